"""The flank the actual machine grinds, exact: envelope of the wheel along its stroke, in blocks (mm, rad).

A nominal flank point sends a ray along its outward normal. Seen from the wheel the ray meets the body at e(s) for each
stroke height s; the deviation is the least of these, where n . v = 0. Newton in (theta, e, s) kept in a bracket
(`ray`); where the stroke errors bend more than the wheel, a scan finds the valley first (`valley`).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from drivers.types.values import FloatArray
from gateway.errors import ModelError
from gateway.gear.cycloid import ProfileSection
from gateway.gear.first_order import abg, along_normal, local_twist, stroke_slope
from gateway.gear.grinding import Grinding
from gateway.gear.wheel_passage import LONGEST_STEP, FlankRays, RayState, passage, step
from gateway.model.transforms import Vector

BLOCK = 8192  # points: what fits the processor's caches
TOLERANCE = 1e-12  # mm, on e
STEPS = 80
TOGETHER = 3  # steps taken by whole blocks before those still open go on alone


def exact(grinding: Grinding, k: ArrayLike, theta: ArrayLike, z: ArrayLike) -> FloatArray:
    """Normal deviation e (mm, + surplus) of the ground flank at nominal points; k, theta, z broadcast together.

    Works in blocks: beyond the result, memory does not grow with the number of points.
    Raises ModelError E-GEAR-ENVELOPE if a point finds no contact.
    """
    parts = [np.asarray(value, dtype=np.float64) for value in (k, theta, z)]
    shape = np.broadcast_shapes(*(part.shape for part in parts))
    parts = [part.reshape((1,) * (len(shape) - part.ndim) + part.shape) for part in parts]
    out = np.empty(shape)
    for block in blocks(shape, BLOCK):
        out[block] = _block(grinding, *(_cut(part, block) for part in parts))
    return out


def blocks(shape: tuple[int, ...], limit: int) -> Iterator[tuple[slice, ...]]:
    """Slices of the leading axes that cut an array of that shape into pieces of at most ``limit`` points."""
    inner = int(np.prod(shape[1:], dtype=np.int64))
    if not shape or inner * shape[0] <= limit:
        yield ()
    elif inner <= limit:
        size = limit // max(inner, 1)
        yield from ((slice(first, first + size),) for first in range(0, shape[0], size))
    else:
        for first in range(shape[0]):
            yield from ((slice(first, first + 1), *rest) for rest in blocks(shape[1:], limit))


def _cut(array: FloatArray, block: tuple[slice, ...]) -> FloatArray:
    """The part of a broadcasting array that belongs to a block of the whole."""
    return array[tuple(part if array.shape[i] > 1 else slice(None) for i, part in enumerate(block))]


def _block(grinding: Grinding, k: FloatArray, theta: FloatArray, z: FloatArray) -> FloatArray:
    rays, state = prepare(grinding, k, theta, z)
    return _solve(rays, state).reshape(np.broadcast_shapes(k.shape, theta.shape, z.shape))


def prepare(grinding: Grinding, k: FloatArray, theta: FloatArray, z: FloatArray) -> tuple[FlankRays, RayState]:
    """The rays of nominal points (arrays that broadcast together, flattened) and where Newton starts."""
    shape = np.broadcast_shapes(k.shape, theta.shape, z.shape)
    local = grinding.gear.section(theta)
    return _enter(grinding, local, k, z, shape), _start(grinding, local, k, theta, z, shape)


def _enter(
    grinding: Grinding, local: ProfileSection, k: FloatArray, z: FloatArray, shape: tuple[int, ...]
) -> FlankRays:
    """The block's rays, entered into the stroke's passage."""
    past = passage(grinding, k)
    nominal = local.turned(grinding.gear.space_angle(k))
    point, normal = past.enter((nominal.x, nominal.y, z), (nominal.nx, nominal.ny, np.zeros(())))
    return FlankRays(grinding, past.spread(shape), _flat(point, shape), _flat(normal, shape))


def _start(
    grinding: Grinding, local: ProfileSection, k: FloatArray, theta: FloatArray, z: FloatArray, shape: tuple[int, ...]
) -> RayState:
    """e1 - R g^2/(2 n_x) at s = z - R g/n_x, or the deepest valley of a scan."""
    R = grinding.E - local.x
    g = stroke_slope(grinding, local, k, z)
    e = along_normal(local, abg(local_twist(grinding, k, z), z)) + grinding.dressing.first_order(local, theta)
    guess = z - np.clip(R * g / local.nx, -LONGEST_STEP, LONGEST_STEP)
    s, low, high = deepest(grinding, local, k, z) or (guess, np.asarray(-np.inf), np.asarray(np.inf))
    parts = (theta, e - 0.5 * R * g**2 / local.nx, s, low, high)
    return RayState(*(np.broadcast_to(part, shape).ravel() for part in parts))


def _solve(rays: FlankRays, state: RayState) -> FloatArray:
    """e of every ray: the whole block first, then only the rays that are still moving."""
    out, index, left = np.empty_like(state.e), np.arange(state.e.size), state.e
    for count in range(1, STEPS + 1):
        state, left = step(rays, state)
        still = ~(left <= TOLERANCE)
        if count >= TOGETHER or not np.any(still):
            out[index] = state.e
            if not np.any(still):
                return out
            rays, state, index = rays.at(still), state.at(still), index[still]
    raise ModelError("E-GEAR-ENVELOPE", "flank", count=index.size, steps=STEPS, left=float(np.max(left)))


def _flat(v: Vector, shape: tuple[int, ...]) -> Vector:
    x, y, z = (np.broadcast_to(part, shape).ravel() for part in v)
    return x, y, z


# ---- Where along the stroke the wheel cuts deepest when stroke errors bend more than the wheel does (mm, rad).

SPACING = 0.25  # mm of stroke between the nodes of the scan
REACH = 12.0  # mm of stroke looked at on each side, at most
SHARE = 0.4  # of the wheel's curvature that the errors may bend before a scan is needed
ANGLES = ("ea", "eb", "ec")

Found = tuple[FloatArray, FloatArray, FloatArray]


def deepest(grinding: Grinding, local: ProfileSection, k: FloatArray, z: FloatArray) -> Found | None:
    """Stroke height of the deepest cut and its bracket, broadcast shape; None where one valley is certain.

    The cut is judged by e1(point held; s) + n_x (s - z)^2 / (2 R), every `SPACING` of s.
    """
    nodes = np.arange(np.min(z) - REACH, np.max(z) + REACH + SPACING, SPACING)
    wheel = local.nx / (grinding.E - local.x)
    if _bend(grinding, local, k, nodes) < SHARE * float(np.min(wheel)):
        return None
    twists = local_twist(grinding, k[..., None], nodes)
    reach = min(REACH, float(np.sqrt(2.0 * _span(twists, local, z) / np.min(wheel))))
    s = _scan(local, wheel, twists, z, nodes, int(np.ceil(reach / SPACING)))
    return s, s - 1.5 * SPACING, s + 1.5 * SPACING


def _bend(grinding: Grinding, local: ProfileSection, k: FloatArray, nodes: FloatArray) -> float:
    """Upper limit of |d2 e1 / ds2| from the stroke axis' own error motions and from tables over the stroke."""
    axis = grinding.chain.axis(grinding.stroke)
    lever = abs(grinding.E) + float(np.max(np.abs(nodes)))
    total = 0.0
    for key, motion in axis.err.items():
        if callable(motion):
            values = axis.value(key, grinding.stroke_command(nodes))
            second = float(np.max(np.abs(np.diff(values, 2)))) / SPACING**2
            slope = float(np.max(np.abs(np.diff(values)))) / SPACING
            total += lever * second + 2.0 * slope if key in ANGLES else second
    for table in grinding.tables:
        if grinding.stroke in table.inputs:
            values = table.added(grinding.commands(k[..., None], nodes))
            turning = grinding.chain.axis(table.out).kind == "revolute"
            arm = float(np.max(np.abs(local.h))) if turning else 1.0
            total += arm * float(np.max(np.abs(np.diff(values, 2)))) / SPACING**2
    return total


