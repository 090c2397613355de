"""What the PLC shows <-> records: the status (registers 0-14), the picture (302-387) and a read-back (200-301)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drivers.errors import RemoteProtocolError
from drivers.sinumerik.mailbox.codec.packing import WordOrder, as_bytes, crc32, number, numbers, unsigned, words
from drivers.sinumerik.mailbox.codec.registers import (
    ADDRESS,
    HEAD_REGISTERS,
    MOST_AXES,
    MOST_RELEASE_S,
    MOST_TABLES,
    NAME_REGISTERS,
    NOT_EXPRESSIBLE,
    PICTURE_SPAN,
    SERIAL_REGISTERS,
    AxisBit,
    Kind,
    StatusBit,
    SwitchBit,
)


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


def status_of(registers: Sequence[int], order: WordOrder) -> Status:
    """Registers 0-14 as a record."""
    return Status(
        heartbeat=registers[4],
        bits=StatusBit(registers[5]),
        number=registers[6],
        error=registers[7],
        detail=registers[9] << 16 | registers[8],
        reserved=registers[10],
        stored=registers[11],
        crc=unsigned(registers[12:14], order),
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
        return number(self._registers[at : at + 2], self._order)

    def joined(self, name: str, count: int) -> int:
        at = ADDRESS[name] - PICTURE_SPAN[0]
        return int.from_bytes(as_bytes(self._registers[at : at + count]), "big")

    def text(self, name: str, count: int) -> str:
        at = ADDRESS[name] - PICTURE_SPAN[0]
        found = words(self._registers[at : at + count])
        if found is None:
            raise self.wrong(name, "no printable ASCII")
        return found


def picture_of(registers: Sequence[int], order: WordOrder, where: str = "") -> Picture:
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
        grid=_grid_of(seen),
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


def _grid_of(seen: _Registers) -> MailboxGrid:
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


def read_back_of(
    registers: Sequence[int], header: Sequence[int], count: int, order: WordOrder
) -> tuple[int, ...] | None:
    """The ``count`` values of registers 200-301 that answer the command ``header``; None when the CRC is wrong."""
    block = registers[:100]
    if unsigned(registers[100:102], order) != crc32(header[:18], block):
        return None
    return numbers(block, order)[:count]
