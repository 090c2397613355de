"""Commands, status, picture and read-back <-> registers, and what a refusal means.

The PC writes data registers 36-135 first, then the header 16-35 with the command's number last; the CRC covers both.
The PLC answers in registers 0-14 (status), 302-387 (picture) and 200-301 (read-back), each with the number and CRC of
the command that it belongs to: an answer to an older command is never taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from drivers.errors import (
    DeviceRefused,
    PointsDiffer,
    RemoteProtocolError,
    TableActs,
    TooManyPoints,
    TransportError,
    TrueflankError,
    UnsupportedDevice,
    ValueOutOfRange,
)
from drivers.message import Message
from drivers.sinumerik.mailbox.codec.registers import (
    ADDRESS,
    CHUNK_POINTS,
    DATA_SPAN,
    HEAD_REGISTERS,
    LAST_NUMBER,
    MAGIC,
    MAP_VERSION,
    MOST_AXES,
    MOST_RELEASE_S,
    MOST_TABLES,
    NAME_REGISTERS,
    NOT_EXPRESSIBLE,
    PICTURE_SPAN,
    SERIAL_REGISTERS,
    AxisBit,
    Command,
    Kind,
    RefusalCode,
    StatusBit,
    SwitchBit,
    TableFlag,
    WordOrder,
    crc32,
    find_word_order,
    pack_dint,
    pack_dints,
    pack_text,
    pack_udint,
    unpack_dint,
    unpack_dints,
    unpack_text,
    unpack_udint,
    wire_bytes,
)

# Commands of the PC <-> registers 16-35 and 36-135, with the CRC over what each command carries.

_ALONE = int(TableFlag.AXIS_ONLY | TableFlag.TABLE_ONLY)
WITH_DATA = (Command.CHUNK, Command.MARKER, Command.ACTIVATE, Command.DISABLE)


@dataclass(frozen=True, slots=True)
class MailboxOrder:
    """One command as numbers: positions in 0.1 um or 1e-6 deg. What a command does not name stays 0."""

    command: Command
    kind: Kind = Kind.NONE
    index: int = 0
    encoder: int = 0
    flags: int = 0
    minimum: int = 0
    step: int = 0
    maximum: int = 0
    total: int = 0
    first: int = 0
    count: int = 0
    input_axis: int = 0
    output_axis: int = 0
    multiply_by: int = 0

    def as_command(self, command: Command, first: int = 0, count: int = 0) -> MailboxOrder:
        """The same table named by another command."""
        return replace(self, command=command, first=first, count=count)


_NUMBERS = [field.name for field in fields(MailboxOrder)][2:]  # in the order of the registers


@dataclass(frozen=True, slots=True)
class CommandFrame:
    """A command ready for the wire: ``data`` (registers 36-135, empty for none) goes first, then ``header`` (16-35)."""

    header: tuple[int, ...]
    data: tuple[int, ...]
    crc: int


def next_number(taken: int) -> int:
    """The number that follows register 6."""
    return taken % LAST_NUMBER + 1


def encode_command(
    order: MailboxOrder, count: int, word_order: WordOrder, data: Sequence[int] = (), whole: Sequence[int] = ()
) -> CommandFrame:
    """Registers of a command under the number ``count``.

    ``data`` are the data registers of commands 3, 5, 6 and 10, ``whole`` all value registers of a table for command 4.
    Raises OverflowError for a number that does not fit its register.
    """
    body = _body(order, count, word_order)
    block: tuple[int, ...] = ()
    if order.command in WITH_DATA:
        block = tuple(data) + (0,) * (DATA_SPAN[1] - len(data))
    crc = crc32(body, block, whole)
    return CommandFrame((*body, *pack_udint(crc, word_order)), block, crc)


def _body(order: MailboxOrder, count: int, word_order: WordOrder) -> tuple[int, ...]:
    body = (
        int(order.command),
        count,
        int(order.kind),
        order.index,
        order.encoder,
        order.flags,
        *pack_dint(order.minimum, word_order),
        *pack_dint(order.step, word_order),
        *pack_dint(order.maximum, word_order),
        order.total,
        order.first,
        order.count,
        order.input_axis,
        order.output_axis,
        order.multiply_by,
    )
    if not all(0 <= register <= 0xFFFF for register in body):
        raise OverflowError(order)
    return body


@dataclass(frozen=True, slots=True)
class ReceivedCommand:
    """A command as the PLC's side reads it; ``sound`` tells whether its CRC is right."""

    order: MailboxOrder
    count: int
    sound: bool


