"""Who did what to which machine: an append-only log whose records are chained by their hashes.

Tamper-evident, not tamper-proof: an edit, a deletion or a swap shows; who rewrites the whole log and its head shows
only against a head exported earlier to where he cannot reach it.
"""

from __future__ import annotations

from gateway.audit.actor import acting, os_user, person, signed_in
from gateway.audit.chain import AUDIT, append
from gateway.audit.checking import Health, Problem, check, demand, sound
from gateway.audit.entries import CORRECTION, TORN, AuditEntry, ChainHead, Happening, head_of, line_of
from gateway.audit.reading import entries
from gateway.audit.recording import correct, note, record
from gateway.audit.standing import (
    APPROVED,
    AS_PUSHED,
    BEGUN,
    DIFFERS,
    ENDING,
    MARKER_LOST,
    PROPOSED,
    USED,
    Standing,
    head_now,
    size,
    standing,
)
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
    "ChainHead",
    "Happening",
    "Health",
    "Problem",
    "Standing",
    "acting",
    "append",
    "check",
    "correct",
    "demand",
    "entries",
    "forward",
    "head_now",
    "head_of",
    "line_of",
    "note",
    "os_user",
    "person",
    "record",
    "signed_in",
    "size",
    "sound",
    "standing",
]
