"""The register map, version 3: addresses, bits and codes exactly as docs/plc-mailbox-reference.md lists them."""

from __future__ import annotations

from enum import IntEnum, IntFlag
from typing import Final

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
