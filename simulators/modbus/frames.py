"""Modbus frames and requests: MBAP of Modbus TCP, RTU with CRC-16, and function codes 03, 06 and 16 on registers.

MODBUS Messaging on TCP/IP Implementation Guide V1.0b 3.1.3; MODBUS over Serial Line V1.02 2.5.1 and 6.2.2; MODBUS
Application Protocol Specification V1.1b3, sections 6.3, 6.6, 6.12 and 7 (exceptions 01 to 04).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

MOST_PDU = 253
MOST_RTU = 256
_HEADER = 7
_SHORTEST_RTU = 4
# RTU tells the end of a frame by silence; over a stream the length must come from the function code.
_FIXED_RTU = dict.fromkeys((1, 2, 3, 4, 5, 6), 8)
_COUNTED_RTU = {0x0F: 6, 0x10: 6, 0x17: 10}


class BrokenFrame(Exception):
    """What came is no frame of this protocol and never will be: the connection is useless."""


@dataclass(frozen=True, slots=True)
class ModbusFrame:
    """A request or response: ``transaction`` counts on TCP only (0 on RTU)."""

    unit: int
    pdu: bytes
    transaction: int = 0


class Framing(Protocol):
    """Takes bytes as they come and gives whole requests; wraps responses."""

    def feed(self, data: bytes, now_s: float) -> list[ModbusFrame]:
        """Requests complete after these bytes. Raises BrokenFrame."""
        ...

    def wrap(self, frame: ModbusFrame) -> bytes:
        """A response on the wire."""
        ...


class Mbap:
    """Modbus TCP: transaction, protocol 0, length, unit, all big-endian."""

    def __init__(self) -> None:
        self._pending = b""

    def feed(self, data: bytes, now_s: float) -> list[ModbusFrame]:  # noqa: ARG002 - TCP frames need no time
        """Requests complete after these bytes. Raises BrokenFrame for another protocol or length."""
        self._pending += data
        found = []
        while len(self._pending) >= _HEADER:
            transaction, protocol, length, unit = struct.unpack_from(">HHHB", self._pending)
            if protocol != 0 or not 2 <= length <= MOST_PDU + 1:
                raise BrokenFrame
            if len(self._pending) < 6 + length:
                break
            found.append(ModbusFrame(unit, self._pending[_HEADER : 6 + length], transaction))
            self._pending = self._pending[6 + length :]
        return found

    def wrap(self, frame: ModbusFrame) -> bytes:
        """A response on the wire."""
        return struct.pack(">HHHB", frame.transaction, 0, len(frame.pdu) + 1, frame.unit) + frame.pdu


def crc16(data: bytes) -> int:
    """CRC of Modbus RTU: polynomial 0xA001 reflected, start 0xFFFF; sent low byte first."""
    crc = 0xFFFF
    for byte in data:
        crc = (crc >> 8) ^ _CRC_TABLE[(crc ^ byte) & 0xFF]
    return crc


def _crc_of_byte(byte: int) -> int:
    for _ in range(8):
        byte = (byte >> 1) ^ (0xA001 if byte & 1 else 0)
    return byte


_CRC_TABLE = tuple(_crc_of_byte(byte) for byte in range(256))


class Rtu:
    """Modbus RTU over a stream of bytes. A frame that stays incomplete for ``gap_s`` is forgotten."""

    def __init__(self, gap_s: float = 0.5) -> None:
        self._gap_s = gap_s
        self._pending = b""
        self._last_s = 0.0

    def feed(self, data: bytes, now_s: float) -> list[ModbusFrame]:
        """Requests complete after these bytes; what has no right CRC is passed over in silence."""
        if now_s - self._last_s > self._gap_s:
            self._pending = b""
        self._last_s = now_s
        self._pending += data
        found = []
        while (frame := self._next()) is not None:
            found.append(frame)
        return found

    def _next(self) -> ModbusFrame | None:
        """The next frame with a right CRC; bytes before it are dropped, an incomplete one at the end is kept."""
        for start in range(len(self._pending)):
            rest = self._pending[start:]
            length = _rtu_length(rest)
            if length is None:
                # Of a function nobody told us about, all that there is may be the frame.
                length = len(rest) if start == 0 else MOST_RTU + 1
            elif start == 0 and len(rest) < length:
                return None
            if len(rest) >= length and has_valid_crc(rest[:length]):
                self._pending = rest[length:]
                return ModbusFrame(rest[0], rest[1 : length - 2])
        self._pending = self._pending[-MOST_RTU:]
        return None

    def wrap(self, frame: ModbusFrame) -> bytes:
        """A response on the wire."""
        body = bytes((frame.unit,)) + frame.pdu
        return body + struct.pack("<H", crc16(body))


def has_valid_crc(frame: bytes) -> bool:
    """Whether an RTU frame ends with its own CRC."""
    return _SHORTEST_RTU <= len(frame) <= MOST_RTU and crc16(frame[:-2]) == frame[-2] | frame[-1] << 8


def _rtu_length(data: bytes) -> int | None:
    """Length of the request that begins here; more than there is while unknown, None for a foreign function."""
    if len(data) < 2:
        return _SHORTEST_RTU
    function = data[1]
    if function in _FIXED_RTU:
        return _FIXED_RTU[function]
    place = _COUNTED_RTU.get(function)
    if place is None:
        return None
    return place + 1 + data[place] + 2 if len(data) > place else place + 3


# Requests and answers.

READ, WRITE_ONE, WRITE_MANY = 0x03, 0x06, 0x10
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_FAILURE = 1, 2, 3, 4
MOST_READ, MOST_WRITTEN = 125, 123


class Registers(Protocol):
    """Holding registers as a PLC offers them."""

    def read(self, address: int, count: int) -> Sequence[int]:
        """``count`` words from ``address``. Raises Refused."""
        ...

    def write(self, address: int, values: Sequence[int]) -> None:
        """Put words from ``address`` on. Raises Refused, Unanswered."""
        ...


class PduRefused(Exception):
    """The answer is an exception with this code."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class NoAnswer(Exception):
    """There is no answer to this request at all."""


