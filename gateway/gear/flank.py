"""Grids of flank points, the one figure a flank is judged by, and inspection values of its deviations (mm, rad)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.message import Message
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
        raise ModelError("E-GEAR-GRID", "flank", key=Message.of("W-GEAR-PWF"))
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


# ---- Inspection values of a cycloid disc from normal deviations: profile, lead, pitch, runout (mm, rad).
#
# Signs: e > 0 is surplus material; the left flank of a space is the one at theta > 0. Taper has equal signs of
# f_Hb on both flanks, helix opposite ones. F_k > 0 is counter-clockwise.

FEWEST = 2


@dataclass(frozen=True, slots=True)
class TraceValues:
    """Total deviation F, slope deviation f_H and form deviation f_f of one trace, mm."""

    F: FloatArray
    f_H: FloatArray
    f_f: FloatArray


@dataclass(frozen=True, slots=True)
class PitchValues:
    """Cumulative F_k and single f_pk pitch deviations (K,) with F_p = range of F_k and f_p = largest |f_pk|, mm."""

    F: FloatArray
    f: FloatArray
    F_p: float
    f_p: float


@dataclass(frozen=True, slots=True)
class RunoutValues:
    """Radial position (K,) of a ball in each space, its range F_r, and the eccentricity in it, mm and rad.

    ``eccentricity`` is the amplitude of the first harmonic, ``direction`` where it is largest.
    """

    radial: FloatArray
    F_r: float
    eccentricity: float
    direction: float


@dataclass(frozen=True, slots=True)
class Inspection:
    """What an inspection chart shows; traces are (K, 2): space, flank (left, right)."""

    profile: TraceValues
    lead: TraceValues
    pitch: tuple[PitchValues, PitchValues]
    runout: RunoutValues


def trace_values(deviation: ArrayLike, along: ArrayLike) -> TraceValues:
    """F, f_H, f_f of traces (..., n) at coordinates ``along`` (n,) in mm: arc length (profile) or z (lead).

    F is the range, f_H the least-squares slope times the evaluated length, f_f the range of what the line leaves.
    """
    e, s = np.asarray(deviation, dtype=np.float64), np.asarray(along, dtype=np.float64)
    if s.ndim != 1 or e.shape[-1:] != s.shape or s.size < FEWEST or not np.ptp(s) > 0.0 or not np.all(np.isfinite(e)):
        raise ModelError("E-GEAR-TRACE", "inspection", fewest=FEWEST, points=s.size)
    centred = s - np.mean(s)
    slope = (e @ centred) / (centred @ centred)
    rest = e - slope[..., None] * centred
    return TraceValues(np.ptp(e, axis=-1), slope * np.ptp(s), np.ptp(rest, axis=-1))


def pitch_values(deviation: ArrayLike, h: float, radius: float) -> PitchValues:
    """Pitch from the deviation (K,) of one flank at one theta in all spaces, in order around the gear.

    The angular position error is e/h (h = x n_y - y n_x), the index deviation F_k = radius e_k/h, f_pk = F_k - F_(k-1).
    """
    e = _all_spaces(deviation)
    F = radius * e / h
    f = F - np.roll(F, 1)
    return PitchValues(F, f, float(np.ptp(F)), float(np.max(np.abs(f))))


def runout_values(left: ArrayLike, right: ArrayLike, nx: float) -> RunoutValues:
    """Runout of a ball that touches both flanks at +-theta: radial shift (e_L + e_R) / (2 n_x) in every space."""
    radial = (_all_spaces(left) + _all_spaces(right)) / (2.0 * nx)
    turn = np.exp(2j * np.pi * np.arange(radial.size) / radial.size)
    first = 2.0 / radial.size * complex(np.sum(radial * turn))
    return RunoutValues(radial, float(np.ptp(radial)), abs(first), float(np.angle(first)))


def inspect(grid: FlankGrid, deviation: ArrayLike) -> Inspection:
    """Inspection values of deviations (K, T, Z) on a grid of all spaces, theta symmetric about the space's bottom.

    Profile and pitch at the height nearest the middle, lead, pitch and runout at the theta nearest half the
    profile's arc on each flank.
    """
    e = np.asarray(deviation, dtype=np.float64)
    gear, thetas = grid.gear, grid.thetas
    if e.shape != grid.shape or grid.ks.size != gear.zc or not np.allclose(thetas, -thetas[::-1], rtol=0.0, atol=1e-9):
        raise ModelError("E-GEAR-SPACES", "inspection", spaces=gear.zc, given=grid.ks.size)
    e = e[np.argsort(grid.ks)]
    left, right = np.flatnonzero(thetas > 0.0), np.flatnonzero(thetas < 0.0)
    middle = int(np.argmin(np.abs(grid.zs)))
    at = _half_way(gear, thetas, left)
    both = (at, thetas.size - 1 - at)
    profile = [trace_values(e[:, side, middle], gear.arc(thetas[side])) for side in (left, right)]
    lead = trace_values(e[:, both, :], grid.zs)
    section = gear.section(thetas[list(both)])
    radius = np.hypot(section.x, section.y)
    pitch = [pitch_values(e[:, both[i], middle], float(section.h[i]), float(radius[i])) for i in (0, 1)]
    runout = runout_values(e[:, both[0], middle], e[:, both[1], middle], float(section.nx[0]))
    return Inspection(_paired_flanks(profile), lead, (pitch[0], pitch[1]), runout)


def _half_way(gear: CycloidGear, thetas: FloatArray, side: NDArray[np.intp]) -> int:
    arc = gear.arc(thetas[side])
    return int(side[np.argmin(np.abs(arc - 0.5 * gear.limits().half_lobe_arc))])


def _paired_flanks(traces: list[TraceValues]) -> TraceValues:
    return TraceValues(*(np.stack([getattr(t, key) for t in traces], axis=-1) for key in ("F", "f_H", "f_f")))


def _all_spaces(deviation: ArrayLike) -> FloatArray:
    e = np.asarray(deviation, dtype=np.float64)
    if e.ndim != 1 or e.size < FEWEST or not np.all(np.isfinite(e)):
        raise ModelError("E-GEAR-TRACE", "inspection", fewest=FEWEST, points=e.size)
    return e
