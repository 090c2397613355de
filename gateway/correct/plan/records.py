"""Corrections q (mm, rad) as the controller's tables and back: deviations d = -q in um and arcsec (sign convention)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from drivers.types.tables import CompensationTable
from drivers.types.values import FloatArray
from drivers.units import (
    ARCSEC_PER_RAD,
    DEG_PER_RAD,
    UM_PER_MM,
    AxisUnit,
    arcsec_to_rad,
    deg_to_rad,
    deviation_scale,
    rad_to_arcsec,
    rad_to_deg,
)
from gateway.correct.flank.tables import Product, Table, TableGrid
from gateway.errors import ModelError
from gateway.model.chain import Chain

EVEN = 1e-6  # of the step: how evenly spaced the controller's points must be
DIGITS = 9


def axis_unit(chain: Chain, name: str) -> AxisUnit:
    """The unit an axis is programmed in."""
    return "mm" if chain.axis(name).kind == "prismatic" else "deg"


def record(
    chain: Chain,
    table: Table,
    kind: Literal["axis", "cross"],
    *,
    index: int = 0,
    direction: Literal[-1, 0, 1] = 0,
    names: Mapping[str, str] | None = None,
) -> CompensationTable:
    """The table the controller gets. ``names`` translates the chain's axis names to the machine's (X -> X1).

    Raises ModelError E-CORRECT-UNEVEN if the nodes are not evenly spaced.
    """
    grid, called = table.grid, names or {}
    nodes, values = _closed_values(table)
    steps = np.diff(nodes)
    if nodes.size < 2 or float(np.ptp(steps)) > EVEN * float(steps[0]):
        raise ModelError("E-CORRECT-UNEVEN", grid.name, nodes=nodes.size)
    inside, outside = axis_unit(chain, grid.over), axis_unit(chain, grid.out)
    at = np.round(rad_to_deg(nodes) if inside == "deg" else nodes, DIGITS)
    d = -values * (ARCSEC_PER_RAD if outside == "deg" else UM_PER_MM)
    return CompensationTable(
        kind=kind,
        input_axis=called.get(grid.over, grid.over),
        output_axis=called.get(grid.out, grid.out),
        minimum=float(at[0]),
        maximum=float(at[-1]),
        step=float(np.round((at[-1] - at[0]) / (at.size - 1), DIGITS)),
        deviations=tuple(float(v) + 0.0 for v in np.round(d, DIGITS)),
        modulo=grid.period is not None,
        index=index,
        input_unit=inside,
        output_unit=outside,
        direction=direction,
    )


def records_of_product(
    chain: Chain, product: Product, *, first: int, second: int, names: Mapping[str, str] | None = None
) -> tuple[CompensationTable, CompensationTable]:
    """Two tables whose product the control adds: the numbers multiply as it holds them.

    Both factors and their product count in the output axis' own unit (mm or deg); ``multiply_by`` of the first is the
    second's table index + 1. The proof of multiplication on that machine decides how the signs of two factors meet.
    """
    size = 1.0 if axis_unit(chain, product.out) == "mm" else 1.0 / np.sqrt(DEG_PER_RAD)
    left = Table(product.first.grid, product.first.values * size)
    right = Table(product.second.grid, -product.second.values * size)
    factor = record(chain, left, "cross", index=first, names=names)
    return replace(factor, multiply_by=second + 1), record(chain, right, "cross", index=second, names=names)


def table_of(chain: Chain, stored: CompensationTable, names: Mapping[str, str] | None = None) -> Table | None:
    """A stored table as corrections of the mean of both directions of travel; ``names`` as in `record`.

    None for one that was never loaded.
    """
    if len(stored.deviations) < 2 or stored.maximum <= stored.minimum:
        return None
    back = {machine: letter for letter, machine in (names or {}).items()}
    at = np.asarray(stored.positions, dtype=np.float64)
    nodes: FloatArray = deg_to_rad(at) if stored.input_unit == "deg" else at
    ways = (stored.deviations, stored.reverse or stored.deviations)
    d = np.mean(np.asarray(ways, dtype=np.float64), axis=0)
    q = -arcsec_to_rad(d) if stored.output_unit == "deg" else -d / UM_PER_MM
    period = float(nodes[-1] - nodes[0]) if stored.modulo else None
    out, over = (back.get(name, name) for name in (stored.output_axis, stored.input_axis))
    for name in (out, over):
        chain.axis(name)
    return Table(TableGrid(out, over, nodes, period), q)


def even_grid(
    chain: Chain, out: str, over: str, minimum: float, maximum: float, step: float, *, modulo: bool = False
) -> TableGrid:
    """The controller's grid, given in the input axis' unit (mm or deg), in mm or rad."""
    count = round((maximum - minimum) / step)
    at = np.asarray(minimum + step * np.arange(count + 1), dtype=np.float64)
    nodes: FloatArray = at / DEG_PER_RAD if axis_unit(chain, over) == "deg" else at
    return TableGrid(out, over, nodes, float(nodes[-1] - nodes[0]) if modulo else None)


def resolution(chain: Chain, out: str, per_axis_unit: float) -> float:
    """A resolution in the axis' unit (mm or deg) in mm or rad."""
    return per_axis_unit / DEG_PER_RAD if axis_unit(chain, out) == "deg" else per_axis_unit


def in_deviation_unit(chain: Chain, out: str, value: float) -> float:
    """mm or rad as um or arcsec."""
    unit = axis_unit(chain, out)
    return rad_to_arcsec(value) if unit == "deg" else value * deviation_scale(unit)


def _closed_values(table: Table) -> tuple[FloatArray, FloatArray]:
    """Nodes and values; a repeating table gets its last point, equal to the first."""
    grid = table.grid
    if grid.period is None or grid.closed:
        return grid.nodes, table.values
    return np.append(grid.nodes, grid.nodes[0] + grid.period), np.append(table.values, table.values[0])
