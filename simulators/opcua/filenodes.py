"""The server's file system as nodes: FileType and FileDirectoryType methods, answered by identifier."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from drivers.sinumerik.opcua.session import nodes
from simulators.nck.control import Nck
from simulators.nck.spec import NckRefusal
from simulators.opcua.manners import Manners
from simulators.opcua.space import Refused
from simulators.opcua.users import Account

_READ, _WRITE, _ERASE, _APPEND = 1, 2, 4, 8
_FOLDERS = ("Part Program", "Sub Program", "Work Pieces")
MOST_OPEN = 32

ON_FILE: dict[str, tuple[str, ...]] = {
    "Open": ("Byte",),
    "Close": ("UInt32",),
    "Read": ("UInt32", "Int32"),
    "Write": ("UInt32", "ByteString"),
    "GetPosition": ("UInt32",),
    "SetPosition": ("UInt32", "UInt64"),
}
ON_FOLDER: dict[str, tuple[str, ...]] = {"CreateFile": ("String", "Boolean"), "Delete": ("NodeId",)}
PROPERTIES = {"UserWritable": "Boolean", "Writable": "Boolean", "Size": "UInt64", "OpenCount": "UInt16"}
RESULTS = {"Open": ("UInt32",), "Read": ("ByteString",), "GetPosition": ("UInt64",), "CreateFile": ("NodeId", "UInt32")}


@dataclass(slots=True)
class _Handle:
    owner: object
    path: str
    mode: int
    content: bytearray
    position: int = 0
    changed: bool = False


@dataclass(slots=True)
class ServedFiles:
    """Open files of all sessions. ``write_level`` is the protection level that writing needs."""

    nck: Nck
    write_level: int
    manners: Manners
    handles: dict[int, _Handle] = field(default_factory=dict)
    _next: int = 1

    def is_one(self, path: str) -> bool:
        """Whether an identifier belongs to the file system."""
        return path.startswith(nodes.FILE_SYSTEM + "/")

    def call(
        self, owner: str, node: str, arguments: Sequence[Any], types: Sequence[str], account: Account, session: object
    ) -> list[Any]:
        """Results of a method of a file or folder. Raises Refused with the status the server gives."""
        name = node.removeprefix(owner + ".")
        file, folder = self._file(owner), self._folder(owner)
        wanted = (ON_FILE if file else ON_FOLDER).get(name) if file or folder else None
        if wanted is None or node == owner:
            raise Refused("BadMethodInvalid")
        if not account.name:
            raise Refused("BadRequestNotAllowed")
        if list(types) != list(wanted):
            raise Refused("BadInvalidArgument")
        if self.nck.booting:
            raise Refused("BadCommunicationError")
        if folder and not file:
            return self._on_folder(name, folder, arguments, account, session)
        acts: dict[str, Callable[..., list[Any]]] = {
            "Close": self._close,
            "Read": self._read,
            "Write": self._write,
            "GetPosition": self._tell,
            "SetPosition": self._seek,
        }
        if name == "Open":
            return [self._open(file, int(arguments[0]), account, session)]
        return acts[name](self._handle(file, int(arguments[0]), session), int(arguments[0]), *arguments[1:])

    def read(self, path: str, account: Account) -> tuple[str, Any]:
        """Kind and value of a property of a file. Raises Refused."""
        owner, _, name = path.rpartition(".")
        file = self._file(owner)
        if not file or name not in PROPERTIES or not self.nck.files.exists(file):
            raise Refused("BadNodeIdUnknown")
        if not account.may("FsRead"):
            raise Refused("BadUserAccessDenied")
        values = {
            "UserWritable": account.may("FsWrite") and self._level_allows,
            "Writable": True,
            "Size": self.nck.files.size(file),
            "OpenCount": sum(1 for one in self.handles.values() if one.path == file),
        }
        return PROPERTIES[name], values[name]

    def forget(self, session: object) -> None:
        """A session has ended: its files are closed, what was not closed by itself is lost."""
        self.handles = {number: one for number, one in self.handles.items() if one.owner is not session}

    @property
    def _level_allows(self) -> bool:
        return bool(self.nck.access_level <= self.write_level)

    def _open(self, file: str, mode: int, account: Account, session: object) -> int:
        if not self.nck.files.exists(file):
            raise Refused("BadNotFound")
        if mode not in (_READ, _WRITE, _READ | _WRITE, _WRITE | _ERASE, _READ | _WRITE | _ERASE, _WRITE | _APPEND):
            raise Refused("BadInvalidArgument")
        if not account.may("FsWrite" if mode & _WRITE else "FsRead"):
            raise Refused("BadUserAccessDenied")
        if mode & _WRITE and not self._level_allows and not self.manners.silent_file_nodes:
            raise Refused("BadNotSupported")
        if mode & _WRITE and any(one.path == file for one in self.handles.values()):
            raise Refused("BadInvalidState")
        if len(self.handles) >= MOST_OPEN:
            raise Refused("BadResourceUnavailable")
        try:
            content = bytearray() if mode & _ERASE else bytearray(self.nck.files.read(file))
        except NckRefusal as refusal:
            raise Refused("BadInvalidState") from refusal
        return self._opened(_Handle(session, file, mode, content, len(content) if mode & _APPEND else 0))

    def _opened(self, handle: _Handle) -> int:
        number, self._next = self._next, self._next + 1
        handle.changed = bool(handle.mode & _ERASE)
        self.handles[number] = handle
        return number

    def _close(self, handle: _Handle, number: int) -> list[Any]:
        del self.handles[number]
        if not handle.changed or not self._level_allows:
            return []
        try:
            self.nck.files.write(handle.path, bytes(handle.content))
        except NckRefusal as refusal:
            raise Refused("BadOutOfMemory" if refusal.number else "BadInvalidState") from refusal
        return []

    def _read(self, handle: _Handle, _number: int, length: int) -> list[Any]:
        if not handle.mode & _READ or length < 0:
            raise Refused("BadInvalidState" if length >= 0 else "BadInvalidArgument")
        part = bytes(handle.content[handle.position : handle.position + length])
        handle.position += len(part)
        return [part]

    def _write(self, handle: _Handle, _number: int, data: bytes | None) -> list[Any]:
        if not handle.mode & _WRITE:
            raise Refused("BadInvalidState")
        content = data or b""
        handle.content[handle.position : handle.position + len(content)] = content
        handle.position += len(content)
        handle.changed = True
        return []

    def _tell(self, handle: _Handle, _number: int) -> list[Any]:
        return [handle.position]

    def _seek(self, handle: _Handle, _number: int, position: int) -> list[Any]:
        handle.position = min(position, len(handle.content))
        return []

    def _handle(self, file: str, number: int, session: object) -> _Handle:
        found = self.handles.get(number)
        if found is None or found.path != file or found.owner is not session:
            raise Refused("BadInvalidArgument")
        return found

    def _on_folder(
        self, name: str, folder: str, arguments: Sequence[Any], account: Account, session: object
    ) -> list[Any]:
        if not account.may("FsWrite"):
            raise Refused("BadUserAccessDenied")
        if not self._level_allows:
            raise Refused("BadNotSupported")
        if name == "Delete":
            return self._delete(arguments[0])
        path = nodes.from_file(f"{folder}/{arguments[0]}")
        if path is None:
            raise Refused("BadInvalidArgument")
        if self.nck.files.exists(path):
            raise Refused("BadBrowseNameDuplicated")
        try:
            self.nck.files.write(path, b"")
        except NckRefusal as refusal:
            raise Refused("BadOutOfMemory") from refusal
        handle = self._opened(_Handle(session, path, _READ | _WRITE, bytearray())) if arguments[1] else 0
        return [f"{folder}/{str(arguments[0]).upper()}", handle]

    def _delete(self, target: Any) -> list[Any]:
        path = self._file(str(getattr(target, "Identifier", "")))
        if not path:
            raise Refused("BadInvalidArgument")
        try:
            self.nck.files.delete(path)
        except NckRefusal as refusal:
            raise Refused("BadInvalidState" if self.nck.files.exists(path) else "BadNotFound") from refusal
        return []

    @staticmethod
    def _file(node: str) -> str:
        """The control's name of a file node; its identifier is in upper case below the folder."""
        folder, _, name = node.rpartition("/")
        return (nodes.from_file(node) or "") if name == name.upper() and folder else ""

    @staticmethod
    def _folder(node: str) -> str:
        start, _, name = node.rpartition("/")
        return node if start == nodes.FILE_SYSTEM and name in _FOLDERS else ""
