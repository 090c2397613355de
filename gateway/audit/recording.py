"""The one call other rooms make: something was done, keep it for good."""

from __future__ import annotations

import os
from collections.abc import Mapping
from datetime import datetime
from importlib import metadata
from pathlib import Path
from typing import Protocol

from gateway.audit.actor import person as who_acts
from gateway.audit.chain import append
from gateway.audit.entries import CORRECTION, AuditEntry, ChainHead, Happening, Role
from gateway.audit.timekeeping import clock_now
from gateway.errors import BusyError, StoreError


class Dated(Protocol):
    """What dates a record: a clock, or one moment of it for another thread."""

    def utc(self) -> datetime:
        """The moment in UTC."""
        ...

    def now(self) -> float:
        """Monotonic seconds."""
        ...


def record(
    root: Path,
    action: str,
    *,
    clock: Dated,
    actor: str = "",
    role: Role = "operator",
    serial: str = "",
    transaction: int = 0,
    plan_hash: str = "",
    base_hash: str = "",
    new_hash: str = "",
    details: Mapping[str, object] | None = None,
) -> ChainHead:
    """Keep what was done, durable on return; ``root`` is the store's folder, ``actor`` who acts if not given.

    ``clock`` must be usable: the wall's needs a running loop. Blocks for a few ms, as the journal does.
    Raises CorruptRecord (E-AUDIT-BROKEN), BusyError (E-AUDIT-BUSY), StoreError: then nothing may be written to
    a machine.
    """
    person, told = actor or who_acts(), dict(details or {})
    happening = Happening(
        action=action,
        actor=person,
        role=role,
        serial=serial,
        transaction=transaction,
        plan_hash=plan_hash,
        base_hash=base_hash,
        new_hash=new_hash,
        details=told,
    )
    utc = clock.utc().isoformat(timespec="milliseconds")
    software = metadata.version("trueflank")
    return append(
        root,
        AuditEntry(
            seq=0,
            utc=utc,
            monotonic_s=round(clock.now(), 6),
            process=os.getpid(),
            software=software,
            happening=happening,
            prev_hash="",
            clock=clock_now(),
        ),
    )


def note(
    root: Path,
    action: str,
    *,
    clock: Dated,
    actor: str = "",
    role: Role = "operator",
    serial: str = "",
    transaction: int = 0,
    plan_hash: str = "",
    base_hash: str = "",
    new_hash: str = "",
    details: Mapping[str, object] | None = None,
) -> str:
    """The same for what is over or writes to no machine: a log that cannot take it stops nothing.

    Returns the problem in words ("": none), to be shown.
    """
    try:
        record(
            root,
            action,
            clock=clock,
            actor=actor,
            role=role,
            serial=serial,
            transaction=transaction,
            plan_hash=plan_hash,
            base_hash=base_hash,
            new_hash=new_hash,
            details=details,
        )
    except (StoreError, BusyError) as error:
        return str(error)
    return ""


def correct(root: Path, seq: int, why: str, *, clock: Dated, actor: str = "") -> ChainHead:
    """Say that an earlier record is wrong; the record itself stays. Raises what `record` raises."""
    return record(root, CORRECTION, clock=clock, actor=actor, details={"corrects": seq, "why": why})
