"""Every limit of a push in one table: value, slope, change, jump, what is left at the reference, age, warmth."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta

from drivers.units import AxisUnit, deviation_unit
from gateway.table.limits import Limits

MAX_AGE = timedelta(hours=24)
WARN_AGE = timedelta(hours=4)
MAX_AHEAD = timedelta(minutes=2)
APPROVED_FOR = timedelta(minutes=10)
APPROVED_AHEAD = timedelta(seconds=10)
MAX_DRIFT_K = 2.0
MIN_REPETITIONS = 3
MAX_SUSPECT_SHARE = 0.1
MAX_REMAINING = 0.5
MAX_REPEATABILITY = 1.0 / 3.0
COARSEST_UM = 1.0
PROOF_WITHIN = 0.2
PROOF_TIMES_U = 4.0


@dataclass(frozen=True, slots=True)
class PushLimits:
    """Limits of one output axis in um or arcsec, slopes per mm or deg of the input axis.

    ``value``, ``change`` and ``slope`` refuse; the ``warn_`` ones ask for a second person. ``jump`` is how far
    switching may move an axis, ``reference`` what a table may be at the reference position of its input.
    """

    value: float
    slope: float
    warn_slope: float
    change: float
    warn_change: float
    jump: float = 1.0
    reference: float = 0.1


_WARN_CHANGE = {"mm": 50.0, "deg": 36.0}


def limits_of(unit: AxisUnit) -> PushLimits:
    """0.200 mm, 1.0 (warn 0.2) um/mm, 0.120 (warn 0.050) mm; 0.050 deg, 10 (warn 5) arcsec/deg, 0.015 (0.010) deg."""
    usual = Limits.usual(deviation_unit(unit))
    return PushLimits(usual.value, usual.slope, usual.slope_warning, usual.change, _WARN_CHANGE[unit])


MAX_JUMP = limits_of("mm").jump
