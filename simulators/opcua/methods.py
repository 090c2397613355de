"""The server's methods: files in and out, program selection, own rights. There is none that starts a program.

The file system is served twice, as on the control: by methods of the Sinumerik node, and as nodes with the methods of
FileType and FileDirectoryType.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from drivers.sinumerik.opcua.session import nodes
from simulators.nck import Nck, NckRefusal
from simulators.opcua.address_space import Account, StatusRefused
from simulators.opcua.quirks import ServerQuirks

MAX_FILE = 16 * 1024 * 1024


@dataclass(frozen=True, slots=True)
class MethodSignature:
    """Argument names and wire types of a method, and the type of its one result ("" for none)."""

    name: str
    arguments: tuple[tuple[str, str], ...]
    result: str


SIGNATURES = (
    MethodSignature(
        "CopyFileToServer", (("TargetFilename", "String"), ("Data", "ByteString"), ("Overwrite", "Boolean")), ""
    ),
    MethodSignature("CopyFileFromServer", (("SourceFile", "String"),), "ByteString"),
    MethodSignature("Select", (("SourceFileNodeId", "String"), ("ChannelNumber", "Int32")), "Int32"),
    MethodSignature("GetMyAccessRights", (), "String"),
)
FILE_METHODS = ("CopyFileToServer", "CopyFileFromServer", "Select")
COPY_METHODS = FILE_METHODS[:2]


class Methods:
    """Calls by name for one account at a time."""

    def __init__(
        self, nck: Nck, file_write_level: int, largest: int = MAX_FILE, refusal: str = "", select_right: str = "ApWrite"
    ) -> None:
        self._nck = nck
        self._select_right = select_right  # "": this server knows no right of its own for it
        self._file_write_level = file_write_level
        self._largest = largest
        self._refusal = refusal  # status the copying methods answer with, whoever calls them
        self._known: dict[str, Callable[..., Any]] = {
            "CopyFileToServer": self._to_server,
            "CopyFileFromServer": self._from_server,
            "Select": self._select,
            "GetMyAccessRights": self._rights,
        }

    def call(self, name: str, arguments: Sequence[Any], types: Sequence[str], account: Account) -> Any:
        """Result of a method, None if it has none. Raises Refused with the status the server gives."""
        signature = next((one for one in SIGNATURES if one.name == name), None)
        if signature is None:
            raise StatusRefused("BadMethodInvalid")
        if not account.name:
            raise StatusRefused("BadRequestNotAllowed")
        kinds = [kind for _, kind in signature.arguments]
        if list(types) != kinds:
            told = ["Good" if one == kind else "BadTypeMismatch" for one, kind in zip(types, kinds, strict=False)]
            raise StatusRefused("BadInvalidArgument", tuple(told))
        if self._nck.booting:
            raise StatusRefused("BadCommunicationError")
        if self._refusal and name in COPY_METHODS:
            raise StatusRefused(self._refusal)
        return self._known[name](account, *arguments)

    def _to_server(self, account: Account, target: str, data: bytes | None, overwrite: bool) -> None:
        path = self._file(target)
        if not account.may("FsWrite"):
            raise StatusRefused("BadUserAccessDenied")
        if self._nck.access_level > self._file_write_level:
            raise StatusRefused("BadNotSupported")
        if len(data or b"") > self._largest:
            raise StatusRefused("BadOutOfRange")
        if self._nck.files.exists(path) and not overwrite:
            raise StatusRefused("BadInvalidArgument")
        try:
            self._nck.files.write(path, data or b"")
        except NckRefusal as refusal:  # number 0: the file is being executed; else the memory is full
            raise StatusRefused("BadOutOfMemory" if refusal.number else "BadInvalidState") from refusal

    def _from_server(self, account: Account, source: str) -> bytes:
        path = self._file(source)
        if not account.may("FsRead"):
            raise StatusRefused("BadUserAccessDenied")
        if not self._nck.files.exists(path):
            raise StatusRefused("BadNotFound")
        if self._nck.files.size(path) > self._largest:
            raise StatusRefused("BadOutOfRange")
        try:
            return self._nck.files.read(path)
        except NckRefusal as refusal:
            raise StatusRefused("BadInvalidState") from refusal

    def _select(self, account: Account, source: str, channel: int) -> int:
        if self._select_right and not account.may(self._select_right):
            raise StatusRefused("BadUserAccessDenied")
        path = nodes.from_file(source)
        return int(self._nck.select(path, channel)) if path else 2

    def _rights(self, account: Account) -> str:
        return ";".join(sorted(account.rights))

    @staticmethod
    def _file(path: str) -> str:
        name = nodes.from_file(path) if isinstance(path, str) else None
        if name is None:
            raise StatusRefused("BadInvalidArgument", ("BadOutOfRange",))
        return name


# Files as nodes, answered by identifier.

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
    quirks: ServerQuirks
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
            raise StatusRefused("BadMethodInvalid")
        if not account.name:
            raise StatusRefused("BadRequestNotAllowed")
        if list(types) != list(wanted):
            raise StatusRefused("BadInvalidArgument")
        if self.nck.booting:
            raise StatusRefused("BadCommunicationError")
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
            raise StatusRefused("BadNodeIdUnknown")
        if not account.may("FsRead"):
            raise StatusRefused("BadUserAccessDenied")
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
            raise StatusRefused("BadNotFound")
        if mode not in (_READ, _WRITE, _READ | _WRITE, _WRITE | _ERASE, _READ | _WRITE | _ERASE, _WRITE | _APPEND):
            raise StatusRefused("BadInvalidArgument")
        if not account.may("FsWrite" if mode & _WRITE else "FsRead"):
            raise StatusRefused("BadUserAccessDenied")
        if mode & _WRITE and not self._level_allows and not self.quirks.silent_file_nodes:
            raise StatusRefused("BadNotSupported")
        if mode & _WRITE and any(one.path == file for one in self.handles.values()):
            raise StatusRefused("BadInvalidState")
        if len(self.handles) >= MOST_OPEN:
            raise StatusRefused("BadResourceUnavailable")
        try:
            content = bytearray() if mode & _ERASE else bytearray(self.nck.files.read(file))
        except NckRefusal as refusal:
            raise StatusRefused("BadInvalidState") from refusal
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
            raise StatusRefused("BadOutOfMemory" if refusal.number else "BadInvalidState") from refusal
        return []

    def _read(self, handle: _Handle, _number: int, length: int) -> list[Any]:
        if not handle.mode & _READ or length < 0:
            raise StatusRefused("BadInvalidState" if length >= 0 else "BadInvalidArgument")
        part = bytes(handle.content[handle.position : handle.position + length])
        handle.position += len(part)
        return [part]

    def _write(self, handle: _Handle, _number: int, data: bytes | None) -> list[Any]:
        if not handle.mode & _WRITE:
            raise StatusRefused("BadInvalidState")
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
            raise StatusRefused("BadInvalidArgument")
        return found

    def _on_folder(
        self, name: str, folder: str, arguments: Sequence[Any], account: Account, session: object
    ) -> list[Any]:
        if not account.may("FsWrite"):
            raise StatusRefused("BadUserAccessDenied")
        if not self._level_allows:
            raise StatusRefused("BadNotSupported")
        if name == "Delete":
            return self._delete(arguments[0])
        path = nodes.from_file(f"{folder}/{arguments[0]}")
        if path is None:
            raise StatusRefused("BadInvalidArgument")
        if self.nck.files.exists(path):
            raise StatusRefused("BadBrowseNameDuplicated")
        try:
            self.nck.files.write(path, b"")
        except NckRefusal as refusal:
            raise StatusRefused("BadOutOfMemory") from refusal
        handle = self._opened(_Handle(session, path, _READ | _WRITE, bytearray())) if arguments[1] else 0
        return [f"{folder}/{str(arguments[0]).upper()}", handle]

    def _delete(self, target: Any) -> list[Any]:
        path = self._file(str(getattr(target, "Identifier", "")))
        if not path:
            raise StatusRefused("BadInvalidArgument")
        try:
            self.nck.files.delete(path)
        except NckRefusal as refusal:
            raise StatusRefused("BadInvalidState" if self.nck.files.exists(path) else "BadNotFound") from refusal
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
