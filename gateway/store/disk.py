"""Files that are either wholly there or not: temporary file, fsync, replace; errors of the disk made ours."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path
from threading import Event

from drivers.local.names import MOST_OF_FILE, allowed, is_file_name, shown
from drivers.local.ownfiles import make_own_folder, open_own, read_own, sync_folder
from gateway.errors import StoreError

# Windows: access denied, sharing violation, lock violation; a virus scanner holds a new file for a moment.
_PASSING = (5, 32, 33)
_TRIES = 25
_PAUSE_S = 0.1


@contextlib.contextmanager
def disk_errors(path: Path) -> Iterator[None]:
    """Turn the operating system's refusals into StoreError (E-STORE-DISK)."""
    try:
        yield
    except OSError as error:
        raise StoreError("E-STORE-DISK", str(path), why=error.strerror or str(error)) from error


def checked_name(name: str) -> str:
    """A file name that is safe on every system, else StoreError (E-STORE-NAME)."""
    if not is_file_name(name):
        raise StoreError("E-STORE-NAME", "store", name=shown(name), allowed=allowed(MOST_OF_FILE))
    return name


def make_folder(path: Path) -> None:
    """A folder of the store, private unless the one above is shared. Raises StoreError (E-STORE-DISK)."""
    with disk_errors(path):
        make_own_folder(path)


def read_whole(path: Path) -> bytes:
    """A file of the store; a link is none. Raises StoreError (E-STORE-DISK)."""
    with disk_errors(path):
        return read_own(path)


def write_whole(path: Path, data: bytes) -> None:
    """Replace a file by these bytes so that a crash leaves the old or the new, never a part."""
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    with disk_errors(path):
        try:
            with open_own(temporary, "xb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
        sync_folder(path.parent)


def replace(source: Path, target: Path) -> None:
    """Rename over, patient for up to 2.5 s with Windows' passing refusals; others are raised at once."""
    for attempt in range(_TRIES):
        try:
            os.replace(source, target)
            return
        except OSError as error:
            if getattr(error, "winerror", None) not in _PASSING or attempt == _TRIES - 1:
                raise
            Event().wait(_PAUSE_S)
