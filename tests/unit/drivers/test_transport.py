"""Wires: the same promises over TCP, in memory and through pyserial, from both ends."""

from __future__ import annotations

import asyncio
import select
import socket

import pytest

from drivers.clock import LoopClock
from drivers.errors import ConfigError, DeadlineExceeded, TransportError
from drivers.serial_io import SerialTransport
from drivers.transport import ByteTransport, FaultyTransport, listen_memory, open_transport, serve
from drivers.transport.memory import PIPE_BYTES
from tests.unit.drivers.loops import run_clean

URLS = ["memory://here", "tcp://127.0.0.1:0", "socket://127.0.0.1:0"]


async def echo(wire: ByteTransport) -> None:
    while True:
        await wire.write(await wire.read(1000))


async def read_all(wire: ByteTransport, count: int) -> bytes:
    data = b""
    while len(data) < count:
        data += await wire.read(1 << 16)
    return data


@pytest.mark.parametrize("url", URLS)
def test_bytes_go_there_and_back(url: str) -> None:
    async def main() -> None:
        clock = LoopClock()
        listener = await serve(url, echo, clock)
        wire = await open_transport(listener.url, clock, 5.0)
        assert wire.description == listener.url
        await wire.write(b"hello")
        assert await read_all(wire, 5) == b"hello"
        await wire.close()
        await wire.close()
        with pytest.raises(TransportError, match="E-LINK-CLOSED"):
            await wire.write(b"more")
        await listener.close()

    run_clean(main, virtual=url.startswith("memory"))


@pytest.mark.parametrize("url", URLS)
def test_much_more_than_any_buffer_arrives_whole(url: str) -> None:
    data = bytes(range(256)) * 16_000

    async def main() -> None:
        clock = LoopClock()

        async def pour(wire: ByteTransport) -> None:
            await wire.read(1)
            await wire.write(data)
            await wire.read(1)

        listener = await serve(url, pour, clock)
        wire = await open_transport(listener.url, clock, 5.0)
        await wire.write(b"?")
        assert await read_all(wire, len(data)) == data
        await wire.close()
        await listener.close()

    run_clean(main, virtual=url.startswith("memory"))


@pytest.mark.parametrize("url", URLS)
def test_a_peer_that_leaves_is_an_exception_after_what_it_said(url: str) -> None:
    async def main() -> None:
        clock = LoopClock()

        async def short(wire: ByteTransport) -> None:
            # Through pyserial a client throws away what waits at the moment of opening.
            await wire.read(1)
            await wire.write(b"bye")

        listener = await serve(url, short, clock)
        wire = await open_transport(listener.url, clock, 5.0)
        await wire.write(b"?")
        assert await read_all(wire, 3) == b"bye"
        for _ in range(2):
            with pytest.raises(TransportError, match="E-LINK-CLOSED"):
                await wire.read(100)
        await wire.close()
        await listener.close()

    run_clean(main, virtual=url.startswith("memory"))


@pytest.mark.parametrize("url", URLS)
def test_a_listener_that_closes_takes_its_conversations_with_it(url: str) -> None:
    async def main() -> None:
        clock = LoopClock()
        listener = await serve(url, echo, clock)
        wire = await open_transport(listener.url, clock, 5.0)
        await wire.write(b"x")
        await wire.read(1)
        await listener.close()
        with pytest.raises(TransportError):
            await wire.read(1)
        await wire.close()
        with pytest.raises(TransportError):
            await open_transport(listener.url, clock, 5.0)

    run_clean(main, virtual=url.startswith("memory"))


@pytest.mark.parametrize("url", URLS[:2])
def test_what_a_handler_dies_of_is_told_when_the_listener_closes(url: str) -> None:
    async def main() -> None:
        clock = LoopClock()

        async def faulty(wire: ByteTransport) -> None:
            await wire.read(1)
            raise ZeroDivisionError("a fault of the simulator")

        listener = await serve(url, faulty, clock)
        wire = await open_transport(listener.url, clock, 5.0)
        await wire.write(b"x")
        with pytest.raises(TransportError):
            await wire.read(1)
        await wire.close()
        with pytest.raises(ZeroDivisionError):
            await listener.close()

    run_clean(main, virtual=url.startswith("memory"))


@pytest.mark.parametrize(
    "url",
    ["", "nothing://x", "tcp://", "tcp://host", "tcp://host:99999999", "tcp://:5", "memory://", "http://a:1"],
)
async def test_urls_that_name_no_wire(url: str) -> None:
    with pytest.raises(ConfigError, match="E-LINK-URL"):
        await open_transport(url, LoopClock(), 1.0)


