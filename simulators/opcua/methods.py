"""The server's methods: files in and out, program selection, own rights. There is none that starts a program."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from drivers.sinumerik.opcua.session import nodes
from simulators.nck.control import Nck
from simulators.nck.spec import NckRefusal
from simulators.opcua.space import Refused
from simulators.opcua.users import Account

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
            raise Refused("BadMethodInvalid")
        if not account.name:
            raise Refused("BadRequestNotAllowed")
        kinds = [kind for _, kind in signature.arguments]
        if list(types) != kinds:
            told = ["Good" if one == kind else "BadTypeMismatch" for one, kind in zip(types, kinds, strict=False)]
            raise Refused("BadInvalidArgument", tuple(told))
        if self._nck.booting:
            raise Refused("BadCommunicationError")
        if self._refusal and name in COPY_METHODS:
            raise Refused(self._refusal)
        return self._known[name](account, *arguments)

    def _to_server(self, account: Account, target: str, data: bytes | None, overwrite: bool) -> None:
        path = self._file(target)
        if not account.may("FsWrite"):
            raise Refused("BadUserAccessDenied")
        if self._nck.access_level > self._file_write_level:
            raise Refused("BadNotSupported")
        if len(data or b"") > self._largest:
            raise Refused("BadOutOfRange")
        if self._nck.files.exists(path) and not overwrite:
            raise Refused("BadInvalidArgument")
        try:
            self._nck.files.write(path, data or b"")
        except NckRefusal as refusal:  # number 0: the file is being executed; else the memory is full
            raise Refused("BadOutOfMemory" if refusal.number else "BadInvalidState") from refusal

    def _from_server(self, account: Account, source: str) -> bytes:
        path = self._file(source)
        if not account.may("FsRead"):
            raise Refused("BadUserAccessDenied")
        if not self._nck.files.exists(path):
            raise Refused("BadNotFound")
        if self._nck.files.size(path) > self._largest:
            raise Refused("BadOutOfRange")
        try:
            return self._nck.files.read(path)
        except NckRefusal as refusal:
            raise Refused("BadInvalidState") from refusal

    def _select(self, account: Account, source: str, channel: int) -> int:
        if self._select_right and not account.may(self._select_right):
            raise Refused("BadUserAccessDenied")
        path = nodes.from_file(source)
        return int(self._nck.select(path, channel)) if path else 2

    def _rights(self, account: Account) -> str:
        return ";".join(sorted(account.rights))

    @staticmethod
    def _file(path: str) -> str:
        name = nodes.from_file(path) if isinstance(path, str) else None
        if name is None:
            raise Refused("BadInvalidArgument", ("BadOutOfRange",))
        return name
