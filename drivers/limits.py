"""What a compensation table may be on any machine: the one place of these numbers, for drivers and gateway alike.

The control neither limits nor monitors values (SINUMERIK 808D FM 01/2017, p. 106), so the limits are ours. What one
control can hold (points, resolution, largest sum) it says itself, in `TableLimits`.
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.units import AxisUnit, deviation_scale

ACCESS_LEVEL = 3  # the user's password: machine data of compensation; 4 to 7 are positions of the key switch
VALUE_RESOLUTION = 1e-6  # mm or deg: values go to a control with six decimals
SOLVED_STEP = 1e-4  # mm or deg: values for the tooth are worked out in whole steps of this, far below what is known


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of one output axis in um or arcsec, slopes per mm or deg of the input axis.

    ``value``, ``change`` against what acts and ``slope`` refuse; the ``warn_`` ones ask for a second person. ``jump``
    is how far switching may move an axis, ``reference`` what a table may be at the reference position of its input.
    ``reversal`` is the largest constant reversal, which acts at every turn of the axis and when it is switched.
    """

    value: float
    slope: float
    warn_slope: float
    change: float
    warn_change: float
    jump: float = 1.0
    reference: float = 0.1
    reversal: float = 20.0

    @classmethod
    def of(cls, unit: AxisUnit) -> Limits:
        """0.200 mm, 1.0 (warn 0.2) um/mm, 0.120 (0.050) mm; 0.050 deg, 10 (warn 5) arcsec/deg, 0.015 (0.010) deg."""
        if unit == "mm":
            return cls(value=200.0, slope=1.0, warn_slope=0.2, change=120.0, warn_change=50.0)
        return cls(value=180.0, slope=10.0, warn_slope=5.0, change=54.0, warn_change=36.0)


def largest_value(unit: AxisUnit) -> float:
    """The largest value as a control stores it: 0.200 mm or 0.050 deg."""
    return Limits.of(unit).value / deviation_scale(unit)
