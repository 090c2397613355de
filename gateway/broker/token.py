"""The secret that a caller must bear to start a run: made once, kept in a file only its owner can read."""

from __future__ import annotations

import os
import re
import secrets
import stat
from pathlib import Path

from drivers.local.ownfiles import open_own, read_own, refuse_link
from gateway.errors import StoreError

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
        return _kept(path) or _made(path)
    except OSError as error:
        raise StoreError("E-WEB-STATE", str(path), why=error.strerror or str(error)) from error


def _kept(path: Path) -> str:
    if not path.is_file() or not _is_private(path):
        return ""
    text = read_own(path).decode("ascii", errors="replace").strip()
    return text if _SHAPE.fullmatch(text) else ""


def _is_private(path: Path) -> bool:
    # Windows keeps other users out by the folder's own rights; its mode bits say nothing.
    return os.name != "posix" or not stat.S_IMODE(path.stat().st_mode) & 0o077


def _made(path: Path) -> str:
    token = secrets.token_urlsafe(32)
    path.unlink(missing_ok=True)
    with open_own(path, "xb", secret=True) as file:
        file.write(f"{token}\n".encode("ascii"))
    return token
