"""The flank before against after, and against what was predicted of it; pure."""

from __future__ import annotations

from typing import Literal

import numpy as np

from drivers.errors import words
from gateway.domain.values import COVERAGE
from gateway.gear.cycloid import CycloidGear
from gateway.gear.setright import set_right
from gateway.tooth import FlankMap, FlankPrediction, FloatArray, InspectedFlank, ToothVerdict

LEAST_UM = 0.05  # a smaller change of the RMS is nobody's business, whatever the uncertainty
Outcome = Literal["better", "unchanged", "worse"]
_SAID: dict[Outcome, str] = {
    "better": "W-TOOTH-BETTER",
    "unchanged": "W-TOOTH-UNCHANGED",
    "worse": "W-TOOTH-WORSE",
}


def _clamped(flank: FlankMap, gear: CycloidGear) -> FloatArray:
    """What one um of eccentricity along x and along y of the gear does to its flanks, (2, K, T, 1)."""
    section, phi = gear.section(flank.theta_rad), gear.space_angle(np.arange(gear.zc))[:, None, None]
    nx, ny = section.nx[None, :, None], section.ny[None, :, None]
    return np.stack([nx * np.cos(phi) - ny * np.sin(phi), nx * np.sin(phi) + ny * np.cos(phi)])


def eccentric_share(flank: FlankMap, gear: CycloidGear) -> tuple[float, float]:
    """RMS of what an eccentricity of part or clamping takes of a flank by least squares, and of what it leaves, um."""
    ways = np.stack([np.broadcast_to(one, flank.deviation_um.shape).ravel() for one in _clamped(flank, gear)], axis=1)
    seen = flank.deviation_um.ravel()
    taken = ways @ np.linalg.lstsq(ways, seen, rcond=None)[0]
    return float(np.sqrt(np.mean(taken**2))), float(np.sqrt(np.mean((seen - taken) ** 2)))


def _of_rms(flank: FlankMap, inspected: InspectedFlank, gear: CycloidGear) -> float:
    """Standard uncertainty of a flank's RMS: how far an eccentric clamping lies along that very flank, um.

    What the inspection may be off is nearly all its clamping, which has any direction: it adds to the RMS only by its
    share of the flank's own shape.
    """
    clamped = _clamped(flank, gear)
    size = inspected.rms_u_um / float(np.sqrt(np.mean(np.sum(clamped**2, axis=0))))
    shape = flank.deviation_um / max(flank.rms_um, np.finfo(float).tiny)
    return size * float(np.hypot(*(np.mean(one * shape) for one in clamped)))


def judge_tooth(
    before: InspectedFlank, after: InspectedFlank, prediction: FlankPrediction, gear: CycloidGear
) -> ToothVerdict:
    """Better or worse than before with its set-up values put right, beyond the uncertainty of both inspections (k = 2).

    Set-up values alone are no merit of the tables, so the flank before is judged without what they would take.
    """
    right = set_right(before.fitted, gear)
    fair = right.rms_um
    doubt = max(LEAST_UM, COVERAGE * float(np.hypot(_of_rms(right, before, gear), _of_rms(after.fitted, after, gear))))
    gain = fair - after.fitted.rms_um
    outcome: Outcome = "unchanged" if abs(gain) <= doubt else "better" if gain > 0.0 else "worse"
    missed = float(np.sqrt(np.mean((after.fitted.deviation_um - prediction.after.deviation_um) ** 2)))
    held = missed <= COVERAGE * float(np.hypot(prediction.u_um, after.rms_u_um))
    figures = {
        "before": f"{before.fitted.rms_um:.2f}",
        "fair": f"{fair:.2f}",
        "after": f"{after.fitted.rms_um:.2f}",
        "predicted": f"{prediction.rms_um:.2f}",
        "u": f"{prediction.u_um:.2f}",
    }
    off, rest = eccentric_share(after.fitted, gear)
    said = words(_SAID[outcome], **figures) + " " + words("W-TOOTH-HELD" if held else "W-TOOTH-MISSED")
    said += " " + words("W-TOOTH-ECCENTRIC", off=f"{off:.2f}", rest=f"{rest:.2f}")
    return ToothVerdict(
        before_um=before.fitted.rms_um,
        before_set_right_um=fair,
        after_um=after.fitted.rms_um,
        predicted_um=prediction.rms_um,
        u_um=prediction.u_um,
        within_prediction=held,
        outcome=outcome,
        words=said,
    )
