"""One transaction on its way: its numbers, its journal and the story it will tell."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from drivers.errors import TrueflankError
from drivers.types import CompensationTable, LiveSet, LiveTable, PushOrder, TableLimits
from gateway.domain import PushRecord, TableChange
from gateway.errors import VerifyError
from gateway.push import journal
from gateway.push.compare import signed, table_facts, tolerance
from gateway.push.context import PushContext
from gateway.push.plan import plan_hash

Purpose = Literal["table", "sign-proof", "restore"]
Outcome = Literal["committed", "already-applied", "rolled-back", "held", "held-on", "refused", "skipped"]


@dataclass(slots=True)
class Work:
    """A push in progress. ``restore_to`` is what must be live again if it fails; ``change`` what is wanted.

    ``coupled`` says that other CEC tables of the output axis were on before, so that they must be again.
    ``marked`` is the order whose number the controller's marker carries. ``cut_short`` says that a load may have
    stopped in its middle, ``torn`` that a control which has restarted since may act by half a table once it is on.
    ``seen`` is the table as it was read last, None once something was announced since;
    ``protected`` that the control refused to write it as one that is on, whatever its switch reads.
    """

    context: PushContext
    folder: Path
    journal: journal.Journal
    number: int
    change: TableChange
    purpose: Purpose
    limits: TableLimits
    agreeing_position: float
    restore_to: LiveTable
    coupled: bool = False
    steps: list[str] = field(default_factory=list)
    backup_path: str = ""
    effect: tuple[tuple[float, float, float], ...] = ()
    marked: PushOrder | None = None
    base: LiveSet | None = None
    cut_short: bool = False
    torn: bool = False
    seen: LiveTable | None = None
    protected: bool = False

    @property
    def axis(self) -> str:
        """Machine axis name of the output."""
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
        moved, place = self.context.moved, self.agreeing_position
        proof = self.context.proof
        if purpose == "sign-proof" or (purpose == "restore" and table.function == "EEC"):
            proof = None
        return PushOrder(number, table, moved.letter, moved.rotary, enable, place, purpose, proof, self.coupled)

    def signed(self, live: LiveSet) -> LiveSet:
        """A live set as saved, CEC as deviations by this push's proof."""
        return signed(live, self.context.sign)

    def fresh_number(self) -> int:
        """Another transaction number of this machine."""
        return journal.allocate(self.folder, seed_of(self.context))

    async def same_machine(self) -> None:
        """The fingerprint once more. Raises VerifyError (E-PUSH-OTHER-MACHINE)."""
        found = await self.context.controller.identify()
        different = self.context.machine.differences(found)
        if different:
            raise VerifyError("E-PUSH-OTHER-MACHINE", self.axis, differ=", ".join(different))

    async def finish(self, state: Literal["committed", "held", "none"]) -> None:
        """Leave the controller's marker in its last state; where that fails the journal still knows the number."""
        if self.marked is None:
            return
        try:
            await self.same_machine()
            await self.context.controller.finish_push(self.marked, state)
        except TrueflankError as error:
            self.steps.append(f"{self._utc()} the marker could not be written: {error}")

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
    journal.tidy(folder)
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
            plan=plan_hash(change, context.machine),
            key=context.key,
            actor=context.actor,
            approved_by=sorted({approval.actor for approval in context.approvals}),
            sign=context.sign,
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
