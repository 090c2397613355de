"""One table off through the mailbox: command 6 where its needs hold, and what is read back afterwards."""

from __future__ import annotations

from drivers.clock import Clock
from drivers.sinumerik.mailbox import checks
from drivers.sinumerik.mailbox.codec.commands import Order, switching
from drivers.sinumerik.mailbox.codec.registers import KINDS, Command, StatusBit, TableFlag
from drivers.sinumerik.mailbox.consent import Consent
from drivers.sinumerik.mailbox.conversation import Talk
from drivers.sinumerik.mailbox.pushing import acting_of
from drivers.sinumerik.mailbox.reader import MailboxReader, table_order
from drivers.sinumerik.mailbox.settings import ModbusSettings
from drivers.types.orders import DisableOrder, SwitchReading

CONFIRM_S = 60.0 + 10.0


class MailboxDisabling:
    """The disable-only order. A session of its own, unless one of ours is open."""

    def __init__(
        self, talk: Talk, reader: MailboxReader, consent: Consent, settings: ModbusSettings, clock: Clock, where: str
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

    def _naming(self, order: DisableOrder) -> Order:
        return table_order(self._reader.axis(order.axis), KINDS[order.kind], order.index)

    async def _read(self, named: Order) -> SwitchReading:
        picture, status = await self._talk.picture_for(named), await self._talk.status()
        on, off = checks.is_on(named, status, picture), checks.is_off(named, status, picture)
        return SwitchReading(on if on != off else None, acting_of(picture))

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
            checks.switchable(status, self._where, released=permitted, anyhow=True)
        except BaseException:
            await self._left()
            raise

    async def disabled(self, order: DisableOrder, timeout_s: float) -> SwitchReading:
        """Command 6, once, and what is read when the axis has come to rest; ends the session that `enter` opened.

        Where a program is at work or an axis moves the PLC waits for the panel. Raises as `check`, and as `Talk.do`.
        """
        named = self._naming(order)
        try:
            async with self._clock.deadline(timeout_s, self._where):
                await self._free()
                await self.check(order)
                told, data = switching(Command.DISABLE, [named], int(TableFlag.ANYHOW))
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
            await self._talk.do(Order(Command.ABORT))

    async def _settled(self, named: Order) -> SwitchReading:
        """What the table held the axis away by is travelled now: read until it is off and at rest, or too long."""
        end = self._clock.now() + self._settings.command_s
        while True:
            found = await self._read(named)
            rests = (await self._talk.recent()).has(StatusBit.STANDSTILL)
            if (found.off and rests) or self._clock.now() >= end:
                return found
            await self._clock.sleep(self._settings.poll_s)
