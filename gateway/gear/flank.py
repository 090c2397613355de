"""Grids of flank points and the one figure a flank is judged by (mm, rad)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from drivers.types.values import FloatArray
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear, ProfileSection

FRACTION = 0.95  # of the profile that is judged


@dataclass(frozen=True, slots=True)
class FlankGrid:
    """Points of spaces ``ks`` at profile angles ``thetas`` (both flanks, ascending) and heights ``zs`` (mm).

    Arrays over the grid have shape (K, T, Z). ``k``, ``theta`` and ``z`` are shaped to broadcast to it.
    """

    gear: CycloidGear
    ks: FloatArray
    thetas: FloatArray
    zs: FloatArray

    def __post_init__(self) -> None:
        for key in ("ks", "thetas", "zs"):
            values = np.atleast_1d(np.asarray(getattr(self, key), dtype=np.float64))
            if values.ndim != 1 or not values.size or not np.all(np.isfinite(values)):
                raise ModelError("E-GEAR-GRID", "flank", key=key)
            object.__setattr__(self, key, values)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(K, T, Z)."""
        return self.ks.size, self.thetas.size, self.zs.size

    @property
    def k(self) -> FloatArray:
        """Space numbers (K, 1, 1)."""
        return self.ks[:, None, None]

    @property
    def theta(self) -> FloatArray:
        """Profile angles (T, 1)."""
        return self.thetas[:, None]

    @property
    def z(self) -> FloatArray:
        """Heights (Z,)."""
        return self.zs

    @property
    def section(self) -> ProfileSection:
        """Nominal profile of space 0 at the profile angles, arrays (T, 1)."""
        return self.gear.section(self.theta)


def flank_grid(
    gear: CycloidGear,
    *,
    profile: int = 11,
    width: int = 5,
    fraction: float = FRACTION,
    spaces: Sequence[int] | None = None,
) -> FlankGrid:
    """The judged flank: ``profile`` points per flank and ``width`` heights for all spaces (or those named).

    The points are the middles of equal cells: equal in arc length over ``fraction`` of the profile around the bottom
    of the space (the tips are left out), equal in height over the full face width. So a plain mean over the points is
    a mean over the flank's area, whatever their number.
    """
    if profile < 1 or width < 1 or not 0.0 < fraction <= 1.0:
        raise ModelError("E-GEAR-GRID", "flank", key="profile, width and fraction")
    half = fraction * gear.limits().half_lobe_arc
    cells = (np.arange(profile) + 0.5) / profile * half
    thetas = gear.theta_at(np.concatenate([-cells[::-1], cells]))
    zs = ((np.arange(width) + 0.5) / width - 0.5) * gear.b
    return FlankGrid(gear, np.asarray(range(gear.zc) if spaces is None else spaces, dtype=np.float64), thetas, zs)


@dataclass(frozen=True, slots=True)
class FlankFigure:
    """RMS and largest normal deviation (mm) after removing one rotation (rad) about the gear's axis."""

    rms: float
    largest: float
    rotation: float


def flank_figure(deviation: ArrayLike, h: ArrayLike) -> FlankFigure:
    """The flank figure of normal deviations (mm) with the levers ``h`` = x n_y - y n_x (mm) that broadcast with them.

    One rotation G, common to all points, is taken out by least squares: e - G h. Nothing else is. Missing points
    (NaN) count for nothing.
    """
    e = np.asarray(deviation, dtype=np.float64)
    lever = np.broadcast_to(np.asarray(h, dtype=np.float64), e.shape)
    here = np.isfinite(e)
    if not np.any(here):
        raise ModelError("E-GEAR-GRID", "flank", key="deviation")
    e, lever = e[here], lever[here]
    square = float(lever @ lever)
    rotation = float(lever @ e) / square if square > 0.0 else 0.0
    rest = e - rotation * lever
    return FlankFigure(float(np.sqrt(np.mean(rest**2))), float(np.max(np.abs(rest))), rotation)
