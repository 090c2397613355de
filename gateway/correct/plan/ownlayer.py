"""The first layer: axis tables that take each axis' own deviation (mean of both directions), as corrections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.types.tables import CompensationTable
from drivers.types.values import FloatArray
from drivers.units import DeviationUnit, deviation_unit
from gateway.correct.flank.tables import Table
from gateway.correct.plan.plan import Plan, live_table, table_spec
from gateway.correct.plan.records import axis_unit, in_deviation_unit
from gateway.model.chain import Chain
from gateway.table import Grid, project

SAMPLES = 181
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
    one = chain.axis(axis)
    errors = one.errors(at)
    part = errors[..., :3] if one.kind == "prismatic" else errors[..., 3:]
    return np.asarray(part @ one.vector)


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

    def wanted(place: FloatArray) -> FloatArray:
        at = nodes[0] + place * (nodes[-1] - nodes[0]) / k
        added = sum((one(at) for one in (acting, tooth) if one is not None), start=np.zeros_like(at))
        return np.asarray(added - own_deviation(chain, axis, at))

    table = Table(spec.grid, project(wanted, Grid(0.0, float(k), 1.0), modulo=plan.grid(axis).modulo))
    values = table.values - table(np.asarray(spec.reference))
    if float(np.max(np.abs(values))) <= QUIET:
        return None
    whole = np.rint(values / spec.resolution) * spec.resolution
    return Table(spec.grid, whole) if np.any(whole) or acting is not None else None


def axis_curve(chain: Chain, axis: str, plan: Plan, own: Sequence[Table], tooth: Sequence[Table]) -> AxisCurve:
    """An axis before and after; ``own`` and ``tooth`` are what the two layers add to what acted."""
    spec = table_spec(chain, plan, axis, axis)
    at = np.linspace(spec.grid.nodes[0], spec.grid.nodes[-1], SAMPLES)
    zero = np.asarray(spec.reference)

    def added(tables: Sequence[Table]) -> FloatArray:
        mine = [table for table in tables if (table.grid.out, table.grid.over) == (axis, axis)]
        return np.asarray(sum((table(at) - table(zero) for table in mine), start=np.zeros_like(at)))

    before = own_deviation(chain, axis, at) - own_deviation(chain, axis, zero)
    first = before + added(own)
    size, unit = in_deviation_unit(chain, axis, 1.0), axis_unit(chain, axis)
    where = np.rad2deg(at) if unit == "deg" else at
    curves = (one * size for one in (before, first, first + added(tooth)))
    return AxisCurve(axis, deviation_unit(unit), where, *curves)
