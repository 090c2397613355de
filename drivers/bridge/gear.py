"""A gear inspection machine behind the bridge: measures a plan and hands its points over, or is stopped."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, cast, get_args

import numpy as np
from numpy.typing import NDArray

from drivers.bridge import records
from drivers.bridge.codec import BridgeMessage, Damaged, Notification
from drivers.bridge.line import BridgeLine
from drivers.bridge.records import Fields
from drivers.bridge.settings import BridgeSettings
from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, DeviceRefused, TransportError, TrueflankError, UnsupportedDevice
from drivers.link import Trace
from drivers.message import Message
from drivers.types.gears import ClampedPart, Flank, GearInspection, GearPlan, GearTrace, InspectedGear
from drivers.types.identity import Identity
from drivers.types.sensing import Ambient
from drivers.types.values import FloatArray

# What a gear inspection machine says over the bridge: plans out, parts, chunks of points and endings in, checked.

PART, MEASURE, ABORT = "gear.part", "gear.measure", "gear.abort"
POINTS, DONE = "gear.points", "gear.done"
SIDES: Mapping[str, int] = {"left": 1, "right": -1, "": 0}
TRACES: tuple[str, ...] = get_args(GearTrace)
COLUMNS = ("x_mm", "y_mm", "z_mm")


def plan_as_object(plan: GearPlan) -> dict[str, Any]:
    """The parameters of ``gear.measure``."""
    found: dict[str, Any] = {
        "space_count": plan.space_count,
        "spaces": list(plan.spaces),
        "flanks": list(plan.flanks),
        "pitch": plan.pitch,
    }
    if plan.profile_points:
        found["profile"] = {"points": plan.profile_points, "z_mm": plan.profile_z_mm}
    if plan.lead_points:
        found["lead"] = {"points": plan.lead_points, "z_mm": list(plan.lead_z_mm)}
    if plan.runout_ball_mm:
        found["runout"] = {"ball_mm": plan.runout_ball_mm}
    return found


def expected_points(plan: GearPlan) -> int:
    """How many points a plan asks for."""
    lines = len(plan.spaces) * len(plan.flanks)
    pitch = 2 * plan.space_count if plan.pitch else 0
    return lines * (plan.profile_points + plan.lead_points) + pitch + (plan.space_count if plan.runout_ball_mm else 0)


def read_part(found: Any, where: str) -> ClampedPart:
    """The result of ``gear.part``."""
    fields = Fields(found, where)
    return ClampedPart(fields.flag("clamped"), fields.text("part", ""), fields.text("clamping", ""))


@dataclass(frozen=True, slots=True, eq=False)
class PointChunk:
    """Some points of one line: ``first`` is the number of the first of them since the plan began."""

    plan: int
    first: int
    trace: GearTrace
    space: int
    flank: Flank | None
    points_mm: FloatArray
    deviation_um: FloatArray | None

    def __len__(self) -> int:
        return len(self.points_mm)

    @classmethod
    def read(cls, found: Any, where: str) -> PointChunk:
        """The parameters of ``gear.points``. Raises RemoteProtocolError (E-BRIDGE-FIELD)."""
        fields = Fields(found, where)
        trace, side = fields.text("trace"), fields.text("flank", "")
        if trace not in TRACES:
            raise fields.wrong("trace", "one of " + ", ".join(TRACES), trace)
        if side not in SIDES or (side == "") != (trace == "runout"):
            raise fields.wrong("flank", Message.of("W-BRIDGE-SIDE"), side)
        columns = [fields.array(name, fields.get(name)) for name in COLUMNS]
        deviation = None if fields.get("deviation_um") is None else fields.array("d", fields.get("deviation_um"))
        lengths = {len(column) for column in (*columns, *(() if deviation is None else (deviation,)))}
        if len(lengths) != 1 or 0 in lengths:
            raise fields.wrong("x_mm", Message.of("W-BRIDGE-LISTS-FULL"), sorted(lengths))
        flank = cast(Flank, side) if side else None
        numbers = fields.integer("plan"), fields.integer("first")
        return cls(
            *numbers, cast(GearTrace, trace), fields.integer("space"), flank, np.column_stack(columns), deviation
        )


@dataclass(frozen=True, slots=True)
class MeasurementEnd:
    """The parameters of ``gear.done``: ``outcome`` is complete, aborted or failed."""

    plan: int
    outcome: str
    points: int
    said: str = ""
    probe_u_um: float | None = None
    temperature_degc: float | None = None

    @classmethod
    def read(cls, found: Any, where: str) -> MeasurementEnd:
        """Raises RemoteProtocolError (E-BRIDGE-FIELD)."""
        fields = Fields(found, where)
        outcome = fields.text("outcome")
        if outcome not in ("complete", "aborted", "failed"):
            raise fields.wrong("outcome", Message.of("W-BRIDGE-ENDS"), outcome)
        return cls(
            fields.integer("plan"),
            outcome,
            fields.integer("points"),
            fields.text("said", ""),
            fields.maybe("probe_u_um"),
            fields.maybe("temperature_degc"),
        )


class PointCollection:
    """The chunks of one plan, in order and complete."""

    def __init__(self, number: int, plan: GearPlan, where: str) -> None:
        self.number = number
        self._plan = plan
        self._where = where
        self._chunks: list[PointChunk] = []
        self.count = 0
        self.total = expected_points(plan)

    def add(self, chunk: PointChunk) -> None:
        """The next chunk. Raises RemoteProtocolError (E-BRIDGE-FIELD) for one that was not asked for or is missing."""
        fields = Fields({}, self._where)
        if chunk.first != self.count:
            raise fields.wrong("first", Message.of("W-BRIDGE-POINTS-LOST", count=self.count), chunk.first)
        if chunk.space >= self._plan.space_count:
            raise fields.wrong("space", f"below {self._plan.space_count}", chunk.space)
        if self._chunks and (chunk.deviation_um is None) != (self._chunks[0].deviation_um is None):
            raise fields.wrong("deviation_um", Message.of("W-BRIDGE-ALL-NONE"), "both")
        self.count += len(chunk)
        if self.count > self.total:
            raise fields.wrong("first", Message.of("W-BRIDGE-POINTS-MOST", total=self.total), self.count)
        self._chunks.append(chunk)

    def record(self, ending: MeasurementEnd, part: ClampedPart, utc: str) -> InspectedGear:
        """All points as one record. Raises RemoteProtocolError (E-BRIDGE-FIELD) where the machine counts others."""
        if not self.count or (ending.points, self.count) != (self.total, self.total):
            raise Fields({}, self._where).wrong("points", f"{self.total}", f"{ending.points}, {self.count} came")
        lines = [chunk for chunk in self._chunks if chunk.flank]
        balls = [chunk for chunk in self._chunks if not chunk.flank]
        deviations = [chunk.deviation_um for chunk in lines if chunk.deviation_um is not None]
        told = {"clamping": part.clamping, "part": part.part, "said": ending.said}
        inspection = GearInspection(
            points_mm=_points(lines),
            space=_spaces(lines),
            flank=np.repeat(np.array([SIDES[chunk.flank or ""] for chunk in lines], np.int64), [len(c) for c in lines]),
            deviation_um=np.concatenate(deviations) if deviations else None,
            probe_u_um=ending.probe_u_um,
            source=self._where,
            header={key: text for key, text in told.items() if text},
        )
        trace = tuple(chunk.trace for chunk in lines for _ in range(len(chunk)))
        return InspectedGear(
            inspection=inspection,
            trace=trace,
            part=part,
            balls_mm=_points(balls),
            ball_space=_spaces(balls),
            temperature_degc=ending.temperature_degc,
            measured_utc=utc,
        )


def _points(chunks: list[PointChunk]) -> FloatArray:
    return np.concatenate([np.empty((0, 3)), *(chunk.points_mm for chunk in chunks)])


def _spaces(chunks: list[PointChunk]) -> NDArray[np.int64]:
    return np.repeat(np.array([chunk.space for chunk in chunks], np.int64), [len(chunk) for chunk in chunks])


Told = PointChunk | MeasurementEnd


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

    def _hear(self, message: BridgeMessage) -> None:
        if isinstance(message, Damaged):
            raise self._line.damaged(message)
        if isinstance(message, Notification) and message.method == POINTS:
            self._told.put_nowait(PointChunk.read(message.params, self.name))
        elif isinstance(message, Notification) and message.method == DONE:
            self._told.put_nowait(MeasurementEnd.read(message.params, self.name))

    def _lost(self, error: TrueflankError) -> None:
        self._told.put_nowait(error)

    async def part(self) -> ClampedPart:
        """What is clamped now."""
        return read_part(await self._line.call(PART), self.name)

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
        answer = Fields(await self._line.call(MEASURE, plan_as_object(plan)), self.name)
        gathering = PointCollection(answer.integer("plan"), plan, self.name)
        try:
            ending = await self._gather(gathering, progress)
            if ending.outcome != "complete":
                raise DeviceRefused("E-GEAR-ENDED", self.name, outcome=ending.outcome, said=ending.said)
        except BaseException:
            await self._abort_quietly()
            raise
        utc = self._clock.utc().isoformat(timespec="seconds")
        return gathering.record(ending, part, utc)

    async def _gather(self, gathering: PointCollection, progress: Callable[[str, int, int], None]) -> MeasurementEnd:
        while True:
            told = await self._next()
            if told.plan != gathering.number:
                continue  # left over from a plan that was aborted
            if isinstance(told, MeasurementEnd):
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
        await self._line.call(ABORT)
