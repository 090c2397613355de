"""A libmodbus server in front of the PLC double, over TCP and over a line; and mbpoll as a client."""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from drivers.clock import LoopClock
from simulators.modbus import Plc
from simulators.modbus.frames import NoAnswer, PduRefused
from tests.interop.peers import HERE, ended, needed, program

SERVER = HERE / "built" / "mbserver"


class LibmodbusServer:
    """The C program; what its registers hold is asked of the PLC double in this process."""

    def __init__(self, plc: Plc) -> None:
        self._plc = plc
        self._process: asyncio.subprocess.Process | None = None
        self._task: asyncio.Task[None] | None = None
        self.asked = {"R": 0, "W": 0}
        self.shift = 0  # registers by which the map is off, as where a tool counts from 1

    async def start(self, *arguments: str) -> int:
        """Start it; the port it listens on, 0 on a line."""
        needed(SERVER.is_file(), "the libmodbus server (libmodbus-dev, gcc)")
        self._process = await asyncio.create_subprocess_exec(str(SERVER), *arguments, stdin=-1, stdout=-1)
        assert self._process.stdout is not None
        ready = (await self._process.stdout.readline()).split()
        assert ready[:1] == [b"ready"], ready
        self._task = asyncio.get_running_loop().create_task(self._serve())
        return int(ready[1])

    async def _serve(self) -> None:
        assert self._process is not None
        assert self._process.stdout is not None
        assert self._process.stdin is not None
        while line := await self._process.stdout.readline():
            self._process.stdin.write(self._answer(line.decode().split()).encode() + b"\n")

    def _answer(self, words: list[str]) -> str:
        way, address, *rest = words[0], *(int(word) for word in words[1:])
        self.asked[way] += 1
        try:
            if way == "R":
                return " ".join(str(value) for value in (0, *self._plc.read(address + self.shift, rest[0])))
            self._plc.write(address, rest)
        except PduRefused as refused:
            return f"E {refused.code}"
        except NoAnswer:
            return "N"
        return "0"

    async def stop(self) -> None:
        """End the child."""
        if self._process is not None:
            await ended(self._process)
        if self._task is not None:
            await self._task


@contextlib.asynccontextmanager
async def libmodbus_server(plc: Plc, *arguments: str) -> AsyncIterator[tuple[LibmodbusServer, int]]:
    """A server for the length of a block, and its port."""
    made = LibmodbusServer(plc)
    try:
        port = await made.start(*arguments)
        yield made, port
    finally:
        await made.stop()


class Line:
    """Two pseudo-terminals with a wire between them; it shows bytes, no baud rate and no parity."""

    def __init__(self) -> None:
        self._masters: list[int] = []
        self._slaves: list[int] = []
        self.ends: list[str] = []

    def __enter__(self) -> Line:
        pty, tty = pytest.importorskip("pty"), pytest.importorskip("tty")
        for _ in range(2):
            master, slave = pty.openpty()
            for descriptor in (master, slave):
                tty.setraw(descriptor)
            os.set_blocking(master, False)
            self._masters.append(master)
            self._slaves.append(slave)
            self.ends.append(os.ttyname(slave))
        loop = asyncio.get_running_loop()
        for source, sink in (self._masters, self._masters[::-1]):
            loop.add_reader(source, self._pass, source, sink)
        return self

    @staticmethod
    def _pass(source: int, sink: int) -> None:
        with contextlib.suppress(OSError):
            os.write(sink, os.read(source, 4096))

    def __exit__(self, *_: object) -> None:
        for master in self._masters:
            asyncio.get_running_loop().remove_reader(master)
        for descriptor in (*self._masters, *self._slaves):
            os.close(descriptor)


async def mbpoll(*arguments: str) -> tuple[int, str]:
    """One call: (exit code, what it printed). Registers count from 0."""
    path = program("mbpoll", "mbpoll")
    words = (path, "-0", "-1", "-t", "4", "-a", "1", *arguments)
    process = await asyncio.create_subprocess_exec(*words, stdout=-1, stderr=asyncio.subprocess.STDOUT, cwd=Path("/"))
    async with LoopClock().deadline(20.0, "mbpoll"):
        out, _ = await process.communicate()
    return process.returncode or 0, out.decode()
