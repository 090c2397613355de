"""Reads the machine through the mailbox: fingerprint, axes, state, limits, marker, and the tables of an axis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from itertools import pairwise
from typing import Literal

from drivers.errors import DeviceRefused, RemoteProtocolError, UnsupportedDevice
from drivers.limits import largest_value
from drivers.message import Message
from drivers.sinumerik.mailbox.codec.frames import MailboxOrder, Picture, Status
from drivers.sinumerik.mailbox.codec.grids import (
    POSITION_UNIT,
    VALUE_UNIT,
    WEIGHT_UNIT,
    MailboxAxis,
    StoredTable,
    mailbox_backup_text,
    reserved_points_of,
)
from drivers.sinumerik.mailbox.codec.registers import (
    ADDRESS,
    CHUNK_POINTS,
    AxisBit,
    Command,
    Kind,
    StatusBit,
    SwitchBit,
)
from drivers.sinumerik.mailbox.conversation import PlcConversation
from drivers.sinumerik.ncprogram.backup import BackupFile, Section, read_backup
from drivers.types.abilities import Marker, TableLimits
from drivers.types.identity import MachineIdentity
from drivers.types.machine import AxisState, ChannelStatus, MachineState
from drivers.types.tables import LiveSet
from drivers.types.values import Sense
from drivers.units import AxisUnit, deviation_scale

MODES = {0: "JOG", 1: "MDA", 2: "AUTO"}
MarkerState = Literal["none", "in-progress", "committed", "held"]
MARKER_STATES: tuple[MarkerState, ...] = ("none", "in-progress", "committed", "held")


@dataclass(frozen=True, slots=True)
class AxisReading:
    """The tables that act on one axis as numbers, EEC first; ``axes`` of the machine in the order of their numbers."""

    axis: MailboxAxis
    encoder: int
    axes: tuple[MailboxAxis, ...]
    stored: tuple[StoredTable, ...]
    where: str

    def live(self, section: Section, number: int, cec_sign: Sense = 1) -> LiveSet:
        """The same as a record, by way of the text that a program of ours would have written under ``number``."""
        saving = BackupFile(
            section=section,
            number=number,
            axis=self.axis.name,
            encoder=self.encoder,
            memory=reserved_points_of(self.stored),
            factor=self.axis.factor_known,
        )
        text = mailbox_backup_text(self.stored, {one.number: one for one in self.axes}, saving)
        units: Mapping[str, AxisUnit] = {one.name: one.unit for one in self.axes}
        return read_backup(text, self.where, saving=saving, units=units, cec_sign=cec_sign)


class MailboxReader:
    """Everything the driver wants to know of one control. Reading selects tables; it changes nothing else."""

    def __init__(self, talk: PlcConversation, where: str) -> None:
        self._talk = talk
        self._where = where
        self._states: dict[str, AxisState] = {}
        self.axes: dict[str, MailboxAxis] = {}

    def axis(self, name: str) -> MailboxAxis:
        """An axis by its name. Raises DeviceRefused (E-NC-AXIS)."""
        if name not in self.axes:
            raise DeviceRefused("E-NC-AXIS", self._where, axis=name, known=", ".join(self.axes))
        return self.axes[name]

    async def identity(self) -> MachineIdentity:
        """Select each axis for its name, read the fingerprint. Raises UnsupportedDevice (E-MBX-SILENT)."""
        first = await self._talk.picture()
        if not first.serial or not first.numbers:
            what = "serial number" if first.numbers else Message.of("W-MBX-AXIS-MAP")
            raise UnsupportedDevice("E-MBX-SILENT", self._where, what=what)
        found = [await self._talk.select(_axis_order(number)) for number in first.numbers]
        facts = [_facts(number, picture) for number, picture in zip(first.numbers, found, strict=True)]
        names = tuple(axis.name for axis in facts)
        if len(set(names)) < len(names) or "" in names:
            raise UnsupportedDevice("E-MBX-SILENT", self._where, what=f"axis names ({', '.join(names)})")
        self.axes = {axis.name: axis for axis in facts}
        self._states = {axis.name: _axis_state(axis, picture) for axis, picture in zip(facts, found, strict=True)}
        return machine_of(first, names)

    async def state(self) -> MachineState:
        """Status and every axis. While a command waits for the panel, or the NCK restarts, only the selected one."""
        status = await self._talk.status()
        for name, axis in self.axes.items():
            if status.has(StatusBit.BUSY) or self._talk.waiting or not status.has(StatusBit.READY):
                break
            picture = await self._talk.select(_axis_order(axis.number))
            self._states[name] = _axis_state(axis, picture)
        picture = await self._talk.picture()
        by_number = {axis.number: axis for axis in self.axes.values()}
        selected = by_number.get(picture.selection.axis)
        if selected is not None:
            self._states[selected.name] = _axis_state(selected, picture)
        return _machine_state(await self._talk.status(), picture, dict(self._states))

    async def limits(self, axis: str, kind: Kind, index: int) -> TableLimits:
        """Reserved points of an encoder or table, the step of a value, and the value limit of this product.

        A cross table that the control does not have holds none.
        """
        facts = self.axis(axis)
        if kind is Kind.CEC and index >= (await self._talk.picture()).tables:
            return TableLimits(0, float(VALUE_UNIT[facts.unit]), largest_value(facts.unit))
        await self._talk.select(table_order(facts, kind, index))
        return TableLimits(self._talk.reserved, float(VALUE_UNIT[facts.unit]), largest_value(facts.unit))

    async def marker(self) -> Marker:
        """What the PLC keeps of the last push. Raises RemoteProtocolError (E-MBX-REGISTER)."""
        return marker_of(await self._talk.picture(), self._where)

    async def tables(self, axis: str, encoder: int) -> AxisReading:
        """EEC of the axis and every loaded CEC table with this output axis: all reserved points, fresh.

        Raises DeviceRefused (E-MBX-UNSTEADY, E-MBX-CHANGED; E-MBX-GRID for a table whose grid the map cannot express).
        """
        facts = self.axis(axis)
        own = await self._stored(table_order(facts, Kind.EEC, encoder))
        found = [own]
        for table in range(own.picture.tables):
            order = table_order(facts, Kind.CEC, table)
            grid = (await self._talk.select(order)).grid
            if grid.output_axis == facts.number and (grid.step or not grid.expressible):
                if grid.input_axis not in (axis.number for axis in self.axes.values()):
                    register = ADDRESS["LIVE_INPUT_AXIS"]
                    raise RemoteProtocolError("E-MBX-REGISTER", self._where, register=register, value=grid.input_axis)
                found.append(await self._stored(order))
        return AxisReading(
            axis=facts, encoder=encoder, axes=tuple(self.axes.values()), stored=tuple(found), where=self._where
        )

    async def _stored(self, order: MailboxOrder) -> StoredTable:
        """Every point is read twice, the second time in chunks that begin elsewhere, and the picture before and after.

        A chunk left out, given twice or kept from earlier is then another number in one of the two readings.
        """
        before = await self._talk.select(order)
        if not before.grid.expressible:
            raise DeviceRefused("E-MBX-GRID", self._where, kind=order.kind.name, index=order.index)
        first, second = await self._points(order, cut=False), await self._points(order, cut=True)
        if first != second:
            raise DeviceRefused("E-MBX-UNSTEADY", self._where, kind=order.kind.name, index=order.index)
        status, picture = await self._talk.recent(), await self._talk.picture_for(order)
        if _lasting(picture) != _lasting(before) or not _agree(order, status, picture):
            raise DeviceRefused("E-MBX-CHANGED", self._where, kind=order.kind.name, index=order.index)
        return StoredTable("axis" if order.kind is Kind.EEC else "cross", picture, second)

    async def _points(self, order: MailboxOrder, *, cut: bool) -> tuple[int, ...]:
        points: tuple[int, ...] = ()
        for first, count in chunk_spans(self._talk.reserved, cut=cut):
            points += await self._talk.points(order, first, count)
        return points


def chunk_spans(reserved: int, *, cut: bool) -> tuple[tuple[int, int], ...]:
    """First point and number of points of each chunk of a table; ``cut``: the first of several is half as long."""
    first = CHUNK_POINTS // 2 if cut and reserved > CHUNK_POINTS else CHUNK_POINTS
    ends = [*range(first, reserved, CHUNK_POINTS), reserved] if reserved else []
    return tuple((begin, end - begin) for begin, end in pairwise([0, *ends]))


def _lasting(picture: Picture) -> tuple[object, ...]:
    """What of a picture does not move with the machine."""
    return picture.grid, picture.switches, picture.weight, picture.backlash


def _agree(order: MailboxOrder, status: Status, picture: Picture) -> bool:
    """The status word comes with the number and the check sum of the last command; the picture's switches do not."""
    if order.kind is Kind.EEC:
        return (SwitchBit.EEC in picture.switches) == status.has(StatusBit.EEC_ENABLED)
    both = SwitchBit.CEC_AXIS | SwitchBit.CEC_TABLE
    return (both in picture.switches) == status.has(StatusBit.CEC_ENABLED)


