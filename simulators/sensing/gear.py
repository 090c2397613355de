"""The gear inspection machine behind its bridge: says what is clamped, measures a plan line by line, can be stopped.

On the wire heights count from the part's lower face; inside the cell from the middle of its width.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from drivers.bridge.codec import Notification
from drivers.bridge.fields import Fields
from drivers.bridge.gearrecords import ABORT, COLUMNS, DONE, MEASURE, PART, POINTS
from drivers.bridge.records import BUSY, ENVIRONMENT, IDENTIFY, INVALID_PARAMS, UNSUPPORTED, BridgeIdentity
from drivers.clock import Clock
from drivers.errors import RemoteProtocolError, TransportError
from simulators.bridge import Answer, BridgeAnswerer, BridgeRefused
from simulators.grinding import WorkPiece
from simulators.inspection import SHARE, UM, GearMachine, OnMachine
from simulators.instrument_wire import Around
from simulators.optics import OpticsBench

FloatArray = NDArray[np.float64]
SIDES = {"left": 1.0, "right": -1.0}
FROM_MACHINE_S = 60.0
MOST_POINTS = 5000


@dataclass(frozen=True, slots=True)
class Line:
    """One line of a plan: points at t (T,) and heights z (Z,) of a space; a ball where ``ball_mm`` is not 0."""

    trace: str
    space: int
    flank: str
    t: FloatArray
    z: FloatArray
    ball_mm: float = 0.0

    def __len__(self) -> int:
        return max(len(self.t) * len(self.z), 1)


class GearAnswerer(BridgeAnswerer):
    """Serves the machine to one client. ``fetch`` gives the part ground last, None while there is none to take."""

    def __init__(
        self,
        machine: GearMachine,
        fetch: Callable[[], WorkPiece | None],
        bench: OpticsBench,
        clock: Clock,
        around: Around | None = None,
    ) -> None:
        super().__init__(cast(Any, machine), bench, clock, 1.0, around)
        self.machine = machine
        self._fetch = fetch
        self._on: OnMachine | None = None
        self._plan = 0
        self._sent = 0
        self._measuring: asyncio.Task[None] | None = None

    def reclamp(self) -> None:
        """Take the part off; it is clamped anew when it is asked for."""
        self._on = None

    def _skip_to(self, now_s: float) -> None:
        """Nothing is sampled."""

    async def _produce(self) -> None:
        """Nothing is sampled."""

    async def stop(self) -> None:
        """End everything."""
        await self._end_measuring()
        await super().stop()

    def _answers(self) -> Mapping[str, Answer]:
        own = {IDENTIFY: self._identify, PART: self._part, MEASURE: self._measure, ABORT: self._abort}
        return own | {ENVIRONMENT: self._environment}

    async def _identify(self, _params: Mapping[str, Any]) -> Any:
        notices = ("simulated machine: its touches are computed from the cell's truth",)
        model = self.machine.spec.model
        return BridgeIdentity(
            kind="gear",
            maker="trueflank",
            model=model,
            serial=self.serial,
            firmware="1.0",
            channels=(),
            sample_rate_hz=0.0,
            notices=notices,
        ).as_object()

    async def _part(self, _params: Mapping[str, Any]) -> Any:
        on = await self._clamped()
        if on is None:
            return {"clamped": False}
        part = f"{on.work.spec.name} {on.work.number}"
        return {"clamped": True, "part": part, "clamping": f"clamping {on.number}, datum bore"}

    async def _clamped(self) -> OnMachine | None:
        """The part ground last, brought over and clamped when it is another one than before."""
        work = self._fetch()
        if work is not None and (self._on is None or self._on.work is not work):
            gear = work.spec.gear
            self._on = self.machine.clamp(work, 4 * gear.zc)
        return self._on

    async def _measure(self, params: Mapping[str, Any]) -> Any:
        if self._measuring is not None and not self._measuring.done():
            raise BridgeRefused(BUSY, "a plan is being measured")
        on = await self._clamped()
        if on is None:
            raise BridgeRefused(UNSUPPORTED, "no part is clamped")
        try:
            asked = Fields(params, "plan")
            lines = list(planned(asked, on))
            count = asked.integer("space_count")
        except RemoteProtocolError as error:
            raise BridgeRefused(INVALID_PARAMS, str(error)) from error
        self._plan += 1
        measure = self._measured(on, lines, count, self._plan)
        self._measuring = asyncio.get_running_loop().create_task(measure, name="gear inspection")
        return {"plan": self._plan, "points": sum(len(line) for line in lines)}

    async def _abort(self, _params: Mapping[str, Any]) -> Any:
        if await self._end_measuring():
            await self._say(DONE, {"plan": self._plan, "outcome": "aborted", "points": self._sent, "said": "stopped"})
        return {}

    async def _end_measuring(self) -> bool:
        task, self._measuring = self._measuring, None
        if task is None or task.done():
            return False
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task
        return True

    async def _measured(self, on: OnMachine, lines: list[Line], count: int, plan: int) -> None:
        """All lines, in the machine's own time."""
        self._sent = 0
        if on.spaces != count:
            await self._fail(plan, f"{on.spaces} spaces found, the plan has {count}")
            return
        for line in lines:
            await self._clock.sleep(len(line) * self.machine.spec.seconds_per_point)
            told = touched(on, line)
            if told is None:
                await self._fail(plan, f"a ball of {line.ball_mm:g} mm finds no rest in a space")
                return
            await self._say(POINTS, {"plan": plan, "first": self._sent} | told)
            self._sent += len(line)
        await self._say(DONE, {"plan": plan, "outcome": "complete", "points": self._sent} | self._probe())

    async def _fail(self, plan: int, said: str) -> None:
        await self._say(DONE, {"plan": plan, "outcome": "failed", "points": self._sent, "said": said})

    def _probe(self) -> dict[str, Any]:
        degc = round(self._bench.truth.climate.sensed(self._clock.now()).material_degc, 2)
        return {"probe_u_um": self.machine.spec.noise_um, "temperature_degc": degc}

    async def _say(self, method: str, params: dict[str, Any]) -> None:
        peer = self._peer
        if peer is not None and not self.silent:
            with contextlib.suppress(TransportError):
                await peer.write(self._codec.send(Notification(method, params)))


