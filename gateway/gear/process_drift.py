"""What runs while one part is ground (a wheel that wears, heat), told from what repeats with a turn of the table; pure.

A pitch error of C, an eccentric part or a lean of the table closes after a turn: the last space lies beside the first
and differs from it little. What runs on from space to space in the order of grinding does not close: between the last
space and the first there is a step. No table can take it, for the next part's first space is at the same place of C.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivers.types.values import FloatArray
from drivers.units import arcsec_to_rad, mm_to_um, rad_to_arcsec, um_to_mm
from gateway.gear.cycloid import CycloidGear, ProfileSection
from gateway.tooth import FlankMap

# Waves a turn that a machine's own errors may have here, one for four spaces; with fewer than two nobody can tell.
ORDERS = 6
FEWEST = 2
PER_ORDER = 4


@dataclass(frozen=True, slots=True)
class ProcessDrift:
    """How far something ran from the first space to the last, with its standard uncertainty from ``freedom`` degrees.

    ``value`` and ``u`` in um (depth: + material is left more and more) or arcsec (index: + turns counter-clockwise);
    ``freedom`` is 0 where nobody can tell. ``flank_um`` is what it makes of the flank as RMS over the profile.
    """

    value: float
    u: float
    freedom: int
    flank_um: float


def depth_running(flank: FlankMap, gear: CycloidGear) -> ProcessDrift:
    """How far the depth of the wheel ran over the spaces 0, 1, ... of a flank: it wears, or the infeed drifts; um."""
    return _fit_drift(flank.deviation_um, gear.section(flank.theta_rad).nx, 1.0)


def index_running(flank: FlankMap, gear: CycloidGear) -> ProcessDrift:
    """How far the index ran over the spaces 0, 1, ... of a flank: C drifts, or the wheel wears on one side; arcsec.

    + where later spaces lie further counter-clockwise.
    """
    return _fit_drift(flank.deviation_um, gear.section(flank.theta_rad).h, rad_to_arcsec(um_to_mm(1.0)))


def _fit_drift(deviation_um: FloatArray, shape: FloatArray, unit: float) -> ProcessDrift:
    by_space = deviation_um.mean(axis=2) @ shape / float(shape @ shape)
    value, u, freedom = _ramp(by_space)
    return ProcessDrift(value * unit, u * unit, freedom, abs(value) * float(np.sqrt(np.mean(shape**2))))


def _ramp(by_space: FloatArray) -> tuple[float, float, int]:
    """First to last of the straight part of values (K,) beside waves that close after a turn; its u and freedom."""
    count = by_space.size
    place = np.arange(count) / count
    orders = np.arange(1, min(ORDERS, (count - 1) // PER_ORDER) + 1)
    turns = 2.0 * np.pi * np.multiply.outer(place, orders)
    ramp = np.linspace(-0.5, 0.5, count)
    design = np.column_stack((ramp, np.ones(count), np.cos(turns), np.sin(turns)))
    found, *_ = np.linalg.lstsq(design, by_space, rcond=None)
    freedom = count - design.shape[1]
    if orders.size < FEWEST:
        return float(found[0]), 0.0, 0
    scatter = float(np.sum((by_space - design @ found) ** 2)) / freedom
    u = np.sqrt(scatter * np.linalg.inv(design.T @ design)[0, 0])
    return float(found[0]), float(u), freedom


# ---- A flank as it would be with the set-up values right: constants of the infeed and of the dressing taken off.
#
# A shift d of the profile leaves d_n along the normal and, where the profile bends, -kappa d_t^2 / 2 + kappa' d_t^3 /
# 6 beside it (kappa + where convex). A part ground 100 um off its zero has 1 um of that, which no straight shift
# takes off again; ground anew with the set-up values right it has none, nor what that shift made together with other
# errors.

ROUNDS = 3
STEP = 1e-5  # rad


def set_right(flank: FlankMap, gear: CycloidGear) -> FlankMap:
    """The flank less what one move of the infeed, one of the dresser and one rotation can take, by least squares.

    A move of the infeed shows as n_x, one of the dressed profile as n_y, a rotation as h, alike in every space and at
    every height. The curvature that a large shift has left is still in it: see `reground`.
    """
    shape = _Shapes.of(flank, gear)
    return replace(flank, deviation_um=flank.deviation_um - shape.straight(shape.constant(flank.deviation_um)))


def with_corrected_setup(flank: FlankMap, gear: CycloidGear, turned_arcsec: float = 0.0) -> FlankMap:
    """The flank of a part ground anew with its set-up values right: without the curvature of their shift either.

    ``flank`` is one that bends as parts do (`with_curvature`), ``turned_arcsec`` the rotation that was removed from it.
    """
    shape = _Shapes.of(flank, gear)
    whole = flank.deviation_um + shape.straight(np.array([[[0.0, 0.0, mm_to_um(arcsec_to_rad(turned_arcsec))]]]))
    terms = shape.terms(whole)
    bent = shape.bent(terms)
    moved = terms - shape.constant(whole - bent)
    return set_right(replace(flank, deviation_um=whole - bent + shape.bent(moved)), gear)


def with_curvature(flank: FlankMap, gear: CycloidGear) -> FlankMap:
    """A map of straight shifts and turns, fitted to points that bend, as the flank that these points lie on.

    No rotation may have been removed: a rotation shifts the points along the profile as much as the dresser does.
    """
    shape = _Shapes.of(flank, gear)
    terms = shape.terms(flank.deviation_um)
    return replace(flank, deviation_um=shape.straight(terms) + shape.bent(terms))


def bent_by_shift(gear: CycloidGear, theta: FloatArray, terms: FloatArray) -> FloatArray:
    """What the curvature makes of shifts A, B (um) and turns G (um/mm), rows (N, 3) at profile angles (N,), in um."""
    section = gear.section(theta)
    above, below = (gear.section(theta + step).curvature for step in (STEP, -STEP))
    growth = (above - below) / (2.0 * STEP * section.speed)
    lever = section.x * section.nx + section.y * section.ny
    along = -terms[:, 0] * section.ny + terms[:, 1] * section.nx + terms[:, 2] * lever
    um = um_to_mm(1.0)
    return np.asarray(-um * section.curvature * along**2 / 2.0 + um**2 * growth * along**3 / 6.0)


class _Shapes:
    """What shifts A, B (um) and turns G (um/mm) of the profile do at the angles of a map; terms are (K, Z, 3)."""

    def __init__(self, section: ProfileSection, growth: FloatArray) -> None:
        self._section, self._growth = section, growth
        self._design = np.stack([section.nx, section.ny, section.h], axis=1)
        self._along = np.stack([-section.ny, section.nx, section.x * section.nx + section.y * section.ny], axis=1)
        self._inverse = np.linalg.pinv(self._design)

    @classmethod
    def of(cls, flank: FlankMap, gear: CycloidGear) -> _Shapes:
        """At the map's profile angles; the curvature's growth along the arc by central difference."""
        theta = flank.theta_rad
        section = gear.section(theta)
        above, below = (gear.section(theta + step).curvature for step in (STEP, -STEP))
        return cls(section, (above - below) / (2.0 * STEP * section.speed))

    def straight(self, terms: FloatArray) -> FloatArray:
        """Along the normal at first order (K, T, Z)."""
        return np.asarray(np.moveaxis(terms @ self._design.T, -1, -2))

    def bent(self, terms: FloatArray) -> FloatArray:
        """What the curvature makes of it (K, T, Z)."""
        along = np.moveaxis(terms @ self._along.T, -1, -2)
        um = um_to_mm(1.0)
        square, cube = self._section.curvature[:, None] * along**2, self._growth[:, None] * along**3
        return np.asarray(-um * square / 2.0 + um**2 * cube / 6.0)

    def terms(self, deviation: FloatArray) -> FloatArray:
        """The shifts and turns of each place whose flank, with its curvature, fits deviations (K, T, Z) best."""
        seen = np.moveaxis(deviation, 1, 2) @ self._inverse.T
        found = seen
        for _ in range(ROUNDS):
            found = seen - np.moveaxis(self.bent(found), 1, 2) @ self._inverse.T
        return np.asarray(found)

    def constant(self, deviation: FloatArray) -> FloatArray:
        """The one shift and turn (1, 1, 3) common to all places, by least squares."""
        return np.asarray(self._inverse @ deviation.mean(axis=(0, 2)))[None, None, :]
