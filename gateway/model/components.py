"""Error motions as functions of position: bases, values, uncertainties, and what belongs to set-up or location."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from drivers.units import rad_to_deg
from gateway.domain.figures import Component
from gateway.domain.values import FloatArray
from gateway.errors import ModelError

LONGEST_WAVE = 12
"""Orders of a turn above this are waves of worm or scale, not the axis' shape."""
Parameters = Mapping[str, Any]
TURN_DEG = 360.0
NEAR = 0.05  # of a range: beyond its ends an end's value is an estimate with a doubt (`near_value`)
SLACK = 1e-3
"""mm or deg beyond the ends that count as the ends: controls round positions, and a derivative needs both sides."""


@dataclass(frozen=True, slots=True)
class KnownRange:
    """Where an error motion is known: ``low`` to ``high`` in ``unit``, everywhere if it repeats after ``period``.

    Angles a whole turn apart are one place, so a position of a turning axis is reduced into the range where exactly
    one such place lies in it.
    """

    name: str
    low: float
    high: float
    unit: Literal["mm", "deg", "rad"]
    period: float | None = None

    @staticmethod
    def of(component: Component) -> KnownRange:
        """The range that a component was fitted over."""
        period = component.parameters.get("period")
        turn = float(str(period)) if period is not None else None
        return KnownRange(component.name, *component.domain, component.axis_unit, turn)

    @property
    def turn(self) -> float | None:
        """A whole turn in the unit; None for a length."""
        return {"mm": None, "deg": TURN_DEG, "rad": 2.0 * np.pi}[self.unit]

    @property
    def slack(self) -> float:
        """`SLACK` in the unit."""
        return float(np.deg2rad(SLACK)) if self.unit == "rad" else SLACK

    def inside(self, positions: ArrayLike) -> FloatArray:
        """Positions (any shape) as they lie in the range.

        Raises ModelError (E-MODEL-RANGE) with name, range and the first position that lies outside.
        """
        at = np.asarray(positions, dtype=np.float64)
        if self.period is not None or not np.any(self._outside(at)):
            return at
        at = self.reduced(at)
        outside = self._outside(at)
        if np.any(outside):
            raise self._error(float(np.asarray(positions, dtype=np.float64)[outside].flat[0]))
        return at

    def has(self, position: float) -> bool:
        """Whether the motion is known at a position."""
        at = np.asarray(position, dtype=np.float64)
        return self.period is not None or not bool(np.any(self._outside(self.reduced(at))))

    def within(self, low: float, high: float) -> tuple[float, float]:
        """What of a travel is known; all of it where the motion repeats or the travel of a turning axis fits in.

        Raises ModelError (E-MODEL-RANGE) where nothing of it is.
        """
        if self.period is not None or (self.turn is not None and self.has(low) and self.has(high)):
            return low, high
        if self.turn is not None:
            return self.low, self.high
        if low > self.high - self.slack or high < self.low + self.slack:
            raise self._error(high if low > self.high - self.slack else low)
        return max(low, self.low), min(high, self.high)

    def _outside(self, at: FloatArray) -> Any:
        return (at < self.low - self.slack) | (at > self.high + self.slack)

    def reduced(self, at: FloatArray) -> FloatArray:
        """Positions with those outside moved by whole turns into the range, where one such place lies in it."""
        turn = self.turn
        if turn is None or self.high - self.low > turn + self.slack:  # over more than a turn two places would do
            return at
        lifted = self.low + np.mod(at - self.low, turn)
        lifted = np.where(lifted - turn >= self.low - self.slack, lifted - turn, lifted)
        return np.where(self._outside(at), lifted, at)

    def _error(self, position: float) -> ModelError:
        unit = "mm" if self.unit == "mm" else "deg"
        low, high, at = (
            f"{float(rad_to_deg(one)) if self.unit == 'rad' else one:.6g}" for one in (self.low, self.high, position)
        )
        return ModelError("E-MODEL-RANGE", self.name, name=self.name, low=low, high=high, position=at, unit=unit)


def value(component: Component, positions: ArrayLike) -> FloatArray:
    """Value of a component at positions (any shape) in its own unit; one that repeats is known everywhere.

    Raises ModelError (E-MODEL-RANGE) outside the range that was fitted: nothing is extrapolated.
    """
    at = np.asarray(positions, dtype=np.float64)
    return (_design_at(component, at.ravel()) @ component.coefficients).reshape(at.shape)


