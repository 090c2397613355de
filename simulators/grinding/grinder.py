"""The grinder: follows the machine's true poses and cuts the clamped work wherever the wheel's body is in it.

No mark in a program says that the wheel cuts: what counts is where the wheel is. Encoder positions are looked at every
`LOOK_S`; while the wheel is near the work, a quarter of a millimetre of stroke apart. They are sent through the
machine's true error motions and split into passes of the wheel, each in one direction through one space.

The work stands where a fixture is dialled in. The once-per-turn radial motion that turns along with the table is no
motion of the axis: it says where the axis lies in the table (ISO 230-7: the eccentricity of whatever is measured). A
dial gauge at a part on the table shows it and whoever mounts a fixture takes it out; so does a tilt that turns along.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from simulators.cellfile import Part, Wheel
from simulators.grinding.workpiece import (
    ARCSEC,
    UM,
    CycloidDisc,
    GrindingPass,
    Poses,
    WheelBody,
    WorkPiece,
    draw_clamping,
)
from simulators.optics import AxisWatcher, OpticsBench
from simulators.truth import AxisMotion, Pose, Truth, fixed_pose

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
LOOK_S = 0.04
STEP_MM = 0.25
SHORTEST_S = 0.0005
STILL_MM = 1e-6
OVERSAMPLING = 1.2


def refine_times(times: FloatArray, x: FloatArray, z: FloatArray, near: BoolArray) -> tuple[FloatArray, BoolArray]:
    """The coarse moments, and between those near the work as many as a quarter of a millimetre of way asks for.

    ``x``, ``z`` and ``near`` may go on beyond ``times``. Returns (n,) times and which lie where the wheel is near.
    """
    wide = near.copy()
    wide[:-1] |= near[1:]
    wide[1:] |= near[:-1]
    ways = np.maximum(np.abs(np.diff(x)), np.abs(np.diff(z)))
    pieces, marks = [times[:1]], [near[:1]]
    for place, (first, last) in enumerate(pairwise(times.tolist())):
        inside = bool(wide[place] and wide[place + 1])
        most = max(int((last - first) / SHORTEST_S), 1)
        count = min(int(np.ceil(OVERSAMPLING * ways[place] / STEP_MM)) + 1, most) if inside else 1
        pieces.append(np.linspace(first, last, count + 1)[1:])
        marks.append(np.full(count, inside))
    return np.concatenate(pieces), np.concatenate(marks)


def split_passes(times: FloatArray, z: FloatArray, spaces: NDArray[np.int_]) -> list[slice]:
    """Stretches in which the wheel goes one way through one space without a gap in time."""
    way = _stroke_signs(np.diff(z))
    turned = np.zeros(len(z), dtype=np.bool_)
    turned[1:] = (spaces[1:] != spaces[:-1]) | (np.diff(times) > 1.5 * LOOK_S)
    turned[1:-1] |= way[1:] != way[:-1]
    edges = [0, *np.flatnonzero(turned).tolist(), len(z)]
    return [slice(low, high) for low, high in pairwise(edges)]


def _stroke_signs(moved: FloatArray) -> FloatArray:
    """+1 or -1 for each step; a stroke that stands still goes on as it went before."""
    way = np.sign(np.where(np.abs(moved) > STILL_MM, moved, 0.0))
    known = np.flatnonzero(way)
    if not len(known):
        return way
    last = np.searchsorted(known, np.arange(len(way)), side="right") - 1
    return np.asarray(way[known[np.maximum(last, 0)]])


STEPS = 720


def rotation_axis_frame(truth: Truth, height_mm: float) -> Pose:
    """The frame in the table whose z axis is the axis of rotation, at this height above the table's origin."""
    x, y = (UM * value for value in _turning_component(truth, "EXC", "EYC"))
    a, b = (ARCSEC * value for value in _turning_component(truth, "EAC", "EBC"))
    return fixed_pose((-x - height_mm * b, -y + height_mm * a, height_mm), (-a, -b, 0.0))


