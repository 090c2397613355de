"""What each correction gives on a part: set-up values, tables and wheel, the best one first, with u after each.

Theory. The flank of a part is its fitted A, B, G of every place and the form w of the wheel, which these cannot make.
Set-up values take what one x, one dressing offset and one rotation can take; tables change the flank by what the model
predicts of them, less that same part; a dressing takes the correction c of the form, which is what the dresser can make
of w (nothing where it may not be dressed). None hides another to first order, so the order is greedy: the correction
that leaves the smallest RMS comes first, then the next one of what is left.

u after a step is the RMS over the flank of the standard uncertainty of its normal deviation: of the inspection before
any step, and with it, in squares, that of the tables' prediction, of the set-up values and of the form of the wheel,
each from the step on that rests on it. The floor is that of the tables on the fitted machine, which has no wheel form:
where the wheel cannot be dressed its form comes on top, in squares, because w is orthogonal to everything that moves.

Drive: the transmission error of discs with this flank by the full model; its u is what the form's uncertainty makes of
it to first order, pattern by pattern (the covariance's own vectors), and what the run's proposal says of the tables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from drivers.types.values import FloatArray
from drivers.units import um_to_mm
from gateway.domain.grinding_process import CorrectionOrder, CorrectionStep, Separation, SetupName, WheelForm
from gateway.gear.cycloid import CycloidGear
from gateway.gear.process_drift import set_right
from gateway.reducer.figures import without_limit
from gateway.reducer.firstorder import transmission_map
from gateway.reducer.records import Reducer
from gateway.reducer.uncertainty import essentials
from gateway.tooth import FlankMap, FlankPrediction, InspectedFlank

Correction = Literal["set-up", "tables", "wheel"]
PATTERNS = 6  # of the form's covariance: the largest ones carry it


@dataclass(frozen=True, slots=True)
class DriveOfOrder:
    """The drive that the discs make, and u of its transmission error by the tables' prediction, arcsec."""

    drive: Reducer
    tables_u_arcsec: float


def form_on(theta: FloatArray, form: WheelForm, values: FloatArray) -> FloatArray:
    """Values (T,) of a form's points at other profile angles, each flank by itself, its end value beyond its ends."""
    known = np.asarray(form.theta_rad)
    found = np.zeros(theta.size)
    for side in (-1.0, 1.0):
        here, there = np.sign(known) == side, np.sign(theta) == side
        found[there] = np.interp(theta[there], known[here], values[here])
    return found


def order_corrections(
    gear: CycloidGear,
    part: InspectedFlank,
    found: Separation,
    prediction: FlankPrediction,
    *,
    correction_um: FloatArray | None = None,
    drive: DriveOfOrder | None = None,
) -> CorrectionOrder:
    """What tables, set-up values and wheel give on this part. ``correction_um`` at the form's points; None: undressed.

    ``prediction`` is on the grid that ``part`` is fitted on. Raises ModelError (E-REDUCER-...).
    """
    form = found.form
    theta = part.fitted.theta_rad
    surplus = form_on(theta, form, np.asarray(form.deviation_um))[None, :, None]
    start = replace(part.fitted, deviation_um=part.fitted.deviation_um + surplus)
    by_tables = set_right(prediction.after, gear).deviation_um - set_right(prediction.before, gear).deviation_um
    dressed = 0.0 if correction_um is None else form_on(theta, form, correction_um)[None, :, None]
    values = [found.asks(name).u * gain for name, gain in _setup_gains(gear, theta).items()]
    squares: Mapping[Correction, float] = {
        "set-up": float(sum(value**2 for value in values)),
        "tables": prediction.u_um**2,
        "wheel": float(np.mean(np.asarray(form.u_um) ** 2)),
    }

    def corrected(flank: FlankMap, name: Correction) -> FlankMap:
        if name == "set-up":
            return set_right(flank, gear)
        return replace(flank, deviation_um=flank.deviation_um + (by_tables if name == "tables" else -dressed))

    left: list[Correction] = ["set-up", "tables", *(["wheel"] if correction_um is not None else [])]  # type: ignore[list-item]
    # The record counts what its fit leaves of the points as unknown; here that is the form, which is known.
    inspected = max(part.rms_u_um**2 - part.u_um**2, 0.0) + found.point_u_um**2
    flank, square, done = start, inspected, list[Correction]()
    form_u = _form_u(drive, start, form)
    steps = [_step("as ground", flank, square, _drive_of(drive, flank, form_u, done))]
    while left:
        best = min(left, key=lambda name: corrected(flank, name).rms_um)
        left.remove(best)
        done.append(best)
        flank, square = corrected(flank, best), square + squares[best]
        steps.append(_step(best, flank, square, _drive_of(drive, flank, form_u, done)))
    plain = prediction.floor_um
    whole = float(np.hypot(plain, np.sqrt(np.mean(surplus**2))))
    return CorrectionOrder(
        part=part.part,
        steps=tuple(steps),
        floor_um=plain if correction_um is not None else whole,
        undressed_floor_um=whole,
    )


def _step(name: str, flank: FlankMap, square: float, drive: tuple[float, float] | None) -> CorrectionStep:
    error, u = drive if drive is not None else (None, None)
    return CorrectionStep(
        name, flank.rms_um, float(np.sqrt(square)), transmission_arcsec=error, transmission_u_arcsec=u
    )


def _setup_gains(gear: CycloidGear, theta: FloatArray) -> dict[SetupName, float]:
    """RMS on the flank of 1 um of x zero and of 1 um of dressing offset."""
    section = gear.section(theta)
    return {"x": float(np.sqrt(np.mean(section.nx**2))), "dressing": float(np.sqrt(np.mean(section.ny**2)))}


def _drive_of(
    told: DriveOfOrder | None, flank: FlankMap, form_u: float, done: Sequence[Correction]
) -> tuple[float, float] | None:
    """Transmission error p-p and its u, arcsec; None without a drive."""
    if told is None:
        return None
    drive = without_limit(told.drive)
    error = essentials(drive, [flank] * len(drive.discs)).error_arcsec
    return error, float(np.hypot(form_u, told.tables_u_arcsec if "tables" in done else 0.0))


def _form_u(told: DriveOfOrder | None, flank: FlankMap, form: WheelForm) -> float:
    """What the form's uncertainty makes of the transmission error, to first order, arcsec; 0 without a drive."""
    if told is None:
        return 0.0
    values, vectors = np.linalg.eigh(np.asarray(form.covariance_um2))
    found, square = transmission_map(without_limit(told.drive), flank), 0.0
    for value, vector in sorted(zip(values.tolist(), vectors.T, strict=True), key=lambda one: -one[0])[:PATTERNS]:
        pattern = form_on(flank.theta_rad, form, np.sqrt(max(value, 0.0)) * vector)
        moved = um_to_mm(1.0) * np.broadcast_to(pattern[None, :, None], flank.deviation_um.shape)
        square += float(np.ptp(found.rows(moved.reshape(-1, 1)), axis=0)[0]) ** 2
    return float(np.sqrt(square))
