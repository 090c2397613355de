"""One push per machine: a lock of the operating system, which a killed process cannot leave behind."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from drivers.local.ownfiles import make_own_folder, open_own, read_own
from gateway.errors import BusyError, StoreError

# Windows forbids reading a locked byte, so the byte locked lies beyond the holder's name.
_BYTE = 1024
# Who only asks whether a lock is held takes it for some microseconds.
TRIES = 100


@contextlib.contextmanager
def machine_lock(folder: Path) -> Iterator[None]:
    """Hold a machine's lock and, above it, the gateway's: one push at a time, whatever the machine.

    Raises BusyError (E-PUSH-BUSY) naming the holder, StoreError (E-PUSH-DISK).
    """
    with held(folder), held(folder.parent):
        yield


@contextlib.contextmanager
def held(folder: Path) -> Iterator[None]:
    """Hold one folder's lock. Raises BusyError (E-PUSH-BUSY) naming the holder, StoreError (E-PUSH-DISK)."""
    path = folder / "lock"
    try:
        make_own_folder(folder)
        file = open_own(path, "a+b")
    except OSError as error:
        raise StoreError("E-PUSH-DISK", str(path), why=str(error)) from error
    with file:
        if not any(_take(file) for _ in range(TRIES)):
            raise BusyError("E-PUSH-BUSY", str(folder), holder=_holder(path))
        _sign(file)
        try:
            yield
        finally:
            _give_back(file)


def is_held(folder: Path) -> bool:
    """Whether somebody, this process included, holds a folder's lock. Raises StoreError (E-PUSH-DISK)."""
    try:
        file = open_own(folder / "lock", "r+b")
    except FileNotFoundError:
        return False
    except OSError as error:
        raise StoreError("E-PUSH-DISK", str(folder), why=str(error)) from error
    with file:
        taken = _take(file)
        if taken:
            _give_back(file)
        return not taken


def _holder(path: Path) -> str:
    try:
        return read_own(path)[:80].decode("ascii", "replace").strip() or "unknown"
    except OSError:
        return "unknown"


def _sign(file: BinaryIO) -> None:
    with contextlib.suppress(OSError):
        file.truncate(0)
        file.write(f"process {os.getpid()}\n".encode("ascii"))
        file.flush()


if sys.platform == "win32":
    import msvcrt

    def _take(file: BinaryIO) -> bool:
        file.seek(_BYTE)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

    def _give_back(file: BinaryIO) -> None:
        file.seek(_BYTE)
        with contextlib.suppress(OSError):
            msvcrt.locking(file.fileno(), msvcrt.LK_UNLCK, 1)

else:
    import fcntl

    def _take(file: BinaryIO) -> bool:
        try:
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return False
        return True

    def _give_back(file: BinaryIO) -> None:
        fcntl.flock(file.fileno(), fcntl.LOCK_UN)
