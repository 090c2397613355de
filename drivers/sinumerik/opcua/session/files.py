"""The control's files as nodes: open, read, write and close piece by piece, where copying methods do not serve."""

from __future__ import annotations

import contextlib
from typing import Any

from drivers.errors import DeviceRefused, TrueflankError, UnsupportedDevice
from drivers.sinumerik.opcua.session import values
from drivers.sinumerik.opcua.session.client import UaSession

PIECE = 64 * 1024
MOST_PARTS = 64 * 1024  # a server that never ends, at a byte for each part
_READ, _REWRITE = 1, 6  # modes of Open: read; write after erasing (OPC 10000-20, 4.2.2)
_NOT_THERE = ("E-UA-FILE", "E-UA-ABSENT")


class FileNodes:
    """Files by their path in the server's file system, ``Sinumerik/FileSystem/Part Program/NAME.MPF``."""

    def __init__(self, session: UaSession, where: str) -> None:
        self._session = session
        self._where = where

    async def writable(self, path: str, timeout_s: float) -> bool | None:
        """What the file says of this user's right to write it; None when it is not there or does not say."""
        (found,) = await self._session.read([f"{_node(path)}.UserWritable"], timeout_s)
        return None if found.status else bool(found.value)

    async def read(self, path: str, timeout_s: float) -> bytes:
        """The whole file; the limit is for each call. Raises DeviceRefused, UnsupportedDevice (E-UA-ABSENT)."""
        node = _node(path)
        handle = await self._open(node, _READ, timeout_s)
        parts: list[bytes] = []
        try:
            while part := await self._part(node, handle, timeout_s):
                parts.append(part)
                if len(parts) > MOST_PARTS:
                    raise values.wrong(f"{node}.Read", part, f"at its end after {MOST_PARTS} parts", self._where)
        finally:
            await self._let_go(node, handle, timeout_s)
        return b"".join(parts)

    async def _part(self, node: str, handle: int, timeout_s: float) -> bytes:
        results = await self._session.invoke(node, "Read", [(handle, "UInt32"), (PIECE, "Int32")], timeout_s)
        part = values.output(results, 0, f"{node}.Read", self._where)
        return b"" if part is None else values.content(part, f"{node}.Read", self._where)

    async def write(self, path: str, content: bytes, timeout_s: float) -> None:
        """Replace or create a file. Each call once; what arrived must be read back by the caller.

        Raises DeviceRefused (E-UA-LEVEL before anything is changed where the file says that it may not be
        written), UnsupportedDevice (E-UA-ABSENT) when the server has no such nodes.
        """
        node = _node(path)
        if await self.writable(path, timeout_s) is False:
            raise DeviceRefused("E-UA-LEVEL", self._where, status="UserWritable is false", what=path)
        handle = await self._open_new(node, timeout_s)
        try:
            for start in range(0, len(content), PIECE):
                piece = [(handle, "UInt32"), (content[start : start + PIECE], "ByteString")]
                await self._session.invoke(node, "Write", piece, timeout_s)
        except TrueflankError:
            await self._let_go(node, handle, timeout_s)
            raise
        await self._session.invoke(node, "Close", [(handle, "UInt32")], timeout_s)

    async def _open_new(self, node: str, timeout_s: float) -> int:
        try:
            return await self._open(node, _REWRITE, timeout_s)
        except (DeviceRefused, UnsupportedDevice) as error:
            if error.code not in _NOT_THERE:
                raise
        folder, _, name = node.rpartition("/")
        results = await self._session.invoke(folder, "CreateFile", [(name, "String"), (True, "Boolean")], timeout_s)
        return self._handle(results, 1, f"{folder}.CreateFile")

    async def _open(self, node: str, mode: int, timeout_s: float) -> int:
        results = await self._session.invoke(node, "Open", [(mode, "Byte")], timeout_s)
        return self._handle(results, 0, f"{node}.Open")

    def _handle(self, results: list[Any], place: int, what: str) -> int:
        return values.whole(values.output(results, place, what, self._where), what, self._where)

    async def _let_go(self, node: str, handle: int, timeout_s: float) -> None:
        """Close a file that is not needed any more; the server does so itself when the session ends."""
        if self._session.is_open:
            with contextlib.suppress(TrueflankError):
                await self._session.invoke(node, "Close", [(handle, "UInt32")], timeout_s)


def _node(path: str) -> str:
    """File names stand in upper case in node identifiers; folders do not."""
    folder, _, name = path.rpartition("/")
    return f"{folder}/{name.upper()}"
