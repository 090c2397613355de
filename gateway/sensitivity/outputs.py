"""Figures of flank and inspection chart for given sizes of the errors (mm, rad), and the error to measure next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from gateway.domain.values import FloatArray
from gateway.errors import ModelError
from gateway.gear.envelope import exact
from gateway.gear.first_order import ErrorParameter, bounded_first_order, linear_flank
from gateway.gear.flank import FlankGrid, flank_figure, inspect
from gateway.gear.grinding import Grinding
from gateway.model.chain import Motion
from gateway.model.motion import travel_of

OUTPUTS = ("rms", "largest", "profile", "lead", "pitch", "runout")
Order = Literal["first", "second", "exact"]
EQUAL_MM, EQUAL_RAD = 0.005, float(np.deg2rad(0.01))
TRAVEL_SAMPLES = 181


@dataclass(frozen=True, slots=True)
class Span:
    """Range of one error's size: the error is size x shape, the shape 1 if not given (mm or rad)."""

    name: str
    low: float
    high: float
    shape: Motion = 1.0

    def size(self, x: FloatArray) -> FloatArray:
        """Size at x in 0 .. 1, same shape."""
        return np.asarray(self.low + x * (self.high - self.low))


@dataclass(frozen=True, slots=True)
class ScaledMotion:
    """A motion times a factor; plain data, so that it can be sent to another process."""

    motion: Motion
    factor: float

    def __call__(self, q: FloatArray) -> FloatArray:
        """Values at q, same shape."""
        value = self.motion(q) if callable(self.motion) else np.full_like(q, self.motion)
        return self.factor * value


@dataclass(frozen=True)
class FlankOutputs:
    """`OUTPUTS` (mm) of a grinding with the errors of the spans alone; called with points (n, d) of the unit cube.

    RMS and largest are those of the flank figure; profile and lead the largest total deviation of any trace, pitch the
    larger F_p of both flanks, runout F_r. ``order`` says how the flank is worked out.
    """

    grinding: Grinding
    grid: FlankGrid
    spans: tuple[Span, ...]
    order: Order = "first"

    def __post_init__(self) -> None:
        if self.order not in ("first", "second", "exact"):
            raise ModelError("E-SENS-ORDER", "ranking", order=self.order)

    def __call__(self, points: FloatArray) -> FloatArray:
        """Outputs (n, 6) of points (n, d)."""
        sizes = np.stack([span.size(points[:, i]) for i, span in enumerate(self.spans)], axis=-1)
        if self.order == "first":
            return np.stack([figures(self.grid, e) for e in self._linear(sizes)])
        return np.stack([figures(self.grid, self._flank(one)) for one in sizes])

    def _linear(self, sizes: FloatArray) -> FloatArray:
        parameters = [_parameter(span) for span in self.spans]
        flank = linear_flank(self._clean(), self.grid, parameters)
        return flank.deviations(sizes.T).T.reshape(-1, *self.grid.shape)

    def _flank(self, sizes: FloatArray) -> FloatArray:
        errors = {span.name: _motion(span, float(size)) for span, size in zip(self.spans, sizes, strict=True)}
        clean = self._clean()
        one = replace(clean, chain=clean.chain.with_errors(errors))
        if self.order == "second":
            return bounded_first_order(one, self.grid.k, self.grid.theta, self.grid.z).second
        return exact(one, self.grid.k, self.grid.theta, self.grid.z)

    def _clean(self) -> Grinding:
        return replace(self.grinding, chain=self.grinding.chain.without_errors())


def figures(grid: FlankGrid, deviation: FloatArray) -> FloatArray:
    """`OUTPUTS` (6,) of deviations (K, T, Z), mm; the figure's rotation is the chart's angular datum."""
    figure = flank_figure(deviation, grid.section.h)
    chart = inspect(grid, deviation - figure.rotation * grid.section.h)
    pitch = max(one.F_p for one in chart.pitch)
    values = (figure.rms, figure.largest, np.max(chart.profile.F), np.max(chart.lead.F), pitch, chart.runout.F_r)
    return np.asarray(values, dtype=np.float64)


def equal_spans(names: Sequence[str], *, symmetric: bool = False) -> tuple[Span, ...]:
    """The paper's equal steps: 5 um or 0.01 deg of each error, from zero or, if ``symmetric``, to both sides."""
    return tuple(Span(name, -size if symmetric else 0.0, size) for name, size in ((n, equal_size(n)) for n in names))


