"""Target positions, the order in which stop plans visit them (ISO 230-2 cycles), and how long that takes; pure."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Literal

import numpy as np

from drivers.types.stops import Stop, StopPlan
from drivers.types.values import FloatArray
from gateway.config import AxisSection, MeasureSection, Targets, WorkingWindow
from gateway.evaluate.standards.iso230_2 import minimum_targets

# Target positions and the stop plans that visit them (ISO 230-2 standard cycle); pure.

DECIMALS = 3
RULE_OFFSET = 0.3
TARGETS_PER_CHECK = 4
OFF_TARGET = 0.2
# So often is a check stop visited from each side: the median then bears one reading out of line, and more places tell
# more than more repetitions.
CHECK_REPETITIONS = 2


def positions(targets: Targets, reference: float, *, rotary: bool = False) -> FloatArray:
    """Target positions in machine coordinates, shape (m,), ascending.

    Evenly spaced with a random offset of at most `offset_fraction` of the interval (ISO 230-2: P_i =
    (i-1)p + r), so that periodic errors are not aliased. End targets move inward only and the target at the
    reference stays exact: it is the datum.
    """
    travel = _of_travel(targets, reference, rotary=rotary)
    return travel if targets.window is None else with_window(travel, _of_window(targets.window))


def _of_travel(targets: Targets, reference: float, *, rotary: bool) -> FloatArray:
    if targets.positions:
        return np.sort(np.asarray(targets.positions, dtype=np.float64))
    low, high = sorted((targets.first, targets.last))
    by_rule = isinstance(targets.count, str)
    kind: Literal["linear", "rotary"] = "rotary" if rotary else "linear"
    count = minimum_targets(kind, high - low)[0] if isinstance(targets.count, str) else targets.count
    even = np.linspace(targets.first, targets.last, count)
    interval = (targets.last - targets.first) / (count - 1)
    spread = abs(interval) * (targets.offset_fraction or (RULE_OFFSET if by_rule else 0.0))
    offsets = np.random.default_rng(targets.seed).uniform(-spread, spread, count)
    offsets[np.abs(even - reference) < abs(interval) / 2] = 0.0
    return np.sort(np.round(np.clip(even + offsets, low, high), DECIMALS))


def between_places(targets: FloatArray, count: int, seed: int) -> FloatArray:
    """Places (k,) for check stops, ascending: one at random in each of k equal stretches, never close to a target.

    One for every four targets at most. The same seed gives the same places, another one others, so that structure
    which repeats at the targets' spacing meets each of them at another phase.
    """
    k = min(count, len(targets) // TARGETS_PER_CHECK)
    if k < 1:
        return np.empty(0)
    drawn = np.random.default_rng([seed, len(targets)]).uniform(0.0, 1.0, k)
    place = targets[0] + (np.arange(k) + drawn) * (targets[-1] - targets[0]) / k
    left = np.clip(np.searchsorted(targets, place, side="right") - 1, 0, len(targets) - 2)
    gap = targets[left + 1] - targets[left]
    share = OFF_TARGET + (1.0 - 2.0 * OFF_TARGET) * (place - targets[left]) / gap
    return np.unique(np.round(targets[left] + share * gap, DECIMALS))


def with_checks(targets: FloatArray, between: FloatArray | None) -> tuple[FloatArray, tuple[int, ...]]:
    """All places (m + k,) ascending, and which of them are check stops."""
    if between is None or not between.size:
        return targets, ()
    places = np.concatenate([targets, between])
    order = np.argsort(places)
    return places[order], tuple(int(i) for i in np.flatnonzero(order >= targets.size))


def targets_of(axis: AxisSection) -> FloatArray:
    """Where an axis stops to be measured, (m,); empty without targets."""
    wanted = axis.measure.targets
    return np.empty(0) if wanted is None else positions(wanted, axis.reference, rotary=axis.kind == "rotary")


def _of_window(window: WorkingWindow) -> FloatArray:
    count = int(np.floor((window.last - window.first) / window.step + 1e-9)) + 1
    return np.asarray(np.round(window.first + window.step * np.arange(count), DECIMALS))


def measuring_plan(
    axis: AxisSection, at: FloatArray, setup: str, *, name: str = "", checks: tuple[int, ...] = ()
) -> StopPlan:
    """All visits of the axis' cycle; labels are target indices, those of ``checks`` are visited twice only."""
    every = cycle_visits(axis.measure.cycle, at, axis.measure.repetitions)
    stops = tuple(stop for stop in every if stop.label not in checks or stop.repetition < CHECK_REPETITIONS)
    plan = plan_of(axis, stops, setup, name=name or f"TFMEAS{axis.letter}", dwell_s=axis.measure.dwell_s)
    return replace(plan, further=True)


def jog_plan(axis: AxisSection, start: float, jog: float, setup: str) -> StopPlan:
    """Three stops, all approached from below: start, start + jog, start again; the sense proof's moves."""
    stops = (Stop(start, 1, 0, 0), Stop(start + jog, 1, 0, 1), Stop(start, 1, 0, 2))
    return plan_of(axis, stops, setup, name=f"TFSENSE{axis.letter}", dwell_s=axis.measure.dwell_s)


