"""Compensation tables: buffered memory, curves, cylinder error calculation, and the path of the additional setpoint.

K3 (Extended Functions, 03/2013 pp. 236-249): k = (MAX - MIN)/STEP, points above k are ignored, MAX is
shortened when memory ends before k; linear between points; the end values hold outside unless modulo. All pure.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulators.nck.spec import NckRefusal

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


def shift_curve(curve: Curve | None, offset: float) -> Curve | None:
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


# Cylinder error calculation of CEC tables of TYPE 1: two measured errors give SD41320 and SD41321. The setting data
# and what happens to them are in the vendor's lists; the formula is not. Here: the straight line through the two
# measured errors, read at the table's first and second point.


@dataclass(frozen=True, slots=True)
class CylinderErrors:
    """Distances in the base axis (CEC_BAS_0/1) and the errors found there (CEC_COMP_0/1)."""

    base_0: float
    base_1: float
    error_0: float
    error_1: float


def cylinder_end_values(measured: CylinderErrors, minimum: float, step: float) -> tuple[float, float]:
    """What SD41320 and SD41321 become; one distance for both points gives their mean error."""
    span = measured.base_1 - measured.base_0
    if span == 0.0:
        mean = (measured.error_0 + measured.error_1) / 2.0
        return mean, mean
    slope = (measured.error_1 - measured.error_0) / span
    first = measured.error_0 + slope * (minimum - measured.base_0)
    return first, first + slope * step


# Buffered memory contains what was written, whether it acts or not.


@dataclass(slots=True)
class EecTable:
    """``$AA_ENC_COMP`` of one axis and encoder."""

    points: list[float]
    minimum: float = 0.0
    maximum: float = 0.0
    step: float = 0.0
    is_modulo: bool = False

    def curve(self, uneven: str, unit: float = 1.0) -> Curve | None:
        """The curve these values mean; ``unit``: mm or deg in one of its units; ``uneven``: see `TableShape`."""
        return curve_of(self.points, shape_of(self, uneven), unit=unit, value_unit=unit)

    def convert(self, factor: float) -> None:
        """Change to another system of units."""
        self.points = [value * factor for value in self.points]
        self.minimum, self.maximum, self.step = (value * factor for value in (self.minimum, self.maximum, self.step))


@dataclass(slots=True)
class CecTable:
    """``$AN_CEC`` of one table; axes by machine name, empty when never set."""

    points: list[float]
    minimum: float = 0.0
    maximum: float = 0.0
    step: float = 0.0
    is_modulo: bool = False
    input_axis: str = ""
    output_axis: str = ""
    input_ncu: int = 1
    output_ncu: int = 1
    direction: int = 0
    mult_by_table: int = 0
    kind: int = 0

    def curve(
        self, ends: tuple[float, float] = (0.0, 0.0), unit: float = 1.0, value_unit: float = 1.0, uneven: str = "floor"
    ) -> Curve | None:
        """The curve these values mean; for TYPE 1 the two setting data ``ends`` are added to points 0 and 1."""
        points = list(self.points)
        if self.kind == 1:
            for place, extra in enumerate(ends[: len(points)]):
                points[place] += extra
        return curve_of(points, shape_of(self, uneven), unit=unit, value_unit=value_unit)


Table = EecTable | CecTable


def shape_of(table: Table, uneven: str) -> TableShape:
    """The grid of a table as the control takes it."""
    return TableShape(table.minimum, table.maximum, step=table.step, is_modulo=table.is_modulo, uneven=uneven)


@dataclass(slots=True)
class TableMemory:
    """All tables of the control: EEC by (axis index, encoder), CEC by table number.

    ``late``: writes that have been taken but do not show yet, each with the time from which it does.
    """

    eec: dict[tuple[int, int], EecTable] = field(default_factory=dict)
    cec: list[CecTable] = field(default_factory=list)
    single_precision: bool = False
    late: list[tuple[float, Callable[[], None]]] = field(default_factory=list)

    @classmethod
    def empty(
        cls, eec_points: dict[tuple[int, int], int], cec_points: list[int], single_precision: bool
    ) -> TableMemory:
        """Fresh memory, every point zero."""
        eec = {key: EecTable([0.0] * count) for key, count in eec_points.items()}
        return cls(eec, [CecTable([0.0] * count) for count in cec_points], single_precision)

    def copied(self) -> TableMemory:
        """The content as it stands."""
        return TableMemory(copy.deepcopy(self.eec), copy.deepcopy(self.cec), self.single_precision)

    def settle(self, now_s: float) -> None:
        """Let the writes show whose time has come."""
        if self.late:
            due = [write for time_s, write in self.late if time_s <= now_s]
            self.late = [entry for entry in self.late if entry[0] > now_s]
            for write in due:
                write()

    def convert(self, factor: float, rotary: list[bool]) -> None:
        """EEC tables of linear axes to another system of units (MD10260); CEC has MD32711 instead."""
        for (axis, _), table in self.eec.items():
            if not rotary[axis]:
                table.convert(factor)

    def shorten(self, uneven: str) -> None:
        """Put MAX of every table back to where its memory ends."""
        tables: list[Table] = [*self.eec.values(), *self.cec]
        for table in tables:
            last = shape_of(table, uneven).last_point(len(table.points))
            if last is not None and table.maximum > table.minimum + table.step * (last + 1 - 1e-9):
                table.maximum = table.minimum + table.step * last

    def saved(self) -> dict[str, Any]:
        """The content as plain values, for static memory."""
        eec = [[*key, asdict(table)] for key, table in self.eec.items()]
        return {"eec": eec, "cec": [asdict(table) for table in self.cec]}

    def restore(self, content: dict[str, Any]) -> None:
        """Take what `saved` gave."""
        self.eec = {(axis, encoder): EecTable(**table) for axis, encoder, table in content["eec"]}
        self.cec = [CecTable(**table) for table in content["cec"]]

    def kept(self, value: float) -> float:
        """A value as the memory keeps it."""
        return float(np.float32(value)) if self.single_precision else value

    def cec_table(self, number: int) -> CecTable:
        """A CEC table. Raises NckRefusal 17020 when there is none of that number."""
        if not 0 <= number < len(self.cec):
            raise NckRefusal(17020, f"illegal array index 1: table {number} of {len(self.cec)}")
        return self.cec[number]

    @staticmethod
    def place(points: list[float], number: int) -> int:
        """Check a point's number against the reserved memory. Raises NckRefusal 17030."""
        if not 0 <= number < len(points):
            raise NckRefusal(17030, f"illegal array index 2: point {number} of {len(points)} reserved")
        return number