@pytest.mark.parametrize("url", ["COM3", "/dev/ttyUSB0", "tcp://127.0.0.1:0", ""])
def test_urls_that_cannot_be_served(url: str) -> None:
    async def main() -> None:
        if url.startswith("tcp"):
            first = await serve(url, echo, LoopClock())
            with pytest.raises(TransportError, match="E-LINK-LISTEN"):
                await serve(first.url, echo, LoopClock())
            await first.close()
        else:
            with pytest.raises(ConfigError, match="E-LINK-URL"):
                await serve(url, echo, LoopClock())

    run_clean(main, virtual=False)


def test_a_port_that_its_reader_closes_under_a_write_is_told_as_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        clock = LoopClock()
        listener = await serve("socket://127.0.0.1:0", echo, clock)
        wire = await open_transport(listener.url, clock, 5.0)
        assert isinstance(wire, SerialTransport)

        def closed(data: bytes) -> None:
            select.select([], [-1], [], 0.0)

        with monkeypatch.context() as patch:
            patch.setattr(wire._port, "write", closed)
            with pytest.raises(TransportError, match="E-LINK-CLOSED"):
                await wire.write(b"x")
        await wire.close()
        await listener.close()

    run_clean(main, virtual=False)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.mark.parametrize("scheme", ["tcp", "socket"])
def test_nobody_there(scheme: str) -> None:
    async def main() -> None:
        with pytest.raises(TransportError, match="E-LINK-CONNECT"):
            await open_transport(f"{scheme}://127.0.0.1:{free_port()}", LoopClock(), 5.0)

    run_clean(main, virtual=False)


def test_a_port_that_does_not_exist() -> None:
    async def main() -> None:
        with pytest.raises(TransportError) as caught:
            await open_transport("/dev/there-is-no-such-port", LoopClock(), 5.0)
        assert caught.value.where == "/dev/there-is-no-such-port"

    run_clean(main, virtual=False)


def test_a_memory_name_is_taken_once_and_free_again_after_close() -> None:
    async def main() -> None:
        first = listen_memory("a", echo)
        with pytest.raises(TransportError, match="E-LINK-LISTEN"):
            listen_memory("a", echo)
        await first.close()
        await listen_memory("a", echo).close()
        listen_memory("left over by a careless test", echo)

    run_clean(main, virtual=True)
    run_clean(main, virtual=True)


def test_a_slow_reader_holds_the_writer_back() -> None:
    async def main() -> None:
        clock = LoopClock()
        written = 0

        async def pour(wire: ByteTransport) -> None:
            nonlocal written
            while True:
                await wire.write(bytes(1000))
                written += 1000

        listener = listen_memory("b", pour)
        wire = await open_transport("memory://b", clock, 1.0)
        await clock.sleep(100.0)
        assert written <= PIPE_BYTES + 1000
        await read_all(wire, PIPE_BYTES)
        await clock.sleep(1.0)
        assert written > PIPE_BYTES
        await wire.close()
        await listener.close()

    run_clean(main, virtual=True)


async def test_long_writes_of_two_tasks_do_not_mix() -> None:
    async def both(wire: ByteTransport) -> None:
        await asyncio.gather(wire.write(b"a" * PIPE_BYTES * 3), wire.write(b"b" * PIPE_BYTES))

    listener = listen_memory("c", both)
    wire = await open_transport("memory://c", LoopClock(), 1.0)
    data = await read_all(wire, 4 * PIPE_BYTES)
    assert data in (b"a" * PIPE_BYTES * 3 + b"b" * PIPE_BYTES, b"b" * PIPE_BYTES + b"a" * PIPE_BYTES * 3)
    await wire.close()
    await listener.close()


def test_a_closing_end_is_not_held_by_a_peer_that_does_not_read() -> None:
    async def main() -> None:
        clock = LoopClock(speed=20.0)

        async def deaf(_wire: ByteTransport) -> None:
            await clock.sleep(1e6)

        listener = await serve("tcp://127.0.0.1:0", deaf, clock)
        wire = await open_transport(listener.url, clock, 5.0)
        with pytest.raises(DeadlineExceeded):
            async with clock.deadline(2.0, "write"):
                await wire.write(bytes(50_000_000))
        await wire.close()
        await listener.close()

    run_clean(main, virtual=False)


async def test_a_bent_wire_splits_drops_and_cuts() -> None:
    listener = listen_memory("d", echo)
    straight = await open_transport("memory://d", LoopClock(), 1.0)

    def outgoing(data: bytes) -> list[bytes]:
        if data == b"cut":
            raise TransportError("E-LINK-CLOSED", "bent", why="cut by the plan")
        return [data[:2], b"", data[2:].replace(b"x", b"")]

    wire = FaultyTransport(
        straight, incoming=lambda data: [data[at : at + 1] for at in range(len(data))], outgoing=outgoing
    )
    await wire.write(b"abxcd")
    assert [await wire.read(10) for _ in range(4)] == [b"a", b"b", b"c", b"d"]
    with pytest.raises(TransportError, match="cut by the plan"):
        await wire.write(b"cut")
    await wire.close()
    await listener.close()
