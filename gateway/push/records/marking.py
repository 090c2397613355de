"""The control's marker against what this store knows: whose it is, and whether the audit log reaches as far."""

from __future__ import annotations

from pathlib import Path

from drivers.errors import words
from drivers.types.abilities import Marker
from gateway.interlocks.facts import Mark
from gateway.push.context import AuditLog, PushContext
from gateway.push.records import journal, numbering


def against_the_log(context: PushContext, marker: Marker | None) -> Mark:
    """The marker (None: the road keeps none) against journals and audit log. Raises StoreError."""
    if marker is None:
        return Mark()
    log = context.log
    if not marker.transaction:
        return Mark(lost=log.last_mark() if log is not None else 0)
    folder = journal.machine_folder(context.journals, context.machine.serial)
    known = journal.knows(folder, marker.transaction)
    if log is None:
        return Mark(known)
    if not numbering.is_ours(folder, marker.transaction):
        return Mark(known, stranger=0 if known else marker.transaction)
    return Mark(known, _behind(log, folder, marker))


def missing_journals(context: PushContext) -> tuple[int, ...]:
    """Transactions that the audit log says began here and whose journals are gone."""
    if context.log is None:
        return ()
    folder = journal.machine_folder(context.journals, context.machine.serial)
    return tuple(sorted(context.log.announced() - journal.numbers(folder)))


def _behind(log: AuditLog, folder: Path, marker: Marker) -> str:
    """How the log falls short of a marker that this store has left."""
    if marker.head is not None and not log.holds(marker.head):
        return words("W-MARK-HEAD", transaction=marker.transaction, head=f"{marker.head:016x}")
    # A restore has a number of its own inside the transaction that it takes back.
    outer = journal.sender(folder, marker.transaction) or marker.transaction
    known = log.begun(marker.transaction) or log.begun(outer)
    return "" if known else words("W-MARK-UNKNOWN", transaction=marker.transaction)
