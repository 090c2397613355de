"""Commands that make the actual machine stand right: on the flank (least squares) or at the wheel centre (mm, rad).

The chain gives the pose of the wheel against the work for any commands, with and without errors. Wanted are changes
dq of some commands so that the actual pose does what the ideal one would. Two residuals: the normal distance of the
profile's points after T_act(q + dq) T_id(q)^-1, or the three coordinates of the wheel centre. Gauss and Newton: the
Jacobian by central differences (exact to second order in a step of 0.1 um), columns scaled by their steps so that mm
and rad compare, the change by least squares of minimum norm, full steps. Errors are a few um and the chain is nearly
linear in them: each round gains about five digits, so it ends in three or four. It ends when every change is below
1e-11 of its value; after STEPS rounds it is an error, not an answer. Redundant commands share a correction by minimum
norm. On a flank the first residual is the right one: a rotation that moves the wheel centre back also turns the
profile.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from drivers.types import FloatArray
from gateway.errors import ModelError
from gateway.gear.grinding import Grinding
from gateway.model import se3
from gateway.model.chain import Chain, Positions, position

STEPS = 20
STEP = 1e-4  # mm or rad x 1e-2, of the difference quotients
SMALLEST = 1e-15


@dataclass(frozen=True, slots=True)
class FlankInverse:
    """Corrections to add to infeed (mm) and index (rad), and the RMS normal deviation (mm) they leave."""

    dx: float
    dc: float
    rms: float


def flank_inverse(grinding: Grinding, k: int, z: float, thetas: ArrayLike) -> FlankInverse:
    """(dx, dc) that minimise sum [n . (T_act(q + dq) inv(T_id(q)) r - r)]^2 over profile points at height z.

    The stroke has no first-order effect on a spur flank and stays as it is.
    """
    q = grinding.commands(float(k), float(z))
    s = grinding.gear.space(thetas, float(k))
    points = np.stack([s.x, s.y, np.full_like(s.x, z)], axis=-1)
    normals = np.stack([s.nx, s.ny, np.zeros_like(s.x)], axis=-1)
    back = se3.inverse(grinding.chain.ideal(q))

    def residual(dq: FloatArray) -> FloatArray:
        T = grinding.chain.actual(_moved(q, (grinding.infeed, grinding.index), dq)) @ back - np.eye(4)
        return np.einsum("ij,ij->i", normals, points @ T[:3, :3].T + T[:3, 3])

    dq = _gauss_newton(residual, np.array([STEP, 0.01 * STEP]))
    return FlankInverse(float(dq[0]), float(dq[1]), float(np.sqrt(np.mean(residual(dq) ** 2))))


def pose_inverse(chain: Chain, q: Positions, names: Sequence[str] = ("X", "Z", "C")) -> FloatArray:
    """Corrections (3,) to the named axes that bring the actual wheel centre where the ideal one stands at q.

    Exact; on a flank prefer `flank_inverse`: a rotation that moves the centre back also turns the profile.
    """
    wanted = chain.ideal(q)[:3, 3]
    steps = np.array([STEP if chain.axis(name).kind == "prismatic" else 0.01 * STEP for name in names])
    return _gauss_newton(lambda dq: chain.actual(_moved(q, names, dq))[:3, 3] - wanted, steps)


def _moved(q: Positions, names: Sequence[str], dq: FloatArray) -> dict[str, ArrayLike]:
    moved = {name: position(q, name) + dq[i] for i, name in enumerate(names)}
    return {**q, **moved}


def _gauss_newton(residual: Callable[[FloatArray], FloatArray], steps: FloatArray) -> FloatArray:
    """Least squares by full steps with central differences; errors are small, so it ends in a few."""
    dq = np.zeros_like(steps)
    for _ in range(STEPS):
        moves = np.diag(steps)
        J = np.stack([(residual(dq + m) - residual(dq - m)) / (2.0 * float(np.sum(m))) for m in moves], axis=-1)
        change = np.linalg.lstsq(J * steps, -residual(dq), rcond=None)[0] * steps
        dq = dq + change
        if np.all(np.abs(change) <= SMALLEST + 1e-11 * np.abs(dq)):
            return dq
    raise ModelError("E-CORRECT-INVERSE", "inverse", steps=STEPS, change=float(np.max(np.abs(change))))
