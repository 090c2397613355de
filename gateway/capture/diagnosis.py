"""Why a reading is not where it must be: unit or sense switched, another target, a frozen reading, a lost zero; pure.

Only what explains the reading within a few per cent is named; everything else stays "not settled".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.errors import BeamObstructed
from drivers.units import ARCSEC_PER_DEG, MM_PER_INCH, UM_PER_MM, deg_to_rad
from gateway.errors import CaptureError

# mm <-> inch, mm <-> um (or m), deg <-> arcmin, deg <-> arcsec, deg <-> rad.
FACTORS: dict[str, float] = {
    "mm to inch": 1.0 / MM_PER_INCH,
    "inch to mm": MM_PER_INCH,
    "mm to um": UM_PER_MM,
    "um to mm": 1.0 / UM_PER_MM,
    "deg to arcmin": 60.0,
    "deg to arcsec": ARCSEC_PER_DEG,
    "deg to rad": deg_to_rad(1.0),
}
LENGTH, ANGLE = slice(0, 4), slice(4, 7)
ALIKE = 0.02
FROZEN_TARGETS = 2
FROZEN_TRAVEL = 1.0


@dataclass(frozen=True, slots=True)
class UnexpectedValue:
    """A settled value that is not the expected one, all in the axis unit and the instrument's present count.

    ``datum`` is what stood at the first target; ``targets`` target -> value expected there.
    """

    read: float
    wanted: float
    datum: float
    tolerance: float
    rotary: bool
    targets: Mapping[float, float]


def cause(doubt: UnexpectedValue, axis: str, target: float) -> CaptureError | BeamObstructed | None:
    """The error that names the cause: E-CAP-SIGN, E-CAP-UNIT, E-CAP-TARGET; None where none explains it.

    A reading that belongs to another target may also be a count that stood still for a step, so it can be
    recovered from like a lost beam; the others cannot.
    """
    read, wanted, at = f"{doubt.read:.6g}", f"{doubt.wanted:.6g}", f"{target:g}"
    if _turned(doubt):
        return CaptureError("E-CAP-SIGN", axis, target=at, read=read, wanted=wanted)
    change = _factor(doubt)
    if change:
        return CaptureError("E-CAP-UNIT", axis, target=at, read=read, wanted=wanted, change=change)
    other = _other(doubt, target)
    if other is not None:
        return BeamObstructed("E-CAP-TARGET", axis, target=at, read=read, wanted=wanted, other=f"{other:g}")
    return None


def _near(value: float, wanted: float, tolerance: float) -> bool:
    return abs(value - wanted) <= max(ALIKE * abs(wanted), min(tolerance, 0.1 * abs(wanted)))


def _turned(doubt: UnexpectedValue) -> bool:
    travel = doubt.wanted - doubt.datum
    if abs(travel) <= 2.0 * doubt.tolerance:
        return False
    return _near(doubt.read - doubt.datum, -travel, doubt.tolerance) or _near(doubt.read, -doubt.wanted, 0.0)


def _factor(doubt: UnexpectedValue) -> str:
    """From the whole value, or from what it moved since the datum."""
    names = list(FACTORS)[ANGLE if doubt.rotary else LENGTH]
    pairs = [(doubt.read, doubt.wanted), (doubt.read - doubt.datum, doubt.wanted - doubt.datum)]
    for read, wanted in pairs:
        if abs(wanted) <= 2.0 * doubt.tolerance:
            continue
        for name in names:
            if _near(read, FACTORS[name] * wanted, 0.0):
                return name
    return ""


def _other(doubt: UnexpectedValue, target: float) -> float | None:
    """The other target at which this would be right."""
    fits = [at for at, value in doubt.targets.items() if at != target and abs(doubt.read - value) <= doubt.tolerance]
    return fits[0] if len(fits) == 1 else None
