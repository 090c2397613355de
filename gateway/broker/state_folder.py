"""One daemon for one run store: the lock that ends with its process, and the secret that a caller must bear."""

from __future__ import annotations

import os
import re
import secrets
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from drivers.local.ownfiles import make_own_parents, open_own, read_own, refuse_link
from gateway.errors import BusyError, StoreError

# One daemon for one run store: a lock that the operating system drops when its process dies.

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
def hold_folder_lock(folder: Path) -> Iterator[None]:
    """Hold the folder's lock. Raises BusyError (E-WEB-LOCKED) naming the pid, StoreError (E-WEB-STATE)."""
    path = folder / LOCK_FILE
    with _open_lock_file(path) as file:
        _lock(file.fileno(), path)
        yield


def _open_lock_file(path: Path) -> BinaryIO:
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
        with hold_folder_lock(folder):
            return False
    except BusyError as error:
        return error.fields.get("pid") == str(by)


# The secret that a caller must bear to start a run: made once, kept in a file only its owner can read.

TOKEN_FILE = "daemon.token"  # noqa: S105 - the file's name
_SHAPE = re.compile(r"[A-Za-z0-9_-]{40,}")


def token_path(folder: Path) -> Path:
    """Where the token of the daemon that serves this run store is kept."""
    return folder / TOKEN_FILE


def token_of(folder: Path) -> str:
    """The stored token; a new one at the first start, or when others could read or spoil the old one.

    Raises StoreError (E-WEB-STATE).
    """
    path = token_path(folder)
    try:
        refuse_link(path)
        return _stored_token(path) or _make_token(path)
    except OSError as error:
        raise StoreError("E-WEB-STATE", str(path), why=error.strerror or str(error)) from error


def _stored_token(path: Path) -> str:
    if not path.is_file() or not _is_private(path):
        return ""
    text = read_own(path).decode("ascii", errors="replace").strip()
    return text if _SHAPE.fullmatch(text) else ""


def _is_private(path: Path) -> bool:
    # Windows keeps other users out by the folder's own rights; its mode bits say nothing.
    return os.name != "posix" or not stat.S_IMODE(path.stat().st_mode) & 0o077


def _make_token(path: Path) -> str:
    token = secrets.token_urlsafe(32)
    path.unlink(missing_ok=True)
    with open_own(path, "xb", secret=True) as file:
        file.write(f"{token}\n".encode("ascii"))
    return token
