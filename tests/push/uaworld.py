"""A small machine behind OPC UA for tests of the push: control, server, a person at the panel, and its judge."""

from __future__ import annotations

import asyncio
import contextlib
import random
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from drivers.clock import Clock
from drivers.sinumerik.opcua.device import SinumerikOpcUa
from drivers.types.identity import MachineIdentity
from drivers.types.orders import SignProof
from drivers.types.stops import Stop, StopPlan
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from gateway.axes import AxisRecord
from gateway.domain.proposals import TableChange
from gateway.push.compare import table_in
from gateway.push.context import PushContext
from simulators.nck import AxisSpec, Nck, NckSpec
from simulators.nck.machine.data import CEC_ENABLE, ENC_ENABLE
from simulators.opcua import SinumerikServer
from tests.placed import PLACES, placed
from tests.push.oracle import Oracle, content_of
from tests.push.world import NAME, NEW, NOTHING, OLD, POINTS, Folder, Scene
from tests.selftested import passed

SETTINGS: Mapping[str, Any] = {"user": "trueflank", "password": "trueflank", "security": "None", "poll_s": 0.2}
X_SPEC = AxisSpec("X1", "X", travel=(-100.0, 100.0), eec_points=(POINTS, 0))
Z_SPEC = AxisSpec("Z1", "Z", travel=(-100.0, 100.0))
X_AXIS = AxisRecord("X1", "X", "mm", False, False, (-100.0, 100.0), 0.0, 6000.0, dwell_s=0.2)
Z_AXIS = AxisRecord("Z1", "Z", "mm", False, False, (-100.0, 100.0), 0.0, 6000.0, dwell_s=0.2)
CROSS = Scene(cross=True)


@dataclass
class UaPerson:
    """Who presses NC START for what was selected, and does what MSG or the gateway says."""

    starts: bool = True
    restarts: bool = True
    resets: bool = True
    after_s: float = 0.0
    wishes: list[str] = field(default_factory=list)
    leaves_at: str = ""  # goes home when this is said

    def hear(self, code: str, _fields: Mapping[str, object]) -> None:
        """What the gateway says aloud."""
        if code == self.leaves_at:
            self.starts = self.restarts = self.resets = False
        if code in ("P-PUSH-RESET", "P-PUSH-RESTART"):
            self.wishes.append(code)


class UaWorld:
    """One machine and all around it."""

    def __init__(self, nck: Nck, server: SinumerikServer, clock: Clock, old: LiveTable, new: CompensationTable) -> None:
        self.nck, self.server, self.clock, self.new = nck, server, clock, new
        self.oracle = Oracle(nck, old, new)
        self.person = UaPerson()
        self._selected = 0
        self._started = 0
        self._tasks: set[asyncio.Task[None]] = set()
        select = nck.select

        def selecting(path: str, channel: int = 1) -> int:
            answer = select(path, channel)
            self._selected += answer == 0
            return answer

        nck.select = selecting  # type: ignore[method-assign]

    def spawn(self, work: Any) -> None:
        """Let something happen beside all else; it ends with the world."""
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def work(self) -> None:
        """What the person does, for ever."""
        while True:
            await self.clock.sleep(0.25 + self.person.after_s)
            if not self.nck.booting:
                await self._act()

    async def _act(self) -> None:
        nck, person = self.nck, self.person
        if person.wishes:
            await self._do(person.wishes.pop(0))
            return
        if nck.channel_status == 0 and self._selected > self._started and person.starts:
            self._started = self._selected
            nck.nc_start()
        if nck.channel_status != 2 or nck.alarms:
            return
        message = nck.message
        if message.startswith("TRUEFLANK ACTIVATE") and person.restarts:
            await self.restart()

    async def _do(self, wish: str) -> None:
        if wish == "P-PUSH-RESET" and self.person.resets:
            self.nck.channel_reset()
        if wish == "P-PUSH-RESTART" and self.person.restarts:
            await self.restart()

    async def restart(self) -> None:
        """NCK reset, and everything referenced again."""
        self.nck.nck_reset()
        await self.ready()

    async def ready(self) -> None:
        """Wait for the control, reference all axes and choose AUTO."""
        while self.nck.booting:
            await self.clock.sleep(0.5)
        for axis in self.nck.spec.axes:
            if not self.nck.axis_state(axis.name).referenced:
                self.nck.reference_axis(axis.name)
        while not all(self.nck.axis_state(axis.name).referenced for axis in self.nck.spec.axes):
            await self.clock.sleep(0.1)
            if self.nck.booting:
                return
        self.nck.set_mode("AUTO")

    def driver(self, **settings: Any) -> SinumerikOpcUa:
        """A driver at this server."""
        return placed(SinumerikOpcUa("840D", self.server.url, {**SETTINGS, **settings}, self.clock))

    async def base(self, device: SinumerikOpcUa) -> LiveSet:
        """The live tables, saved by a program as a measurement does."""
        stops = (Stop(0.0, -1),)
        await device.prepare_stops(StopPlan("T", "X1", "X", "mm", False, stops, 3600.0, 5.0, 0.2))
        counter = 0
        while (stop := await device.wait_stop(counter, 120.0)) is not None:
            counter = stop.counter
            await device.release_stop(counter)
        return await device.saved_tables("X1")

    async def __aenter__(self) -> UaWorld:
        await self.ready()
        self.spawn(self.work())
        return self

    async def __aexit__(self, *_why: object) -> None:
        tasks = tuple(self._tasks)
        for task in tasks:
            task.cancel()
        for ended in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(ended, Exception):
                raise ended


