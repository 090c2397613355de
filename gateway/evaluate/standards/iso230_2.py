"""ISO 230-2 evaluation of a positioning test, editions 1988, 1997, 2006 and 2014, complete or not."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import partial
from math import ceil, hypot, inf
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.message import Message, digits, fixed
from drivers.units import DeviationUnit
from gateway.domain.figures import Evaluation
from gateway.domain.values import FloatArray
from gateway.errors import ModelError
from gateway.evaluate.standards import statistics
from gateway.evaluate.standards.statistics import SECONDARY
from gateway.evaluate.uncertainty import budget as turning
from gateway.evaluate.uncertainty.budget import Budget, expanded_uncertainties

SIGMAS: Mapping[str, float] = {"1988": 3.0, "1997": 2.0, "2006": 2.0, "2014": 2.0}
STANDARD_RUNS = 5
UNITS = ("um", "arcsec")
MOST_INCURABLE = 0.5  # of A: beyond it no table is worth much
LONG_TRAVEL_MM, LONG_INTERVAL_MM = 2000.0, 250.0


def evaluate_iso230_2(
    targets: ArrayLike,
    deviations: ArrayLike,
    unit: DeviationUnit,
    *,
    edition: str | int = "2014",
    budget: Budget | None = None,
) -> Evaluation:
    """Evaluate deviations (m, n, 2), approach + then -, NaN where missing, in `unit`; targets (m,).

    Every target is evaluated with its own n. What the data do not allow is None, or NaN in arrays, and
    said in ``flags``: a target without one approach takes no part in B, M and R_i but stays in E and A of
    its approach; with n = 1 there is no s, R or A. ``U`` holds expanded uncertainties (k = 2) with
    coefficients of our own (`budget.expanded`). Formulas: ISO 230-2:2014, clause 3 (2 s; 1988: 3 s).
    Raises ModelError (E-EVAL-EDITION, E-EVAL-WORD, E-EVAL-NUMBER, E-EVAL-SHAPE, E-EVAL-INFINITE, E-EVAL-EMPTY).
    """
    edition = str(edition)
    k = sigmas(edition)
    _check_word("unit", unit, UNITS)
    at, x = statistics.check_readings(targets, deviations)
    mean, s, n = statistics.means(x), statistics.standard_deviations(x), statistics.counts(x)
    values = statistics.stated_values(statistics.parameters_of_moments(mean, s, k))
    return Evaluation(
        standard=f"ISO 230-2:{edition}",
        unit=unit,
        targets=at,
        mean_up=mean[:, 0],
        mean_down=mean[:, 1],
        s_up=s[:, 0],
        s_down=s[:, 1],
        B_i=mean[:, 0] - mean[:, 1],
        R_i=statistics.repeatability(mean, s, k),
        **values,
        U=_with_calibrator_shape(
            at, (mean, s), k=k, budget=budget or Budget(), U=_uncertainties(s, values, n, budget or Budget())
        ),
        flags=statistics.gaps(n, STANDARD_RUNS, "s, R, A"),
        edition=edition,
        certainty=SECONDARY,
    )


def minimum_targets(kind: Literal["linear", "rotary"], travel: float) -> tuple[int, int]:
    """Fewest targets and runs for a travel in mm or deg (ISO 230-2, clause 4), for planning and for judging a plan.

    Linear: five per metre and five in all, 5 runs; over 2000 mm a mean interval of 250 mm at most, 1 run.
    Rotary: 3 to 90 deg, 5 to 180, 8 to 360, 5 runs; beyond that 8 per revolution, 1 run.
    Raises ModelError (E-EVAL-WORD, E-EVAL-NUMBER).
    """
    _check_word(Message.of("W-EVAL-AXIS-KIND"), kind, ("linear", "rotary"))
    if not 0.0 < travel < inf:
        raise ModelError("E-EVAL-NUMBER", "ISO 230-2", key="travel", value=travel, must="above 0")
    if kind == "linear":
        if travel > LONG_TRAVEL_MM:
            return ceil(travel / LONG_INTERVAL_MM) + 1, 1
        return max(5, ceil(5.0 * travel / 1000.0)), STANDARD_RUNS
    if travel > 360.0:
        return ceil(8.0 * travel / 360.0), 1
    return next(count for limit, count in ((90, 3), (180, 5), (360, 8)) if travel <= limit), STANDARD_RUNS


def _check_word(key: str | Message, value: str, known: Collection[str]) -> None:
    if value not in known:
        raise ModelError("E-EVAL-WORD", "ISO 230-2", key=key, value=value, known=", ".join(known))


def sigmas(edition: str) -> float:
    """How many s a band is wide on each side: 2, in 1988 3. Raises ModelError (E-EVAL-EDITION)."""
    if edition not in SIGMAS:
        raise ModelError("E-EVAL-EDITION", "ISO 230-2", edition=edition, known=", ".join(SIGMAS))
    return SIGMAS[edition]


def incurable_part(evaluation: Evaluation) -> tuple[float, float] | None:
    """(A that would be left with the mean of both directions zero everywhere, its share of A); None without A."""
    if not evaluation.A:
        return None
    mean = np.stack([evaluation.mean_up, evaluation.mean_down], axis=-1)
    s = np.stack([evaluation.s_up, evaluation.s_down], axis=-1)
    centred = mean - mean.mean(axis=-1, keepdims=True)
    left = float(statistics.parameters_of_moments(centred, s, sigmas(evaluation.edition))["A"])
    return left, min(left / evaluation.A, 1.0)


def scatter_alone(evaluation: Evaluation) -> float | None:
    """A that scatter alone leaves: with both means zero everywhere; None without A."""
    if not evaluation.A:
        return None
    s = np.stack([evaluation.s_up, evaluation.s_down], axis=-1)
    return float(
        statistics.parameters_of_moments(np.where(np.isfinite(s), 0.0, np.nan), s, sigmas(evaluation.edition))["A"]
    )


def describe_incurable(evaluation: Evaluation) -> tuple[Message, ...]:
    """A remark where reversal and scatter make more than half of A."""
    found = incurable_part(evaluation)
    if found is None or found[1] <= MOST_INCURABLE:
        return ()
    left, share = found
    fields = {"scatter": digits(scatter_alone(evaluation), 3)}
    fields |= {"A": digits(evaluation.A, 3), "left": digits(left, 3), "percent": fixed(100.0 * share, 0)}
    return (Message.of("W-INCURABLE", **fields, unit=evaluation.unit),)


def _with_calibrator_shape(
    at: FloatArray, table: tuple[FloatArray, FloatArray], *, k: float, budget: Budget, U: Mapping[str, float]
) -> dict[str, float]:
    """Uncertainties with what a rotary calibrator's shape does to the ranges among them."""
    if not budget.turning:
        return dict(U)
    mean, s = table
    figures = partial(statistics.ranges, s=s, k=k)
    wide = turning.uncertainty_of_ranges(at, mean, budget.turning, figures)
    return {name: hypot(value, wide.get(name, 0.0)) for name, value in U.items()}


def _uncertainties(
    s: FloatArray, values: Mapping[str, float | None], n: NDArray[np.int64], budget: Budget
) -> dict[str, float]:
    eve = budget.eve
    if eve is None:
        known = s[np.isfinite(s)]
        if not known.size:
            return {}
        eve = 2.0 * float(np.sqrt(np.mean(known**2)))
    fewest, both = int(n[n > 0].min()), int((n > 0).all(axis=1).sum())
    # R and A stand on the places with two readings and more alone.
    repeated = int(n[n > 1].min(initial=int(n.max())))
    spread, means = (expanded_uncertainties(count, eve, budget.systematic, both) for count in (repeated, fewest))
    found = {**means, **{name: u for name, u in spread.items() if name[0] in "RA"}}
    return {name: u for name, u in found.items() if values[name] is not None}
