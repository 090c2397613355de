"""One table off through OPC UA: a program of its own that the operator starts, and what is read back afterwards."""

from __future__ import annotations

from dataclasses import replace

from drivers.errors import DeviceRefused
from drivers.sinumerik.ncprogram import disabling as disabling_program
from drivers.sinumerik.ncprogram.legal import legal
from drivers.sinumerik.ncprogram.measuring import Setting
from drivers.sinumerik.ncprogram.words import Phase, program_path
from drivers.sinumerik.opcua.dialogue import Dialogue, Glance
from drivers.sinumerik.opcua.machine import Configuration, MachineReader
from drivers.sinumerik.opcua.pushing import Pushing
from drivers.sinumerik.opcua.transfer import Transfer
from drivers.types.machine import ChannelStatus
from drivers.types.orders import DisableOrder, SwitchReading


class Disabling:
    """The disable-only order; it shares dialogue, reader and transfer with all else the driver does."""

    def __init__(
        self, dialogue: Dialogue, reader: MachineReader, transfer: Transfer, pushing: Pushing, where: str
    ) -> None:
        self._dialogue = dialogue
        self._reader = reader
        self._transfer = transfer
        self._pushing = pushing
        self._where = where

    async def prepare(self, order: DisableOrder, setting: Setting) -> None:
        """Send, read back and select the program; nothing in the control changes until NC START.

        Raises DeviceRefused (E-NC-NOT-RESET) with nothing written while a program runs or waits, and as `legal`.
        """
        path = program_path("OFF", order.axis)
        passed = legal(path, disabling_program.disabling(order, setting), setting.memory.axes)
        await self._dialogue.begin(setting.axis_number, order.transaction, path)
        await self._transfer.send(passed)
        await self._transfer.select(path)

    async def disabled(self, order: DisableOrder, timeout_s: float, configuration: Configuration) -> SwitchReading:
        """Wait for the program's end, then read back. Where this user may not read a switch, the program has.

        Raises DeadlineExceeded (E-NC-NO-START), DeviceRefused (E-NC-STOPPED, E-NC-ALARM).
        """
        said_off = await self._pushing.until(order.transaction, timeout_s, self._is_over)
        found = await self.reading(order, configuration)
        return replace(found, enabled=False) if said_off and found.enabled is None else found

    def _is_over(self, before: Glance | None, seen: Glance) -> bool | None:
        if seen.channel is not ChannelStatus.RESET:
            return None
        if seen.phase in (Phase.SWITCHED_OFF, Phase.STILL_ON):
            return bool(seen.phase == Phase.SWITCHED_OFF)
        if seen.phase == Phase.LEFT or (before is not None and before.channel is ChannelStatus.RESET):
            raise DeviceRefused("E-NC-STOPPED", self._where, phase=seen.phase, table="the disable order")
        return None

    async def reading(self, order: DisableOrder, configuration: Configuration) -> SwitchReading:
        """Every switch of the table, as far as this user may read it, and what acts; one request each."""
        found = {await self._reader.switch(name, configuration) for name in disabling_program.switches(order)}
        axis = (await self._reader.state(configuration)).axes[order.axis]
        acts = {"axis": axis.encoder_compensation, "cross": axis.cross_compensation, "reversal": 0.0}
        return SwitchReading(found.pop() if len(found) == 1 else None, acts[order.kind])
