"""Tables into the controller so that old or new is live at every instant; recovery; the sign proof."""

from __future__ import annotations

from drivers.errors import TrueflankError
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
    last = record.steps[-1] if record.steps else ""
    if record.outcome == "refused":
        reasons = [step for step in record.steps if step.startswith("E-")] or [last]
        return WriteRefused("E-PUSH-REFUSED", record.axis, count=len(reasons), reasons="; ".join(reasons))
    if record.outcome == "rolled-back":
        why = next((step for step in record.steps if " ROLLING_BACK" in step), last)
        return VerifyError("E-PUSH-ROLLED-BACK", record.axis, axis=record.axis, why=why)
    if record.outcome == "held":
        return RollbackFailed("E-PUSH-HELD", record.axis, axis=record.axis, backup=record.backup_path or "none")
    if record.outcome == "held-on":
        return StillOn("E-PUSH-HELD-ON", record.axis, axis=record.axis, backup=record.backup_path or "none")
    return None