def answer_pdu(request: bytes, registers: Registers) -> bytes:
    """The response to one request PDU (function code and data, 1..253 bytes). Passes Unanswered on."""
    work = {READ: _read, WRITE_ONE: _write_one, WRITE_MANY: _write_many}.get(request[0])
    try:
        if work is None:
            raise PduRefused(ILLEGAL_FUNCTION)
        return request[:1] + work(request[1:], registers)
    except PduRefused as refusal:
        return bytes((request[0] | 0x80, refusal.code))


def _pack_words(data: bytes, count: int) -> tuple[int, ...]:
    """The first ``count`` words; exception 03 when the request is shorter."""
    if len(data) < 2 * count:
        raise PduRefused(ILLEGAL_VALUE)
    return struct.unpack_from(f">{count}H", data)


def _check_length(data: bytes, length: int) -> None:
    if len(data) != length:
        raise PduRefused(ILLEGAL_VALUE)


def _read(data: bytes, registers: Registers) -> bytes:
    _check_length(data, 4)
    address, count = _pack_words(data, 2)
    if not 1 <= count <= MOST_READ:
        raise PduRefused(ILLEGAL_VALUE)
    return bytes((2 * count,)) + struct.pack(f">{count}H", *registers.read(address, count))


def _write_one(data: bytes, registers: Registers) -> bytes:
    _check_length(data, 4)
    address, value = _pack_words(data, 2)
    registers.write(address, (value,))
    return data


def _write_many(data: bytes, registers: Registers) -> bytes:
    address, count = _pack_words(data, 2)
    if not 1 <= count <= MOST_WRITTEN or len(data) < 5 or data[4] != 2 * count:
        raise PduRefused(ILLEGAL_VALUE)
    _check_length(data, 5 + 2 * count)
    registers.write(address, struct.unpack(f">{count}H", data[5:]))
    return data[:4]
