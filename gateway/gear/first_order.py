"""First-order flank deviation e1 = A n_x + B n_y + G h, its second-order correction and its bound (mm, rad).

Twists are taken in the work and turned into the frame of the space, origin on the gear's axis. On a spur
flank only A = delta_x + z eps_y, B = delta_y - z eps_x and G = eps_z act; e > 0 is surplus material. k, theta and
z are arrays that broadcast together, e.g. (K, 1, 1), (T, 1) and (Z,) for a grid (`gateway.gear.flank.FlankGrid`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from drivers.types.values import FloatArray
from gateway.gear.cycloid import ProfileSection
from gateway.gear.grinding import Grinding
from gateway.model import se3

STEP = 1e-3  # mm of stroke, for the slope of e1 along the stroke
THETA_STEP = 1e-5  # rad, for the slope of the curvature
MARGIN = 1.5  # of the bound over the sum of the second-order terms
FLOOR = 1e-8  # mm, rounding and what is left at third order for tiny errors


@dataclass(frozen=True, slots=True)
class FirstOrder:
    """First-order deviation with what is known about its truth, all of the broadcast shape, mm.

    ``deviation`` is e1, ``second`` the second-order value e2, ``third`` adds to e2 what the change of the profile's
    curvature does; ``bound`` is a limit for |e1 - exact|.
    """

    deviation: FloatArray
    second: FloatArray
    third: FloatArray
    bound: FloatArray

    def good_enough(self, tolerance: float) -> bool:
        """True if no point can be wrong by more than ``tolerance`` (mm); else use the exact flank."""
        return bool(np.max(self.bound) <= tolerance)


def local_twist(grinding: Grinding, k: ArrayLike, z: ArrayLike) -> FloatArray:
    """First-order relative twist (..., 6) in the frame of space k with the wheel at height z (mm)."""
    return to_space(grinding, k, grinding.twist(grinding.commands(k, z)))


def to_space(grinding: Grinding, k: ArrayLike, twist: FloatArray) -> FloatArray:
    """Work-frame twists (..., 6) turned into the frame of space k."""
    turn = se3.rpy(0.0, 0.0, -grinding.gear.space_angle(k))
    parts = twist.reshape(*twist.shape[:-1], 2, 3)
    local = (turn[..., None, :, :] @ parts[..., None])[..., 0]
    return np.asarray(local.reshape(*local.shape[:-2], 6))


def abg(twist: FloatArray, z: ArrayLike) -> FloatArray:
    """A, B (mm) and G (rad), shape (..., 3), of space-frame twists (..., 6) acting at height z."""
    height = np.asarray(z, dtype=np.float64)
    dx, dy, ex, ey, ez = (twist[..., i] for i in (0, 1, 3, 4, 5))
    return np.stack(np.broadcast_arrays(dx + height * ey, dy - height * ex, ez), axis=-1)


def flank_abg(grinding: Grinding, k: ArrayLike, z: ArrayLike) -> FloatArray:
    """A, B, G of the machine, shape (broadcast of k and z, 3); all that reaches a spur flank at first order."""
    return abg(local_twist(grinding, k, z), z)


def along_normal(section: ProfileSection, terms: FloatArray) -> FloatArray:
    """A n_x + B n_y + G h of (..., 3)."""
    return terms[..., 0] * section.nx + terms[..., 1] * section.ny + terms[..., 2] * section.h


def first_order(grinding: Grinding, k: ArrayLike, theta: ArrayLike, z: ArrayLike) -> FloatArray:
    """e1 (mm) of the machine's and the wheel's errors, broadcast shape of k, theta and z."""
    t = np.asarray(theta, dtype=np.float64)
    section = grinding.gear.section(t)
    return along_normal(section, flank_abg(grinding, k, z)) + grinding.dressing.first_order(section, t)


def stroke_slope(grinding: Grinding, section: ProfileSection, k: ArrayLike, z: ArrayLike) -> FloatArray:
    """g = d e1 / d stroke with the point held (mm/mm)."""
    at = np.asarray(z, dtype=np.float64)
    above, below = (abg(local_twist(grinding, k, at + step), at) for step in (STEP, -STEP))
    return along_normal(section, (above - below) / (2.0 * STEP))


def judged(grinding: Grinding, k: ArrayLike, theta: ArrayLike, z: ArrayLike) -> FirstOrder:
    """First order with its second-order correction and bound.

    e2 = d_n + d_t w_z - kappa d_t^2/2 - d_z (w_t + g) - R g^2/(2 n_x): d the exact displacement of the point,
    t = z x n, w the exact rotation; e3 = e2 + kappa' d_t^3/6. The bound is `MARGIN` times the sum of the
    second-order terms, each taken positive.
    """
    t = np.asarray(theta, dtype=np.float64)
    section = grinding.gear.section(t)
    e1 = along_normal(section, flank_abg(grinding, k, z)) + grinding.dressing.first_order(section, t)
    d, w = _displacement(grinding, section, k, np.asarray(z, dtype=np.float64))
    d = (d[0] - grinding.dressing.radius, d[1] + grinding.dressing.offset, d[2])
    dn, dt = d[0] * section.nx + d[1] * section.ny, d[1] * section.nx - d[0] * section.ny
    wt = w[1] * section.nx - w[0] * section.ny
    g = stroke_slope(grinding, section, k, z)
    profile = grinding.dressing.deviation(t - dt / section.speed)
    R = grinding.E - section.x
    terms = (
        dn + profile - e1,
        dt * w[2],
        -0.5 * section.curvature * dt**2,
        -d[2] * (wt + g),
        -0.5 * R * g**2 / section.nx,
    )
    second = e1 + sum(terms)
    third = second + _curvature_slope(grinding, t) / section.speed * dt**3 / 6.0
    bound = MARGIN * sum(np.abs(term) for term in terms) + FLOOR
    return FirstOrder(*np.broadcast_arrays(e1, second, third, bound))


def _curvature_slope(grinding: Grinding, theta: FloatArray) -> FloatArray:
    """d kappa / d theta by central difference."""
    above, below = (grinding.gear.section(theta + step).curvature for step in (THETA_STEP, -THETA_STEP))
    return np.asarray((above - below) / (2.0 * THETA_STEP))


def _displacement(
    grinding: Grinding, section: ProfileSection, k: ArrayLike, z: FloatArray
) -> tuple[tuple[FloatArray, FloatArray, FloatArray], tuple[FloatArray, FloatArray, FloatArray]]:
    """Exact displacement of the points by E_W = T_act inv(T_id) and its rotation vector, in the space's frame."""
    q = grinding.commands(k, z)
    E = grinding.actual(q) @ se3.inverse(grinding.chain.ideal(q))
    turn = se3.rpy(0.0, 0.0, -grinding.gear.space_angle(k))
    change = turn @ (E[..., :3, :3] - np.eye(3)) @ np.swapaxes(turn, -1, -2)
    shift = se3.apply(turn, E[..., :3, 3])
    w = se3.apply(turn, se3.rotation_vector(E[..., :3, :3]))
    x, y = section.x, section.y
    d = [change[..., i, 0] * x + change[..., i, 1] * y + change[..., i, 2] * z + shift[..., i] for i in range(3)]
    return (d[0], d[1], d[2]), (w[..., 0], w[..., 1], w[..., 2])
