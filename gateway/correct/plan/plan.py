"""What may be used to correct a machine, in the controller's units, and corrections as its tables and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from drivers.limits import SOLVED_STEP, Limits
from drivers.types.tables import CompensationTable, factors_of
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
from gateway.correct.flank.flank_model import SetupUnknown
from gateway.correct.flank.noise import FitNoise
from gateway.correct.flank.tables import Product, Table, TableGrid
from gateway.correct.solve.constraints import TableSpec
from gateway.correct.solve.optimise import Norm
from gateway.errors import ModelError
from gateway.model.chain import Chain
from gateway.reducer.goal import DriveGoal
from gateway.table.limits import check_points

INDIFFERENCE_RMS_MM = 5e-6  # a twentieth of a step: far below what is known of any flank
CROSS = (("X", "Z"), ("X", "C"), ("C", "Z"), ("C", "C"))


@dataclass(frozen=True, slots=True)
class AxisGrid:
    """The controller's grid of one input axis in its unit (mm or deg), and where its tables are zero."""

    axis: str
    minimum: float
    maximum: float
    step: float
    reference: float = 0.0
    modulo: bool = False


@dataclass(frozen=True)
class Plan:
    """Grids by input axis, axes with a table of their own, cross tables (output, input), set-up values, goal.

    ``mounting``: the work's eccentricity and tilt are set right by hand, no table takes them. ``bounds`` (um or arcsec
    by axis) is how far cross tables may spoil an axis; one without is bound by the limits of a table alone.
    ``indifference_rms`` (mm, in squares) is how much worse the flank may be for smoother tables. ``noise`` says how the
    errors may be wrong, ``reserved`` how many points the controller holds for a table, by name. Tables over an axis
    without a grid are left out. ``goal`` is what of the drive counts beside the flank's RMS; None: nothing.
    """

    grids: tuple[AxisGrid, ...]
    own: tuple[str, ...] = ("X", "Z", "C")
    cross: tuple[tuple[str, str], ...] = CROSS
    zeros: tuple[str, ...] = ("X", "C")
    dressing: bool = True
    mounting: bool = True
    norm: Norm = "rms"
    goal: DriveGoal | None = None
    bounds: Mapping[str, float] = field(default_factory=dict)
    indifference_rms: float = INDIFFERENCE_RMS_MM
    noise: FitNoise = field(default_factory=FitNoise)
    reserved: Mapping[str, int] = field(default_factory=dict)
    resolution_mm: float = SOLVED_STEP
    resolution_deg: float = SOLVED_STEP

    def has(self, axis: str) -> bool:
        """True if there is a grid for tables over that axis."""
        return any(one.axis == axis for one in self.grids)

    def grid(self, axis: str) -> AxisGrid:
        """The grid of an input axis. Raises ModelError E-CORRECT-PLAN."""
        for one in self.grids:
            if one.axis == axis:
                return one
        raise ModelError("E-CORRECT-PLAN", "plan", axis=axis)

    def resolution(self, chain: Chain, out: str) -> float:
        """Smallest step of a value of that output axis, mm or rad."""
        unit = axis_unit(chain, out)
        return resolution(chain, out, self.resolution_deg if unit == "deg" else self.resolution_mm)


def table_spec(chain: Chain, plan: Plan, out: str, over: str, live: Sequence[CompensationTable] = ()) -> TableSpec:
    """One table within the limits of a table; ``live`` are the tables that acted while the errors were measured.

    Raises TooManyPoints if the controller reserved fewer points.
    """
    grid = plan.grid(over)
    points = round((grid.maximum - grid.minimum) / grid.step) + 1
    check_points(
        points, plan.reserved.get(f"{out}({over})", points), f"{out}({over})", "axis" if out == over else "cross"
    )
    inside = in_deviation_unit(chain, over, 1.0) / (3600.0 if axis_unit(chain, over) == "deg" else 1000.0)
    limits = Limits.of(axis_unit(chain, out))
    size = 1.0 / in_deviation_unit(chain, out, 1.0)
    return TableSpec(
        even_grid(
            chain, out, over=over, minimum=grid.minimum, maximum=grid.maximum, step=grid.step, modulo=grid.modulo
        ),
        resolution=plan.resolution(chain, out),
        value=limits.value * size,
        slope=limits.slope * size * inside,
        change=limits.change * size,
        reference=grid.reference / inside,
        live=live_table(chain, out, over, live),
    )


