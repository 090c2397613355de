"""Checks of what is read: unit, sense, target, zero; environment readings; whether a table acts as read; pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers.errors import BeamObstructed
from drivers.message import digits, fixed
from drivers.types.sensing import Ambient
from drivers.types.tables import CompensationTable, LiveSet
from drivers.types.values import CompensatedFor
from drivers.units import ARCSEC_PER_DEG, MM_PER_INCH, UM_PER_MM, deg_to_rad
from gateway.config import AxisSection
from gateway.errors import AmbientOutOfRange, CaptureError
from gateway.evaluate.optics.air import require_reading
from gateway.table.comparison import acting_mean, effective

# Why a reading is not where it must be: unit or sense switched, another target, a frozen reading, a lost zero; pure.
#
# Only what explains the reading within a few per cent is named; everything else stays "not settled".

# mm <-> inch, mm <-> um (or m), deg <-> arcmin, deg <-> arcsec, deg <-> rad.
FACTORS: dict[str, float] = {
    "mm -> inch": 1.0 / MM_PER_INCH,
    "inch -> mm": MM_PER_INCH,
    "mm -> um": UM_PER_MM,
    "um -> mm": 1.0 / UM_PER_MM,
    "deg -> arcmin": 60.0,
    "deg -> arcsec": ARCSEC_PER_DEG,
    "deg -> rad": deg_to_rad(1.0),
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


def explain_value(doubt: UnexpectedValue, axis: str, target: float) -> CaptureError | BeamObstructed | None:
    """The error that names the cause: E-CAP-SIGN, E-CAP-UNIT, E-CAP-TARGET; None where none explains it.

    A reading that belongs to another target may also be a count that stood still for a step, so it can be
    recovered from like a lost beam; the others cannot.
    """
    read, wanted, at = f"{doubt.read:.6g}", f"{doubt.wanted:.6g}", f"{target:g}"
    if _sense_is_turned(doubt):
        return CaptureError("E-CAP-SIGN", axis, target=at, read=read, wanted=wanted)
    change = _factor(doubt)
    if change:
        return CaptureError("E-CAP-UNIT", axis, target=at, read=read, wanted=wanted, change=change)
    other = _other(doubt, target)
    if other is not None:
        return BeamObstructed("E-CAP-TARGET", axis, target=at, read=read, wanted=wanted, other=digits(other, 6))
    return None


def _near(value: float, wanted: float, tolerance: float) -> bool:
    return abs(value - wanted) <= max(ALIKE * abs(wanted), min(tolerance, 0.1 * abs(wanted)))


def _sense_is_turned(doubt: UnexpectedValue) -> bool:
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


# Whether environment readings may be used: there, possible and fresh, for what is left to be corrected with them.

STALE_S = 30.0
NEEDED: dict[CompensatedFor, tuple[str, ...]] = {
    "nothing": ("air_degc", "pressure_hpa", "humidity_pct"),
    "air": (),
    "air+material": (),
}


def check_ambient(axis: AxisSection, seen: Ambient, already: CompensatedFor, where: str) -> None:
    """Raises AmbientOutOfRange: E-EVAL-SENSOR (missing), E-EVAL-AMBIENT (impossible), E-CAP-STALE.

    Angles and what the instrument corrects itself need no readings of ours.
    """
    if axis.kind != "linear" or already == "air+material":
        return
    for sensor in NEEDED[already]:
        require_reading(sensor, getattr(seen, sensor), where)
    if not seen.material_degc:
        raise AmbientOutOfRange("E-EVAL-SENSOR", where, sensor="material_degc")
    for value in seen.material_degc:
        require_reading("material_degc", value, where)
    if seen.age_s > STALE_S:
        raise AmbientOutOfRange("E-CAP-STALE", where, age_s=fixed(seen.age_s, 0), limit_s=fixed(STALE_S, 0))


def check_all_ambient(axis: AxisSection, seen: Iterable[Ambient], already: CompensatedFor, where: str) -> None:
    """Every reading of a capture; raises as `check_ambient` for the first that must not be used."""
    for one in seen:
        check_ambient(axis, one, already, where)


# Does the control apply the table that was read, as it was read? Asked where no public text says how it is taken.

WHOLE = 1e-6
POSITION_SLACK = 0.01  # mm or deg: the exact stop window
SHOWN_SLACK = 0.02  # um or arcsec: the last places of the table and of what the control shows


def is_uneven(table: CompensationTable) -> bool:
    """Whether the step leaves a rest of the range: points end at k = floor((maximum - minimum) / step), as assumed."""
    if table.places or table.step <= 0.0 or table.maximum <= table.minimum:
        return False
    intervals = (table.maximum - table.minimum) / table.step
    return abs(intervals - round(intervals)) > WHOLE


def check_applied(live: LiveSet, shown: Iterable[tuple[float, float]]) -> None:
    """Compare what the control said it applied at stops, (position, um or arcsec), with an uneven table that acts.

    Raises CaptureError (E-CAP-APPLIED): then it takes the step in another way, and nothing may be built on that table.
    """
    table = effective(live.own)
    seen = np.asarray(sorted(shown), dtype=np.float64).reshape(-1, 2)
    if not is_uneven(table) or not live.own.enabled or not len(seen):
        return
    expected = acting_mean(table, seen[:, 0])
    steepest = float(np.max(np.abs(np.diff(table.deviations)), initial=0.0)) / table.step
    off = np.abs(seen[:, 1] - expected)
    worst = int(np.argmax(off))
    if off[worst] > SHOWN_SLACK + POSITION_SLACK * steepest:
        told: dict[str, Any] = {
            "position": round(float(seen[worst, 0]), 4),
            "expected": round(float(expected[worst]), 3),
        }
        told |= {"found": round(float(seen[worst, 1]), 3), "step": table.step}
        raise CaptureError("E-CAP-APPLIED", live.axis, table=table.name, unit=table.deviation_unit, **told)
