"""The NCK's passive file system: part programs, subprograms and workpieces, kept as lists of lines."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field

from simulators.nck.spec import NckRefusal

_ROOTS = ("/_N_MPF_DIR", "/_N_SPF_DIR", "/_N_WKS_DIR")
_CLOSED_ROOTS = ("/_N_CMA_DIR", "/_N_CUS_DIR", "/_N_CST_DIR", "/_N_DEF_DIR")
_NAME = re.compile(r"_N_[A-Z0-9_]{1,32}_(MPF|SPF|WPF|INI)")
_WORKPIECE = re.compile(r"/_N_WKS_DIR/_N_[A-Z0-9_]{1,32}_WPD")

OK, NOT_PERMITTED, NO_PATH, NO_FILE, WRONG_TYPE = 0, 1, 2, 3, 4
FULL, IN_USE, NO_MEMORY, NO_RIGHTS, OTHER = 10, 11, 12, 13, 20


class NcFileMissing(NckRefusal):
    """There is no such file."""

    def __init__(self, path: str) -> None:
        super().__init__(0, f"no such file: {path}")


@dataclass(slots=True)
class _File:
    lines: list[str] = field(default_factory=list)
    size: int = 0


def canonical_path(path: str) -> str:
    """A path as the control keeps it: upper case, with its leading slash."""
    return "/" + "/".join(part for part in path.strip().upper().split("/") if part)


def program_path(name: str, directory: str) -> str:
    """The path WRITE, DELETE and ISFILE mean by a name; without a directory the running program's."""
    text = name.strip().upper()
    folder, slash, last = text.rpartition("/")
    if not last.startswith("_N_"):
        last = "_N_" + last
    if not last.endswith(("_MPF", "_SPF", "_WPF", "_INI")):
        last += "_MPF"
    return canonical_path(f"{folder}/{last}") if slash else f"{directory}/{last}"


def _bytes_of(file: _File) -> bytes:
    return "".join(file.lines).encode("latin-1", "replace")


class FileSystem:
    """Files by path; ``reading`` and ``changing`` may refuse (NckRefusal) what the machine's state forbids.

    ``stale``: a file that was replaced, or deleted and written again, is read from outside as it was before.
    """

    def __init__(
        self,
        max_total: int,
        max_count: int,
        reading: Callable[[str], None] = lambda _path: None,
        changing: Callable[[str], None] = lambda _path: None,
        *,
        stale: bool = False,
    ) -> None:
        self._max_total = max_total
        self._max_count = max_count
        self._reading = reading
        self._changing = changing
        self._files: dict[str, _File] = {}
        self._used = 0
        self._stale = stale
        self._former: dict[str, bytes] = {}

    def state_of_path(self, path: str) -> int:
        """WRITE's code for a path: 0, or why no file can be there."""
        folder, _, name = path.rpartition("/")
        if folder.startswith(_CLOSED_ROOTS):
            return NO_RIGHTS
        if not folder.startswith(_ROOTS):
            return NOT_PERMITTED if not folder.startswith("/_N_") else NO_PATH
        if folder not in _ROOTS[:2] and not _WORKPIECE.fullmatch(folder):
            return NO_PATH
        return OK if _NAME.fullmatch(name) else WRONG_TYPE

    def exists(self, path: str) -> bool:
        """Whether the file is there."""
        return canonical_path(path) in self._files

    @property
    def routines(self) -> frozenset[str]:
        """Names of all programs, without folder, front and ending."""
        return frozenset(path.rpartition("/")[2][3:-4] for path in self._files)

    def size(self, path: str) -> int:
        """Bytes of the file."""
        return self._found(path).size

    def read(self, path: str) -> bytes:
        """The whole file. Raises NcFileMissing, or NckRefusal while the control forbids reading."""
        file = self._found(path)
        self._reading(canonical_path(path))
        return self._former.get(canonical_path(path)) or _bytes_of(file)

    def text(self, path: str) -> str:
        """The whole file for the interpreter. Raises NcFileMissing."""
        return "".join(self._found(path).lines)

    def write(self, path: str, data: bytes) -> None:
        """Create or replace a file. Raises NckRefusal: bad path, memory, or the file is being executed."""
        path = canonical_path(path)
        state = self.state_of_path(path)
        if state != OK:
            raise NckRefusal(0, f"no file can be stored at {path} (state {state})")
        self._changing(path)
        self._keep_former(path)
        old = self._files[path].size if path in self._files else 0
        if self._used - old + len(data) > self._max_total or self._crowded(path):
            raise NckRefusal(0, f"no memory for {path}")
        self._used += len(data) - old
        # One byte one character, so what is fetched is byte for byte what was sent.
        self._files[path] = _File(data.decode("latin-1").splitlines(keepends=True), len(data))

    def delete(self, path: str) -> None:
        """Delete a file. Raises NcFileMissing, or NckRefusal when it is being executed."""
        self._found(path)
        self._changing(canonical_path(path))
        self._keep_former(canonical_path(path))
        self._used -= self._files.pop(canonical_path(path)).size

    def list(self, directory: str) -> list[str]:
        """Names of files and workpiece directories in a directory, sorted."""
        front = canonical_path(directory) + "/"
        found = {path[len(front) :].partition("/")[0] for path in self._files if path.startswith(front)}
        if front == "/":
            found |= {root[1:] for root in _ROOTS}
        return sorted(found)

    def append(self, path: str, text: str, limit: int) -> int:
        """WRITE: add a line, creating the file; returns WRITE's state code."""
        state = self.state_of_path(path)
        if state != OK:
            return state
        file = self._files.get(path)
        if file is None:
            if self._crowded(path):
                return NO_MEMORY
            file = self._files[path] = _File()
        elif not self._free(path):
            return IN_USE
        if file.size + len(text) + 1 > limit:
            return FULL
        if self._used + len(text) + 2 > self._max_total:
            return NO_MEMORY
        if file.lines and not file.lines[-1].endswith("\n"):
            file.lines[-1] += "\n"
            file.size += 1
            self._used += 1
        file.lines.append(text + "\n")
        file.size += len(text) + 1
        self._used += len(text) + 1
        return OK

    def remove(self, path: str) -> int:
        """DELETE: returns its state code."""
        state = self.state_of_path(path)
        if state != OK:
            return state
        if path not in self._files:
            return NO_FILE
        if not self._free(path):
            return IN_USE
        self._keep_former(path)
        self._used -= self._files.pop(path).size
        return OK

    def wipe(self) -> None:
        """Everything is lost."""
        self._files.clear()
        self._former.clear()
        self._used = 0

    def saved(self) -> dict[str, str]:
        """All files as text, one character for a byte, for static memory."""
        return {path: _bytes_of(file).decode("latin-1") for path, file in self._files.items()}

    def restore(self, content: dict[str, str]) -> None:
        """Take what `saved` gave."""
        self._files = {path: _File(text.splitlines(keepends=True), len(text)) for path, text in content.items()}
        self._used = sum(file.size for file in self._files.values())

    def _keep_former(self, path: str) -> None:
        if self._stale and path in self._files:
            self._former[path] = _bytes_of(self._files[path])

    def _free(self, path: str) -> bool:
        try:
            self._changing(path)
        except NckRefusal:
            return False
        return True

    def _crowded(self, path: str) -> bool:
        return path not in self._files and len(self._files) >= self._max_count

    def _found(self, path: str) -> _File:
        file = self._files.get(canonical_path(path))
        if file is None:
            raise NcFileMissing(path)
        return file
