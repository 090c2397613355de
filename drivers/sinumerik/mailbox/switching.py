"""The second half of a push through the mailbox: enabling, confirmed by a person at the panel and seen to act; and one
table off.

Enabling is command 5, switching off command 6. The PLC reports the command as done when the switches are set; the table
counts as active when the picture shows its compensation acting. Switching off needs no release at the panel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, DeviceRefused
from drivers.sinumerik.mailbox import pushing
from drivers.sinumerik.mailbox.codec import grids
from drivers.sinumerik.mailbox.codec.frames import MailboxOrder, Picture, switching_command
from drivers.sinumerik.mailbox.codec.grids import MailboxAxis
from drivers.sinumerik.mailbox.codec.registers import KINDS, MOST_ENTRIES, AxisBit, Command, Kind, StatusBit, TableFlag
from drivers.sinumerik.mailbox.conversation import PanelRelease, PlcConversation
from drivers.sinumerik.mailbox.pushing import MailboxPushing, acting_value
from drivers.sinumerik.mailbox.reader import MailboxReader, MarkerState, marker_of, position_of, table_order
from drivers.sinumerik.mailbox.settings import ModbusSettings
from drivers.types.orders import DisableOrder, PushBatch, PushOrder, SwitchReading
from drivers.types.values import GONE

# Enabling and switching.

GRACE_S = 3.0
CONFIRM_S = 60.0 + 10.0


def command_entries(passed: PushBatch, axes: Mapping[str, MailboxAxis]) -> list[MailboxOrder]:
    """What command 5 names of the tables that passed.

    Of a CEC table that stays off beside others that act the axis switch alone; of any other that stays off nothing.
    """
    found: list[MailboxOrder] = []
    for order in passed:
        named = grids.naming_order(order.table, axes).as_command(Command.ACTIVATE)
        if order.enable:
            found.append(named)
        elif named.kind is Kind.CEC and order.coupled:
            found.append(replace(named, flags=int(TableFlag.AXIS_ONLY)))
    return found


class MailboxSwitching:
    """Release, enabling, activation, switching, and the marker's last state."""

    def __init__(
        self,
        talk: PlcConversation,
        reader: MailboxReader,
        pushing: MailboxPushing,
        settings: ModbusSettings,
        clock: Clock,
        where: str,
    ) -> None:
        self._talk = talk
        self._reader = reader
        self._pushing = pushing
        self._settings = settings
        self._clock = clock
        self._where = where

    async def release(self, batch: PushBatch, passed: PushBatch) -> None:
        """Check all and ask the PLC to activate those that passed in one command; it waits for the panel once.

        Nothing is asked for a table that shall stay off. Raises DeviceRefused (E-MBX-NOT-PREPARED, E-MBX-MARKER,
        E-MBX-STILL-ON, E-MBX-PLACE...) before it asks.
        """
        for order in batch:
            await self._pushing.check_place(order, self._pushing.backup_of(order))
        for order in batch:
            named = self._naming(order)
            picture = await self._talk.select(named)
            status = await self._talk.status()
            pushing.check_before_write(status, self._where, picture.alarm)
            self._check_marker(order, picture)
            if not pushing.is_off(named, status, picture):
                raise DeviceRefused("E-MBX-STILL-ON", self._where, kind=named.kind.name, index=named.index)
        entries = self._entries(passed)
        if len(entries) > MOST_ENTRIES:
            raise DeviceRefused("E-MBX-MANY", self._where, count=len(entries), most=MOST_ENTRIES)
        if entries:
            told, data = switching_command(Command.ACTIVATE, entries)
            await self._talk.start(told, data)
            await self._talk.ended(told, self._settings.command_s, or_waiting=True)

    def _entries(self, passed: PushBatch) -> list[MailboxOrder]:
        return command_entries(passed, self._reader.axes)

    def _check_marker(self, order: PushOrder, picture: Picture) -> None:
        found = marker_of(picture, self._where)
        if (found.transaction, found.state) != (order.transaction, "in-progress"):
            told = f"{found.transaction} {found.state}"
            raise DeviceRefused("E-MBX-MARKER", self._where, wanted=f"{order.transaction} in-progress", found=told)

    def _naming(self, order: PushOrder) -> MailboxOrder:
        return grids.naming_order(order.table, self._reader.axes)

    async def enabled(self, passed: PushBatch, timeout_s: float) -> tuple[bool, ...]:
        """Wait for the panel; table by table, true where the switches then read on, false where they do not.

        False: nobody confirmed, or the NCK took some of several tables and not this one.
        Raises DeviceRefused (E-MBX-NOT-RELEASED, E-MBX-NOT-IN-RESET...: the PLC's reason not to, nothing is on then;
        E-MBX-READBACK: a backlash is on, and another than was sent).
        """
        entries = self._entries(passed)
        if entries and not await self._confirmed(entries, timeout_s):
            return (False,) * len(passed)
        async with self._talk.turn:
            return tuple([await self._enabled(order) for order in passed])

    async def _enabled(self, order: PushOrder) -> bool:
        named = self._naming(order)
        picture = await self._talk.select(named)
        on = pushing.is_on(named, await self._talk.recent(), picture)
        if on and named.kind is Kind.BACKLASH:
            (number,) = self._pushing.plan(order).values
            wrong = pushing.compare_backlash(order, number, picture, self._where)
            if wrong is not None:
                raise wrong
        return on

    async def _confirmed(self, entries: Sequence[MailboxOrder], timeout_s: float) -> bool:
        """False when the PLC says that time was over; a limit of the caller's ends the waiting at the panel.

        Where the NCK refused one of several, those before it stay as they were switched: each is looked at then.
        """
        activate, longer = switching_command(Command.ACTIVATE, entries)[0], len(entries) - 1.0
        try:
            await self._talk.ended(activate, min(timeout_s, CONFIRM_S + longer))
        except DeviceRefused as error:
            if error.code == "E-MBX-TIME":
                return False
            if error.code == "E-MBX-NCK" and len(entries) > 1:
                return True
            raise
        except DeadlineExceeded as error:
            if error.code != "E-MBX-NO-ANSWER":
                raise
            await self._talk.do(MailboxOrder(Command.ABORT))
        return True

    async def activated(self, orders: PushBatch, timeout_s: float) -> None:
        """Return when every axis is referenced again after one was not, or all their tables are seen to act.

        One restart serves all: it is seen once. At least one order.

        Without `ModbusSettings.needs_reference` a state that stays ready for `GRACE_S` is enough. Whether the table
        acts as it should is proved by its values, not here. Raises DeadlineExceeded (E-NC-NO-ACTIVATION).
        """
        end, seen_down, settled_since = self._clock.now() + timeout_s, False, None
        while True:
            async with self._talk.turn:
                looks = [await self._look(order) for order in orders]
            back, acts = (all(each) for each in zip(*looks, strict=True))
            now = self._clock.now()
            seen_down = seen_down or not back
            settled_since = None if not back else now if settled_since is None else settled_since
            settled = settled_since is not None and now - settled_since >= GRACE_S
            if back and (seen_down or acts or (settled and not self._settings.needs_reference)):
                return
            if now >= end:
                axis = ", ".join(dict.fromkeys(order.table.output_axis for order in orders))
                raise DeadlineExceeded("E-NC-NO-ACTIVATION", self._where, axis=axis, timeout_s=timeout_s)
            await self._clock.sleep(self._settings.poll_s)

    async def _look(self, order: PushOrder) -> tuple[bool, bool]:
        """Whether the NCK is up with the axis referenced, and whether its table is seen to act."""
        status = await self._talk.status()
        if not status.has(StatusBit.READY, StatusBit.IN_RESET):
            return False, False
        try:
            expected = await self._expected(order)
            picture = await self._talk.select(self._naming(order))
        except DeviceRefused as error:
            if error.code != "E-MBX-NOT-IN-RESET":
                raise
            return False, False  # it went down between two looks
        # Where little is expected nothing can be seen to act.
        acts = expected > 10 * GONE and abs(acting_value(picture)) >= 0.5 * expected
        return AxisBit.REFERENCED in picture.axis, acts

    async def _expected(self, order: PushOrder) -> float:
        """How much the order's table should act where its input axis stands, without sign, um or arcsec."""
        source = self._reader.axis(order.table.input_axis)
        picture = await self._talk.select(MailboxOrder(Command.SELECT, Kind.EEC, source.number))
        return abs(pushing.value_at(order.table, position_of(picture)))

    async def switch(self, order: PushOrder, enable: bool, timeout_s: float) -> None:
        """Off by command 6, on by command 5 and the panel; returns when the acting value has followed.

        Raises DeadlineExceeded (E-MBX-NOT-ACTING), DeviceRefused (E-MBX-TIME: nobody confirmed).
        """
        await self._pushing.consent.enter()
        named = self._naming(order)
        async with self._clock.deadline(timeout_s, self._where):
            if not enable:
                await self._talk.select(named)
                await self._pushing.disable(named)
                return
            activate, data = switching_command(Command.ACTIVATE, [named])
            pushing.check_before_write(await self._talk.status(), self._where)
            await self._talk.start(activate, data)
            await self._talk.ended(activate, CONFIRM_S)
            await self._until_acting(order, named)

    async def _until_acting(self, order: PushOrder, named: MailboxOrder) -> None:
        expected = await self._expected(order)
        await self._talk.select(named)
        end = self._clock.now() + self._settings.command_s
        while True:
            picture = await self._talk.picture_for(named)
            acting, status = abs(acting_value(picture)), await self._talk.status()
            at_work = pushing.is_on(named, status, picture) and acting >= 0.5 * expected - GONE
            if at_work and status.has(StatusBit.STANDSTILL):
                return
            if self._clock.now() >= end:
                told: dict[str, Any] = {"expected": round(expected, 4), "acting": round(acting, 4)}
                raise DeadlineExceeded("E-MBX-NOT-ACTING", self._where, table=order.table.name, **told)
            await self._clock.sleep(self._settings.poll_s)

    async def finish(self, batch: PushBatch, state: MarkerState) -> None:
        """The marker's last state, read back, then the end of the session. A release of this session is needed for it.

        Where nothing is to be taken back, because no marker is in progress, nothing is written.
        Raises DeviceRefused (E-MBX-MARKER, E-MBX-NO-RELEASE).
        """
        stands = marker_of(await self._talk.picture(), self._where)
        if state != "none" or stands.state == "in-progress":
            await self._talk.enter()
            if not self._pushing.consent.given:
                await self._pushing.consent.enter()
            await self._pushing.mark(batch[0].transaction, state, batch[0].head)
        self._pushing.backups = {}
        await self._talk.leave()


