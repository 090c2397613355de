"""A measured result file -> compensation tables: datum, directions, grid, zero at the reference.

A result file knows its own zero only; where that is on the machine must be said. An axis table takes the mean of both
directions; a cross pair takes each direction by itself. Values are deviations d = measured - target (sign convention).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from drivers.errors import ConfigError, Gap
from drivers.limits import VALUE_RESOLUTION, Limits
from drivers.message import digits
from drivers.terms import TableKind
from drivers.types.results import MeasuredSet
from drivers.types.tables import CompensationTable
from drivers.units import AxisUnit, DeviationUnit, deviation_scale, deviation_unit
from gateway.domain.proposals import TableFinding
from gateway.domain.values import FloatArray
from gateway.errors import InDoubt
from gateway.table.limits import check, check_reach, second_person_finding
from gateway.table.merging import Grid, project, round_to_resolution, zero_at_reference

TURN_DEG = 360.0
WIDEST_BRIDGE_DEG = 60.0
WIDEST_GAP_DEG = 180.0
EVEN = 1e-6  # mm or deg: targets this close to a grid are on it
MOST_INTERVALS = 20_000  # no control reserves more


@dataclass(frozen=True, slots=True)
class FileDatum:
    """Where a file's positions are on the machine: machine = offset + sense x file, mm or deg."""

    offset: float
    sense: Literal[1, -1] = 1


@dataclass(frozen=True, slots=True)
class TableRequest:
    """What to make: layer, axis, where its tables are zero, grid (None: from the targets), numbers.

    ``index`` is the encoder of an axis table, or the first of two numbers of cross tables.
    """

    to: TableKind
    axis: str
    reference: float
    datum: FileDatum
    minimum: float | None = None
    maximum: float | None = None
    step: float | None = None
    modulo: bool = False
    index: int = 0


@dataclass(frozen=True, slots=True)
class Curves:
    """Mean deviations at rising machine positions (m,), by machine direction: ``plus``, ``minus`` (m,) um or arcsec.

    NaN where that direction was not measured.
    """

    positions: FloatArray
    plus: FloatArray
    minus: FloatArray
    unit: AxisUnit


@dataclass(frozen=True, slots=True)
class Conversion:
    """The tables, and what their reader must know."""

    tables: tuple[CompensationTable, ...]
    findings: tuple[TableFinding, ...]


def datum_of(pairs: Sequence[tuple[float, float]]) -> FileDatum:
    """The datum that (file, machine) positions fix: one pair counts the same way, two may count against each other.

    Raises ConfigError (E-COMP-DATUM) if two pairs are not equally far apart in file and machine.
    """
    (file, machine), *more = pairs
    if not more:
        return FileDatum(machine - file)
    (other_file, other_machine) = more[0]
    apart, on_machine = other_file - file, other_machine - machine
    if len(more) > 1 or apart == 0.0 or abs(abs(apart) - abs(on_machine)) > 1e-3:
        raise ConfigError("E-COMP-DATUM", "--datum", file=digits(apart, 6), machine=digits(on_machine, 6))
    sense: Literal[1, -1] = 1 if apart * on_machine > 0 else -1
    return FileDatum(machine - sense * file, sense)


def convert(measured: MeasuredSet, request: TableRequest, limits: Limits | None = None) -> Conversion:
    """The axis table or the pair of cross tables of a result file.

    Raises InDoubt (E-COMP-DOUBT: a doubt that nobody settled), ConfigError (E-COMP-DATUM, E-COMP-NO-GRID), Gap
    (E-COMP-GRID, E-COMP-TURN, E-COMP-MISSING, E-COMP-ONE-WAY, E-COMP-REACH), ValueOutOfRange (E-COMP-VALUE,
    E-COMP-SLOPE, E-COMP-CHANGE).
    """
    found = curves(measured, request.datum, modulo=request.modulo)
    grid = _grid(found, request)
    kinds = _kinds(found, request)
    tables = tuple(_table(found, kind, grid, request) for kind in kinds)
    allowed = limits or Limits.of(found.unit)
    findings = list(_coverage(found, grid, request))
    for table in tables:
        nothing = replace(table, deviations=(0.0,) * len(table.deviations))
        findings += check(table, nothing, allowed, request.axis)
    findings += _remarks(found, request)
    return Conversion(tables, tuple(findings))


