"""Fits the measured means of an axis: weighted least squares, of an order that takes structure and leaves noise."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import comb, log
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.units import AxisUnit
from gateway.domain.figures import Component
from gateway.domain.values import FloatArray
from gateway.errors import ModelError, NotIdentifiable
from gateway.model.components import FEWEST, at_datum, design, leave_one_out_rows, separate_nodes

# ---- Weighted least squares with an honest covariance: the scatter of what is left is in it.

LARGEST_CONDITION = 1e10


@dataclass(frozen=True, slots=True)
class Regression:
    """A solved fit: coefficients (p,), covariance (p, p), residual (m,), leverage (m,) and chi-square.

    ``covariance`` is (A'WA)^-1 times the larger of 1 and chi-square / (m - p).
    """

    coefficients: FloatArray
    covariance: FloatArray
    residual: FloatArray
    leverage: FloatArray
    chi_square: float

    @property
    def left_out(self) -> FloatArray:
        """What each point would be off if it had not been fitted (PRESS residual), shape (m,)."""
        return self.residual / np.maximum(1.0 - self.leverage, 1e-9)


def check_means(
    targets: ArrayLike, means: ArrayLike, u: ArrayLike | float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Targets, means and uncertainties (m,) as numbers; a target without a place is one without a mean (NaN).

    Raises ModelError (E-MODEL-SHAPE) where they are no numbers or not as many.
    """
    try:
        at, values, sigma = (np.asarray(one, dtype=np.float64) for one in (targets, means, u))
    except (TypeError, ValueError):
        at, values, sigma = (np.zeros((0, 0)) for _ in range(3))
    if at.ndim != 1 or values.shape != at.shape or sigma.shape not in ((), at.shape):
        raise ModelError("E-MODEL-SHAPE", "fit", targets=str(at.shape), means=str(values.shape), u=str(sigma.shape))
    return at, np.where(np.isfinite(at), values, np.nan), np.broadcast_to(sigma, at.shape)


def solve_weighted(design: FloatArray, values: FloatArray, u: FloatArray, where: str = "fit") -> Regression:
    """Fit values (m,) with standard uncertainties u (m,) by the columns of design (m, p).

    Raises NotIdentifiable (E-MODEL-POINTS: fewer points than unknowns; E-MODEL-CONDITION).
    """
    m, p = design.shape
    if m < p:
        raise NotIdentifiable("E-MODEL-POINTS", where, points=m, unknowns=p)
    rows, target = design / u[:, None], values / u
    left, singular, right = np.linalg.svd(rows, full_matrices=False)
    if singular[-1] <= singular[0] / LARGEST_CONDITION:
        raise NotIdentifiable("E-MODEL-CONDITION", where, unknowns=p, points=m)
    inverse = right.T / singular
    coefficients = inverse @ (left.T @ target)
    residual = values - design @ coefficients
    chi_square = float(np.sum((residual / u) ** 2))
    scatter = max(1.0, chi_square / (m - p)) if m > p else 1.0
    return Regression(
        coefficients=coefficients,
        covariance=inverse @ inverse.T * scatter,
        residual=residual,
        leverage=np.sum(left**2, axis=1),
        chi_square=chi_square,
    )


HIGHEST_DEGREE = 9
HIGHEST_ORDER = 12
WIDEST_GAP_DEG = 60.0
WIDEST_MODULO_GAP_DEG = 180.0
SIMPLER_WITHIN = 1.1
FAR_ABOVE_NOISE = 5.0
TURN_DEG = 360.0
SAME_DEG = 1e-6
ENDS_ALIKE = 0.1
"""Share of all that an axis deviates by which places a turn apart may differ: instruments and warmth drift so much."""
THROUGH = "cubic", "piecewise"
SMALLEST_U = 1e-3
"""Weights assume at least this, um or arcsec: readings that agree to the last digit are not exact."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """One basis tried on the data. ``criterion`` ranks within a family, ``left_out`` between families.

    ``left_out`` is the rms by which a target is missed when it is not fitted, never below the noise.
    """

    basis: str
    parameters: Mapping[str, Any]
    regression: Regression
    criterion: float
    left_out: float

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return int(self.regression.coefficients.size)


@dataclass(frozen=True, slots=True)
class _Data:
    """Points to fit, ascending; ``period`` is None unless the axis closes on itself. ``driven``: by screw or worm."""

    at: FloatArray
    values: FloatArray
    u: FloatArray
    period: float | None = None
    driven: bool = False

    @property
    def noise(self) -> float:
        return float(np.sqrt(np.mean(self.u**2)))


def fit_positioning(
    targets: ArrayLike,
    means: ArrayLike,
    u: ArrayLike | float,
    *,
    name: str,
    axis: str,
    axis_unit: AxisUnit,
    kind: Literal["linear", "rotary"],
    modulo: bool = False,
    reference: float | None = None,
) -> Component:
    """Fit mean deviations (m,) at targets (m,), standard uncertainties u (m,) or one for all.

    A full turn is fitted with harmonics or a periodic polygon, anything else with polynomials, cubic
    B-splines or the curve through the means that bends least (straight lines of few). Within a family AICc,
    extended for the number of choices and with the known noise as floor, chooses the order; between families
    the leave-one-out error does (see `choose`). The covariance holds the scatter that the fit leaves (order
    above the targets, steps). Targets without a mean (NaN) are left out. With `reference` the value there is
    made zero (datum). Targets around a part of the turn of a `modulo` axis lie beside each other across 0 deg, whatever
    they are counted from: the curve never crosses the part that was not measured.
    Raises NotIdentifiable (E-MODEL-POINTS) with fewer than two targets, ModelError (E-MODEL-U: a mean has no
    uncertainty; E-MODEL-SHAPE).
    """
    data = _data(targets, means, u, name)
    if kind == "rotary" and _closes(data, modulo):
        data = replace(data, period=TURN_DEG)
    elif kind == "rotary" and modulo:
        data = _part_of_turn(data)
    best = choose(candidates(data), data.noise)
    fitted = _component(best, data, name, axis, axis_unit)
    return fitted if reference is None else at_datum(fitted, reference)


def fit_through(
    targets: ArrayLike, means: ArrayLike, u: ArrayLike | float, *, name: str, axis: str, axis_unit: AxisUnit
) -> Component:
    """The curve through the means, whatever their scatter; straight lines of few. Arguments as `fit_positioning`."""
    data = _data(targets, means, u, name)
    return _component(_through(data), data, name, axis, axis_unit)


def _component(best: Candidate, data: _Data, name: str, axis: str, axis_unit: AxisUnit) -> Component:
    return Component(
        name=name,
        axis=axis,
        axis_unit=axis_unit,
        basis=best.basis,
        domain=(float(data.at[0]), float(data.at[-1])),
        coefficients=best.regression.coefficients,
        covariance=best.regression.covariance,
        parameters=best.parameters,
        residual_rms=_unresolved_rms(best, data),
    )


def choose(tried: Iterable[Candidate], noise: float) -> Candidate:
    """The candidate that misses a left-out target least; a simpler one within 10 % of it is preferred.

    Where that leaves more than half of what a constant misses, and this is far above the noise, the
    deviation changes almost as fast as the targets follow: then the curve through them, if it predicts
    anything at all.
    """
    everyone = list(tried)
    limit = min(candidate.left_out for candidate in everyone) * SIMPLER_WITHIN
    best = min((c for c in everyone if c.left_out <= limit), key=lambda c: c.size)
    plain = max(c.left_out for c in everyone if c.basis == "constant")
    if plain > FAR_ABOVE_NOISE * noise and best.left_out > plain / 2.0:
        return next((c for c in everyone if c.basis in THROUGH and c.left_out < plain), best)
    return best


def candidates(data: _Data) -> tuple[Candidate, ...]:
    """The best of every family that the data can carry."""
    found = [_candidate("constant", {} if data.period is None else {"period": data.period}, data)]
    if data.period is not None:
        found += _harmonics(data)
    else:
        found += _best(_polynomials(data)) + _best(_splines(data))
    if data.at.size > 3:
        found.append(_through(data))
    return tuple(found)


def _data(targets: ArrayLike, means: ArrayLike, u: ArrayLike | float, name: str) -> _Data:
    at, values, sigma = check_means(targets, means, u)
    known = np.isfinite(values) & np.isfinite(at)
    places = np.unique(at[known]).size
    if places < 2:
        raise NotIdentifiable("E-MODEL-POINTS", "fit", points=places, unknowns=2)
    if not (np.isfinite(sigma[known]).all() and (sigma[known] >= 0.0).all()):
        raise ModelError("E-MODEL-U", "fit")
    order = np.argsort(at[known], kind="stable")
    least = np.maximum(sigma[known][order], SMALLEST_U)
    return _Data(at[known][order], values[known][order], least, driven=name[1:2] == name[2:3])


def _closes(data: _Data, modulo: bool) -> bool:
    """Whether targets lie all around a turn, and an axis that does not count modulo shows the same at both its ends."""
    if data.at.size <= 2 or _gaps(data.at)[1] > (WIDEST_MODULO_GAP_DEG if modulo else WIDEST_GAP_DEG):
        return False
    early, late = np.nonzero(np.abs(data.at[:, None] + TURN_DEG - data.at[None, :]) < SAME_DEG)
    apart = np.abs(data.values[late] - data.values[early])
    return modulo or bool(np.all(apart <= max(FAR_ABOVE_NOISE * data.noise, ENDS_ALIKE * float(np.ptp(data.values)))))


def part_of_turn(at: FloatArray) -> FloatArray:
    """Positions (m,) of a modulo axis counted on from where the widest gap of the turn ends: 340, 350, 0 as 340 .. 360.

    Positions that lie so already are returned as they are.
    """
    places = np.unique(np.round(np.mod(at, TURN_DEG), 6))
    gaps = np.diff(np.append(places, places[0] + TURN_DEG))
    if float(np.ptp(at)) <= TURN_DEG - float(gaps.max()) + SAME_DEG:
        return at
    start = float(places[(int(np.argmax(gaps)) + 1) % places.size])
    return np.asarray(start + np.mod(np.round(at - start, 9), TURN_DEG))


def _part_of_turn(data: _Data) -> _Data:
    at = part_of_turn(data.at)
    order = np.argsort(at, kind="stable")
    return replace(data, at=at[order], values=data.values[order], u=data.u[order])


def _gaps(at: FloatArray) -> tuple[int, float]:
    """How many different places of the turn there are, and the widest gap between them in deg."""
    places = np.unique(np.round(np.mod(at, TURN_DEG), 6))
    return places.size, float(np.diff(np.append(places, places[0] + TURN_DEG)).max())


def _candidate(basis: str, parameters: Mapping[str, Any], data: _Data, choices: int = 1) -> Candidate:
    solved = solve_weighted(design(basis, parameters, data.at), data.values, data.u, basis)
    size = solved.coefficients.size
    missed = float(np.sqrt(np.mean(solved.left_out**2)))
    return Candidate(
        basis=basis,
        parameters=parameters,
        regression=solved,
        criterion=_criterion(solved, data, size, choices),
        left_out=max(missed, data.noise),
    )


def _criterion(solved: Regression, data: _Data, size: int, choices: int) -> float:
    # Scatter below the known noise is no merit: there the variance is known, above it is estimated.
    m, per_point = data.at.size, solved.chi_square / data.at.size
    misfit = m * (log(per_point) + 1.0) if per_point > 1.0 else m * per_point
    # AICc corrects for few points (else the last orders always look good), EBIC for the many choices.
    return misfit + 2.0 * size * m / max(m - size - 1, 0.5) + 2.0 * log(choices)


def _best(family: Iterable[Candidate]) -> list[Candidate]:
    members = list(family)
    return [min(members, key=lambda c: c.criterion)] if members else []


def _polynomials(data: _Data) -> Iterable[Candidate]:
    low, high = float(data.at[0]), float(data.at[-1])
    shared = {"centre": (low + high) / 2.0, "scale": (high - low) / 2.0}
    for degree in range(1, min(HIGHEST_DEGREE, np.unique(data.at).size // 2) + 1):
        yield _candidate("polynomial", {**shared, "degree": degree}, data)


def _splines(data: _Data) -> Iterable[Candidate]:
    places = separate_nodes(data.at)
    for count in range(1, max(1, places.size - 7)):
        quantiles = np.linspace(0.0, 1.0, count + 2)[1:-1]
        interior = np.quantile(places, quantiles)
        try:
            yield _candidate("bspline", _knots(data.at, tuple(float(q) for q in interior)), data)
        except NotIdentifiable:
            return


def _knots(at: FloatArray, interior: tuple[float, ...]) -> Mapping[str, Any]:
    low, high = float(at[0]), float(at[-1])
    return {"knots": (low,) * 4 + interior + (high,) * 4}


def _harmonics(data: _Data) -> list[Candidate]:
    places, widest = _gaps(data.at)
    if widest > WIDEST_GAP_DEG:
        return []
    highest = min(HIGHEST_ORDER, (places - 3) // 2, int(0.75 * TURN_DEG // widest))
    chosen: tuple[int, ...] = ()
    path: list[Candidate] = []
    while len(chosen) < highest:
        rest = [order for order in range(1, highest + 1) if order not in chosen]
        choices = comb(highest, len(chosen) + 1)
        tried = [_with_orders(data, (*chosen, order), choices) for order in rest]
        best = min(tried, key=lambda c: c.regression.chi_square)
        chosen = tuple(best.parameters["orders"])
        path.append(best)
    return _best(path)


def _with_orders(data: _Data, orders: tuple[int, ...], choices: int) -> Candidate:
    return _candidate("fourier", {"period": data.period, "orders": tuple(sorted(orders))}, data, choices)


def _through(data: _Data) -> Candidate:
    """What goes through the means takes everything, so it is judged by its leave-one-out error.

    The pitch of a screw is too short for any curve through targets, which swings more than straight lines; and what
    is measured at the points of a table is gone there only with straight lines, which a table is made of. So along the
    axis that it drives these go.
    """
    at = data.at if data.period is None else np.mod(data.at, data.period)
    nodes = separate_nodes(at)
    if data.period is not None or data.driven or nodes.size < FEWEST:
        return _node_fit("piecewise", np.unique(np.round(at, 6)), data)
    return _node_fit("cubic", nodes, data)


def _node_fit(basis: str, nodes: FloatArray, data: _Data) -> Candidate:
    parameters = {"nodes": tuple(float(q) for q in nodes), "period": data.period}
    solved = solve_weighted(design(basis, parameters, data.at), data.values, data.u, basis)
    means = solved.coefficients
    skipped = leave_one_out_rows(nodes) @ means if basis == "cubic" else _off_neighbours(nodes, means, data.period)
    missed = max(float(np.sqrt(np.mean(skipped**2))), data.noise)
    return Candidate(basis=basis, parameters=parameters, regression=solved, criterion=float("inf"), left_out=missed)


def _off_neighbours(nodes: FloatArray, values: FloatArray, period: float | None) -> FloatArray:
    """Value at each inner node less the line between its neighbours."""
    if period is not None:
        nodes = np.concatenate(([nodes[-1] - period], nodes, [nodes[0] + period]))
        values = np.concatenate(([values[-1]], values, [values[0]]))
    share = (nodes[1:-1] - nodes[:-2]) / (nodes[2:] - nodes[:-2])
    return np.asarray(values[1:-1] - (1.0 - share) * values[:-2] - share * values[2:])


def _unresolved_rms(best: Candidate, data: _Data) -> float:
    """Rms of structure that the fit does not follow, less the noise it must leave."""
    if best.basis in THROUGH:
        nodes, means = np.asarray(best.parameters["nodes"]), best.regression.coefficients
        # A target misses the line between its neighbours by sqrt(1.5) times what scatters independently. A curve that
        # was chosen because it misses little may do so by luck: then the line tells.
        missed = [_off_neighbours(nodes, means, data.period) / 1.5**0.5]
        if best.basis == "cubic":
            rows = leave_one_out_rows(nodes)
            missed.append(rows @ means / float(np.mean(np.sum(rows**2, axis=1))) ** 0.5)
        square = max(float(np.mean(one**2)) for one in missed)
        return float(np.sqrt(max(square - data.noise**2, 0.0)))
    freedom = max(data.at.size - best.size, 1)
    spread = float(np.sum(best.regression.residual**2)) / freedom
    return float(np.sqrt(max(spread - data.noise**2, 0.0)))
