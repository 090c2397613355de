"""One transaction on its way: what its tables share, the state of each table, and the error boundary."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from drivers.errors import TrueflankError, words
from drivers.message import Message
from drivers.types.abilities import Marker, TableLimits
from drivers.types.orders import PushBatch, PushOrder
from drivers.types.stops import Stop
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.errors import BusyError, StoreError, Unexpected, VerifyError
from gateway.events import PushEnded, PushPhaseChanged, TableStateChanged
from gateway.push import journal
from gateway.push.compare import tolerance
from gateway.push.context import PushContext
from gateway.push.journal import Journal, is_replaying, replayed_value
from gateway.push.phases import INITIAL_STATE, PushEvent, PushState, step_message, step_with_facts, table_message
from gateway.stopping import current

ReadStop = Callable[[Stop], Awaitable[tuple[float, float]]]
"""The settled reading of an axis at a stop, um or arcsec, positive as the axis counts, and its u."""
Reading = Callable[[], AbstractAsyncContextManager[ReadStop]]
"""An instrument that begins to read anew: a push, or a restart, moves the axis at its own feed."""
Purpose = Literal["table", "sign-proof", "restore"]
Outcome = Literal["committed", "already-applied", "rolled-back", "untouched", "held", "held-on", "refused", "skipped"]


@dataclass(slots=True)
class Transaction:
    """What all tables of one push share: its number, its journal, and how it stands with the control.

    ``before`` is the marker as it stood before the first order, ``sent`` are the numbers of all orders,
    ``acknowledged`` says that the marker has carried one of them. ``batch`` are the orders that were sent together.
    ``never_started``: the control has shown that their program never began, and an abort keeps it from beginning.
    """

    folder: Path
    journal: journal.Journal
    number: int
    purpose: Purpose
    before: Marker | None = None
    sent: set[int] = field(default_factory=set)
    acknowledged: bool = False
    batch: PushBatch = ()
    never_started: bool = False


@dataclass(slots=True, eq=False)
class TableTransactionState:
    """One table of a push in progress: ``change`` is wanted, ``restore_to`` must be live again if it fails.

    ``of`` is its name among the journal's entries ("": it is the only one), ``beside`` the other tables of the
    transaction that move the same output axis, ``acting`` those of them that act by now, ``along`` those that move
    other axes.
    ``base`` is all that was live before, ``base_digest`` what remains of it in a later process.
    ``confirmed`` says that two independent readings agree on ``restore_to``: it goes back to nothing else.
    ``coupled`` says that other cross tables of the output axis, none of this transaction, were on before, so that they
    must be again; ``sibling_enabled`` that one beside it is on now, which a way back leaves on.
    ``begun`` says that a load may have written something. ``marked`` is the order whose number the controller's marker
    carries. ``cut_short`` says that a load may have stopped in its middle, ``partially_written`` that a control which
    has restarted since may act by half a table once it is on.
    ``loaded`` is what a recovery has just read there: nobody is asked to have it saved again.
    ``state`` is where it stands by the table of transitions, ``last`` the event that led there.
    ``seen`` is the table as it was read last, None once something was announced since; ``protected`` that the control
    refused to write it as one that is on, whatever its switch reads.
    ``reasons`` are why it does not end as asked, ``marker_lost`` why the marker could not be written at its end.
    """

    context: PushContext
    transaction: Transaction
    change: TableChange
    limits: TableLimits
    agreeing_position: float
    restore_to: LiveTable
    of: str = ""
    beside: tuple[CompensationTable, ...] = ()
    along: tuple[CompensationTable, ...] = ()
    acting: tuple[CompensationTable, ...] = ()
    coupled: bool = False
    sibling_enabled: bool = False
    steps: list[Message] = field(default_factory=list)
    backup_path: str = ""
    effect: tuple[tuple[float, float, float], ...] = ()
    marked: PushOrder | None = None
    base: LiveSet | None = None
    loaded: LiveSet | None = None
    cut_short: bool = False
    partially_written: bool = False
    confirmed: bool = False
    begun: bool = False
    base_digest: str = ""
    state: PushState = INITIAL_STATE
    last: PushEvent | None = None
    seen: LiveTable | None = None
    protected: bool = False
    reasons: list[Message] = field(default_factory=list)
    marker_lost: Message | None = None

    @property
    def axis(self) -> str:
        """Machine axis name of the output."""
        return self.change.axis

    @property
    def siblings(self) -> tuple[CompensationTable, ...]:
        """The other tables of the transaction: each is compared by itself, so none of them is a change from outside."""
        return (*self.beside, *self.along)

    @property
    def name(self) -> str:
        """What its own files are named after: its axis, or its table where several have one transaction."""
        return self.of or self.axis

    @property
    def tolerance(self) -> float:
        """Largest difference of two values that are the same to the controller, um or arcsec."""
        return tolerance(self.limits, self.change.new)

    def note(self, event: PushEvent, **facts: object) -> None:
        """Write the journal first, then tell.

        Raises StoreError when the journal refuses, IllegalTransition where the event may not follow.
        """
        self.state.after(event, facts)
        self.transaction.journal.append(event, utc=self._utc(), **({"of": self.of} if self.of else {}), **facts)
        self.tell_event(event, facts)

    def because(self, *reasons: Message) -> None:
        """Keep why it does not end as asked, each reason once; the record contains them."""
        self.reasons += [reason for reason in dict.fromkeys(reasons) if reason not in self.reasons]

    def tell_event(self, event: PushEvent, facts: Mapping[str, object]) -> None:
        """Tell what the journal holds by now."""
        known = self.state.table if self.last is not None else None
        self.last, self.state = event, self.state.after(event, facts)
        self.steps.append(step_with_facts(event, self._utc(), facts))
        PushPhaseChanged(self.name, event, step_message(event)).tell(self.context.say)
        if (now := self.state.table) is not known:
            TableStateChanged(self.name, now, table_message(now)).tell(self.context.say)

    def note_stop(self) -> None:
        """Somebody ended us from outside: where it stands, on the disk before anything else is done."""
        stop, last = current(), self.last
        by = {"by": stop.by or "a cancel"}
        try:
            if self.marked is None:
                self.note(PushEvent.ABORTED, why=Message.of("W-PUSH-STOP-EARLY", **by))
                return
            if self.transaction.number not in stop.transactions:
                stop.transactions.append(self.transaction.number)
            self.note(PushEvent.STOPPED, why=Message.of("W-PUSH-STOP-BY", **by), after=last or "nothing")
        except StoreError as error:
            stop.tell(str(error))
        told = {"axis": self.axis, "transaction": self.transaction.number, "last": step_message(last or "nothing")}
        self.context.say("P-STOPPED-PUSH", **told)
        stop.tell(words("P-STOPPED-PUSH", **told))

    def order(self, table: CompensationTable, enable: bool, purpose: Purpose, number: int) -> PushOrder:
        """The order for the controller to load one table."""
        moved, place = self.context.input_axis, self.agreeing_position
        proof = self.context.proof
        if purpose == "sign-proof" or (purpose == "restore" and table.kind != "cross"):
            proof = None
        head = self.context.log.head() if self.context.log is not None else 0
        return PushOrder(
            number,
            table,
            letter=moved.letter,
            rotary=moved.rotary,
            enable=enable,
            agreeing_position=place,
            purpose=purpose,
            proof=proof,
            coupled=self.coupled or self.sibling_enabled,
            head=head,
            encoder=self.context.axis.encoder,
            encoder_said=self.context.axis.encoder_said,
        )

    def fresh_number(self) -> int:
        """Another transaction number of this machine; in work that goes on the one that was given here before."""
        known = replayed_value(self.transaction.journal, PushEvent.DISABLE, "order")
        return int(known) if known else journal.allocate_number(self.transaction.folder, number_seed(self.context))

    async def require_same_machine(self) -> None:
        """The fingerprint once more. Raises VerifyError (E-PUSH-OTHER-MACHINE)."""
        found = await self.context.controller.identify()
        different = self.context.machine.differences(found)
        if different:
            raise VerifyError("E-PUSH-OTHER-MACHINE", self.axis, differ=", ".join(different))

    async def require_own_marker(self) -> None:
        """Raise BusyError (E-PUSH-ANOTHER) when the control's marker is another gateway's: nothing may be touched."""
        controller = self.context.controller
        marker = await controller.marker() if controller.capabilities.marker else None
        if marker is None or marker.transaction in (0, *self.transaction.sent):
            return
        if self.transaction.acknowledged or marker != self.transaction.before:
            raise BusyError("E-PUSH-ANOTHER", self.axis, number=marker.transaction, state=marker.state)

    async def finish_marker(self, state: Literal["committed", "held", "none"]) -> None:
        """Leave the controller's marker in its last state; where that fails the journal still knows the number.

        The audit log is told first, so that the marker carries a head that knows of the end. A marker that is another
        gateway's by now stays as it is.
        """
        if self.marked is None:
            return
        log = self.context.log
        if log is not None:
            log.end(self.transaction.number, state)
        together = self.transaction.batch if self.marked in self.transaction.batch else (self.marked,)
        head = log.head() if log is not None else 0
        try:
            with wrap_unexpected(self.axis):
                await self.require_same_machine()
                await self.require_own_marker()
                await self.context.controller.finish_push(tuple(replace(one, head=head) for one in together), state)
        except TrueflankError as error:
            self._marker_lost(state, error.message)

    def _marker_lost(self, state: str, why: Message) -> None:
        """The tables are as they are; what the control's marker says of them is not: an alarm, kept in the log."""
        self.marker_lost = why
        self.context.say("P-PUSH-MARKER", axis=self.name, transaction=self.transaction.number, why=why)
        if self.context.log is not None:
            self.context.log.marker_lost(self.transaction.number, self.change.name, state, str(why))

    def keep_text(self, name: str, text: str) -> str:
        """Keep a text for good; returns its run folder and name: a record holds no path of this computer."""
        if is_replaying(self.transaction.journal) and (self.context.folder.path / name).exists():
            return f"{self.context.folder.path.name}/{name}"
        path = self.context.folder.write_text(name, text)
        return f"{path.parent.name}/{path.name}"

    def record(self, outcome: Outcome, *, told: bool = False) -> PushRecord:
        """What happened, for the run folder; said to people unless that was ``told`` of several tables at once."""
        if not told:
            PushEnded(self.change.name, outcome).tell(self.context.say)
        steps = tuple(self.steps)
        return PushRecord(
            self.transaction.number,
            self.axis,
            outcome=outcome,
            steps=steps,
            backup_path=self.backup_path,
            effect=self.effect,
            reasons=tuple(self.reasons),
            marker=self.marker_lost,
            purpose=self.transaction.purpose,
        )

    def _utc(self) -> str:
        return self.context.clock.utc().isoformat(timespec="milliseconds")


