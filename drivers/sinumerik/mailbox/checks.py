"""What must hold before and after each step of a push through the mailbox; pure, every refusal with its words."""

from __future__ import annotations

from typing import Any

import numpy as np

from drivers.errors import DeviceRefused
from drivers.limits import Limits
from drivers.sinumerik.mailbox.codec.commands import Order
from drivers.sinumerik.mailbox.codec.grids import Stored
from drivers.sinumerik.mailbox.codec.readings import Picture, Status
from drivers.sinumerik.mailbox.codec.registers import Kind, StatusBit, SwitchBit
from drivers.sinumerik.mailbox.reader import AxisReading
from drivers.types.orders import PushBatch, PushOrder
from drivers.types.tables import CompensationTable, LiveSet, LiveTable

JUMP = Limits.of("mm").jump + 1e-6  # um or arcsec: what an axis may jump when a table is switched
_REST = (StatusBit.READY, StatusBit.IN_RESET, StatusBit.STANDSTILL)
_GRID = ("flags", "minimum", "step", "maximum", "multiply_by")


def guard(status: Status, where: str, alarm: int = 0) -> None:
    """What must hold before every write of a push.

    Raises DeviceRefused (E-MBX-NOT-RELEASED, E-MBX-NOT-IN-RESET, E-MBX-ALARM).
    """
    if not status.has(StatusBit.RELEASED):
        raise DeviceRefused("E-MBX-NOT-RELEASED", where, command="push", detail=0)
    at_rest(status, where, alarm)


def at_rest(status: Status, where: str, alarm: int = 0) -> None:
    """Ready, in reset, standing, no alarm. Raises DeviceRefused (E-MBX-NOT-IN-RESET, E-MBX-ALARM)."""
    if not status.has(*_REST):
        raise DeviceRefused("E-MBX-NOT-IN-RESET", where, command="push", detail=0)
    if status.has(StatusBit.ALARM):
        raise DeviceRefused("E-MBX-ALARM", where, number=alarm or "in the panel's list")


def switchable(status: Status, where: str, *, released: bool, anyhow: bool = False) -> None:
    """What command 6 needs; an alarm does not keep a table on, and ``anyhow`` no program and no motion either.

    Raises DeviceRefused as `guard`.
    """
    if not released:
        raise DeviceRefused("E-MBX-NOT-RELEASED", where, command="DISABLE", detail=0)
    if not status.has(StatusBit.READY) or not (anyhow or status.has(*_REST)):
        raise DeviceRefused("E-MBX-NOT-IN-RESET", where, command="DISABLE", detail=0)


def is_on(order: Order, status: Status, picture: Picture) -> bool:
    """Whether the table that ``order`` names is at work, by its switches; the status word must agree.

    A backlash has no switch: it is on where it is not 0.
    """
    if order.kind is Kind.BACKLASH:
        return SwitchBit.BACKLASH in picture.switches and picture.backlash != 0
    if order.kind is Kind.EEC:
        return SwitchBit.EEC in picture.switches and status.has(StatusBit.EEC_ENABLED)
    both = SwitchBit.CEC_AXIS | SwitchBit.CEC_TABLE
    return both in picture.switches and status.has(StatusBit.CEC_ENABLED)


def is_off(order: Order, status: Status, picture: Picture) -> bool:
    """Whether it may be written: each of its switches reads off, in the picture and in the status word."""
    if order.kind is Kind.BACKLASH:
        return SwitchBit.BACKLASH not in picture.switches and picture.backlash == 0
    if order.kind is Kind.EEC:
        return SwitchBit.EEC not in picture.switches and not status.has(StatusBit.EEC_ENABLED)
    either = SwitchBit.CEC_AXIS | SwitchBit.CEC_TABLE
    return not picture.switches & either and not status.has(StatusBit.CEC_ENABLED)