def standard_uncertainty(component: Component, positions: ArrayLike) -> FloatArray:
    """Standard uncertainty of the fitted value at positions: sqrt(g' V g), GUM.

    V holds the readings' scatter and the scatter of what the fit leaves; structure that lies between the
    targets and is not seen by them is ``residual_rms``, to be added where it matters. Raises as `value`.
    """
    at = np.asarray(positions, dtype=np.float64)
    g = _design_at(component, at.ravel())
    variance = np.einsum("ij,jk,ik->i", g, component.covariance, g)
    return np.sqrt(np.maximum(variance, 0.0)).reshape(at.shape)


def near_value(component: Component, positions: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Value and standard uncertainty at positions (any shape), up to `NEAR` of the range beyond its ends.

    Set-ups of one axis have targets of their own, so one begins a little before the other. There the value of the end
    is taken, and what the curve may change by on the way, at its steepest, is uncertainty: an estimate that says so.
    Raises ModelError (E-MODEL-RANGE) further away.
    """
    known = KnownRange.of(component)
    at = np.asarray(positions, dtype=np.float64)
    if known.period is not None:
        return value(component, at), standard_uncertainty(component, at)
    inside = np.clip(known.reduced(at), known.low, known.high)
    beyond = np.abs(known.reduced(at) - inside)
    if np.any(beyond > NEAR * (known.high - known.low)):
        known.inside(at[beyond > NEAR * (known.high - known.low)])
    dense = np.linspace(known.low, known.high, 401)
    steepest = float(np.max(np.abs(np.gradient(value(component, dense), dense))))
    return value(component, inside), np.hypot(standard_uncertainty(component, inside), steepest * beyond)


def estimated_beyond(component: Component, positions: ArrayLike) -> tuple[KnownRange, float] | None:
    """Known range, and which of the positions lies furthest beyond it, where `near_value` has an estimate alone.

    None where all positions are known. Raises as `near_value`.
    """
    known = KnownRange.of(component)
    at = known.reduced(np.atleast_1d(np.asarray(positions, dtype=np.float64)))
    beyond = np.maximum(known.low - at, at - known.high)
    if known.period is not None or not at.size or float(beyond.max()) <= known.slack:
        return None
    near_value(component, positions)
    return known, float(at[int(np.argmax(beyond))])


def motion_uncertainty(component: Component, positions: ArrayLike) -> FloatArray:
    """Standard uncertainty of the error motion itself at positions: of the fit, and of what it does not follow.

    A constant through readings that change by much is well known as a constant, and says little of any one place.
    """
    return np.hypot(standard_uncertainty(component, positions), component.residual_rms)


def at_datum(component: Component, reference: float) -> Component:
    """The component with its value at the reference taken off everywhere; its uncertainty is zero there.

    The offset of a positioning deviation is the machine zero and no error motion. Raises as `value`.
    """
    g = _design_at(component, np.asarray([reference]))[0]
    ones = _one_everywhere(component, g.size)
    shift = np.eye(g.size) - np.outer(ones, g)
    return replace(
        component,
        coefficients=shift @ component.coefficients,
        covariance=shift @ component.covariance @ shift.T,
    )


def _one_everywhere(component: Component, size: int) -> FloatArray:
    """Hats and splines add up to one everywhere; the other bases carry their constant in the first term."""
    waves = 2 * len(component.parameters.get("lengths", ()))  # type: ignore[arg-type]
    if component.parameters.get("smooth", component.basis) in ("piecewise", "cubic", "bspline"):
        return np.append(np.ones(size - waves), np.zeros(waves))
    return np.asarray(np.eye(size)[0])


def without_waves(component: Component) -> Component:
    """The component without its short waves; itself where it has none."""
    turns = component.basis == "fourier"
    orders = component.parameters.get("orders", ()) if turns else ()
    short = [n > LONGEST_WAVE for n in orders]  # type: ignore[attr-defined]
    if not any(short) and component.basis != "waved":
        return component
    kept = component.coefficients.copy()
    if turns:
        kept[1:][np.repeat(short, 2)] = 0.0
    else:
        kept[-2 * len(component.parameters["lengths"]) :] = 0.0  # type: ignore[arg-type]
    return replace(component, coefficients=kept)


def is_periodic(component: Component) -> bool:
    """Whether the component repeats (a full turn of a rotary axis)."""
    return component.parameters.get("period") is not None


def design(basis: str, parameters: Parameters, positions: FloatArray) -> FloatArray:
    """Basis functions (points, coefficients) at positions inside the domain, which is not checked here.

    Raises ModelError (E-MODEL-BASIS) for an unknown name.
    """
    if basis not in _BASES:
        raise ModelError("E-MODEL-BASIS", "model", basis=basis, known=", ".join(_BASES))
    return _BASES[basis](parameters, positions)


def _design_at(component: Component, positions: FloatArray) -> FloatArray:
    return design(component.basis, component.parameters, KnownRange.of(component).inside(positions))


def _constant(_parameters: Parameters, positions: FloatArray) -> FloatArray:
    return np.ones((positions.size, 1))


def _polynomial(parameters: Parameters, positions: FloatArray) -> FloatArray:
    scaled = (positions - parameters["centre"]) / parameters["scale"]
    return np.vander(scaled, int(parameters["degree"]) + 1, increasing=True)


def _fourier(parameters: Parameters, positions: FloatArray) -> FloatArray:
    turn = 2.0 * np.pi * positions / parameters["period"]
    columns = [np.ones_like(turn)]
    for order in parameters["orders"]:
        columns += [np.cos(order * turn), np.sin(order * turn)]
    return np.stack(columns, axis=1)


def _bspline(parameters: Parameters, positions: FloatArray) -> FloatArray:
    knots = np.asarray(parameters["knots"], dtype=np.float64)
    return np.asarray(scipy.interpolate.BSpline.design_matrix(positions, knots, 3, extrapolate=True).toarray())


def _piecewise(parameters: Parameters, positions: FloatArray) -> FloatArray:
    nodes = np.asarray(parameters["nodes"], dtype=np.float64)
    period = parameters.get("period")
    return hats(nodes, positions, held=False) if period is None else periodic_hats(nodes, float(period), positions)


def _cubic(parameters: Parameters, positions: FloatArray) -> FloatArray:
    return cardinal(np.asarray(parameters["nodes"], dtype=np.float64), positions)


def _smooth_with_waves(parameters: Parameters, positions: FloatArray) -> FloatArray:
    """A smooth basis, then cosine and sine of each wave."""
    phases = [2.0 * np.pi * positions / length for length in parameters["lengths"]]
    waves = [one for phase in phases for one in (np.cos(phase), np.sin(phase))]
    return np.column_stack([_BASES[parameters["smooth"]](parameters, positions), *waves])


_BASES: Mapping[str, Callable[[Parameters, FloatArray], FloatArray]] = {
    "constant": _constant,
    "polynomial": _polynomial,
    "fourier": _fourier,
    "bspline": _bspline,
    "piecewise": _piecewise,
    "cubic": _cubic,
    "waved": _smooth_with_waves,
}


def hats(nodes: FloatArray, positions: FloatArray, *, held: bool = True) -> FloatArray:
    """Hat functions (points, nodes) of ascending nodes; outside, end values hold or the last lines go on."""
    found = np.zeros((positions.size, nodes.size))
    rows = np.arange(positions.size)
    if nodes.size == 1:
        found[:, 0] = 1.0
        return found
    left = np.clip(np.searchsorted(nodes, positions, side="right") - 1, 0, nodes.size - 2)
    share = (positions - nodes[left]) / (nodes[left + 1] - nodes[left])
    share = np.clip(share, 0.0, 1.0) if held else share
    found[rows, left] = 1.0 - share
    found[rows, left + 1] = share
    return found


def periodic_hats(nodes: FloatArray, period: float, positions: FloatArray) -> FloatArray:
    """Hat functions (points, nodes) that repeat after `period`; ascending nodes within one period."""
    wrapped = nodes[0] + np.mod(positions - nodes[0], period)
    closed = hats(np.append(nodes, nodes[0] + period), wrapped)
    found = closed[:, :-1].copy()
    found[:, 0] += closed[:, -1]
    return found


# ---- Takes out of a fitted motion what belongs to set-up or location: line, mean, the wave of an eccentric artefact.
#
# Means and waves are those of the axis' own travel: the whole turn of a motion that repeats, else the range measured.

DENSE = 720


def without_line(component: Component, positions: ArrayLike) -> Component:
    """The component less the least-squares line through its values at positions (m,), mm; nothing is known of a line.

    Straightness has no slope of its own: it is the mounting's, or a squareness error.
    """
    x = np.asarray(positions, dtype=np.float64)
    return _less(component, x, np.column_stack([np.ones_like(x), x - x.mean()]))


def without_mean(component: Component) -> Component:
    """A component of a turning axis less its mean over the axis' travel: that is a location error."""
    x = travel(component)
    return _less(component, x, np.ones((DENSE, 1)))


def travel(component: Component) -> FloatArray:
    """Places (720,) evenly over the travel: the turn of a component that repeats, else the range that was measured."""
    if is_periodic(component):
        return np.arange(DENSE) * TURN_DEG / DENSE
    return np.linspace(*component.domain, DENSE)


def _less(component: Component, x: FloatArray, shapes: FloatArray) -> Component:
    """The component less its projection on shapes (m, s) at positions x (m,); they must lie in its basis."""
    columns = design(component.basis, component.parameters, x)
    rest = columns - shapes @ np.linalg.lstsq(shapes, columns, rcond=None)[0]
    keep = np.linalg.lstsq(columns, rest, rcond=None)[0]
    covariance = keep @ component.covariance @ keep.T
    return replace(component, coefficients=keep @ component.coefficients, covariance=covariance)


def mean_of(component: Component) -> tuple[float, float]:
    """Mean over the axis' travel and its standard uncertainty."""
    g = design(component.basis, component.parameters, travel(component)).mean(axis=0)
    return float(g @ component.coefficients), float(np.sqrt(max(g @ component.covariance @ g, 0.0)))


@dataclass(frozen=True, slots=True)
class Wave:
    """a cos(q) + b sin(q)."""

    a: float
    b: float

    def __call__(self, positions_deg: FloatArray) -> FloatArray:
        """Values at positions, same shape."""
        q = np.deg2rad(positions_deg)
        return np.asarray(self.a * np.cos(q) + self.b * np.sin(q))


def first_harmonic(component: Component) -> Wave:
    """The once-per-turn part: over a part of a turn that of the least-squares wave with a constant."""
    x = travel(component)
    values, q = value(component, x), np.deg2rad(x)
    found = np.linalg.lstsq(np.column_stack([np.ones_like(q), np.cos(q), np.sin(q)]), values, rcond=None)[0]
    return Wave(float(found[1]), float(found[2]))


def in_phase(first: Wave, second: Wave) -> tuple[Wave, Wave]:
    """What an eccentric artefact makes of a pair of cross directions (X and Y, or A and B): u, v turning with the axis.

    first = u cos q - v sin q, second = u sin q + v cos q. The counter-rotating rest is error motion and stays.
    """
    u, v = (first.a + second.b) / 2.0, (second.a - first.b) / 2.0
    return Wave(u, -v), Wave(v, u)


# ---- The curve that bends least through values at places: natural cubic splines, as sums over their nodes.

FEWEST = 6
"""Nodes that carry a curve; fewer carry straight lines."""
CLOSE = 0.1
"""Nodes closer than this share of a gap beside them are one: their scatter is a slope that swings over the gap."""


def separate_nodes(places: FloatArray) -> FloatArray:
    """Nodes for places of any order, ascending: those too close together are one in their middle; both ends stay."""
    nodes, counts = np.unique(np.round(places, 6), return_counts=True)
    while nodes.size > 2:
        gaps = np.diff(nodes)
        beside = np.maximum(np.append(gaps[1:], 0.0), np.append(0.0, gaps[:-1]))
        i = int(np.argmin(gaps / beside))
        if gaps[i] >= CLOSE * beside[i]:
            break
        middle = (nodes[i] * counts[i] + nodes[i + 1] * counts[i + 1]) / (counts[i] + counts[i + 1])
        one = nodes[0] if i == 0 else nodes[-1] if i == gaps.size - 1 else middle
        counts = np.concatenate([counts[:i], [counts[i] + counts[i + 1]], counts[i + 2 :]])
        nodes = np.concatenate([nodes[:i], [one], nodes[i + 2 :]])
    return nodes


def cardinal(nodes: FloatArray, positions: FloatArray) -> FloatArray:
    """What each node's value adds at positions within them: (points, nodes), each row's sum 1; nodes ascend."""
    return np.asarray(scipy.interpolate.CubicSpline(nodes, np.eye(nodes.size), bc_type="natural")(positions))


def leave_one_out_rows(nodes: FloatArray) -> FloatArray:
    """Rows (nodes - 2, nodes): each inner value less the curve through all others.

    What a curve bends, the integral of its second derivative squared, is y' K y in the values y at its nodes (Green and
    Silverman 1994, section 2.1). The others' curve goes where that is least, so a value misses it by (K y)_k / K_kk.
    """
    h, inner = np.diff(nodes), np.arange(nodes.size - 2)
    q = np.zeros((nodes.size, nodes.size - 2))
    q[inner, inner], q[inner + 1, inner], q[inner + 2, inner] = 1.0 / h[:-1], -1.0 / h[:-1] - 1.0 / h[1:], 1.0 / h[1:]
    beside = np.diag(h[1:-1] / 6.0, 1)
    r = np.diag((h[:-1] + h[1:]) / 3.0) + beside + beside.T
    bent = q @ np.linalg.solve(r, q.T)
    return np.asarray((bent / np.diag(bent)[:, None])[1:-1])