def note_together(works: Sequence[TableTransactionState], event: PushEvent) -> None:
    """As `TableTransactionState.note`, of several tables in one line: it is on the disk for all of them or for none."""
    first = works[0]
    if not first.of:
        first.note(event)
        return
    utc = first.context.clock.utc().isoformat(timespec="milliseconds")
    for work in works:
        work.state.after(event, {})
    first.transaction.journal.append(event, utc=utc, all=[work.of for work in works])
    for work in works:
        work.tell_event(event, {})


def number_seed(context: PushContext) -> int:
    """A number that differs from day to day and second to second."""
    return int(context.clock.utc().timestamp())


# The error boundary of a push. A bug's TypeError, an OSError, a cancel that one of our own limits let slip: once a
# write has been announced each means the same, "outcome unknown". So each becomes an error of ours and leads back to
# the old table as any failure does. Only a cancel from outside and the end of the process pass unchanged.


@contextmanager
def wrap_unexpected(where: str) -> Iterator[None]:
    """Run a step of a push. Raises Unexpected (E-PUSH-UNEXPECTED) for whatever is no error of ours."""
    before = _cancel_count()
    try:
        yield
    except TrueflankError:
        raise
    except asyncio.CancelledError as error:
        if _cancel_count() > before:
            raise
        raise _as_unexpected(where, error) from error
    except Exception as error:
        raise _as_unexpected(where, error) from error


def _as_unexpected(where: str, error: BaseException) -> Unexpected:
    return Unexpected("E-PUSH-UNEXPECTED", where, kind=type(error).__name__, why=str(error) or "no words")


def _cancel_count() -> int:
    """How many wish from outside that this task ends."""
    task = asyncio.current_task()
    return task.cancelling() if task is not None else 0


def mute_during_replay(context: PushContext, kept: Journal) -> PushContext:
    """The context with a voice that does not tell again what was told before this work was taken up again."""
    say = context.say

    def told(code: str, /, **fields: object) -> None:
        if not is_replaying(kept):
            say(code, **fields)

    return replace(context, say=told)


def with_safe_logger(context: PushContext) -> PushContext:
    """The context with a voice that cannot stop a push: a terminal that is gone leaves no table half way."""

    def say(code: str, /, **fields: object) -> None:
        try:
            context.say(code, **fields)
        except Exception:  # noqa: BLE001 - what is told has been noted; who tells it may be gone
            return

    return replace(context, say=say)
