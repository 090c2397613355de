"""A scripted PLC in raw bytes: knows the mailbox of docs/plc-mailbox.md a little, and lies on the wire as it is told.

It shares nothing with the driver but the document: neither pymodbus nor the codec.
"""

from __future__ import annotations

import contextlib
import struct
import zlib
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from dataclasses import dataclass, field

from drivers.clock import LoopClock
from drivers.errors import TransportError
from drivers.transport import ByteTransport, serve

Lie = Callable[["Asked", bytes], "Iterable[bytes | float] | None"]

STATUS, TAKEN, CRC, SESSION = 5, 6, 12, 14
AT_REST = 0x0071  # ready, in reset, standing, referenced
RELEASED = 0x80


def words(text: str, count: int) -> list[int]:
    """ASCII into registers."""
    return list(struct.unpack(f">{count}H", text.encode().ljust(2 * count, b"\0")))


def crc16(data: bytes) -> bytes:
    """The check sum of a serial frame."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ 0xA001 if value & 1 else value >> 1
    return struct.pack("<H", value)


@dataclass(frozen=True, slots=True)
class Asked:
    """One request as it came: ``place`` counts from 0 over all connections."""

    place: int
    function: int
    address: int
    count: int
    transaction: int
    command: int = 0


@dataclass
class Rogue:
    """Two axes X1 (mm) and C1 (deg) with EEC tables of ``reserved`` points. `lie` sees each honest reply frame."""

    framer: str = "tcp"
    unit: int = 1
    reserved: int = 70
    low_first: bool = False
    lie: Lie = lambda asked, reply: None
    registers: list[int] = field(default_factory=lambda: [0] * 388)
    tables: dict[int, list[int]] = field(default_factory=dict)
    grids: dict[int, list[int]] = field(default_factory=dict)
    enabled: set[int] = field(default_factory=set)
    asked: list[Asked] = field(default_factory=list)
    done: list[int] = field(default_factory=list)
    received: list[int] = field(default_factory=list)
    connections: int = 0
    beats: float = 0.0

    def __post_init__(self) -> None:
        self.clock = LoopClock()
        self.tables = {1: [0] * self.reserved, 2: [0] * self.reserved}
        self.grids = {1: [0] * 8, 2: [0] * 8}
        registers = self.registers
        registers[0:4] = [0x4743, 3, *self._pair(0x12345678)]
        registers[STATUS] = AT_REST
        registers[306:308] = [1, 2]
        registers[308:324], registers[324:332] = words("ROGUE-1", 16), words("4.8.6", 8)
        registers[349:351] = [2, 0]
        registers[377] = 2
        registers[378:380] = self._pair(0b11)

    def _pair(self, value: int) -> list[int]:
        pair = [value >> 16 & 0xFFFF, value & 0xFFFF]
        return pair[::-1] if self.low_first else pair

    def _crc(self, *blocks: Sequence[int]) -> list[int]:
        data = b"".join(struct.pack(f">{len(block)}H", *block) for block in blocks)
        return self._pair(zlib.crc32(data))

    @property
    def writes(self) -> list[Asked]:
        """Requests that wrote anything but selections and the heartbeat."""
        return [one for one in self.asked if one.function in (6, 16) and one.address != 15 and one.command != 11]

    # ---- the PLC ------------------------------------------------------------------------------------

    def evaluate(self) -> None:
        """One cycle after the number changed: everything is right that the CRC says so of."""
        registers = self.registers
        if registers[17] == registers[TAKEN]:
            return
        head = registers[16:34]
        whole = self.received if head[0] == 4 else ()
        covered = (head, registers[36:136]) if head[0] in (3, 5, 6, 10) else (head, whole)
        sound = self._crc(*covered) == registers[34:36]
        registers[TAKEN], registers[CRC : CRC + 2] = head[1], registers[34:36]
        error = self._do(head) if sound else 1
        registers[7] = error
        registers[STATUS] = registers[STATUS] & ~0x0E | (0x08 if error else 0x04)
        self.done.append(head[0])

    def _do(self, head: list[int]) -> int:
        registers, command = self.registers, head[0]
        if command == 1:
            registers[SESSION] = head[3]
            registers[STATUS] |= RELEASED  # somebody stands at the panel
            registers[384] = 900
        elif command == 9:
            registers[SESSION] = 0
            registers[STATUS] &= ~RELEASED
            registers[384] = 0
        elif command == 10:
            registers[340:349] = registers[36:45]
            registers[380:384] = registers[45:49]
        if command in (5, 6):
            head = [command, head[1], *registers[36:39], *[0] * 13]  # the first entry
        if command in (2, 3, 4, 5, 6, 7, 11):
            if head[3] not in self.tables:
                return 9
            self._select(head[2], head[3], head[4])
        return {2: self._begin, 3: self._chunk, 4: self._verify, 5: self._on, 6: self._off, 7: self._read}.get(
            command, lambda _head: 0
        )(head)

    def _select(self, kind: int, axis: int, encoder: int) -> None:
        registers = self.registers
        registers[351:356] = [kind, axis, encoder, axis, 0b111101 if axis == 1 else 0b111111]
        registers[332:340] = words({1: "X1", 2: "C1"}[axis], 8)
        registers[10] = self.reserved
        self._show()

    def _show(self) -> None:
        registers = self.registers
        axis = registers[352]
        if axis in self.grids:
            registers[356:364] = [self.grids[axis][0], *self.grids[axis][1:7], axis]
            registers[364] = axis
            registers[366] = int(axis in self.enabled)
            registers[355] = 0b111100 if axis == 1 else 0b111111
            registers[STATUS] = registers[STATUS] & ~0x200 | (0x200 if axis in self.enabled else 0)

    def _begin(self, head: list[int]) -> int:
        if head[3] in self.enabled:
            return 7
        self.received = []
        self.registers[11] = 0
        return 0

    def _chunk(self, head: list[int]) -> int:
        self.received += self.registers[36 : 36 + 2 * head[14]]
        self.registers[11] += head[14]
        return 0

    def _verify(self, head: list[int]) -> int:
        self.grids[head[3]] = [head[5], *head[6:12], 0]
        values = self.received + [0] * (2 * self.reserved - len(self.received))
        self.tables[head[3]] = [self._number(values[2 * n : 2 * n + 2]) for n in range(self.reserved)]
        self.registers[11] = 0
        self._show()
        return 0

    def _number(self, pair: list[int]) -> int:
        value = (pair[::-1] if self.low_first else pair)[0] << 16 | (pair[::-1] if self.low_first else pair)[1]
        return value - 2**32 if value >= 2**31 else value

    def _on(self, head: list[int]) -> int:
        self.enabled.add(head[3])
        self._show()
        return 0

    def _off(self, head: list[int]) -> int:
        self.enabled.discard(head[3])
        self._show()
        return 0

    def _read(self, head: list[int]) -> int:
        values = self.tables[head[3]][head[13] : head[13] + head[14]]
        block = [register for value in values for register in self._pair(value)]
        block += [0] * (100 - len(block))
        self.registers[200:302] = [*block, *self._crc(head, block)]
        return 0

    # ---- the wire -----------------------------------------------------------------------------------

    async def converse(self, peer: ByteTransport) -> None:
        """Answer one connection."""
        self.connections += 1
        buffer = b""
        with contextlib.suppress(TransportError):
            while True:
                buffer += await peer.read(4096)
                while (frame := self._cut(buffer)) is not None:
                    buffer = buffer[len(frame) :]
                    await self._reply(peer, frame)

    def _cut(self, buffer: bytes) -> bytes | None:
        if len(buffer) < 8:
            return None
        if self.framer == "tcp":
            length = 6 + int.from_bytes(buffer[4:6], "big")
        else:
            length = 8 if buffer[1] != 16 else 9 + buffer[6]
        return buffer[:length] if len(buffer) >= length else None

    async def _reply(self, peer: ByteTransport, frame: bytes) -> None:
        tcp = self.framer == "tcp"
        transaction = int.from_bytes(frame[:2], "big") if tcp else 0
        pdu = frame[7:] if tcp else frame[1:-2]
        function, address, count = struct.unpack(">BHH", pdu[:5])
        command = int.from_bytes(pdu[6:8], "big") if (function, address) == (16, 16) else 0
        asked = Asked(len(self.asked), function, address, count, transaction, command)
        self.asked.append(asked)
        reply = self.frame(self._answer(pdu), transaction)
        lies = self.lie(asked, reply)
        for piece in [reply] if lies is None else lies:
            if isinstance(piece, float):
                await self.clock.sleep(piece)
            else:
                await peer.write(piece)

    def frame(self, pdu: bytes, transaction: int) -> bytes:
        """An honest frame around a PDU."""
        if self.framer == "tcp":
            return struct.pack(">HHHB", transaction, 0, len(pdu) + 1, self.unit) + pdu
        body = bytes([self.unit]) + pdu
        return body + crc16(body)

    def _answer(self, pdu: bytes) -> bytes:
        function, address, count = struct.unpack(">BHH", pdu[:5])
        registers = self.registers
        if function == 3:
            registers[4] = int(self.clock.now()) & 0xFFFF
            self._show()
            return struct.pack(f">BB{count}H", 3, 2 * count, *registers[address : address + count])
        if function == 6:
            registers[address] = count
            return pdu[:5]
        registers[address : address + count] = struct.unpack(f">{count}H", pdu[6:])
        if address == 16:
            self.evaluate()
        return pdu[:5]


@contextlib.asynccontextmanager
async def serving(rogue: Rogue, url: str = "memory://rogue") -> AsyncIterator[str]:
    """The scripted PLC for the length of a block."""
    listener = await serve(url, rogue.converse, rogue.clock)
    try:
        yield listener.url
    finally:
        await listener.close()
