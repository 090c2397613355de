"""What an axis section says against itself and the rest: kind, letter, ranges, error, instrument, targets."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from drivers.errors import words
from drivers.local.names import shown
from gateway.config.faults import Fault
from gateway.config.keyfaults import broken
from gateway.config.rules import LINEAR, ROTARY, TURN_DEG, bounds, instrument_faults, is_pair, target_faults, within

MOTION = re.compile(r"E[A-Z][A-Z]")


def axis_faults(tree: Mapping[str, Any], site: Any) -> Iterator[Fault]:
    """Everything that the axes of a file say wrong."""
    for axis in site.axes:
        yield from _axis(tree, axis)
        if hasattr(axis.measure, "place"):
            yield from _measured(tree, site, axis)


def _axis(tree: Mapping[str, Any], axis: Any) -> Iterator[Fault]:
    place, letter = axis.place, axis.letter or "?"
    if (axis.kind == "linear" and letter in ROTARY) or (axis.kind == "rotary" and letter in LINEAR):
        right = "rotary" if letter in ROTARY else "linear"
        yield broken(tree, (*place, "kind"), words("W-CFG-KIND", letter=letter, kind=right))
    if axis.modulo and axis.kind == "linear":
        yield broken(tree, (*place, "modulo"), words("W-CFG-MODULO"))
    elif axis.modulo and is_pair(axis.travel) and not (axis.travel[0] >= 0.0 and axis.travel[1] <= TURN_DEG):
        yield broken(tree, (*place, "travel"), words("W-CFG-MODULO-TRAVEL"))
    if isinstance(axis.name, str) and axis.name[:1] in LINEAR + ROTARY and axis.name[:1] != letter and axis.letter:
        yield broken(tree, (*place, "letter"), words("W-CFG-OTHER-LETTER", name=shown(axis.name)), doubt=True)
    low, high = bounds(axis)
    if axis.reference is not None and not within(axis.reference, low, high):
        yield broken(tree, (*place, "reference"), words("W-CFG-REFERENCE", low=low, high=high))
    table = axis.table
    for key in ("minimum", "maximum"):
        value = getattr(table, key, None)
        if value is not None and not within(value, low, high):
            yield broken(tree, (*table.place, key), words("W-CFG-TABLE", low=low, high=high))


def _measured(tree: Mapping[str, Any], site: Any, axis: Any) -> Iterator[Fault]:
    measure, place, letter = axis.measure, axis.measure.place, axis.letter
    own = f"E{letter}{letter}"
    if letter and measure.component is not None and measure.component != own:
        # Who works with set-ups alone takes an axis whose own deviation has no name; nobody measures it by this.
        fault = broken(tree, (*place, "component"), words("W-CFG-OWN", own=own, letter=letter))
        yield replace(fault, later=MOTION.fullmatch(str(measure.component)) is None)
    if measure.file is None:
        yield from instrument_faults(tree, site, (*place, "instrument"), measure.instrument)
    elif measure.file_datum is not None and not within(measure.file_datum, *bounds(axis)):
        low, high = bounds(axis)
        yield broken(tree, (*place, "file_datum"), words("W-CFG-OUTSIDE", low=low, high=high))
    yield from target_faults(tree, axis, measure.targets, measure.overrun if measure.file is None else 0.0)
    low, high = bounds(axis)
    if measure.jog is not None and measure.jog > high - low:
        yield broken(tree, (*place, "jog"), words("W-CFG-JOG", span=high - low))
