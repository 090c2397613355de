"""What the computer knows of its own clock: whether it is kept by a time server, how far off it is, how sure that is.

Linux tells it by `adjtimex`, which changes nothing when nothing is asked of it. Elsewhere it is unknown, and said so.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Mapping
from functools import cache
from typing import Any

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
def _asked() -> Any:
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
    ask, found = _asked(), _Timex()
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
