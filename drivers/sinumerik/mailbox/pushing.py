"""The first half of a push through the mailbox: back up, mark, disable, load, read back over a new connection.

A table is never loaded while it acts, and what the control holds afterwards is read from the control twice
before anybody may enable it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from drivers.clock import Clock
from drivers.errors import DeviceRefused, TableError, TooManyPoints, TrueflankError, ValueOutOfRange
from drivers.sinumerik.mailbox import checks
from drivers.sinumerik.mailbox.codec import grids
from drivers.sinumerik.mailbox.codec.commands import Order, chunks, marker_data, switching
from drivers.sinumerik.mailbox.codec.grids import MailboxAxis
from drivers.sinumerik.mailbox.codec.packing import dints
from drivers.sinumerik.mailbox.codec.readings import Picture, Status
from drivers.sinumerik.mailbox.codec.registers import MOST_ENTRIES, AxisBit, Command, Kind, StatusBit
from drivers.sinumerik.mailbox.consent import Consent
from drivers.sinumerik.mailbox.conversation import Talk
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
from drivers.sinumerik.tablefile.tables import sense_for
from drivers.types.identity import MachineIdentity
from drivers.types.orders import DisableOrder, PushBatch, PushOrder, ReadBack
from drivers.types.tables import LiveSet
from drivers.types.values import GONE

MARKER_DIGITS = 16


@dataclass(frozen=True, slots=True)
class MailboxPlan:
    """An order as numbers: command 2, and the values of all points."""

    begin: Order
    values: tuple[int, ...]


class MailboxPushing:
    """The first half; `modbusswitch.Switching` is the second and uses this one's back-up and marker."""

    def __init__(self, talk: Talk, reader: MailboxReader, settings: ModbusSettings, clock: Clock, where: str) -> None:
        self._talk = talk
        self._reader = reader
        self.consent = Consent(talk=talk, settings=settings, clock=clock, where=where)
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
                checks.coupled(order, reading, batch, self._where)
                backup = reading.live("BACK", order.transaction, sense_for(order))
                self._check_way_back(order, backup)
                await self.check_place(order, backup)
                backups[place_of(order)] = backup
            await self.mark(batch[0].transaction, "in-progress", batch[0].head)
        except TrueflankError:
            await self._talk.leave()
            raise
        self.backups = backups

    def backup_of(self, order: PushOrder) -> LiveSet:
        """What `prepare` read for this very order. Raises DeviceRefused (E-MBX-NOT-PREPARED)."""
        found = self.backups.get(place_of(order))
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
        return as_numbers(order, self._reader.axes, self._where)

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
        checks.guard(await self._talk.recent(), self._where, picture.alarm)
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
        live = checks.live_of(order, backup)
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
        position = position_of(await self._talk.select(Order(Command.SELECT, Kind.EEC, source.number)))
        checks.place(order, backup, position, self._where)

    async def mark(self, transaction: int, state: MarkerState, head: int) -> None:
        """Set the marker and read it back. Raises DeviceRefused (E-MBX-MARKER)."""
        number = "" if state == "none" else str(transaction)
        wanted = f"{number} {state}".strip()
        if len(number) > MARKER_DIGITS:
            raise DeviceRefused("E-MBX-MARKER", self._where, wanted=wanted, found="nothing: it is too long")
        await self._talk.do(Order(Command.MARKER), marker_data(number, MARKER_STATES.index(state), head))
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
                why = checks.different(order, plan.begin, values=plan.values, reading=reading, where=self._where)
                wrong += [why] if why is not None else []
                found.append(ReadBack(old, reading.live("READ", order.transaction, sense_for(order)), why is None))
        if len(wrong) == len(batch):
            raise wrong[0]
        return tuple(found)

    async def disable(self, *named: Order) -> None:
        """All of them off in one command, each by its switch and by what acts: a switch that reads off proves nothing.

        Raises DeviceRefused (E-MBX-STILL-ON, E-MBX-STILL-ACTING).
        """
        status = await self._talk.recent()
        checks.switchable(status, self._where, released=self.consent.permits_off(status))
        for entries in batched(named):
            await self._talk.do(*switching(Command.DISABLE, entries))
        for begin in reversed(named):
            if begin is not named[-1]:  # the command itself has selected its last entry
                await self._talk.select(begin)
            await self._gone(begin)

    async def _gone(self, begin: Order) -> None:
        end = self._clock.now() + self._settings.command_s
        while True:
            # What the table held the axis away by is travelled now: it may move until it has come to rest.
            picture, status = await self._talk.picture_for(begin), await self._talk.status()
            if not checks.is_off(begin, status, picture):
                raise DeviceRefused("E-MBX-STILL-ON", self._where, kind=begin.kind.name, index=begin.index)
            gone = abs(acting_of(picture)) <= GONE
            if gone and status.has(StatusBit.STANDSTILL):
                checks.at_rest(status, self._where, picture.alarm)
                return
            if self._clock.now() >= end:
                checks.at_rest(status, self._where, picture.alarm)
                raise DeviceRefused("E-MBX-STILL-ACTING", self._where, acting=acting_of(picture), kind=begin.kind.name)
            await self._clock.sleep(self._settings.poll_s)

    async def _guarded(self, order: Order, data: Sequence[int] = (), whole: Sequence[int] = ()) -> Status:
        """A command of the transfer: the state is looked at right before and in its answer."""
        checks.guard(await self._talk.recent(), self._where)
        status = await self._talk.do(order, data, whole)
        checks.guard(status, self._where)
        return status

    async def _load(self, plan: MailboxPlan) -> None:
        order = self._settings.order
        await self._guarded(plan.begin)
        for first, count, data in chunks(plan.values, order):
            status = await self._guarded(plan.begin.as_command(Command.CHUNK, first, count), data)
            if status.stored != first + count:
                raise DeviceRefused("E-MBX-LENGTH", self._where, command="CHUNK", detail=status.stored)
        await self._guarded(plan.begin.as_command(Command.VERIFY), (), dints(plan.values, order))

    async def _read_again(self, order: PushOrder) -> AxisReading:
        reading = await self._tables(order)
        seen = reading.stored[0].picture
        if self._machine is not None:
            different = self._machine.differences(machine_of(seen, self._machine.axis_names))
            if different or seen.axis_name != order.table.output_axis:
                raise DeviceRefused("E-MBX-OTHER", self._where, differ=", ".join(different) or "axis name")
        return reading


