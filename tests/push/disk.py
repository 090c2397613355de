"""A disk that fails at one write or fsync of the push's journal: full, broken, or full in the middle of a line."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, BinaryIO

from gateway.push import journal

FAULTS = ("full", "broken", "short", "fsync")


@dataclass
class Disk:
    """Fails from the nth journal entry on; ``hit`` says whether it came to that."""

    kind: str
    nth: int
    count: int = 0
    hit: bool = False

    def due(self) -> bool:
        """One more entry; whether the disk fails at it."""
        self.count += 1
        self.hit = self.hit or self.count >= self.nth
        return self.count >= self.nth


class _File:
    """A journal's file on a bad disk."""

    def __init__(self, file: BinaryIO, disk: Disk) -> None:
        self._file, self._disk = file, disk

    def write(self, data: bytes) -> int:
        if self._disk.kind != "fsync" and self._disk.due():
            if self._disk.kind == "short":
                self._file.write(data[: len(data) // 2])
                self._file.flush()
            code = errno.EIO if self._disk.kind == "broken" else errno.ENOSPC
            raise OSError(code, os.strerror(code))
        return self._file.write(data)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


@contextlib.contextmanager
def failing(disk: Disk | None) -> Iterator[None]:
    """Journals made inside the block are kept on this disk."""
    if disk is None:
        yield
        return
    made, fsync = journal.Journal.__init__, os.fsync

    def making(self: journal.Journal, path: Any, file: BinaryIO, *rest: Any) -> None:
        made(self, path, _File(file, disk), *rest)  # type: ignore[arg-type]
        if disk.kind == "fsync":
            os.fsync = bad_fsync  # type: ignore[assignment]

    def bad_fsync(descriptor: Any) -> None:
        if disk.due():
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        fsync(descriptor)

    journal.Journal.__init__ = making  # type: ignore[method-assign, assignment]
    try:
        yield
    finally:
        journal.Journal.__init__ = made  # type: ignore[method-assign]
        os.fsync = fsync
