"""What tables could do for the tooth by the errors that a day's files told, before any control was asked; pure."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

from drivers.types.tables import CompensationTable
from gateway.correct.flank.noise import noise_patterns
from gateway.correct.outlook.drive_outlook import costliest, drive_forecast
from gateway.correct.outlook.flank_uncertainty import ProcessUncertainty, doubts, error_doubts
from gateway.correct.outlook.prediction import Prediction, predict, select_cross_tables
from gateway.correct.plan.layers import LayeredCorrection, correct
from gateway.correct.plan.plan import AxisGrid, Plan
from gateway.gear.flank import FlankGrid, flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.error_model import ErrorModel, chain_of_errors
from gateway.reducer.goal import DriveGoal
from gateway.tooth import DriveForecast
from gateway.workflow.tooth.proposal import ToothWork

PROFILE, WIDTH = 11, 5
LARGEST = 3


@dataclass(frozen=True, slots=True)
class ForecastTable:
    """A table that would be proposed, by its layer and name, with its lowest and highest value (um or arcsec)."""

    layer: str
    name: str
    points: int
    low: float
    high: float
    unit: str


@dataclass(frozen=True, slots=True)
class ToothForecast:
    """RMS of the flank, um: as it is with its set-up values right, with axis tables, and with everything.

    Each by the errors that are known, with its standard uncertainty by all doubts (``_u_um``). ``sources_um``: what of
    that comes from errors not measured, from measured ones and from the process, RMS on the flank; ``largest``: the
    errors not measured that do most. It supposes that no table acted while the files were measured: only the control
    can tell. ``drive`` where the gear file names a reducer.
    """

    before_um: float
    before_u_um: float
    with_own_um: float
    with_own_u_um: float
    after_um: float
    after_u_um: float
    sources_um: dict[str, float]
    largest: tuple[str, ...]
    tables: tuple[ForecastTable, ...]
    drive: DriveForecast | None = None

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        return asdict(self)


def forecast(model: ErrorModel, work: ToothWork, grids: tuple[AxisGrid, ...]) -> ToothForecast:
    """Both layers of tables worked out for a machine without any. Raises ModelError (E-CORRECT-...)."""
    chain = chain_of_errors(model, height_mm=work.height_mm)
    grinding = Grinding(chain, work.gear, work.centre_distance_mm)
    grid = flank_grid(work.gear, profile=PROFILE, width=WIDTH)
    plan = Plan(grids, zeros=("X",), goal=work.goal)
    plan = replace(plan, noise=noise_patterns(grinding, grid, doubts(model, chain, plan)))

    def worked_out(tried: Plan) -> tuple[LayeredCorrection, Prediction]:
        found = correct(grinding, grid, plan=tried)
        return found, predict(grinding, grid, plan=tried, model=model, found=found, shop=ProcessUncertainty())

    chosen = select_cross_tables(plan, worked_out)
    found, parts = chosen.found, chosen.outlook.flank.parts_um
    before, own, after = chosen.outlook.steps_um
    gaps = {one.name for one in model.unknown}
    kinds = {
        name: "unmeasured" if name in gaps else "measured" if name in model.measured else "process" for name in parts
    }
    return ToothForecast(
        before_um=before[0],
        before_u_um=before[1],
        with_own_um=own[0],
        with_own_u_um=own[1],
        after_um=after[0],
        after_u_um=after[1],
        sources_um={
            kind: sum(size**2 for name, size in parts.items() if kinds[name] == kind) ** 0.5
            for kind in ("unmeasured", "measured", "process")
        },
        largest=tuple(name for name in parts if name in gaps)[:LARGEST],
        tables=tuple(_table(one) for one in (*found.own, *found.cross) if any(one.deviations)),
        drive=None if work.goal is None else _drive(work.goal, grinding, grid, plan=plan, model=model, found=found),
    )


def _drive(
    goal: DriveGoal, grinding: Grinding, grid: FlankGrid, *, plan: Plan, model: ErrorModel, found: LayeredCorrection
) -> DriveForecast:
    """The drive of the discs as the machine is, with axis tables and with everything for this goal."""
    wrong = error_doubts(grinding, grid, plan, model)
    costs = costliest(goal.drive, found.machine, grid, doubt=wrong, measured=model.measured)
    machines = (
        ("as it is", grinding),
        ("axis tables", found.machine_with_own),
        (f"this goal: {goal.kind}", found.machine),
    )
    return drive_forecast(goal.drive, machines, grid, costs)


def _table(one: CompensationTable) -> ForecastTable:
    values = one.deviations
    return ForecastTable(
        layer=one.kind,
        name=f"{one.output_axis}({one.input_axis})",
        points=len(values),
        low=min(values),
        high=max(values),
        unit=one.deviation_unit,
    )
