"""ISO 230-2 evaluation of a positioning test, editions 1988, 1997, 2006 and 2014, complete or not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, floor
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.units import DeviationUnit
from gateway.domain import Evaluation, FloatArray
from gateway.errors import ModelError
from gateway.evaluate import readings
from gateway.evaluate.uncertainty import Budget, expanded

COVERAGE: Mapping[str, float] = {"1988": 3.0, "1997": 2.0, "2006": 2.0, "2014": 2.0}
STANDARD_RUNS = 5
LONG_TRAVEL_MM = 2000.0


def evaluate(
    targets: ArrayLike,
    deviations: ArrayLike,
    unit: DeviationUnit,
    *,
    edition: str = "2014",
    budget: Budget | None = None,
) -> Evaluation:
    """Evaluate deviations (m, n, 2), approach + then -, NaN where missing, in `unit`; targets (m,).

    Every target is evaluated with its own n. What the data do not allow is None, or NaN in arrays, and
    said in ``flags``: a target without one approach takes no part in B, M and R_i but stays in E and A of
    its approach; with n = 1 there is no s, R or A. ``U`` holds expanded uncertainties (k = 2) with
    coefficients of our own (`uncertainty.expanded`). Formulas: ISO 230-2:2014, clause 3 (2 s; 1988: 3 s).
    Raises ModelError (E-EVAL-EDITION, E-EVAL-SHAPE, E-EVAL-INFINITE, E-EVAL-EMPTY).
    """
    if edition not in COVERAGE:
        raise ModelError("E-EVAL-EDITION", "ISO 230-2", edition=edition, known=", ".join(COVERAGE))
    at, x = readings.checked(targets, deviations)
    table = _Table(readings.means(x), readings.standard_deviations(x), COVERAGE[edition])
    n = readings.counts(x)
    return Evaluation(
        standard=f"ISO 230-2:{edition}",
        unit=unit,
        targets=at,
        mean_up=table.mean[:, 0],
        mean_down=table.mean[:, 1],
        s_up=table.s[:, 0],
        s_down=table.s[:, 1],
        B_i=table.reversal,
        R_i=table.repeatability,
        **table.parameters(),
        U=_uncertainties(table, n, budget or Budget()),
        flags=_flags(n),
    )


def evaluate_positions(
    targets: ArrayLike,
    positions: ArrayLike,
    unit: DeviationUnit,
    *,
    edition: str = "2014",
    budget: Budget | None = None,
) -> Evaluation:
    """As `evaluate`, from measured positions (m, n, 2) in the unit of the results."""
    return evaluate(targets, readings.deviations_of(targets, positions), unit, edition=edition, budget=budget)


def minimum_targets(kind: Literal["linear", "rotary"], travel: float) -> tuple[int, int]:
    """Fewest targets and runs for a travel in mm or deg (ISO 230-2, clause 4).

    Linear: five per metre and five in all, 5 runs; over 2000 mm a mean interval of 250 mm, 1 run.
    Rotary: 3 to 90 deg, 5 to 180, 8 to 360, 5 runs; beyond that 8 per revolution, 1 run.
    """
    if kind == "linear":
        if travel > LONG_TRAVEL_MM:
            return floor(travel / 250.0) + 1, 1
        return max(5, ceil(5.0 * travel / 1000.0)), STANDARD_RUNS
    if travel > 360.0:
        return ceil(8.0 * travel / 360.0), 1
    return next(count for limit, count in ((90, 3), (180, 5), (360, 8)) if travel <= limit), STANDARD_RUNS


@dataclass(frozen=True, slots=True)
class _Table:
    """Means and standard deviations (m, 2) and what follows from them; ``k`` is 2, in 1988 3."""

    mean: FloatArray
    s: FloatArray
    k: float

    @property
    def reversal(self) -> FloatArray:
        """B_i, signed, NaN where one approach is missing."""
        return self.mean[:, 0] - self.mean[:, 1]

    @property
    def repeatability(self) -> FloatArray:
        """R_i = max(k s+ + k s- + |B_i|, 2k s+, 2k s-), NaN where it cannot be had."""
        both = self.k * (self.s[:, 0] + self.s[:, 1]) + np.abs(self.reversal)
        return np.asarray(np.maximum(both, np.max(2.0 * self.k * self.s, axis=1)))

    def parameters(self) -> dict[str, float | None]:
        up, down = self.mean[:, 0], self.mean[:, 1]
        has_both = bool(np.isfinite(self.mean).any(axis=0).all())
        complete_s = bool(np.isfinite(self.s[np.isfinite(self.mean)]).all())
        reversal = self.reversal
        values = {
            "B": _top(np.abs(reversal)),
            "B_mean": _mean(reversal),
            "M": _range(self.mean.mean(axis=1)),
            "E": _range(self.mean) if has_both else None,
            "E_up": _range(up),
            "E_down": _range(down),
            "R": None,
            "R_up": None,
            "R_down": None,
            "A": None,
            "A_up": None,
            "A_down": None,
        }
        return values | (self._with_spread(has_both) if complete_s else {})

    def _with_spread(self, has_both: bool) -> dict[str, float | None]:
        high, low = self.mean + self.k * self.s, self.mean - self.k * self.s
        return {
            "R": _top(self.repeatability),
            "R_up": _top(2.0 * self.k * self.s[:, 0]),
            "R_down": _top(2.0 * self.k * self.s[:, 1]),
            "A": _span(high, low) if has_both else None,
            "A_up": _span(high[:, 0], low[:, 0]),
            "A_down": _span(high[:, 1], low[:, 1]),
        }


def _top(values: FloatArray) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.max()) if known.size else None


def _mean(values: FloatArray) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else None


def _range(values: FloatArray) -> float | None:
    return _span(values, values)


def _span(high: FloatArray, low: FloatArray) -> float | None:
    top, bottom = high[np.isfinite(high)], low[np.isfinite(low)]
    return float(top.max() - bottom.min()) if top.size else None


def _uncertainties(
    table: _Table, n: np.ndarray[tuple[int, ...], np.dtype[np.int64]], budget: Budget
) -> Mapping[str, float]:
    fewest = int(n[n > 0].min())
    eve = budget.eve
    if eve is None:
        known = table.s[np.isfinite(table.s)]
        if not known.size:
            return {}
        eve = 2.0 * float(np.sqrt(np.mean(known**2)))
    exist = table.parameters()
    return {name: u for name, u in expanded(fewest, eve, budget.systematic).items() if exist[name] is not None}


def _flags(n: np.ndarray[tuple[int, ...], np.dtype[np.int64]]) -> tuple[str, ...]:
    used = n[:, n.any(axis=0)]
    found = ["unidirectional"] if used.shape[1] == 1 else []
    if n.shape[0] == 1:
        found.append("one target")
    found += [f"no approach {'+-'[a]} at i = {i + 1}" for i, a in np.argwhere(used == 0)]
    runs = int(used.max())
    found += [f"n = {used[i, a]} of {runs} at i = {i + 1}" for i, a in np.argwhere((used > 0) & (used < runs))]
    if runs < STANDARD_RUNS:
        found.append(f"n = {runs}" + (": no s, R, A" if runs == 1 else f", the standard asks for {STANDARD_RUNS}"))
    elif 1 in used:
        found.append("a target has one reading: no R, A")
    return tuple(found)
