"""Measured points that tell A, B, G of their wheel places: incomplete places and glitches left out, others refused."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.types.values import FloatArray
from drivers.units import UM_PER_MM, mm_to_um
from gateway.correct.flank.wheel_places import Places, places_of_points
from gateway.correct.part.fromgear import PlaceFit, fit_places
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import flank_grid
from gateway.gear.measured import FlankPoints
from gateway.tooth import InspectedFlank

GLITCH = 6.0  # standard uncertainties of one point
ROUNDS = 6
MOST_GLITCHES = 0.02  # of all points: more is no glitch
FORM_MM = 0.003  # what A, B, G leave of a place at most, median: more is another gear, or one that is not ground
FEWEST_HEIGHTS, LEAST_SHARE = 2, 0.5  # heights in each space, and the part of the face they span
MAD = 1.4826
FULL = 0.95  # leverage of a point that its place can hardly do without


@dataclass(frozen=True)
class FittedPlaces:
    """Points at places that all tell A, B and G, with the fit; how many points were left out, and why."""

    points: FlankPoints
    places: Places
    fit: PlaceFit
    beside: int = 0
    glitches: int = 0


def placed(gear: CycloidGear, points: FlankPoints, probe: float = 0.0) -> FittedPlaces:
    """The points that count. ``probe`` (mm): what is known of one touch; readings far off the fit are left out.

    Raises ModelError: E-INSPECT-GEAR (another gear, or spaces not ground), E-INSPECT-GLITCHES, E-INSPECT-SPACES.
    """
    found = _told(gear, points)
    found = _without_glitches(gear, _of_this_gear(found), probe)
    _check_spaces(gear, found.places)
    return found


def check_points(gear: CycloidGear, points: FlankPoints) -> None:
    """Refuse points of another gear or of spaces that are not ground. Raises ModelError E-INSPECT-GEAR."""
    _of_this_gear(_told(gear, points))


def placed_again(gear: CycloidGear, points: FlankPoints) -> FittedPlaces:
    """Points that were found good before, with their places and fit."""
    places = places_of_points(gear, points.k, points.theta, points.z)
    return FittedPlaces(points, places, fit_places(places, points.deviation))


def of_record(gear: CycloidGear, flank: InspectedFlank) -> FittedPlaces:
    """The points of a stored inspection, with their places and fit."""
    deviation = np.asarray(flank.deviation_um) / UM_PER_MM
    return placed_again(gear, FlankPoints(flank.k, flank.theta_rad, flank.z_mm, deviation))


def leverage(places: Places, form: FloatArray, of: NDArray[np.intp]) -> FloatArray:
    """Variance (n,) of fitted points with rows ``form`` (n, 3) at places ``of`` (n,), per variance of one point."""
    return np.asarray(np.einsum("ni,nij,nj->n", form, places.inverses[of], form))


def _told(gear: CycloidGear, points: FlankPoints) -> FittedPlaces:
    """Without the places whose flank a single touch would tell better."""
    found = placed_again(gear, points)
    K = found.places.k.size
    section = gear.section(flank_grid(gear, profile=5, width=1, spaces=(0,)).thetas)
    judged = np.stack([section.nx, section.ny, section.h], axis=-1)
    rows, of = np.tile(judged, (K, 1)), np.repeat(np.arange(K), judged.shape[0])
    spread = leverage(found.places, rows, of).reshape(K, -1).mean(axis=1)
    good = np.all(np.isfinite(found.fit.abg), axis=1) & (spread <= 1.0)
    if not np.any(good):
        raise _missing(gear, list(range(gear.zc)))
    return found if np.all(good) else _kept(gear, found, good[found.places.of], beside=True)


def _kept(gear: CycloidGear, found: FittedPlaces, here: NDArray[np.bool_], *, beside: bool) -> FittedPlaces:
    left = int(np.count_nonzero(~here))
    one = found.points
    again = placed_again(gear, FlankPoints(one.k[here], one.theta[here], one.z[here], one.deviation[here]))
    counts = (found.beside + left, found.glitches) if beside else (found.beside, found.glitches + left)
    return FittedPlaces(again.points, again.places, again.fit, *counts)


def _of_this_gear(found: FittedPlaces) -> FittedPlaces:
    left = np.array([np.median(part) for part in _by_place(found.places, np.abs(found.fit.residual))])
    if np.any(left > FORM_MM):
        wrong = sorted({int(k) for k in found.places.k[left > FORM_MM]})
        worst, limit = f"{mm_to_um(float(left.max())):.1f}", f"{mm_to_um(FORM_MM):g}"
        spaces = _listed(wrong)
        raise ModelError("E-INSPECT-GEAR", "inspection", count=len(wrong), spaces=spaces, worst=worst, limit=limit)
    return found


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
        found = _told_again(gear, _kept(gear, found, ~far, beside=False))
        if found.glitches > most:
            break
    raise ModelError("E-INSPECT-GLITCHES", "inspection", count=found.glitches, limit=f"{GLITCH:g}", most=most)


def _told_again(gear: CycloidGear, found: FittedPlaces) -> FittedPlaces:
    """A place that lost a point may not tell enough any more."""
    good = np.all(np.isfinite(found.fit.abg), axis=1)
    return found if np.all(good) else _kept(gear, found, good[found.places.of], beside=True)


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
        raise _missing(gear, missing)


def _missing(gear: CycloidGear, spaces: list[int]) -> ModelError:
    span = f"{LEAST_SHARE * gear.b:g}"
    count, named = len(spaces), _listed(spaces)
    least = FEWEST_HEIGHTS
    return ModelError(
        "E-INSPECT-SPACES", "inspection", count=count, spaces=named, total=gear.zc, heights=least, span=span
    )


def _listed(spaces: list[int]) -> str:
    """The first few numbers."""
    return ", ".join(str(k) for k in spaces[:8]) + (" ..." if len(spaces) > 8 else "")
