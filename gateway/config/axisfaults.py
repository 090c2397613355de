"""What an axis section says against itself and the rest: kind, letter, ranges, error, instrument, targets."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import pairwise
from math import tau
from typing import Any

from drivers.errors import words
from drivers.local.names import shown
from gateway.config.faults import Fault
from gateway.config.keyfaults import broken
from gateway.config.places import held
from gateway.config.reaching import is_moved
from gateway.config.rules import (
    LINEAR,
    NEAR,
    ROTARY,
    TURN_DEG,
    bounds,
    feed_faults,
    instrument_faults,
    is_pair,
    target_faults,
    target_positions,
    within,
)

AXIS_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
MOTION = re.compile(r"E[A-Z][A-Z]")
# What lies beyond is taken for a slip of the unit: no machine tool travels so short, feeds so slow, scatters so.
LEAST_TRAVEL_MM, LONG_MIN, LONG_S, STABLE, LEAST_EXPANSION = 5.0, 20.0, 60.0, (0.005, 50.0), 0.02
FASTEST = {"mm": 120_000.0, "deg": 72_000.0}  # a minute
LONGEST_JOG_DEG, MOMENT_S = 1.0, 0.02
SHORTEST_JOG = {"mm": 0.1, "deg": 0.001}
NEAR_TURN = 0.1
LEAST_TARGETS, LEAST_STEPS, LEAST_REPETITIONS = 5, 4, 3
LIVE_KEYS = ("instrument", "targets", "beam", "dead_path_mm")
FILE_KEYS = ("file_datum", "file_axis_sense", "file_unit")


def axis_faults(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    """Everything that the axes of a file say wrong."""
    for axis in site.axes:
        yield from _axis(tree, axis)
        if hasattr(axis.measure, "place"):
            yield from _measured(tree, site, axis)


def _is_turn(low: float, high: float) -> bool:
    """Whether it is the travel of an axis that turns without end, as controls tell it: 0 to 359.999 too."""
    return low >= 0.0 and high <= TURN_DEG and high - low > TURN_DEG - 1.0


def _axis(tree: Mapping[str, Any], axis: Any) -> Iterator[Fault]:
    place, letter = axis.place, axis.letter or "?"
    if (axis.kind == "linear" and letter in ROTARY) or (axis.kind == "rotary" and letter in LINEAR):
        right = "rotary" if letter in ROTARY else "linear"
        yield broken(tree, (*place, "kind"), words("W-CFG-KIND", letter=letter, kind=right))
    if axis.modulo and axis.kind == "linear":
        yield broken(tree, (*place, "modulo"), words("W-CFG-MODULO"))
    elif axis.modulo and is_pair(axis.travel) and not _is_turn(*axis.travel):
        yield broken(tree, (*place, "travel"), words("W-CFG-MODULO-TRAVEL"))
    if isinstance(axis.name, str) and axis.name[:1] in LINEAR + ROTARY and axis.name[:1] != letter and axis.letter:
        yield broken(tree, (*place, "letter"), words("W-CFG-OTHER-LETTER", name=shown(axis.name)), doubt=True)
    if isinstance(axis.name, str) and AXIS_NAME.fullmatch(axis.name) is None:
        yield broken(tree, (*place, "name"), words("W-CFG-AXIS-NAME"), doubt=True)
    low, high = bounds(axis)
    if axis.reference is not None and not within(axis.reference, low, high):
        yield broken(tree, (*place, "reference"), words("W-CFG-REFERENCE", low=low, high=high))
    yield from _unit_slips(tree, axis)
    table = axis.table
    yield from _turn(tree, axis, table)
    for key in ("minimum", "maximum"):
        value = getattr(table, key, None)
        if value is not None and not within(value, low, high):
            yield broken(tree, (*table.place, key), words("W-CFG-TABLE", low=low, high=high))


def _turn(tree: Mapping[str, Any], axis: Any, table: Any) -> Iterator[Fault]:
    """The table of an axis that turns without end covers one turn; any other holds its reference."""
    low, high = (getattr(table, key, None) for key in ("minimum", "maximum"))
    if not (isinstance(low, int | float) and isinstance(high, int | float)):
        return
    if axis.modulo and abs(high - low - TURN_DEG) > NEAR:
        yield replace(broken(tree, (*table.place, "maximum"), words("W-CFG-TURN")), later=True)
    elif not axis.modulo and axis.reference is not None and not within(axis.reference, low, high):
        place = (*axis.place, "reference") if "reference" in held(tree, axis.place) else (*table.place, "minimum")
        fields = {"reference": axis.reference, "low": low, "high": high}
        yield broken(tree, place, words("W-CFG-REFERENCE-TABLE", **fields), doubt=True)


def _unit_slips(tree: Mapping[str, Any], axis: Any) -> Iterator[Fault]:
    """Values that nobody means in the unit that the file has: a feed in m/min, an expansion in 1/K."""
    low, high = bounds(axis)
    span, rotary = high - low, axis.kind == "rotary"
    unit = "deg" if rotary else "mm"
    if not axis.modulo and ((span < LEAST_TRAVEL_MM and not rotary) or (abs(span - tau) < NEAR_TURN and rotary)):
        yield broken(tree, (*axis.place, "travel"), words("W-CFG-UNIT-TRAVEL", span=span, unit=unit), doubt=True)
    measure = axis.measure
    given = held(tree, measure.place) if hasattr(measure, "place") else {}
    feed, stable, expansion = (getattr(measure, key, None) for key in ("feed", "stable", "expansion_ppm_per_k"))
    if feed is not None and (minutes := span / feed) > LONG_MIN and minutes < float("inf"):
        told = words("W-CFG-UNIT-FEED", minutes=round(minutes), unit=unit)
        yield broken(tree, (*measure.place, "feed"), told, doubt=True)
    if feed is not None and feed > FASTEST[unit]:
        yield broken(tree, (*measure.place, "feed"), words("W-CFG-UNIT-FAST", unit=unit), doubt=True)
    if rotary and "jog" in given and measure.jog is not None and measure.jog > LONGEST_JOG_DEG:
        yield broken(tree, (*measure.place, "jog"), words("W-CFG-UNIT-JOG"), doubt=True)
    if "jog" in given and measure.jog is not None and 0.0 < measure.jog < SHORTEST_JOG[unit]:
        yield broken(tree, (*measure.place, "jog"), words("W-CFG-UNIT-JOG-SHORT", unit=unit), doubt=True)
    if stable is not None and not STABLE[0] <= stable <= STABLE[1]:
        told = words("W-CFG-UNIT-STABLE", unit="arcsec" if rotary else "um")
        yield broken(tree, (*measure.place, "stable"), told, doubt=True)
    if expansion is not None and 0.0 < abs(expansion) < LEAST_EXPANSION:
        yield broken(tree, (*measure.place, "expansion_ppm_per_k"), words("W-CFG-UNIT-EXPANSION"), doubt=True)
    for key in ("dwell_s", "settle_s", "average_s"):
        value = given.get(key)
        if isinstance(value, int | float) and value > LONG_S:
            yield broken(tree, (*measure.place, key), words("W-CFG-UNIT-SECONDS"), doubt=True)
    for key in ("dwell_s", "average_s"):
        value = given.get(key)
        if isinstance(value, int | float) and 0.0 < value < MOMENT_S:
            yield broken(tree, (*measure.place, key), words("W-CFG-UNIT-MOMENT"), doubt=True)


def _unmeasured(tree: Mapping[str, Any], axis: Any, measure: Any) -> Iterator[Fault]:
    """A table that reaches further past the outer targets than one step between them: no push takes it."""
    targets, table = measure.targets, axis.table
    if not (hasattr(targets, "place") and hasattr(table, "place")):
        return
    at, ends = target_positions(targets), (table.minimum, table.maximum, table.step)
    if len(at) < 2 or not all(isinstance(one, int | float) for one in (*at, *ends)):
        return
    if not isinstance(targets.count, str) and len(at) < LEAST_TARGETS:
        yield broken(tree, targets.place, words("W-CFG-TARGETS-FEW", least=LEAST_TARGETS), doubt=True)
    if table.step > 0.0 and (steps := (table.maximum - table.minimum) / table.step) < LEAST_STEPS:
        yield broken(tree, (*table.place, "step"), words("W-CFG-STEPS-FEW", points=round(steps) + 1), doubt=True)
    widest = max(*(after - before for before, after in pairwise(at)), table.step)
    if axis.modulo:
        beyond, key = TURN_DEG - (at[-1] - at[0]), "maximum"
    else:
        beyond, key = max((at[0] - table.minimum, "minimum"), (table.maximum - at[-1], "maximum"))
    if beyond > widest + NEAR:
        told = words("W-CFG-UNMEASURED", beyond=beyond, low=at[0], high=at[-1], widest=widest)
        yield broken(tree, (*table.place, key), told, doubt=True)


def _idle(tree: Mapping[str, Any], measure: Any) -> Iterator[Fault]:
    """Keys that have no effect where the deviations come from a file, or where they do not."""
    given = held(tree, measure.place)
    idle, beside = (LIVE_KEYS, "beside file") if measure.file is not None else (FILE_KEYS, "without file")
    for key in idle:
        if key in given:
            yield broken(tree, (*measure.place, key), words("W-CFG-IDLE", beside=beside), doubt=True)


def _measured(tree: Mapping[str, Any], site: Any, axis: Any) -> Iterator[Fault]:
    measure, place, letter = axis.measure, axis.measure.place, axis.letter
    own = f"E{letter}{letter}"
    if letter and measure.component is not None and measure.component != own:
        # Who works with set-ups alone takes an axis whose own deviation has no name; nobody measures it by this.
        fault = broken(tree, (*place, "component"), words("W-CFG-OWN", own=own, letter=letter))
        yield replace(fault, later=MOTION.fullmatch(str(measure.component)) is None)
    yield from _idle(tree, measure)
    if isinstance(measure.repetitions, int) and measure.repetitions < LEAST_REPETITIONS and measure.file is None:
        yield broken(tree, (*place, "repetitions"), words("W-CFG-REPETITIONS", least=LEAST_REPETITIONS), doubt=True)
    if measure.file is None:
        if measure.instrument == "" and is_moved(site):
            yield broken(tree, place, words("W-CFG-LIVE-NEEDS"))
        yield from instrument_faults(tree, site, (*place, "instrument"), measure.instrument)
        yield from feed_faults(tree, site, axis)
        yield from _unmeasured(tree, axis, measure)
    elif measure.file_datum is not None and not within(measure.file_datum, *bounds(axis)):
        low, high = bounds(axis)
        yield broken(tree, (*place, "file_datum"), words("W-CFG-OUTSIDE", low=low, high=high))
    yield from target_faults(tree, axis, measure.targets, measure.overrun if measure.file is None else 0.0)
    low, high = bounds(axis)
    if measure.jog is not None and measure.jog > high - low:
        yield broken(tree, (*place, "jog"), words("W-CFG-JOG", span=high - low))
