"""The work piece: its nominal flank, the dressed wheel, and what the passes of the wheel have left of the blank.

Nominal flank (mm, rad). In the complex plane a pin's centre runs along w(t) = R exp(it) - a exp(i zp t); the disc's
flank is w minus the pin's radius along the unit normal -i w'/|w'|, which points out of the disc. t = 0 is the bottom of
the space that faces +X, t = +-pi/zc are its tips; space k is turned by 2 pi k/zc.

Wheel. It is a body of revolution about its own Y, with radius R(y). While it strokes along Z at centre distance E, a
point (x, y) of the work is reached when sqrt((E - x)^2 + dz^2) < R(y) for some dz of the stroke, that is when
E - x < R(y). What stays has the edge x = E - R(y); for it to be the wanted space, R(y) = E - x(y).

Entry. A ray starts at a point of the work and runs out of the material. In a pose's wheel frame its end q(e) lies
outside the wheel while F(e) = hypot(q_x, q_z) - R(q_y) > 0; the wheel begins where F = 0. What stays of the material is
the least such e over all poses: the most advanced pose has taken the rest. Poses are samples of a motion; between them
e is smooth in time, so the least value is the vertex of a parabola through the least sample and its neighbours.

A `WorkPiece` keeps, for each space, the passes that no later pass has cut away, and evaluates them where it is asked.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from simulators.cellfile import Clamping, Gear, Part
from simulators.truth import Pose, fixed_pose, generator

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
LENGTH_POINTS = 20001


@dataclass(frozen=True, slots=True)
class Rays:
    """Points (m, 3) and unit directions (m, 3), e.g. a flank's nominal points and outward normals, in mm."""

    points: FloatArray
    directions: FloatArray