def equal_size(name: str) -> float:
    """5 um (mm) or 0.01 deg (rad), by what kind of error it is: EAX and B0Z are angles."""
    angle = name[1:2] in "ABC" if name.startswith("E") else name[:1] in "ABC"
    return EQUAL_RAD if angle else EQUAL_MM


def measured_spans(
    grinding: Grinding, names: Sequence[str], travels: Mapping[str, tuple[float, float]]
) -> tuple[Span, ...]:
    """Each error from its least to its greatest value over its axis' travel (mm or rad); a constant from zero to it.

    Of a travel that counts over which the error is known. Raises ModelError (E-MODEL-RANGE) where that is nothing,
    E-SENS-TRAVEL for a linear axis without a travel.
    """
    found = []
    for name in names:
        axis, key = grinding.chain.error_place(name)
        one = grinding.chain.axis(axis)
        if key in one.err and callable(one.err[key]):
            reach = travels.get(axis, (0.0, 2.0 * np.pi) if one.kind == "revolute" else None)
            if reach is None:
                raise ModelError("E-SENS-TRAVEL", "ranking", name=name, axis=axis)
            values = one.value(key, np.linspace(*travel_of(one.err[key], *reach), TRAVEL_SAMPLES))
        else:
            values = np.array(
                [0.0, float(one.loc.get(key, 0.0)) if key in one.loc else _constant(one.err.get(key, 0.0))]
            )
        found.append(Span(name, float(np.min(values)), float(np.max(values))))
    return tuple(found)


def _constant(motion: Motion) -> float:
    return 0.0 if callable(motion) else float(motion)


def _parameter(span: Span) -> ErrorParameter:
    shape = span.shape
    if callable(shape):
        return ErrorParameter(span.name, shape)
    return ErrorParameter(span.name) if shape == 1.0 else ErrorParameter(span.name, lambda q: np.full_like(q, shape))


def _motion(span: Span, size: float) -> Motion:
    return ScaledMotion(span.shape, size) if callable(span.shape) else size * span.shape


# ---- What to measure next: the error whose better knowledge would change the proposed correction most.

RANK = 1e-10


@dataclass(frozen=True, slots=True)
class MeasurementPriority:
    """One error's doubt: what it moves the proposal by on the flank, what no proposal can follow (both RMS, in the
    unit of the columns), and its share of all that the proposal may be wrong by."""

    name: str
    change: float
    beyond: float
    share: float


def measure_next(
    names: Sequence[str], doubts: ArrayLike, cures: ArrayLike, points: int
) -> tuple[MeasurementPriority, ...]:
    """Errors by what their doubt changes in the proposal, the most important first.

    ``doubts`` (R, d): the flank of one standard uncertainty, named by the error it belongs to (several independent
    columns of one error count together); ``cures`` (R, m): the flank of one unit of
    each value that may be set; both in coordinates whose sum of squares is ``points`` times the mean square. A least-
    squares proposal follows the part of a doubt that the cures span: so much it would change if the error were known.
    """
    W, A = np.asarray(doubts, dtype=np.float64), np.asarray(cures, dtype=np.float64)
    if W.ndim != 2 or A.ndim != 2 or W.shape != (A.shape[0], len(names)):
        raise ModelError("E-SENS-SHAPE", "what next", points=W.shape, outputs=A.shape)
    size = np.linalg.norm(A, axis=0)
    used = A[:, size > 0.0] / size[size > 0.0]
    u, s, _ = np.linalg.svd(used, full_matrices=False)
    followed = u[:, s > RANK * np.max(s, initial=0.0)].T @ W
    errors = list(dict.fromkeys(names))
    moved, whole = np.zeros(len(errors)), np.zeros(len(errors))
    for i, name in enumerate(names):
        moved[errors.index(name)] += float(np.sum(followed[:, i] ** 2)) / points
        whole[errors.index(name)] += float(np.sum(W[:, i] ** 2)) / points
    beyond = np.sqrt(np.maximum(whole - moved, 0.0))
    total = float(np.sum(moved))
    share = moved / total if total > 0.0 else moved
    order = np.argsort(-moved, kind="stable")
    return tuple(
        MeasurementPriority(errors[i], float(np.sqrt(moved[i])), float(beyond[i]), float(share[i])) for i in order
    )
