"""A server of messages that goes away at every moment: noticed at once, said once, nothing left for the collector."""

from __future__ import annotations

import asyncio
import gc
import logging
import socket
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from drivers.clock import LoopClock
from drivers.errors import LinkBroken
from gateway.config import MqttSection
from gateway.mqtt.connecting import _Quietly, connected

pytestmark = pytest.mark.wall_time
WELCOME, REFUSED = b"\x20\x02\x00\x00", b"\x20\x02\x00\x05"
PUBLISH, CONFIRMED = 3, b"\x40\x02"


class Server:
    """Answers a CONNECT and ``confirms`` messages, then goes: before the welcome, with it, or at the next message."""

    def __init__(self, welcome: bytes, confirms: int, *, reset: bool) -> None:
        self._welcome, self._confirms, self._reset = welcome, confirms, reset

    @asynccontextmanager
    async def open(self) -> AsyncIterator[int]:
        server = await asyncio.start_server(self._met, "127.0.0.1", 0)
        async with server:
            yield server.sockets[0].getsockname()[1]

    async def _met(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            if not await _packet(reader):
                return  # who only looked whether anybody is there
            writer.write(self._welcome)
            for _one in range(max(self._confirms, 0)):
                if not (told := await _packet(reader)):
                    return
                at = 2 + int.from_bytes(told[:2], "big")
                writer.write(CONFIRMED + told[at : at + 2])
            await writer.drain()
            if self._confirms >= 0:
                await _packet(reader)
        finally:
            if self._reset:
                writer.transport.abort()
            writer.close()


async def _packet(reader: asyncio.StreamReader) -> bytes:
    """The body of the next packet, which is shorter than 128 bytes; empty at the end."""
    head = await reader.read(1)
    size = await reader.read(1)
    return await reader.readexactly(size[0]) if head and size else b""


@pytest.fixture
def noise(caplog: pytest.LogCaptureFixture) -> Iterator[list[str]]:
    """What a journal would show beside our own words."""
    told: list[str] = []
    caplog.set_level(logging.WARNING)
    yield told
    gc.collect()
    told += [one.getMessage() for one in caplog.records]
    assert told == []


@pytest.mark.parametrize("reset", [False, True])
@pytest.mark.parametrize(
    ("welcome", "confirms"),
    [(b"", -1), (REFUSED, -1), (WELCOME, -1), (WELCOME, 0), (WELCOME, 3)],
    ids=["before the welcome", "refused", "with the welcome", "at the first message", "in the middle"],
)
async def test_a_server_that_goes_is_noticed_at_once_and_without_noise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, noise: list[str], *, welcome: bytes, confirms: int, reset: bool
) -> None:
    monkeypatch.setattr("gateway.mqtt.connecting.ANSWER_S", 100.0 if welcome else 0.3)
    asyncio.get_running_loop().set_exception_handler(lambda _loop, met: noise.append(str(met)))
    sent = 0

    async def send(port: int) -> None:
        nonlocal sent
        section = MqttSection(host="127.0.0.1", port=port)
        async with connected(section, tmp_path, "x", will=("a", b""), clock=LoopClock()) as publish:
            while True:
                await publish("a/b", b"{}", stays=False)
                sent += 1

    async with Server(welcome, confirms, reset=reset).open() as port:
        with pytest.raises(LinkBroken) as caught:
            async with LoopClock().deadline(60.0, "far less than the time for an answer"):
                await send(port)
        assert caught.value.code == "E-MQTT-AWAY"
    assert sent == max(confirms, 0)
    gc.collect()


async def test_a_socket_that_closed_before_its_turn_to_write_is_let_be(noise: list[str]) -> None:
    asyncio.get_running_loop().set_exception_handler(lambda _loop, met: noise.append(str(met)))
    client, way = _Quietly("127.0.0.1"), socket.socket()
    client._on_socket_register_write(None, None, way)
    way.close()
    await LoopClock().sleep(0.0)


async def test_who_is_cancelled_while_sending_leaves_nothing_behind(tmp_path: Path, noise: list[str]) -> None:
    asyncio.get_running_loop().set_exception_handler(lambda _loop, met: noise.append(str(met)))
    sending = asyncio.Event()

    async def send(port: int) -> None:
        section = MqttSection(host="127.0.0.1", port=port)
        async with connected(section, tmp_path, "x", will=("a", b""), clock=LoopClock()) as publish:
            sending.set()
            await publish("a/b", b"{}", stays=False)

    async with Server(WELCOME, 0, reset=False).open() as port:
        task = asyncio.create_task(send(port))
        await sending.wait()
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
    gc.collect()