def machine_of(picture: Picture, names: tuple[str, ...]) -> MachineIdentity:
    """The fingerprint from a picture and the axis names."""
    return MachineIdentity(picture.serial, picture.nck_version, names, "metric" if picture.metric else "inch")


def marker_of(picture: Picture, where: str) -> Marker:
    """The marker from a picture. Raises RemoteProtocolError (E-MBX-REGISTER) when its number has no digits only."""
    if picture.marker and not picture.marker.isdecimal():
        raise RemoteProtocolError("E-MBX-REGISTER", where, register="340-347", value=picture.marker)
    return Marker(int(picture.marker or 0), MARKER_STATES[picture.marker_state], picture.head)


def position_of(picture: Picture) -> float:
    """Actual position of the selected axis, mm or deg."""
    return float(picture.position * POSITION_UNIT["deg" if picture.rotary else "mm"])


def deviation_of(value: int, unit: AxisUnit) -> float:
    """A compensation value of the map in um or arcsec."""
    return float(value * VALUE_UNIT[unit] * Decimal(deviation_scale(unit)))


def table_order(axis: MailboxAxis, kind: Kind, index: int) -> MailboxOrder:
    """Select: ``index`` is the encoder of an EEC table or backlash, or the number of a CEC table."""
    if kind is not Kind.CEC:
        return MailboxOrder(Command.SELECT, kind, axis.number, index)
    return MailboxOrder(Command.SELECT, kind, index, output_axis=axis.number)