def _turning_component(truth: Truth, first: str, second: str) -> tuple[float, float]:
    """The part of a pair of stator-frame motions that turns along with the table, as a vector of the table."""
    places = 360.0 / STEPS * np.arange(STEPS, dtype=np.float64)
    turn = np.deg2rad(places)
    x, y = truth.motion(first, places), truth.motion(second, places)
    along = np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x
    return float(np.mean(along[0])), float(np.mean(along[1]))


LONGEST_LOOK_S = 6.0  # what drifts is taken to stand still so long
MARGIN_MM = 0.1
MOST_DRESSED_MM = 1.0
FEWEST_ROWS = 2


class Dresser:
    """The form dresser: what a dressing makes of the wheel, and the correction that a person gave it."""

    def __init__(self, lobes: CycloidDisc, centre_distance_mm: float, wheel: Wheel) -> None:
        self._lobes = lobes
        self._distance = centre_distance_mm
        self._wheel = wheel
        self._given: tuple[FloatArray, FloatArray] | None = None
        self._dressed: tuple[FloatArray, FloatArray] | None = None
        self.count = 0
        self.worn_um = 0.0

    def give(self, axial_mm: FloatArray, correction_um: FloatArray) -> None:
        """A correction along the profile's normal at axial places; it acts from the next dressing on.

        Raises ValueError for places that do not ascend or numbers that are none.
        """
        both = np.stack([np.asarray(axial_mm, dtype=np.float64), np.asarray(correction_um, dtype=np.float64)])
        if both.shape[1] < FEWEST_ROWS or not np.all(np.isfinite(both)) or np.any(np.diff(both[0]) <= 0.0):
            raise ValueError("the dresser takes ascending axial places and finite corrections")
        self._given = (both[0], both[1])

    def dress(self) -> None:
        """Dress the wheel once: its wear goes as far as the depth reaches."""
        self.count += 1
        self._dressed = self._given
        self.worn_um = max(self.worn_um - self._wheel.dressing_depth_um, 0.0)

    def body(self, worn_um: float) -> WheelBody:
        """The wheel after so much more wear than at hand."""
        excess = (self._wheel.radius_um - self.worn_um - worn_um) * UM
        plain = not (self._wheel.form or self._dressed or self.diamond_um)
        return WheelBody(self._lobes, self._distance, excess, None if plain else self._surplus)

    @property
    def diamond_um(self) -> float:
        """What the diamond is too small by in the last dressing."""
        return self._wheel.diamond_um + self._wheel.diamond_wear_um * max(self.count - 1, 0)

    def _surplus(self, t: FloatArray) -> FloatArray:
        """What the dressed profile leaves of the part along its normal, mm."""
        along = np.abs(self._lobes.length(t)) / self._lobes.length(np.asarray([self._lobes.half]))
        left = np.full(t.shape, -self.diamond_um)
        for wave in self._wheel.form:
            size = np.where(t > 0.0, wave.left_um, wave.right_um)
            left = left + size * np.cos(2.0 * np.pi * wave.waves * along)
        if self._dressed is not None:
            axial = self._wheel.table_axial * self._lobes.profile(t)[0].imag
            left = left - self._wheel.table_sign * np.interp(axial, *self._dressed)
        return UM * left


