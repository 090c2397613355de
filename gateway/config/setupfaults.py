"""What set-ups say wrong: axes and instruments that there are not, errors of another axis, parking, doubles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from drivers.errors import words
from drivers.local.names import guess
from gateway.config.faults import Fault
from gateway.config.keyfaults import broken
from gateway.config.rules import bounds, instrument_faults, no_such, target_faults, within
from gateway.siteplan import LOCATIONS


def setup_faults(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    """Everything that the set-ups of a file say wrong."""
    axes = {axis.name: axis for axis in site.axes if isinstance(axis.name, str)}
    keys: list[object] = []
    for setup in site.setups:
        yield from instrument_faults(tree, site, (*setup.place, "instrument"), setup.instrument)
        if isinstance(setup.axis, str) and setup.axis not in axes:
            yield no_such(tree, (*setup.place, "axis"), "axis", axes)
        elif isinstance(setup.axis, str):
            yield from _on_axis(tree, setup, axes[setup.axis])
        if isinstance(setup.park, Mapping):
            yield from _parked(tree, setup, axes)
            key = (setup.component, setup.axis, tuple(sorted(setup.park.items())))
            if None not in key and key in keys:
                yield broken(tree, (*setup.place, "component"), words("W-CFG-SETUP-TWICE"))
            keys.append(key)


def _on_axis(tree: Mapping[str, Any], setup: Any, axis: Any) -> Iterator[Fault]:
    yield from _component(tree, setup, axis.letter)
    if axis.kind == "rotary" and isinstance(setup.offset_mm, list) and any(setup.offset_mm[:2]):
        yield broken(tree, (*setup.place, "offset_mm"), words("W-CFG-OFFSET"))
    if setup.datum is not None and not within(setup.datum, *bounds(axis)):
        low, high = bounds(axis)
        yield broken(tree, (*setup.place, "datum"), words("W-CFG-OUTSIDE", low=low, high=high))
    yield from target_faults(tree, axis, setup.targets, getattr(axis.measure, "overrun", None))


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
