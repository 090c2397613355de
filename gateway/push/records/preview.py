"""What a rollback would change, table by table: one set with the same figures for the terminal and the page; pure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from drivers.errors import words
from drivers.types.tables import CompensationTable
from drivers.types.values import Approach, Sense
from gateway.moving import shown
from gateway.push.records.history import Committed, ConsentSet, TableName, named
from gateway.table.comparison import effective, toward


def by_senses(senses: Callable[[str], Sense | None]) -> Callable[[CompensationTable, Sense], CompensationTable]:
    """Tables as deviations by today's proofs where no controller is open: ``senses`` gives the proof's of an axis.

    Only cross tables have one. Where an axis has no proof any more its tables are as they were kept, and nothing can be
    taken back before the sign is proved again.
    """

    def meant(kept: CompensationTable, sense: Sense) -> CompensationTable:
        today = senses(kept.output_axis) if kept.kind == "cross" else None
        if today is None or today == sense:
            return kept
        turned = (tuple(-value + 0.0 for value in values) for values in (kept.deviations, kept.reverse))
        deviations, reverse = turned
        return replace(kept, deviations=deviations, reverse=reverse)

    return meant


@dataclass(frozen=True, slots=True)
class RollbackPreview:
    """One table of a set: what acts in its place until the rollback (``newer``), what acts after it (``older``)."""

    done: Committed
    newer: TableName
    older: TableName

    @property
    def plan(self) -> str:
        """Both tables by their names, in words."""
        told = {"transaction": self.done.transaction, "utc": self.done.utc[:16].replace("T", " ")}
        return words("W-ROLLBACK-PLAN", table=self.done.table, newer=self.newer.words, older=self.older.words, **told)

    @property
    def move(self) -> tuple[str, dict[str, Any]]:
        """By how much the table moves its axis at most, and where: a code of the catalogue and what it names."""
        new = self.done.new.table
        told: dict[str, Any] = {"axis": new.output_axis, "unit": new.deviation_unit}
        if new.kind == "reversal":
            was, becomes = (float(effective(one).deviations[0]) for one in (self.done.new, self.done.old))
            return "W-ROLLBACK-REVERSAL", {**told, **_figures(was, becomes)}
        points = list(changes(self.done))
        place, _, was, becomes = max(points, key=lambda one: abs(one[3] - one[2]))
        told |= {"place": shown(place), "place_unit": new.input_unit, "input": new.input_axis, "count": len(points)}
        return "W-ROLLBACK-LARGEST", {**told, **_figures(was, becomes)}

    @property
    def lines(self) -> tuple[str, ...]:
        """As a terminal shows it."""
        code, fields = self.move
        return self.plan, f"  {words(code, **fields)}"

    def as_data(self) -> dict[str, Any]:
        """As JSON data: names, and the move as code, fields and words."""
        code, fields = self.move
        told = {"table": self.done.table, "newer": self.newer.words, "older": self.older.words}
        return {**told, "move": {"code": code, "fields": fields, "words": words(code, **fields)}}


def previews(pushes: tuple[Committed, ...], found: ConsentSet) -> Mapping[str, RollbackPreview]:
    """The preview of each table of a set, by the table's name.

    ``pushes`` are as they were kept, for a table keeps its name whatever its sign was proved to be since; the figures
    are those of ``found``.
    """
    return {one.table: _preview(pushes, one) for one in found.tables}


def _preview(pushes: tuple[Committed, ...], done: Committed) -> RollbackPreview:
    kept = next((one for one in pushes if (one.transaction, one.table) == (done.transaction, done.table)), done)
    before = tuple(one for one in pushes if one.transaction != done.transaction)
    newer, older = named(pushes, done.table, kept.new), named(before, done.table, kept.old, done.utc)
    return RollbackPreview(done, newer, older)


def _figures(was: float, becomes: float) -> dict[str, float]:
    return {"was": round(was, 2) + 0.0, "becomes": round(becomes, 2) + 0.0, "size": round(abs(becomes - was), 2)}


def changes(done: Committed) -> Iterator[tuple[float, Approach, float, float]]:
    """Each point of the larger of both tables, the direction of travel, what acts there now and what would act."""
    new, old = done.new, done.old
    places = max((new.table, old.table), key=lambda table: len(table.deviations)).positions
    ways: tuple[Approach, ...] = (1, -1) if new.table.reverse or old.table.reverse else (1,)
    for way in ways:
        now, then = toward(effective(new), places, way), toward(effective(old), places, way)
        for place, was, becomes in zip(places, now, then, strict=True):
            yield float(place), way, float(was), float(becomes)
