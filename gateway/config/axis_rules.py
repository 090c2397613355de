"""Rules of the axes, their safe places and their set-ups: what the sections say against each other."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import pairwise
from math import tau
from typing import Any

from drivers.errors import words
from drivers.local.names import guess, shown
from gateway.config.connections import by_files, is_moved
from gateway.config.faults import Fault, value_at
from gateway.config.model_faults import broken_rule
from gateway.config.rules import (
    LINEAR,
    NEAR,
    ROTARY,
    TURN_DEG,
    all_named,
    bounds,
    feed_faults,
    instrument_faults,
    is_pair,
    is_within,
    no_such,
    target_faults,
    target_positions,
)
from gateway.siteplan import LOCATIONS

# What an axis section says against itself and the rest: kind, letter, ranges, error, instrument, targets.

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
        yield from _faults_of_axis(tree, axis)
        if hasattr(axis.measure, "place"):
            yield from _measurement_faults(tree, site, axis)


def _is_turn(low: float, high: float) -> bool:
    """Whether it is the travel of an axis that turns without end, as controls tell it: 0 to 359.999 too."""
    return low >= 0.0 and high <= TURN_DEG and high - low > TURN_DEG - 1.0


def _faults_of_axis(tree: Mapping[str, Any], axis: Any) -> Iterator[Fault]:
    place, letter = axis.place, axis.letter or "?"
    if (axis.kind == "linear" and letter in ROTARY) or (axis.kind == "rotary" and letter in LINEAR):
        right = "rotary" if letter in ROTARY else "linear"
        yield broken_rule(tree, (*place, "kind"), words("W-CFG-KIND", letter=letter, kind=right))
    if axis.modulo and axis.kind == "linear":
        yield broken_rule(tree, (*place, "modulo"), words("W-CFG-MODULO"))
    elif axis.modulo and is_pair(axis.travel) and not _is_turn(*axis.travel):
        yield broken_rule(tree, (*place, "travel"), words("W-CFG-MODULO-TRAVEL"))
    if isinstance(axis.name, str) and axis.name[:1] in LINEAR + ROTARY and axis.name[:1] != letter and axis.letter:
        yield broken_rule(tree, (*place, "letter"), words("W-CFG-OTHER-LETTER", name=shown(axis.name)), doubt=True)
    if isinstance(axis.name, str) and AXIS_NAME.fullmatch(axis.name) is None:
        yield broken_rule(tree, (*place, "name"), words("W-CFG-AXIS-NAME"), doubt=True)
    low, high = bounds(axis)
    if axis.reference is not None and not is_within(axis.reference, low, high):
        yield broken_rule(tree, (*place, "reference"), words("W-CFG-REFERENCE", low=low, high=high))
    yield from _unit_slips(tree, axis)
    table = axis.table
    yield from _table_of_turn(tree, axis, table)
    for key in ("minimum", "maximum"):
        value = getattr(table, key, None)
        if value is not None and not is_within(value, low, high):
            yield broken_rule(tree, (*table.place, key), words("W-CFG-TABLE", low=low, high=high))


def _table_of_turn(tree: Mapping[str, Any], axis: Any, table: Any) -> Iterator[Fault]:
    """The table of an axis that turns without end covers one turn; any other holds its reference."""
    low, high = (getattr(table, key, None) for key in ("minimum", "maximum"))
    if not (isinstance(low, int | float) and isinstance(high, int | float)):
        return
    if axis.modulo and abs(high - low - TURN_DEG) > NEAR:
        yield replace(broken_rule(tree, (*table.place, "maximum"), words("W-CFG-TURN")), later=True)
    elif not axis.modulo and axis.reference is not None and not is_within(axis.reference, low, high):
        place = (*axis.place, "reference") if "reference" in value_at(tree, axis.place) else (*table.place, "minimum")
        fields = {"reference": axis.reference, "low": low, "high": high}
        yield broken_rule(tree, place, words("W-CFG-REFERENCE-TABLE", **fields), doubt=True)


def _unit_slips(tree: Mapping[str, Any], axis: Any) -> Iterator[Fault]:
    """Values that nobody means in the unit that the file has: a feed in m/min, an expansion in 1/K."""
    low, high = bounds(axis)
    span, rotary = high - low, axis.kind == "rotary"
    unit = "deg" if rotary else "mm"
    if not axis.modulo and ((span < LEAST_TRAVEL_MM and not rotary) or (abs(span - tau) < NEAR_TURN and rotary)):
        yield broken_rule(tree, (*axis.place, "travel"), words("W-CFG-UNIT-TRAVEL", span=span, unit=unit), doubt=True)
    measure = axis.measure
    given = value_at(tree, measure.place) if hasattr(measure, "place") else {}
    feed, stable, expansion = (getattr(measure, key, None) for key in ("feed", "stable", "expansion_ppm_per_k"))
    if feed is not None and (minutes := span / feed) > LONG_MIN and minutes < float("inf"):
        told = words("W-CFG-UNIT-FEED", minutes=round(minutes), unit=unit)
        yield broken_rule(tree, (*measure.place, "feed"), told, doubt=True)
    if feed is not None and feed > FASTEST[unit]:
        yield broken_rule(tree, (*measure.place, "feed"), words("W-CFG-UNIT-FAST", unit=unit), doubt=True)
    if rotary and "jog" in given and measure.jog is not None and measure.jog > LONGEST_JOG_DEG:
        yield broken_rule(tree, (*measure.place, "jog"), words("W-CFG-UNIT-JOG"), doubt=True)
    if "jog" in given and measure.jog is not None and 0.0 < measure.jog < SHORTEST_JOG[unit]:
        yield broken_rule(tree, (*measure.place, "jog"), words("W-CFG-UNIT-JOG-SHORT", unit=unit), doubt=True)
    if stable is not None and not STABLE[0] <= stable <= STABLE[1]:
        told = words("W-CFG-UNIT-STABLE", unit="arcsec" if rotary else "um")
        yield broken_rule(tree, (*measure.place, "stable"), told, doubt=True)
    if expansion is not None and 0.0 < abs(expansion) < LEAST_EXPANSION:
        yield broken_rule(tree, (*measure.place, "expansion_ppm_per_k"), words("W-CFG-UNIT-EXPANSION"), doubt=True)
    for key in ("dwell_s", "settle_s", "average_s"):
        value = given.get(key)
        if isinstance(value, int | float) and value > LONG_S:
            yield broken_rule(tree, (*measure.place, key), words("W-CFG-UNIT-SECONDS"), doubt=True)
    for key in ("dwell_s", "average_s"):
        value = given.get(key)
        if isinstance(value, int | float) and 0.0 < value < MOMENT_S:
            yield broken_rule(tree, (*measure.place, key), words("W-CFG-UNIT-MOMENT"), doubt=True)


def _table_beyond_targets(tree: Mapping[str, Any], axis: Any, measure: Any) -> Iterator[Fault]:
    """A table that reaches further past the outer targets than one step between them: no push takes it."""
    targets, table = measure.targets, axis.table
    if not (hasattr(targets, "place") and hasattr(table, "place")):
        return
    at, ends = target_positions(targets), (table.minimum, table.maximum, table.step)
    if len(at) < 2 or not all(isinstance(one, int | float) for one in (*at, *ends)):
        return
    if not isinstance(targets.count, str) and len(at) < LEAST_TARGETS:
        yield broken_rule(tree, targets.place, words("W-CFG-TARGETS-FEW", least=LEAST_TARGETS), doubt=True)
    if table.step > 0.0 and (steps := (table.maximum - table.minimum) / table.step) < LEAST_STEPS:
        yield broken_rule(tree, (*table.place, "step"), words("W-CFG-STEPS-FEW", points=round(steps) + 1), doubt=True)
    widest = max(*(after - before for before, after in pairwise(at)), table.step)
    if axis.modulo:
        beyond, key = TURN_DEG - (at[-1] - at[0]), "maximum"
    else:
        beyond, key = max((at[0] - table.minimum, "minimum"), (table.maximum - at[-1], "maximum"))
    if beyond > widest + NEAR:
        told = words("W-CFG-UNMEASURED", beyond=beyond, low=at[0], high=at[-1], widest=widest)
        yield broken_rule(tree, (*table.place, key), told, doubt=True)


def _idle_measure_keys(tree: Mapping[str, Any], measure: Any) -> Iterator[Fault]:
    """Keys that have no effect where the deviations come from a file, or where they do not."""
    given = value_at(tree, measure.place)
    idle, beside = (LIVE_KEYS, "beside file") if measure.file is not None else (FILE_KEYS, "without file")
    for key in idle:
        if key in given:
            yield broken_rule(tree, (*measure.place, key), words("W-CFG-IDLE", beside=beside), doubt=True)


def _measurement_faults(tree: Mapping[str, Any], site: Any, axis: Any) -> Iterator[Fault]:
    measure, place, letter = axis.measure, axis.measure.place, axis.letter
    own = f"E{letter}{letter}"
    if letter and measure.component is not None and measure.component != own:
        # Who works with set-ups alone takes an axis whose own deviation has no name; nobody measures it by this.
        fault = broken_rule(tree, (*place, "component"), words("W-CFG-OWN", own=own, letter=letter))
        yield replace(fault, later=MOTION.fullmatch(str(measure.component)) is None)
    yield from _idle_measure_keys(tree, measure)
    if isinstance(measure.repetitions, int) and measure.repetitions < LEAST_REPETITIONS and measure.file is None:
        yield broken_rule(
            tree, (*place, "repetitions"), words("W-CFG-REPETITIONS", least=LEAST_REPETITIONS), doubt=True
        )
    if measure.file is None:
        if measure.instrument == "" and is_moved(site):
            yield broken_rule(tree, place, words("W-CFG-LIVE-NEEDS"))
        yield from instrument_faults(tree, site, (*place, "instrument"), measure.instrument)
        yield from feed_faults(tree, site, axis)
        yield from _table_beyond_targets(tree, axis, measure)
    elif measure.file_datum is not None and not is_within(measure.file_datum, *bounds(axis)):
        low, high = bounds(axis)
        yield broken_rule(tree, (*place, "file_datum"), words("W-CFG-OUTSIDE", low=low, high=high))
    yield from target_faults(tree, axis, measure.targets, measure.overrun if measure.file is None else 0.0)
    low, high = bounds(axis)
    if measure.jog is not None and measure.jog > high - low:
        yield broken_rule(tree, (*place, "jog"), words("W-CFG-JOG", span=high - low))


# What a site file says wrong of safe places, and which axes still need one before anything is pushed.

_SAFE = ("moves", "safe")
ANY = "any"
_FEEDS = (("feed_mm", 20.0, "mm"), ("feed_deg", 5.0, "deg"))
"""Feeds below which a push would crawl from place to place, per minute: more likely a slip of the unit."""


def moves_faults(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    """Places that are no range or beyond the travel, feeds of another unit, and every axis without a place."""
    written = value_at(tree, _SAFE)
    given = written if isinstance(written, Mapping) else {}
    axes = {axis.name: axis for axis in site.axes if isinstance(axis.name, str)}
    for name, place in given.items():
        if place == ANY and getattr(axes.get(name), "kind", None) == "linear":
            yield broken_rule(tree, (*_SAFE, name), words("W-CFG-PLACE-ANY"), doubt=True)
        if not is_pair(place):
            continue
        if place[0] >= place[1]:
            yield broken_rule(tree, (*_SAFE, name), words("W-CFG-TRAVEL"))
        elif name in axes:
            low, high = bounds(axes[name])
            beyond = not (is_within(place[0], low, high) and is_within(place[1], low, high))
            if beyond:
                apart = place[1] <= low or place[0] >= high
                yield broken_rule(tree, (*_SAFE, name), words("W-CFG-OUTSIDE", low=low, high=high), doubt=not apart)
    for key, least, unit in _FEEDS:
        feed = getattr(site.moves, key, None)
        if isinstance(feed, int | float) and 0.0 < feed < least:
            yield broken_rule(tree, ("moves", key), words("W-CFG-UNIT-SLOW", unit=unit), doubt=True)
    dresser = getattr(site.work, "dresser", None)
    known = [*axes, *([dresser] if isinstance(dresser, str) and dresser else [])]
    missing = [name for name in known if name not in given]
    for name in given:
        # An axis of the control that the file measures nothing of may well have a place: only a likely slip is told.
        if name not in known and (meant := [one for one in missing if one[:1] == name[:1].upper()]):
            missing.remove(meant[0])
            yield broken_rule(tree, (*_SAFE, name), words("W-CFG-PLACE-MEANT", meant=meant[0]), doubt=True)
    if missing and not by_files(site):
        yield broken_rule(tree, _SAFE, words("W-CFG-NO-PLACE", axes=", ".join(missing), first=missing[0]), doubt=True)


# What set-ups say wrong: axes and instruments that there are not, errors of another axis, parking, doubles.

SQUARE = "B0Z"
_FILE = ("path", "unit", "datum", "file_axis_sense")
_LIVE = ("instrument", "channel", "targets", "repetitions", "settle_s", "average_s", "stable", "jog", "sense")
_IDLE = {"live": _FILE, "file": ("instrument", "channel", "jog"), "none": (*_FILE, *_LIVE)}


def setup_faults(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    """Everything that the set-ups of a file say wrong."""
    axes = {axis.name: axis for axis in site.axes if isinstance(axis.name, str)}
    whole = all_named(site.axes)
    keys: list[object] = []
    for setup in site.setups:
        yield from instrument_faults(tree, site, (*setup.place, "instrument"), setup.instrument)
        if isinstance(setup.axis, str) and setup.axis not in axes:
            if whole:
                yield no_such(tree, (*setup.place, "axis"), "axis", axes)
        elif isinstance(setup.axis, str):
            yield from _on_axis(tree, site, setup, axes[setup.axis])
        if whole and isinstance(setup.park, Mapping):
            yield from _parking_faults(tree, setup, axes)
            key = (setup.component, setup.axis, tuple(sorted(setup.park.items())))
            if None not in key and key in keys:
                yield broken_rule(tree, (*setup.place, "component"), words("W-CFG-SETUP-TWICE"))
            keys.append(key)
    if whole and all(isinstance(axis.letter, str) for axis in site.axes):
        yield from _arms(tree, site.setups, axes)


def _arms(tree: Mapping[str, Any], setups: Any, axes: Mapping[str, Any]) -> Iterator[Fault]:
    """A square is measured along both its arms."""
    found = {}
    for one in setups:
        letter = getattr(axes.get(str(one.axis)), "letter", None)
        if one.component == SQUARE and one.source != "none" and letter in LOCATIONS[SQUARE]:
            found[letter] = one
    missing = set(LOCATIONS[SQUARE]) - set(found)
    if len(found) == 1 and missing:
        place = (*next(iter(found.values())).place, "component")
        yield broken_rule(tree, place, words("W-CFG-SECOND-ARM", axis=missing.pop()), doubt=True)


def _on_axis(tree: Mapping[str, Any], site: Any, setup: Any, axis: Any) -> Iterator[Fault]:
    yield from _error_not_of_axis(tree, setup, axis.letter)
    if setup.source == "live" and setup.instrument not in (None, "", getattr(axis.measure, "instrument", None)):
        yield from feed_faults(tree, site, axis, instrument=setup.instrument, place=(*setup.place, "instrument"))
    yield from _idle_setup_keys(tree, setup)
    if axis.kind == "rotary" and isinstance(setup.offset_mm, list) and any(setup.offset_mm[:2]):
        yield broken_rule(tree, (*setup.place, "offset_mm"), words("W-CFG-OFFSET"))
    if setup.datum is not None and not is_within(setup.datum, *bounds(axis)):
        low, high = bounds(axis)
        yield broken_rule(tree, (*setup.place, "datum"), words("W-CFG-OUTSIDE", low=low, high=high))
    overrun = getattr(axis.measure, "overrun", None) if setup.source == "live" else None
    yield from target_faults(tree, axis, setup.targets, overrun)


def _error_not_of_axis(tree: Mapping[str, Any], setup: Any, letter: Any) -> Iterator[Fault]:
    """An error motion is measured along its own axis, a location error along one that can show it."""
    if not isinstance(setup.component, str) or not isinstance(letter, str):
        return
    name, path = setup.component.removesuffix("-R"), (*setup.place, "component")
    if name[1] == "0":
        if letter not in LOCATIONS.get(name, ()):
            known = ", ".join(f"{one} on {' and '.join(on)}" for one, on in LOCATIONS.items())
            yield broken_rule(tree, path, words("W-CFG-LOCATION", known=known))
    elif name[2] != letter:
        yield broken_rule(
            tree, path, words("W-CFG-MOTION", of=name[2], letter=letter) + guess(name, (name[:2] + letter,))
        )


def _idle_setup_keys(tree: Mapping[str, Any], setup: Any) -> Iterator[Fault]:
    """Keys that have no effect with this source, or with this error."""
    given = value_at(tree, setup.place)
    idle = [(key, f'with source = "{setup.source}"') for key in _IDLE.get(setup.source, ())]
    if isinstance(setup.component, str) and setup.component[1:2] != "0":
        idle.append(("own_angle_arcsec", "beside a location error alone"))
    for key, where in idle:
        if key in given:
            yield broken_rule(tree, (*setup.place, key), words("W-CFG-IDLE", beside=where), doubt=True)


def _parking_faults(tree: Mapping[str, Any], setup: Any, axes: Mapping[str, Any]) -> Iterator[Fault]:
    for name, value in setup.park.items():
        path = (*setup.place, "park", name)
        if name == setup.axis:
            yield broken_rule(tree, path, words("W-CFG-PARK-SELF"))
        elif name not in axes:
            known = (", ".join(sorted(set(axes) - {setup.axis})) or words("W-CFG-NONE")) + guess(name, axes)
            yield broken_rule(tree, path, words("W-CFG-PARK", known=known))
        elif not is_within(value, *bounds(axes[name])):
            low, high = bounds(axes[name])
            yield broken_rule(tree, path, words("W-CFG-OUTSIDE", low=low, high=high))
