"""The gear inspection machine: clamps the ground part, touches its flanks along the nominal normals, answers a bridge.

Every touch is a ray of the machine's own (nominal) gear into the true surface of the part as it is clamped. So an
eccentric or turned part is measured as such a machine would measure it, with nothing shortened. On the wire a plan is
measured line by line in the machine's own time and can be aborted; heights count there from the part's lower face, and
in the cell from the middle of its width.
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
from drivers.bridge.gear import ABORT, COLUMNS, DONE, MEASURE, PART, POINTS
from drivers.bridge.records import BUSY, ENVIRONMENT, IDENTIFY, INVALID_PARAMS, UNSUPPORTED, BridgeIdentity, Fields
from drivers.clock import Clock
from drivers.errors import RemoteProtocolError, TransportError
from simulators.bridge import Answer, BridgeRefused, BridgeServer
from simulators.cellfile import InspectionMachine
from simulators.grinding import CycloidDisc, Rays, WorkPiece, draw_clamping
from simulators.instrument_server import WireWrapper
from simulators.optics import OpticsBench
from simulators.truth import Pose, generator

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
UM = 1e-3
FLANK_SHARE = 0.95
BISECTIONS = 60


@dataclass(frozen=True, slots=True)
class TouchedPoints:
    """What was touched: points (n, 3) in mm, space and flank (n,), deviation along the nominal normal (n,) in um.

    The frame is the machine's: its gear as it should be, the part as it is clamped. ``flank`` is +1 where the
    profile angle counts up from the bottom of its space (counter-clockwise side), -1 on the other side;
    ``deviation_um`` + = surplus material.
    """

    points_mm: FloatArray
    space: IntArray
    flank: IntArray
    deviation_um: FloatArray


class ClampedPart:
    """One part in one clamping of the machine."""

    def __init__(self, spec: InspectionMachine, seed: int, work: WorkPiece, number: int, touches: int) -> None:
        """``number`` counts the machine's clampings; of about ``touches`` to come some are glitches."""
        self.spec = spec
        self.work = work
        self.number = number
        self.seat: Pose = draw_clamping(spec.clamping, seed, spec.name, f"part {work.number}", f"{number}")
        gear = work.spec.gear
        other = {"rrp": 1.04 * gear.rrp, "a": 0.98 * gear.a} if spec.wrong_part else {}
        self.lobes = CycloidDisc(gear.model_copy(update=other))
        self._rng = generator(seed, spec.name, f"touches {number}")
        wild = self._rng.choice(max(touches, 1), size=min(spec.glitches, touches), replace=False)
        self._wild = {int(place): float(self._rng.choice((-1.0, 1.0))) for place in wild}
        self._done = 0

    @property
    def spaces(self) -> int:
        """How many spaces the machine counts."""
        return max(self.lobes.gear.zc + self.spec.wrong_spaces, 1)

    def touch(self, space: int, t: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Touch a space at t (T,) and heights z (Z,): points (T * Z, 3) in mm, z fastest, and deviations in um."""
        rays = self.lobes.rays(space, t, z)
        seen = self._met(space, rays) / UM + self._errors(len(rays.points))
        return rays.points + seen[:, None] * UM * rays.directions, seen

    def ball(self, space: int, diameter_mm: float) -> tuple[FloatArray, float] | None:
        """A ball put into a space at half height, resting on both flanks: its centre (3,) in mm, how far out, um.

        None for one that finds no rest in the space.
        """
        t = self._rest(0.5 * diameter_mm)
        if t is None:
            return None
        sides = np.asarray([t, -t])
        _, seen = self.touch(space, sides, np.zeros(1))
        point, normal = self.lobes.profile(sides)
        turn = np.exp(2j * self.lobes.half * space)
        normals = np.stack((normal.real, normal.imag), axis=1)
        moved = np.linalg.solve(normals, seen * UM)
        centre = (point[0] + 0.5 * diameter_mm * normal[0] + moved[0] + 1j * moved[1]) * turn
        return np.asarray((centre.real, centre.imag, 0.0)), float(moved[0] / UM)

    def _rest(self, radius: float) -> float | None:
        """t where a ball in the middle of the space touches its flank: its centre's y is 0."""

        def beside(t: float) -> float:
            point, normal = self.lobes.profile(np.asarray([t]))
            return float(point.imag[0] + radius * normal.imag[0])

        low, high = 0.02 * self.lobes.half, 0.95 * self.lobes.half
        if beside(low) >= 0.0 or beside(high) <= 0.0:
            return None
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if beside(middle) < 0.0 else (low, middle)
        return 0.5 * (low + high)

    def _met(self, space: int, rays: Rays) -> FloatArray:
        """Where the machine's rays meet the part as it is clamped, (m,) mm."""
        if self.spec.wrong_part:
            return np.zeros(len(rays.points))
        turn = self.seat.rotation[0]
        entered = Rays((rays.points - self.seat.origin[0]) @ turn, rays.directions @ turn)
        return self.work.surface(space % self.work.spec.gear.zc, entered)

    def _errors(self, count: int) -> FloatArray:
        """Noise of the next touches in um, and the odd glitch."""
        errors = self._rng.normal(0.0, self.spec.noise_um, count)
        for place in range(count):
            errors[place] += self.spec.glitch_um * self._wild.get(self._done + place, 0.0)
        self._done += count
        return errors


class GearMachine:
    """One machine; each clamping is its own."""

    def __init__(self, spec: InspectionMachine, seed: int) -> None:
        self.spec = spec
        self._seed = seed
        self._count = 0

    def change(self, **options: object) -> None:
        """Become a better or worse machine from the next clamping on: keys of the cell file."""
        self.spec = InspectionMachine.model_validate({**self.spec.model_dump(), **options})

    def clamp(self, work: WorkPiece, touches: int = 1000) -> ClampedPart:
        """Put a part on the machine; about so many touches will be asked for."""
        self._count += 1
        return ClampedPart(spec=self.spec, seed=self._seed, work=work, number=self._count, touches=touches)

    def inspect(self, work: WorkPiece, profile: int, width: int, share: float = FLANK_SHARE) -> TouchedPoints:
        """Touch `profile` x `width` points on both flanks of every space, by equal steps of length and height.

        ``share`` is how much of the flank's length is touched; the width is touched from end to end.
        """
        part = self.clamp(work, 2 * profile * width * work.spec.gear.zc)
        t = part.lobes.even(2 * profile, share)
        z = np.linspace(-0.5, 0.5, width) * part.lobes.gear.b if width > 1 else np.zeros(1)
        touched = [part.touch(space, t, z) for space in range(part.spaces)]
        flank = np.repeat(np.where(t > 0.0, 1, -1), len(z))
        return TouchedPoints(
            np.concatenate([points for points, _ in touched]),
            np.repeat(np.arange(part.spaces), len(flank)),
            np.tile(flank, part.spaces),
            np.concatenate([seen for _, seen in touched]),
        )


# The machine on its wire: identifies itself and the clamped part, measures plans.

SIDES = {"left": 1.0, "right": -1.0}
FROM_MACHINE_S = 60.0
MOST_POINTS = 5000


@dataclass(frozen=True, slots=True)
class MeasuringLine:
    """One line of a plan: points at t (T,) and heights z (Z,) of a space; a ball where ``ball_mm`` is not 0."""

    trace: str
    space: int
    flank: str
    t: FloatArray
    z: FloatArray
    ball_mm: float = 0.0

    def __len__(self) -> int:
        return max(len(self.t) * len(self.z), 1)


class GearInspectionServer(BridgeServer):
    """Serves the machine to one client. ``fetch`` gives the part ground last, None while there is none to take."""

    def __init__(
        self,
        machine: GearMachine,
        fetch: Callable[[], WorkPiece | None],
        bench: OpticsBench,
        clock: Clock,
        around: WireWrapper | None = None,
    ) -> None:
        super().__init__(cast(Any, machine), bench, clock, 1.0, around)
        self.machine = machine
        self._fetch = fetch
        self._on: ClampedPart | None = None
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
        on = await self._clamp_latest()
        if on is None:
            return {"clamped": False}
        part = f"{on.work.spec.name} {on.work.number}"
        return {"clamped": True, "part": part, "clamping": f"clamping {on.number}, datum bore"}

    async def _clamp_latest(self) -> ClampedPart | None:
        """The part ground last, brought over and clamped when it is another one than before."""
        work = self._fetch()
        if work is not None and (self._on is None or self._on.work is not work):
            gear = work.spec.gear
            self._on = self.machine.clamp(work, 4 * gear.zc)
        return self._on

    async def _measure(self, params: Mapping[str, Any]) -> Any:
        if self._measuring is not None and not self._measuring.done():
            raise BridgeRefused(BUSY, "a plan is being measured")
        on = await self._clamp_latest()
        if on is None:
            raise BridgeRefused(UNSUPPORTED, "no part is clamped")
        try:
            asked = Fields(params, "plan")
            lines = list(plan_lines(asked, on))
            count = asked.integer("space_count")
        except RemoteProtocolError as error:
            raise BridgeRefused(INVALID_PARAMS, str(error)) from error
        self._plan += 1
        measure = self._measured(on, lines, count, self._plan)
        self._measuring = asyncio.get_running_loop().create_task(measure, name="gear inspection")
        return {"plan": self._plan, "points": sum(len(line) for line in lines)}

    async def _abort(self, _params: Mapping[str, Any]) -> Any:
        if await self._end_measuring():
            await self._notify(
                DONE, {"plan": self._plan, "outcome": "aborted", "points": self._sent, "said": "stopped"}
            )
        return {}

    async def _end_measuring(self) -> bool:
        task, self._measuring = self._measuring, None
        if task is None or task.done():
            return False
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task
        return True

    async def _measured(self, on: ClampedPart, lines: list[MeasuringLine], count: int, plan: int) -> None:
        """All lines, in the machine's own time."""
        self._sent = 0
        if on.spaces != count:
            await self._fail(plan, f"{on.spaces} spaces found, the plan has {count}")
            return
        for line in lines:
            await self._clock.sleep(len(line) * self.machine.spec.seconds_per_point)
            record = touch_line(on, line)
            if record is None:
                await self._fail(plan, f"a ball of {line.ball_mm:g} mm finds no rest in a space")
                return
            await self._notify(POINTS, {"plan": plan, "first": self._sent} | record)
            self._sent += len(line)
        await self._notify(DONE, {"plan": plan, "outcome": "complete", "points": self._sent} | self._probe())

    async def _fail(self, plan: int, said: str) -> None:
        await self._notify(DONE, {"plan": plan, "outcome": "failed", "points": self._sent, "said": said})

    def _probe(self) -> dict[str, Any]:
        degc = round(self._bench.truth.climate.sensed(self._clock.now()).material_degc, 2)
        return {"probe_u_um": self.machine.spec.noise_um, "temperature_degc": degc}

    async def _notify(self, method: str, params: dict[str, Any]) -> None:
        peer = self._peer
        if peer is not None and not self.silent:
            with contextlib.suppress(TransportError):
                await peer.write(self._codec.send(Notification(method, params)))


def plan_lines(asked: Fields, on: ClampedPart) -> Iterator[MeasuringLine]:
    """The lines of a plan as the wire has it. Raises RemoteProtocolError (E-BRIDGE-FIELD)."""
    count = asked.integer("space_count")
    spaces, flanks = _list_field(asked, "spaces"), _list_field(asked, "flanks") or ["left", "right"]
    if not all(isinstance(space, int) and 0 <= space < count for space in spaces):
        raise asked.wrong("spaces", f"numbers from 0 to {count - 1}", spaces)
    if not all(flank in SIDES for flank in flanks):
        raise asked.wrong("flanks", "left, right", flanks)
    middle, level, along = np.asarray([_flank_middle(on)]), np.zeros(1), _profile_parameters(asked, on)
    for space in spaces:
        for flank in flanks:
            yield from _flank_lines(asked, on, space, flank, middle, along)
    if asked.get("pitch"):
        for space in range(count):
            for flank, side in SIDES.items():
                yield MeasuringLine(trace="pitch", space=space, flank=flank, t=side * middle, z=level)
    if asked.get("runout") is not None:
        ball = Fields(asked.get("runout"), "runout").number("ball_mm")
        for space in range(count):
            yield MeasuringLine(trace="runout", space=space, flank="", t=np.zeros(1), z=level, ball_mm=ball)


def _profile_parameters(asked: Fields, on: ClampedPart) -> FloatArray:
    """t of a profile line on the left flank; nothing where none is asked for."""
    if asked.get("profile") is None:
        return np.zeros(0)
    t = on.lobes.even(2 * _point_count(Fields(asked.get("profile"), "profile")), FLANK_SHARE)
    return t[t > 0.0]


def _flank_lines(
    asked: Fields, on: ClampedPart, space: int, flank: str, middle: FloatArray, along: FloatArray
) -> Iterator[MeasuringLine]:
    side, half = SIDES[flank], _half_width(on)
    if len(along):
        profile = Fields(asked.get("profile"), "profile")
        yield MeasuringLine(
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
        yield MeasuringLine(
            trace="lead",
            space=space,
            flank=flank,
            t=side * middle,
            z=np.linspace(ends[0] - half, ends[1] - half, _point_count(lead)),
        )


def touch_line(on: ClampedPart, line: MeasuringLine) -> dict[str, Any] | None:
    """What the machine finds along a line, as the wire has it; None where a ball finds no rest."""
    if line.ball_mm:
        found = on.ball(line.space, line.ball_mm)
        if found is None:
            return None
        points, seen = found[0][None], np.asarray([found[1]])
    else:
        points, seen = on.touch(line.space, line.t, line.z)
    record = {"trace": line.trace, "space": line.space} | ({"flank": line.flank} if line.flank else {})
    if on.spec.deviations:  # along the normals; of a ball, out along its space
        points = points - seen[:, None] * UM * on.lobes.rays(line.space, line.t, line.z).directions
        record["deviation_um"] = np.round(seen, 4).tolist()
    columns = (points + np.asarray((0.0, 0.0, _half_width(on)))).T
    return record | {name: np.round(column, 7).tolist() for name, column in zip(COLUMNS, columns, strict=True)}


def _half_width(on: ClampedPart) -> float:
    return 0.5 * on.lobes.gear.b


def _flank_middle(on: ClampedPart) -> float:
    """t half way along a flank."""
    return float(on.lobes.even(5, 1.0)[3])


def _point_count(fields: Fields) -> int:
    points = fields.integer("points")
    if not 1 <= points <= MOST_POINTS:
        raise fields.wrong("points", f"1 to {MOST_POINTS}", points)
    return points


def _list_field(asked: Fields, name: str) -> list[Any]:
    found = asked.get(name, [])
    if not isinstance(found, list):
        raise asked.wrong(name, "a list", found)
    return found
