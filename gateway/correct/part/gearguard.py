"""The drift guard from gears alone: an inspected gear against the approved one, both as their A, B, G fits tell."""

from __future__ import annotations

import numpy as np

from gateway.correct.flank.wheel_places import Places
from gateway.correct.part.fitted_places import FittedPlaces, leverage, of_record
from gateway.correct.part.fromgear import PlaceFit
from gateway.gear.cycloid import CycloidGear
from gateway.guard import Flanks, GuardVerdict, guard_gear, not_alike
from gateway.tooth import InspectedFlank

SAME_MM = 0.1  # of two heights inspected
GLITCHES = 2  # points that a place may have lost


def guard_flanks(approved: InspectedFlank, now: InspectedFlank, gear: CycloidGear, limit_um: float) -> GuardVerdict:
    """Whether the machine still grinds as when the approved part was inspected, within ``limit_um`` at every point.

    Rotation and clamping of both inspections do not count. Cannot tell where they were not made by one plan of points.
    """
    known, found = of_record(gear, approved), of_record(gear, now)
    if not _one_plan(known, found):
        return not_alike(limit_um, known.points.k.size, found.points.k.size)
    return guard_fits(known.fit, found.fit, places=found.places, gear=gear, limit_um=limit_um)


def _one_plan(known: FittedPlaces, found: FittedPlaces) -> bool:
    one, other = known.places, found.places
    if one.k.shape != other.k.shape or not np.array_equal(one.k, other.k):
        return False
    fewer = np.abs(np.bincount(one.of) - np.bincount(other.of))
    return bool(np.all(np.abs(one.z - other.z) <= SAME_MM) and np.all(fewer <= GLITCHES))


def guard_fits(approved: PlaceFit, now: PlaceFit, places: Places, gear: CycloidGear, limit_um: float) -> GuardVerdict:
    """Whether the machine still grinds what was approved, within ``limit_um`` of normal deviation at every point.

    Both fits must be of the same ``places``: the gears were inspected by one plan. Places that their points do not
    tell (NaN in the fit) count for nothing.
    """
    angle = np.asarray(gear.space_angle(places.k), dtype=np.float64)[places.of]
    return guard_gear(
        _flanks(approved, places), _flanks(now, places), form=places.form, angle_rad=angle, limit_um=limit_um
    )


def _flanks(fit: PlaceFit, places: Places) -> Flanks:
    """Smoothed deviations and their standard uncertainty u sqrt(leverage) at the points."""
    count = places.k.size
    if fit.abg.shape != (count, 3):
        return Flanks(np.full(fit.abg.shape[0], np.nan), np.full(fit.abg.shape[0], np.nan))
    own = np.maximum(leverage(places, places.form, places.of), 0.0)
    freedom = float(max(fit.residual.size - 3 * count, 1))
    return Flanks(places.along_normal(fit.abg), fit.u * np.sqrt(own), freedom)
