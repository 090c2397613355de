"""The dressed wheel: a body of revolution about its own Y whose radius is a function of the place along Y (mm).

Why the dressed section is the space itself: while the wheel strokes along Z at centre distance E, a point (x, y)
of the work is reached when sqrt((E - x)^2 + dz^2) < R(y) for some dz of the stroke, that is when E - x < R(y). What
stays has the edge x = E - R(y); for it to be the wanted space, R(y) = E - x(y).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from simulators.grinding.lobes import Lobes

FloatArray = NDArray[np.float64]
KNOTS = 1501


class WheelBody:
    """Radius over the axial place; beyond the tips of the space it goes on along the tangent."""

    def __init__(self, lobes: Lobes, centre_distance_mm: float, excess_mm: float = 0.0) -> None:
        # From just beside the bottom, where the two flanks may be turned apart: each side is the other's mirror.
        t = np.linspace(1e-9, lobes.half, KNOTS)
        points, normals = lobes.profile(t)
        self._first, self._last = float(points.imag[0]), float(points.imag[-1])
        slopes = normals.imag / normals.real
        radii = centre_distance_mm + excess_mm - points.real
        self._radius = CubicSpline(points.imag, radii, bc_type=((1, slopes[0]), (1, slopes[-1])))
        self._slope = self._radius.derivative()
        self.largest_mm = float(radii[0])

    def radius(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Radius at axial places y (any shape) and its slope there, mm and mm/mm."""
        side = np.abs(y)
        inside = np.clip(side, self._first, self._last)
        slope = self._slope(inside)
        return self._radius(inside) + slope * (side - inside), np.sign(y) * slope
