"""The live table against the one that was approved and the one before it, point by point and in words; pure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from drivers.message import Message, Quantity, fixed
from drivers.types.tables import CompensationTable, LiveTable
from gateway.table.comparison import curves_apart, deviations_toward, differences, differing_parts, part_name

Kind = Literal["as-approved", "switched-off", "switched-on", "before", "differs"]
_WORDS: dict[Kind, str] = {
    "as-approved": "W-LIVE-AS-APPROVED",
    "switched-off": "W-LIVE-SWITCHED-OFF",
    "switched-on": "W-LIVE-SWITCHED-ON",
    "before": "W-LIVE-BEFORE",
    "differs": "W-LIVE-DIFFERS",
}


@dataclass(frozen=True, slots=True)
class DifferingPoint:
    """One interpolation point where the live table is not the approved one; values in its deviation unit.

    ``before`` is NaN where the table before is not known.
    """

    position: float
    before: float
    approved: float
    live: float


@dataclass(frozen=True, slots=True)
class ThreeWay:
    """What is live. ``form`` names parts other than values that differ."""

    kind: Kind
    name: str
    unit: str
    points: int
    places: tuple[DifferingPoint, ...]
    form: tuple[Message, ...]
    live_enabled: bool
    allowed: float

    @property
    def as_before(self) -> int:
        """At how many of the different points the live value is that of the table before."""
        return sum(abs(place.live - place.before) <= self.allowed for place in self.places)

    @property
    def words(self) -> str:
        """What is live, in English."""
        return str(self.message)

    @property
    def message(self) -> Message:
        """What is live as people read it."""
        switch = Message.of("S-LIVE-ON" if self.live_enabled else "S-LIVE-OFF")
        told = [Message.of(_WORDS[self.kind], table=self.name, switch=switch)]
        if self.kind in ("as-approved", "switched-off", "switched-on"):
            return told[0]
        if self.form:
            told.append(Message.of("W-LIVE-FORM", form=self.form))
        if self.places:
            first = self.places[0]
            told.append(
                Message.of(
                    "W-LIVE-PLACES",
                    count=len(self.places),
                    total=self.points,
                    as_before=self.as_before,
                    position=Quantity(first.position),
                    before=_value(first.before),
                    approved=_value(first.approved),
                    live=_value(first.live),
                    unit=self.unit,
                )
            )
        return Message.of("S-LIVE-SAID", said=tuple(told))

    def as_data(self) -> dict[str, Any]:
        """The comparison as JSON data."""
        places = [[one.position, _finite(one.before), one.approved, _finite(one.live)] for one in self.places]
        return {
            "kind": self.kind,
            "table": self.name,
            "unit": self.unit,
            "live_enabled": self.live_enabled,
            "form": list(map(str, self.form)),
            "differences": places,
            "what": self.words,
        }


def compare_three_tables(live: LiveTable, approved: LiveTable, before: LiveTable | None, allowed: float) -> ThreeWay:
    """What is live: the approved table, the same with the other switch, the one before it, or neither.

    ``before`` is the table that was live before the approved one was written (None: not known); ``allowed`` how
    far values of the same table may lie apart, um or arcsec. Values are compared at the approved table's points.
    """
    form = tuple(_form(approved.table, live.table, allowed))
    places = tuple(_places(live, approved, before, allowed))
    kind = _kind(live, approved, before, allowed, same=not form and not places)
    table, points = approved.table, len(approved.table.deviations)
    return ThreeWay(
        kind=kind,
        name=table.called,
        unit=table.deviation_unit,
        points=points,
        places=places,
        form=form,
        live_enabled=live.enabled,
        allowed=allowed,
    )


def _kind(live: LiveTable, approved: LiveTable, before: LiveTable | None, allowed: float, *, same: bool) -> Kind:
    if same and live.enabled == approved.enabled:
        return "as-approved"
    if before is not None and before.enabled == live.enabled and not differences(before.table, live.table, allowed):
        return "before"
    if same:
        return "switched-on" if live.enabled else "switched-off"
    old = before is not None and not differences(before.table, live.table, allowed)
    return "before" if old else "differs"


def _form(approved: CompensationTable, live: CompensationTable, allowed: float) -> Iterator[Message]:
    for name, wanted, found in differing_parts(approved, live):
        yield Message.of("S-DIFF-LIVE", name=part_name(name), wanted=wanted, found=found)
    if len(approved.deviations) != len(live.deviations):
        points = Message.of("S-PART-POINTS")
        yield Message.of("S-DIFF-LIVE", name=points, wanted=len(approved.deviations), found=len(live.deviations))
    yield from curves_apart(approved, live, allowed)


def _places(live: LiveTable, approved: LiveTable, before: LiveTable | None, allowed: float) -> Iterator[DifferingPoint]:
    """By the curve of the positive direction of travel; that of the other one is told beside the values."""
    at = approved.table.positions
    found = deviations_toward(live.table, at, 1)
    old = deviations_toward(before.table, at, 1) if before is not None else np.full(at.shape, np.nan)
    for position, was, wanted, value in zip(at, old, approved.table.deviations, found, strict=True):
        if not abs(value - wanted) <= allowed:
            yield DifferingPoint(float(position), float(was), float(wanted), float(value))


def _value(value: float) -> Quantity | str:
    return fixed(value, 3, signed=True) if np.isfinite(value) else "?"


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
