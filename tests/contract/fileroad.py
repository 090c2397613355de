"""A control that takes its tables from files when it starts: no programs of ours, no marker, no cross tables.

Each joint has one file of rows "place forward reverse" at free, rising places, at most 256 of them, in um. The file is
read once, when the control starts. What acts cannot be read out: only the acting value where the joint stands.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from drivers.clock import LoopClock
from drivers.errors import DeadlineExceeded, DeviceRefused, TableError, TooManyPoints, UnsupportedDevice
from drivers.ports.devices import Tell
from drivers.terms import TableKind
from drivers.types.abilities import Capabilities, Marker, TableAbility, TableLimits
from drivers.types.identity import Identity, MachineIdentity
from drivers.types.machine import AxisState, ChannelStatus, MachineState
from drivers.types.orders import DisableOrder, PushBatch, PushOrder, ReadBack, SignProof, SwitchReading, TableQuestion
from drivers.types.stops import StopPlan, StopReached
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from drivers.types.values import Sense
from drivers.workpiece import GrindPlan

MOST = 256
RESOLUTION_MM = 1e-6
CAPABILITIES = Capabilities(
    stops=False,
    tables=(TableAbility("axis", "free", "columns", MOST),),
    switched="by-restart",
    marker=False,
    consent="restart",
    alarms=False,
    acting_tables=False,
)


@dataclass
class Machine:
    """The control: files by name, and what it read of them when it started. ``position`` of each joint in mm."""

    files: dict[str, str] = field(default_factory=dict)
    loaded: dict[str, str] = field(default_factory=dict)
    position: dict[str, float] = field(default_factory=lambda: {"X": 0.0, "Z": 0.0})
    starts: int = 0

    def restart(self) -> None:
        """Read every joint's file, as it stands now."""
        self.loaded = {joint: self.files[joint] for joint in self.position if joint in self.files}
        self.starts += 1

    def acting_um(self, joint: str) -> float:
        """What acts where the joint stands, coming up from below."""
        found = self.loaded.get(joint)
        return float(table_of(joint, found).at(np.array([self.position[joint]]))[0]) if found else 0.0


def text_of(table: CompensationTable) -> str:
    """The joint's file. Raises TableError (E-TABLE-PLAIN) for a kind it has not, TooManyPoints (E-COMP-POINTS)."""
    if table.kind != "axis" or table.input_axis != table.output_axis:
        raise TableError("E-TABLE-PLAIN", table.name, table=table.name)
    if len(table.deviations) > MOST:
        raise TooManyPoints("E-COMP-POINTS", table.name, needed=len(table.deviations), reserved=MOST, memory="file")
    rows = zip(table.positions, table.deviations, table.reverse or table.deviations, strict=True)
    return "".join(
        f"{place!r} {forward!r} {back!r}\n" for place, forward, back in ((*map(float, row),) for row in rows)
    )


def table_of(joint: str, text: str) -> CompensationTable:
    """The table in a joint's file."""
    rows = [tuple(map(float, line.split())) for line in text.splitlines()]
    places, forward, back = zip(*rows, strict=True)
    return CompensationTable(
        "axis", joint, joint, places[0], places[-1], 0.0, tuple(forward), places=tuple(places), reverse=tuple(back)
    )


