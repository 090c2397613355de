"""A study worked out: errors one at a time, ranking, cures, floor, correction before and after, what comes next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from drivers.types.values import FloatArray
from drivers.units import arcsec_to_rad, um_to_mm
from gateway.correct.flank.compensability import Cure, cures
from gateway.correct.flank.flank_model import FlankModel, flank_model
from gateway.correct.flank.noise import FitNoise, noise_patterns, shapes_over
from gateway.correct.flank.tables import with_tables
from gateway.correct.outlook.flank_uncertainty import FlankDoubts, column_doubts, doubts, error_doubts
from gateway.correct.part.from_gear import Visible, visible
from gateway.correct.plan.layers import LayeredCorrection, correct
from gateway.correct.plan.plan import Plan, cross_specs, setup_unknowns
from gateway.correct.plan.products import ProductResult, product_layer
from gateway.correct.solve.floor import Floor, floor
from gateway.errors import ModelError
from gateway.gear.envelope import exact
from gateway.gear.first_order import ErrorParameter, bounded_first_order, linear_flank
from gateway.gear.flank import FlankFigure, FlankGrid, Inspection, flank_figure, inspect
from gateway.gear.grinding import Grinding
from gateway.model.chain import Chain
from gateway.model.error_model import ErrorModel
from gateway.sensitivity.outputs import (
    OUTPUTS,
    FlankOutputs,
    MeasurementPriority,
    Order,
    equal_size,
    equal_spans,
    measure_next,
    measured_spans,
)
from gateway.sensitivity.screening import ScreeningResult, screen
from gateway.study.drive import Constant, DriveStudy, drive_study, reducer_of
from gateway.study.inputs import Doubt, ErrorFile, GearFile
from gateway.study.machine import error_names, grid_of, grinding_of, is_angle, plan_of, travels

TRAJECTORIES = 20


@dataclass(frozen=True)
class SingleErrorStudy:
    """One error of the paper's size alone: its flank (K, T, Z) mm to second order, and what first order misses."""

    name: str
    deviation: FloatArray
    figure: FlankFigure
    missed: float


@dataclass(frozen=True)
class State:
    """A flank (K, T, Z) mm with its figure, and its chart with the figure's rotation taken out (the angular datum)."""

    deviation: FloatArray
    figure: FlankFigure
    chart: Inspection


@dataclass(frozen=True)
class Study:
    """Everything a study found; mm and rad inside.

    The states are flanks to second order, or exact where ``order`` is; ``with_products`` only where products help.
    ``drive`` where the gear file names a reducer.
    """

    gear: GearFile
    errors: ErrorFile
    grinding: Grinding
    grid: FlankGrid
    plan: Plan
    names: tuple[str, ...]
    alone: tuple[SingleErrorStudy, ...]
    equal: ScreeningResult
    measured: ScreeningResult
    cures: Mapping[str, Cure]
    floor: Floor
    visible: Visible
    correction: LayeredCorrection
    products: tuple[ProductResult, ...]
    before: State
    with_own: State
    after: State
    with_products: State | None
    order: Order
    next: tuple[MeasurementPriority, ...]
    truncation: float
    drive: DriveStudy | None


def study(
    gear_file: GearFile,
    error_file: ErrorFile,
    *,
    executor: Executor | None = None,
    order: Order = "first",
    r: int = TRAJECTORIES,
    seed: int = 1,
    model: ErrorModel | None = None,
) -> Study:
    """Work out all studies of a gear on a machine; ``model`` is what a run knows of its errors together.

    Raises ModelError of the rooms it calls.
    """
    ready = prepare_study(gear_file, error_file, model)
    grinding, grid, names, plan = ready.grinding, ready.grid, ready.names, ready.plan
    correction = correct(grinding, grid, ready.used)
    spans = (equal_spans(names), measured_spans(grinding, names, travels(plan, grinding.chain)))
    equal, measured = (
        screen(FlankOutputs(grinding, grid, one, order), names, OUTPUTS, r=r, seed=seed, executor=executor)
        for one in spans
    )
    first = bounded_first_order(grinding, grid.k, grid.theta, grid.z)
    products = product_layer(correction.machine, grid, plan, proved=True) if error_file.multiplication_proved else ()
    states = {
        "before": _state(grid, grinding, order),
        "with_own": _state(grid, correction.machine_with_own, order),
        "after": _state(grid, correction.machine, order),
    }
    multiplied = with_tables(correction.machine, [one.product for one in products])
    return Study(
        gear=gear_file,
        errors=error_file,
        grinding=grinding,
        grid=grid,
        plan=plan,
        names=names,
        alone=tuple(_alone(grinding, grid, name) for name in names),
        equal=equal,
        measured=measured,
        cures=_cures(grinding, grid, names),
        floor=floor(grinding, grid),
        visible=visible(linear_flank(grinding, grid, names)),
        correction=correction,
        products=products,
        before=states["before"],
        with_own=states["with_own"],
        after=states["after"],
        with_products=_state(grid, multiplied, order) if products else None,
        order=order,
        next=_next(grinding, grid, plan, [name_of(parameter) for parameter, _ in ready.columns], ready.noise),
        truncation=float(np.max(np.abs(first.second - first.deviation))),
        drive=None
        if gear_file.reducer is None
        else drive_study(
            reducer_of(gear_file.reducer, grinding.gear),
            grinding,
            grid,
            names=names,
            states={name: one.deviation for name, one in states.items()},
            r=r,
            seed=seed,
            executor=executor,
            doubt=ready.doubt,
            measured=() if model is None else model.measured,
        ),
    )


