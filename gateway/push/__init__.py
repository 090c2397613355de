"""Tables into the controller so that old or new is live at every instant; recovery; the sign proof.

What is imported here is the package's interface; the modules below it are its own affair. On request: `transaction`
(push), `rollback`, `recovery`, `sign_proof`, `setup_values`. Steps on the controller: `preflight`, `load`, `effect`,
`restore`, `disable`. On the disk: `journal`, `sent_programs`, and what they say: `history`, `table_status`,
`recovery_findings`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from drivers.errors import TrueflankError
from drivers.message import Form, Message
from gateway.domain.outcomes import PushRecord
from gateway.errors import RollbackFailed, StillOn, VerifyError, WriteRefused
from gateway.push.compare import table_facts, table_in, tolerance
from gateway.push.context import PushContext, plan_hash
from gateway.push.controller_access import PlanAxes, read_live_of_axes, read_live_tables, table_questions
from gateway.push.disable import DisablePreflight, disable_order, disable_table, preflight_disable
from gateway.push.effect import make_effect_plan, proof_positions
from gateway.push.history import (
    CommittedPush,
    ConsentSet,
    RollbackPreview,
    all_pushes,
    committed_pushes,
    consent_set,
    journalled_machines,
    point_changes,
    pushed_tables,
    rollback_previews,
    sense_conversion,
    table_id,
    tables_of,
)
from gateway.push.journal import (
    JOURNALS,
    JournalRead,
    hold_lock,
    machine_folder,
    mark_emptied,
    read_journals,
    set_ended_aside,
)
from gateway.push.load import other_tables_enabled
from gateway.push.phases import transitions_in_markdown
from gateway.push.preflight import (
    MovedTable,
    PreflightResult,
    group_transactions,
    has_ended,
    is_resumed,
    positions_of,
    run_preflight,
    transaction_groups,
)
from gateway.push.recovery import Choice, LiveReadings, inspect_unfinished, recover_table, unfinished_tables
from gateway.push.recovery_findings import PushFinding, make_finding, with_rest
from gateway.push.rollback import RollbackRequest, group_rollbacks, preflight_rollbacks, roll_back_pushes
from gateway.push.sent_programs import SentProgramBook
from gateway.push.setup_values import (
    SetupContext,
    hand_over_setup,
    last_setup,
    preflight_setup,
    restore_setup,
    sense_refusals,
    setup_history,
    unfinished_setup,
)
from gateway.push.sign_proof import prove_sign, prove_signs
from gateway.push.sign_proof_tables import ROUNDS, TIMES, SignQuestion, Steps, trials_stay_off
from gateway.push.state import Reading, ReadStop
from gateway.push.table_status import TableState, held_pushes, table_states
from gateway.push.transaction import PartialCommitPolicy, push_table, push_tables

__all__ = [
    "JOURNALS",
    "ROUNDS",
    "TIMES",
    "Choice",
    "CommittedPush",
    "ConsentSet",
    "DisablePreflight",
    "JournalRead",
    "LiveReadings",
    "MovedTable",
    "PartialCommitPolicy",
    "PlanAxes",
    "PreflightResult",
    "PushContext",
    "PushFinding",
    "ReadStop",
    "Reading",
    "RollbackPreview",
    "RollbackRequest",
    "SentProgramBook",
    "SetupContext",
    "SignQuestion",
    "Steps",
    "TableState",
    "all_pushes",
    "committed_pushes",
    "consent_set",
    "disable_order",
    "disable_table",
    "group_rollbacks",
    "group_transactions",
    "hand_over_setup",
    "has_ended",
    "held_pushes",
    "hold_lock",
    "inspect_unfinished",
    "is_resumed",
    "journalled_machines",
    "last_setup",
    "machine_folder",
    "make_effect_plan",
    "make_finding",
    "mark_emptied",
    "other_tables_enabled",
    "outcome_alarms",
    "outcome_error",
    "plan_hash",
    "point_changes",
    "positions_of",
    "preflight_disable",
    "preflight_rollbacks",
    "preflight_setup",
    "proof_positions",
    "prove_sign",
    "prove_signs",
    "push_table",
    "push_tables",
    "pushed_tables",
    "read_journals",
    "read_live_of_axes",
    "read_live_tables",
    "recover_table",
    "restore_setup",
    "roll_back_pushes",
    "rollback_previews",
    "run_preflight",
    "sense_conversion",
    "sense_refusals",
    "set_ended_aside",
    "setup_history",
    "table_facts",
    "table_id",
    "table_in",
    "table_questions",
    "table_states",
    "tables_of",
    "tolerance",
    "transaction_groups",
    "transitions_in_markdown",
    "trials_stay_off",
    "unfinished_setup",
    "unfinished_tables",
    "with_rest",
]


def outcome_error(record: PushRecord) -> TrueflankError | None:
    """The error a shell should end with for a push that did not do what was asked; None when it did."""
    why = record.reasons or Message.of("W-PUSH-NO-REASON")
    backup = record.backup_path or Message.of("W-PUSH-NO-BACKUP")
    told: dict[str, Any] = {"axis": record.axis, "why": why, "backup": backup}
    if record.outcome == "refused":
        return WriteRefused("E-PUSH-REFUSED", record.axis, count=max(len(record.reasons), 1), reasons=why)
    back = record.purpose == "restore"
    if record.outcome == "untouched":
        return VerifyError("E-ROLLBACK-UNTOUCHED" if back else "E-PUSH-UNTOUCHED", record.axis, **told)
    if record.outcome == "rolled-back":
        return VerifyError("E-ROLLBACK-UNDONE" if back else "E-PUSH-ROLLED-BACK", record.axis, **told)
    if record.outcome == "held":
        return RollbackFailed("E-ROLLBACK-HELD" if back else "E-PUSH-HELD", record.axis, **told)
    if record.outcome == "held-on":
        return StillOn("E-ROLLBACK-HELD-ON" if back else "E-PUSH-HELD-ON", record.axis, **told)
    return None


def outcome_alarms(records: Iterable[PushRecord]) -> tuple[Message, ...]:
    """What must be put right although the tables are as asked: a marker of the control that could not be written."""
    told = {record.transaction: record for record in records if record.marker}
    return tuple(
        Message("W-PUSH-MARKER", {"axis": one.axis, "transaction": number, "why": one.marker}, Form.REASON)
        for number, one in told.items()
    )
