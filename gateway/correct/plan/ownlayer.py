"""The first layer: axis tables that take each axis' own deviation (mean of both directions), as corrections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.message import Message, digits
from drivers.types.tables import CompensationTable
from drivers.types.values import FloatArray
from drivers.units import DeviationUnit, deviation_unit
from gateway.correct.flank.tables import Table
from gateway.correct.plan.plan import Plan, live_table, table_spec
from gateway.correct.plan.records import axis_unit, in_deviation_unit
from gateway.model.axis import MOTIONS
from gateway.model.chain import Chain
from gateway.model.motion import travel_of
from gateway.table import Grid, project
from gateway.table.limits import check_reach, reason

SAMPLES = 181
EDGE = 1e-3  # mm: positions are rounded by so much
QUIET = 1e-12  # mm or rad: an axis without a deviation of its own gets no table


@dataclass(frozen=True)
class AxisCurve:
    """An axis' own deviation at positions ``at`` (m,) in its unit; um or arcsec, each curve zero at the reference.

    ``before`` as it is, ``own_layer`` with axis tables, ``predicted`` with these and the tooth's tables.
    """

    axis: str
    unit: DeviationUnit
    at: FloatArray
    before: FloatArray
    own_layer: FloatArray
    predicted: FloatArray


def own_deviation(chain: Chain, axis: str, at: FloatArray) -> FloatArray:
    """An axis' positioning deviation (mm or rad) at positions (mm or rad), same shape: EXX, EZZ, ECC."""
    one, total = chain.axis(axis), np.zeros(np.shape(at))
    for key, share in _own_keys(chain, axis):
        total = total + share * one.value(key, at)
    return np.asarray(total)


def known_travel(chain: Chain, axis: str, low: float, high: float) -> tuple[float, float]:
    """What of a travel (mm or rad) an axis' own deviation is known over. Raises ModelError (E-MODEL-RANGE): nothing."""
    one = chain.axis(axis)
    for key, _ in _own_keys(chain, axis):
        low, high = travel_of(one.err.get(key, 0.0), low, high)
    return low, high


def _own_keys(chain: Chain, axis: str) -> list[tuple[str, float]]:
    """The error motions along or about the axis itself, each with its share."""
    one = chain.axis(axis)
    keys = MOTIONS[:3] if one.kind == "prismatic" else MOTIONS[3:]
    return [(key, float(share)) for key, share in zip(keys, one.vector, strict=True) if share != 0.0]


def own_layer(chain: Chain, plan: Plan, live: Sequence[CompensationTable] = ()) -> tuple[Table, ...]:
    """Each axis' own table: what acted plus the deviation measured with it, zero at the reference, in whole steps.

    What the tooth's table of the axis over itself added while the errors were measured is no deviation of the axis.
    """
    tables = (_own_table(chain, axis, plan, live) for axis in plan.own if plan.has(axis))
    return tuple(table for table in tables if table is not None)


def tooth_table(chain: Chain, axis: str, live: Sequence[CompensationTable]) -> Table | None:
    """The tooth's table of an axis over itself that acted, if any."""
    return live_table(chain, axis, axis, [one for one in live if one.kind == "cross"])


def _own_table(chain: Chain, axis: str, plan: Plan, live: Sequence[CompensationTable]) -> Table | None:
    spec = table_spec(chain, plan, axis, axis)
    acting = live_table(chain, axis, axis, [one for one in live if one.kind == "axis"])
    tooth = tooth_table(chain, axis, live)
    nodes, k = spec.grid.nodes, spec.grid.nodes.size - 1
    low, high = _covered(chain, axis, plan)

    def wanted(place: FloatArray) -> FloatArray:
        at = nodes[0] + place * (nodes[-1] - nodes[0]) / k
        added = sum((one(at) for one in (acting, tooth) if one is not None), start=np.zeros_like(at))
        # Beyond what is known a table holds its last value, as a control does: `held_tables` says where.
        inside = at if plan.grid(axis).modulo else np.clip(at, low, high)
        return np.asarray(added - own_deviation(chain, axis, inside))

    table = Table(spec.grid, project(wanted, Grid(0.0, float(k), 1.0), modulo=plan.grid(axis).modulo))
    values = table.values - table(np.asarray(spec.reference))
    if float(np.max(np.abs(values))) <= QUIET:
        return None
    whole = np.rint(values / spec.resolution) * spec.resolution
    return Table(spec.grid, whole) if np.any(whole) or acting is not None else None


def _covered(chain: Chain, axis: str, plan: Plan) -> tuple[float, float]:
    """What of an axis' table is known (mm or rad). Raises Gap (E-COMP-REACH) as `check_reach`."""
    nodes = table_spec(chain, plan, axis, axis).grid.nodes
    low, high = known_travel(chain, axis, float(nodes[0]), float(nodes[-1]))
    grid = plan.grid(axis)
    if chain.axis(axis).kind == "prismatic":
        check_reach((low, high), (grid.minimum, grid.maximum), "mm", axis)
    return low, high


def held_tables(chain: Chain, plan: Plan) -> tuple[Message, ...]:
    """Where axis tables reach beyond what is known of their axis, in words."""
    found = []
    for axis in plan.own:
        if not plan.has(axis) or chain.axis(axis).kind != "prismatic":
            continue
        grid, (low, high) = plan.grid(axis), _covered(chain, axis, plan)
        if low > grid.minimum + EDGE or high < grid.maximum - EDGE:
            ends = {"minimum": digits(grid.minimum, 6), "maximum": digits(grid.maximum, 6)}
            ends |= {"low": digits(low, 6), "high": digits(high, 6)}
            found.append(reason("W-COMP-FLAT", axis, unit="mm", **ends))
    return tuple(found)


def axis_curve(chain: Chain, axis: str, plan: Plan, own: Sequence[Table], tooth: Sequence[Table]) -> AxisCurve:
    """An axis before and after, over what of its table is known; zero at the reference or the place nearest to it.

    ``own`` and ``tooth`` are what the two layers add to what acted.
    """
    spec = table_spec(chain, plan, axis, axis)
    low, high = known_travel(chain, axis, float(spec.grid.nodes[0]), float(spec.grid.nodes[-1]))
    at = np.linspace(low, high, SAMPLES)
    turning = chain.axis(axis).kind == "revolute"
    reference = spec.reference or 0.0
    zero = np.asarray(reference if turning else min(max(reference, low), high))

    def added(tables: Sequence[Table]) -> FloatArray:
        mine = [table for table in tables if (table.grid.out, table.grid.over) == (axis, axis)]
        return np.asarray(sum((table(at) - table(zero) for table in mine), start=np.zeros_like(at)))

    before = own_deviation(chain, axis, at) - own_deviation(chain, axis, zero)
    first = before + added(own)
    size, unit = in_deviation_unit(chain, axis, 1.0), axis_unit(chain, axis)
    where = np.rad2deg(at) if unit == "deg" else at
    curves = (one * size for one in (before, first, first + added(tooth)))
    return AxisCurve(axis, deviation_unit(unit), where, *curves)
