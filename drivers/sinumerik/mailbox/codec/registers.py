"""The register map, version 3, exactly as docs/plc-mailbox-reference.md lists it, and the packing of its values.

A DINT takes two registers in the PLC's word order, which the order test register shows. Texts are ASCII, two characters
in a register. The CRC is CRC-32 (IEEE 802.3) over registers as they are sent, high byte first.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Sequence
from enum import IntEnum, IntFlag
from typing import Final, Literal

# Addresses, bits and codes.

MAGIC: Final = 0x4743
MAP_VERSION: Final = 3
ORDER_TEST: Final = 0x12345678

# Every address under the name that the structured text uses as well.
ADDRESS: Final = {
    "MAGIC": 0,
    "MAP_VERSION": 1,
    "ORDER_TEST": 2,
    "PLC_HEARTBEAT": 4,
    "STATUS": 5,
    "NUMBER_TAKEN": 6,
    "ERROR": 7,
    "DETAIL_LOW": 8,
    "DETAIL_HIGH": 9,
    "RESERVED_POINTS": 10,
    "POINTS_STORED": 11,
    "CRC_TAKEN": 12,
    "SESSION": 14,
    "PC_HEARTBEAT": 15,
    "COMMAND": 16,
    "NUMBER": 17,
    "KIND": 18,
    "INDEX": 19,
    "ENCODER": 20,
    "FLAGS": 21,
    "MIN": 22,
    "STEP": 24,
    "MAX": 26,
    "TOTAL": 28,
    "FIRST": 29,
    "COUNT": 30,
    "INPUT_AXIS": 31,
    "OUTPUT_AXIS": 32,
    "MULTIPLY_BY": 33,
    "CRC": 34,
    "DATA": 36,
    "READ_BACK": 200,
    "READ_BACK_CRC": 300,
    "POSITION": 302,
    "ACTING": 304,
    "UNIT_SYSTEM": 306,
    "ACCESS_LEVEL": 307,
    "SERIAL": 308,
    "NCK_VERSION": 324,
    "AXIS_NAME": 332,
    "MARKER": 340,
    "MARKER_STATE": 348,
    "AXIS_COUNT": 349,
    "TABLE_COUNT": 350,
    "SELECTED_KIND": 351,
    "SELECTED_INDEX": 352,
    "SELECTED_ENCODER": 353,
    "SELECTED_AXIS": 354,
    "AXIS_FLAGS": 355,
    "LIVE_FLAGS": 356,
    "LIVE_MIN": 357,
    "LIVE_STEP": 359,
    "LIVE_MAX": 361,
    "LIVE_INPUT_AXIS": 363,
    "LIVE_OUTPUT_AXIS": 364,
    "LIVE_MULTIPLY_BY": 365,
    "SWITCHES": 366,
    "WEIGHT": 367,
    "ACTING_EEC": 369,
    "ACTING_CEC": 371,
    "BACKLASH": 373,
    "ALARM": 375,
    "MODE": 377,
    "AXIS_MAP": 378,
    "MARKER_HEAD": 380,
    "RELEASE_LEFT": 384,
    "ENCODER_COUNT": 385,
    "BACKLASH_FACTOR": 386,
}

STATUS_SPAN: Final = (0, 15)
HEADER_SPAN: Final = (16, 18)
DATA_SPAN: Final = (36, 100)
READ_BACK_SPAN: Final = (200, 102)
PICTURE_SPAN: Final = (302, 86)
SERIAL_REGISTERS: Final = 16
NAME_REGISTERS: Final = 8
HEAD_REGISTERS: Final = 4
CHUNK_POINTS: Final = 50
ENTRY_REGISTERS: Final = 5
MOST_ENTRIES: Final = 20
MOST_AXES: Final = 31
MOST_TABLES: Final = 62
MOST_RELEASE_S: Final = 900
LAST_NUMBER: Final = 65535
NOT_EXPRESSIBLE: Final = 1 << 15


class Command(IntEnum):
    """Register 16."""

    OPEN = 1
    BEGIN = 2
    CHUNK = 3
    VERIFY = 4
    ACTIVATE = 5
    DISABLE = 6
    READ_BACK = 7
    ABORT = 8
    CLOSE = 9
    MARKER = 10
    SELECT = 11


class Kind(IntEnum):
    """Register 18."""

    NONE = 0
    EEC = 1
    CEC = 2
    BACKLASH = 3
    TEMPERATURE = 4


KINDS = {"axis": Kind.EEC, "cross": Kind.CEC, "reversal": Kind.BACKLASH}


class StatusBit(IntFlag):
    """Register 5."""

    READY = 1 << 0
    BUSY = 1 << 1
    DONE = 1 << 2
    ERROR = 1 << 3
    IN_RESET = 1 << 4
    STANDSTILL = 1 << 5
    REFERENCED = 1 << 6
    RELEASED = 1 << 7
    ALARM = 1 << 8
    EEC_ENABLED = 1 << 9
    CEC_ENABLED = 1 << 10
    WRITABLE = 1 << 11
    AWAITS_CONFIRM = 1 << 12
    RELEASE_STALE = 1 << 13


class AxisBit(IntFlag):
    """Register 355."""

    ROTARY = 1 << 0
    MODULO = 1 << 1
    REFERENCED = 1 << 2
    IN_POSITION = 1 << 3
    STANDSTILL = 1 << 4
    FIRST_ACTS = 1 << 5
    SECOND_ACTS = 1 << 6


class SwitchBit(IntFlag):
    """Register 366."""

    EEC = 1 << 0
    CEC_AXIS = 1 << 1
    CEC_TABLE = 1 << 2
    BACKLASH = 1 << 3


class TableFlag(IntFlag):
    """Registers 21 and 356, and the flags of an entry: modulo, direction as a number in bits 1-2, cylinder error; axis
    switch alone, table switch alone (entries of commands 5 and 6); whatever moves (register 21 of command 6)."""

    MODULO = 1 << 0
    POSITIVE = 1 << 1
    NEGATIVE = 2 << 1
    CYLINDER = 1 << 3
    AXIS_ONLY = 1 << 4
    TABLE_ONLY = 1 << 5
    ANYHOW = 1 << 6


class RefusalCode(IntEnum):
    """Register 7."""

    NONE = 0
    CRC = 1
    ORDER = 2
    LENGTH = 3
    VALUE = 4
    NOT_RELEASED = 5
    NOT_IN_RESET = 6
    WRITE_PROTECTED = 7
    POINTS = 8
    UNKNOWN = 9
    MISMATCH = 10
    NCK = 11
    TIME = 12
    SESSION_LOST = 13
    TAKEN = 14


# Packing.

WordOrder = Literal["high-first", "low-first"]
LOWEST, HIGHEST = -(2**31), 2**31 - 1


def pack_dint(value: int, order: WordOrder) -> tuple[int, int]:
    """Two registers of a signed 32-bit number. Raises OverflowError for a number that does not fit."""
    if not LOWEST <= value <= HIGHEST:
        raise OverflowError(value)
    high, low = (value >> 16) & 0xFFFF, value & 0xFFFF
    return (high, low) if order == "high-first" else (low, high)


def pack_dints(values: Iterable[int], order: WordOrder) -> tuple[int, ...]:
    """Registers of many signed 32-bit numbers, shape (2n,)."""
    return tuple(register for value in values for register in pack_dint(value, order))


def unpack_dint(registers: Sequence[int], order: WordOrder) -> int:
    """The signed 32-bit number in two registers."""
    value = unpack_udint(registers, order)
    return value - 2**32 if value >= 2**31 else value


def unpack_udint(registers: Sequence[int], order: WordOrder) -> int:
    """The unsigned 32-bit number in two registers."""
    first, second = registers
    return (first << 16 | second) if order == "high-first" else (second << 16 | first)


def unpack_dints(registers: Sequence[int], order: WordOrder) -> tuple[int, ...]:
    """The signed 32-bit numbers in an even count of registers."""
    pairs = zip(registers[::2], registers[1::2], strict=True)
    return tuple(unpack_dint(pair, order) for pair in pairs)


def pack_udint(value: int, order: WordOrder) -> tuple[int, int]:
    """Two registers of an unsigned 32-bit number, as a CRC is."""
    high, low = value >> 16, value & 0xFFFF
    return (high, low) if order == "high-first" else (low, high)


def pack_text(words: str, registers: int) -> tuple[int, ...]:
    """ASCII, two characters in a register, unused places 0. Raises OverflowError when it is too long."""
    raw = words.encode("ascii")
    if len(raw) > 2 * registers:
        raise OverflowError(words)
    return struct.unpack(f">{registers}H", raw.ljust(2 * registers, b"\0"))


def unpack_text(registers: Sequence[int]) -> str | None:
    """The text in registers, blanks at its ends removed; None when it is not printable ASCII."""
    raw = wire_bytes(registers).rstrip(b"\0")
    if not all(32 <= byte < 127 for byte in raw):
        return None
    return raw.decode("ascii").strip()


def wire_bytes(registers: Sequence[int]) -> bytes:
    """Registers as they pass on the wire, high byte first."""
    return struct.pack(f">{len(registers)}H", *registers)


def crc32(*blocks: Sequence[int]) -> int:
    """CRC-32 (IEEE 802.3) over the bytes of register blocks, one after the other."""
    value = 0
    for block in blocks:
        value = zlib.crc32(wire_bytes(block), value)
    return value


def find_word_order(registers: Sequence[int]) -> str:
    """What the magic and the word order test (registers 0, 2, 3) show: a word order, or what is wrong instead.

    "high-first", "low-first", "bytes swapped", "shifted" or "no mailbox".
    """
    magic, test = registers[0], (registers[2], registers[3])
    swapped = {(MAGIC & 0xFF) << 8 | MAGIC >> 8}
    if magic == MAGIC:
        for order in ("high-first", "low-first"):
            if test == pack_udint(ORDER_TEST, order):
                return order
        return "no mailbox"
    if magic in swapped:
        return "bytes swapped"
    return "shifted" if MAGIC in registers[1:3] or registers[1:3] == (0x1234, 0x5678) else "no mailbox"
