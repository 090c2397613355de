"""Modbus/TCP Security: the same frames inside TLS, both ends with certificates (MB-TCP-Security V3.6)."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)

from drivers.clock import Clock
from drivers.errors import (
    DeadlineExceeded,
    DeviceRefused,
    LinkBroken,
    LocalProtocolError,
    RemoteProtocolError,
    UnsupportedDevice,
)
from drivers.link import Link
from drivers.message import Message
from drivers.sinumerik.mailbox.codec.frames import BUSY, exception_refusal
from drivers.sinumerik.mailbox.settings import ModbusSettings
from drivers.transport import TlsFiles, open_transport

# Modbus/TCP Security: the same frames inside TLS, both ends with certificates (MB-TCP-Security V3.6).


def tls_certificates(settings: ModbusSettings) -> TlsFiles | None:
    """Whom we trust and who we are; None: plain Modbus."""
    if not settings.secured:
        return None
    own, key = Path(settings.client_certificate), Path(settings.client_key_file)
    return TlsFiles(Path(settings.server_certificate), own, key, settings.server_name)


READ, WRITE_ONE, WRITE = 3, 6, 16
MOST_READ, MOST_WRITTEN = 125, 123
_LENGTHS = {WRITE_ONE: 8, WRITE: 8}
_BUSY_REPLIES = 5.0
_BUSY_PAUSE_S = 0.02
_SILENCE_S = 0.05
_READ_BYTES = 4096
_TORN = 3  # bytes at the end of our question that an adapter may lose


@dataclass(frozen=True, slots=True)
class Question:
    """One request: ``values`` to write, or ``count`` registers to read."""

    function: int
    address: int
    count: int
    values: tuple[int, ...] = ()

    def pdu(self) -> ModbusPDU:
        """The request as pymodbus encodes it."""
        if self.function == READ:
            return ReadHoldingRegistersRequest(address=self.address, count=self.count)
        if self.function == WRITE_ONE:
            return WriteSingleRegisterRequest(address=self.address, registers=list(self.values))
        return WriteMultipleRegistersRequest(address=self.address, registers=list(self.values))


@dataclass(frozen=True, slots=True)
class ModbusReply:
    """What came back: registers, an exception code of the standard, or ``problem``: why it cannot be believed."""

    registers: tuple[int, ...] = ()
    exception: int | None = None
    problem: str = ""
    told: str = ""


@dataclass(frozen=True, slots=True)
class Adapter:
    """What an RS-485 adapter adds to a line and is passed over: our own question, zero bytes before an answer."""

    local_echo: bool = False
    leading_zeros: bool = False


class ModbusCodec:
    """Bytes <-> questions and replies of one client; pure but for the transaction number and what was asked."""

    def __init__(self, unit: int, framer: str, adapter: Adapter | None = None) -> None:
        self._unit = unit
        self._adapter = adapter or Adapter()
        self._sent = b""
        self._echoes = 0
        self._decoder = DecodePDU(False)
        self._tcp = framer == "tcp"
        self._framer = FramerSocket(self._decoder) if self._tcp else FramerRTU(self._decoder)
        self._transaction = 0
        self._asked: Question | None = None
        self._buffer = bytearray()
        self._answered = b""

    def send(self, message: Question) -> bytes:
        """A question as bytes. Raises LocalProtocolError (E-MODBUS-LIMIT) for one that Modbus cannot say."""
        most = MOST_READ if message.function == READ else MOST_WRITTEN
        good = 1 <= message.count <= most and 0 <= message.address <= 0x10000 - message.count
        if not good or not all(0 <= value <= 0xFFFF for value in message.values) or not self._unit:
            fields: dict[str, Any] = {"address": message.address, "count": message.count, "most": most}
            raise LocalProtocolError("E-MODBUS-LIMIT", "modbus", **fields)
        self._transaction = self._transaction % 0xFFFF + 1
        self._asked = message
        pdu = message.pdu()
        pdu.dev_id, pdu.transaction_id = self._unit, self._transaction
        self._sent = bytes(self._framer.buildFrame(pdu))
        self._echoes = int(self._adapter.local_echo and not self._tcp)
        return self._sent

    def receive(self, data: bytes) -> Iterable[ModbusReply]:
        """Any bytes to the replies they complete; a repeat of the last answer (TCP) is passed over."""
        self._buffer += data
        found: list[ModbusReply] = []
        while self._buffer:
            reply, used = self._cut_tcp() if self._tcp else self._cut_rtu()
            if not used:
                break
            frame = bytes(self._buffer[:used])
            del self._buffer[:used]
            if self._tcp and frame == self._answered:
                continue
            judged = reply or self._judge(frame)
            if not judged.problem:
                self._answered, self._asked = frame, None
            found.append(judged)
        return found

    # ---- frames -------------------------------------------------------------------------------------

    def _cut_tcp(self) -> tuple[ModbusReply | None, int]:
        """How many bytes the next frame has; a reply already when its head is wrong."""
        if len(self._buffer) < 6:
            return None, 0
        length = int.from_bytes(self._buffer[4:6], "big")
        if self._buffer[2:4] != b"\0\0" or not 3 <= length <= 254:
            return self._wrong("E-MODBUS-FRAME"), len(self._buffer)
        return None, 6 + length if len(self._buffer) >= 6 + length else 0

    def _passed_over(self) -> tuple[ModbusReply | None, int] | None:
        """Take what an RS-485 adapter adds off the front, where the settings allow it; None once an answer begins.

        Otherwise the same as a frame that is cut: what is wrong with the bytes, or nothing yet while more must come.
        Zero bytes before an answer come from a line that floats while the driver is switched over.
        """
        while True:
            zeros = len(self._buffer) - len(self._buffer.lstrip(b"\0"))
            if zeros == 1 and (foreign := self._is_of_unit_0()) is not False:
                return (self._wrong("E-MODBUS-UNIT"), len(self._buffer)) if foreign else (None, 0)
            if zeros and not self._adapter.leading_zeros:
                return self._wrong("E-MODBUS-ZEROS"), len(self._buffer)
            del self._buffer[:zeros]
            if not self._sent or self._buffer[: len(self._sent)] != self._sent:
                return None
            if not self._echoes:
                return None if self._is_confirmed() else (self._wrong("E-MODBUS-LOCAL-ECHO"), len(self._buffer))
            self._echoes -= 1
            del self._buffer[: len(self._sent)]

    def _is_of_unit_0(self) -> bool | None:
        """Whether one zero byte begins a whole frame of unit 0 (another device); None while it may still become one."""
        if len(self._buffer) > 3 and self._is_sound(self._buffer):
            return True
        if self._asked is None:
            return False
        if len(self._buffer) == 1:
            return None
        function, refused = self._buffer[1] & 0x7F, self._buffer[1] & 0x80
        if function != self._asked.function:
            return False
        counted = function == READ and not refused
        if counted and self._buffer[2:3] not in (b"", bytes([2 * self._asked.count])):
            return False
        length = 5 if refused else _LENGTHS.get(function, 5 + 2 * self._asked.count)
        return self._is_sound(self._buffer[:length]) if len(self._buffer) >= length else None

    def _is_confirmed(self) -> bool:
        """Whether our own question is what a PLC must answer: a single register is confirmed by its repetition."""
        alone = len(self._buffer) == len(self._sent)
        return alone and self._asked is not None and self._asked.function == WRITE_ONE

    def _may_be_own(self) -> bool:
        """Whether the bytes so far are the beginning of our own question and of no answer to it."""
        begun = len(self._buffer) < len(self._sent) and self._sent.startswith(self._buffer)
        if self._adapter.local_echo and not self._echoes:
            return False
        if not begun or self._asked is None or self._asked.function == WRITE_ONE:
            return begun and bool(self._echoes)
        if self._asked.function == READ:
            return self._buffer[2:3] != bytes([2 * self._asked.count]) or bool(self._echoes)
        return len(self._buffer) < _LENGTHS[WRITE] or not self._is_sound(self._buffer[: _LENGTHS[WRITE]])

    def _may_answer(self) -> bool:
        """Whether the head is that of an answer to a read."""
        asked = self._asked
        return asked is not None and self._buffer[:3] == bytes([self._unit, READ, 2 * asked.count & 0xFF])

    def _is_torn_echo(self) -> bool:
        """Whether these bytes are our own question without its first byte or its last ones, as an adapter that switches
        over late or early gives it back; asked only of what is no answer."""
        ends = (self._sent[:-lost] for lost in range(1, _TORN + 1))
        return bool(self._sent) and any(self._buffer.startswith(piece) for piece in (self._sent[1:], *ends))

    @staticmethod
    def _is_sound(frame: bytes | bytearray) -> bool:
        return bool(FramerRTU.check_CRC(bytes(frame[:-2]), int.from_bytes(frame[-2:], "big")))

    def _cut_rtu(self) -> tuple[ModbusReply | None, int]:
        added = self._passed_over()
        if added is not None:
            return added
        if not self._buffer or self._may_be_own():
            return None, 0
        if self._asked is None:
            return self._wrong("E-MODBUS-STRAY"), len(self._buffer)
        if len(self._buffer) < 3:
            return None, 0
        unit, function = self._buffer[0], self._buffer[1]
        if (unit != self._unit or function == READ) and not self._may_answer() and self._is_torn_echo():
            return self._wrong("E-MODBUS-LOCAL-ECHO"), len(self._buffer)
        if unit != self._unit:
            return self._wrong("E-MODBUS-UNIT"), len(self._buffer)
        if function == READ and self._buffer[2] != 2 * self._asked.count:
            return self._wrong("E-MODBUS-LENGTH"), len(self._buffer)
        length = 5 if function & 0x80 else _LENGTHS.get(function, 5 + self._buffer[2])
        if function not in (READ, WRITE_ONE, WRITE) and not function & 0x80:
            return self._wrong("E-MODBUS-REPLY"), len(self._buffer)
        return None, length if len(self._buffer) >= length else 0

    def _wrong(self, problem: str) -> ModbusReply:
        return ModbusReply(problem=problem, told=self._buffer[:32].hex(" "))

    def _judge(self, frame: bytes) -> ModbusReply:
        problem = self._tcp_problem(frame) if self._tcp else self._rtu_problem(frame)
        body = frame[7:] if self._tcp else frame[1:-2]
        return ModbusReply(problem=problem, told=frame[:32].hex(" ")) if problem else self._content(body, frame)

    def _tcp_problem(self, frame: bytes) -> str:
        if self._asked is None:
            return "E-MODBUS-STRAY"
        if int.from_bytes(frame[:2], "big") != self._transaction:
            return "E-MODBUS-TRANSACTION"
        return "" if frame[6] == self._unit else "E-MODBUS-UNIT"

    def _rtu_problem(self, frame: bytes) -> str:
        return "" if self._is_sound(frame) else "E-MODBUS-CRC"

    def _content(self, body: bytes, frame: bytes) -> ModbusReply:
        asked, told = self._asked, frame[:32].hex(" ")
        if asked is None:
            return ModbusReply(problem="E-MODBUS-STRAY", told=told)
        if body[0] == asked.function | 0x80 and len(body) == 2:
            return ModbusReply(exception=body[1], told=told)
        if body[0] != asked.function:
            return ModbusReply(problem="E-MODBUS-REPLY", told=told)
        if asked.function != READ:
            good = body == _echo(asked)
            return ModbusReply() if good else ModbusReply(problem="E-MODBUS-ECHO", told=told)
        if body[1] != 2 * asked.count or len(body) != 2 + 2 * asked.count:
            return ModbusReply(problem="E-MODBUS-LENGTH", told=told)
        pdu = self._decoder.decode(body)
        registers = tuple(pdu.registers) if pdu is not None else ()
        good = len(registers) == asked.count
        return ModbusReply(registers) if good else ModbusReply(problem="E-MODBUS-LENGTH", told=told)


def _echo(asked: Question) -> bytes:
    """What FC06 and FC16 must answer."""
    tail = asked.values[0] if asked.function == WRITE_ONE else asked.count
    return bytes([asked.function]) + asked.address.to_bytes(2, "big") + tail.to_bytes(2, "big")


class ModbusWire:
    """Reads and writes holding registers of one unit, one request at a time, none of them repeated by itself.

    Raises DeadlineExceeded, LinkBroken, TransportError, RemoteProtocolError (E-MODBUS-...: the answer does not
    belong to the question), UnsupportedDevice (exceptions 1-3), DeviceRefused (4, 5, 6, 8).
    """

    def __init__(self, url: str, settings: ModbusSettings, clock: Clock, where: str) -> None:
        self._url = url
        self._settings = settings
        self._framer = settings.framing(url)
        self._clock = clock
        self._where = where
        self._link: Link[Question, ModbusReply] | None = None
        self._unsure = False

    async def open(self, timeout_s: float) -> None:
        """Connect afresh. RTU: first listen until late answers to an older connection must have passed."""
        await self.close()
        async with self._clock.deadline(timeout_s, self._where):
            settings = self._settings
            line: dict[str, Any] = {"baudrate": settings.baudrate, "parity": settings.parity}
            wire = await open_transport(self._url, self._clock, timeout_s, tls=tls_certificates(settings), **line)
            try:
                if self._framer == "rtu":
                    await self._drain(wire.read, settings.reply_s if self._unsure else _SILENCE_S)
            except BaseException:
                await wire.close()
                raise
        codec = ModbusCodec(settings.unit, self._framer, Adapter(settings.local_echo, settings.leading_zeros))
        self._link = Link(self._where, wire, codec, self._clock, is_answer=lambda _reply: True)
        self._unsure = False

    @property
    def sound(self) -> bool:
        """Whether the link is open and no exchange on it was interrupted."""
        return self._link is not None and self._link.failure is None

    async def _drain(self, read: Callable[[int], Awaitable[bytes]], seconds: float) -> None:
        try:
            async with self._clock.deadline(seconds, self._where):
                while True:
                    await read(_READ_BYTES)
        except DeadlineExceeded:
            return

    async def close(self) -> None:
        """Let go of the wire; never raises."""
        link, self._link = self._link, None
        if link is not None:
            self._unsure = self._unsure or link.failure is not None
            await link.close()

    async def read(self, address: int, count: int) -> tuple[int, ...]:
        """Holding registers (FC03). A busy peer is asked again, for a while."""
        question = Question(READ, address, count)
        end = self._clock.now() + _BUSY_REPLIES * self._settings.reply_s
        while True:
            reply = await self._ask(question)
            if reply.exception not in BUSY or self._clock.now() >= end:
                return self._good(question, reply).registers
            await self._clock.sleep(_BUSY_PAUSE_S)

    async def write(self, address: int, values: Sequence[int]) -> None:
        """Several registers (FC16), once. A peer that says "busy" is not told again: it is read back."""
        await self._write(Question(WRITE, address, len(values), tuple(values)))

    async def write_one(self, address: int, value: int) -> None:
        """One register (FC06), once."""
        await self._write(Question(WRITE_ONE, address, 1, (value,)))

    async def _write(self, question: Question) -> None:
        reply = await self._ask(question)
        if reply.exception not in BUSY:
            self._good(question, reply)
            return
        end = self._clock.now() + _BUSY_REPLIES * self._settings.reply_s
        while await self.read(question.address, question.count) != question.values:
            if self._clock.now() >= end:
                self._good(question, reply)
            await self._clock.sleep(_BUSY_PAUSE_S)

    async def _ask(self, question: Question) -> ModbusReply:
        link = self._link
        if link is None:
            raise LinkBroken("E-LINK-BROKEN", self._where, why=Message.of("W-LINK-NOT-OPEN"))
        if self._framer == "rtu":
            await self._clock.sleep(self._settings.gap_s)
        reply = await link.exchange(question, self._settings.reply_s)
        if reply.problem:
            error = RemoteProtocolError(reply.problem, self._where, told=reply.told, address=question.address)
            link.fail(error)
            raise error
        return reply

    def _good(self, question: Question, reply: ModbusReply) -> ModbusReply:
        if reply.exception is not None:
            last = question.address + question.count - 1
            error = exception_refusal(
                reply.exception, question.function, first=question.address, last=last, where=self._where
            )
            if not isinstance(error, DeviceRefused | UnsupportedDevice) and self._link is not None:
                self._link.fail(error)
            raise error
        return reply