# One table off through the mailbox: command 6 where its needs hold, and what is read back afterwards.


class MailboxDisabling:
    """The disable-only order. A session of its own, unless one of ours is open."""

    def __init__(
        self,
        talk: PlcConversation,
        reader: MailboxReader,
        consent: PanelRelease,
        settings: ModbusSettings,
        clock: Clock,
        where: str,
    ) -> None:
        self._talk = talk
        self._consent = consent
        self._opened = False
        self._reader = reader
        self._settings = settings
        self._clock = clock
        self._where = where

    async def reading(self, order: DisableOrder) -> SwitchReading:
        """The switches in picture and status word, which must agree, and what acts."""
        named = self._naming(order)
        await self._talk.select(named)
        return await self._read(named)

    def _naming(self, order: DisableOrder) -> MailboxOrder:
        return table_order(self._reader.axis(order.axis), KINDS[order.kind], order.index)

    async def _read(self, named: MailboxOrder) -> SwitchReading:
        picture, status = await self._talk.picture_for(named), await self._talk.status()
        on, off = pushing.is_on(named, status, picture), pushing.is_off(named, status, picture)
        return SwitchReading(on if on != off else None, acting_value(picture))

    async def enter(self) -> None:
        """A session with a release, if there is none yet. Raises as `Consent.enter`, which closes what it opened."""
        if not self._consent.given:
            self._opened = not self._talk.session
            await self._consent.enter()

    async def check(self, order: DisableOrder) -> None:
        """Whether command 6 would be taken now. Raises DeviceRefused (E-MBX-NOT-RELEASED, E-MBX-NOT-IN-RESET)."""
        try:
            await self._talk.select(self._naming(order))
            status = await self._talk.status()
            permitted = self._consent.permits_off(status)
            pushing.check_switchable(status, self._where, released=permitted, anyhow=True)
        except BaseException:
            await self._left()
            raise

    async def disabled(self, order: DisableOrder, timeout_s: float) -> SwitchReading:
        """Command 6, once, and what is read when the axis has come to rest; ends the session that `enter` opened.

        Where a program is at work or an axis moves the PLC waits for the panel. Raises as `check_encoder`, and as
        `Talk.do`.
        """
        named = self._naming(order)
        try:
            async with self._clock.deadline(timeout_s, self._where):
                await self._free()
                await self.check(order)
                told, data = switching_command(Command.DISABLE, [named], int(TableFlag.ANYHOW))
                await self._talk.start(told, data)
                await self._talk.ended(told, CONFIRM_S)
                return await self._settled(named)
        finally:
            await self._left()

    async def _left(self) -> None:
        if self._opened:
            self._opened = False
            await self._talk.leave()

    async def _free(self) -> None:
        """A command of ours that still waits, for the panel say, is ended first: nothing may switch on after this."""
        if (await self._talk.status()).has(StatusBit.BUSY):
            await self._talk.do(MailboxOrder(Command.ABORT))

    async def _settled(self, named: MailboxOrder) -> SwitchReading:
        """What the table held the axis away by is travelled now: read until it is off and at rest, or too long."""
        end = self._clock.now() + self._settings.command_s
        while True:
            found = await self._read(named)
            rests = (await self._talk.recent()).has(StatusBit.STANDSTILL)
            if (found.off and rests) or self._clock.now() >= end:
                return found
            await self._clock.sleep(self._settings.poll_s)
