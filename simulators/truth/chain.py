"""Rigid bodies in a row: rotations and points of bed > X > C and bed > Z with every error motion in them.

The transforms are those of any textbook on multibody kinematics: a prismatic axis moves along its (tilted)
direction and then errs; the rotary axis errs in the frame of its stator and then turns. All exact, no
small-angle shortening, vectorised over samples. Units mm and rad, right-handed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Pose:
    """A moving frame in the bed frame: rotation (n, 3, 3) and origin (n, 3) in mm."""

    rotation: FloatArray
    origin: FloatArray

    def point(self, p: FloatArray) -> FloatArray:
        """Where the frame's point p (3,) is in the bed frame, (n, 3)."""
        return self.rotation @ p + self.origin

    def then(self, inner: Pose) -> Pose:
        """The frame that `inner` describes within this one."""
        turned = np.einsum("nij,nj->ni", *_broadcast(self.rotation, inner.origin))
        return Pose(self.rotation @ inner.rotation, turned + self.origin)


def _broadcast(rotation: FloatArray, vector: FloatArray) -> tuple[FloatArray, FloatArray]:
    if len(rotation) == len(vector):
        return rotation, vector
    count = max(len(rotation), len(vector))
    return np.broadcast_to(rotation, (count, 3, 3)), np.broadcast_to(vector, (count, 3))


def rotation(angles: FloatArray) -> FloatArray:
    """Rz(c) Ry(b) Rx(a) for angles (3, n) = (a, b, c) in rad: shape (n, 3, 3)."""
    if angles.shape == (3, 1):  # a machine that stands is asked for a hundred times as often as one that moves
        (sa, sb, sc), (ca, cb, cc) = np.sin(angles)[:, 0].tolist(), np.cos(angles)[:, 0].tolist()
    else:
        (sa, sb, sc), (ca, cb, cc) = np.sin(angles), np.cos(angles)
    rows = (
        (cc * cb, cc * sb * sa - sc * ca, cc * sb * ca + sc * sa),
        (sc * cb, sc * sb * sa + cc * ca, sc * sb * ca - cc * sa),
        (-sb, cb * sa, cb * ca),
    )
    found = np.asarray(rows)
    return found[None] if found.ndim == 2 else np.moveaxis(found, 2, 0)


def slide(q: FloatArray, direction: FloatArray, shift: FloatArray, tilt: FloatArray) -> Pose:
    """A prismatic axis at q (n,) mm along `direction` (3,), off by `shift` (3, n) mm and `tilt` (3, n) rad."""
    return Pose(rotation(tilt), q[:, None] * direction + shift.T)


def table(q: FloatArray, seat: Pose, shift: FloatArray, tilt: FloatArray) -> Pose:
    """A rotary axis about Z at q (n,) rad in its `seat`, with stator-frame errors `shift` and `tilt`."""
    zeros = np.zeros_like(q)
    spin = Pose(rotation(np.stack((zeros, zeros, q))), np.zeros((len(q), 3)))
    return seat.then(Pose(rotation(tilt), shift.T)).then(spin)


def still(shift: tuple[float, float, float], tilt: tuple[float, float, float]) -> Pose:
    """A fixed frame: shift in mm, tilt in rad."""
    angles = np.asarray(tilt, dtype=np.float64)[:, None]
    return Pose(rotation(angles), np.asarray(shift, dtype=np.float64)[None, :])


BED = Pose(np.eye(3)[None], np.zeros((1, 3)))
