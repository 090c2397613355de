"""Target positions and the stop plans that visit them (ISO 230-2 standard cycle); pure."""

from __future__ import annotations

import numpy as np

from drivers.types import FloatArray, Stop, StopPlan
from gateway.config import AxisSection, MeasureSection, Targets

DECIMALS = 3


def positions(targets: Targets, reference: float) -> FloatArray:
    """Target positions in machine coordinates, shape (m,), ascending.

    Evenly spaced with a random offset of at most `offset_fraction` of the interval (ISO 230-2: P_i =
    (i-1)p + r), so that periodic errors are not aliased. End targets move inward only and the target at the
    reference stays exact: it is the datum.
    """
    if targets.positions:
        return np.sort(np.asarray(targets.positions, dtype=np.float64))
    even = np.linspace(targets.first, targets.last, targets.count)
    interval = (targets.last - targets.first) / (targets.count - 1)
    spread = abs(interval) * targets.offset_fraction
    offsets = np.random.default_rng(targets.seed).uniform(-spread, spread, targets.count)
    offsets[np.abs(even - reference) < abs(interval) / 2] = 0.0
    low, high = sorted((targets.first, targets.last))
    return np.sort(np.round(np.clip(even + offsets, low, high), DECIMALS))


def measuring_plan(axis: AxisSection, at: FloatArray, setup: str, *, name: str) -> StopPlan:
    """Up through all targets, overrun, down through all, `repetitions` times; labels are target indices."""
    measure = axis.measure
    stops: list[Stop] = []
    for repetition in range(measure.repetitions):
        up = [Stop(float(p), 1, repetition, index) for index, p in enumerate(at)]
        down = [Stop(float(p), -1, repetition, index) for index, p in reversed(list(enumerate(at)))]
        stops += up + down
    return plan_of(axis, tuple(stops), setup, name=name, dwell_s=measure.dwell_s)


def jog_plan(axis: AxisSection, start: float, jog: float, setup: str) -> StopPlan:
    """Three stops, all approached from below: start, start + jog, start again; the sense proof's moves."""
    stops = (Stop(start, 1, 0, 0), Stop(start + jog, 1, 0, 1), Stop(start, 1, 0, 2))
    return plan_of(axis, stops, setup, name=f"TFSENSE{axis.letter}", dwell_s=axis.measure.dwell_s)


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
    )


def jog_start(axis: AxisSection, jog: float) -> float:
    """Where the sense jog begins: the middle of the travel for a linear axis, the reference for a rotary one."""
    if axis.kind == "rotary":
        return axis.reference
    low, high = axis.travel
    return round((low + high - jog) / 2.0, DECIMALS)


def expected_travel(plan: StopPlan, index: int) -> float:
    """The least distance the axis leaves stop index-1 by before it stands at stop `index` (0 if it stays)."""
    if index == 0:
        return 0.0
    here, before = plan.stops[index], plan.stops[index - 1]
    if here.switch is not None and here.target == before.target:
        return 0.0
    return max(abs(here.target - before.target), plan.overrun if here.approach != before.approach else 0.0)
