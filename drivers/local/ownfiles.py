"""Files and folders of our own: never through a symbolic link, for their owner alone unless their folder is shared.

A folder that is writable for its group, or hands its group on (set-group-ID), is shared on purpose: what is made in
it has the group's rights of that folder, as far as the process' umask leaves them. Others never get any right.
Secrets are for their owner alone, always. Windows keeps people out by the folder's access list, which is inherited.
"""

from __future__ import annotations

import errno
import functools
import os
import stat
import sys
from pathlib import Path
from typing import BinaryIO, cast

from drivers.errors import words

_SHARED = stat.S_ISGID | stat.S_IWGRP
_JUNCTION = 0xA0000003  # IO_REPARSE_TAG_MOUNT_POINT
# Never wait for who opens the other end of a pipe that somebody put in a file's place.
_SAFELY = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)


def open_own(path: Path, mode: str, *, secret: bool = False, buffering: int = -1) -> BinaryIO:
    """Open a plain file of our own; ``mode`` binary as for `open`. Raises OSError, for a link or a pipe too."""
    file = cast(BinaryIO, open(path, mode, buffering, opener=functools.partial(_open, secret=secret)))  # noqa: SIM115
    if stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        return file
    file.close()
    raise OSError(errno.EINVAL, words("W-OWN-KIND"), str(path))


def read_own(path: Path) -> bytes:
    """A plain file of our own as bytes. Raises OSError, for a link too."""
    with open_own(path, "rb") as file:
        return bytes(file.read())


def _open(name: str, flags: int, *, secret: bool) -> int:
    path = Path(name)
    # Where the system has no O_NOFOLLOW, looking before is what is left.
    refuse_link(path)
    shared = 0 if secret or not flags & os.O_CREAT else _of_group(path.parent) & 0o060
    try:
        return os.open(name, flags | _SAFELY, 0o600 | shared)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise _linked(path) from error
        raise


def is_link(path: Path) -> bool:
    """Whether a path is a symbolic link, or a junction where the system has those. Raises no error."""
    try:
        found = os.lstat(path)
    except OSError:
        return False
    return stat.S_ISLNK(found.st_mode) or bool(getattr(found, "st_reparse_tag", 0) == _JUNCTION)


def refuse_link(path: Path) -> None:
    """Raises OSError when a path is a link."""
    if is_link(path):
        raise _linked(path)


def _linked(path: Path) -> OSError:
    return OSError(errno.ELOOP, words("W-OWN-LINK"), str(path))


def make_own_folder(path: Path) -> Path:
    """A folder of our own, made with its parents where it is not there yet. Raises OSError, for a link too."""
    refuse_link(path)
    if not path.is_dir():
        make_own_parents(path)
        _make(path)
    return path


def make_own_parents(path: Path) -> None:
    """The folders above a path; those that are there stay as they are, links too. Raises OSError."""
    for parent in reversed(path.parents):
        if not parent.is_dir():
            _make(parent)


def make_new_own_folder(path: Path) -> Path:
    """As `make_own_folder`, but it must not be there yet. Raises FileExistsError, OSError."""
    make_own_parents(path)
    os.mkdir(path, _folder_mode(path))
    return path


def _make(path: Path) -> None:
    try:
        os.mkdir(path, _folder_mode(path))
    except FileExistsError:
        if not path.is_dir():
            raise


def _folder_mode(path: Path) -> int:
    # 0o700 would cut a Windows folder off from the access list of the one above it.
    return 0o777 if os.name == "nt" else 0o700 | _of_group(path.parent)


def _of_group(folder: Path) -> int:
    """The group's rights in a shared folder, 0 in any other."""
    mode = os.stat(folder).st_mode
    return mode & 0o070 if mode & _SHARED else 0


def sync_folder(folder: Path) -> None:
    """Make a rename or a new file durable; Windows has no way to ask for it and needs none."""
    if sys.platform == "win32":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
