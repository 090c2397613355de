"""A small controller in memory with an operator beside it, faults on demand and a reaper that kills."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np

from drivers.clock import LoopClock
from drivers.errors import DeadlineExceeded, DeviceRefused, UnsupportedDevice
from drivers.ports.devices import Tell
from drivers.safe_positions import SafePositionMixin
from drivers.sinumerik.opcua.device import read_live_tables
from drivers.sinumerik.tablefile import tables
from drivers.sinumerik.tablefile.tables import HELD_KINDS
from drivers.types.abilities import Capabilities, Marker, TableLimits
from drivers.types.identity import Identity, MachineIdentity
from drivers.types.machine import AxisState, ChannelStatus, MachineState
from drivers.types.orders import DisableOrder, PushBatch, PushOrder, ReadBack, SignProof, SwitchReading, TableQuestion
from drivers.types.stops import StopPlan, StopReached
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from drivers.types.values import Sense
from gateway.axes import AxisRecord
from gateway.domain.proposals import TableChange
from gateway.interlocks.facts import value_at
from gateway.push import journal
from gateway.push.context import PushContext
from tests.placed import PLACES
from tests.signed import signed

MACHINE = MachineIdentity("SN-1", "V4.8", ("X1", "Z1"))
PROOF = SignProof(MACHINE, "axis", "X1", -1.0, 0.02, 1, "2026-11-21T09:00:00+00:00")
AXIS = AxisRecord("X1", "X", "mm", False, False, (0.0, 400.0), 0.0, 2000.0)
Z_AXIS = AxisRecord("Z1", "Z", "mm", False, False, (0.0, 400.0), 0.0, 2000.0)
NOTHING = np.zeros(0)


def table(*values: float, step: float = 50.0) -> CompensationTable:
    return CompensationTable("axis", "X1", "X1", 0.0, step * (len(values) - 1), step, values)


OLD = table(0.0, 2.0, 4.0, 6.0, 4.0, 2.0, 0.0, -2.0, 0.0)
NEW = table(0.0, 5.0, 12.0, 15.5, 9.0, 4.0, -3.0, -6.0, 0.0)
NEVER = CompensationTable("axis", "X1", "X1", 0.0, 0.0, 0.0, (0.0,))


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
    """The control's memory and its operator. ``acting`` is the table content in effect, if enabled.

    ``cross`` are stored values with their own switch (SD41300); ``cec_on`` is the switch of the output axis X1
    (MD32710) over all of them; ``acting_cec`` their content in effect. ``jumps`` is how far each switching moved
    X1.
    """

    own: LiveTable
    cross: tuple[LiveTable, ...] = ()
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
    z_position: float = 0.0
    reserved: int = 100
    plan: StopPlan | None = None
    orders: PushBatch = ()
    passed: PushBatch = ()
    phase: int = 0
    release: int = 0
    operator: bool = True
    saved: LiveSet | None = None
    backup: LiveSet | None = None
    backup_number: int = 0
    readback: LiveSet | None = None
    wrong_point: float = 0.0
    wrong_index: int | None = None
    stops_after: int | None = None
    ignore_release: bool = False
    ignore_reset: bool = False
    quantum: float = 0.0
    writes: list[str] = field(default_factory=list)
    history: list[LiveTable] = field(default_factory=list)
    cec_on: bool = True
    acting_cec: dict[int, CompensationTable] = field(default_factory=dict)
    others: tuple[LiveTable, ...] = ()
    marker: Marker = field(default_factory=lambda: Marker(0, "none"))
    forgets_marker: bool = False
    jumps: list[float] = field(default_factory=list)
    shown_sense: float = 1.0
    keeps_grids: bool = False
    stuck_on: bool = False

    def __post_init__(self) -> None:
        self.acting = self.own.table
        self.acting_cec = {one.table.index: one.table for one in self.cross}

    def live(self, sign: int = 1) -> LiveSet:
        cec = tuple(LiveTable(one.table, one.enabled and self.cec_on) for one in self.cross if one.table.step > 0)
        parts = [asdict(self.own), [asdict(one) for one in cec], self.backlash, [asdict(one) for one in self.others]]
        native = json.dumps(parts)
        digest = hashlib.sha256(native.encode()).hexdigest()
        return signed(LiveSet("X1", self.own, cec, self.backlash, native, digest, self.others), sign)

    def become(self, own: LiveTable) -> None:
        before = self.compensation
        self.own = own
        self.history.append(own)
        self.jumps.append(self.compensation - before)

    def become_cec(self, table: CompensationTable, *, switch: bool, axis_on: bool) -> None:
        before = self.crossing
        kept = tuple(one for one in self.cross if one.table.index != table.index)
        self.cross = tuple(sorted((*kept, LiveTable(table, switch)), key=lambda one: one.table.index))
        self.cec_on = axis_on
        self.history.append(LiveTable(table, switch and axis_on))
        self.jumps.append(self.crossing - before)

    def held(self, wanted: CompensationTable) -> CompensationTable:
        if wanted.kind == "axis":
            return self.own.table
        return next((one.table for one in self.cross if one.table.index == wanted.index), replace(wanted, step=0.0))

    def put(self, table: CompensationTable, *, enabled: bool, axis_on: bool = False) -> None:
        if table.kind == "axis":
            self.become(LiveTable(table, enabled))
        else:
            self.become_cec(table, switch=enabled, axis_on=axis_on)

    @property
    def compensation(self) -> float:
        return value_at(self.acting, self.position) if self.own.enabled and self.referenced else 0.0

    def place(self, axis: str) -> float:
        return self.position if axis == "X1" else self.z_position

    def go(self, axis: str, position: float) -> None:
        if axis == "X1":
            self.position = position
        else:
            self.z_position = position

    @property
    def crossing(self) -> float:
        if not (self.cec_on and self.referenced):
            return 0.0
        on = [self.acting_cec.get(one.table.index) for one in self.cross if one.enabled]
        return sum(value_at(one, self.place(one.input_axis)) for one in on if one is not None)

    def start_push(self, *, moves: bool = True) -> None:
        """First half, after NC START."""
        if not self.orders or self.phase:
            return
        self.keep_backup(self.orders)
        for order in self.orders:
            if moves:
                self.go(order.table.input_axis, order.agreeing_position)
            self.put(self.held(order.table), enabled=False)
        for number, order in enumerate(self.orders):
            if number == self.stops_after:  # RESET at the panel
                self.stops_after = None
                self.end()
                raise DeviceRefused("E-TEST-REFUSED", "double")
            self._load(order)
        self.readback, self.phase = self.live(_sign(self.orders[0])), 4
        self.channel = ChannelStatus.INTERRUPTED

    def _load(self, order: PushOrder) -> None:
        old, new = self.held(order.table), self._stored(order)
        if new.step <= 0 and self.keeps_grids:  # a road that cannot take a grid back writes zeros on it
            new = replace(old, deviations=(0.0,) * len(old.deviations))
        half = new.deviations[: len(new.deviations) // 2]
        rest = old.deviations[len(half) : len(new.deviations)]
        self.put(replace(new, deviations=half + rest), enabled=False)
        self.writes.append(order.purpose)
        self.put(new, enabled=False)

    def keep_backup(self, batch: PushBatch) -> None:
        """Under the batch's number; CEC as deviations by its proof."""
        self.backup, self.backup_number = self.live(_sign(batch[0])), batch[0].transaction

    def _stored(self, order: PushOrder) -> CompensationTable:
        wanted = order.table
        values = np.array(wanted.deviations) * _sign(order)
        if self.wrong_index in (None, wanted.index):
            values[len(values) // 2] += self.wrong_point
        if self.quantum:
            values = np.round(values / self.quantum) * self.quantum
        return replace(wanted, deviations=tuple(float(value) + 0.0 for value in values))

    def go_on(self) -> None:
        """Second half, after the second NC START."""
        if not self.orders or self.phase != 4:
            return
        released = self.release == self.orders[0].transaction and not self.ignore_release
        for order in self.passed if released else ():
            table = self.held(order.table)
            if order.enable:
                self.put(table, enabled=True, axis_on=True)
                self.phase, self.channel = 5, ChannelStatus.INTERRUPTED
            elif table.kind == "cross" and (order.coupled or order.purpose == "sign-proof"):
                self.put(table, enabled=False, axis_on=True)
        if self.phase != 5:
            self.end()

    def end(self) -> None:
        """RESET or the program's other end: nothing is enabled by it."""
        self.channel, self.phase, self.orders, self.plan = ChannelStatus.RESET, 9, (), None

    def reading(self, order: DisableOrder) -> SwitchReading:
        if order.kind == "axis":
            return SwitchReading(self.own.enabled, self.compensation)
        table = any(one.enabled and one.table.index == order.index for one in self.cross)
        return SwitchReading(table if table == self.cec_on else None, self.crossing)

    def switch_off(self, order: DisableOrder) -> None:
        if self.stuck_on:
            return
        if order.kind == "axis":
            self.become(LiveTable(self.own.table, enabled=False))
            return
        kept = [LiveTable(one.table, one.enabled and one.table.index != order.index) for one in self.cross]
        self.cross, self.cec_on = tuple(kept), False

    def nck_reset(self) -> None:
        self.end()
        if not self.ignore_reset:
            self.acting = self.own.table
            self.acting_cec = {one.table.index: one.table for one in self.cross}
        self.position = self.z_position = 0.0


def _sign(order: PushOrder) -> int:
    cross = order.table.kind == "cross" and order.proof is not None
    return order.proof.sign if cross and order.proof is not None else 1


Fault = Callable[[Machine], None]


class Controller(SafePositionMixin):
    """The port, over a `Machine`. ``faults`` maps (call, nth from 1, "before" or "after") to what happens.

    With ``by_hand`` it is a road without programs: the operator's hand moves the axes, a panel switches.
    """

    name = "double"
    goes_on = False

    def __init__(
        self, machine: Machine, clock: LoopClock, reaper: Reaper | None = None, *, by_hand: bool = False
    ) -> None:
        self.machine = machine
        self.clock = clock
        self.reaper = reaper or Reaper()
        self.by_hand = by_hand
        self.switching = True
        self.batches = False
        self.keeps_marker = True
        self.faults: dict[tuple[str, int, str], Fault] = {}
        self.calls: dict[str, int] = {}

    @property
    def capabilities(self) -> Capabilities:
        consent: Literal["start", "panel"] = "panel" if self.by_hand else "start"
        switched: Literal["at-stop", "by-itself", "by-restart"] = "by-itself" if self.by_hand else "at-stop"
        return Capabilities(
            not self.by_hand,
            HELD_KINDS,
            switched=switched if self.switching else "by-restart",
            marker=self.keeps_marker,
            consent=consent,
            cross_shown="either-way",
            together=self.batches,
        )

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
        cross = m.shown_sense * m.crossing
        axes = {
            "X1": AxisState("X1", m.position, m.referenced, m.standing, m.compensation, cross, "mm"),
            "Z1": AxisState("Z1", m.z_position, m.referenced, m.standing, 0.0, 0.0, "mm"),
        }
        self._end("state", number)
        return MachineState(m.channel, m.mode, "", m.alarms, m.access_level, axes)

    async def table_limits(self, axis: str, kind: Literal["axis", "cross"] = "axis", index: int = 0) -> TableLimits:
        number = await self._begin("table_limits")
        self._end("table_limits", number)
        return TableLimits(self.machine.reserved, 1e-6, 1.0, 1.0 if kind == "cross" else None)

    async def marker(self) -> Marker | None:
        number = await self._begin("marker")
        self._end("marker", number)
        return self.machine.marker if self.keeps_marker else None

    async def prepare_stops(self, plan: StopPlan) -> None:
        number = await self._begin("prepare_stops")
        if self.by_hand:
            raise UnsupportedDevice("E-TEST-PROGRAMS", "double")
        self._in_reset()
        m = self.machine
        m.plan, m.orders, m.phase, m.saved = plan, (), 0, None
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
        m.channel = ChannelStatus.ACTIVE
        m.go(m.plan.axis, stop.target)
        if stop.switch is not None:
            self._switch(m.plan.cross_table, stop.switch)
        found = StopReached(
            after + 1,
            stop.repetition,
            stop.label,
            stop.approach,
            stop.target,
            m.compensation,
            m.shown_sense * m.crossing,
        )
        self._end("wait_stop", number)
        return found

    def _switch(self, cross_table: int | None, enable: bool) -> None:
        m = self.machine
        if cross_table is None:
            m.become(LiveTable(m.own.table, enable))
            return
        table = next(one.table for one in m.cross if one.table.index == cross_table)
        m.become_cec(table, switch=enable, axis_on=m.cec_on)

    async def switch(self, order: PushOrder, enable: bool, timeout_s: float) -> None:
        number = await self._begin("switch")
        await self._operator(timeout_s)
        self._switch(order.table.index if order.table.kind == "cross" else None, enable)
        self._end("switch", number)

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

    async def prepare_reading(self, plans: Sequence[StopPlan]) -> None:
        (plan,) = plans
        await self.prepare_stops(plan)

    async def live_tables(self, question: TableQuestion, tell: Tell) -> LiveSet:
        if self.by_hand:
            return await self.saved_tables(question.axis, question.proof)
        return (await read_live_tables(self, (question,), tell))[0]

    def tables_by(self, live: LiveSet, proof: SignProof | None) -> LiveSet:
        return tables.tables_by_proof(live, proof)

    def table_by(self, table: CompensationTable, sense: Sense, proof: SignProof | None) -> CompensationTable:
        return tables.table_by_proof(table, sense, proof)

    async def saved_tables(self, axis: str, proof: SignProof | None = None) -> LiveSet:
        number = await self._begin("saved_tables")
        saved = self.machine.live() if self.by_hand else self.machine.saved
        self._end("saved_tables", number)
        if saved is None:
            raise DeviceRefused("E-TEST-FILE", "double")
        return tables.tables_by_proof(saved, proof)

    async def stage(self, batch: PushBatch) -> None:
        number = await self._begin("stage")
        self._in_reset()
        m = self.machine
        m.orders, m.plan, m.phase, m.release = batch, None, 0, 0
        if not m.forgets_marker:
            m.marker = Marker(batch[0].transaction, "in-progress")
        self._end("stage", number)

    async def backup_of(self, batch: PushBatch) -> tuple[LiveSet, ...]:
        number = await self._begin("backup_of")
        if self.by_hand and self.machine.orders == batch:
            self.machine.keep_backup(batch)
        self._end("backup_of", number)
        if self.machine.backup is None or self.machine.backup_number != batch[0].transaction:
            raise DeviceRefused("E-TEST-FILE", "double")
        return (self.machine.backup,) * len(batch)

    async def read_back(self, batch: PushBatch, timeout_s: float) -> tuple[ReadBack, ...]:
        number = await self._begin("read_back")
        await self._operator(timeout_s)
        self.machine.start_push(moves=not self.by_hand)
        self._end("read_back", number)
        backup, readback = self.machine.backup, self.machine.readback
        if backup is None or readback is None:
            raise DeviceRefused("E-TEST-FILE", "double")
        return (ReadBack(backup, readback),) * len(batch)

    async def activate(self, batch: PushBatch, passed: PushBatch) -> None:
        number = await self._begin("activate")
        self.machine.release, self.machine.passed = batch[0].transaction, passed
        self._end("activate", number)

    async def confirm(self, passed: PushBatch, timeout_s: float) -> tuple[bool, ...]:
        number = await self._begin("confirm")
        await self._operator(timeout_s)
        self.machine.go_on()
        self._end("confirm", number)
        return tuple(order.enable and self.machine.phase == 5 for order in passed)

    async def restarted(self, passed: PushBatch, timeout_s: float) -> None:
        number = await self._begin("restarted")
        await self._operator(timeout_s)
        self.machine.nck_reset()
        self._end("restarted", number)

    async def switch_reading(self, order: DisableOrder) -> SwitchReading:
        number = await self._begin("switch_reading")
        self._end("switch_reading", number)
        return self.machine.reading(order)

    async def prepare_disable(self, order: DisableOrder) -> None:
        number = await self._begin("prepare_disable")
        self._in_reset()
        self._end("prepare_disable", number)

    async def wait_disabled(self, order: DisableOrder, timeout_s: float) -> SwitchReading:
        number = await self._begin("wait_disabled")
        await self._operator(timeout_s)
        self.machine.switch_off(order)
        self._end("wait_disabled", number)
        return self.machine.reading(order)

    async def finish_push(self, batch: PushBatch, state: Literal["committed", "held", "none"]) -> None:
        number = await self._begin("finish_push")
        self.machine.marker = Marker(batch[0].transaction, state) if state != "none" else Marker(0, "none")
        self._end("finish_push", number)


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
    root: Path,
    old: LiveTable | None = None,
    reaper: Reaper | None = None,
    machine: Machine | None = None,
    *,
    by_hand: bool = False,
) -> Bench:
    """Fresh, or over a machine that is already there."""
    clock = LoopClock(started_utc=datetime(2026, 11, 21, 10, tzinfo=UTC))
    machine = machine or Machine(old or LiveTable(OLD, enabled=True))
    controller = Controller(machine, clock, reaper, by_hand=by_hand)
    controller.keep_to(PLACES)
    told: list[tuple[str, dict[str, object]]] = []

    def say(code: str, /, **fields: object) -> None:
        told.append((code, fields))
        if code == "P-PUSH-JOG" and machine.operator:
            machine.go(str(fields["axis"]), float(str(fields["position"])) + 0.004)

    context = PushContext(
        controller, clock, Folder(root, reaper), root / "journal", AXIS, MACHINE, "mill", "mill", PROOF, say=say
    )
    return Bench(machine, controller, context, told)


def change_of(machine: Machine, new: CompensationTable = NEW) -> TableChange:
    """The change as a capture made now would propose it."""
    live = machine.live()
    return TableChange("X1", live.own.table, new, live.own.enabled, live.digest, NOTHING, NOTHING, NOTHING)


def journals_of(root: Path) -> Sequence[journal.JournalRead]:
    folder = journal.machine_folder(root / "journal", MACHINE.serial)
    return (*journal.read_journals(folder), *journal.read_journals(folder / "done"))


def only_old_or_new_enabled(machine: Machine, *allowed: CompensationTable) -> bool:
    """The invariant, over everything the machine ever held."""
    return all(not live.enabled or live.table in allowed for live in [*machine.history, machine.own])


def deadline(_machine: Machine) -> None:
    raise DeadlineExceeded("E-LINK-DEADLINE", "double", timeout_s=1.0)


def refuse(_machine: Machine) -> None:
    raise DeviceRefused("E-TEST-REFUSED", "double")


def changing(**values: Any) -> Fault:
    def act(machine: Machine) -> None:
        for name, value in values.items():
            setattr(machine, name, value)

    return act
