"""What a pushed table really did, told from before and after by the slope of the change over the table's shape; pure.

A table that takes the deviation d(x) away should change the axis by -d(x). The least-squares slope a of
after - before = a d + offset then says what happened: -1 as predicted, 0 not active, +1 wrong sign, -2 applied on
top of itself. By the inequality of Cauchy and Schwarz no error pattern whose RMS is U moves the slope by more than
U / RMS(d), however it is spread over the targets; so nothing is decided unless RMS(d) > 4 U.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from drivers.message import Message, digits, fixed
from drivers.types.values import FloatArray

Kind = Literal["as-predicted", "not-active", "wrong-sign", "doubled", "partly", "something-else", "cannot-tell"]
APART = 4.0
FEWEST = 3
# A slope this near to a hypothesis is that hypothesis: interpolation, scale and temperature take their share.
NEAR = 0.2
# What the table does not explain is the main thing when its RMS is this much of the table's.
MAIN = 0.5
_SLOPES: dict[Kind, float] = {"as-predicted": -1.0, "not-active": 0.0, "wrong-sign": 1.0, "doubled": -2.0}
_WORDS: dict[Kind, str] = {
    "as-predicted": "W-WHY-AS-PREDICTED",
    "not-active": "W-WHY-NOT-ACTIVE",
    "wrong-sign": "W-WHY-WRONG-SIGN",
    "doubled": "W-WHY-DOUBLED",
    "partly": "W-WHY-PARTLY",
    "something-else": "W-WHY-SOMETHING-ELSE",
    "cannot-tell": "W-WHY-CANNOT-TELL",
}


@dataclass(frozen=True, slots=True)
class TableEffect:
    """What happened. ``slope`` of the change over the table's shape with its standard uncertainty (NaN: none).

    ``slope_u`` is for errors that may all look like the table. ``residual`` is the RMS of what the table does not
    explain, ``effect`` the RMS of the table about its mean, ``U`` the RMS expanded uncertainty of the change
    (k = 2); all three in ``unit``.
    """

    kind: Kind
    slope: float
    slope_u: float
    residual: float
    effect: float
    U: float
    unit: str = ""

    @property
    def unexplained(self) -> bool:
        """Whether more changed than the table and the uncertainty explain."""
        return self.residual > self.U

    @property
    def words(self) -> tuple[Message, ...]:
        """The finding, sentence by sentence."""
        told = Message.of(
            _WORDS[self.kind],
            slope=fixed(self.slope, signed=True),
            U=digits(self.U),
            effect=digits(self.effect),
            residual=digits(self.residual),
            percent=fixed(-100.0 * self.slope, 0),
            unit=self.unit,
        )
        if not self.unexplained or self.kind in ("something-else", "cannot-tell"):
            return (told,)
        left = {"residual": digits(self.residual), "U": digits(self.U), "unit": self.unit}
        return (told, Message.of("W-WHY-BESIDES", **left))


def why(before: FloatArray, after: FloatArray, effect: FloatArray, U: FloatArray, unit: str = "") -> TableEffect:
    """Which hypothesis before and after support, or that they support none; never raises for what they hold.

    All arrays (m,), one value a target, in the same unit: mean deviation ``before`` and ``after`` the push,
    ``effect`` d(x) = deviation that the new table takes away less what the old one did, expanded uncertainty ``U``
    (k = 2) of after - before at each target. Targets with a value that is not finite are left out. A constant
    offset between before and after is allowed for.
    """
    before, after, effect, U = (np.asarray(values, dtype=np.float64) for values in (before, after, effect, U))
    good = np.isfinite(before) & np.isfinite(after) & np.isfinite(effect) & np.isfinite(U)
    d = effect[good] - np.mean(effect[good]) if np.any(good) else np.zeros(0)
    doubt, size = _rms(U[good]), _rms(d)
    if d.size < FEWEST or not size > 0.0:
        return TableEffect(
            kind="cannot-tell", slope=np.nan, slope_u=np.nan, residual=np.nan, effect=size, U=doubt, unit=unit
        )
    change = after[good] - before[good]
    change = change - np.mean(change)
    slope = float(np.sum(change * d) / np.sum(d * d))
    residual = _rms(change - slope * d)
    slope_u = 0.5 * doubt / size
    return TableEffect(
        kind=_kind(slope, slope_u, residual, size, doubt),
        slope=slope,
        slope_u=slope_u,
        residual=residual,
        effect=size,
        U=doubt,
        unit=unit,
    )


def _kind(slope: float, slope_u: float, residual: float, size: float, doubt: float) -> Kind:
    if not size > APART * doubt:
        return "cannot-tell"
    if residual > max(doubt, MAIN * size):
        return "something-else"
    near = max(NEAR, 2.0 * slope_u)
    for kind, wanted in _SLOPES.items():
        if abs(slope - wanted) <= near:
            return kind
    return "partly" if -1.0 < slope < 0.0 else "something-else"


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0