def decode_command(
    header: Sequence[int], word_order: WordOrder, data: Sequence[int] = (), whole: Sequence[int] = ()
) -> ReceivedCommand:
    """Registers 16-35 back into a command. Raises ValueError for a command or kind that does not exist."""
    body = tuple(header[:18])
    grid = (unpack_dint(body[at : at + 2], word_order) for at in (6, 8, 10))
    values = dict(zip(_NUMBERS, (*body[3:6], *grid, *body[12:18]), strict=True))
    order = MailboxOrder(Command(body[0]), Kind(body[2]), **values)
    block = tuple(data) if order.command in WITH_DATA else ()
    sound = unpack_udint(header[18:20], word_order) == crc32(body, block, whole)
    return ReceivedCommand(order, body[1], sound)


def value_chunks(values: Sequence[int], word_order: WordOrder) -> list[tuple[int, int, tuple[int, ...]]]:
    """(first point, number of points, data registers) of each chunk; a value is never split over two of them."""
    return [
        (first, len(part), pack_dints(part, word_order))
        for first in range(0, len(values), CHUNK_POINTS)
        for part in [values[first : first + CHUNK_POINTS]]
    ]


def marker_data(transaction: str, state: int, head: int = 0) -> tuple[int, ...]:
    """Data registers of command 10: the number in digits, the state, and 64 bits of the audit log's head."""
    parts = (head >> shift & 0xFFFF for shift in range(16 * (HEAD_REGISTERS - 1), -1, -16))
    return (*pack_text(transaction, NAME_REGISTERS), state, *parts)


def switching_command(
    command: Command, tables: Sequence[MailboxOrder], flags: int = 0
) -> tuple[MailboxOrder, tuple[int, ...]]:
    """Commands 5 and 6 for several tables, and their data registers: an entry for each, in this order.

    Of a table's flags its entry takes those of the switches; ``flags`` are the command's own (register 21).
    """
    data: list[int] = []
    for one in tables:
        data += (int(one.kind), one.index, one.encoder, looked_up_axis(one), one.flags & _ALONE)
    return MailboxOrder(command, flags=flags, count=len(tables)), tuple(data)


def looked_up_axis(order: MailboxOrder) -> int:
    """The axis that a table is looked at by: the output axis of a cross table, else the index."""
    return order.output_axis if order.kind is Kind.CEC else order.index


# What the PLC shows <-> records: the status (registers 0-14), the picture (302-387) and a read-back (200-301).


@dataclass(frozen=True, slots=True)
class Status:
    """Registers 0-14. ``detail`` belongs to ``error``; ``crc`` and ``number`` to the last command taken."""

    heartbeat: int
    bits: StatusBit
    number: int
    error: int
    detail: int
    reserved: int
    stored: int
    crc: int
    session: int

    def has(self, *bits: StatusBit) -> bool:
        """Whether all these bits are set."""
        return all(bit in self.bits for bit in bits)


def decode_status(registers: Sequence[int], order: WordOrder) -> Status:
    """Registers 0-14 as a record."""
    return Status(
        heartbeat=registers[4],
        bits=StatusBit(registers[5]),
        number=registers[6],
        error=registers[7],
        detail=registers[9] << 16 | registers[8],
        reserved=registers[10],
        stored=registers[11],
        crc=unpack_udint(registers[12:14], order),
        session=registers[14],
    )


@dataclass(frozen=True, slots=True)
class Selection:
    """Which table and axis the picture speaks of: registers 351-354."""

    kind: Kind
    index: int
    encoder: int
    axis: int


@dataclass(frozen=True, slots=True)
class MailboxGrid:
    """Parameters of the selected table as it stands in the control; ``expressible`` is false when MIN, STEP or MAX
    have no whole number of 0.1 um or 1e-6 deg."""

    flags: int
    minimum: int
    step: int
    maximum: int
    input_axis: int
    output_axis: int
    multiply_by: int
    expressible: bool


@dataclass(frozen=True, slots=True)
class Picture:
    """Registers 302-387. Positions in 0.1 um or 1e-6 deg; compensation and backlash in nm or 1e-7 deg."""

    position: int
    acting: int
    metric: bool
    access_level: int
    serial: str
    nck_version: str
    axis_name: str
    marker: str
    marker_state: int
    axes: int
    tables: int
    selection: Selection
    axis: AxisBit
    grid: MailboxGrid
    switches: SwitchBit
    weight: int
    acting_eec: int
    acting_cec: int
    backlash: int
    alarm: int
    mode: int
    axis_map: int
    head: int
    release_left_s: int
    encoders: int
    backlash_factor: int

    @property
    def numbers(self) -> tuple[int, ...]:
        """The numbers of the machine axes that there are; a machine may leave some out."""
        return tuple(number for number in range(1, self.axes + 1) if self.axis_map >> (number - 1) & 1)

    @property
    def rotary(self) -> bool:
        """Whether the selected axis is in degrees."""
        return AxisBit.ROTARY in self.axis