def as_numbers(order: PushOrder, axes: Mapping[str, MailboxAxis], where: str) -> MailboxPlan:
    """The order as numbers, for axes as the PLC names them. Raises as `MailboxPushing.plan`."""
    order = replace(order, table=grids.sayable(order.table))
    table = order.table
    source, output = axes[table.input_axis], axes[table.output_axis]
    if (table.input_unit, table.output_unit) != (source.unit, output.unit):
        raise TableError("E-MBX-UNIT", where, table=table.name, input=source.unit, output=output.unit)
    values = grids.numbers_of(table, tables.values_of(order), output)
    return MailboxPlan(grids.begin_order(table, len(values), axes), values)


def batched(orders: Sequence[Order]) -> list[Sequence[Order]]:
    """As many at a time as commands 5 and 6 take."""
    return [orders[first : first + MOST_ENTRIES] for first in range(0, len(orders), MOST_ENTRIES)]


def place_of(order: PushOrder) -> DisableOrder:
    """Which table of which transaction an order is about."""
    return DisableOrder(order.transaction, order.table.kind, order.table.output_axis, order.table.index)


def acting_of(picture: Picture) -> float:
    """The acting compensation of the selected kind, um or arcsec."""
    return deviation_of(picture.acting, "deg" if picture.rotary else "mm")