def curves(measured: MeasuredSet, datum: FileDatum, *, modulo: bool) -> Curves:
    """Means over the repetitions, on the machine's own scale and in its own directions.

    Where the file counts against the machine, deviations change sign and the directions change places.
    Raises Gap (E-COMP-MISSING) if a direction lacks a target that it has readings around, InDoubt (E-COMP-DOUBT) if the
    record has a doubt that nobody settled.
    """
    if any(one.blocking for one in measured.doubts):
        codes = ", ".join(one.code for one in measured.doubts if one.blocking)
        raise InDoubt("E-COMP-DOUBT", "file", codes=codes)
    up, down = _mean(measured, 0), _mean(measured, 1)
    plus, minus = (up, down) if datum.sense == 1 else (-down, -up)
    positions = datum.offset + datum.sense * measured.targets
    if modulo:
        positions = np.mod(np.round(positions, 9), TURN_DEG)
    order = np.argsort(positions, kind="stable")
    at, places = np.unique(np.round(positions[order], 9), return_inverse=True)
    return Curves(
        at, _mean_of_positions(plus[order], places), _mean_of_positions(minus[order], places), measured.axis_unit
    )


def _mean_of_positions(values: FloatArray, places: np.ndarray) -> FloatArray:
    """Readings of one position (0 and 360 deg are one) to their mean."""
    sums = np.bincount(places, weights=values)
    return np.asarray(sums / np.bincount(places))


def _mean(measured: MeasuredSet, way: int) -> FloatArray:
    """Mean over the repetitions that are there, (m,); the number of targets has no part in it."""
    readings = measured.deviations[:, :, way]
    there = ~np.isnan(readings)
    counts = there.sum(axis=1)
    if counts.any() and not counts.all():
        missing = measured.targets[int(np.argmin(counts))]
        raise Gap("E-COMP-MISSING", "file", target=digits(missing, 6), unit=measured.axis_unit, way="+-"[way])
    if not counts.any():
        return np.full(counts.shape, np.nan)
    return np.asarray(np.where(there, readings, 0.0).sum(axis=1) / counts)


def _kinds(found: Curves, request: TableRequest) -> tuple[tuple[FloatArray, Literal[-1, 0, 1]], ...]:
    one_way = bool(np.isnan(found.plus).all() or np.isnan(found.minus).all())
    if request.to == "cross":
        if one_way:
            raise Gap("E-COMP-ONE-WAY", request.axis)
        return ((found.plus, 1), (found.minus, -1))
    if one_way:
        return ((np.where(np.isnan(found.plus), found.minus, found.plus), 0),)
    return (((found.plus + found.minus) / 2.0, 0),)


def _grid(found: Curves, request: TableRequest) -> Grid:
    if request.modulo and (found.unit != "deg" or _widest_gap(found.positions) > WIDEST_GAP_DEG):
        raise Gap("E-COMP-TURN", request.axis, low=digits(found.positions[0], 6), high=digits(found.positions[-1], 6))
    even = _spacing(found.positions, modulo=request.modulo)
    step = request.step if request.step is not None else even
    if step is None:
        raise ConfigError("E-COMP-NO-GRID", request.axis, targets=found.positions.size)
    if request.modulo:
        grid = Grid(0.0, TURN_DEG, step)
    else:
        low = float(found.positions[0]) if request.minimum is None else request.minimum
        high = float(found.positions[-1]) if request.maximum is None else request.maximum
        grid = Grid(low, high, step)
    if grid.intervals > MOST_INTERVALS:
        raise Gap("E-COMP-GRID", request.axis, minimum=grid.minimum, maximum=grid.maximum, step=grid.step)
    return grid


def _widest_gap(positions: FloatArray) -> float:
    """Between neighbouring positions round the turn, deg."""
    return float(np.max(np.diff(np.append(positions, positions[0] + TURN_DEG))))


def _spacing(positions: FloatArray, *, modulo: bool) -> float | None:
    """The step of evenly spaced targets, None if they are not."""
    ends = np.append(positions, positions[0] + TURN_DEG) if modulo else positions
    gaps = np.diff(ends)
    if gaps.size == 0:
        return None
    step = round(float(ends[-1] - ends[0]) / gaps.size, 9)
    return step if step > 0 and float(np.max(np.abs(gaps - step))) <= EVEN else None