class _Registers:
    """Registers 302-387 by name."""

    def __init__(self, registers: Sequence[int], order: WordOrder, where: str) -> None:
        self._registers = registers
        self._order = order
        self._where = where

    def wrong(self, name: str, value: object) -> RemoteProtocolError:
        return RemoteProtocolError("E-MBX-REGISTER", self._where, register=ADDRESS[name], value=value)

    def one(self, name: str, most: int = 0xFFFF) -> int:
        value = self._registers[ADDRESS[name] - PICTURE_SPAN[0]]
        if value > most:
            raise self.wrong(name, value)
        return value

    def two(self, name: str) -> int:
        at = ADDRESS[name] - PICTURE_SPAN[0]
        return unpack_dint(self._registers[at : at + 2], self._order)

    def joined(self, name: str, count: int) -> int:
        at = ADDRESS[name] - PICTURE_SPAN[0]
        return int.from_bytes(wire_bytes(self._registers[at : at + count]), "big")

    def text(self, name: str, count: int) -> str:
        at = ADDRESS[name] - PICTURE_SPAN[0]
        found = unpack_text(self._registers[at : at + count])
        if found is None:
            raise self.wrong(name, "no printable ASCII")
        return found


def decode_picture(registers: Sequence[int], order: WordOrder, where: str = "") -> Picture:
    """Registers 302-387 as a record. Raises RemoteProtocolError (E-MBX-REGISTER) for what the map does not allow."""
    seen = _Registers(registers, order, where)
    selection = Selection(
        Kind(seen.one("SELECTED_KIND", max(Kind))),
        seen.one("SELECTED_INDEX"),
        seen.one("SELECTED_ENCODER", 1),
        seen.one("SELECTED_AXIS", MOST_AXES),
    )
    return Picture(
        position=seen.two("POSITION"),
        acting=seen.two("ACTING"),
        metric=bool(seen.one("UNIT_SYSTEM", 1)),
        access_level=seen.one("ACCESS_LEVEL", 7),
        serial=seen.text("SERIAL", SERIAL_REGISTERS),
        nck_version=seen.text("NCK_VERSION", NAME_REGISTERS),
        axis_name=seen.text("AXIS_NAME", NAME_REGISTERS),
        marker=seen.text("MARKER", NAME_REGISTERS),
        marker_state=seen.one("MARKER_STATE", 3),
        axes=seen.one("AXIS_COUNT", MOST_AXES),
        tables=seen.one("TABLE_COUNT", MOST_TABLES),
        selection=selection,
        axis=AxisBit(seen.one("AXIS_FLAGS", 127)),
        grid=_decode_grid(seen),
        switches=SwitchBit(seen.one("SWITCHES", 15)),
        weight=seen.two("WEIGHT"),
        acting_eec=seen.two("ACTING_EEC"),
        acting_cec=seen.two("ACTING_CEC"),
        backlash=seen.two("BACKLASH"),
        alarm=seen.two("ALARM"),
        mode=seen.one("MODE", 255),
        axis_map=seen.two("AXIS_MAP") & 0xFFFFFFFF,
        head=seen.joined("MARKER_HEAD", HEAD_REGISTERS),
        release_left_s=seen.one("RELEASE_LEFT", MOST_RELEASE_S),
        encoders=seen.one("ENCODER_COUNT", 2),
        backlash_factor=seen.two("BACKLASH_FACTOR"),
    )


def _decode_grid(seen: _Registers) -> MailboxGrid:
    flags = seen.one("LIVE_FLAGS")
    if flags & ~NOT_EXPRESSIBLE > 15 or flags & 6 == 6:
        raise seen.wrong("LIVE_FLAGS", flags)
    return MailboxGrid(
        flags=flags & ~NOT_EXPRESSIBLE,
        minimum=seen.two("LIVE_MIN"),
        step=seen.two("LIVE_STEP"),
        maximum=seen.two("LIVE_MAX"),
        input_axis=seen.one("LIVE_INPUT_AXIS", MOST_AXES),
        output_axis=seen.one("LIVE_OUTPUT_AXIS", MOST_AXES),
        multiply_by=seen.one("LIVE_MULTIPLY_BY", MOST_TABLES),
        expressible=not flags & NOT_EXPRESSIBLE,
    )