class Grinder:
    """The work place of a cell: a wheel, and at most one work piece on the table."""

    def __init__(
        self, bench: OpticsBench, part: Part, wheel: Wheel, dressed_mm: Callable[[], float] = lambda: 0.0
    ) -> None:
        """``dressed_mm`` tells the offset that a dressing program takes now."""
        self._bench = bench
        self._part = part
        self._wheel = wheel
        self._lobes = CycloidDisc(part.gear)
        distance = part.grinding.centre_distance_mm
        self._dresser = Dresser(self._lobes, distance, wheel)
        self._body = self._dresser.body(0.0)
        self._worn = [self._body]
        self._rough = Dresser(self._lobes, distance, wheel.roughing).body(0.0)
        self._roughing = False
        self._parts = 0
        tilt = (wheel.tilt_arcsec[0] * ARCSEC, 0.0, wheel.tilt_arcsec[1] * ARCSEC)
        self._seat = fixed_pose((wheel.offset_um[0] * UM, wheel.offset_um[1] * UM, wheel.offset_um[2] * UM), tilt)
        self._watcher = AxisWatcher(bench)
        self._dressed_mm = dressed_mm
        self._offset_mm = 0.0
        self._now = 0.0
        self._count = 0
        self.work: WorkPiece | None = None
        self.last: WorkPiece | None = None

    def load(self, now_s: float, seat: Pose | None = None) -> WorkPiece:
        """Take off what is on the table, dress the wheel and clamp a new blank; ``seat`` if that is known."""
        self.unload(now_s)
        self._roughing = False
        offset = self._dressed_mm()
        if abs(offset) <= MOST_DRESSED_MM:  # a dressing program refuses more, and the profile stays where it was
            self._offset_mm = offset
        if self._parts % self._wheel.dress_every == 0:
            self._dresser.dress()
            self._body = self._dresser.body(0.0)
            self._worn = [self._body]
        self._parts += 1
        self._count += 1
        seed, height = self._bench.truth.seed, self._part.grinding.height_mm
        off = draw_clamping(self._part.clamping, seed, f"blank {self._count}")
        drawn = rotation_axis_frame(self._bench.truth, height).then(off)
        self.work = WorkPiece(self._part, self._count, seat or drawn)
        self._watcher = AxisWatcher(self._bench)
        self._now = now_s
        return self.work

    def change_wheel(self, now_s: float, *, roughing: bool) -> None:
        """Put on the roughing or the finishing wheel; what was cut until now was cut by the other one."""
        self.follow(now_s, whole=True)
        self._roughing = roughing

    @property
    def dresser(self) -> Dresser:
        """What dresses the wheel for each blank."""
        return self._dresser

    def unload(self, now_s: float) -> WorkPiece | None:
        """Take the work off; it stays at hand as ``last`` once the wheel has been in it."""
        self.follow(now_s, whole=True)
        taken, self.work = self.work, None
        if taken is not None and self._wheel.wear_um:
            self._dresser.worn_um += self._wheel.wear_um * len(taken.spaces)
            self._worn = self._worn[:1]
            self._body = self._worn[0] = self._dresser.body(0.0)
        if taken is not None and taken.passes:
            self.last = taken
        return taken

    def put(self, work: WorkPiece, now_s: float, number: int = 0) -> None:
        """A part ground elsewhere lies at hand as the one made last; what is on the table is taken off.

        It gets the next number, or keeps the one given.
        """
        self.unload(now_s)
        self._count += not number
        work.number = number or self._count
        self.last = work

    def latest(self, now_s: float) -> WorkPiece | None:
        """The part that was ground last, on the table or off it; None before the first."""
        self.follow(now_s, whole=True)
        on_table = self.work is not None and self.work.passes
        return self.work if on_table else self.last

    def follow(self, now_s: float, *, whole: bool = False) -> None:
        """Cut whatever the wheel went through since it was last asked, up to clock time `now_s`.

        A pass under way at that moment waits for the next time, unless `whole`.
        """
        if self.work is None:
            self._now = now_s
            return
        while self._now < now_s:
            end = min(now_s, self._now + LONGEST_LOOK_S)
            reached = self._stretch(self.work, self._now, end, whole=whole or end < now_s)
            if reached == self._now:
                return
            self._now = reached

    def _stretch(self, work: WorkPiece, start: float, end: float, *, whole: bool) -> float:
        """Cut what happened in this time; returns how far it got: no pass is taken in two halves unless `whole`."""
        coarse = np.linspace(start, end, max(int(np.ceil((end - start) / LOOK_S)) + 1, 2))
        x, z = (self._bench.machine.encoder(self._bench.cell.axis(name).name, coarse)[0] for name in "XZ")
        near = self._near(work, x, z)
        clear = int(np.flatnonzero(~near)[-1]) + 1 if not near.all() else 0
        if near[-1] and (clear > 1 or not whole):
            coarse = coarse[:clear]
        if len(coarse) < 2:
            return start
        self._follow(work, *refine_times(coarse, x, z, near))
        return float(coarse[-1])

    def _follow(self, work: WorkPiece, times: FloatArray, inside: BoolArray) -> None:
        motions = self._watcher.motions("XZC", times)
        if not inside.any():
            return
        close = {letter: _select_samples(motion, inside) for letter, motion in motions.items()}
        self._cut(work, times[inside], close, float(times[inside].mean()))

    def _near(self, work: WorkPiece, x: FloatArray, z: FloatArray) -> BoolArray:
        """Where the wheel's body can reach the stock of the blank, by nominal places (n,) mm."""
        stock = work.spec.grinding.stock_um * UM + MARGIN_MM
        reach = np.sqrt(2.0 * self._body.largest_mm * stock)
        deep = -x < self._part.grinding.centre_distance_mm + stock
        height = work.spec.grinding.height_mm
        return np.asarray(deep & (np.abs(z - height) < 0.5 * work.spec.gear.b + reach))

    def _cut(self, work: WorkPiece, times: FloatArray, motions: dict[str, AxisMotion], t: float) -> None:
        truth = self._bench.truth
        poses = self._relative(work, truth.frames(motions, t), times)
        pitch = 2.0 * np.pi / work.spec.gear.zc
        towards = np.arctan2(poses.origin[:, 1], poses.origin[:, 0])
        spaces = np.mod(np.rint(towards / pitch), work.spec.gear.zc).astype(int)
        swell = work.spec.expansion_ppm_per_k * 1e-6 * (truth.climate.true(t).material_degc - 20.0)
        for stretch in split_passes(times, poses.origin[:, 2], spaces):
            space = int(spaces[stretch.start])
            place = work.place_of(space)
            worn_mm = 0.0 if self._roughing else self._wheel.wear_side_um * UM * place
            cut = poses.part(stretch).moved(worn_mm)
            work.cut(GrindingPass(space, self._worn_body(place), cut, swell))

    def _worn_body(self, place: int) -> WheelBody:
        """The wheel after so many spaces since it was dressed; the roughing wheel is always the same."""
        if self._roughing:
            return self._rough
        if not self._wheel.wear_um:
            return self._body
        while len(self._worn) <= place:
            self._worn.append(self._dresser.body(self._wheel.wear_um * len(self._worn)))
        return self._worn[place]

    def _relative(self, work: WorkPiece, frames: dict[str, Pose], times: FloatArray) -> Poses:
        """The wheel in the work's frame."""
        count = len(times)
        wheel, seat = frames["Z"].then(self._seat), frames["C"].then(work.seat)
        away = np.broadcast_to(wheel.origin - seat.origin, (count, 3))
        back = np.broadcast_to(np.swapaxes(seat.rotation, 1, 2), (count, 3, 3))
        rotation = back @ np.broadcast_to(wheel.rotation, (count, 3, 3))
        return Poses(times, rotation, np.einsum("nij,nj->ni", back, away), self._dressed(times))

    def _dressed(self, times: FloatArray) -> FloatArray:
        """Where the profile is along the wheel's axis, (n,) mm: as it was dressed, or where an axis carries it."""
        letters = [axis.letter for axis in self._bench.cell.axes]
        if self._wheel.place not in letters:
            return np.full(len(times), self._offset_mm)
        name = self._bench.cell.axis(self._wheel.place).name
        return self._bench.machine.encoder(name, times)[0]


def _select_samples(motion: AxisMotion, which: BoolArray) -> AxisMotion:
    parts = (motion.position, motion.direction, motion.windup, motion.scatter)
    return AxisMotion(*(part if len(part) == 1 else part[which] for part in parts))