class FileRoad:
    """The port over such a control; ``new`` files lie beside those that the control reads."""

    name = "files"

    def __init__(self, machine: Machine, clock: LoopClock) -> None:
        self.machine = machine
        self.clock = clock
        self._before: dict[tuple[int, str], str | None] = {}
        self._started = 0

    @property
    def capabilities(self) -> Capabilities:
        return CAPABILITIES

    async def open(self, timeout_s: float) -> Identity:
        del timeout_s
        return Identity("file-road", "control with tables in files", "FILE-1", "2.9")

    async def close(self) -> None:
        return None

    async def identify(self) -> MachineIdentity:
        return MachineIdentity("FILE-1", "2.9", tuple(self.machine.position))

    async def state(self) -> MachineState:
        axes = {
            joint: AxisState(joint, place, True, True, self.machine.acting_um(joint), 0.0, "mm")
            for joint, place in self.machine.position.items()
        }
        return MachineState(ChannelStatus.RESET, "AUTO", "", (), 0, axes)

    async def table_limits(self, axis: str, kind: TableKind = "axis", index: int = 0) -> TableLimits:
        if kind != "axis" or index or axis not in self.machine.position:
            raise DeviceRefused("E-MBX-TABLE", self.name)
        return TableLimits(MOST, RESOLUTION_MM, 1.0)

    async def marker(self) -> Marker | None:
        return None

    # ---- what acts --------------------------------------------------------------------------------

    async def live_tables(self, question: TableQuestion, tell: Tell) -> LiveSet:
        del tell
        return await self.saved_tables(question.axis, question.proof)

    def tables_by(self, live: LiveSet, proof: SignProof | None) -> LiveSet:
        """It has no cross tables, so there is nothing to turn."""
        del proof
        return live

    def table_by(self, table: CompensationTable, sense: Sense, proof: SignProof | None) -> CompensationTable:
        del sense, proof
        return table

    async def saved_tables(self, axis: str, proof: SignProof | None = None) -> LiveSet:
        del proof
        return self._set(axis, self.machine.loaded.get(axis), enabled=True)

    def _set(self, axis: str, text: str | None, *, enabled: bool) -> LiveSet:
        nothing = CompensationTable("axis", axis, axis, 0.0, 0.0, 0.0, (0.0,))
        own = LiveTable(table_of(axis, text), enabled) if text else LiveTable(nothing, enabled=False)
        native = text or ""
        return LiveSet(axis, own, (), 0.0, native, hashlib.sha256(native.encode()).hexdigest())

    async def switch_reading(self, order: DisableOrder) -> SwitchReading:
        return SwitchReading(order.axis in self.machine.loaded, self.machine.acting_um(order.axis))

    # ---- a table in -------------------------------------------------------------------------------

    async def stage(self, batch: PushBatch) -> None:
        for order in batch:
            text_of(order.table)
        for order in batch:
            joint = order.table.output_axis
            self._before[order.transaction, joint] = self.machine.files.get(joint)

    async def read_back(self, batch: PushBatch, timeout_s: float) -> tuple[ReadBack, ...]:
        del timeout_s
        backups = await self.backup_of(batch)
        return tuple(ReadBack(old, self._load(order)) for old, order in zip(backups, batch, strict=True))

    def _load(self, order: PushOrder) -> LiveSet:
        joint = order.table.output_axis
        empty = order.purpose == "restore" and not any((*order.table.deviations, *order.table.reverse))
        self.machine.files[f"{joint}.new"] = "" if empty else text_of(order.table)
        return self._set(joint, self.machine.files[f"{joint}.new"], enabled=False)

    async def backup_of(self, batch: PushBatch) -> tuple[LiveSet, ...]:
        return tuple(self._backup_of(order) for order in batch)

    def _backup_of(self, order: PushOrder) -> LiveSet:
        joint = order.table.output_axis
        if (order.transaction, joint) not in self._before:
            raise DeviceRefused("E-MBX-TABLE", self.name)
        before = self._before[order.transaction, joint]
        return self._set(joint, before, enabled=before is not None)

    async def activate(self, batch: PushBatch, passed: PushBatch) -> None:
        """The new files take the old ones' place; the control has not read them yet."""
        del batch
        for order in passed:
            self._take_over(order)

    def _take_over(self, order: PushOrder) -> None:
        joint = order.table.output_axis
        text = self.machine.files.pop(f"{joint}.new")
        if order.enable and text:
            self.machine.files[joint] = text
        else:
            self.machine.files.pop(joint, None)
        self._started = self.machine.starts

    async def confirm(self, passed: PushBatch, timeout_s: float) -> tuple[bool, ...]:
        """An order that leaves the table off needs the restart too: until then the old one acts."""
        if not all(order.enable for order in passed):
            await self.restarted(passed, timeout_s)
        return tuple(order.enable for order in passed)

    async def restarted(self, passed: PushBatch, timeout_s: float) -> None:
        """The control was started, and the acting values are those of the files. Raises DeadlineExceeded."""
        for order in passed:
            await self._restarted(order, timeout_s)

    async def _restarted(self, order: PushOrder, timeout_s: float) -> None:
        joint, end = order.table.output_axis, self.clock.now() + timeout_s
        while self.machine.starts == self._started:
            if self.clock.now() >= end:
                raise DeadlineExceeded("E-NC-NO-ACTIVATION", self.name, axis=joint, timeout_s=timeout_s)
            await self.clock.sleep(0.5)
        here = np.array([self.machine.position[joint]])
        wanted = float(order.table.at(here)[0]) if order.enable else 0.0
        if abs(self.machine.acting_um(joint) - wanted) > 1e-6:
            raise DeviceRefused("E-MBX-TABLE", self.name)

    async def finish_push(self, batch: PushBatch, state: Literal["committed", "held", "none"]) -> None:
        del state
        for order in batch:
            self._before.pop((order.transaction, order.table.output_axis), None)

    async def prepare_disable(self, order: DisableOrder) -> None:
        self._started = self.machine.starts
        self.machine.files.pop(order.axis, None)

    async def wait_disabled(self, order: DisableOrder, timeout_s: float) -> SwitchReading:
        end = self.clock.now() + timeout_s
        while self.machine.starts == self._started:
            if self.clock.now() >= end:
                raise DeadlineExceeded("E-NC-NO-ACTIVATION", self.name, axis=order.axis, timeout_s=timeout_s)
            await self.clock.sleep(0.5)
        return await self.switch_reading(order)

    # ---- not on this road -------------------------------------------------------------------------

    def _unable(self, **told: Any) -> UnsupportedDevice:
        return UnsupportedDevice("E-NC-NO-SWITCHING", self.name, **told)

    async def switch(self, order: PushOrder, enable: bool, timeout_s: float) -> None:
        raise self._unable(table=order.table.name, enable=enable, timeout_s=timeout_s)

    async def prepare_stops(self, plan: StopPlan) -> None:
        raise self._unable(table=plan.name)

    async def wait_stop(self, after: int, timeout_s: float) -> StopReached | None:
        raise self._unable(table="", after=after, timeout_s=timeout_s)

    async def release_stop(self, counter: int) -> None:
        raise self._unable(table="", counter=counter)

    async def abort_program(self) -> None:
        return None

    async def prepare_grinding(self, plan: GrindPlan) -> str:
        raise self._unable(table=plan.name)

    async def wait_ground(self, after: int, timeout_s: float) -> int | None:
        raise self._unable(table="", after=after, timeout_s=timeout_s)


def curve(shift: float = 0.0) -> CompensationTable:
    """Forward and reverse curves of X at free places, both zero where the joint stands."""
    places = (-40.0, -17.5, -3.0, 0.0, 2.25, 30.0)
    forward = tuple(round(4.0 * float(np.sin(place / 9.0)) + shift * place, 3) + 0.0 for place in places)
    back = tuple(round(value + 0.02 * place, 3) + 0.0 for place, value in zip(places, forward, strict=True))
    table = CompensationTable("axis", "X", "X", places[0], places[-1], 0.0, forward)
    return replace(table, places=places, reverse=back)
