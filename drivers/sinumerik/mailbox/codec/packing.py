"""Registers <-> numbers and text: word order, two's complement, ASCII and the CRC over registers as sent."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Sequence
from typing import Literal

from drivers.sinumerik.mailbox.codec.registers import MAGIC, ORDER_TEST

WordOrder = Literal["high-first", "low-first"]
LOWEST, HIGHEST = -(2**31), 2**31 - 1


def dint(value: int, order: WordOrder) -> tuple[int, int]:
    """Two registers of a signed 32-bit number. Raises OverflowError for a number that does not fit."""
    if not LOWEST <= value <= HIGHEST:
        raise OverflowError(value)
    high, low = (value >> 16) & 0xFFFF, value & 0xFFFF
    return (high, low) if order == "high-first" else (low, high)


def dints(values: Iterable[int], order: WordOrder) -> tuple[int, ...]:
    """Registers of many signed 32-bit numbers, shape (2n,)."""
    return tuple(register for value in values for register in dint(value, order))


def number(registers: Sequence[int], order: WordOrder) -> int:
    """The signed 32-bit number in two registers."""
    value = unsigned(registers, order)
    return value - 2**32 if value >= 2**31 else value


def unsigned(registers: Sequence[int], order: WordOrder) -> int:
    """The unsigned 32-bit number in two registers."""
    first, second = registers
    return (first << 16 | second) if order == "high-first" else (second << 16 | first)


def numbers(registers: Sequence[int], order: WordOrder) -> tuple[int, ...]:
    """The signed 32-bit numbers in an even count of registers."""
    pairs = zip(registers[::2], registers[1::2], strict=True)
    return tuple(number(pair, order) for pair in pairs)


def unsigned_pair(value: int, order: WordOrder) -> tuple[int, int]:
    """Two registers of an unsigned 32-bit number, as a CRC is."""
    high, low = value >> 16, value & 0xFFFF
    return (high, low) if order == "high-first" else (low, high)


def text(words: str, registers: int) -> tuple[int, ...]:
    """ASCII, two characters in a register, unused places 0. Raises OverflowError when it is too long."""
    raw = words.encode("ascii")
    if len(raw) > 2 * registers:
        raise OverflowError(words)
    return struct.unpack(f">{registers}H", raw.ljust(2 * registers, b"\0"))


def words(registers: Sequence[int]) -> str | None:
    """The text in registers, blanks at its ends removed; None when it is not printable ASCII."""
    raw = as_bytes(registers).rstrip(b"\0")
    if not all(32 <= byte < 127 for byte in raw):
        return None
    return raw.decode("ascii").strip()


def as_bytes(registers: Sequence[int]) -> bytes:
    """Registers as they pass on the wire, high byte first."""
    return struct.pack(f">{len(registers)}H", *registers)


def crc32(*blocks: Sequence[int]) -> int:
    """CRC-32 (IEEE 802.3) over the bytes of register blocks, one after the other."""
    value = 0
    for block in blocks:
        value = zlib.crc32(as_bytes(block), value)
    return value


def order_of(registers: Sequence[int]) -> str:
    """What the magic and the word order test (registers 0, 2, 3) show: a word order, or what is wrong instead.

    "high-first", "low-first", "bytes swapped", "shifted by one register" or "no mailbox".
    """
    magic, test = registers[0], (registers[2], registers[3])
    swapped = {(MAGIC & 0xFF) << 8 | MAGIC >> 8}
    if magic == MAGIC:
        for order in ("high-first", "low-first"):
            if test == unsigned_pair(ORDER_TEST, order):
                return order
        return "no mailbox"
    if magic in swapped:
        return "bytes swapped"
    return "shifted by one register" if MAGIC in registers[1:3] or registers[1:3] == (0x1234, 0x5678) else "no mailbox"