@dataclass(frozen=True)
class StudyContext:
    """What every study begins with; ``used`` is the plan with the doubt that run or error file state.

    ``columns`` are independent shapes of the errors, one standard uncertainty each (mm, rad): of the run's model what
    a correction in the run takes too. ``doubt`` has them as patterns of the flank, with what lies between a run's
    targets.
    """

    grinding: Grinding
    grid: FlankGrid
    names: tuple[str, ...]
    plan: Plan
    used: Plan
    columns: Sequence[tuple[ErrorParameter | str, float]]
    noise: FitNoise
    doubt: FlankDoubts
    known: bool


def prepare_study(gear_file: GearFile, error_file: ErrorFile, model: ErrorModel | None = None) -> StudyContext:
    """Gear on machine with the plan of its tables, and how its errors may be wrong together."""
    grinding = grinding_of(gear_file, error_file)
    grid = grid_of(gear_file, grinding.gear)
    names = error_names(grinding.chain)
    plan = plan_of(error_file, grinding)
    columns: Sequence[tuple[ErrorParameter | str, float]] = (
        doubt_columns(grinding.chain, names, error_file.uncertainty or Doubt(), plan)
        if model is None
        else doubts(model, grinding.chain, plan)
    )
    noise = noise_patterns(grinding, grid, columns)
    known = model is not None or error_file.uncertainty is not None
    used = replace(plan, noise=noise) if known else plan
    doubt = column_doubts(grinding, grid, columns) if model is None else error_doubts(grinding, grid, plan, model)
    return StudyContext(
        grinding=grinding,
        grid=grid,
        names=names,
        plan=plan,
        used=used,
        columns=columns,
        noise=noise,
        doubt=doubt,
        known=known,
    )


def name_of(parameter: ErrorParameter | str) -> str:
    """The error that a column is of."""
    return parameter if isinstance(parameter, str) else parameter.name


def doubt_columns(
    chain: Chain, names: tuple[str, ...], doubt: Doubt, plan: Plan
) -> list[tuple[ErrorParameter | str, float]]:
    """How each error may be wrong: a location error by its value, a motion by independent smooth shapes that together
    make its standard uncertainty (first and second order over the travel, or two harmonics around the turn)."""
    found: list[tuple[ErrorParameter | str, float]] = []
    for name in names:
        axis, _ = chain.error_place(name)
        usual = arcsec_to_rad(doubt.angular_arcsec) if is_angle(name) else um_to_mm(doubt.linear_um)
        each = doubt.each.get(name)
        u = usual if each is None else each * (arcsec_to_rad(1.0) if is_angle(name) else um_to_mm(1.0))
        if not name.startswith("E"):
            found.append((ErrorParameter(name), u))
            continue
        shapes = shapes_over(chain, axis, travels(plan, chain).get(axis, (-1.0, 1.0)))
        found += [(ErrorParameter(name, shape), u / np.sqrt(len(shapes))) for shape in shapes]
    return found


def _alone(grinding: Grinding, grid: FlankGrid, name: str) -> SingleErrorStudy:
    clean = grinding.chain.without_errors()
    one = bounded_first_order(
        replace(grinding, chain=clean.with_errors({name: equal_size(name)})), grid.k, grid.theta, grid.z
    )
    missed = float(np.max(np.abs(one.second - one.deviation)))
    e = np.broadcast_to(one.second, grid.shape)
    return SingleErrorStudy(name, e, flank_figure(e, grid.section.h), missed)


def _cures(grinding: Grinding, grid: FlankGrid, names: tuple[str, ...]) -> dict[str, Cure]:
    """Cures of the machine's own errors; one the machine does not have is judged as a constant of the paper's size.

    Sizes are those of the flank figure, as everywhere in a study.
    """
    wanted = []
    for name in names:
        axis, key = grinding.chain.error_place(name)
        one = grinding.chain.axis(axis)
        motion = one.err.get(key, one.loc.get(key, 0.0))
        if callable(motion):
            wanted.append(ErrorParameter(name, motion))
        else:
            size = float(motion) or equal_size(name)
            wanted.append(ErrorParameter(name, Constant(size)))
    return {cure.error: cure for cure in cures(grinding, grid, wanted, figure=True)}


def _state(grid: FlankGrid, grinding: Grinding, order: Order) -> State:
    whole = exact if order == "exact" else _second
    e = np.broadcast_to(whole(grinding, grid.k, grid.theta, grid.z), grid.shape)
    figure = flank_figure(e, grid.section.h)
    return State(e, figure, inspect(grid, e - figure.rotation * grid.section.h))


def _second(grinding: Grinding, k: FloatArray, theta: FloatArray, z: FloatArray) -> FloatArray:
    return bounded_first_order(grinding, k, theta, z).second


def _next(
    grinding: Grinding, grid: FlankGrid, plan: Plan, names: list[str], noise: FitNoise
) -> tuple[MeasurementPriority, ...]:
    model = _tables_model(grinding, grid, plan)
    return measure_next(names, noise.rows(model), model.rows, model.places.points)


def _tables_model(grinding: Grinding, grid: FlankGrid, plan: Plan) -> FlankModel:
    chain = grinding.chain
    grids = [spec.grid for spec in cross_specs(chain, plan)]
    return flank_model(grinding, grid, grids, setup_unknowns(chain, plan))


def the_order(text: str) -> Order:
    """The order of a word. Raises ModelError E-SENS-ORDER."""
    known: dict[str, Order] = {"first": "first", "second": "second", "exact": "exact"}
    if text not in known:
        raise ModelError("E-SENS-ORDER", "study", order=text)
    return known[text]
