"""What stood there before and what stands there now, of each table of a load: kept, then compared."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from drivers.errors import words
from drivers.terms import spoken
from drivers.types.orders import PushOrder, ReadBack
from drivers.types.tables import CompensationTable, LiveSet
from gateway.errors import VerifyError
from gateway.interlocks.facts import rest_of
from gateway.push.compare import aside, same_rest, same_set, same_table, table_facts, table_in
from gateway.push.records.phases import PushEvent
from gateway.push.work import Work
from gateway.table.comparison import differences


def keep_backup(work: Work, order: PushOrder, backup: LiveSet) -> None:
    """The text as read, durable before anything else; a restore's own back-up shows the table that failed.

    The transaction's own back-up confirms what to go back to where it agrees with what was live before.
    """
    name = f"backup-{work.name}-{order.transaction:06d}{spoken().program_suffix}"
    path = work.kept(name, backup.native)
    if order.transaction != work.whole.number:
        work.note(PushEvent.FAILED_TABLE, path=path, digest=backup.digest)
        return
    work.backup_path = path
    work.confirmed = agrees(work, backup)
    old = {"old": table_facts(work.restore_to.table), "old_enabled": work.restore_to.enabled}
    work.note(PushEvent.BACKUP, path=path, digest=backup.digest, confirmed=work.confirmed, **old)


def agrees(work: Work, backup: LiveSet) -> bool:
    """Whether a second reading says the same of what was live before: then, and only then, it may be restored."""
    if work.base is not None:
        return same_set(work.base, backup, work.allowed)
    same = same_table(work.restore_to, table_in(backup, work.change.new), work.allowed)
    return same and backup.digest == work.base_digest


def check_base(work: Work, base: LiveSet | None, backup: LiveSet) -> None:
    """Raises VerifyError (E-PUSH-LOST-UPDATE)."""
    if base is not None and not same_set(base, backup, work.allowed):
        before, found = base.digest[:12], backup.digest[:12]
        raise VerifyError("E-PUSH-LOST-UPDATE", work.axis, axis=work.axis, base=before, found=found)


def fault_of(work: Work, order: PushOrder, read: ReadBack, backup: LiveSet) -> VerifyError | None:
    """How the table differs from what was sent (E-PUSH-READBACK); None where it is as sent, and off.

    Raises VerifyError (E-PUSH-COUPLED) where anything else changed, which is no fault of one table: the others of the
    transaction are not looked at here, each is compared by itself.
    """
    axis, found = work.axis, table_in(read.found, order.table)
    waits = order.table.kind == "reversal"  # one value, written only when it is released
    different = [] if waits else list(differences(order.table, found.table, work.allowed))
    if found.enabled:
        different.append("the compensation is still enabled")
    if not read.agreed and not different:
        different.append(words("W-PUSH-CONTROL-DIFFERS"))
    if different:
        return VerifyError("E-PUSH-READBACK", axis, count=len(different), first=different[0])
    before, now = aside(backup, work.siblings), aside(read.found, work.siblings)
    if not same_rest(before, now, order.table, work.allowed, beside=work.siblings):
        raise VerifyError("E-PUSH-COUPLED", axis, axis=axis)
    return None


def is_coupled(live: LiveSet, work: Work) -> bool:
    """Whether other cross tables of the output axis are on, none of this transaction; never for an axis table."""
    return others_on(live, work.change.new, work.beside)


def others_on(live: LiveSet, table: CompensationTable, beside: Sequence[CompensationTable]) -> bool:
    """Whether cross tables of the output of a cross ``table`` are on that are none of those ``beside`` it."""
    return table.kind == "cross" and any(one.enabled for one in rest_of(aside(live, beside), table))


def is_beside(live: LiveSet, work: Work) -> bool:
    """Whether a cross table of the same output and transaction is on: whoever switches this one leaves it on."""
    beside = {one.index for one in work.beside if one.kind == "cross"}
    return work.change.new.kind == "cross" and any(one.enabled and one.table.index in beside for one in live.cross)


def leave_out(work: Work, there: Iterable[Work], base: LiveSet) -> None:
    """Tables that are as wanted are no part of what is sent: they stand beside as any other of the axis do."""
    gone = [other.change.new for other in there]
    work.beside = tuple(table for table in work.beside if table not in gone)
    work.coupled = is_coupled(base, work)
