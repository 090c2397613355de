"""The one call of other packages: something was done, keep it for good, with actor and time."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from datetime import datetime
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, Protocol

from gateway.audit.chain import CORRECTION, AuditEntry, AuditEvent, ChainHead, Role, append
from gateway.errors import BusyError, StoreError


class TimeSource(Protocol):
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
    clock: TimeSource,
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
    person, told = actor or acting_person(), dict(details or {})
    happening = AuditEvent(
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
    clock: TimeSource,
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


def correct(root: Path, seq: int, why: str, *, clock: TimeSource, actor: str = "") -> ChainHead:
    """Say that an earlier record is wrong; the record itself stays. Raises what `record` raises."""
    return record(root, CORRECTION, clock=clock, actor=actor, details={"corrects": seq, "why": why})


# The actor is the person signed in at the service, else the operating system's user.

if sys.platform == "win32":

    def os_user() -> str:
        """The name of the user this process belongs to."""
        return os.getlogin()

else:
    import pwd

    def os_user() -> str:
        """The name of the user this process belongs to; ``uid:N`` where the system has no name for him."""
        try:
            return pwd.getpwuid(os.getuid()).pw_name
        except KeyError:
            return f"uid:{os.getuid()}"


_signed_in: ContextVar[str] = ContextVar("signed in", default="")


def signed_in() -> str:
    """Who is signed in at the service for what this task does; "" at a keyboard."""
    return _signed_in.get()


def acting_person() -> str:
    """In whose name this task works; the operating system's user where nobody signed in for it."""
    return _signed_in.get() or os_user()


@contextmanager
def act_as(name: str) -> Iterator[None]:
    """What the block does, its tasks among it, is done in this name; "" changes nothing."""
    before = _signed_in.set(name or _signed_in.get())
    try:
        yield
    finally:
        _signed_in.reset(before)


# Whether the computer's clock follows a time server is recorded with each entry. Linux reports it by `adjtimex`, which
# changes nothing when nothing is asked of it; elsewhere it is recorded as unknown.

UNSYNCHRONISED, NANOSECONDS, ERROR = 0x0040, 0x2000, 5
"""STA_UNSYNC, STA_NANO and TIME_ERROR of adjtimex(2)."""
UNKNOWN: Mapping[str, object] = {"synchronised": "unknown"}


class _Timex(ctypes.Structure):
    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),
        ("freq", ctypes.c_long),
        ("maxerror", ctypes.c_long),
        ("esterror", ctypes.c_long),
        ("status", ctypes.c_int),
        ("more", ctypes.c_byte * 256),
    )


@cache
def _adjtimex() -> Any:
    if not sys.platform.startswith("linux"):
        return None
    try:
        found = ctypes.CDLL(None, use_errno=True).adjtimex
    except (OSError, AttributeError):
        return None
    found.argtypes, found.restype = (ctypes.POINTER(_Timex),), ctypes.c_int
    return found


def clock_now() -> Mapping[str, object]:
    """``synchronised`` (true, false or "unknown"); ``offset_s`` and the largest error ``most_s`` where known."""
    ask, found = _adjtimex(), _Timex()
    if ask is None:
        return UNKNOWN
    state = int(ask(ctypes.byref(found)))
    if state < 0:
        return UNKNOWN
    return clock_from(state, status=found.status, offset=found.offset, most_us=found.maxerror)


def clock_from(state: int, *, status: int, offset: int, most_us: int) -> Mapping[str, object]:
    """The same from the answer's numbers; an offset counts in ns where ``status`` says so, else in us."""
    if state == ERROR or status & UNSYNCHRONISED:
        return {"synchronised": False}
    unit = 1e-9 if status & NANOSECONDS else 1e-6
    return {"synchronised": True, "offset_s": round(offset * unit, 9), "most_s": round(most_us * 1e-6, 6)}