def live_table(chain: Chain, out: str, over: str, live: Sequence[CompensationTable]) -> Table | None:
    """What acted of one name, as corrections of the mean of both directions; None where nothing was loaded.

    ``live`` are tables of one layer. A pair for one direction each (DIRECTION 1 and -1) counts half each, as they take
    half of the mean; tables that are switched off hold zeros and count nothing. Raises ModelError: E-CORRECT-SEVERAL
    where several tables of that name act in one direction, for none alone is what acted; E-CORRECT-FACTOR where one is
    a factor of a product, by either of its two tables, for what it does by itself is not public.
    """
    factors = factors_of(one for one in live if any(one.deviations) or any(one.reverse))
    named = [one for one in live if (one.output_axis, one.input_axis) == (out, over)]
    loaded = [(one, table) for one in named if (table := table_of(chain, one)) is not None]
    found = [pair for pair in loaded if np.any(pair[1].values)] or loaded[:1]
    ways = [one.direction for one, _ in found]
    multiplied = [one for one, table in found if one.index in factors and np.any(table.values)]
    if multiplied:
        numbers = ", ".join(str(one.index) for one in multiplied)
        raise ModelError("E-CORRECT-FACTOR", "layers", name=f"{out}({over})", numbers=numbers)
    if len(set(ways)) < len(ways) or (len(ways) > 1 and 0 in ways):
        numbers = ", ".join(str(one.index) for one, _ in found)
        raise ModelError("E-CORRECT-SEVERAL", "layers", name=f"{out}({over})", count=len(found), numbers=numbers)
    shares = [(0.5 if one.direction else 1.0, table) for one, table in found]
    if len(shares) < 2:
        return next((Table(table.grid, share * table.values) for share, table in shares), None)
    first = shares[0][1].grid
    if len({table.grid.period for _, table in shares}) > 1:
        raise ModelError("E-CORRECT-SEVERAL", "layers", name=f"{out}({over})", count=2, numbers="+, -")
    nodes = np.unique(np.concatenate([table.grid.nodes for _, table in shares]))
    grid = TableGrid(out, over, nodes, first.period)
    return Table(grid, np.sum([share * table(nodes) for share, table in shares], axis=0))


def cross_specs(chain: Chain, plan: Plan, live: Sequence[CompensationTable] = ()) -> list[TableSpec]:
    """All cross tables of the plan for which there is a grid."""
    acting = [one for one in live if one.kind == "cross"]
    return [table_spec(chain, plan, out=out, over=over, live=acting) for out, over in plan.cross if plan.has(over)]


def setup_unknowns(chain: Chain, plan: Plan) -> list[SetupUnknown]:
    """The set-up values that the plan leaves open, with their resolutions."""
    zeros = [SetupUnknown(axis, plan.resolution(chain, axis)) for axis in plan.zeros]
    return [*zeros, SetupUnknown("", plan.resolution_mm)] if plan.dressing else zeros


# ---- Corrections q (mm, rad) as the controller's tables and back: deviations d = -q in um and arcsec (sign
# convention).

EVEN = 1e-6  # of the step: how evenly spaced the controller's points must be
DIGITS = 9


def axis_unit(chain: Chain, name: str) -> AxisUnit:
    """The unit an axis is programmed in."""
    return "mm" if chain.axis(name).kind == "prismatic" else "deg"


def table_record(
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
    factor = table_record(chain, left, "cross", index=first, names=names)
    return replace(factor, multiply_by=second + 1), table_record(chain, right, "cross", index=second, names=names)


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
