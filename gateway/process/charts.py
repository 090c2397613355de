"""Control charts of the grinding process over routine parts: is it still as it was, and will the next part be good?

Theory. Every inspected part gives a few figures with standard uncertainty: form of the wheel, equal error of the
profile, x zero and dressing offset, wear, what turns with C and what goes over Z, and the whole deviation. Each has an
EWMA chart: z = l x + (1 - l) z, started at the mean m of the first `BASE` parts. While nothing changes its variance is
s^2 (l / (2 - l) (1 - (1 - l)^(2 i)) + 1 / n), the last term because m is itself a mean of n parts. s^2 weighs the
scatter of those parts with the uncertainty that their separation states (`PRIOR` degrees of freedom): five parts alone
say little of a scatter. A chart signals beyond `LIMIT` of these standard deviations; with l = 0.25 and 3.6 one of eight
charts is wrong in less than one part in two hundred.

The next part: a straight line through the whole deviation of the last parts since dressing, with the prediction's own
uncertainty (regression, Student's t), gives the probability that it stays within the tolerance.

Answers. What only the wheel makes asks for dressing; what only C makes, for a measurement of C alone. A gear shows 8
combinations of 21 constants: everything else, and several groups at once, cannot be told from gears.

Sources: ISO 7870-6 (EWMA charts); JCGM 100 (uncertainty); prediction from a regression line: any text of statistics.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import stdtr

from gateway.domain.grinding_process import Separation

WEIGHT, LIMIT = 0.25, 3.6
BASE, PRIOR = 5, 6.0
LAST = 8  # parts of the trend
SURE = 0.95
WHEEL = ("wheel", "dresser", "x zero", "wear")
TURNING = ("axes over C",)
OTHERS = ("dressing offset", "axes over Z", "clamping")
TOTAL = "total"
Answer = Literal["valid", "dress", "measure C only", "cannot tell"]


@dataclass(frozen=True, slots=True)
class PartFigures:
    """What one routine part adds to the charts: figures by name in um with their u, and when it was made.

    ``dressed`` parts have been ground since the last dressing, this one with them; ``degc`` of the part where known.
    """

    part: str
    utc: str
    values: Mapping[str, float]
    u: Mapping[str, float]
    dressed: int = 1
    degc: float | None = None

    @classmethod
    def of(cls, found: Separation, utc: str, dressed: int = 1, degc: float | None = None) -> PartFigures:
        """From a separation of one part."""
        shares = {
            "wheel": "wheel",
            "axes over C": "axes, over C",
            "axes over Z": "axes, over Z",
            "clamping": "clamping",
        }
        values = {name: found.share(one).rms_um for name, one in shares.items()}
        u = {name: found.share(one).u_um for name, one in shares.items()}
        single = {
            "dresser": found.diamond, "x zero": found.setup["x_um"], "dressing offset": found.setup["dressing_um"],
            "wear": found.wear["depth_um"],
        }  # fmt: skip
        for name, one in single.items():
            if np.isfinite(one.u):
                values[name], u[name] = one.value, one.u
        values[TOTAL], u[TOTAL] = found.total_um, found.point_u_um
        return cls(found.parts[0], utc, values, u, dressed, degc)


@dataclass(frozen=True, slots=True)
class ChartPoint:
    """One chart after the last part: value, EWMA, mean and limit to either side, um."""

    name: str
    value: float
    ewma: float
    mean: float
    limit: float

    @property
    def signals(self) -> bool:
        """Whether the EWMA lies beyond its limit."""
        return abs(self.ewma - self.mean) > self.limit


@dataclass(frozen=True, slots=True)
class ProcessAnswer:
    """What the routine parts say: the answer, the probability that the next part is within tolerance, the charts."""

    answer: Answer
    probability: float
    tolerance_um: float
    parts: int
    charts: tuple[ChartPoint, ...]

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the charts that signal."""
        return tuple(one.name for one in self.charts if one.signals)


def judge_process(history: Sequence[PartFigures], tolerance_um: float) -> ProcessAnswer:
    """The answer after the last part of a history; ``tolerance_um`` is the largest RMS of the whole deviation."""
    if len(history) <= BASE:
        return ProcessAnswer("cannot tell", float("nan"), tolerance_um=tolerance_um, parts=len(history), charts=())
    names = [name for name in (*WHEEL, *TURNING, *OTHERS, TOTAL) if all(name in one.values for one in history)]
    charts = tuple(_chart(history, name) for name in names)
    chance = _chance(history, tolerance_um)
    return ProcessAnswer(_answer(charts, chance), chance, tolerance_um=tolerance_um, parts=len(history), charts=charts)


def _chart(history: Sequence[PartFigures], name: str) -> ChartPoint:
    values = np.array([one.values[name] for one in history])
    first = values[:BASE]
    mean = float(first.mean())
    u = float(np.median([one.u.get(name, 0.0) for one in history[:BASE]]))
    variance = (PRIOR * u**2 + float(np.sum((first - mean) ** 2))) / (PRIOR + BASE - 1)
    z, steps = mean, 0
    for value, part in zip(values[BASE:], history[BASE:], strict=True):
        if part.dressed == 1 and name in WHEEL:
            z, steps = mean, 0
        z, steps = WEIGHT * value + (1.0 - WEIGHT) * z, steps + 1
    spread = WEIGHT / (2.0 - WEIGHT) * (1.0 - (1.0 - WEIGHT) ** (2 * steps)) + 1.0 / BASE
    limit = LIMIT * float(np.sqrt(variance * spread))
    return ChartPoint(name, value=float(values[-1]), ewma=float(z), mean=mean, limit=limit)


def _chance(history: Sequence[PartFigures], tolerance_um: float) -> float:
    """That the next part's whole deviation is within the tolerance, by the line through the last ones."""
    since = min(max(history[-1].dressed, BASE), LAST, len(history))
    y = np.array([one.values[TOTAL] for one in history[-since:]])
    x = np.arange(since, dtype=np.float64)
    design = np.stack([np.ones(since), x], axis=1)
    found = np.linalg.lstsq(design, y, rcond=None)[0]
    u = float(np.median([one.u.get(TOTAL, 0.0) for one in history[-since:]]))
    left = float(np.sum((y - design @ found) ** 2))
    freedom = PRIOR + since - 2
    variance = (PRIOR * u**2 + left) / freedom
    row = np.array([1.0, float(since)])
    spread = np.sqrt(variance * (1.0 + row @ np.linalg.inv(design.T @ design) @ row))
    return float(stdtr(freedom, (tolerance_um - float(row @ found)) / max(float(spread), 1e-9)))


def _answer(charts: Sequence[ChartPoint], chance: float) -> Answer:
    loud = {one.name for one in charts if one.signals} - {TOTAL}
    if not loud and chance >= SURE and not any(one.signals for one in charts):
        return "valid"
    if not loud:  # the whole grows, and no chart signals alone: the one that has moved most says where
        moved = max((one for one in charts if one.name != TOTAL), key=lambda one: abs(one.ewma - one.mean) / one.limit)
        loud = {moved.name} if abs(moved.ewma - moved.mean) > 0.5 * moved.limit else set()
    if loud and loud <= set(WHEEL):
        return "dress"
    if loud and loud <= set(TURNING):
        return "measure C only"
    return "cannot tell"
