"""The mailbox's register map, its number formats, and the codes with which a command ends (docs/plc-mailbox.md)."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

SIZE = 388
MAGIC, VERSION, ORDER_TEST, HEARTBEAT, STATUS, TAKEN, ERROR, DETAIL = 0, 1, 2, 4, 5, 6, 7, 8
RESERVED, STORED, COMMAND_CRC, SESSION, PC_HEARTBEAT = 10, 11, 12, 14, 15
COMMAND, NUMBER, KIND, INDEX, ENCODER, FLAGS, MINIMUM, STEP, MAXIMUM = 16, 17, 18, 19, 20, 21, 22, 24, 26
TOTAL, FIRST, COUNT, INPUT, OUTPUT, FACTOR, CRC, DATA = 28, 29, 30, 31, 32, 33, 34, 36
DATA_END, READ_BACK, READ_BACK_CRC = 136, 200, 300
LIVE, POSITION, ACTING, UNITS, LEVEL, SERIAL, NCK_VERSION, AXIS_NAME = 302, 302, 304, 306, 307, 308, 324, 332
MARKER, MARKER_STATE, AXES, TABLES, SELECTED, AXIS_BITS = 340, 348, 349, 350, 351, 355
TABLE_FLAGS, SWITCHES, WEIGHT, EEC_ACTING, CEC_ACTING, BACKLASH, ALARM, MODE = 356, 366, 367, 369, 371, 373, 375, 377
AXIS_MAP, MARKER_HEAD, RELEASE_LEFT, ENCODERS, BACKLASH_FACTOR = 378, 380, 384, 385, 386
WRITABLE = range(PC_HEARTBEAT, DATA_END)

MAGIC_WORD, ORDER_WORD = 0x4743, 0x12345678
MOST_POINTS = 50
ENTRY, MOST_ENTRIES = 5, 20
DINT_LOW, DINT_HIGH = -(1 << 31), (1 << 31) - 1


def dint_words(value: int, low_first: bool) -> tuple[int, int]:
    """A DINT (or an unsigned 32-bit number) as two registers."""
    high, low = value >> 16 & 0xFFFF, value & 0xFFFF
    return (low, high) if low_first else (high, low)


def dint_of(first: int, second: int, low_first: bool) -> int:
    """Two registers as a signed DINT."""
    high, low = (second, first) if low_first else (first, second)
    value = high << 16 | low
    return value - (1 << 32) if value > DINT_HIGH else value


def text_words(text: str, count: int) -> list[int]:
    """Text of two characters a register, filled up with 0."""
    raw = text.encode("ascii", "replace")[: 2 * count].ljust(2 * count, b"\0")
    return list(struct.unpack(f">{count}H", raw))


def crc_of(words: Sequence[int]) -> int:
    """CRC-32 (IEEE) over registers, high byte first."""
    return zlib.crc32(struct.pack(f">{len(words)}H", *words))


class ProcessImage:
    """The process image: 388 words; everything the PLC program reads or sets goes through here."""

    def __init__(self, low_first: bool) -> None:
        self.low_first = low_first
        self.words = [0] * SIZE

    def put(self, address: int, words: Sequence[int]) -> None:
        """Set words from an address on."""
        self.words[address : address + len(words)] = words

    def put_dint(self, address: int, value: int) -> None:
        """Set a DINT."""
        self.put(address, dint_words(value, self.low_first))

    def dint(self, address: int) -> int:
        """Read a signed DINT."""
        return dint_of(self.words[address], self.words[address + 1], self.low_first)

    def dints(self, address: int, count: int) -> list[int]:
        """Read several signed DINTs."""
        return [self.dint(place) for place in range(address, address + 2 * count, 2)]


@dataclass(frozen=True, slots=True)
class PlcCommand:
    """Registers 16..35 as they stood when the command's number changed, and the data words behind them."""

    head: tuple[int, ...]
    data: tuple[int, ...]
    crc: int
    minimum: int
    step: int
    maximum: int

    @classmethod
    def of(cls, image: ProcessImage) -> PlcCommand:
        """Take a command out of the image."""
        head, data = tuple(image.words[COMMAND:CRC]), tuple(image.words[DATA:DATA_END])
        crc = image.dint(CRC) & 0xFFFFFFFF
        return cls(head, data, crc, image.dint(MINIMUM), image.dint(STEP), image.dint(MAXIMUM))

    def __getitem__(self, register: int) -> int:
        """A register of the head by its address."""
        return self.head[register - COMMAND]

    def difference(self, other: PlcCommand) -> int | None:
        """Address of the first register of 18-28 and 31-33 that differs, or None."""
        same = (*range(KIND, TOTAL + 1), *range(INPUT, FACTOR + 1))
        return next((address for address in same if self[address] != other[address]), None)


# Kinds of tables, error codes, and one table with its parameters.

EEC, CEC, BACKLASH_KIND, TEMPERATURE = 1, 2, 3, 4
NO_CRC, OUT_OF_ORDER, LENGTH, RANGE, NOT_RELEASED, NOT_IN_RESET, PROTECTED, TOO_MANY, UNKNOWN = range(1, 10)
DIFFERS, NCK_REFUSED, TIME_OVER, NO_SESSION, SESSION_TAKEN = range(10, 15)

INEXPRESSIBLE = 1 << 15


class PlcFault(Exception):
    """A command ends with this error code and detail."""

    def __init__(self, code: int, detail: int = 0) -> None:
        super().__init__(code, detail)
        self.code = code
        self.detail = detail


@dataclass(frozen=True, slots=True)
class TableAddress:
    """One table or set of data: kind, axis number or table t, encoder, and the axis it is looked at by."""

    kind: int
    index: int
    encoder: int
    axis: int

    @property
    def table(self) -> tuple[int, int, int]:
        """What identifies the table itself."""
        return (self.kind, self.index, self.encoder if self.kind != CEC else 0)


@dataclass(frozen=True, slots=True)
class TableParameters:
    """A table's parameters in mailbox units; ``flags`` as register 356, axes by number (0: none yet)."""

    flags: int
    minimum: int
    step: int
    maximum: int
    input_axis: int
    output_axis: int
    factor: int
