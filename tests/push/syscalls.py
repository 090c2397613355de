"""Our own storage layer with a fault in one of its system calls, or with a power cut that loses what was not synced.

Each open, write, flush, fsync, replace, unlink and mkdir below one folder is a place, counted from 1. At one of them an
`OSError` is raised, once, as the disk or the system would; or the process dies there, and the folder is left as a disk
may leave it: of each file what its last fsync kept, of each folder the names that its last fsync kept. Nothing here is
the gateway's: the calls are caught in `os` and at the files that `open_own` gives.
"""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from drivers.local import ownfiles
from tests.unit.push.double import Killed

ERRNOS = (errno.ENOSPC, errno.EROFS, errno.EACCES, errno.EIO, errno.EMFILE, errno.ENOMEM, errno.ETIMEDOUT)


@dataclass
class Calls:
    """What happens at which place: ``code`` an errno, 0 the power cut; ``hit`` names the call it came to."""

    root: Path
    nth: int = -1
    code: int = 0
    count: int = 0
    hit: str = ""
    synced: dict[Path, bytes] = field(default_factory=dict)
    durable: dict[Path, bytes] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.root = self.root.resolve()
        self.synced = {path: path.read_bytes() for path in self.root.rglob("*") if path.is_file()}
        self.durable = dict(self.synced)

    def concerns(self, path: Any) -> bool:
        """Whether a path lies below the folder."""
        return isinstance(path, str | os.PathLike) and Path(path).is_absolute() and self.root in Path(path).parents

    def place(self, call: str) -> None:
        """One more place; the fault where it is its turn."""
        self.count += 1
        if self.count != self.nth:
            return
        self.hit = call
        if self.code:
            raise OSError(self.code, os.strerror(self.code))
        raise Killed

    def fsynced(self, path: Path) -> None:
        """A file or a folder is on the disk as it is now."""
        if path.is_dir():
            names = {one for one in path.iterdir() if one.is_file()}
            for gone in [one for one in self.durable if one.parent == path and one not in names]:
                del self.durable[gone]
            self.durable |= {one: self.synced.get(one, b"") for one in names}
        else:
            self.synced[path] = path.read_bytes()
            if path in self.durable:
                self.durable[path] = self.synced[path]

    def cut(self) -> None:
        """Leave the folder as the disk has it."""
        for path in [one for one in self.root.rglob("*") if one.is_file()]:
            if path not in self.durable:
                path.unlink()
        for path, data in self.durable.items():
            if not path.exists() or path.read_bytes() != data:
                path.write_bytes(data)


_NAMED = ("open", "unlink", "mkdir")


class _File:
    """A file whose writes are places too."""

    def __init__(self, file: BinaryIO, calls: Calls) -> None:
        self._file, self._calls = file, calls

    def write(self, data: bytes) -> int:
        self._calls.place("write")
        return self._file.write(data)

    def flush(self) -> None:
        self._calls.place("flush")
        self._file.flush()

    def __enter__(self) -> _File:
        return self

    def __exit__(self, *_error: object) -> None:
        self._file.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


@contextlib.contextmanager
def caught(calls: Calls) -> Iterator[Calls]:
    """Inside the block the storage layer's calls below the folder are counted, and one of them fails."""
    kept = {name: getattr(os, name) for name in (*_NAMED, "fsync", "replace")}
    opened = ownfiles.open_own
    users = [one for one in list(sys.modules.values()) if getattr(one, "open_own", None) is opened]
    patched = {name: _named(name, kept[name], calls) for name in _NAMED}
    patched |= {"replace": _replacing(kept["replace"], calls), "fsync": _syncing(kept["fsync"], calls)}

    def own(path: Path, mode: str, **more: Any) -> Any:
        file = opened(path, mode, **more)
        return _File(file, calls) if calls.concerns(path) and set(mode) & set("wxa+") else file

    try:
        for name, call in patched.items():
            setattr(os, name, call)
        for module in users:
            module.open_own = own  # type: ignore[attr-defined]
        yield calls
    finally:
        for name, call in kept.items():
            setattr(os, name, call)
        for module in users:
            module.open_own = opened  # type: ignore[attr-defined]


def _named(name: str, real: Callable[..., Any], calls: Calls) -> Callable[..., Any]:
    def call(path: Any, *rest: Any, **more: Any) -> Any:
        if calls.concerns(path):
            calls.place(name)
        return real(path, *rest, **more)

    return call


def _replacing(real: Callable[..., Any], calls: Calls) -> Callable[..., Any]:
    def call(source: Any, target: Any, *rest: Any, **more: Any) -> Any:
        if calls.concerns(source):
            calls.place("replace")
        answer = real(source, target, *rest, **more)
        if Path(source) in calls.synced:
            calls.synced[Path(target)] = calls.synced.pop(Path(source))
        return answer

    return call


def _syncing(real: Callable[..., Any], calls: Calls) -> Callable[..., Any]:
    def call(descriptor: Any) -> None:
        number = descriptor if isinstance(descriptor, int) else descriptor.fileno()
        path = Path(os.readlink(f"/proc/self/fd/{number}"))
        ours = calls.concerns(path) or path == calls.root
        if ours:
            calls.place("fsync")
        real(descriptor)
        if ours:
            calls.fsynced(path)

    return call
