"""Connections within a virtual loop behave as sockets do: the same talk on a real loop gives the same story."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Awaitable, Callable

import pytest

from drivers.clock import LoopClock, run_virtual

Script = Callable[["Witness", "Witness"], Awaitable[None]]
MEGABYTE = 1 << 20


class Witness(asyncio.Protocol):
    """Remembers what it was told, data as their number of bytes."""

    def __init__(self, *, half_open: bool = False) -> None:
        self.story: list[str] = []
        self.received = bytearray()
        self.held_back = False
        self.half_open = half_open
        self.changed = asyncio.Event()
        self.transport: asyncio.Transport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        self._note("made")

    def data_received(self, data: bytes) -> None:
        self.received += data
        self.changed.set()

    def eof_received(self) -> bool:
        self._note(f"eof after {len(self.received)}")
        return self.half_open

    def connection_lost(self, exc: Exception | None) -> None:
        self._note("reset" if isinstance(exc, ConnectionError) else f"lost {exc}")

    def pause_writing(self) -> None:
        self.held_back = True
        self._note("pause")

    def resume_writing(self) -> None:
        self.held_back = False
        self._note("resume")

    def _note(self, what: str) -> None:
        self.story.append(what)
        self.changed.set()

    async def until(self, good: Callable[[], bool]) -> None:
        while not good():
            self.changed.clear()
            await self.changed.wait()

    async def over(self) -> None:
        await self.until(lambda: self.story[-1] == "reset" or self.story[-1].startswith("lost"))


async def close_after_writing(near: Witness, far: Witness) -> None:
    near.transport.write(b"a" * 10)
    near.transport.write(b"b" * 5)
    near.transport.close()
    near.transport.close()
    await far.over()
    assert bytes(far.received) == b"a" * 10 + b"b" * 5


async def half_close(near: Witness, far: Witness) -> None:
    near.transport.write(b"question")
    near.transport.write_eof()
    await far.until(lambda: far.story[-1] == "eof after 8")
    far.transport.write(b"the answer")
    far.transport.close()
    await near.over()
    assert bytes(near.received) == b"the answer"


async def abort(near: Witness, far: Witness) -> None:
    near.transport.abort()
    await far.over()
    await near.over()


async def write_to_one_who_left(near: Witness, far: Witness) -> None:
    near.transport.close()
    await far.until(lambda: far.story[-1].startswith("eof"))
    while not far.transport.is_closing():
        far.transport.write(b"anybody there?")
        await LoopClock().sleep(0.01)
    await far.over()


async def hold_back(near: Witness, far: Witness) -> None:
    far.transport.pause_reading()
    sent = 0
    while not near.held_back:
        near.transport.write(b"x" * MEGABYTE)
        sent += MEGABYTE
    assert not far.received
    far.transport.resume_reading()
    await near.until(lambda: not near.held_back)
    near.transport.close()
    await far.over()
    assert len(far.received) == sent
    far.story = [line for line in far.story if not line.startswith("eof")]  # how much fits differs


async def leave_with_bytes_unread(near: Witness, far: Witness) -> None:
    near.transport.pause_reading()
    far.transport.write(b"never read")
    await LoopClock().sleep(0.05)
    near.transport.close()
    await far.over()


SCRIPTS = [close_after_writing, half_close, abort, write_to_one_who_left, hold_back, leave_with_bytes_unread]


async def told(script: Script) -> tuple[list[str], list[str], bool]:
    loop = asyncio.get_running_loop()
    half_open = script in (half_close, write_to_one_who_left)
    far = Witness(half_open=half_open)
    server = await loop.create_server(lambda: far, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    _transport, near = await loop.create_connection(Witness, "127.0.0.1", port)
    await far.until(lambda: bool(far.story))
    inside = near.transport.get_extra_info("socket") is None
    await script(near, far)
    server.close()
    await server.wait_closed()
    with pytest.raises(ConnectionRefusedError):
        await loop.create_connection(Witness, "127.0.0.1", port)
    return near.story, far.story, inside


@pytest.mark.parametrize("script", SCRIPTS)
def test_the_story_is_the_same_as_with_sockets(script: Script) -> None:
    near, far, inside = run_virtual(lambda: told(script))
    real_near, real_far, real_inside = asyncio.run(told(script))
    assert (inside, real_inside) == (True, False)
    assert (near, far) == (real_near, real_far)


def test_a_stranger_still_calls_through_the_door() -> None:
    async def main() -> bytes:
        clock, got = LoopClock(), asyncio.Event()
        answers: list[bytes] = []

        async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            await clock.sleep(3.0)
            writer.write(await reader.readline())
            await writer.drain()
            writer.close()

        server = await asyncio.start_server(answer, "127.0.0.1", 0)
        address = server.sockets[0].getsockname()
        loop = asyncio.get_running_loop()

        def call() -> None:
            with socket.create_connection(address, 10.0) as wire:
                wire.sendall(b"from outside\n")
                answers.append(wire.recv(100))
            loop.call_soon_threadsafe(got.set)

        thread = threading.Thread(target=call)
        thread.start()
        await got.wait()
        thread.join()
        server.close()
        await server.wait_closed()
        return answers[0]

    assert run_virtual(main) == b"from outside\n"
