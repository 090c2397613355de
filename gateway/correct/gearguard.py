"""The drift guard from gears alone: an inspected gear against the approved one, both as their A, B, G fits tell."""

from __future__ import annotations

import numpy as np

from gateway.correct.fromgear import PlaceFit
from gateway.correct.places import Places
from gateway.gear.cycloid import CycloidGear
from gateway.guard import Flanks, GuardVerdict, guard_gear


def guard_fits(approved: PlaceFit, now: PlaceFit, places: Places, gear: CycloidGear, limit_um: float) -> GuardVerdict:
    """Whether the machine still grinds what was approved, within ``limit_um`` of normal deviation at every point.

    Both fits must be of the same ``places``: the gears were inspected by one plan. Places that their points do not
    tell (NaN in the fit) count for nothing.
    """
    angle = np.asarray(gear.space_angle(places.k), dtype=np.float64)[places.of]
    return guard_gear(_flanks(approved, places), _flanks(now, places), places.form, angle, limit_um)


def _flanks(fit: PlaceFit, places: Places) -> Flanks:
    """Smoothed deviations and their standard uncertainty u sqrt(leverage) at the points."""
    count = places.k.size
    if fit.abg.shape != (count, 3):
        return Flanks(np.full(fit.abg.shape[0], np.nan), np.full(fit.abg.shape[0], np.nan))
    grams = np.zeros((count, 3, 3))
    np.add.at(grams, places.of, places.form[:, :, None] * places.form[:, None, :])
    inverse = np.linalg.pinv(grams, hermitian=True)[places.of]
    leverage = np.einsum("ni,nij,nj->n", places.form, inverse, places.form)
    freedom = float(max(fit.residual.size - 3 * count, 1))
    return Flanks(places.along_normal(fit.abg), fit.u * np.sqrt(np.maximum(leverage, 0.0)), freedom)
