"""One daemon for one run store: a lock that the operating system drops when its process dies."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from drivers.local.ownfiles import make_own_parents, open_own
from gateway.errors import BusyError, StoreError

LOCK_FILE = "daemon.lock"

# Windows locks bytes and hides them from readers; this one lies beyond the pid, which stays readable.
_BYTE = 1 << 20

if sys.platform == "win32":
    import msvcrt

    def _take(handle: int) -> None:
        os.lseek(handle, _BYTE, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        os.lseek(handle, 0, os.SEEK_SET)
else:
    import fcntl

    def _take(handle: int) -> None:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder's lock. Raises BusyError (E-WEB-LOCKED) naming the pid, StoreError (E-WEB-STATE)."""
    path = folder / LOCK_FILE
    with _opened(path) as file:
        _lock(file.fileno(), path)
        yield


def _opened(path: Path) -> BinaryIO:
    try:
        make_own_parents(path)
        return open_own(path, "a+b", buffering=0)
    except OSError as error:
        raise StoreError("E-WEB-STATE", str(path), why=error.strerror or str(error)) from error


def _lock(handle: int, path: Path) -> None:
    try:
        _take(handle)
    except OSError as error:
        raise BusyError("E-WEB-LOCKED", str(path), pid=_holder(handle)) from error
    os.ftruncate(handle, 0)
    os.write(handle, str(os.getpid()).encode("ascii"))


def _holder(handle: int) -> str:
    os.lseek(handle, 0, os.SEEK_SET)
    text = os.read(handle, 20)
    return text.decode("ascii") if text.isdigit() else "unknown"


def is_locked(folder: Path, by: int) -> bool:
    """Whether exactly this process holds the folder's lock now: its number alone might be another's by today."""
    try:
        with locked(folder):
            return False
    except BusyError as error:
        return error.fields.get("pid") == str(by)
