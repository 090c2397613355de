"""A small machine behind a PLC mailbox for tests of the push: control, PLC, a person at the panel, and its judge.

The machine lives by its own clock and goes on whatever becomes of the gateway.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Coroutine, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from drivers.clock import Clock, LoopClock
from drivers.sinumerik.mailbox.device import SinumerikModbus
from drivers.types.identity import MachineIdentity
from drivers.types.orders import SignProof
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from gateway.axes import AxisRecord
from gateway.domain.proposals import TableChange
from gateway.push.compare import table_in
from gateway.push.context import PushContext
from simulators.instrument_server import WireWrapper
from simulators.modbus import PlcStation, make_station
from simulators.nck import AxisSpec, Nck, NckSpec
from simulators.nck.machine.data import CEC_ENABLE, ENC_ENABLE
from tests.placed import PLACES, placed
from tests.push.oracle import Oracle, content_of
from tests.signed import signed

URL = "memory://plc"
POINTS = 12
X_SPEC = AxisSpec("X1", "X", travel=(-100.0, 100.0), eec_points=(POINTS, 0), absolute_encoder=True)
Z_SPEC = AxisSpec("Z1", "Z", travel=(-100.0, 100.0), absolute_encoder=True)
X_AXIS = AxisRecord("X1", "X", "mm", False, False, (-100.0, 100.0), 0.0, 6000.0, overrun=5.0)
Z_AXIS = AxisRecord("Z1", "Z", "mm", False, False, (-100.0, 100.0), 0.0, 6000.0, overrun=5.0)
NOTHING = np.zeros(0)
NAME = "mill"


def table(*values: float, function: Any = "axis") -> CompensationTable:
    """A table of X1 in um over -90..90 mm, zero in the middle where the axis stands."""
    step = 180.0 / (len(values) - 1)
    return CompensationTable(function, "Z1" if function == "cross" else "X1", "X1", -90.0, 90.0, step, values)


OLD = table(0.0, 1.5, 3.0, 2.0, 1.0, 0.0, -1.0, -2.5, -3.5, -2.0, 0.0)
NEW = table(0.0, 3.0, 7.0, 5.5, 2.0, 0.0, -3.0, -6.0, -7.25, -4.125, 0.0)
OTHER = table(0.0, 2.0, 1.0, 3.5, 4.0, 0.0, 1.0, 2.0, 3.0, 1.0, 0.0)
NEVER = CompensationTable("axis", "X1", "X1", 0.0, 0.0, 0.0, (0.0,))


@dataclass(frozen=True)
class Scene:
    """What the machine is like. ``strict`` asks for NCK reset and reference run; ``cross`` pushes a CEC table.

    ``both``: the axis has memory for a table of its own beside it, never loaded; ``more``: for so many cross tables.
    """

    old_on: bool = True
    never: bool = False
    strict: bool = False
    cross: bool = False
    both: bool = False
    more: int = 0
    sign: int = 1
    points: int = 0
    plc: Mapping[str, Any] = field(default_factory=dict)
    nck: Mapping[str, Any] = field(default_factory=dict)

    @property
    def tables(self) -> tuple[LiveTable, CompensationTable]:
        """What is live before, and what is to be."""
        old, new = (NEVER if self.never else OLD), NEW
        if self.points:
            new, old = long(self.points, 1.0), long(self.points, 0.5)
        if self.cross:
            parts: dict[str, Any] = {"kind": "cross", "input_axis": "Z1"}
            old, new = replace(old, **parts), replace(new, **parts)
        return LiveTable(old, self.old_on and not self.never), new


def long(points: int, size: float) -> CompensationTable:
    """A table of that many points, zero at the reference."""
    places = np.linspace(-90.0, 90.0, points)
    values = np.round(size * 6.0 * np.sin(places / 15.0) + size * np.sin(places / 3.0), 3)
    return table(*(float(value) + 0.0 for value in values))


@dataclass
class Person:
    """Who jogs where told, presses the panel's button, and switches off and on where a table asks for it."""

    confirms: bool = True
    jogs: bool = True
    restarts: bool = True
    confirm_after_s: float = 0.0
    wishes: list[tuple[str, float]] = field(default_factory=list)
    restart_wanted: bool = False

    def hear(self, code: str, fields: Mapping[str, object]) -> None:
        """What the gateway says aloud."""
        if code == "P-PUSH-JOG":
            self.wishes.append((str(fields["axis"]), float(str(fields["position"]))))
        if code in ("P-PUSH-ACTIVATE", "P-PUSH-RESTART"):
            self.restart_wanted = True


