"""The audit log as a push asks for it: told before anything is sent, asked what it knows, read again as it grows."""

from __future__ import annotations

from pathlib import Path

from drivers.errors import TrueflankError
from gateway import audit
from gateway.domain.proposals import TableChange
from gateway.push import JOURNALS, journal, table_facts
from gateway.store.records import canonical, sha256
from gateway.workflow.bench import Bench


class Witness:
    """A store's log for one machine; keeps `gateway.push.context.AuditLog`."""

    def __init__(self, at: Bench) -> None:
        self._root, self._clock, self._serial = at.store.root, at.clock, at.machine.serial
        self._run = at.folder.run_id
        self._known = audit.LogState()
        self._as_of = ""

    def begin(self, transaction: int, change: TableChange) -> str:
        """Keep that a transaction begins; the head is then on the disk. Raises as `audit.record`."""
        head = audit.record(
            self._root,
            audit.BEGUN,
            clock=self._clock,
            serial=self._serial,
            transaction=transaction,
            base_hash=change.base_digest,
            new_hash=sha256(canonical(table_facts(change.new))),
            details={"table": change.name, "run": self._run},
        )
        return str(head)

    def end(self, transaction: int, state: str) -> None:
        """Keep what the control's marker is about to say."""
        told = {"state": state, "run": self._run}
        audit.note(
            self._root, audit.ENDING, clock=self._clock, serial=self._serial, transaction=transaction, details=told
        )

    def marker_lost(self, transaction: int, table: str, state: str, why: str) -> None:
        """Keep that the control's marker does not say how a transaction ended."""
        told = {"table": table, "state": state, "why": why, "run": self._run}
        audit.note(
            self._root,
            audit.MARKER_LOST,
            clock=self._clock,
            serial=self._serial,
            transaction=transaction,
            details=told,
        )

    def head(self) -> int:
        """The first 64 bits of the head; 0 where the log has none to give."""
        try:
            number, _, digest = audit.current_head(self._root).partition(":")
        except TrueflankError:
            return 0
        return int(digest[:16], 16) if int(number) else 0

    def begun(self, transaction: int) -> bool:
        """Whether a line names this transaction."""
        return transaction in self.standing.begun

    def announced(self) -> frozenset[int]:
        """Transactions that were begun here, each with its journal."""
        return frozenset(self.standing.announced)

    def holds(self, head: int) -> bool:
        """Whether a line has a hash that begins so."""
        return head in self.standing.prefixes

    def last_mark(self) -> int:
        """The transaction that the marker should still name; 0 where it need name none."""
        return self.standing.last_mark

    @property
    def standing(self) -> audit.LogState:
        """What the log says now."""
        try:
            as_of = audit.current_head(self._root)
        except TrueflankError:
            as_of = ""  # a log that is not whole is told elsewhere; what it says is read afresh
        if not as_of or as_of != self._as_of:
            self._known, self._as_of = audit.read_log_state(self._root, self._serial), as_of
        return self._known


def anchors(root: Path, serial: str, *named: str) -> tuple[audit.ChainHead, ...]:
    """Heads that the journals of a machine, and ``named`` others, say the log has had. Raises CorruptRecord."""
    folder = journal.machine_folder(root / JOURNALS, serial)
    every = (*journal.read_all(folder), *journal.read_all(folder / "done"))
    told = {str(found.latest("audit")) for found in every if found.latest("audit")}
    return tuple(audit.parse_head(text) for text in sorted({*told, *(one for one in named if one)}))
