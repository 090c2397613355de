"""Who did what to which machine: an append-only log whose records are chained by their hashes.

Tamper-evident, not tamper-proof: an edit, a deletion or a swap shows; who rewrites the whole log and its head shows
only against a head exported earlier to where he cannot reach it.
"""

from __future__ import annotations

from gateway.audit.chain import (
    AUDIT,
    CORRECTION,
    TORN,
    AuditEntry,
    AuditEvent,
    ChainHead,
    append,
    audit_files,
    encode_line,
    parse_head,
    read_entries,
)
from gateway.audit.integrity import Health, Problem, check_log, check_store, is_sound, require_sound
from gateway.audit.log_state import (
    APPROVED,
    AS_PUSHED,
    BEGUN,
    DIFFERS,
    ENDING,
    MARKER_LOST,
    PROPOSED,
    USED,
    LogState,
    current_head,
    file_sizes,
    read_log_state,
)
from gateway.audit.recording import act_as, acting_person, correct, note, os_user, record, signed_in
from gateway.audit.syslog import forward

__all__ = [
    "APPROVED",
    "AS_PUSHED",
    "AUDIT",
    "BEGUN",
    "CORRECTION",
    "DIFFERS",
    "ENDING",
    "MARKER_LOST",
    "PROPOSED",
    "TORN",
    "USED",
    "AuditEntry",
    "AuditEvent",
    "ChainHead",
    "Health",
    "LogState",
    "Problem",
    "act_as",
    "acting_person",
    "append",
    "audit_files",
    "check_log",
    "check_store",
    "correct",
    "current_head",
    "encode_line",
    "file_sizes",
    "forward",
    "is_sound",
    "note",
    "os_user",
    "parse_head",
    "read_entries",
    "read_log_state",
    "record",
    "require_sound",
    "signed_in",
]
