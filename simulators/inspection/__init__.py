"""A gear inspection machine: clamps the ground part, touches its flanks along the nominal normals, and errs a little.

Every touch is a ray of the machine's own (nominal) gear into the true surface of the part as it is clamped; so
an eccentric or turned part is measured as such a machine would, with nothing shortened.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulators.cellfile.part import InspectionMachine
from simulators.grinding import Lobes, Rays, WorkPiece, clamped
from simulators.truth import generator
from simulators.truth.chain import Pose

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
UM = 1e-3
SHARE = 0.95
BISECTIONS = 60


@dataclass(frozen=True, slots=True)
class Touches:
    """What was touched: points (n, 3) in mm, space and flank (n,), deviation along the nominal normal (n,) in um.

    The frame is the machine's: its gear as it should be, the part as it is clamped. ``flank`` is +1 where the
    profile angle counts up from the bottom of its space (counter-clockwise side), -1 on the other side;
    ``deviation_um`` + = surplus material.
    """

    points_mm: FloatArray
    space: IntArray
    flank: IntArray
    deviation_um: FloatArray


class OnMachine:
    """One part in one clamping of the machine."""

    def __init__(self, spec: InspectionMachine, seed: int, work: WorkPiece, number: int, touches: int) -> None:
        """``number`` counts the machine's clampings; of about ``touches`` to come some are glitches."""
        self.spec = spec
        self.work = work
        self.number = number
        self.seat: Pose = clamped(spec.clamping, seed, spec.name, f"part {work.number}", f"{number}")
        gear = work.spec.gear
        other = {"rrp": 1.04 * gear.rrp, "a": 0.98 * gear.a} if spec.wrong_part else {}
        self.lobes = Lobes(gear.model_copy(update=other))
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

    def clamp(self, work: WorkPiece, touches: int = 1000) -> OnMachine:
        """Put a part on the machine; about so many touches will be asked for."""
        self._count += 1
        return OnMachine(spec=self.spec, seed=self._seed, work=work, number=self._count, touches=touches)

    def inspect(self, work: WorkPiece, profile: int, width: int, share: float = SHARE) -> Touches:
        """Touch `profile` x `width` points on both flanks of every space, by equal steps of length and height.

        ``share`` is how much of the flank's length is touched; the width is touched from end to end.
        """
        part = self.clamp(work, 2 * profile * width * work.spec.gear.zc)
        t = part.lobes.even(2 * profile, share)
        z = np.linspace(-0.5, 0.5, width) * part.lobes.gear.b if width > 1 else np.zeros(1)
        touched = [part.touch(space, t, z) for space in range(part.spaces)]
        flank = np.repeat(np.where(t > 0.0, 1, -1), len(z))
        return Touches(
            np.concatenate([points for points, _ in touched]),
            np.repeat(np.arange(part.spaces), len(flank)),
            np.tile(flank, part.spaces),
            np.concatenate([seen for _, seen in touched]),
        )