class World:
    """One machine and all around it."""

    def __init__(self, scene: Scene, nck: Nck, station: PlcStation, clock: Clock) -> None:
        self.scene, self.nck, self.station, self.clock = scene, nck, station, clock
        old, new = scene.tables
        self.oracle = Oracle(nck, old, new, scene.sign)
        self.person = Person()
        self._tasks: set[asyncio.Task[None]] = set()

    def spawn(self, work: Coroutine[Any, Any, None]) -> None:
        """Let something happen beside all else; it ends with the world."""
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def work(self) -> None:
        """What the person does, for ever."""
        waited = 0.0
        while True:
            await self.clock.sleep(0.25)
            plc, person = self.station.plc, self.person
            waited = waited + 0.25 if plc.waiting else 0.0
            if plc.waiting and person.confirms and waited > person.confirm_after_s:
                plc.confirm()
            if self.nck.booting:
                continue
            if person.restart_wanted and person.restarts:
                person.restart_wanted = False
                if self.scene.strict:
                    await self.restart()
            while person.wishes and person.jogs and not self.nck.booting:
                axis, position = person.wishes.pop(0)
                await self.clock.sleep(self._jog(axis, position) + 0.3)

    def _jog(self, axis: str, position: float) -> float:
        """Seconds until the axis is there; nothing moves while the control does not let it."""
        if self.nck.mode != "JOG" and not self.nck.set_mode("JOG"):
            self.person.wishes.append((axis, position))
            return 1.0
        core = self.nck.core
        return float(core.move({core.axis(axis).index: position}, None))

    async def restart(self) -> None:
        """NCK reset, and everything referenced again."""
        self.nck.nck_reset()
        await self.ready()

    async def ready(self) -> None:
        """Wait for the control and reference what is not."""
        while self.nck.booting:
            await self.clock.sleep(0.2)
        for axis in self.nck.spec.axes:
            if not self.nck.axis_state(axis.name).referenced:
                self.nck.reference_axis(axis.name)
        while not all(self.nck.axis_state(axis.name).referenced for axis in self.nck.spec.axes):
            await self.clock.sleep(0.2)
        self.nck.set_mode("AUTO")

    def driver(self, **settings: Any) -> SinumerikModbus:
        """A driver at this PLC."""
        here = self.station.home
        return placed(SinumerikModbus("grinder", here, {**driver_settings(self.scene), **settings}, self.clock))

    async def __aenter__(self) -> World:
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


def driver_settings(scene: Scene) -> dict[str, Any]:
    """The driver's settings at this machine."""
    return {"needs_reference": scene.strict, "fast_poll_s": 0.05, "poll_s": 0.4, "command_s": 20.0}


@contextlib.asynccontextmanager
async def world(
    scene: Scene, clock: Clock | None = None, around: WireWrapper | None = None, url: str = URL
) -> AsyncIterator[World]:
    """A machine that is switched on, referenced, in AUTO, with the old table live."""
    clock = clock or LoopClock()
    nck = Nck(_spec(scene), clock)
    _preset(nck, scene)
    await nck.start()
    _switch(nck, scene)
    try:
        station = make_station(nck, clock, {"scan_s": 0.01, **scene.plc}, around)
        try:
            station.plc.on_session = station.plc.release.give
            await station.start(url)
            async with World(scene, nck, station, clock) as made:
                yield made
        finally:
            await station.stop()
    finally:
        await nck.stop()


def _spec(scene: Scene) -> NckSpec:
    count = scene.points or POINTS
    axis = replace(X_SPEC, eec_points=(count if scene.both or not scene.cross else 0, 0))
    changes = {"cec_sign": scene.sign, "strict_activation": scene.strict, **scene.nck}
    cec = (count,) * (1 + scene.more) if scene.cross else ()
    return NckSpec((axis, Z_SPEC) if scene.cross else (axis,), cec_points=cec, access_level=2, **changes)


def _preset(nck: Nck, scene: Scene) -> None:
    """The old table in memory, as it was when the machine was switched off."""
    old, _new = scene.tables
    memory = nck.core.memory
    held: Any = memory.cec[0] if scene.cross else memory.eec[0, 0]
    content = content_of(old.table, len(held.points), scene.sign)
    held.points = list(content.points)
    held.minimum, held.maximum, held.step, held.is_modulo = content.shape
    if scene.cross:
        held.input_axis, held.output_axis = "Z1", "X1"


def _switch(nck: Nck, scene: Scene) -> None:
    """The old table's switch, as somebody set it after the start."""
    old, _new = scene.tables
    if scene.cross:
        nck.core.data.store("$SN_CEC_TABLE_ENABLE", (0,), old.enabled)
        nck.core.data.store(CEC_ENABLE, (0,), old.enabled)
    else:
        nck.core.data.store(ENC_ENABLE, (0, 0), old.enabled)
    nck.core.newconf()


class Folder:
    """A run folder: texts, durable."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def write_text(self, name: str, text: str) -> Path:
        """Keep a text."""
        path = self.path / name
        path.write_text(text, encoding="utf-8")
        return path


def context_for(
    scene: Scene, device: SinumerikModbus, clock: Clock, root: Path, machine: MachineIdentity, **more: Any
) -> PushContext:
    """What a push or a recovery at this machine works with."""
    function: Any = "cross" if scene.cross else "axis"
    sign: Any = scene.sign if scene.cross else 1
    proof = SignProof(machine, function, "X1", -1.0 * sign, 0.01, sign, "2026-01-01T00:00:00+00:00")
    given: dict[str, Any] = {
        "proof": proof,
        "start_timeout_s": 60.0,
        "stop_timeout_s": 60.0,
        "approvals_needed": 1,
        "risk_taken": True,
        "modes": ("AUTO", "JOG"),
        "input": Z_AXIS if scene.cross else None,
        "actor": "anna",
    }
    folder = Folder(root)
    device.keep_to(PLACES)
    return PushContext(device, clock, folder, root / "journal", X_AXIS, machine, NAME, NAME, **{**given, **more})


def change_of(scene: Scene, live: LiveSet) -> TableChange:
    """The change from what is live to the scene's new table."""
    _old, new = scene.tables
    found = table_in(signed(live, scene.sign), new)
    return TableChange("X1", found.table, new, found.enabled, live.digest, NOTHING, NOTHING, NOTHING, base=live)
