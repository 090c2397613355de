"""Measured points that determine A, B, G of their wheel places, glitches left out; and the drift guard from gears."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.message import digits, fixed
from drivers.types.values import FloatArray
from drivers.units import UM_PER_MM, mm_to_um
from gateway.correct.flank.flank_model import Places, places_of_points
from gateway.correct.part.from_gear import PlaceFit, fit_places
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import flank_grid
from gateway.gear.measured_points import FlankPoints
from gateway.guard import Flanks, GuardVerdict, guard_gear, not_alike
from gateway.tooth import InspectedFlank

GLITCH = 6.0  # standard uncertainties of one point
ROUNDS = 6
MOST_GLITCHES = 0.02  # of all points: more is no glitch
FORM_MM = 0.003  # what A, B, G leave of a place at most, median: more is another gear, or one that is not ground
FEWEST_HEIGHTS, LEAST_SHARE = 2, 0.5  # heights in each space, and the part of the face they span
MAD = 1.4826
BALL_MM, BALL_SHARE = 0.03, 0.3  # a probe left in the points, and how little else may be in them
FULL = 0.95  # leverage of a point that its place can hardly do without


@dataclass(frozen=True)
class FittedPlaces:
    """Points at places that all tell A, B and G, with the fit; how many points were left out, and why."""

    points: FlankPoints
    places: Places
    fit: PlaceFit
    beside: int = 0
    glitches: int = 0


def fit_points(gear: CycloidGear, points: FlankPoints, probe: float = 0.0) -> FittedPlaces:
    """The points that count. ``probe`` (mm): what is known of one touch; readings far off the fit are left out.

    Raises ModelError: E-INSPECT-GEAR (another gear, or spaces not ground), E-INSPECT-BALL (the probe's radius is in the
    points), E-INSPECT-GLITCHES, E-INSPECT-SPACES.
    """
    found = _determined_places(gear, points)
    found = _without_glitches(gear, _of_this_gear(found), probe)
    _check_spaces(gear, found.places)
    return found


def check_points(gear: CycloidGear, points: FlankPoints) -> None:
    """Refuse points of another gear or of spaces that are not ground. Raises ModelError E-INSPECT-GEAR."""
    _of_this_gear(_determined_places(gear, points))


def refit_points(gear: CycloidGear, points: FlankPoints) -> FittedPlaces:
    """Points that were found good before, with their places and fit."""
    places = places_of_points(gear, points.k, points.theta, points.z)
    return FittedPlaces(points, places, fit_places(places, points.deviation))


def fit_record(gear: CycloidGear, flank: InspectedFlank) -> FittedPlaces:
    """The points of a stored inspection, with their places and fit."""
    deviation = np.asarray(flank.deviation_um) / UM_PER_MM
    return refit_points(gear, FlankPoints(flank.k, flank.theta_rad, flank.z_mm, deviation))


def leverage(places: Places, form: FloatArray, of: NDArray[np.intp]) -> FloatArray:
    """Variance (n,) of fitted points with rows ``form`` (n, 3) at places ``of`` (n,), per variance of one point."""
    return np.asarray(np.einsum("ni,nij,nj->n", form, places.inverses[of], form))


def _determined_places(gear: CycloidGear, points: FlankPoints) -> FittedPlaces:
    """Without the places whose flank a single touch would tell better."""
    found = refit_points(gear, points)
    K = found.places.k.size
    section = gear.section(flank_grid(gear, profile=5, width=1, spaces=(0,)).thetas)
    judged = np.stack([section.nx, section.ny, section.h], axis=-1)
    rows, of = np.tile(judged, (K, 1)), np.repeat(np.arange(K), judged.shape[0])
    spread = leverage(found.places, rows, of).reshape(K, -1).mean(axis=1)
    good = np.all(np.isfinite(found.fit.abg), axis=1) & (spread <= 1.0)
    if not np.any(good):
        raise _missing_places(gear, list(range(gear.zc)))
    return found if np.all(good) else _select_points(gear, found, good[found.places.of], beside=True)


def _select_points(gear: CycloidGear, found: FittedPlaces, here: NDArray[np.bool_], *, beside: bool) -> FittedPlaces:
    left = int(np.count_nonzero(~here))
    one = found.points
    again = refit_points(gear, FlankPoints(one.k[here], one.theta[here], one.z[here], one.deviation[here]))
    counts = (found.beside + left, found.glitches) if beside else (found.beside, found.glitches + left)
    return FittedPlaces(again.points, again.places, again.fit, *counts)


def _of_this_gear(found: FittedPlaces) -> FittedPlaces:
    left = np.array([np.median(part) for part in _by_place(found.places, np.abs(found.fit.residual))])
    if np.any(left > FORM_MM):
        _demand_no_ball(found)
        wrong = sorted({int(k) for k in found.places.k[left > FORM_MM]})
        worst, limit = f"{mm_to_um(float(left.max())):.1f}", f"{mm_to_um(FORM_MM):g}"
        spaces = _list_numbers(wrong)
        raise ModelError("E-INSPECT-GEAR", "inspection", count=len(wrong), spaces=spaces, worst=worst, limit=limit)
    return found


def _demand_no_ball(found: FittedPlaces) -> None:
    """Refuse points of the probe's centre: one distance from the flank everywhere. Raises ModelError E-INSPECT-BALL."""
    e, form = found.points.deviation, found.places.form
    plain = np.column_stack([np.ones_like(e), form])
    size, left = np.linalg.lstsq(plain, e, rcond=None)[0][0], float(np.std(found.fit.residual))
    rest = e - plain @ np.linalg.lstsq(plain, e, rcond=None)[0]
    if abs(size) > BALL_MM and float(np.std(rest)) < BALL_SHARE * left:
        raise ModelError("E-INSPECT-BALL", "inspection", size=fixed(mm_to_um(float(size)), 0, signed=True))


