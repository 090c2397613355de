"""Are the tables that pushes left still in the control? Compared wherever live tables are read; a difference alarms."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import partial

from drivers.message import Form, Message
from drivers.terms import spoken
from drivers.types.orders import SignProof
from drivers.types.tables import CompensationTable, LiveSet
from gateway import audit
from gateway.errors import StoreError
from gateway.push import JOURNALS, CommittedPush, committed_pushes, pushed_tables, table_in, tolerance
from gateway.store import Store
from gateway.table.live_comparison import ThreeWay, compare_three_tables
from gateway.workflow.run.audit_trail import AuditAdapter, alarms_of, report_log_problem
from gateway.workflow.run.context import RunContext


@dataclass(frozen=True, slots=True)
class PushedTable:
    """A table as the last committed push left it; ``allowed`` is no difference.

    ``meant`` gives a live set by the proof that the push is known by.
    """

    push: CommittedPush
    meant: Callable[[LiveSet], LiveSet]
    allowed: float

    @property
    def table(self) -> CompensationTable:
        """The table itself."""
        return self.push.new.table


@dataclass(frozen=True, slots=True)
class TableLook:
    """One comparison: what was wanted, what was found, and the hash of the live set it was found in."""

    expected: PushedTable
    found: ThreeWay
    digest: str

    @property
    def name(self) -> str:
        """The table as in a proposal."""
        return self.expected.push.table

    @property
    def against(self) -> str:
        """What it was compared with."""
        return str(describe_comparisons((self,)))


def describe_comparisons(looks: Sequence[TableLook]) -> Message:
    """What tables of one push were compared with."""
    push, names = looks[0].expected.push, ", ".join(look.name for look in looks)
    return Message.of("W-VERIFY-AGAINST-PUSH", table=names, transaction=push.transaction, utc=push.utc)


async def expected_tables(at: RunContext, axis: str = "") -> tuple[PushedTable, ...]:
    """Every table of an axis of the site (all: "") that a committed push left. Raises StoreError, what the port raises.

    A cross table whose sign is not proved any more cannot be compared: it is told and left out.
    """
    found = []
    for name in pushed_tables(at.store.root / JOURNALS, at.machine.serial):
        output, cross = spoken().axis_of(name), spoken().is_cross(name)
        if (axis and output != axis) or output not in {one.name for one in at.site.axes}:
            continue
        proof = at.proofs.find(at.machine, "cross", output) if cross else None
        if cross and proof is None:
            at.say("P-VERIFY-UNPROVED", table=name)
            continue
        found.append(await _expected_table(at, name, proof))
    return tuple(found)


async def _expected_table(at: RunContext, name: str, proof: SignProof | None) -> PushedTable:
    controller = at.supervisor.controller
    meant = partial(controller.table_by, proof=proof)
    last = committed_pushes(at.store.root / JOURNALS, at.machine.serial, name, meant)[-1]
    shape = last.new.table
    limits = await controller.table_limits(shape.output_axis, shape.kind, shape.index)
    return PushedTable(last, partial(controller.tables_by, proof=proof), tolerance(limits, shape))


def compare_with(wanted: tuple[PushedTable, ...], live: LiveSet) -> tuple[TableLook, ...]:
    """The live tables of an axis, by whatever proof they were read, against what pushes left; pure."""
    return tuple(
        TableLook(
            one,
            compare_three_tables(table_in(one.meant(live), one.table), one.push.new, one.push.old, one.allowed),
            live.digest,
        )
        for one in wanted
        if one.push.axis == live.axis
    )


def record_looks(at: RunContext, looks: tuple[TableLook, ...], *, aloud: bool = True) -> None:
    """Record every comparison, and say what is not as it was left unless it is the answer to who asked."""
    for look in looks:
        same = look.found.kind == "as-approved"
        if aloud and not same:
            at.say("P-TABLE-ALARM", table=look.name, words=look.found.message)
        told = {"table": look.name, "found": look.found.words, "kind": look.found.kind, "run": at.folder.run_id}
        told |= {"said": json.dumps(look.found.message.as_data())}
        problem = audit.note(
            at.store.root,
            audit.AS_PUSHED if same else audit.DIFFERS,
            clock=at.clock,
            serial=at.machine.serial,
            details={**told, "against": look.expected.push.transaction},
        )
        report_log_problem(at, problem)


async def compare_live_tables(at: RunContext, live: LiveSet | None) -> None:
    """Compare live tables that were read for another purpose, just now."""
    if live is not None:
        record_looks(at, without_cross_differences(compare_with(await expected_tables(at, live.axis), live)))


def without_cross_differences(looks: tuple[TableLook, ...]) -> tuple[TableLook, ...]:
    """Cross tables are switched off to measure an axis: that says nothing about them."""
    return tuple(one for one in looks if one.expected.table.kind != "cross" or one.found.kind != "switched-off")


async def alarms_for_push(at: RunContext, axis: str) -> Callable[[LiveSet], tuple[Message, ...]]:
    """What a push calls with the live tables it has read; it answers with the axis' alarms."""
    wanted = await expected_tables(at, axis)

    def seen(live: LiveSet) -> tuple[Message, ...]:
        looks = compare_with(wanted, live)
        record_looks(at, without_cross_differences(looks))
        return standing_alarms(at, axis)

    return seen


def standing_alarms(at: RunContext, axis: str = "") -> tuple[Message, ...]:
    """What the last looks found that was not put right since, of one axis or of all."""
    known = AuditAdapter(at).standing
    return alarms_of(known, axis) if axis else every_alarm(known)


def every_alarm(known: audit.LogState) -> tuple[Message, ...]:
    """All alarms of a machine: tables that are not as pushed, and a marker that could not be written, with its code."""
    lost = (Message("W-PUSH-MARKER", known.marker_lost, Form.REASON),) if known.marker_lost else ()
    return (*known.alarms.values(), *lost)


def overdue_tables(store: Store, serial: str, now: datetime, hour: int) -> tuple[str, ...]:
    """Tables that no look has met since the last ``hour`` o'clock (UTC). Raises StoreError."""
    last = now.replace(hour=hour, minute=0, second=0, microsecond=0)
    last = last if last <= now else last - timedelta(days=1)
    looked = audit.read_log_state(store.root, serial).looked
    names = pushed_tables(store.root / JOURNALS, serial)
    return tuple(name for name in names if not _last_daily_hour(looked.get(name, ""), last))


class StandingAlarms:
    """The alarms of a machine as the log has them, read again whenever it has grown."""

    def __init__(self, store: Store, serial: str) -> None:
        self._root, self._serial = store.root, serial
        self._as_of: tuple[tuple[str, int], ...] = ()
        self._alarms: tuple[Message, ...] = ()

    def __call__(self) -> tuple[Message, ...]:
        """What stands now; a log that cannot be read is an alarm of its own."""
        try:
            as_of = audit.file_sizes(self._root)
            if as_of != self._as_of:
                known = audit.read_log_state(self._root, self._serial)
                self._alarms, self._as_of = every_alarm(known), as_of
        except StoreError as error:
            return (error.message,)
        return self._alarms


def _last_daily_hour(utc: str, moment: datetime) -> bool:
    try:
        return datetime.fromisoformat(utc) >= moment
    except (ValueError, TypeError):
        return False