def _span(twists: FloatArray, local: ProfileSection, z: FloatArray) -> float:
    """How much e1 can change along the stroke."""
    span = np.max(np.ptp(twists, axis=-2), axis=tuple(range(twists.ndim - 2)))
    high = float(np.max(np.abs(z)))
    return float(span[0] + span[1] + high * (span[3] + span[4]) + np.max(np.abs(local.h)) * span[5])


def _scan(
    local: ProfileSection, wheel: FloatArray, twists: FloatArray, z: FloatArray, nodes: FloatArray, reach: int
) -> FloatArray:
    """The node with the least e, looked for ``reach`` nodes to each side of z."""
    shape = np.broadcast_shapes(twists.shape[:-2], z.shape)
    wide = np.broadcast_to(twists, (*shape, *twists.shape[-2:]))
    middle = np.broadcast_to(np.rint((z - nodes[0]) / SPACING).astype(np.int64), shape)
    least: FloatArray | None = None
    best: FloatArray | None = None
    for offset in range(-reach, reach + 1):
        index = np.clip(middle + offset, 0, nodes.size - 1)
        twist = np.take_along_axis(wide, index[..., None, None], axis=-2)[..., 0, :]
        s = nodes[index]
        e = along_normal(local, abg(twist, z)) + 0.5 * wheel * (s - z) ** 2
        s = np.broadcast_to(s, e.shape)
        if least is None or best is None:
            least, best = e, s
        else:
            least, best = np.minimum(e, least), np.where(e < least, s, best)
    return best if best is not None else z
