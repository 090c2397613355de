"""The first half of a push through the mailbox, with what must hold before and after each of its steps.

::

    back up -> mark -> switch off -> load in chunks -> verify -> read back over a new connection

A table is never loaded while it acts. What the control holds afterwards is read twice from the control before anybody
may enable it. The checks are pure: a reading in, an exception with its reason out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from drivers.clock import Clock
from drivers.errors import DeviceRefused, TableError, TooManyPoints, TrueflankError, ValueOutOfRange
from drivers.limits import Limits
from drivers.message import Message
from drivers.sinumerik.mailbox.codec import grids
from drivers.sinumerik.mailbox.codec.frames import (
    MailboxOrder,
    Picture,
    Status,
    marker_data,
    switching_command,
    value_chunks,
)
from drivers.sinumerik.mailbox.codec.grids import MailboxAxis, StoredTable
from drivers.sinumerik.mailbox.codec.registers import (
    MOST_ENTRIES,
    AxisBit,
    Command,
    Kind,
    StatusBit,
    SwitchBit,
    pack_dints,
)
from drivers.sinumerik.mailbox.conversation import PanelRelease, PlcConversation
from drivers.sinumerik.mailbox.reader import (
    MARKER_STATES,
    AxisReading,
    MailboxReader,
    MarkerState,
    deviation_of,
    machine_of,
    marker_of,
    position_of,
)
from drivers.sinumerik.mailbox.settings import ModbusSettings
from drivers.sinumerik.tablefile import tables
from drivers.sinumerik.tablefile.tables import order_sense
from drivers.types.identity import MachineIdentity
from drivers.types.orders import DisableOrder, PushBatch, PushOrder, ReadBack
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from drivers.types.values import GONE

# Checks.

JUMP = Limits.of("mm").jump + 1e-6  # um or arcsec: what an axis may jump when a table is switched
_REST = (StatusBit.READY, StatusBit.IN_RESET, StatusBit.STANDSTILL)
_GRID = ("flags", "minimum", "step", "maximum", "multiply_by")


def check_before_write(status: Status, where: str, alarm: int = 0) -> None:
    """What must hold before every write of a push.

    Raises DeviceRefused (E-MBX-NOT-RELEASED, E-MBX-NOT-IN-RESET, E-MBX-ALARM).
    """
    if not status.has(StatusBit.RELEASED):
        raise DeviceRefused("E-MBX-NOT-RELEASED", where, command="push", detail=0)
    check_at_rest(status, where, alarm)


def check_at_rest(status: Status, where: str, alarm: int = 0) -> None:
    """Ready, in reset, standing, no alarm. Raises DeviceRefused (E-MBX-NOT-IN-RESET, E-MBX-ALARM)."""
    if not status.has(*_REST):
        raise DeviceRefused("E-MBX-NOT-IN-RESET", where, command="push", detail=0)
    if status.has(StatusBit.ALARM):
        raise DeviceRefused("E-MBX-ALARM", where, number=alarm or Message.of("W-MBX-PANEL-LIST"))


def check_switchable(status: Status, where: str, *, released: bool, anyhow: bool = False) -> None:
    """What command 6 needs; an alarm does not keep a table on, and ``anyhow`` no program and no motion either.

    Raises DeviceRefused as `check_before_write`.
    """
    if not released:
        raise DeviceRefused("E-MBX-NOT-RELEASED", where, command="DISABLE", detail=0)
    if not status.has(StatusBit.READY) or not (anyhow or status.has(*_REST)):
        raise DeviceRefused("E-MBX-NOT-IN-RESET", where, command="DISABLE", detail=0)


def is_on(order: MailboxOrder, status: Status, picture: Picture) -> bool:
    """Whether the table that ``order`` names is at work, by its switches; the status word must agree.

    A backlash has no switch: it is on where it is not 0.
    """
    if order.kind is Kind.BACKLASH:
        return SwitchBit.BACKLASH in picture.switches and picture.backlash != 0
    if order.kind is Kind.EEC:
        return SwitchBit.EEC in picture.switches and status.has(StatusBit.EEC_ENABLED)
    both = SwitchBit.CEC_AXIS | SwitchBit.CEC_TABLE
    return both in picture.switches and status.has(StatusBit.CEC_ENABLED)


def is_off(order: MailboxOrder, status: Status, picture: Picture) -> bool:
    """Whether it may be written: each of its switches reads off, in the picture and in the status word."""
    if order.kind is Kind.BACKLASH:
        return SwitchBit.BACKLASH not in picture.switches and picture.backlash == 0
    if order.kind is Kind.EEC:
        return SwitchBit.EEC not in picture.switches and not status.has(StatusBit.EEC_ENABLED)
    either = SwitchBit.CEC_AXIS | SwitchBit.CEC_TABLE
    return not picture.switches & either and not status.has(StatusBit.CEC_ENABLED)


def check_coupling(order: PushOrder, backup: AxisReading, batch: PushBatch, where: str) -> None:
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


def check_position(order: PushOrder, backup: LiveSet, position: float, where: str) -> None:
    """The axis must stand where neither the old nor the new table moves it; nothing on this road can bring it there.

    ``position`` of the input axis, mm or deg. Raises DeviceRefused (E-MBX-PLACE).
    """
    old = live_table_of(order, backup)
    before = abs(value_at(old.table, position)) if old is not None and old.enabled else 0.0
    after = abs(value_at(order.table, position)) if order.enable else 0.0
    if max(before, after) > JUMP:
        told: dict[str, Any] = {"axis": order.table.input_axis, "position": position, "unit": order.table.input_unit}
        jump = round(max(before, after), 3)
        raise DeviceRefused("E-MBX-PLACE", where, jump=jump, wanted=order.agreeing_position, **told)


def compare_read_back(
    order: PushOrder, begin: MailboxOrder, values: tuple[int, ...], reading: AxisReading, where: str
) -> DeviceRefused | None:
    """Numbers read back against numbers sent, points above them against zero: E-MBX-READBACK, None where all agree.

    Of a backlash nothing stands there yet: it is written when it is switched on, and looked at then
    (`compare_backlash`).
    """
    if order.table.kind == "reversal":
        return compare_backlash(order, 0, reading.stored[0].picture, where)
    stored = _stored_of(order, reading)
    found = ["the table"] if stored is None else list(_differences(begin, values, stored))
    if not found:
        return None
    told: dict[str, Any] = {"count": len(found), "first": found[0]}
    return DeviceRefused("E-MBX-READBACK", where, table=order.table.name, **told)


def compare_backlash(order: PushOrder, number: int, picture: Picture, where: str) -> DeviceRefused | None:
    """The backlash that stands in the control against a number: E-MBX-READBACK, None where they are the same."""
    if picture.backlash == number:
        return None
    told: dict[str, Any] = {
        "count": 1,
        "first": Message.of("W-MBX-BACKLASH-IS", number=number, backlash=picture.backlash),
    }
    return DeviceRefused("E-MBX-READBACK", where, table=order.table.name, **told)


def _differences(begin: MailboxOrder, values: tuple[int, ...], stored: StoredTable) -> list[str]:
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


def live_table_of(order: PushOrder, live: LiveSet) -> LiveTable | None:
    """What stands now where an order writes; None where there is nothing."""
    if order.table.kind != "cross":
        return live.own if order.table.kind == "axis" else live.reversal
    return next((one for one in live.cross if one.table.index == order.table.index), None)


def _stored_of(order: PushOrder, reading: AxisReading) -> StoredTable | None:
    if order.table.kind == "axis":
        return reading.stored[0]
    index = order.table.index
    return next((one for one in reading.stored[1:] if one.picture.selection.index == index), None)


# The steps.

MARKER_DIGITS = 16


@dataclass(frozen=True, slots=True)
class MailboxPlan:
    """An order as numbers: command 2, and the values of all points."""

    begin: MailboxOrder
    values: tuple[int, ...]


class MailboxPushing:
    """The first half; `modbusswitch.MailboxSwitching` is the second and uses this one's back-up and marker."""

    def __init__(
        self, talk: PlcConversation, reader: MailboxReader, settings: ModbusSettings, clock: Clock, where: str
    ) -> None:
        self._talk = talk
        self._reader = reader
        self.consent = PanelRelease(talk=talk, settings=settings, clock=clock, where=where)
        self._settings = settings
        self._clock = clock
        self._where = where
        self._machine: MachineIdentity | None = None
        self._plans: dict[int, tuple[PushOrder, MailboxPlan]] = {}
        self.backups: dict[DisableOrder, LiveSet] = {}
        self.connect_s = 10.0

    def planned(self, batch: PushBatch) -> None:
        """Every order as numbers, before a session is opened for them. Raises as `plan`."""
        self._plans = {}
        for order in batch:
            self.plan(order)

    async def prepare(self, batch: PushBatch) -> None:
        """Check every order, back up and mark in the session that is open; nothing that moves an axis changes.

        Raises TableError (E-TABLE-NO-PROOF, E-MBX-FRACTION, ...) before anything is written, DeviceRefused
        (E-MBX-NUMBERS, E-MBX-FACTORS, E-MBX-NOT-RELEASED, E-MBX-PLACE, E-MBX-COUPLED, ...) or TableError
        (E-MBX-PUT-BACK); the session is closed again then.
        """
        backups: dict[DisableOrder, LiveSet] = {}
        try:
            self._machine = await self._reader.identity()
            self.planned(batch)  # anew: the axes were read anew, and a reversal goes by the factor of its axis
            for order in batch:
                if order.purpose != "restore":  # the way back is open whatever the site file says
                    self._as_printed(order)
                await self._check(order, self.plan(order))
                reading = await self._tables(order)
                check_coupling(order, reading, batch, self._where)
                backup = reading.live("BACK", order.transaction, order_sense(order))
                self._check_way_back(order, backup)
                await self.check_place(order, backup)
                backups[order_place(order)] = backup
            await self.mark(batch[0].transaction, "in-progress", batch[0].head)
        except TrueflankError:
            await self._talk.leave()
            raise
        self.backups = backups

    def backup_of(self, order: PushOrder) -> LiveSet:
        """What `prepare` read for this very order. Raises DeviceRefused (E-MBX-NOT-PREPARED)."""
        found = self.backups.get(order_place(order))
        if found is None:
            raise DeviceRefused("E-MBX-NOT-PREPARED", self._where, table=order.table.name)
        return found

    def plan(self, order: PushOrder) -> MailboxPlan:
        """The order as numbers. Raises TableError and ValueOutOfRange for what cannot or must not be said."""
        known = self._plans.get(id(order))
        if known is None or known[0] is not order:
            known = self._plans[id(order)] = order, self._planned(order)
        return known[1]

    def _planned(self, order: PushOrder) -> MailboxPlan:
        for name in (order.table.input_axis, order.table.output_axis):
            self._reader.axis(name)
        return plan_numbers(order, self._reader.axes, self._where)

    def _as_printed(self, order: PushOrder) -> None:
        """What was printed for this site is what will be sent. Raises DeviceRefused (E-MBX-NUMBERS, E-MBX-FACTORS)."""
        axes, table = self._reader.axes, order.table
        said = self._settings.numbered(axes)
        for name in dict.fromkeys((table.input_axis, table.output_axis)):
            if axes[name].number != said[name][0]:
                line = ", ".join(f"{one.name} = {one.number}" for one in axes.values())
                told: dict[str, Any] = {"axis": name, "said": said[name][0], "found": axes[name].number}
                raise DeviceRefused("E-MBX-NUMBERS", self._where, line=f"axis_numbers = {{ {line} }}", **told)
        output = axes[table.output_axis]
        if table.kind == "reversal" and output.factor_known and output.factor != said[output.name][1]:
            found = f"{output.factor.normalize():f}"
            others = [one for one in axes.values() if one.factor_known and one.factor != 1]
            line = f"backlash_factors = {{ {', '.join(f'{one.name} = {float(one.factor)!r}' for one in others)} }}"
            told = {"axis": output.name, "said": f"{said[output.name][1]:f}", "found": found}
            raise DeviceRefused("E-MBX-FACTORS", self._where, line=line, **told)

    async def _check(self, order: PushOrder, plan: MailboxPlan) -> None:
        picture = await self._talk.select(plan.begin)
        check_before_write(await self._talk.recent(), self._where, picture.alarm)
        output = self._reader.axis(order.table.output_axis)
        if AxisBit.REFERENCED not in picture.axis:
            raise DeviceRefused("E-MBX-NOT-REFERENCED", self._where, axis=order.table.output_axis)
        if order.table.kind == "reversal" and picture.backlash_factor * grids.WEIGHT_UNIT != output.factor:
            raise DeviceRefused("E-MBX-CHANGED", self._where, kind="BACKLASH", index=output.number)
        acting = AxisBit.SECOND_ACTS if order.saved_encoder else AxisBit.FIRST_ACTS
        if order.purpose != "restore" and acting not in picture.axis:
            named: dict[str, Any] = {"axis": order.table.output_axis, "encoder": order.saved_encoder + 1}
            raise DeviceRefused("E-MBX-ENCODER", self._where, **named)
        if self._talk.reserved < len(plan.values):
            told: dict[str, Any] = {"points": len(plan.values), "reserved": self._talk.reserved}
            raise TooManyPoints("E-TABLE-POINTS", self._where, table=order.table.name, **told)

    async def _tables(self, order: PushOrder) -> AxisReading:
        return await self._reader.tables(order.table.output_axis, order.saved_encoder)

    def _check_way_back(self, order: PushOrder, backup: LiveSet) -> None:
        """The table that stands now must be sayable too, or it could not be put back once it was overwritten.

        Raises TableError (E-MBX-PUT-BACK).
        """
        live = live_table_of(order, backup)
        empty = live is None or (live.table.kind != "reversal" and live.table.step <= 0)
        if order.purpose == "restore" or live is None or empty:
            return
        proof = order.proof if order.table.kind == "cross" else None
        back = replace(order, table=live.table, purpose="restore", proof=proof)
        try:
            self._planned(back)
        except (TableError, ValueOutOfRange) as error:
            raise TableError("E-MBX-PUT-BACK", self._where, table=live.table.name, why=error.what) from error

    async def check_place(self, order: PushOrder, backup: LiveSet) -> None:
        """Raises DeviceRefused (E-MBX-PLACE) where switching the old off or the new on would move the axis."""
        source = self._reader.axis(order.table.input_axis)
        position = position_of(await self._talk.select(MailboxOrder(Command.SELECT, Kind.EEC, source.number)))
        check_position(order, backup, position, self._where)

    async def mark(self, transaction: int, state: MarkerState, head: int) -> None:
        """Set the marker and read it back. Raises DeviceRefused (E-MBX-MARKER)."""
        number = "" if state == "none" else str(transaction)
        wanted = f"{number} {state}".strip()
        if len(number) > MARKER_DIGITS:
            raise DeviceRefused("E-MBX-MARKER", self._where, wanted=wanted, found=Message.of("W-MBX-TOO-LONG"))
        await self._talk.do(MailboxOrder(Command.MARKER), marker_data(number, MARKER_STATES.index(state), head))
        found = marker_of(await self._talk.picture(), self._where)
        if (found.transaction, found.state, found.head) != (int(number or 0), state, head):
            told = f"{found.transaction} {found.state}"
            raise DeviceRefused("E-MBX-MARKER", self._where, wanted=wanted, found=told)

    async def loaded(self, batch: PushBatch, timeout_s: float) -> tuple[ReadBack, ...]:
        """Disable all, load and verify each, and read back twice over a new connection: what stood, what stands now.

        Raises DeviceRefused (E-MBX-STILL-ON, E-MBX-STILL-ACTING, E-MBX-READBACK where no table reads as sent,
        E-MBX-UNSTEADY...), LinkBroken.
        """
        backups = [self.backup_of(order) for order in batch]
        plans = [self.plan(order) for order in batch]
        found: list[ReadBack] = []
        wrong: list[DeviceRefused] = []
        async with self._clock.deadline(timeout_s, self._where):
            await self.disable(*(plan.begin for plan in plans))
            for plan in plans:
                await self._load(plan)
            await self._talk.renew(self.connect_s)
            for order, plan, old in zip(batch, plans, backups, strict=True):
                reading = await self._read_again(order)
                why = compare_read_back(order, plan.begin, values=plan.values, reading=reading, where=self._where)
                wrong += [why] if why is not None else []
                found.append(ReadBack(old, reading.live("READ", order.transaction, order_sense(order)), why is None))
        if len(wrong) == len(batch):
            raise wrong[0]
        return tuple(found)

    async def disable(self, *named: MailboxOrder) -> None:
        """All of them off in one command, each by its switch and by what acts: a switch that reads off proves nothing.

        Raises DeviceRefused (E-MBX-STILL-ON, E-MBX-STILL-ACTING).
        """
        status = await self._talk.recent()
        check_switchable(status, self._where, released=self.consent.permits_off(status))
        for entries in split_batches(named):
            await self._talk.do(*switching_command(Command.DISABLE, entries))
        for begin in reversed(named):
            if begin is not named[-1]:  # the command itself has selected its last entry
                await self._talk.select(begin)
            await self._gone(begin)

    async def _gone(self, begin: MailboxOrder) -> None:
        end = self._clock.now() + self._settings.command_s
        while True:
            # What the table held the axis away by is travelled now: it may move until it has come to rest.
            picture, status = await self._talk.picture_for(begin), await self._talk.status()
            if not is_off(begin, status, picture):
                raise DeviceRefused("E-MBX-STILL-ON", self._where, kind=begin.kind.name, index=begin.index)
            gone = abs(acting_value(picture)) <= GONE
            if gone and status.has(StatusBit.STANDSTILL):
                check_at_rest(status, self._where, picture.alarm)
                return
            if self._clock.now() >= end:
                check_at_rest(status, self._where, picture.alarm)
                raise DeviceRefused(
                    "E-MBX-STILL-ACTING", self._where, acting=acting_value(picture), kind=begin.kind.name
                )
            await self._clock.sleep(self._settings.poll_s)

    async def _guarded(self, order: MailboxOrder, data: Sequence[int] = (), whole: Sequence[int] = ()) -> Status:
        """A command of the transfer: the state is looked at right before and in its answer."""
        check_before_write(await self._talk.recent(), self._where)
        status = await self._talk.do(order, data, whole)
        check_before_write(status, self._where)
        return status

    async def _load(self, plan: MailboxPlan) -> None:
        order = self._settings.order
        await self._guarded(plan.begin)
        for first, count, data in value_chunks(plan.values, order):
            status = await self._guarded(plan.begin.as_command(Command.CHUNK, first, count), data)
            if status.stored != first + count:
                raise DeviceRefused("E-MBX-LENGTH", self._where, command="CHUNK", detail=status.stored)
        await self._guarded(plan.begin.as_command(Command.VERIFY), (), pack_dints(plan.values, order))

    async def _read_again(self, order: PushOrder) -> AxisReading:
        reading = await self._tables(order)
        seen = reading.stored[0].picture
        if self._machine is not None:
            different = self._machine.differences(machine_of(seen, self._machine.axis_names))
            if different or seen.axis_name != order.table.output_axis:
                raise DeviceRefused("E-MBX-OTHER", self._where, differ=", ".join(different) or "axis name")
        return reading