def planned(asked: Fields, on: OnMachine) -> Iterator[Line]:
    """The lines of a plan as the wire has it. Raises RemoteProtocolError (E-BRIDGE-FIELD)."""
    count = asked.integer("space_count")
    spaces, flanks = _list(asked, "spaces"), _list(asked, "flanks") or ["left", "right"]
    if not all(isinstance(space, int) and 0 <= space < count for space in spaces):
        raise asked.wrong("spaces", f"numbers from 0 to {count - 1}", spaces)
    if not all(flank in SIDES for flank in flanks):
        raise asked.wrong("flanks", "left, right", flanks)
    middle, level, along = np.asarray([_middle(on)]), np.zeros(1), _along(asked, on)
    for space in spaces:
        for flank in flanks:
            yield from _flank_lines(asked, on, space, flank, middle, along)
    if asked.get("pitch"):
        for space in range(count):
            for flank, side in SIDES.items():
                yield Line(trace="pitch", space=space, flank=flank, t=side * middle, z=level)
    if asked.get("runout") is not None:
        ball = Fields(asked.get("runout"), "runout").number("ball_mm")
        for space in range(count):
            yield Line(trace="runout", space=space, flank="", t=np.zeros(1), z=level, ball_mm=ball)


def _along(asked: Fields, on: OnMachine) -> FloatArray:
    """t of a profile line on the left flank; nothing where none is asked for."""
    if asked.get("profile") is None:
        return np.zeros(0)
    t = on.lobes.even(2 * _points(Fields(asked.get("profile"), "profile")), SHARE)
    return t[t > 0.0]


def _flank_lines(
    asked: Fields, on: OnMachine, space: int, flank: str, middle: FloatArray, along: FloatArray
) -> Iterator[Line]:
    side, half = SIDES[flank], _half_width(on)
    if len(along):
        profile = Fields(asked.get("profile"), "profile")
        yield Line(
            trace="profile",
            space=space,
            flank=flank,
            t=side * along,
            z=np.asarray([profile.number("z_mm", 0.0) - half]),
        )
    if asked.get("lead") is not None:
        lead = Fields(asked.get("lead"), "lead")
        ends = lead.array("z_mm", lead.get("z_mm"))
        if len(ends) != 2:
            raise lead.wrong("z_mm", "two heights", ends.tolist())
        yield Line(
            trace="lead",
            space=space,
            flank=flank,
            t=side * middle,
            z=np.linspace(ends[0] - half, ends[1] - half, _points(lead)),
        )


def touched(on: OnMachine, line: Line) -> dict[str, Any] | None:
    """What the machine finds along a line, as the wire has it; None where a ball finds no rest."""
    if line.ball_mm:
        found = on.ball(line.space, line.ball_mm)
        if found is None:
            return None
        points, seen = found[0][None], np.asarray([found[1]])
    else:
        points, seen = on.touch(line.space, line.t, line.z)
    told = {"trace": line.trace, "space": line.space} | ({"flank": line.flank} if line.flank else {})
    if on.spec.deviations:
        points = points - seen[:, None] * UM * _outward(on, line)
        told["deviation_um"] = np.round(seen, 4).tolist()
    columns = (points + np.asarray((0.0, 0.0, _half_width(on)))).T
    return told | {name: np.round(column, 7).tolist() for name, column in zip(COLUMNS, columns, strict=True)}


def _outward(on: OnMachine, line: Line) -> FloatArray:
    """Directions of the deviations, (n, 3): a ball's is out along its space."""
    return on.lobes.rays(line.space, line.t, line.z).directions


def _half_width(on: OnMachine) -> float:
    return 0.5 * on.lobes.gear.b


def _middle(on: OnMachine) -> float:
    """t half way along a flank."""
    return float(on.lobes.even(5, 1.0)[3])


def _points(fields: Fields) -> int:
    points = fields.integer("points")
    if not 1 <= points <= MOST_POINTS:
        raise fields.wrong("points", f"1 to {MOST_POINTS}", points)
    return points


def _list(asked: Fields, name: str) -> list[Any]:
    found = asked.get(name, [])
    if not isinstance(found, list):
        raise asked.wrong(name, "a list", found)
    return found
