"""What may be used to correct a machine: grids, tables, set-up values, goal, limits, in the controller's units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from drivers.limits import SOLVED_STEP, Limits
from drivers.types.tables import CompensationTable, factors_of
from gateway.correct.flank.flankmodel import SetupUnknown
from gateway.correct.flank.noise import FitNoise
from gateway.correct.flank.tables import Table, TableGrid
from gateway.correct.plan.records import axis_unit, even_grid, in_deviation_unit, resolution, table_of
from gateway.correct.solve.limits import TableSpec
from gateway.correct.solve.optimise import Norm
from gateway.errors import ModelError
from gateway.model.chain import Chain
from gateway.reducer.goal import DriveGoal
from gateway.table.limits import check_points

ALIKE_MM = 5e-6  # a twentieth of a step: far below what is known of any flank
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
    by axis) is how far cross tables may spoil an axis; one without is bound by the limits of a table alone. ``alike``
    (mm RMS, in squares) is how much worse the flank may be for smoother tables. ``noise`` says how the errors may be
    wrong, ``reserved`` how many points the controller holds for a table, by name. Tables over an axis without a grid
    are left out. ``goal`` is what of the drive counts beside the flank's RMS; None: nothing.
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
    alike: float = ALIKE_MM
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
