"""One table off through the mailbox: command 6 where its needs hold, and what is read back afterwards."""

from __future__ import annotations

from drivers.clock import Clock
from drivers.sinumerik.mailbox import checks
from drivers.sinumerik.mailbox.codec.commands import Order
from drivers.sinumerik.mailbox.codec.registers import KINDS, Command, StatusBit
from drivers.sinumerik.mailbox.conversation import Talk
from drivers.sinumerik.mailbox.pushing import acting_of
from drivers.sinumerik.mailbox.reader import MailboxReader, table_order
from drivers.sinumerik.mailbox.settings import ModbusSettings
from drivers.types.orders import DisableOrder, SwitchReading


class MailboxDisabling:
    """The disable-only order. A session of its own, unless one of ours is open."""

    def __init__(self, talk: Talk, reader: MailboxReader, settings: ModbusSettings, clock: Clock, where: str) -> None:
        self._talk = talk
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

    async def check(self, order: DisableOrder) -> None:
        """Whether command 6 would be taken now. Raises DeviceRefused (E-MBX-NOT-RELEASED, E-MBX-NOT-IN-RESET)."""
        await self._talk.select(self._naming(order))
        checks.switchable(await self._talk.status(), self._where)

    async def disabled(self, order: DisableOrder, timeout_s: float) -> SwitchReading:
        """Command 6, once, and what is read when the axis has come to rest. Raises as `check`, and as `Talk.do`."""
        ours = self._talk.session
        named = self._naming(order)
        await self._talk.enter()
        try:
            async with self._clock.deadline(timeout_s, self._where):
                await self._free()
                await self.check(order)
                await self._talk.do(named.as_command(Command.DISABLE))
                return await self._settled(named)
        finally:
            if not ours:
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
