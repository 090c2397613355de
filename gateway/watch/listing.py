"""What lies in a folder, and its bytes: plain files only, links are never followed, nothing is ever changed."""

from __future__ import annotations

import hashlib
import os
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from drivers.errors import ConfigError, FileUnreadable

CHUNK = 1 << 20


@dataclass(frozen=True, slots=True)
class SeenFile:
    """One entry of a folder. ``plain`` is false for links, folders and devices."""

    name: str
    size: int
    mtime_ns: int
    plain: bool = True

    @property
    def stamp(self) -> tuple[int, int]:
        """What changes while a file grows."""
        return self.size, self.mtime_ns


class FolderListing(Protocol):
    """A folder as the watcher needs it."""

    def entries(self) -> tuple[SeenFile, ...]:
        """What is there now. Raises ConfigError (E-WATCH-FOLDER)."""
        ...

    def digest(self, seen: SeenFile) -> str:
        """sha256 of a file that is still as seen, "" when it is not. Raises FileUnreadable (E-FILE-READ)."""
        ...

    def path(self, name: str) -> Path:
        """Where a name of this folder is."""
        ...


class Folder:
    """A real folder; folders inside it are not looked into."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def entries(self) -> tuple[SeenFile, ...]:
        """See `FolderListing.entries`; an entry that vanishes meanwhile is left out."""
        found: list[SeenFile] = []
        try:
            with os.scandir(self._root) as scan:
                for entry in scan:
                    seen = _seen(entry)
                    if seen is not None:
                        found.append(seen)
        except OSError as error:
            raise ConfigError("E-WATCH-FOLDER", str(self._root), why=error.strerror or str(error)) from error
        return tuple(sorted(found, key=lambda one: one.name))

    def path(self, name: str) -> Path:
        """See `FolderListing.path`. Raises ConfigError (E-WATCH-NAME) for what would leave the folder."""
        if name in ("", ".", "..") or any(mark in name for mark in ("/", "\\", "\0")):
            raise ConfigError("E-WATCH-NAME", str(self._root), name=repr(name))
        return self._root / name

    def digest(self, seen: SeenFile) -> str:
        """See `FolderListing.digest`."""
        path = self.path(seen.name)
        try:
            descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0))
            with os.fdopen(descriptor, "rb") as file:
                before = os.fstat(descriptor)
                if not stat.S_ISREG(before.st_mode) or (before.st_size, before.st_mtime_ns) != seen.stamp:
                    return ""
                digest = hashlib.sha256()
                while piece := file.read(CHUNK):
                    digest.update(piece)
                after = os.fstat(descriptor)
        except OSError as error:
            raise FileUnreadable("E-FILE-READ", str(path), why=error.strerror or str(error)) from error
        return digest.hexdigest() if (after.st_size, after.st_mtime_ns) == seen.stamp else ""


def _seen(entry: os.DirEntry[str]) -> SeenFile | None:
    try:
        facts = entry.stat(follow_symlinks=False)
    except FileNotFoundError:
        return None
    return SeenFile(entry.name, facts.st_size, facts.st_mtime_ns, stat.S_ISREG(facts.st_mode))
