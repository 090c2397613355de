"""Where along the stroke the wheel cuts deepest when stroke errors bend more than the wheel does (mm, rad)."""

from __future__ import annotations

import numpy as np

from drivers.types.values import FloatArray
from gateway.gear.cycloid import ProfileSection
from gateway.gear.first_order import abg, along_normal, local_twist
from gateway.gear.grinding import Grinding

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
