"""A Modbus master of these tests' own, from the standard and docs/plc-mailbox.md: bytes by hand, no library of ours."""

from __future__ import annotations

import contextlib
import struct
import zlib
from collections.abc import AsyncIterator, Sequence
from typing import Any

from drivers.clock import LoopClock
from drivers.errors import DeadlineExceeded
from drivers.transport import ByteTransport, open_transport
from simulators.modbus import PlcStation, running_station
from tests.unit.nck.bench import Bench

BUSY, DONE, FAILED = 2, 4, 8
SWITCHING = (5, 6)


def crc16(data: bytes) -> bytes:
    """CRC of RTU bit by bit, low byte first."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return struct.pack("<H", crc)


def words(value: int, low_first: bool = False) -> list[int]:
    high, low = divmod(value & 0xFFFFFFFF, 1 << 16)
    return [low, high] if low_first else [high, low]


def crc32(registers: Sequence[int]) -> int:
    return zlib.crc32(b"".join(struct.pack(">H", word) for word in registers))


class Master:
    """One PC at one wire. ``command`` does what section 3 of the map says; the raw calls do anything."""

    def __init__(self, wire: ByteTransport, rtu: bool = False, unit: int = 1, low_first: bool = False) -> None:
        self.wire = wire
        self.rtu = rtu
        self.unit = unit
        self.low_first = low_first
        self.clock = LoopClock()
        self.transaction = 0
        self.points: list[int] = []

    # -- frames ------------------------------------------------------------------------------------

    async def exchange(self, pdu: bytes, reply_s: float = 1.0) -> bytes:
        """One request PDU, the answer's PDU; DeadlineExceeded when none comes."""
        self.transaction = self.transaction % 0xFFFF + 1
        body = bytes((self.unit,)) + pdu
        head = struct.pack(">HHH", self.transaction, 0, len(body))
        await self.wire.write(body + crc16(body) if self.rtu else head + body)
        async with self.clock.deadline(reply_s, "master"):
            return await (self._rtu_answer() if self.rtu else self._tcp_answer())

    async def _exactly(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            data += await self.wire.read(count - len(data))
        return data

    async def _tcp_answer(self) -> bytes:
        transaction, protocol, length = struct.unpack(">HHH", await self._exactly(6))
        body = await self._exactly(length)
        assert (transaction, protocol, body[0]) == (self.transaction, 0, self.unit)
        return body[1:]

    async def _rtu_answer(self) -> bytes:
        front = await self._exactly(3)
        rest = {3: front[2], 6: 3, 16: 3}.get(front[1], 0) + 2
        frame = front + await self._exactly(rest)
        assert crc16(frame[:-2]) == frame[-2:]
        assert frame[0] == self.unit
        return frame[1:-2]

    async def is_silent(self, pdu: bytes, reply_s: float = 1.0) -> bool:
        try:
            await self.exchange(pdu, reply_s)
        except DeadlineExceeded:
            return True
        return False

    # -- registers ---------------------------------------------------------------------------------

    async def read(self, address: int, count: int) -> list[int]:
        answer = await self.exchange(struct.pack(">BHH", 3, address, count))
        assert answer[:2] == bytes((3, 2 * count)), answer.hex(" ")
        return list(struct.unpack(f">{count}H", answer[2:]))

    async def write(self, address: int, values: Sequence[int]) -> None:
        answer = await self.exchange(many(address, values))
        assert answer == struct.pack(">BHH", 16, address, len(values)), answer.hex(" ")

    async def dint(self, address: int) -> int:
        pair = await self.read(address, 2)
        high, low = reversed(pair) if self.low_first else pair
        return int(struct.unpack(">i", struct.pack(">HH", high, low))[0])

    async def beat(self) -> None:
        (old,) = await self.read(15, 1)
        await self.exchange(struct.pack(">BHH", 6, 15, (old + 1) & 0xFFFF))

    # -- commands ----------------------------------------------------------------------------------

    def header(self, code: int, number: int, fields: dict[int, int], **places: int) -> list[int]:
        """Registers 16..33; ``minimum``, ``step`` and ``maximum`` as DINT."""
        head = [0] * 18
        head[0:2] = [code, number]
        for register, value in fields.items():
            head[register - 16] = value
        for name, register in (("minimum", 22), ("step", 24), ("maximum", 26)):
            head[register - 16 : register - 14] = words(places.get(name, 0), self.low_first)
        return head

    async def put(self, head: list[int], data: Sequence[int] | None = None, crc: int | None = None) -> None:
        """Write a command, its data first; ``crc`` None: the right one over what this command covers."""
        if data is None and head[0] in SWITCHING:
            fields, data = entry_of(dict(enumerate(head, start=16)))
            head = self.header(head[0], head[1], fields)
        if data is not None:
            data = [*data, *[0] * (100 - len(data))]
            await self.write(36, data)
        covered = [*head, *(data or [])] if head[0] != 4 else [*head, *self.points]
        right = crc32(covered) if crc is None else crc
        await self.write(16, [*head, *words(right, self.low_first)])

    async def command(
        self,
        code: int,
        fields: dict[int, int] | None = None,
        data: Sequence[int] | None = None,
        *,
        number: int | None = None,
        crc: int | None = None,
        limit_s: float = 100.0,
        **places: int,
    ) -> tuple[int, int]:
        """Do a command and wait for it; (error, detail)."""
        taken = (await self.read(6, 1))[0]
        number = taken % 0xFFFF + 1 if number is None else number
        head = self.header(code, number, fields or {}, **places)
        await self.put(head, data, crc)
        return await self.result(number, limit_s)

    async def result(self, number: int, limit_s: float = 100.0) -> tuple[int, int]:
        """Wait until the PLC has done that command."""
        end = self.clock.now() + limit_s
        while True:
            found = await self.read(0, 15)
            if found[6] == number and found[5] & (DONE | FAILED):
                assert found[5] & (BUSY | DONE | FAILED) in (DONE, FAILED)
                assert bool(found[5] & FAILED) == bool(found[7])
                return found[7], found[8] | found[9] << 16
            assert self.clock.now() < end, f"command {number} does not end: {found}"
            await self.clock.sleep(0.05)

    async def open(self, session: int = 0x2A17) -> None:
        assert await self.command(1, {19: session}) == (0, 0)

    async def load(
        self, fields: dict[int, int], values: Sequence[int], minimum: int = 0, step: int = 100_000
    ) -> tuple[int, int]:
        """Begin, chunks and verify of one table; the first error, or (0, 0)."""
        fields = {**fields, 28: len(values)}
        places = {"minimum": minimum, "step": step, "maximum": minimum + step * (len(values) - 1)}
        found = await self.command(2, fields, **places)
        self.points = []
        for first in range(0, len(values), 50):
            if found != (0, 0):
                return found
            part = [word for value in values[first : first + 50] for word in words(value, self.low_first)]
            self.points += part
            count = len(part) // 2
            found = await self.command(3, {**fields, 29: first, 30: count}, part, **places)
        return await self.command(4, fields, **places) if found == (0, 0) else found

    async def read_back(self, fields: dict[int, int], first: int, count: int) -> list[int]:
        """Command 7; checks the CRC."""
        number = (await self.read(6, 1))[0] % 0xFFFF + 1
        head = self.header(7, number, {**fields, 29: first, 30: count})
        await self.put(head)
        assert await self.result(number) == (0, 0)
        area = await self.read(200, 102)
        assert crc32([*head, *area[:100]]) == (
            area[101] << 16 | area[100] if self.low_first else area[100] << 16 | area[101]
        )
        pairs = [area[2 * k : 2 * k + 2] for k in range(count)]
        ordered = [(pair[1], pair[0]) for pair in pairs] if self.low_first else [(pair[0], pair[1]) for pair in pairs]
        return [int(struct.unpack(">i", struct.pack(">HH", high, low))[0]) for high, low in ordered]


def entry_of(fields: dict[int, int]) -> tuple[dict[int, int], list[int]]:
    """Header and data of commands 5 and 6 for the one table that the fields of another command name; flags in 21."""
    kind, index = fields.get(18, 0), fields.get(19, 0)
    axis = fields.get(32, 0) if kind == 2 else index
    return {30: 1}, [kind, index, fields.get(20, 0), axis, fields.get(21, 0) & 0x30]


def many(address: int, values: Sequence[int]) -> bytes:
    """PDU of FC16."""
    return struct.pack(">BHHB", 16, address, len(values), 2 * len(values)) + struct.pack(f">{len(values)}H", *values)


class Desk:
    """A control, its PLC, and a master at it."""

    def __init__(self, bench: Bench, station: PlcStation, master: Master) -> None:
        self.bench = bench
        self.nck = bench.nck
        self.station = station
        self.plc = station.plc
        self.master = master

    async def reconnect(self) -> Master:
        """A new connection of the same PC."""
        await self.master.wire.close()
        self.master.wire = await open_transport(self.station.url, LoopClock(), 5.0)
        return self.master

    async def confirmed(self, code: int, fields: dict[int, int]) -> tuple[int, int]:
        """A command that waits for the button, pressed after 3 s; beats meanwhile."""
        master = self.master
        number = (await master.read(6, 1))[0] % 0xFFFF + 1
        await master.put(master.header(code, number, fields))
        for _ in range(3):
            await self.bench.sleep(1.0)
            await master.beat()
        self.plc.confirm()
        return await master.result(number)


@contextlib.asynccontextmanager
async def at_desk(
    url: str = "memory://plc", *, spec: dict[str, Any] | None = None, **settings: Any
) -> AsyncIterator[Desk]:
    """Control warmed up, PLC serving, master connected, for the length of a test."""
    bench = Bench(**(spec or {}))
    await bench.nck.start()
    try:
        await bench.warm_up()
        async with running_station(bench.nck, bench.clock, settings, url) as station:
            station.plc.on_session = station.plc.release.give
            wire = await open_transport(station.url, LoopClock(), 5.0)
            low_first = settings.get("word_order") == "low-first"
            master = Master(wire, settings.get("framer") == "rtu", settings.get("unit", 1), low_first)
            try:
                yield Desk(bench, station, master)
            finally:
                await master.wire.close()
    finally:
        await bench.nck.stop()