def decode_read_back(
    registers: Sequence[int], header: Sequence[int], count: int, order: WordOrder
) -> tuple[int, ...] | None:
    """The ``count`` values of registers 200-301 that answer the command ``header``; None when the CRC is wrong."""
    block = registers[:100]
    if unpack_udint(registers[100:102], order) != crc32(header[:18], block):
        return None
    return unpack_dints(block, order)[:count]


# What a refusal means: exceptions of Modbus, a wrong map, and the mailbox's error codes 1-14.

BUSY = (5, 6)
_MAP = {1: "E-MODBUS-NO-FUNCTION", 2: "E-MODBUS-NO-ADDRESS", 3: "E-MODBUS-NO-VALUE"}
_CODES: Mapping[int, tuple[type[TrueflankError], str]] = {
    RefusalCode.CRC: (RemoteProtocolError, "E-MBX-CRC"),
    RefusalCode.ORDER: (DeviceRefused, "E-MBX-ORDER"),
    RefusalCode.LENGTH: (DeviceRefused, "E-MBX-LENGTH"),
    RefusalCode.VALUE: (ValueOutOfRange, "E-MBX-VALUE"),
    RefusalCode.NOT_RELEASED: (DeviceRefused, "E-MBX-NOT-RELEASED"),
    RefusalCode.NOT_IN_RESET: (DeviceRefused, "E-MBX-NOT-IN-RESET"),
    RefusalCode.WRITE_PROTECTED: (TableActs, "E-MBX-PROTECTED"),
    RefusalCode.POINTS: (TooManyPoints, "E-MBX-POINTS"),
    RefusalCode.UNKNOWN: (UnsupportedDevice, "E-MBX-UNKNOWN"),
    RefusalCode.MISMATCH: (PointsDiffer, "E-MBX-MISMATCH"),
    RefusalCode.NCK: (DeviceRefused, "E-MBX-NCK"),
    RefusalCode.TIME: (DeviceRefused, "E-MBX-TIME"),
    RefusalCode.SESSION_LOST: (DeviceRefused, "E-MBX-SESSION-LOST"),
    RefusalCode.TAKEN: (DeviceRefused, "E-MBX-TAKEN"),
}


def exception_refusal(exception: int, function: int, first: int, last: int, where: str) -> TrueflankError:
    """The error of an exception reply (Modbus Application Protocol V1.1b3, p. 47): 1-3 the map, 4 and 8 the device,
    5 and 6 busy, 10 and 11 a gateway between, which counts as a lost wire; any other is against the rules."""
    fields: dict[str, Any] = {"first": first, "last": last, "function": function}
    if exception in _MAP:
        return UnsupportedDevice(_MAP[exception], where, **fields)
    if exception in (4, 8):
        return DeviceRefused("E-MODBUS-FAILED", where, exception=exception, **fields)
    if exception in BUSY:
        return DeviceRefused("E-MODBUS-BUSY", where, **fields)
    if exception in (10, 11):
        return TransportError("E-MODBUS-GATEWAY", where, exception=exception, **fields)
    return RemoteProtocolError("E-MODBUS-EXCEPTION", where, exception=exception, **fields)


def command_refusal(status: Status, order: MailboxOrder, where: str) -> TrueflankError:
    """The error of a command that the PLC answered with its error bit."""
    fields: dict[str, Any] = {"command": order.command.name, "detail": status.detail}
    kind, code = _CODES.get(status.error, (RemoteProtocolError, "E-MBX-ERROR-CODE"))
    if code == "E-MBX-ERROR-CODE":
        fields["error"] = status.error
    return kind(code, where, **fields)


_NO_ORDER = {"bytes swapped": "W-MBX-SWAPPED", "shifted": "W-MBX-SHIFTED", "no mailbox": "W-MBX-NONE"}


def check_map(registers: Sequence[int], order: WordOrder, where: str) -> None:
    """Magic, version and word order, before anything else is believed.

    Raises UnsupportedDevice: E-MBX-WORD-ORDER says which setting would be right; E-MBX-MAGIC (no mailbox, bytes
    swapped, addresses shifted), E-MBX-OLD-MAP, E-MBX-VERSION. Nothing is adapted silently.
    """
    found = find_word_order(registers)
    if found in _NO_ORDER:
        why = Message.of(_NO_ORDER[found])
        raise UnsupportedDevice("E-MBX-MAGIC", where, found=f"{registers[0]:04X}", wanted=f"{MAGIC:04X}", why=why)
    if registers[1] != MAP_VERSION:
        code = "E-MBX-OLD-MAP" if registers[1] < MAP_VERSION else "E-MBX-VERSION"
        raise UnsupportedDevice(code, where, found=registers[1], wanted=MAP_VERSION)
    if found != order:
        raise UnsupportedDevice("E-MBX-WORD-ORDER", where, found=found, setting=order)
