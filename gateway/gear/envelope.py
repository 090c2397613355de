"""The flank the actual machine grinds, exact: envelope of the wheel along its stroke, for many points at once (mm, rad).

A nominal flank point sends a ray along its outward normal. Seen from the wheel the ray meets the body at e(s) for each
stroke height s; the deviation is the least of these, where n . v = 0. Newton in (theta, e, s), the angle of the
wheel eliminated, kept in a bracket; where the stroke errors bend more than the wheel, a scan finds the valley first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.types import FloatArray
from gateway.errors import ModelError
from gateway.gear.cycloid import Section
from gateway.gear.first_order import abg, along_normal, local_twist, stroke_slope
from gateway.gear.grinding import Grinding
from gateway.gear.valley import deepest
from gateway.model.parts import Vector, cross, vector
from gateway.model.stroke import Stroke, split

BLOCK = 8192  # points: what fits the processor's caches
TOLERANCE = 1e-12  # mm, on e
STEPS = 80
FULL_STEPS = 3  # steps taken by whole blocks before those still open go on alone
LONGEST_STEP = 1.0  # mm of stroke


@dataclass(frozen=True, slots=True)
class _Rays:
    """Entered nominal points and normals of a block, flat, with their unknowns' frame."""

    grinding: Grinding
    stroke: Stroke
    point: Vector
    normal: Vector

    def at(self, which: NDArray[np.bool_]) -> _Rays:
        """Only the rays marked."""
        stroke = self.stroke
        if stroke.outer.ndim > 2:
            stroke = replace(stroke, outer=stroke.outer[which])
        return replace(self, stroke=stroke, point=_pick(self.point, which), normal=_pick(self.normal, which))


@dataclass(frozen=True, slots=True)
class _State:
    """Unknowns and the bracket of the stroke height, flat arrays."""

    theta: FloatArray
    e: FloatArray
    s: FloatArray
    low: FloatArray
    high: FloatArray

    def at(self, which: NDArray[np.bool_]) -> _State:
        """Only those marked."""
        return _State(self.theta[which], self.e[which], self.s[which], self.low[which], self.high[which])


def exact(grinding: Grinding, k: ArrayLike, theta: ArrayLike, z: ArrayLike) -> FloatArray:
    """Normal deviation e (mm, + surplus) of the ground flank at nominal points; k, theta, z broadcast together.

    Works in blocks, so that memory does not grow with the number of points beyond the result.
    Raises ModelError E-GEAR-ENVELOPE if a point finds no contact.
    """
    k, theta, z = (np.asarray(value, dtype=np.float64) for value in (k, theta, z))
    shape = np.broadcast_shapes(k.shape, theta.shape, z.shape)
    out = np.empty(shape)
    for block in blocks(shape, BLOCK):
        out[block] = _block(grinding, _cut(k, block, shape), _cut(theta, block, shape), _cut(z, block, shape))
    return out


def blocks(shape: tuple[int, ...], limit: int) -> Iterator[tuple[slice, ...]]:
    """Slices of the leading axes that cut a shape into pieces of at most ``limit`` points where they can."""
    rest = int(np.prod(shape[1:], dtype=np.int64)) if shape else 1
    if not shape or rest * shape[0] <= limit:
        yield ()
    elif rest <= limit:
        step = max(1, limit // max(rest, 1))
        for start in range(0, shape[0], step):
            yield (slice(start, start + step),)
    else:
        for start in range(shape[0]):
            for inner in blocks(shape[1:], limit):
                yield (slice(start, start + 1), *inner)


def _cut(array: FloatArray, block: tuple[slice, ...], shape: tuple[int, ...]) -> FloatArray:
    """The part of a broadcasting array that belongs to a block."""
    skipped = len(shape) - array.ndim
    index = [part if array.shape[i] > 1 else slice(None) for i, part in enumerate(block[skipped:])]
    return np.asarray(array[tuple(index)])


def _block(grinding: Grinding, k: FloatArray, theta: FloatArray, z: FloatArray) -> FloatArray:
    shape = np.broadcast_shapes(k.shape, theta.shape, z.shape)
    local = grinding.gear.section(theta)
    rays = _enter(grinding, local, k, z, shape)
    state = _start(grinding, local, k, theta, z, shape)
    return _solve(rays, state).reshape(shape)


def _enter(grinding: Grinding, local: Section, k: FloatArray, z: FloatArray, shape: tuple[int, ...]) -> _Rays:
    q = grinding.commands(k, np.zeros(()))
    stroke = split(grinding.chain, grinding.stroke, q)
    nominal = local.turned(grinding.gear.space_angle(k))
    zero = np.zeros(())
    point, normal = stroke.enter((nominal.x, nominal.y, z), (nominal.nx, nominal.ny, zero))
    if stroke.outer.ndim > 2:
        stroke = replace(stroke, outer=np.broadcast_to(stroke.outer, (*shape, 4, 4)).reshape(-1, 4, 4))
    return _Rays(grinding, stroke, _flat(point, shape), _flat(normal, shape))


def _start(
    grinding: Grinding, local: Section, k: FloatArray, theta: FloatArray, z: FloatArray, shape: tuple[int, ...]
) -> _State:
    """First-order guess: e1 - R g^2/(2 n_x) at s = z - R g/n_x, or the deepest valley of a scan."""
    R = grinding.E - local.x
    e = along_normal(local, abg(local_twist(grinding, k, z), z))
    g = stroke_slope(grinding, local, k, z)
    s = z - np.clip(R * g / local.nx, -LONGEST_STEP, LONGEST_STEP)
    e = e - 0.5 * R * g**2 / local.nx + grinding.dressing.first_order(local, theta)
    found = deepest(grinding, local, k, z, shape)
    low, high = np.broadcast_to(-np.inf, shape), np.broadcast_to(np.inf, shape)
    if found is not None:
        s, low, high = found
    flat = [np.broadcast_to(part, shape).ravel() for part in (theta, e, s, low, high)]
    return _State(*flat)


def _solve(rays: _Rays, state: _State) -> FloatArray:
    """e of every ray: whole blocks first, then only the rays that are still moving."""
    out = np.empty_like(state.e)
    index = np.arange(out.size)
    for step in range(STEPS):
        state, left = _step(rays, state)
        if not np.any(open_ := left > TOLERANCE):
            out[index] = state.e
            return out
        if step >= FULL_STEPS - 1:
            out[index] = state.e
            rays, state, index = rays.at(open_), state.at(open_), index[open_]
    raise ModelError("E-GEAR-ENVELOPE", "flank", count=index.size, steps=STEPS, left=float(np.nanmax(left)))


def _step(rays: _Rays, state: _State) -> tuple[_State, FloatArray]:
    """One safeguarded Newton step; also how far e may still have been away before it (mm)."""
    motion = _motion(rays, state)
    profile = rays.grinding.dressing.section(rays.grinding.gear, state.theta)
    dn, dt, f, slopes = _residual(rays, profile, motion)
    grade = f.s + slopes * motion.tangent_s(profile)
    across = f.e + slopes * motion.tangent_e(profile)
    pull = f.value + slopes * dt - across * dn / f.a
    grade = grade + across * f.value / f.a
    low, high = np.where(pull < 0.0, state.s, state.low), np.where(pull < 0.0, state.high, state.s)
    return state, dn