def step_plan(axis: AxisSection, start: float, message: str) -> StopPlan:
    """One stop, after a person has done what the message says."""
    dwell_s = axis.measure.dwell_s
    return plan_of(axis, (Stop(start, 1, 0, 0),), message, name=f"TFSENSE{axis.letter}", dwell_s=dwell_s)


def plan_of(
    axis: AxisSection, stops: tuple[Stop, ...], setup: str, *, name: str, dwell_s: float, save: bool = True
) -> StopPlan:
    """A stop plan with the axis' own facts filled in."""
    measure: MeasureSection = axis.measure
    return StopPlan(
        name=name,
        axis=axis.name,
        letter=axis.letter,
        unit=axis.unit,
        rotary=axis.kind == "rotary",
        stops=stops,
        feed=measure.feed,
        overrun=measure.overrun,
        dwell_s=dwell_s,
        setup=setup,
        save_tables=save,
        encoder=axis.encoder,
        encoder_said=axis.encoder_said,
    )


def jog_start(axis: AxisSection, jog: float) -> float:
    """Where the sense jog begins: the middle of the travel for a linear axis, the reference for a rotary one."""
    if axis.kind == "rotary":
        return axis.reference
    low, high = axis.travel
    return round((low + high - jog) / 2.0, DECIMALS)


def expected_travel(before: Stop, here: Stop, overrun: float) -> float:
    """The least distance the axis leaves stop `before` by until it stands at stop `here`.

    0 where it stays to be switched, and where it may stay: the same target from the same side.
    """
    if here.switch is not None and here.target == before.target:
        return 0.0
    return max(abs(here.target - before.target), overrun if here.approach != before.approach else 0.0)


# In which order targets are visited: standard, step (pendulum) and pilgrim cycles; pure.
#
# ISO 230-2 reports rest on the standard cycle alone: all targets up, all down, again and again. The step cycle
# swings over each target before it goes on; the pilgrim cycle goes up and down over a few targets, then on to the
# next few. Both lose less to drift and more to local heating, and are reported as what they are.

Cycle = Literal["standard", "pendulum", "pilgrim"]
SECTION = 4


def cycle_visits(cycle: Cycle, targets: FloatArray, repetitions: int) -> tuple[Stop, ...]:
    """Every (target, repetition, approach) once; ``targets`` (m,) ascending, a stop's label is its index."""
    chosen: dict[str, Callable[[FloatArray, int], Iterator[Stop]]]
    chosen = {"standard": _standard, "pendulum": _pendulum, "pilgrim": _pilgrim}
    return tuple(chosen[cycle](targets, repetitions))


def _up_and_down(targets: FloatArray, indices: range, repetition: int) -> Iterator[Stop]:
    for index in indices:
        yield Stop(float(targets[index]), 1, repetition, index)
    for index in reversed(indices):
        yield Stop(float(targets[index]), -1, repetition, index)


def _standard(targets: FloatArray, repetitions: int) -> Iterator[Stop]:
    for repetition in range(repetitions):
        yield from _up_and_down(targets, range(len(targets)), repetition)


def _pendulum(targets: FloatArray, repetitions: int) -> Iterator[Stop]:
    for index in range(len(targets)):
        for repetition in range(repetitions):
            yield from _up_and_down(targets, range(index, index + 1), repetition)


def _pilgrim(targets: FloatArray, repetitions: int) -> Iterator[Stop]:
    for repetition in range(repetitions):
        for start in range(0, len(targets), SECTION):
            yield from _up_and_down(targets, range(start, min(start + SECTION, len(targets))), repetition)


def with_window(targets: FloatArray, window: FloatArray) -> FloatArray:
    """Targets of the full travel and of a working window together, ascending.

    Within the window its own points stand; a target of the travel gives way where a point of the window lies
    nearer than half the window's step.
    """
    if len(window) < 2:
        return targets
    step = float(np.min(np.diff(window)))
    nearest = np.min(np.abs(targets[:, None] - window[None, :]), axis=1)
    return np.sort(np.concatenate([targets[nearest >= 0.5 * step], window]))


# How long stops take by the site's own figures: travel at the feed, overruns, dwell, settling, averaging; pure.

HANDSHAKE_S = 1.0  # from a reading to the next move, and until the stream has caught up


def reading_s(measure: MeasureSection) -> float:
    """Seconds that an axis stands at a stop after the dwell, until its reading is taken."""
    return measure.settle_s + measure.average_s + HANDSHAKE_S


def way_of(plan: StopPlan) -> float:
    """How far the axis goes from the first stop to the last, mm or deg, with its overruns."""
    return sum(_leg(before, here, plan.overrun) for before, here in pairwise(plan.stops))


def plan_s(plan: StopPlan, standing_s: float) -> float:
    """Seconds from the first stop to the end; ``standing_s`` is what each takes beyond the program's dwell."""
    return len(plan.stops) * (plan.dwell_s + standing_s) + way_of(plan) / plan.feed * 60.0


def _leg(before: Stop, here: Stop, overrun: float) -> float:
    """Past the target and back where it is not approached in the direction in which the axis comes."""
    along = here.target - before.target
    if here.switch is not None and not along:
        return 0.0
    return abs(along) + (0.0 if along * here.approach > 0.0 else 2.0 * overrun)
