"""Inspection values of a cycloid disc from normal deviations: profile, lead, pitch, runout (mm, rad).

Signs: e > 0 is surplus material; the left flank of a space is the one at theta > 0. Taper has equal signs of
f_Hb on both flanks, helix opposite ones. F_k > 0 is counter-clockwise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.types.values import FloatArray
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import FlankGrid

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
    return Inspection(_paired(profile), lead, (pitch[0], pitch[1]), runout)


def _half_way(gear: CycloidGear, thetas: FloatArray, side: NDArray[np.intp]) -> int:
    arc = gear.arc(thetas[side])
    return int(side[np.argmin(np.abs(arc - 0.5 * gear.limits().half_lobe_arc))])


def _paired(traces: list[TraceValues]) -> TraceValues:
    return TraceValues(*(np.stack([getattr(t, key) for t in traces], axis=-1) for key in ("F", "f_H", "f_f")))


def _all_spaces(deviation: ArrayLike) -> FloatArray:
    e = np.asarray(deviation, dtype=np.float64)
    if e.ndim != 1 or e.size < FEWEST or not np.all(np.isfinite(e)):
        raise ModelError("E-GEAR-TRACE", "inspection", fewest=FEWEST, points=e.size)
    return e
