"""Files and program selection: send, fetch back and compare, select; by methods, else by file nodes.

Only a `LegalProgram` is sent, so that nothing passes the gate by.
"""

from __future__ import annotations

from collections.abc import Callable

from drivers.errors import DeviceRefused, LocalProtocolError, UnsupportedDevice
from drivers.programs import ProgramText
from drivers.sinumerik.ncprogram.legal import LegalProgram
from drivers.sinumerik.opcua.session import nodes, values
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.session.files import FileNodes

COPIED = 16 * 1024 * 1024  # what the copying methods take (manual of 05/2022)
LARGEST = 64 * 1024 * 1024
_SELECTED = 0
_SELECT = {1: "E-NC-CHANNEL", 2: "E-NC-NO-PROGRAM", 3: "E-NC-NOT-RESET"}
# By these the server says that it will not copy, and has not; the file's own node may still serve.
_NOT_COPIED = frozenset({"BadNotSupported", "BadRequestNotAllowed", "BadOutOfRange", "BadRequestTooLarge"})
_NOT_GIVEN = _NOT_COPIED | {"BadResponseTooLarge", "BadEncodingLimitsExceeded"}


class Transfer:
    """Moves text files; ``timeout_s`` bounds each call. ``keep`` is called with each program before it is sent.

    ``text`` is the last one.
    """

    def __init__(self, session: UaSession, channel: int, where: str, timeout_s: float = 5.0) -> None:
        self._session = session
        self._files = FileNodes(session, where)
        self._channel = channel
        self._where = where
        self.timeout_s = timeout_s
        self.text = ""
        self.keep: Callable[[ProgramText], None] = _nowhere

    async def send(self, passed: LegalProgram) -> None:
        """Write a program and read it back. Raises DeviceRefused (E-NC-PROGRAM-CHANGED) when it differs."""
        path, text = passed.program.path, passed.program.text
        content = text.encode("ascii")
        if len(content) > LARGEST:
            raise LocalProtocolError("E-PROGRAM-SIZE", self._where, size=len(content), limit=LARGEST)
        self.keep(passed.program)
        self.text = text
        await self._put(_server_path(path), content)
        if _lines(await self.fetch(path)) != _lines(text):
            raise DeviceRefused("E-NC-PROGRAM-CHANGED", self._where, path=path)

    async def _put(self, path: str, content: bytes) -> None:
        refused: DeviceRefused | None = None
        if "CopyFileToServer" in self._session.methods and len(content) <= COPIED:
            arguments = [(path, "String"), (content, "ByteString"), (True, "Boolean")]
            try:
                await self._session.call("CopyFileToServer", arguments, self.timeout_s)
            except DeviceRefused as error:
                if error.fields.get("status") not in _NOT_COPIED:
                    raise
                refused = error
            else:
                return
        try:
            await self._files.write(path, content, self.timeout_s)
        except UnsupportedDevice as error:
            raise (refused or error) from error

    async def fetch(self, path: str) -> str:
        """A file's text. Raises DeviceRefused (E-UA-FILE, E-UA-BUSY, E-UA-RIGHTS), RemoteProtocolError (E-UA-VALUE)."""
        content = values.content(await self._get(_server_path(path)), path, self._where)
        return content.decode("latin-1")

    async def found(self, path: str) -> str | None:
        """A file's text, None where there is no such file."""
        try:
            return await self.fetch(path)
        except DeviceRefused as error:
            if error.code != "E-UA-FILE":
                raise
            return None

    async def _get(self, path: str) -> object:
        refused: DeviceRefused | None = None
        if "CopyFileFromServer" in self._session.methods:
            try:
                return await self._session.call("CopyFileFromServer", [(path, "String")], self.timeout_s)
            except DeviceRefused as error:
                if error.fields.get("status") not in _NOT_GIVEN:
                    raise
                refused = error
        try:
            return await self._files.read(path, self.timeout_s)
        except UnsupportedDevice as error:
            raise (refused or error) from error

    async def select(self, path: str) -> None:
        """Select a program for NC START. Raises DeviceRefused (E-NC-CHANNEL, E-NC-NO-PROGRAM, E-NC-NOT-RESET...)."""
        arguments = [(_server_path(path), "String"), (self._channel, "Int32")]
        answer = await self._session.call("Select", arguments, self.timeout_s)
        code = values.whole(answer, f"Select {path}", self._where)
        if code != _SELECTED:
            refused = _SELECT.get(code, "E-NC-SELECT")
            raise DeviceRefused(refused, self._where, path=path, answer=code, channel=self._channel, status="busy")


def _nowhere(_program: ProgramText) -> None:
    """Nobody keeps what is sent."""


def _server_path(path: str) -> str:
    found = nodes.to_file(path)
    if found is None:
        raise LocalProtocolError("E-PROGRAM-NAME", path, name=path)
    return found


def _lines(text: str) -> list[str]:
    """The blocks of a program without what transfers may change: line ends and blank lines at the end."""
    return [line.rstrip() for line in text.rstrip().splitlines()]