def _by_place(places: Places, values: FloatArray) -> list[FloatArray]:
    order = np.argsort(places.of, kind="stable")
    return np.split(values[order], np.cumsum(np.bincount(places.of))[:-1])


def _without_glitches(gear: CycloidGear, found: FittedPlaces, probe: float) -> FittedPlaces:
    """The worst reading of each place goes first: it bends the fit of its neighbours."""
    most = max(int(MOST_GLITCHES * found.points.k.size), 1)
    for _ in range(ROUNDS):
        far = _far(found, probe)
        if not np.any(far):
            return found
        found = _drop_undetermined(gear, _select_points(gear, found, ~far, beside=False))
        if found.glitches > most:
            break
    raise ModelError("E-INSPECT-GLITCHES", "inspection", count=found.glitches, limit=digits(GLITCH, 6), most=most)


def _drop_undetermined(gear: CycloidGear, found: FittedPlaces) -> FittedPlaces:
    """A place that lost a point may not tell enough any more."""
    good = np.all(np.isfinite(found.fit.abg), axis=1)
    return found if np.all(good) else _select_points(gear, found, good[found.places.of], beside=True)


def _far(found: FittedPlaces, probe: float) -> NDArray[np.bool_]:
    """Of each place the reading furthest from its fit, where that is too far."""
    places, residual = found.places, np.abs(found.fit.residual)
    own = np.minimum(leverage(places, places.form, places.of), FULL)
    freedom = max(residual.size - 3 * places.k.size, 1) / residual.size
    scatter = max(MAD * float(np.median(residual)) / np.sqrt(freedom), probe)
    off = residual / np.sqrt(1.0 - own)
    worst = np.zeros(places.k.size)
    np.maximum.at(worst, places.of, off)
    return np.asarray((off == worst[places.of]) & (off > GLITCH * scatter) & (scatter > 0.0))


def _check_spaces(gear: CycloidGear, places: Places) -> None:
    missing = []
    for k in range(gear.zc):
        z = places.z[places.k == k]
        if z.size < FEWEST_HEIGHTS or float(np.ptp(z)) < LEAST_SHARE * gear.b:
            missing.append(k)
    if missing:
        raise _missing_places(gear, missing)


def _missing_places(gear: CycloidGear, spaces: list[int]) -> ModelError:
    span = f"{LEAST_SHARE * gear.b:g}"
    count, named = len(spaces), _list_numbers(spaces)
    least = FEWEST_HEIGHTS
    return ModelError(
        "E-INSPECT-SPACES", "inspection", count=count, spaces=named, total=gear.zc, heights=least, span=span
    )


def _list_numbers(spaces: list[int]) -> str:
    """The first few numbers."""
    return ", ".join(str(k) for k in spaces[:8]) + (" ..." if len(spaces) > 8 else "")


# ---- The drift guard from gears alone: an inspected gear against the approved one, both as their A, B, G fits tell.

SAME_MM = 0.1  # of two heights inspected
GLITCHES = 2  # points that a place may have lost


def guard_flanks(approved: InspectedFlank, now: InspectedFlank, gear: CycloidGear, limit_um: float) -> GuardVerdict:
    """Whether the machine still grinds as when the approved part was inspected, within ``limit_um`` at every point.

    Rotation and clamping of both inspections do not count. Cannot tell where they were not made by one plan of points.
    """
    known, found = fit_record(gear, approved), fit_record(gear, now)
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
