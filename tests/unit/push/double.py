"""A small controller in memory with an operator beside it, faults on demand and a reaper that kills."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from drivers.clock import LoopClock
from drivers.errors import DeadlineExceeded, DeviceRefused
from drivers.types import (
    AxisState,
    ChannelStatus,
    CompensationTable,
    Identity,
    LiveSet,
    LiveTable,
    MachineIdentity,
    MachineState,
    PushOrder,
    SignProof,
    StopPlan,
    StopReached,
    TableLimits,
)
from gateway.domain import TableChange
from gateway.interlocks import value_at
from gateway.push import AxisFacts, PushContext, journal

MACHINE = MachineIdentity("SN-1", "V4.8", ("X1", "C1"))
PROOF = SignProof(MACHINE, "EEC", "X1", -1.0, 0.02, 1, "2026-11-21T09:00:00+00:00")
AXIS = AxisFacts("X1", "X", "mm", False, False, (0.0, 400.0), 0.0, 2000.0)
NOTHING = np.zeros(0)


def table(*values: float, step: float = 50.0) -> CompensationTable:
    return CompensationTable("EEC", "X1", "X1", 0.0, step * (len(values) - 1), step, values)


OLD = table(0.0, 2.0, 4.0, 6.0, 4.0, 2.0, 0.0, -2.0, 0.0)
NEW = table(0.0, 5.0, 12.0, 15.5, 9.0, 4.0, -3.0, -6.0, 0.0)
NEVER = CompensationTable("EEC", "X1", "X1", 0.0, 0.0, 0.0, (0.0,))


class Killed(BaseException):
    """The process is gone: nobody may catch this."""


@dataclass(slots=True)
class Reaper:
    """Counts steps and kills at one of them."""

    at: int = -1
    count: int = 0

    def tick(self) -> None:
        self.count += 1
        if self.count - 1 == self.at:
            raise Killed


@dataclass(slots=True)
class Machine:
    """The control's memory and its operator. ``acting`` is the table content in effect, if enabled."""

    eec: LiveTable
    cec: tuple[LiveTable, ...] = ()
    backlash: float = 0.002
    identity: MachineIdentity = MACHINE
    acting: CompensationTable = OLD
    channel: ChannelStatus = ChannelStatus.RESET
    mode: str = "AUTO"
    alarms: tuple[int, ...] = ()
    access_level: int = 2
    referenced: bool = True
    standing: bool = True
    position: float = 0.0
    reserved: int = 100
    plan: StopPlan | None = None
    order: PushOrder | None = None
    phase: int = 0
    release: int = 0
    operator: bool = True
    saved: LiveSet | None = None
    backup: LiveSet | None = None
    readback: LiveSet | None = None
    wrong_point: float = 0.0
    ignore_release: bool = False
    ignore_reset: bool = False
    quantum: float = 0.0
    writes: list[str] = field(default_factory=list)
    history: list[LiveTable] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.acting = self.eec.table

    def live(self) -> LiveSet:
        parts = [asdict(self.eec), [asdict(one) for one in self.cec], self.backlash]
        native = json.dumps(parts)
        digest = hashlib.sha256(native.encode()).hexdigest()
        return LiveSet("X1", self.eec, self.cec, self.backlash, native, digest)

    def become(self, eec: LiveTable) -> None:
        self.eec = eec
        self.history.append(eec)

    @property
    def compensation(self) -> float:
        return value_at(self.acting, self.position) if self.eec.enabled and self.referenced else 0.0

    def start_push(self) -> None:
        """First half, after NC START."""
        order = self.order
        if order is None or self.phase:
            return
        self.backup = self.live()
        self.position = order.agreeing_position
        self.become(LiveTable(self.eec.table, enabled=False))
        half = order.table.deviations[: len(order.table.deviations) // 2]
        rest = self.eec.table.deviations[len(half) : len(order.table.deviations)]
        self.become(LiveTable(replace(order.table, deviations=half + rest), enabled=False))
        self.writes.append(order.purpose)
        self.become(LiveTable(self._stored(order.table), enabled=False))
        self.readback, self.phase, self.channel = self.live(), 4, ChannelStatus.INTERRUPTED

    def _stored(self, wanted: CompensationTable) -> CompensationTable:
        values = np.array(wanted.deviations)
        values[len(values) // 2] += self.wrong_point
        if self.quantum:
            values = np.round(values / self.quantum) * self.quantum
        return replace(wanted, deviations=tuple(float(value) for value in values))

    def go_on(self) -> None:
        """Second half, after the second NC START."""
        if self.order is None or self.phase != 4:
            return
        released = self.release == self.order.transaction and not self.ignore_release
        if released and self.order.enable:
            self.become(LiveTable(self.eec.table, enabled=True))
            self.phase, self.channel = 5, ChannelStatus.INTERRUPTED
            return
        self.end()

    def end(self) -> None:
        """RESET or the program's other end: nothing is enabled by it."""
        self.channel, self.phase, self.order, self.plan = ChannelStatus.RESET, 9, None, None

    def nck_reset(self) -> None:
        self.end()
        if not self.ignore_reset:
            self.acting = self.eec.table
        self.position = 0.0


Fault = Callable[[Machine], None]


class Controller:
    """The port, over a `Machine`. ``faults`` maps (call, nth from 1, "before" or "after") to what happens."""

    name = "double"

    def __init__(self, machine: Machine, clock: LoopClock, reaper: Reaper | None = None) -> None:
        self.machine = machine
        self.clock = clock
        self.reaper = reaper or Reaper()
        self.faults: dict[tuple[str, int, str], Fault] = {}
        self.calls: dict[str, int] = {}

    async def _begin(self, call: str) -> int:
        self.calls[call] = self.calls.get(call, 0) + 1
        await self.clock.sleep(0.01)
        self.reaper.tick()
        self._fault(call, self.calls[call], "before")
        return self.calls[call]

    def _end(self, call: str, number: int) -> None:
        self._fault(call, number, "after")
        self.reaper.tick()

    def _fault(self, call: str, number: int, when: str) -> None:
        for key in ((call, number, when), (call, 0, when)):
            if key in self.faults:
                self.faults[key](self.machine)

    async def open(self, timeout_s: float) -> Identity:
        return Identity("double", "double", self.machine.identity.serial)

    async def close(self) -> None:
        return None

    async def identify(self) -> MachineIdentity:
        number = await self._begin("identify")
        self._end("identify", number)
        return self.machine.identity

    async def state(self) -> MachineState:
        number = await self._begin("state")
        m = self.machine
        axis = AxisState("X1", m.position, m.referenced, m.standing, m.compensation, 0.0, "mm")
        self._end("state", number)
        return MachineState(m.channel, m.mode, "", m.alarms, m.access_level, {"X1": axis})

    async def table_limits(self, axis: str) -> TableLimits:
        number = await self._begin("table_limits")
        self._end("table_limits", number)
        return TableLimits(self.machine.reserved, 1e-6, 1.0)

    async def prepare_stops(self, plan: StopPlan) -> None:
        number = await self._begin("prepare_stops")
        self._in_reset()
        m = self.machine
        m.plan, m.order, m.phase, m.saved = plan, None, 0, None
        self._end("prepare_stops", number)

    def _in_reset(self) -> None:
        if self.machine.channel is not ChannelStatus.RESET:
            raise DeviceRefused("E-TEST-RESET", "double")

    async def wait_stop(self, after: int, timeout_s: float) -> StopReached | None:
        number = await self._begin("wait_stop")
        await self._operator(timeout_s)
        m = self.machine
        if m.plan is None:
            raise DeadlineExceeded("E-LINK-DEADLINE", "double", timeout_s=timeout_s)
        if m.saved is None:
            m.saved = m.live()
        if after >= len(m.plan.stops):
            m.end()
            self._end("wait_stop", number)
            return None
        stop = m.plan.stops[after]
        m.channel, m.position = ChannelStatus.ACTIVE, stop.target
        if stop.switch is not None:
            m.become(LiveTable(m.eec.table, stop.switch))
        found = StopReached(after + 1, stop.repetition, stop.label, stop.approach, stop.target, m.compensation, 0.0)
        self._end("wait_stop", number)
        return found

    async def _operator(self, timeout_s: float) -> None:
        if not self.machine.operator:
            await self.clock.sleep(timeout_s)
            raise DeadlineExceeded("E-LINK-DEADLINE", "double", timeout_s=timeout_s)
        await self.clock.sleep(1.0)

    async def release_stop(self, counter: int) -> None:
        number = await self._begin("release_stop")
        self._end("release_stop", number)

    async def abort_program(self) -> None:
        number = await self._begin("abort_program")
        if self.machine.operator and self.machine.channel is not ChannelStatus.RESET:
            self.machine.end()
        self._end("abort_program", number)

    async def saved_tables(self, axis: str) -> LiveSet:
        number = await self._begin("saved_tables")
        saved = self.machine.saved
        self._end("saved_tables", number)
        if saved is None:
            raise DeviceRefused("E-TEST-FILE", "double")
        return saved

    async def prepare_push(self, order: PushOrder) -> None:
        number = await self._begin("prepare_push")
        self._in_reset()
        m = self.machine
        m.order, m.plan, m.phase, m.release = order, None, 0, 0
        self._end("prepare_push", number)

    async def wait_loaded(self, order: PushOrder, timeout_s: float) -> tuple[LiveSet, LiveSet]:
        number = await self._begin("wait_loaded")
        await self._operator(timeout_s)
        self.machine.start_push()
        self._end("wait_loaded", number)
        backup, readback = self.machine.backup, self.machine.readback
        if backup is None or readback is None:
            raise DeviceRefused("E-TEST-FILE", "double")
        return backup, readback

    async def release_push(self, order: PushOrder) -> None:
        number = await self._begin("release_push")
        self.machine.release = order.transaction
        self._end("release_push", number)

    async def wait_enabled(self, order: PushOrder, timeout_s: float) -> bool:
        number = await self._begin("wait_enabled")
        await self._operator(timeout_s)
        self.machine.go_on()
        self._end("wait_enabled", number)
        return self.machine.phase == 5

    async def wait_activated(self, order: PushOrder, timeout_s: float) -> None:
        number = await self._begin("wait_activated")
        await self._operator(timeout_s)
        self.machine.nck_reset()
        self._end("wait_activated", number)


class Folder:
    """Keeps texts on disk as a run folder does."""

    def __init__(self, path: Path, reaper: Reaper | None = None) -> None:
        self.path = path
        self.reaper = reaper or Reaper()

    def write_text(self, name: str, text: str) -> Path:
        self.reaper.tick()
        (self.path / name).write_text(text)
        self.reaper.tick()
        return self.path / name


@dataclass(slots=True)
class Bench:
    """A machine, its port and a context to push with."""

    machine: Machine
    controller: Controller
    context: PushContext
    told: list[tuple[str, dict[str, object]]]


def bench(
    root: Path, old: LiveTable | None = None, reaper: Reaper | None = None, machine: Machine | None = None
) -> Bench:
    """Fresh, or over a machine that is already there."""
    clock = LoopClock(started_utc=datetime(2026, 11, 21, 10, tzinfo=UTC))
    machine = machine or Machine(old or LiveTable(OLD, enabled=True))
    controller = Controller(machine, clock, reaper)
    told: list[tuple[str, dict[str, object]]] = []

    def say(code: str, /, **fields: object) -> None:
        told.append((code, fields))

    context = PushContext(
        controller, clock, Folder(root, reaper), root / "journal", AXIS, MACHINE, "mill", "mill", PROOF, say=say
    )
    return Bench(machine, controller, context, told)


def change_of(machine: Machine, new: CompensationTable = NEW) -> TableChange:
    """The change as a capture made now would propose it."""
    live = machine.live()
    return TableChange("X1", live.eec.table, new, live.eec.enabled, live.digest, NOTHING, NOTHING, NOTHING)


def journals_of(root: Path) -> Sequence[journal.JournalRead]:
    folder = journal.machine_folder(root / "journal", MACHINE.serial)
    return (*journal.all_of(folder), *journal.all_of(folder / "done"))


def only_old_or_new_enabled(machine: Machine, *allowed: CompensationTable) -> bool:
    """The invariant, over everything the machine ever held."""
    return all(not live.enabled or live.table in allowed for live in [*machine.history, machine.eec])


def deadline(_machine: Machine) -> None:
    raise DeadlineExceeded("E-LINK-DEADLINE", "double", timeout_s=1.0)


def refuse(_machine: Machine) -> None:
    raise DeviceRefused("E-TEST-REFUSED", "double")


def changing(**values: Any) -> Fault:
    def act(machine: Machine) -> None:
        for name, value in values.items():
            setattr(machine, name, value)

    return act
