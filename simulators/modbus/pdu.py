"""Modbus requests -> answers on a register image: function codes 03, 06 and 16, and exceptions 01 to 04.

MODBUS Application Protocol Specification V1.1b3, sections 6.3, 6.6, 6.12 and 7.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Protocol

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


class Unanswered(Exception):
    """There is no answer to this request at all."""


def answer(request: bytes, registers: Registers) -> bytes:
    """The response to one request PDU (function code and data, 1..253 bytes). Passes Unanswered on."""
    work = {READ: _read, WRITE_ONE: _write_one, WRITE_MANY: _write_many}.get(request[0])
    try:
        if work is None:
            raise PduRefused(ILLEGAL_FUNCTION)
        return request[:1] + work(request[1:], registers)
    except PduRefused as refusal:
        return bytes((request[0] | 0x80, refusal.code))


def _words(data: bytes, count: int) -> tuple[int, ...]:
    """The first ``count`` words; exception 03 when the request is shorter."""
    if len(data) < 2 * count:
        raise PduRefused(ILLEGAL_VALUE)
    return struct.unpack_from(f">{count}H", data)


def _exactly(data: bytes, length: int) -> None:
    if len(data) != length:
        raise PduRefused(ILLEGAL_VALUE)


def _read(data: bytes, registers: Registers) -> bytes:
    _exactly(data, 4)
    address, count = _words(data, 2)
    if not 1 <= count <= MOST_READ:
        raise PduRefused(ILLEGAL_VALUE)
    return bytes((2 * count,)) + struct.pack(f">{count}H", *registers.read(address, count))


def _write_one(data: bytes, registers: Registers) -> bytes:
    _exactly(data, 4)
    address, value = _words(data, 2)
    registers.write(address, (value,))
    return data


def _write_many(data: bytes, registers: Registers) -> bytes:
    address, count = _words(data, 2)
    if not 1 <= count <= MOST_WRITTEN or len(data) < 5 or data[4] != 2 * count:
        raise PduRefused(ILLEGAL_VALUE)
    _exactly(data, 5 + 2 * count)
    registers.write(address, struct.unpack(f">{count}H", data[5:]))
    return data[:4]