def plan_numbers(order: PushOrder, axes: Mapping[str, MailboxAxis], where: str) -> MailboxPlan:
    """The order as numbers, for axes as the PLC names them. Raises as `MailboxPushing.plan`."""
    order = replace(order, table=grids.as_loadable(order.table))
    table = order.table
    source, output = axes[table.input_axis], axes[table.output_axis]
    if (table.input_unit, table.output_unit) != (source.unit, output.unit):
        raise TableError("E-MBX-UNIT", where, table=table.name, input=source.unit, output=output.unit)
    values = grids.numbers_of(table, tables.order_values(order), output)
    return MailboxPlan(grids.begin_order(table, len(values), axes), values)


def split_batches(orders: Sequence[MailboxOrder]) -> list[Sequence[MailboxOrder]]:
    """As many at a time as commands 5 and 6 take."""
    return [orders[first : first + MOST_ENTRIES] for first in range(0, len(orders), MOST_ENTRIES)]


def order_place(order: PushOrder) -> DisableOrder:
    """Which table of which transaction an order is about."""
    return DisableOrder(order.transaction, order.table.kind, order.table.output_axis, order.table.index)


def acting_value(picture: Picture) -> float:
    """The acting compensation of the selected kind, um or arcsec."""
    return deviation_of(picture.acting, "deg" if picture.rotary else "mm")
