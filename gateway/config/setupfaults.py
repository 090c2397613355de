"""What set-ups say wrong: axes and instruments that there are not, errors of another axis, parking, doubles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from drivers.errors import words
from drivers.local.names import guess
from gateway.config.faults import Fault
from gateway.config.keyfaults import broken
from gateway.config.places import held
from gateway.config.rules import all_named, bounds, feed_faults, instrument_faults, no_such, target_faults, within
from gateway.siteplan import LOCATIONS

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
            yield from _parked(tree, setup, axes)
            key = (setup.component, setup.axis, tuple(sorted(setup.park.items())))
            if None not in key and key in keys:
                yield broken(tree, (*setup.place, "component"), words("W-CFG-SETUP-TWICE"))
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
        yield broken(tree, place, words("W-CFG-SECOND-ARM", axis=missing.pop()), doubt=True)


def _on_axis(tree: Mapping[str, Any], site: Any, setup: Any, axis: Any) -> Iterator[Fault]:
    yield from _component(tree, setup, axis.letter)
    if setup.source == "live" and setup.instrument not in (None, "", getattr(axis.measure, "instrument", None)):
        yield from feed_faults(tree, site, axis, instrument=setup.instrument, place=(*setup.place, "instrument"))
    yield from _idle(tree, setup)
    if axis.kind == "rotary" and isinstance(setup.offset_mm, list) and any(setup.offset_mm[:2]):
        yield broken(tree, (*setup.place, "offset_mm"), words("W-CFG-OFFSET"))
    if setup.datum is not None and not within(setup.datum, *bounds(axis)):
        low, high = bounds(axis)
        yield broken(tree, (*setup.place, "datum"), words("W-CFG-OUTSIDE", low=low, high=high))
    overrun = getattr(axis.measure, "overrun", None) if setup.source == "live" else None
    yield from target_faults(tree, axis, setup.targets, overrun)


def _component(tree: Mapping[str, Any], setup: Any, letter: Any) -> Iterator[Fault]:
    """An error motion is measured along its own axis, a location error along one that can show it."""
    if not isinstance(setup.component, str) or not isinstance(letter, str):
        return
    name, path = setup.component.removesuffix("-R"), (*setup.place, "component")
    if name[1] == "0":
        if letter not in LOCATIONS.get(name, ()):
            known = ", ".join(f"{one} on {' and '.join(on)}" for one, on in LOCATIONS.items())
            yield broken(tree, path, words("W-CFG-LOCATION", known=known))
    elif name[2] != letter:
        yield broken(tree, path, words("W-CFG-MOTION", of=name[2], letter=letter) + guess(name, (name[:2] + letter,)))


def _idle(tree: Mapping[str, Any], setup: Any) -> Iterator[Fault]:
    """Keys that have no effect with this source, or with this error."""
    given = held(tree, setup.place)
    idle = [(key, f'with source = "{setup.source}"') for key in _IDLE.get(setup.source, ())]
    if isinstance(setup.component, str) and setup.component[1:2] != "0":
        idle.append(("own_angle_arcsec", "beside a location error alone"))
    for key, where in idle:
        if key in given:
            yield broken(tree, (*setup.place, key), words("W-CFG-IDLE", beside=where), doubt=True)


def _parked(tree: Mapping[str, Any], setup: Any, axes: Mapping[str, Any]) -> Iterator[Fault]:
    for name, value in setup.park.items():
        path = (*setup.place, "park", name)
        if name == setup.axis:
            yield broken(tree, path, words("W-CFG-PARK-SELF"))
        elif name not in axes:
            known = (", ".join(sorted(set(axes) - {setup.axis})) or words("W-CFG-NONE")) + guess(name, axes)
            yield broken(tree, path, words("W-CFG-PARK", known=known))
        elif not within(value, *bounds(axes[name])):
            low, high = bounds(axes[name])
            yield broken(tree, path, words("W-CFG-OUTSIDE", low=low, high=high))
