"""Compensation curves and the path of the additional setpoint: pure, from the vendor's manual alone.

K3 (Extended Functions, 03/2013 pp. 236-249): k = (MAX - MIN)/STEP, points above k are ignored, MAX is
shortened when memory ends before k; linear between points; the end values hold outside unless modulo.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SUBDIVISIONS = 64
_MOST_NODES = 50_000
_EVEN = 1e-9


@dataclass(frozen=True, slots=True)
class Curve:
    """A table as it acts: nodes and values of equal length; period > 0 for a modulo axis."""

    nodes: Array
    values: Array
    step: float
    period: float

    def at(self, positions: Array) -> Array:
        """Value at each position (same unit as the table's)."""
        if self.period > 0.0:
            positions = self.nodes[0] + np.mod(positions - self.nodes[0], self.period)
        return np.interp(positions, self.nodes, self.values)

    def one(self, position: float) -> float:
        """Value at one position."""
        return float(self.at(np.array([position]))[0])


@dataclass(frozen=True, slots=True)
class TableShape:
    """A table's parameters; ``uneven`` is how a step that does not divide the range is taken (`Switches`)."""

    minimum: float
    maximum: float
    step: float
    is_modulo: bool = False
    uneven: str = "floor"

    @property
    def is_uneven(self) -> bool:
        """Whether the step leaves a rest."""
        intervals = (self.maximum - self.minimum) / self.step
        return abs(intervals - round(intervals)) > _EVEN

    def last_point(self, count: int) -> int | None:
        """Number of the last point, in a memory of ``count``; None when the parameters describe none."""
        span = self.maximum - self.minimum
        if count < 1 or self.step <= 0.0 or span < 0.0 or not math.isfinite(span / self.step):
            return None
        if self.uneven == "idle" and self.is_uneven:
            return None
        up = self.uneven == "ceil" and self.is_uneven
        return min(math.floor(span / self.step + _EVEN) + up, count - 1)

    def nodes(self, last: int) -> Array:
        """Where the points 0 .. last stand."""
        nodes = self.minimum + self.step * np.arange(last + 1, dtype=np.float64)
        if self.uneven == "stretched" and self.is_uneven and self.maximum - nodes[-1] < self.step:
            nodes[-1] = self.maximum
        return nodes


def curve_of(points: Sequence[float], shape: TableShape, *, unit: float = 1.0, value_unit: float = 1.0) -> Curve | None:
    """The curve a table's memory means; None when its parameters describe none.

    ``unit`` and ``value_unit``: mm or deg in one unit of its positions and of its values.
    """
    last = shape.last_point(len(points))
    if last is None:
        return None
    span = shape.maximum - shape.minimum
    period = span * unit if shape.is_modulo and span > 0.0 else 0.0
    values = np.nan_to_num(np.array(points[: last + 1], dtype=np.float64), nan=0.0)
    return Curve(shape.nodes(last) * unit, values * value_unit, shape.step * unit, period)


def shifted(curve: Curve | None, offset: float) -> Curve | None:
    """The curve with a constant added; no curve counts as zero."""
    if offset == 0.0:
        return curve
    if curve is None:
        return Curve(np.zeros(1), np.array([offset]), 1.0, 0.0)
    return replace(curve, values=curve.values + offset)


@dataclass(frozen=True, slots=True)
class CrossTable:
    """A CEC table as it acts: axes by index, weight SD41310, direction of base travel it is for (0 both)."""

    curve: Curve
    input_axis: int
    output_axis: int
    weight: float
    direction: int
    factor: int | None


@dataclass(frozen=True, slots=True)
class Stretch:
    """A piece of a base axis's way: from ``start_s`` at ``position`` with ``slope`` per s.

    ``direction`` +1 or -1, 0 for neither.
    """

    start_s: float
    position: float
    slope: float
    direction: int

    def at(self, times: Array) -> Array:
        """Positions at those times."""
        return self.position + self.slope * (times - self.start_s)


def cross_sum(
    tables: Mapping[int, CrossTable],
    output_axis: int,
    inputs: Mapping[int, tuple[Array, int]],
    factors_count: bool,
) -> Array:
    """Sum of all tables for one output axis; ``inputs``: axis -> positions and travel direction."""
    own = {number: _own(table, inputs) for number, table in tables.items()}
    factors = {table.factor for table in tables.values() if table.factor is not None}
    total = np.zeros_like(next(iter(inputs.values()))[0])
    for number, table in tables.items():
        if table.output_axis != output_axis:
            continue
        if table.factor is not None:
            total = total + own[number] * own.get(table.factor, 0.0)
        if factors_count or (table.factor is None and number not in factors):
            total = total + own[number]
    return total


def _own(table: CrossTable, inputs: Mapping[int, tuple[Array, int]]) -> Array:
    positions, direction = inputs[table.input_axis]
    if table.direction not in (0, direction):
        return np.zeros_like(positions)
    return table.weight * table.curve.at(positions)


def cross_path(
    tables: Mapping[int, CrossTable],
    output_axis: int,
    ways: Mapping[int, Sequence[Stretch]],
    factors_count: bool,
) -> tuple[Array, Array]:
    """The sum over time along the base axes' ways: break times and values; a time twice is a jump."""
    starts = sorted({stretch.start_s for way in ways.values() for stretch in way})
    times: list[Array] = []
    values: list[Array] = []
    for place, begin in enumerate(starts):
        end = starts[place + 1] if place + 1 < len(starts) else begin
        now = {axis: _current(way, begin) for axis, way in ways.items()}
        inner = _break_times(tables, now, begin, end)
        inputs = {axis: (stretch.at(inner), stretch.direction) for axis, stretch in now.items()}
        times.append(inner)
        values.append(cross_sum(tables, output_axis, inputs, factors_count))
    return np.concatenate(times), np.concatenate(values)


def _current(way: Sequence[Stretch], time_s: float) -> Stretch:
    return max((stretch for stretch in way if stretch.start_s <= time_s), key=lambda s: s.start_s)


def _break_times(tables: Mapping[int, CrossTable], now: Mapping[int, Stretch], begin: float, end: float) -> Array:
    """The times at which a sum changes slope: the passing of table points, finely divided for products."""
    if end <= begin:
        return np.array([begin])
    found = [np.array([begin, end])]
    for table in tables.values():
        stretch = now[table.input_axis]
        if stretch.slope != 0.0:
            found.append(_passing_times(table.curve, stretch, begin, end))
        if table.factor is not None:
            found.append(np.linspace(begin, end, _SUBDIVISIONS))
    return np.unique(np.concatenate(found))


def _passing_times(curve: Curve, stretch: Stretch, begin: float, end: float) -> Array:
    ends = stretch.at(np.array([begin, end]))
    low, high = sorted(ends)
    if curve.period <= 0.0:
        nodes = curve.nodes[(curve.nodes >= low) & (curve.nodes <= high)]
    else:
        first, last = math.ceil((low - curve.nodes[0]) / curve.step), math.floor((high - curve.nodes[0]) / curve.step)
        stride = max(1, (last - first) // _MOST_NODES)
        nodes = curve.nodes[0] + curve.step * np.arange(first, last + 1, stride, dtype=np.float64)
    times = stretch.start_s + (nodes - stretch.position) / stretch.slope
    return times[(times > begin) & (times < end)]


def follow(
    times: Array, values: Array, current: float, limit: float, step_limit: float
) -> tuple[list[tuple[float, float, float]], bool]:
    """Follow a path with a limited rate and make up later what was missed (MD32730, MD32760).

    Returns pieces (start, value, slope) and whether the limit acted. A jump of up to ``step_limit`` is one.
    """
    steps = np.diff(values)
    spans = np.diff(times)
    slopes = np.divide(steps, spans, out=np.zeros_like(steps), where=spans > 0.0)
    jumps = np.abs(np.concatenate([[values[0] - current], steps[spans <= 0.0]]))
    if np.all(np.abs(slopes) <= limit) and np.all(jumps <= step_limit):
        pieces = list(zip(times.tolist(), values.tolist(), [*slopes.tolist(), 0.0], strict=True))
        return pieces, False
    return _chase(times, values, slopes, current, limit), True


def _chase(
    times: Array, values: Array, slopes: Array, current: float, limit: float
) -> list[tuple[float, float, float]]:
    pieces: list[tuple[float, float, float]] = []
    last = len(times) - 1
    for place in range(last + 1):
        begin, target = float(times[place]), float(values[place])
        slope = float(slopes[place]) if place < last else 0.0
        end = float(times[place + 1]) if place < last else math.inf
        while begin < end:
            speed, meeting = _pursuit(current, target, slope, limit)
            pieces.append((begin, current, speed))
            until = min(end, begin + meeting)
            if math.isinf(until):
                break
            span = until - begin
            target += slope * span
            current = target if until < end else current + speed * span
            begin = until
    return pieces


def _pursuit(current: float, target: float, slope: float, limit: float) -> tuple[float, float]:
    """Speed towards a moving target and the time until it is met (inf: never, or already with it)."""
    gap = target - current
    if abs(gap) < 1e-12:
        return (slope, math.inf) if abs(slope) <= limit else (math.copysign(limit, slope), math.inf)
    towards = math.copysign(1.0, gap)
    closing = limit - slope * towards
    return limit * towards, abs(gap) / closing if closing > 0.0 else math.inf
