"""The machine's rigid bodies and the motions of its axes: bed > X > C and bed > Z, with every error motion in them.

The transforms are those of any textbook on multibody kinematics: a prismatic axis moves along its (tilted)
direction and then errs; the rotary axis errs in the frame of its stator and then turns. All exact, no
small-angle shortening, vectorised over samples. Units mm and rad, right-handed. An `AxisMotion` says where an axis
is, which way it goes, how far its reversal has built up, and how it scatters.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import count

import numpy as np
from numpy.typing import NDArray

from simulators.truth.curves import generator

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


def slide_pose(q: FloatArray, direction: FloatArray, shift: FloatArray, tilt: FloatArray) -> Pose:
    """A prismatic axis at q (n,) mm along `direction` (3,), off by `shift` (3, n) mm and `tilt` (3, n) rad."""
    return Pose(rotation(tilt), q[:, None] * direction + shift.T)


def table_pose(q: FloatArray, seat: Pose, shift: FloatArray, tilt: FloatArray) -> Pose:
    """A rotary axis about Z at q (n,) rad in its `seat`, with stator-frame errors `shift` and `tilt`."""
    zeros = np.zeros_like(q)
    spin = Pose(rotation(np.stack((zeros, zeros, q))), np.zeros((len(q), 3)))
    return seat.then(Pose(rotation(tilt), shift.T)).then(spin)


def fixed_pose(shift: tuple[float, float, float], tilt: tuple[float, float, float]) -> Pose:
    """A fixed frame: shift in mm, tilt in rad."""
    angles = np.asarray(tilt, dtype=np.float64)[:, None]
    return Pose(rotation(angles), np.asarray(shift, dtype=np.float64)[None, :])


BED = Pose(np.eye(3)[None], np.zeros((1, 3)))


@dataclass(frozen=True, slots=True)
class AxisMotion:
    """An axis over some samples: encoder position (n,) in mm or deg, its travel sense and its wind-up.

    ``direction`` is +1 or -1, the last travel; ``windup`` runs from -1 to +1 as hysteresis builds up. ``scatter`` is
    what this very stop is off, um or arcsec. Arrays of length 1 stand for "all the time".
    """

    position: FloatArray
    direction: FloatArray
    windup: FloatArray
    scatter: FloatArray = field(default_factory=lambda: np.zeros(1))


class Hysteresis:
    """Follows one axis and says how far its reversal has built up: -1 to +1 over the given distance.

    The stop operator of Prandtl and Ishlinskii: the state follows travel, and saturates.
    """

    def __init__(self, distance: float) -> None:
        self._distance = distance
        self._last: float | None = None
        self._state = -1.0

    def follow(self, position: FloatArray) -> FloatArray:
        """The state at each of these successive positions (n,)."""
        start = position[0] if self._last is None else self._last
        self._last = float(position[-1])
        travel = np.diff(position, prepend=start) / self._distance
        if not travel.any():
            return np.full(len(position), self._state)
        states = np.empty(len(position))
        state = self._state
        for index, moved in enumerate(travel.tolist()):
            state = min(1.0, max(-1.0, state + moved))
            states[index] = state
        self._state = state
        return states


class Scatter:
    """Random repeatability: follows one axis and gives every stop of it an offset of its own, um or arcsec.

    A stop begins when the axis has left the place where it stood before; a table that is switched on or off moves it by
    micrometres, which makes no new stop. ``names`` tell apart who follows: each has draws of his own.
    """

    LEFT = 0.01
    STANDS = 1e-6

    def __init__(self, size: float, seed: int, *names: str) -> None:
        self._size = size
        self._seed, self._names = seed, names
        self._number = count()
        self._anchor: float | None = None
        self._last: float | None = None
        self._now = self._draw()

    def _draw(self) -> float:
        return self._size * float(generator(self._seed, *self._names, f"stop {next(self._number)}").normal())

    def drawn(self, shape: tuple[int, ...]) -> FloatArray:
        """Offsets of so many further stops, in C order."""
        return np.asarray([self._draw() for _ in range(int(np.prod(shape)))]).reshape(shape)

    def follow(self, position: FloatArray) -> FloatArray:
        """The offset at each of these successive positions (n,); one for all while the axis stands."""
        if self._anchor is not None and np.all(np.abs(position - self._anchor) < self.LEFT):
            self._last = float(position[-1])
            return np.full(1, self._now)
        return np.asarray([self._one(place) for place in position.tolist()])

    def _one(self, place: float) -> float:
        """The next stop's offset holds from the moment the axis leaves the last one."""
        stands = self._last is None or abs(place - self._last) < self.STANDS
        self._last = place
        if self._anchor is not None and abs(place - self._anchor) >= self.LEFT:
            self._anchor, self._now = None, self._draw()
        elif self._anchor is None and stands:
            self._anchor = place
        return self._now
