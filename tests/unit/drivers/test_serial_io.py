"""The serial room: threads that end, bytes that are not lost, errors that are ours."""

from __future__ import annotations

import asyncio
import threading
from time import process_time

import pytest

from drivers import serial_io
from drivers.clock import LoopClock
from drivers.errors import DeadlineExceeded, TransportError
from drivers.transport import ByteTransport, open_transport, serve
from tests.unit.drivers.loops import run_clean

pieces: list[bytes] = []


async def read_on(wire: ByteTransport, clock: LoopClock) -> None:
    """Read until the wire fails, leaving the reader thread time to get ahead."""
    pieces.clear()
    async with clock.deadline(10.0, "read"):
        while True:
            pieces.append(await wire.read(100))
            await clock.sleep(0.001)


def test_a_cell_at_a_hundred_times_the_speed_passes_without_much_work() -> None:
    """5 MB in pieces as a counter sends them; a byte-wise reader would need minutes of processor time."""
    piece = b"0 0 12345678 12 0 4000000 0 0\r\n" * 33
    count = 5_000_000 // len(piece)

    async def main() -> None:
        clock = LoopClock()

        async def pour(wire: ByteTransport) -> None:
            await wire.read(1)
            for _ in range(count):
                await wire.write(piece)
            await wire.read(1)

        listener = await serve("socket://127.0.0.1:0", pour, clock)
        wire = await open_transport(listener.url, clock, 5.0)
        start, received = process_time(), 0
        await wire.write(b"!")
        async with clock.deadline(30.0, "pour"):
            while received < count * len(piece):
                received += len(await wire.read(1 << 18))
        assert received == count * len(piece)
        assert process_time() - start < 3.0
        await wire.close()
        await listener.close()

    run_clean(main, virtual=False)


def test_a_socket_whose_bytes_are_not_taken_holds_its_peer_back_and_loses_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(serial_io, "QUEUE_BYTES", 10_000)
    sent = bytes(range(250)) * 20_000

    async def main() -> None:
        clock = LoopClock()
        behind = asyncio.Event()

        async def pour(wire: ByteTransport) -> None:
            await wire.read(1)
            behind.set()
            await wire.write(sent)
            await wire.read(1)

        listener = await serve("socket://127.0.0.1:0", pour, clock)
        wire = await open_transport(listener.url, clock, 5.0)
        await wire.write(b"!")
        await behind.wait()
        got = bytearray()
        async with clock.deadline(20.0, "read"):
            while len(got) < len(sent):
                got += await wire.read(1 << 18)
        assert bytes(got) == sent
        await wire.close()
        await listener.close()

    run_clean(main, virtual=False)


def test_fault_16_more_than_a_port_can_hold_is_an_error_and_not_a_loss(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serial_io, "QUEUE_BYTES", 10_000)
    opened(monkeypatch, ScriptedPort([bytes(4000)] * 5))

    async def main() -> None:
        wire = await open_transport("COM3", LoopClock(), 5.0)
        with pytest.raises(TransportError, match="E-LINK-OVERFLOW"):
            await read_on(wire, LoopClock())
        assert len(b"".join(pieces)) >= 10_000
        await wire.close()

    run_clean(main, virtual=False)


@pytest.mark.wall_time
async def test_giving_up_the_opening_leaves_no_port_open(monkeypatch: pytest.MonkeyPatch) -> None:
    closed = threading.Event()
    may_open = threading.Event()

    class SlowPort:
        def reset_input_buffer(self) -> None:
            return None

        def close(self) -> None:
            closed.set()

    def slowly(*_arguments: object, **_options: object) -> SlowPort:
        may_open.wait(10.0)
        return SlowPort()

    monkeypatch.setattr(serial_io.serial, "serial_for_url", slowly)

    with pytest.raises(DeadlineExceeded):
        await open_transport("COM7", LoopClock(), 0.05)
    assert not closed.is_set()
    may_open.set()
    assert await asyncio.to_thread(closed.wait, 10.0)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("[Errno 11] Could not exclusively lock port /dev/ttyUSB0", "E-LINK-TAKEN"),
        ("could not open port 'COM3': PermissionError(13, 'Access is denied.', None, 5)", "E-LINK-TAKEN"),
        ("could not open port 'COM9': FileNotFoundError(2, 'not found', None, 2)", "E-LINK-CONNECT"),
    ],
)
def test_fault_14_a_port_held_by_another_program_is_told_from_one_that_is_not_there(
    monkeypatch: pytest.MonkeyPatch, text: str, code: str
) -> None:
    asked: dict[str, object] = {}

    def refuse(_url: str, **options: object) -> None:
        asked.update(options)
        raise serial_io.serial.SerialException(text)

    monkeypatch.setattr(serial_io.serial, "serial_for_url", refuse)

    async def main() -> None:
        with pytest.raises(TransportError) as caught:
            await open_transport("COM3", LoopClock(), 5.0, baudrate=9600)
        assert caught.value.code == code
        assert "COM3" in str(caught.value)

    run_clean(main, virtual=False)
    assert asked["exclusive"] is True
    assert asked["baudrate"] == 9600
    assert asked["write_timeout"]


class ScriptedPort:
    """A port as pyserial gives it, with what it does written down."""

    def __init__(self, script: list[bytes | Exception], stuck: bool = False) -> None:
        self.script = script
        self.stuck = stuck
        self.timeout = 0.0
        self.waiting = b""
        self.sizes: list[int] = []
        self.closed = 0

    def reset_input_buffer(self) -> None:
        self.waiting = b""

    @property
    def in_waiting(self) -> int:
        return len(self.waiting)

    def read(self, size: int) -> bytes:
        self.sizes.append(size)
        if not self.waiting and self.script:
            item = self.script.pop(0)
            if isinstance(item, Exception):
                raise item
            self.waiting = item
        data, self.waiting = self.waiting[:size], self.waiting[size:]
        return data

    def write(self, data: bytes) -> int:
        if self.stuck:
            raise serial_io.serial.SerialTimeoutException("Write timeout")
        return len(data)

    def close(self) -> None:
        self.closed += 1


def opened(monkeypatch: pytest.MonkeyPatch, port: ScriptedPort) -> None:
    monkeypatch.setattr(serial_io.serial, "serial_for_url", lambda *_arguments, **_options: port)


def test_a_port_is_read_in_blocks_and_an_unplugged_one_is_our_error(monkeypatch: pytest.MonkeyPatch) -> None:
    port = ScriptedPort([b"x" * 5000, b"y" * 300, OSError(5, "Input/output error")])
    opened(monkeypatch, port)

    async def main() -> None:
        wire = await open_transport("/dev/ttyUSB0", LoopClock(), 5.0)
        with pytest.raises(TransportError, match="Input/output error"):
            await read_on(wire, LoopClock())
        assert b"".join(pieces) == b"x" * 5000 + b"y" * 300
        await wire.close()

    run_clean(main, virtual=False)
    assert port.sizes[:4] == [1, 4999, 1, 299]
    assert port.closed == 1


def test_fault_19_a_device_that_takes_no_bytes_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    opened(monkeypatch, ScriptedPort([], stuck=True))

    async def main() -> None:
        wire = await open_transport("COM3", LoopClock(), 5.0)
        with pytest.raises(TransportError, match="E-LINK-WRITE"):
            await wire.write(b"?")
        await wire.close()
        with pytest.raises(TransportError, match="E-LINK-CLOSED"):
            await wire.read(1)

    run_clean(main, virtual=False)
