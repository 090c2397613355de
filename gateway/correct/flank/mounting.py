"""How the work sits on its table: eccentricity and tilt, set-up values that change at each clamping and enter no table.

In the work's own frame they are constant; seen from the stator they are the in-phase first harmonics of the rotary
axis' radial and tilt errors. Counter-rotating harmonics are genuine error motions and stay with the tables (mm, rad).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivers.types.values import FloatArray
from drivers.units import mm_to_um, rad_to_arcsec
from gateway.correct.flank.flank_model import Places
from gateway.gear.first_order import abg, flank_abg, to_space
from gateway.gear.grinding import Grinding
from gateway.model.chain import Motion
from gateway.model.motion import Fourier, MotionSum

UNIT = np.array([[-1.0, 0, 0, 0, 0, 0], [0, -1.0, 0, 0, 0, 0], [0, 0, 0, -1.0, 0, 0], [0, 0, 0, 0, -1.0, 0]])
KEYS = ("dx", "dy", "ea", "eb")
RANK = 1e-8


@dataclass(frozen=True, slots=True)
class WorkMounting:
    """Where the work's axis stands against the table's: eccentricity x, y (mm) and tilt a, b (rad), work frame."""

    x_mm: float = 0.0
    y_mm: float = 0.0
    a_rad: float = 0.0
    b_rad: float = 0.0

    @property
    def values(self) -> tuple[float, float, float, float]:
        """x, y, a, b."""
        return self.x_mm, self.y_mm, self.a_rad, self.b_rad

    @property
    def eccentricity_um(self) -> tuple[float, float]:
        """x, y in um."""
        return mm_to_um(self.x_mm), mm_to_um(self.y_mm)

    @property
    def tilt_arcsec(self) -> tuple[float, float]:
        """a, b in arcsec."""
        return rad_to_arcsec(self.a_rad), rad_to_arcsec(self.b_rad)

    @property
    def opposite(self) -> WorkMounting:
        """What to move the work by so that it sits right."""
        return WorkMounting(*(0.0 - value for value in self.values))

    def rounded(self, length: float, angle: float) -> WorkMounting:
        """In whole steps of a length (mm) and an angle (rad): less than half a step is no set-up."""
        steps = (length, length, angle, angle)
        return WorkMounting(*(float(np.rint(v / s) * s) for v, s in zip(self.values, steps, strict=True)))


def mounting_terms(grinding: Grinding, places: Places) -> FloatArray:
    """A, B, G (G, 3, 4) per unit of x, y, a, b."""
    parts = [abg(to_space(grinding, places.k, np.broadcast_to(u, (*places.k.shape, 6))), places.z) for u in UNIT]
    return np.stack(parts, axis=-1)


def mounting_of(grinding: Grinding, places: Places) -> WorkMounting:
    """The in-phase first harmonics in a machine's errors, by least squares of A and B over all places.

    What repeats in every space (constants and slopes along the face) is told apart first.
    """
    return mounting_in(grinding, places, flank_abg(grinding, places.k, places.z))


def mounting_in(grinding: Grinding, places: Places, terms: FloatArray) -> WorkMounting:
    """The same in any A, B, G (G, 3) of the places, measured ones for instance."""
    field = terms[:, :2].reshape(-1)
    wanted = mounting_terms(grinding, places)[:, :2, :].reshape(-1, 4)
    even = np.zeros((places.k.size, 2, 4))
    for i in range(2):
        even[:, i, 2 * i], even[:, i, 2 * i + 1] = 1.0, places.z
    columns = np.concatenate([wanted, even.reshape(-1, 4)], axis=1)
    size = np.linalg.norm(columns, axis=0)
    scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
    found = np.linalg.lstsq(columns * scale, field, rcond=RANK)[0] * scale
    return WorkMounting(*(float(v) for v in found[:4]))


def without_mounting(grinding: Grinding, mounting: WorkMounting) -> Grinding:
    """The machine with the work set right: that eccentricity and tilt taken out of the index axis' errors."""
    axis = grinding.chain.axis(grinding.index)
    sense = float(axis.vector[2])
    x, y, a, b = (-value for value in mounting.values)
    pairs = (((x, y), KEYS[:2]), ((a, b), KEYS[2:]))
    err: dict[str, Motion] = dict(axis.err)
    for (first, second), keys in pairs:
        if first == 0.0 and second == 0.0:
            continue
        for key, motion in zip(keys, _in_error_frame(first, second, axis.err_frame == "moving", sense), strict=True):
            err[key] = MotionSum((err.get(key, 0.0), motion))
    names = {key: f"E{'XYZABC'[['dx', 'dy', 'dz', 'ea', 'eb', 'ec'].index(key)]}{axis.name}" for key in err}
    return replace(grinding, chain=grinding.chain.with_errors({names[key]: motion for key, motion in err.items()}))


def _in_error_frame(first: float, second: float, moving: bool, sense: float) -> tuple[Motion, Motion]:
    """The pair in the frame of the axis' errors: constant if they ride with it, turning with it if not."""
    if moving:
        return first, second
    return Fourier(0.0, (first,), (-sense * second,)), Fourier(0.0, (second,), (sense * first,))