@contextlib.asynccontextmanager
async def ua_world(
    clock: Clock,
    keys: Path,
    old: LiveTable | None = None,
    new: CompensationTable = NEW,
    security: tuple[str, ...] = ("None",),
    **switches: Any,
) -> AsyncIterator[UaWorld]:
    """A machine that is switched on, referenced, in AUTO, with the old table live; ``keys`` keeps the server's."""
    old = LiveTable(OLD, True) if old is None else old
    cross = new.kind == "cross"
    spec = NckSpec((X_SPEC, Z_SPEC), cec_points=(POINTS, 2)) if cross else NckSpec((X_SPEC,))
    nck = Nck(replace(spec, access_level=2, files_max_bytes=65536, **switches), clock)
    held: Any = nck.core.memory.cec[0] if cross else nck.core.memory.eec[0, 0]
    content = content_of(old.table, len(held.points))
    held.points = list(content.points)
    held.minimum, held.maximum, held.step, held.is_modulo = content.shape
    if cross:
        held.input_axis, held.output_axis = "Z1", "X1"
    await nck.start()
    for name, place in (("$SN_CEC_TABLE_ENABLE", (0,)), (CEC_ENABLE, (0,))) if cross else ((ENC_ENABLE, (0, 0)),):
        nck.core.data.store(name, place, old.enabled)
    nck.core.newconf()
    server = SinumerikServer(nck, clock, {"folder": str(keys), "security": security})
    await server.start()
    try:
        async with UaWorld(nck, server, clock, old, new) as made:
            yield made
            server = made.server
    finally:
        await server.stop()
        await nck.stop()


def ua_context(controller: Any, clock: Clock, root: Path, machine: MachineIdentity, **more: Any) -> PushContext:
    """What a push or a recovery at this machine works with."""
    function: Any = "cross" if more.get("input") else "axis"
    proof = SignProof(machine, function, "X1", -1.0, 0.01, 1, "2026-01-01T00:00:00+00:00")
    controller.keep_to(PLACES)
    given: dict[str, Any] = {"self_test": passed(machine)}
    given |= {
        "proof": proof,
        "start_timeout_s": 60.0,
        "approvals_needed": 1,
        "risk_taken": True,
        "actor": "anna",
        **more,
    }
    return PushContext(controller, clock, Folder(root), root / "journal", X_AXIS, machine, NAME, NAME, **given)


def ua_change(live: LiveSet, new: CompensationTable) -> TableChange:
    """The change from what is live to the new table."""
    found = table_in(live, new)
    return TableChange("X1", found.table, new, found.enabled, live.digest, NOTHING, NOTHING, NOTHING, base=live)


def never_loaded() -> LiveTable:
    """Nothing was ever loaded."""
    return LiveTable(CompensationTable("axis", "X1", "X1", 0.0, 0.0, 0.0, (0.0,)), False)


def choice(rng: random.Random) -> LiveTable:
    """What may be live before a push."""
    return rng.choice((LiveTable(OLD, True), LiveTable(OLD, True), LiveTable(OLD, False), never_loaded()))