def _axis_order(number: int) -> MailboxOrder:
    return MailboxOrder(Command.SELECT, Kind.EEC, number)


def _facts(number: int, picture: Picture) -> MailboxAxis:
    unit: AxisUnit = "deg" if picture.rotary else "mm"
    factor = picture.backlash_factor * WEIGHT_UNIT
    modulo = AxisBit.MODULO in picture.axis
    return MailboxAxis(number, picture.axis_name, unit, modulo=modulo, factor=factor)


def _axis_state(axis: MailboxAxis, picture: Picture) -> AxisState:
    return AxisState(
        name=axis.name,
        position=position_of(picture),
        referenced=AxisBit.REFERENCED in picture.axis,
        in_position=AxisBit.IN_POSITION in picture.axis and AxisBit.STANDSTILL in picture.axis,
        encoder_compensation=deviation_of(picture.acting_eec, axis.unit),
        cross_compensation=deviation_of(picture.acting_cec, axis.unit),
        unit=axis.unit,
    )


def _machine_state(status: Status, picture: Picture, axes: Mapping[str, AxisState]) -> MachineState:
    in_reset = status.has(StatusBit.IN_RESET, StatusBit.READY)
    return MachineState(
        channel=ChannelStatus.RESET if in_reset else ChannelStatus.ACTIVE,
        mode=MODES.get(picture.mode, "unknown"),
        message="",
        alarms=(picture.alarm,) if status.has(StatusBit.ALARM) else (),
        access_level=picture.access_level,
        axes=axes,
    )
