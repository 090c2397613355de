"""A control, its OPC UA server, an operator at the panel and our driver, in one loop of virtual time."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from drivers.clock import LoopClock
from drivers.sinumerik.opcua.device import SinumerikOpcUa
from drivers.types.orders import PushOrder
from drivers.types.stops import Stop, StopPlan, StopReached
from drivers.types.tables import CompensationTable, LiveSet
from simulators.nck import AxisSpec, Nck, NckSpec
from simulators.opcua import SinumerikServer
from tests.batches import sets_of

AXES = (
    AxisSpec("X1", "X", travel=(-250.0, 250.0), eec_points=(81, 81)),
    AxisSpec("Z1", "Z", travel=(0.0, 600.0), eec_points=(10, 0)),
    AxisSpec("C1", "C", rotary=True, modulo=True, eec_points=(80, 0)),
)
SPEC = NckSpec(AXES, cec_points=(0, 10), access_level=2, files_max_bytes=65536)
USER = {"user": "trueflank", "password": "trueflank"}
PLAIN = {**USER, "security": "None", "poll_s": 0.2}

WAVE = (0.0, *(((n * 7) % 13 - 6) * 0.36 for n in range(1, 72)), 0.0)
TABLE_C = CompensationTable("axis", "C1", "C1", 0.0, 360.0, 5.0, WAVE, modulo=True, input_unit="deg", output_unit="deg")
ORDER = PushOrder(4711, TABLE_C, "C", True, True, 0.0, "sign-proof")


def plan(stops: tuple[Stop, ...], **more: Any) -> StopPlan:
    return replace(StopPlan("T", "C1", "C", "deg", True, stops, 3600.0, 5.0, 0.5), **more)


@dataclass
class Stage:
    """Everything a test touches. ``pressed`` lists what the operator did."""

    clock: LoopClock
    nck: Nck
    server: SinumerikServer
    device: SinumerikOpcUa
    pressed: list[str] = field(default_factory=list)
    restarts: bool = True

    def driver(self, **settings: Any) -> SinumerikOpcUa:
        """Another driver for the same server."""
        return SinumerikOpcUa("840D", self.server.url, {**PLAIN, **settings}, self.clock)

    def press(self) -> None:
        """NC START; the operator presses it for a selected program."""
        assert self.nck.nc_start(), self.nck.alarms

    async def asked(self, work: Coroutine[Any, Any, Any], told: list[str]) -> Any:
        """Do a piece of the talk while somebody presses NC START once ``told`` to."""
        before, task = len(told), asyncio.ensure_future(work)
        while len(told) == before and not task.done():
            await self.clock.sleep(0.1)
        if not task.done():
            self.press()
        return await task

    async def operate(self) -> None:
        """Do what MSG says, as the auto operator of a cell does."""
        while True:
            await self.clock.sleep(0.25)
            if self.nck.channel_status != 2 or self.nck.alarms:
                continue
            message = self.nck.message
            if message.startswith(("TRUEFLANK SETUP ", "TRUEFLANK LOAD BLANK ", "TRUEFLANK UNLOAD PART ")):
                self.pressed.append("setup")
                self.nck.nc_start()
            elif message.startswith("TRUEFLANK ACTIVATE NCK RESET AND REFERENCE ") and self.restarts:
                self.pressed.append("activate")
                await self.restart()

    async def restart(self) -> None:
        """NCK reset, reference run of all axes, back to AUTO."""
        self.nck.nck_reset()
        await self.referenced()

    async def referenced(self) -> None:
        """Reference all axes and choose AUTO."""
        while self.nck.booting:
            await self.clock.sleep(0.5)
        for axis in self.nck.spec.axes:
            self.nck.reference_axis(axis.name)
        while not all(self.nck.axis_state(axis.name).referenced for axis in self.nck.spec.axes):
            await self.clock.sleep(0.1)
        self.nck.set_mode("AUTO")

    async def walk(
        self, stops: StopPlan, at_stop: Callable[[StopReached], Awaitable[None]] | None = None
    ) -> list[StopReached]:
        """Run a plan to its end."""
        await self.device.prepare_stops(stops)
        self.press()
        seen: list[StopReached] = []
        while (stop := await self.device.wait_stop(seen[-1].counter if seen else 0, 120.0)) is not None:
            seen.append(stop)
            if at_stop:
                await at_stop(stop)
            await self.device.release_stop(stop.counter)
        return seen

    async def loaded(self, order: PushOrder) -> tuple[LiveSet, LiveSet]:
        """First half."""
        await self.device.stage((order,))
        self.press()
        return sets_of(await self.device.read_back((order,), 120.0))

    async def push(self, order: PushOrder) -> bool:
        """Both halves and the activation."""
        await self.loaded(order)
        await self.device.activate((order,), (order,))
        (enabled,) = await self.device.confirm((order,), 120.0)
        if enabled:
            await self.device.restarted((order,), 120.0)
        return enabled

    def memory(self, axis: str = "C1") -> tuple[Any, ...]:
        """All that the control holds of an axis' EEC table, leftovers too, and its switch."""
        points = next(one for one in self.nck.spec.axes if one.name == axis).eec_points[0]
        names = [f"$AA_ENC_COMP[0,{n},{axis}]" for n in range(points)]
        names += [f"$AA_ENC_COMP_{part}[0,{axis}]" for part in ("STEP", "MIN", "MAX", "IS_MODULO")]
        return tuple(self.nck.get(name) for name in [*names, f"$MA_ENC_COMP_ENABLE[0,{axis}]"])

    @property
    def enabled(self) -> bool:
        """MD32700 of C1."""
        return bool(self.nck.get("$MA_ENC_COMP_ENABLE[0,C1]"))


@contextlib.asynccontextmanager
async def stage(spec: NckSpec, server: dict[str, Any], settings: dict[str, Any]) -> AsyncIterator[Stage]:
    """A stage with all axes referenced, in AUTO, and the driver open."""
    clock = LoopClock()
    nck = Nck(spec, clock)
    await nck.start()
    served = SinumerikServer(nck, clock, server)
    await served.start()
    device = SinumerikOpcUa("840D", served.url, {**PLAIN, **settings}, clock)
    made = Stage(clock, nck, served, device)
    operator = asyncio.get_running_loop().create_task(made.operate())
    try:
        await made.referenced()
        await device.open(5.0)
        yield made
    finally:
        operator.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await operator
        await device.close()
        await served.stop()
        await nck.stop()


@contextlib.asynccontextmanager
async def on_stage(
    spec: NckSpec = SPEC,
    server: dict[str, Any] | None = None,
    settings: dict[str, Any] | None = None,
    folder: Path | None = None,
) -> AsyncIterator[Stage]:
    """A stage for the length of a test; afterwards no session or connection may be left."""
    keys = {"folder": str(folder)} if folder else {}
    async with stage(spec, {**keys, **(server or {})}, settings or {}) as made:
        yield made
    assert made.server.sessions == 0
