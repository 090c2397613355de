"""The two layers: axis tables take each axis' own deviation, cross tables and set-up values what the tooth needs more.

No deviation stands in both: the second layer is worked out on the machine with the first one acting, be it worked out
here or given as it will be live. What the flank does not see is decided by the axis (first layer) or goes back to what
acts, and is said.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from drivers.message import Message, Quantity, digits, fixed
from drivers.types.tables import CompensationTable
from drivers.types.values import FloatArray
from drivers.units import DeviationUnit, deviation_unit, mm_to_um
from gateway.correct.flank.flank_model import places_of_grid, setup_tables
from gateway.correct.flank.mounting import WorkMounting, mounting_of, without_mounting
from gateway.correct.flank.tables import Table, with_tables
from gateway.correct.plan.plan import (
    Plan,
    axis_unit,
    cross_specs,
    in_deviation_unit,
    live_table,
    setup_unknowns,
    table_of,
    table_record,
    table_spec,
)
from gateway.correct.solve.constraints import AxisBound
from gateway.correct.solve.optimise import Optimum, optimise
from gateway.errors import ModelError
from gateway.gear.first_order import bounded_first_order
from gateway.gear.flank import FlankFigure, FlankGrid, flank_figure
from gateway.gear.grinding import Grinding
from gateway.model.chain import MOTIONS, Chain
from gateway.model.motion import travel_of
from gateway.reducer.goal import flank_target
from gateway.table import Grid, project
from gateway.table.limits import check_reach, reason
from gateway.tooth import SetupValues

# ---- The first layer: axis tables that take each axis' own deviation (mean of both directions), as corrections.

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
    low, high = _known_part(chain, axis, plan)

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


def _known_part(chain: Chain, axis: str, plan: Plan) -> tuple[float, float]:
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
        grid, (low, high) = plan.grid(axis), _known_part(chain, axis, plan)
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


FEWEST_SPACES = 5  # fewer cannot tell a harmonic of the turn


@dataclass(frozen=True)
class LayeredCorrection:
    """What to load and set, and what it does.

    ``own`` and ``cross`` are compensation tables (our signs), ``setup`` what to add to the set-up values, ``moved``
    how to move the work on its table. Flank figures (mm): as it is, with axis tables, at best, with everything;
    ``checked`` is that by second order on ``machine``, the machine with everything acting and the work moved;
    ``unmoved`` is the same with the work as it sits. ``said`` are findings in words.
    """

    own: tuple[CompensationTable, ...]
    cross: tuple[CompensationTable, ...]
    setup: SetupValues
    moved: WorkMounting
    before: FlankFigure
    with_own: FlankFigure
    best: FlankFigure
    after: FlankFigure
    checked: FlankFigure
    optimum: Optimum
    machine_with_own: Grinding
    machine: Grinding
    unmoved: Grinding
    axes: tuple[AxisCurve, ...]
    said: tuple[Message, ...]


def correct(
    grinding: Grinding,
    grid: FlankGrid,
    plan: Plan,
    live: Sequence[CompensationTable] = (),
    own: Sequence[CompensationTable] | None = None,
) -> LayeredCorrection:
    """Both layers and the set-up values for a machine whose errors were measured while ``live`` acted.

    ``own`` are the axis tables that will be live (our signs, the chain's axis letters), those proposed and no others:
    an axis without one keeps what acts. None: the first layer is worked out here.
    Raises ModelError E-CORRECT-INFEASIBLE if limits and bounds leave no solution, E-CORRECT-OWN.
    """
    chain = grinding.chain
    layer = own_layer(chain, plan, live) if own is None else _axis_tables(chain, own)
    first = _table_increments(chain, layer, live, "axis")
    acting = with_tables(grinding, first)
    mounting = _mounting(with_tables(acting, _taken_off(chain, plan, live)), grid, plan)
    seated = without_mounting(acting, mounting)
    specs = cross_specs(chain, plan, live)
    bounds = [_bound(chain, plan, axis, first, live) for axis in plan.bounds if plan.has(axis)]
    setup = setup_unknowns(chain, plan)
    found = optimise(
        seated,
        grid,
        specs,
        setup,
        norm=plan.norm,
        noise=plan.noise,
        bounds=bounds,
        indifference_rms=plan.indifference_rms,
        target=flank_target(plan.goal, grid) if plan.goal is not None and plan.goal.of_drive else None,
    )
    second = _table_increments(chain, found.tables, live, "cross")
    machine, unmoved = (_set_up(with_tables(one, second), found.setup) for one in (seated, acting))
    return LayeredCorrection(
        own=tuple(table_record(chain, table, "axis") for table in layer) if own is None else tuple(own),
        cross=tuple(table_record(chain, table, "cross", index=i) for i, table in enumerate(found.tables)),
        setup=found.setup,
        moved=mounting.opposite,
        before=second_order_figure(grinding, grid),
        with_own=second_order_figure(acting, grid),
        best=found.best,
        after=found.after,
        checked=second_order_figure(machine, grid),
        optimum=found,
        machine_with_own=acting,
        machine=machine,
        unmoved=unmoved,
        axes=tuple(axis_curve(chain, axis, plan=plan, own=first, tooth=second) for axis in plan.own if plan.has(axis)),
        said=(*_describe_decisions(plan, found, layer), *(held_tables(chain, plan) if own is None else ())),
    )


def second_order_figure(grinding: Grinding, grid: FlankGrid) -> FlankFigure:
    """The flank figure to second order."""
    return flank_figure(bounded_first_order(grinding, grid.k, grid.theta, grid.z).second, grid.section.h)


def _axis_tables(chain: Chain, tables: Sequence[CompensationTable]) -> tuple[Table, ...]:
    """Axis tables as corrections. Raises ModelError E-CORRECT-OWN for one of the other layer."""
    for one in tables:
        if one.kind != "axis" or one.input_axis != one.output_axis:
            raise ModelError("E-CORRECT-OWN", "layers", name=one.name)
    found = (table_of(chain, one) for one in tables)
    return tuple(one for one in found if one is not None)


def _table_increments(
    chain: Chain, tables: Sequence[Table], live: Sequence[CompensationTable], layer: Literal["axis", "cross"]
) -> list[Table]:
    """What new tables of a layer add to those of the same name that acted while the errors were measured."""
    acting = [one for one in live if one.kind == layer]
    old = [live_table(chain, table.grid.out, table.grid.over, acting) for table in tables]
    return [*tables, *(Table(one.grid, -one.values) for one in old if one is not None)]


def _taken_off(chain: Chain, plan: Plan, live: Sequence[CompensationTable]) -> list[Table]:
    """What takes the tooth's tables that acted off again: they meet B by C, which must not look like a mounting."""
    acting = [one for one in live if one.kind == "cross"]
    found = [live_table(chain, out, over, acting) for out, over in plan.cross]
    return [Table(one.grid, -one.values) for one in found if one is not None]


def _mounting(acting: Grinding, grid: FlankGrid, plan: Plan) -> WorkMounting:
    if not plan.mounting or grid.ks.size < FEWEST_SPACES:
        return WorkMounting()
    return mounting_of(acting, places_of_grid(grid)).rounded(plan.resolution_mm, np.deg2rad(plan.resolution_deg))


def _bound(chain: Chain, plan: Plan, axis: str, first: Sequence[Table], live: Sequence[CompensationTable]) -> AxisBound:
    curve = axis_curve(chain, axis, plan=plan, own=first, tooth=())
    size = 1.0 / in_deviation_unit(chain, axis, 1.0)
    at = np.deg2rad(curve.at) if curve.unit == "arcsec" else curve.at
    tooth = tooth_table(chain, axis, live)
    own = curve.own_layer * size - (tooth(at) if tooth is not None else 0.0)
    return AxisBound(axis, at, own, plan.bounds[axis] * size)


def _set_up(machine: Grinding, setup: SetupValues) -> Grinding:
    """The machine with its zeros moved and the wheel dressed with the offset."""
    zeros = setup_tables(machine, setup)
    offset = machine.dressing.offset + setup.dressing_mm
    return replace(with_tables(machine, zeros), dressing=replace(machine.dressing, offset=offset))


def _sizes(gain: float, U: float) -> dict[str, Quantity | str]:
    return {"gain": fixed(mm_to_um(gain), 3), "U": fixed(mm_to_um(U), 3)}


def _describe_decisions(plan: Plan, found: Optimum, own: Sequence[Table]) -> tuple[Message, ...]:
    """What was decided without the flank, what was left alone, and why."""
    said = [
        Message.of("S-CORRECT-IDLE", name=one.name)
        if one.idle
        else Message.of(
            "S-CORRECT-WITHIN-U", name=one.name, gain=fixed(mm_to_um(one.gain), 3), U=fixed(mm_to_um(one.U), 3)
        )
        for one in found.omitted
    ]
    for name, nodes in found.unseen.items():
        if nodes:
            said.append(Message.of("S-CORRECT-UNSEEN", name=name, count=len(nodes)))
    said += [Message.of("S-CORRECT-BY-AXIS", name=t.grid.name) for t in own if t.grid.out not in _moving_axes(plan)]
    outs = [table.grid.out for table in found.tables]
    for out in sorted({one for one in outs if outs.count(one) > 1}):
        shared = ", ".join(table.grid.name for table in found.tables if table.grid.out == out)
        said.append(Message.of("S-CORRECT-SHARED", names=shared, axis=out))
    return (*said, Message.of("S-CORRECT-CROSS-TERM"))


def _moving_axes(plan: Plan) -> set[str]:
    """Axes that move during one gear and whose own error the flank sees."""
    return {grid.axis for grid in plan.grids if grid.modulo}