class CycloidDisc:
    """The flanks of one disc as its data have them."""

    def __init__(self, gear: Gear) -> None:
        self.gear = gear
        self.circle = gear.rp + gear.drp
        self.pin = gear.rrp + gear.drrp
        self.half = np.pi / gear.zc

    @property
    def tip_mm(self) -> float:
        """Radius of the tips."""
        return self.circle + self.gear.a - self.pin

    def profile(self, t: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Points and outward normals of space 0 as complex numbers, shaped like t; both turned by ``drot``."""
        first = self.circle * np.exp(1j * t)
        second = self.gear.a * np.exp(1j * self.gear.zp * t)
        normal = first - self.gear.zp * second
        normal = normal / np.abs(normal)
        turn = np.exp(1j * np.sign(t) * self.gear.drot)
        return (first - second - self.pin * normal) * turn, normal * turn

    def length(self, t: FloatArray) -> FloatArray:
        """Length of the flank in mm from the bottom of the space, signed like t (|t| <= half a lobe)."""
        fine = np.linspace(0.0, self.half, LENGTH_POINTS)
        points = self.profile(fine)[0] * np.exp(-1j * np.sign(fine) * self.gear.drot)
        along = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(points)))))
        return np.asarray(np.sign(t) * np.interp(np.abs(t), fine, along))

    def even(self, count: int, share: float = 0.95) -> FloatArray:
        """t of `count` points of one space, both flanks, in equal steps along this share of the flank's length."""
        fine = np.linspace(-self.half, self.half, LENGTH_POINTS)
        along = self.length(fine)
        return np.asarray(np.interp(np.linspace(-share, share, count) * along[-1], along, fine))

    def rays(self, space: int, t: FloatArray, z: FloatArray) -> Rays:
        """Nominal points and outward normals of a space at t (T,) and heights z (Z,): m = T * Z, z fastest."""
        turn = np.exp(2j * self.half * space)
        point, normal = (np.repeat(part * turn, len(z)) for part in self.profile(t))
        heights = np.tile(z, len(t))
        return Rays(
            np.stack((point.real, point.imag, heights), axis=1),
            np.stack((normal.real, normal.imag, np.zeros_like(heights)), axis=1),
        )


KNOTS = 1501


class WheelBody:
    """Radius over the axial place; beyond the tips of the space it goes on along the tangent.

    ``surplus`` (mm) at signed t says what the profile leaves of the part along the normal, where it is not perfect.
    """

    def __init__(
        self,
        lobes: CycloidDisc,
        centre_distance_mm: float,
        excess_mm: float = 0.0,
        surplus: Callable[[FloatArray], FloatArray] | None = None,
    ) -> None:
        # From just beside the bottom, where the two flanks may be turned apart: each side is the other's mirror,
        # but for what the dresser left.
        t = np.linspace(1e-9, lobes.half, KNOTS)
        points, normals = lobes.profile(t)
        slopes = normals.imag / normals.real
        distance = centre_distance_mm + excess_mm
        self._sides = {}
        for side in (1.0,) if surplus is None else (1.0, -1.0):
            edge = points if surplus is None else points + surplus(side * t) * normals
            ends = (slopes[0], slopes[-1])
            if surplus is not None:
                first, last = (np.gradient(part.real, part.imag, edge_order=2) for part in (edge[:3], edge[-3:]))
                ends = (-first[0], -last[-1])
            radius = CubicSpline(edge.imag, distance - edge.real, bc_type=((1, ends[0]), (1, ends[-1])))
            self._sides[side] = (float(edge.imag[0]), float(edge.imag[-1]), radius, radius.derivative())
        self.largest_mm = float(distance - points.real[0])

    def radius(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Radius at axial places y (any shape) and its slope there, mm and mm/mm."""
        found = {side: self._half(side, y) for side in self._sides}
        if len(found) == 1:
            return found[1.0]
        left = y >= 0.0
        return np.where(left, found[1.0][0], found[-1.0][0]), np.where(left, found[1.0][1], found[-1.0][1])

    def _half(self, side: float, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        first, last, radius, derivative = self._sides[side]
        along = np.abs(y)
        inside = np.clip(along, first, last)
        slope = derivative(inside)
        return radius(inside) + slope * (along - inside), np.sign(y) * slope


NEWTON = 5
RUINED_MM = -1.0
FACING = -0.05


@dataclass(frozen=True, slots=True)
class Poses:
    """The wheel in the work's frame over a stretch of motion: times (n,), rotations (n, 3, 3), origins (n, 3).

    ``shift`` (n,) is where the dressed profile sits along the wheel's axis, mm.
    """

    times: FloatArray
    rotation: FloatArray
    origin: FloatArray
    shift: FloatArray

    def part(self, which: slice | NDArray[np.bool_]) -> Poses:
        """Some of them."""
        return Poses(self.times[which], self.rotation[which], self.origin[which], self.shift[which])

    def moved(self, along_mm: float) -> Poses:
        """The same with the dressed profile moved along the wheel's axis."""
        return replace(self, shift=self.shift + along_mm) if along_mm else self


def entry_depth(body: WheelBody, poses: Poses, rays: Rays) -> FloatArray:
    """Least e over one pass of the wheel, (m,) mm; inf where the wheel never came near a ray."""
    rough = _estimate(body, poses, rays)
    best = np.argmin(rough, axis=0)
    last = len(poses.times) - 1
    around = np.clip(best + np.asarray([[-1], [0], [1]]), 0, last)
    start = np.take_along_axis(rough, around, axis=0)
    exact = _solve_entry(body, poses, rays, around, start)
    least = _vertex(poses.times[around], exact)
    whole = np.all(np.isfinite(exact), axis=0) & (best > 0) & (best < last)
    return np.asarray(np.where(whole, least, np.min(exact, axis=0)))


def _estimate(body: WheelBody, poses: Poses, rays: Rays) -> FloatArray:
    """One Newton step from the ray's start at every pose, (n, m)."""
    point = (rays.points[None] - poses.origin[:, None]) @ poses.rotation
    way = rays.directions[None] @ poses.rotation
    value, slope = _outside_wheel(body, point, way, poses.shift[:, None])
    return _newton_step(np.zeros_like(value), value, slope)


def _outside_wheel(body: WheelBody, q: FloatArray, way: FloatArray, shift: FloatArray) -> tuple[FloatArray, FloatArray]:
    """F and dF/de for ends q (..., 3) that move along `way`."""
    rho = np.hypot(q[..., 0], q[..., 2])
    radius, grade = body.radius(q[..., 1] - shift)
    moving = (q[..., 0] * way[..., 0] + q[..., 2] * way[..., 2]) / rho
    return rho - radius, moving - grade * way[..., 1]


def _newton_step(e: FloatArray, value: FloatArray, slope: FloatArray) -> FloatArray:
    facing = slope < FACING
    step = value / np.where(facing, slope, -1.0)
    return np.asarray(np.where(facing, np.maximum(e - step, RUINED_MM), np.inf))


def _solve_entry(body: WheelBody, poses: Poses, rays: Rays, which: NDArray[np.int64], e: FloatArray) -> FloatArray:
    """The entry at these poses of each ray, which (3, m), from a first estimate."""
    turned = poses.rotation[which]
    point = np.einsum("pmi,pmij->pmj", rays.points[None] - poses.origin[which], turned)
    way = np.einsum("mi,pmij->pmj", rays.directions, turned)
    shift = poses.shift[which]
    for _ in range(NEWTON):
        known = np.where(np.isfinite(e), e, 0.0)
        value, slope = _outside_wheel(body, point + known[..., None] * way, way, shift)
        e = np.where(np.isfinite(e), _newton_step(known, value, slope), np.inf)
    return e


def _vertex(t: FloatArray, e: FloatArray) -> FloatArray:
    """The least value of the parabolas through three samples (3, m), the middle one being the least."""
    left, right = t[0] - t[1], t[2] - t[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = (e[0] - e[1]) / left, (e[2] - e[1]) / right
        bend = (high - low) / (right - left)
        grade = low - bend * left
        drop = grade**2 / (4.0 * bend)
        drop = np.where(np.isfinite(drop) & (bend > 0.0), drop, 0.0)
    return np.asarray(e[1] - drop)


ARCSEC = np.pi / 180.0 / 3600.0
UM = 1e-3
SURELY_MM = 0.004


@dataclass(frozen=True, slots=True)
class GrindingPass:
    """The wheel going once through one space. ``swell`` is the work's expansion beyond 20 degC, m/m."""

    space: int
    body: WheelBody
    poses: Poses
    swell: float


def draw_clamping(clamping: Clamping, seed: int, *names: str) -> Pose:
    """Where a part comes to sit when somebody clamps it: its frame in that of the axis, drawn by the seed."""
    rng = generator(seed, "clamping", *names)
    x, y, a, b, turned = rng.normal(0.0, 0.5, 5)
    off, tilt = clamping.eccentric_um * UM, clamping.tilt_arcsec * ARCSEC
    return fixed_pose((x * off, y * off, 0.0), (a * tilt, b * tilt, turned * clamping.turned_arcsec * ARCSEC))


class WorkPiece:
    """A disc with its true flanks, which the passes made so far have left. + = surplus material."""

    def __init__(self, spec: Part, number: int, seat: Pose) -> None:
        """``seat`` is the part's frame in the table's; z = 0 is the middle of the face width."""
        self.spec = spec
        self.number = number
        self.seat = seat
        self.lobes = CycloidDisc(spec.gear)
        self._passes: dict[int, list[tuple[GrindingPass, FloatArray]]] = {}

    @property
    def spaces(self) -> tuple[int, ...]:
        """Spaces the wheel has been in."""
        return tuple(sorted(self._passes))

    def place_of(self, space: int) -> int:
        """How many other spaces were ground before this one."""
        known = list(self._passes)
        return known.index(space) if space in self._passes else len(known)

    @property
    def passes(self) -> int:
        """How many times the wheel went through a space so far."""
        return sum(len(found) for found in self._passes.values())

    @property
    def finished(self) -> bool:
        """Whether every space has been ground."""
        return len(self._passes) == self.spec.gear.zc

    def cut(self, made: GrindingPass) -> None:
        """The wheel went through a space once more; passes that later ones have cut away are forgotten."""
        known, depth = self._passes.setdefault(made.space, []), self._depth(made)
        if not np.isfinite(depth).all():
            known.append((made, depth))
        elif not any(np.all(depth > other + SURELY_MM) for _, other in known):
            known[:] = [one for one in known if not np.all(one[1] > depth + SURELY_MM)] + [(made, depth)]

    def _depth(self, made: GrindingPass) -> FloatArray:
        """How deep a pass went at a few places of its space, (9,) mm."""
        z = 0.45 * self.spec.gear.b * np.asarray([-1.0, 0.0, 1.0])
        probes = self.lobes.rays(made.space, 0.9 * self.lobes.half * np.asarray([-1.0, 0.0, 1.0]), z)
        return entry_depth(made.body, made.poses, probes)

    def surface(self, space: int, rays: Rays) -> FloatArray:
        """How far along rays of the part's frame (at 20 degC) the surface of a space lies, (m,) mm.

        The blank's stock where no wheel went; -1 mm where it went much too deep.
        """
        left = np.full(len(rays.points), self.spec.grinding.stock_um * UM)
        for made, _ in self._passes.get(space, ()):
            grown = Rays(rays.points * (1.0 + made.swell), rays.directions)
            left = np.minimum(left, entry_depth(made.body, made.poses, grown) / (1.0 + made.swell))
        return left

    def surplus_um(self, spaces: FloatArray, t: FloatArray, z: FloatArray) -> FloatArray:
        """Surplus material along the nominal normals (K, T, Z) in um: the part in its own frame."""
        flanks = [self.surface(int(k), self.lobes.rays(int(k), t, z)).reshape(len(t), len(z)) for k in spaces]
        return np.stack(flanks) / UM
