"""Tables into the controller so that old or new is live at every instant; recovery; the sign proof."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from drivers.errors import TrueflankError, words
from drivers.message import Message
from gateway.domain.outcomes import PushRecord
from gateway.errors import RollbackFailed, StillOn, VerifyError, WriteRefused
from gateway.push.asking import Asked, ask, ended_before, goes_on
from gateway.push.context import PushContext
from gateway.push.places import together
from gateway.push.plan import plan_hash
from gateway.push.proofs.switching import Steps, quiet
from gateway.push.signproof import prove_sign, prove_signs
from gateway.push.transaction import Stays, push_table, push_tables
from gateway.push.trials import SignQuestion
from gateway.push.undo.finding import PushFinding
from gateway.push.undo.recovery import look, recover, unfinished
from gateway.push.work import Reading, ReadStop

__all__ = [
    "Asked",
    "PushContext",
    "PushFinding",
    "ReadStop",
    "Reading",
    "SignQuestion",
    "Stays",
    "Steps",
    "ask",
    "ended_before",
    "goes_on",
    "look",
    "outcome_alarms",
    "outcome_error",
    "plan_hash",
    "prove_sign",
    "prove_signs",
    "push_table",
    "push_tables",
    "quiet",
    "recover",
    "together",
    "unfinished",
]


def outcome_error(record: PushRecord) -> TrueflankError | None:
    """The error a shell should end with for a push that did not do what was asked; None when it did."""
    why = record.reasons or Message.of("W-PUSH-NO-REASON")
    backup = record.backup_path or Message.of("W-PUSH-NO-BACKUP")
    told: dict[str, Any] = {"axis": record.axis, "why": why, "backup": backup}
    if record.outcome == "refused":
        return WriteRefused("E-PUSH-REFUSED", record.axis, count=max(len(record.reasons), 1), reasons=why)
    back = record.purpose == "restore"
    if record.outcome == "rolled-back":
        return VerifyError("E-ROLLBACK-UNDONE" if back else "E-PUSH-ROLLED-BACK", record.axis, **told)
    if record.outcome == "held":
        return RollbackFailed("E-ROLLBACK-HELD" if back else "E-PUSH-HELD", record.axis, **told)
    if record.outcome == "held-on":
        return StillOn("E-ROLLBACK-HELD-ON" if back else "E-PUSH-HELD-ON", record.axis, **told)
    return None


def outcome_alarms(records: Iterable[PushRecord]) -> tuple[str, ...]:
    """What must be put right although the tables are as asked: a marker of the control that could not be written."""
    told = {record.transaction: record for record in records if record.marker}
    return tuple(
        "W-PUSH-MARKER: " + words("W-PUSH-MARKER", axis=one.axis, transaction=number, why=one.marker)
        for number, one in told.items()
    )