def _table(
    found: Curves, kind: tuple[FloatArray, Literal[-1, 0, 1]], grid: Grid, request: TableRequest
) -> CompensationTable:
    means, direction = kind
    period = TURN_DEG if request.modulo else None

    def curve(at: FloatArray) -> FloatArray:
        return np.asarray(np.interp(at, found.positions, means, period=period))

    values = zero_at_reference(
        project(curve, grid, modulo=request.modulo), grid, request.reference, modulo=request.modulo
    )
    return CompensationTable(
        kind=request.to,
        input_axis=request.axis,
        output_axis=request.axis,
        minimum=grid.minimum,
        maximum=grid.maximum,
        step=grid.step,
        deviations=round_to_resolution(values, VALUE_RESOLUTION * deviation_scale(found.unit)),
        modulo=request.modulo,
        index=request.index + (1 if direction == -1 else 0),
        input_unit=found.unit,
        output_unit=found.unit,
        direction=direction,
    )


def _coverage(found: Curves, grid: Grid, request: TableRequest) -> list[TableFinding]:
    if request.modulo:
        gap = _widest_gap(found.positions)
        return (
            [second_person_finding("W-COMP-BRIDGE", request.axis, gap=digits(gap, 6), unit="deg")]
            if gap > WIDEST_BRIDGE_DEG
            else []
        )
    low, high, unit = float(found.positions[0]), float(found.positions[-1]), found.unit
    # Whoever asks for a table chooses its range too, so nothing of it needs to lie beyond the targets.
    check_reach((low, high), (grid.minimum, grid.maximum), unit, request.axis, beyond=0.0)
    findings = []
    if not grid.minimum <= request.reference <= grid.maximum:
        at = f"{request.reference:g}"
        findings.append(
            second_person_finding("W-COMP-OUTSIDE", request.axis, reference=at, low=low, high=high, unit=unit)
        )
    return findings


def _remarks(found: Curves, request: TableRequest) -> list[TableFinding]:
    unit: DeviationUnit = deviation_unit(found.unit)
    findings = [second_person_finding("W-COMP-REPLACES", request.axis)]
    reversal = found.plus - found.minus
    if np.isnan(reversal).any():
        return [*findings, second_person_finding("W-COMP-ONE-WAY", request.axis)]
    if request.to == "axis":
        mean = f"{float(reversal.mean()):.3f}"
        return [*findings, second_person_finding("W-COMP-REVERSAL", request.axis, reversal=mean, unit=unit)]
    period = TURN_DEG if request.modulo else None
    there = f"{float(np.interp(request.reference, found.positions, reversal, period=period)):.3f}"
    return [
        *findings,
        second_person_finding(
            "W-COMP-REVERSAL-LEFT", request.axis, reversal=there, reference=digits(request.reference, 6), unit=unit
        ),
        second_person_finding("W-COMP-CROSS-SIGN", request.axis),
    ]


# ---- A measured result file -> an axis' own table as it was measured: free positions, a curve for each direction.
#
# For controls that take such tables. The mean of both directions is zero at the reference; the reversal stays.


def convert_as_measured(measured: MeasuredSet, axis: str, reference: float, datum: FileDatum) -> CompensationTable:
    """The table at the machine positions of the targets, um or arcsec. Raises Gap (E-COMP-MISSING, E-COMP-FREE)."""
    found = curves(measured, datum, modulo=False)
    plus = np.where(np.isnan(found.plus), found.minus, found.plus)
    minus = np.where(np.isnan(found.minus), found.plus, found.minus)
    low, high = float(found.positions[0]), float(found.positions[-1])
    if found.positions.size < 2 or not low <= reference <= high:
        raise Gap("E-COMP-FREE", axis, reference=digits(reference, 6), low=digits(low, 6), high=digits(high, 6))
    zero = float(np.interp(reference, found.positions, (plus + minus) / 2.0))
    resolution = VALUE_RESOLUTION * deviation_scale(found.unit)
    forward, reverse = (round_to_resolution(one - zero, resolution) for one in (plus, minus))
    return CompensationTable(
        kind="axis",
        input_axis=axis,
        output_axis=axis,
        minimum=low,
        maximum=high,
        step=0.0,
        deviations=forward,
        input_unit=found.unit,
        output_unit=found.unit,
        places=tuple(float(one) for one in found.positions),
        reverse=() if forward == reverse else reverse,
    )