def coupled(order: PushOrder, backup: AxisReading, batch: PushBatch, where: str) -> None:
    """A CEC axis switch serves all tables of its axis: no other one may wake up, or join a sign proof, unseen.

    ``order.coupled`` says that others were at work and shall be again. Raises DeviceRefused (E-MBX-COUPLED).
    """
    if order.table.kind != "cross":
        return
    ours = {one.table.index for one in batch if one.table.kind == "cross"}
    others = [
        table.picture.selection.index
        for table in backup.stored[1:]
        if SwitchBit.CEC_TABLE in table.picture.switches and table.picture.selection.index not in ours
    ]
    asleep = not (order.coupled and axis_switch(backup))
    if others and (asleep or order.purpose == "sign-proof"):
        told = ", ".join(map(str, others))
        raise DeviceRefused("E-MBX-COUPLED", where, axis=order.table.output_axis, tables=told)


def axis_switch(backup: AxisReading) -> bool:
    """Whether `$MA_CEC_ENABLE` of the axis was on."""
    return SwitchBit.CEC_AXIS in backup.stored[0].picture.switches


def place(order: PushOrder, backup: LiveSet, position: float, where: str) -> None:
    """The axis must stand where neither the old nor the new table moves it; nothing on this road can bring it there.

    ``position`` of the input axis, mm or deg. Raises DeviceRefused (E-MBX-PLACE).
    """
    old = live_of(order, backup)
    before = abs(value_at(old.table, position)) if old is not None and old.enabled else 0.0
    after = abs(value_at(order.table, position)) if order.enable else 0.0
    if max(before, after) > JUMP:
        told: dict[str, Any] = {"axis": order.table.input_axis, "position": position, "unit": order.table.input_unit}
        jump = round(max(before, after), 3)
        raise DeviceRefused("E-MBX-PLACE", where, jump=jump, wanted=order.agreeing_position, **told)


def different(
    order: PushOrder, begin: Order, values: tuple[int, ...], reading: AxisReading, where: str
) -> DeviceRefused | None:
    """Numbers read back against numbers sent, points above them against zero: E-MBX-READBACK, None where all agree.

    Of a backlash nothing stands there yet: it is written when it is switched on, and looked at then (`taken_up`).
    """
    if order.table.kind == "reversal":
        return taken_up(order, 0, reading.stored[0].picture, where)
    stored = _stored_of(order, reading)
    found = ["the table"] if stored is None else list(_differences(begin, values, stored))
    if not found:
        return None
    told: dict[str, Any] = {"count": len(found), "first": found[0]}
    return DeviceRefused("E-MBX-READBACK", where, table=order.table.name, **told)


def taken_up(order: PushOrder, number: int, picture: Picture, where: str) -> DeviceRefused | None:
    """The backlash that stands in the control against a number: E-MBX-READBACK, None where they are the same."""
    if picture.backlash == number:
        return None
    told: dict[str, Any] = {"count": 1, "first": f"the backlash: {number} is {picture.backlash}"}
    return DeviceRefused("E-MBX-READBACK", where, table=order.table.name, **told)


def _differences(begin: Order, values: tuple[int, ...], stored: Stored) -> list[str]:
    grid = stored.picture.grid
    wanted = values + (0,) * (len(stored.points) - len(values))
    pairs = list(zip(wanted, stored.points, strict=False))
    found = [f"point {number}: {one} is {two}" for number, (one, two) in enumerate(pairs) if one != two]
    found += [
        f"{name}: {getattr(begin, name)} is {getattr(grid, name)}"
        for name in _GRID
        if getattr(begin, name) != getattr(grid, name)
    ]
    if begin.kind is Kind.CEC and (begin.input_axis, begin.output_axis) != (grid.input_axis, grid.output_axis):
        found.append("the axes")
    return found if len(stored.points) >= len(values) else [*found, f"{len(values)} points are {len(stored.points)}"]


def value_at(table: CompensationTable, position: float) -> float:
    """Deviation of a table at a position; a table never loaded (step 0) is zero."""
    if table.step <= 0 or not any(table.deviations):
        return 0.0
    return float(table.at(np.array([position]))[0])


def live_of(order: PushOrder, live: LiveSet) -> LiveTable | None:
    """What stands now where an order writes; None where there is nothing."""
    if order.table.kind != "cross":
        return live.own if order.table.kind == "axis" else live.reversal
    return next((one for one in live.cross if one.table.index == order.table.index), None)


def _stored_of(order: PushOrder, reading: AxisReading) -> Stored | None:
    if order.table.kind == "axis":
        return reading.stored[0]
    index = order.table.index
    return next((one for one in reading.stored[1:] if one.picture.selection.index == index), None)
