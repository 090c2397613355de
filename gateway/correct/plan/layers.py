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

from drivers.message import Message, Quantity, fixed
from drivers.types.tables import CompensationTable
from drivers.units import mm_to_um
from gateway.correct.flank.flankmodel import setup_tables
from gateway.correct.flank.mounting import WorkMounting, centred, mounting_of
from gateway.correct.flank.tables import Table, with_tables
from gateway.correct.flank.wheel_places import places_of_grid
from gateway.correct.plan.ownlayer import AxisCurve, axis_curve, held_tables, own_layer, tooth_table
from gateway.correct.plan.plan import Plan, cross_specs, live_table, setup_unknowns
from gateway.correct.plan.records import in_deviation_unit, record, table_of
from gateway.correct.solve.limits import AxisBound
from gateway.correct.solve.optimise import Optimum, optimise
from gateway.errors import ModelError
from gateway.gear.first_order import judged
from gateway.gear.flank import FlankFigure, FlankGrid, flank_figure
from gateway.gear.grinding import Grinding
from gateway.model.chain import Chain
from gateway.reducer.goal import flank_target
from gateway.tooth import SetupValues

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
    layer = own_layer(chain, plan, live) if own is None else _given(chain, own)
    first = _added(chain, layer, live, "axis")
    acting = with_tables(grinding, first)
    mounting = _mounting(with_tables(acting, _taken_off(chain, plan, live)), grid, plan)
    seated = centred(acting, mounting)
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
        alike=plan.alike,
        target=flank_target(plan.goal, grid) if plan.goal is not None and plan.goal.of_drive else None,
    )
    second = _added(chain, found.tables, live, "cross")
    machine, unmoved = (_set_up(with_tables(one, second), found.setup) for one in (seated, acting))
    return LayeredCorrection(
        own=tuple(record(chain, table, "axis") for table in layer) if own is None else tuple(own),
        cross=tuple(record(chain, table, "cross", index=i) for i, table in enumerate(found.tables)),
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
        said=(*_said(plan, found, layer), *(held_tables(chain, plan) if own is None else ())),
    )


def second_order_figure(grinding: Grinding, grid: FlankGrid) -> FlankFigure:
    """The flank figure to second order."""
    return flank_figure(judged(grinding, grid.k, grid.theta, grid.z).second, grid.section.h)


def _given(chain: Chain, tables: Sequence[CompensationTable]) -> tuple[Table, ...]:
    """Axis tables as corrections. Raises ModelError E-CORRECT-OWN for one of the other layer."""
    for one in tables:
        if one.kind != "axis" or one.input_axis != one.output_axis:
            raise ModelError("E-CORRECT-OWN", "layers", name=one.name)
    found = (table_of(chain, one) for one in tables)
    return tuple(one for one in found if one is not None)


def _added(
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


def _said(plan: Plan, found: Optimum, own: Sequence[Table]) -> tuple[Message, ...]:
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
    said += [Message.of("S-CORRECT-BY-AXIS", name=t.grid.name) for t in own if t.grid.out not in _turning(plan)]
    outs = [table.grid.out for table in found.tables]
    for out in sorted({one for one in outs if outs.count(one) > 1}):
        shared = ", ".join(table.grid.name for table in found.tables if table.grid.out == out)
        said.append(Message.of("S-CORRECT-SHARED", names=shared, axis=out))
    return (*said, Message.of("S-CORRECT-CROSS-TERM"))


def _turning(plan: Plan) -> set[str]:
    """Axes that move during one gear and whose own error the flank sees."""
    return {grid.axis for grid in plan.grids if grid.modulo}
