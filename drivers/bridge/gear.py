"""A gear inspection machine behind the bridge: measures a plan and hands its points over, or is stopped."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Mapping
from typing import Any

from drivers.bridge import gearrecords, records
from drivers.bridge.codec import Damaged, Message, Notification
from drivers.bridge.fields import Fields
from drivers.bridge.gearrecords import Chunk, Ending, Gathering
from drivers.bridge.line import BridgeLine
from drivers.bridge.settings import BridgeSettings
from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, DeviceRefused, TransportError, TrueflankError, UnsupportedDevice
from drivers.link import Trace
from drivers.types.gears import ClampedPart, GearPlan, InspectedGear
from drivers.types.identity import Identity
from drivers.types.sensing import Ambient

Told = Chunk | Ending


class BridgeGear:
    """Driver "bridge-gear": kind "gear" of docs/instrument-bridge.md."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        self._clock = clock
        self._settings = BridgeSettings.read(settings, name)
        self._line = BridgeLine(
            name=name, url=url, settings=self._settings, clock=clock, hear=self._hear, lost=self._lost
        )
        self._told: asyncio.Queue[Told | TrueflankError] = asyncio.Queue()

    @property
    def trace(self) -> Trace | None:
        """Called with every piece of bytes; set before `open`."""
        return self._line.trace

    @trace.setter
    def trace(self, trace: Trace | None) -> None:
        self._line.trace = trace

    @property
    def notices(self) -> tuple[str, ...]:
        """What the machine said of itself when it was opened."""
        return self._line.who.notices if self._line.who else ()

    async def open(self, timeout_s: float) -> Identity:
        """Connect and identify. Raises what `BridgeLine.open` raises; UnsupportedDevice (E-BRIDGE-KIND)."""
        who = await self._line.open(timeout_s)
        if who.kind != "gear":
            await self.close()
            raise UnsupportedDevice("E-BRIDGE-KIND", self.name, found=who.kind, wanted="gear")
        return Identity(
            driver="bridge-gear",
            model=f"{who.maker} {who.model}".strip(),
            serial=who.serial,
            firmware=who.firmware,
            notes=who.notices,
        )

    async def close(self) -> None:
        """Let go of the wire; never raises. A plan that runs goes on at the machine until it notices."""
        await self._line.close()

    def _hear(self, message: Message) -> None:
        if isinstance(message, Damaged):
            raise self._line.damaged(message)
        if isinstance(message, Notification) and message.method == gearrecords.POINTS:
            self._told.put_nowait(Chunk.read(message.params, self.name))
        elif isinstance(message, Notification) and message.method == gearrecords.DONE:
            self._told.put_nowait(Ending.read(message.params, self.name))

    def _lost(self, error: TrueflankError) -> None:
        self._told.put_nowait(error)

    async def part(self) -> ClampedPart:
        """What is clamped now."""
        return gearrecords.read_part(await self._line.call(gearrecords.PART), self.name)

    async def ambient(self) -> Ambient:
        """Environment readings; empty where the machine has no sensors."""
        try:
            return records.read_environment(await self._line.call(records.ENVIRONMENT), self.name)
        except DeviceRefused as error:
            if error.code == "E-BRIDGE-UNSUPPORTED":
                return Ambient()
            raise

    async def inspect(self, plan: GearPlan, progress: Callable[[str, int, int], None]) -> InspectedGear:
        """Measure. Raises DeviceRefused (E-GEAR-CLAMP, E-GEAR-ENDED), what the wire raises; aborts then.

        A machine that says nothing for ``gear_quiet_s`` is no longer waited for (E-LINK-STALE).
        """
        part = await self.part()
        if not part.clamped:
            raise DeviceRefused("E-GEAR-CLAMP", self.name)
        self._told = asyncio.Queue()
        answer = Fields(await self._line.call(gearrecords.MEASURE, gearrecords.plan_as_object(plan)), self.name)
        gathering = Gathering(answer.integer("plan"), plan, self.name)
        try:
            ending = await self._gather(gathering, progress)
            if ending.outcome != "complete":
                raise DeviceRefused("E-GEAR-ENDED", self.name, outcome=ending.outcome, said=ending.said)
        except BaseException:
            await self._abort_quietly()
            raise
        utc = self._clock.utc().isoformat(timespec="seconds")
        return gathering.record(ending, part, utc)

    async def _gather(self, gathering: Gathering, progress: Callable[[str, int, int], None]) -> Ending:
        while True:
            told = await self._next()
            if told.plan != gathering.number:
                continue  # left over from a plan that was aborted
            if isinstance(told, Ending):
                return told
            gathering.add(told)
            progress(told.trace, gathering.count, gathering.total)

    async def _next(self) -> Told:
        quiet_s = self._settings.gear_quiet_s
        try:
            async with self._clock.deadline(quiet_s, self.name):
                told = await self._told.get()
        except DeadlineExceeded as error:
            raise TransportError("E-LINK-STALE", self.name, stale_s=quiet_s) from error
        if isinstance(told, TrueflankError):
            raise told
        return told

    async def _abort_quietly(self) -> None:
        if self._line.works:
            with contextlib.suppress(TrueflankError):
                await self.abort()

    async def abort(self) -> None:
        """Stop measuring and retract. Raises what the wire raises."""
        await self._line.call(gearrecords.ABORT)
