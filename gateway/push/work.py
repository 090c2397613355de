"""One transaction on its way: its numbers, its journal and the story it will tell."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from drivers.types import CompensationTable, LiveTable, PushOrder, TableLimits
from gateway.domain import PushRecord, TableChange
from gateway.push import journal
from gateway.push.compare import table_facts, tolerance
from gateway.push.context import PushContext

Purpose = Literal["table", "sign-proof", "restore"]
Outcome = Literal["committed", "already-applied", "rolled-back", "held", "refused", "skipped"]


@dataclass(slots=True)
class Work:
    """A push in progress. ``restore_to`` is what must be live again if it fails; ``change`` what is wanted."""

    context: PushContext
    folder: Path
    journal: journal.Journal
    number: int
    change: TableChange
    purpose: Purpose
    limits: TableLimits
    agreeing_position: float
    restore_to: LiveTable
    steps: list[str] = field(default_factory=list)
    backup_path: str = ""
    effect: tuple[tuple[float, float, float], ...] = ()

    @property
    def axis(self) -> str:
        """Machine axis name."""
        return self.change.axis

    @property
    def allowed(self) -> float:
        """Largest difference of two values that are the same to the controller, um or arcsec."""
        return tolerance(self.limits, self.change.new)

    def note(self, kind: str, **facts: object) -> None:
        """Write the journal first, then tell. Raises StoreError when the journal refuses."""
        self.journal.append(kind, utc=self._utc(), **facts)
        told = ", ".join(f"{key} {value}" for key, value in facts.items() if isinstance(value, (str, int)))
        self.steps.append(f"{self._utc()} {kind}" + (f": {told}" if told else ""))
        self.context.say("P-PUSH-STEP", axis=self.axis, step=kind)

    def order(self, table: CompensationTable, enable: bool, purpose: Purpose, number: int) -> PushOrder:
        """The order for the controller to load one table."""
        axis = self.context.axis
        proof = self.context.proof if purpose == "table" else None
        place = self.agreeing_position
        return PushOrder(number, table, axis.letter, axis.rotary, enable, place, purpose, proof)

    def fresh_number(self) -> int:
        """Another transaction number of this machine."""
        return journal.allocate(self.folder, seed_of(self.context))

    def record(self, outcome: Outcome) -> PushRecord:
        """What happened, for the run folder."""
        self.context.say("P-PUSH-END", axis=self.axis, outcome=outcome)
        steps = tuple(self.steps)
        return PushRecord(self.number, self.axis, outcome, steps, self.backup_path, self.effect)

    def _utc(self) -> str:
        return self.context.clock.utc().isoformat(timespec="milliseconds")


def seed_of(context: PushContext) -> int:
    """A number that differs from day to day and second to second."""
    return int(context.clock.utc().timestamp())


@contextmanager
def begun(
    context: PushContext,
    folder: Path,
    change: TableChange,
    purpose: Purpose,
    limits: TableLimits,
    agreeing_position: float,
) -> Iterator[Work]:
    """A new transaction: number, journal, its first entry. The journal is set aside once it has ended."""
    number = journal.allocate(folder, seed_of(context))
    written = journal.Journal.create(folder, number)
    old = LiveTable(change.old, change.old_enabled)
    work = Work(context, folder, written, number, change, purpose, limits, agreeing_position, old)
    with closed_at_the_end(work):
        work.note(
            "LEASED",
            transaction=number,
            purpose=purpose,
            axis=change.axis,
            serial=context.machine.serial,
            old=table_facts(change.old),
            old_enabled=change.old_enabled,
            new=table_facts(change.new),
            base_digest=change.base_digest,
            place=agreeing_position,
        )
        yield work


@contextmanager
def closed_at_the_end(work: Work) -> Iterator[Work]:
    """Let go of the journal's file, and move the journal to `done` when its last entry is final."""
    try:
        yield work
    finally:
        work.journal.close()
    if journal.read(work.journal.path).finished:
        journal.set_aside(work.journal.path)
