"""A sorted day made: a site file with its set-ups, a run of its captures, error model, forecast and reports."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import date, datetime
from pathlib import Path
from typing import Any

from drivers import registry
from drivers.clock import Clock
from drivers.errors import ConfigError, TrueflankError
from drivers.message import words
from drivers.types.tables import CompensationTable
from gateway.config import SiteFile, load_site, read_site, site_text
from gateway.correct.flank.noise import noise_patterns
from gateway.correct.outlook.drive_outlook import costliest, drive_forecast
from gateway.correct.outlook.flank_uncertainty import ProcessUncertainty, doubts, error_doubts
from gateway.correct.outlook.prediction import Prediction, predict, select_cross_tables
from gateway.correct.plan.layers import LayeredCorrection, correct
from gateway.correct.plan.plan import AxisGrid, Plan
from gateway.events import RunStarted
from gateway.gear.flank import FlankGrid, flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.error_model import ErrorModel, chain_of_errors
from gateway.reducer.goal import DriveGoal
from gateway.say import Say
from gateway.store import RunFolder, write_whole
from gateway.tooth import DriveForecast
from gateway.workflow.axes.measure import report_overdue_calibrations
from gateway.workflow.day.folder import Answers, DayFolder
from gateway.workflow.day.sorting import SortedFile, accepted_words, day_facts
from gateway.workflow.errors21.error_file import errors_of_run
from gateway.workflow.errors21.measurement import PlanOutcome, fit_error_model, grids, measure_site
from gateway.workflow.errors21.setup_capture import axes_from_setups, capture_of, read_setup
from gateway.workflow.errors21.setups import PlannedSetup, key_of, plan_setups
from gateway.workflow.files.headers import days_of
from gateway.workflow.files.statements import settle
from gateway.workflow.results.particulars import STATED, with_unit
from gateway.workflow.run import stages
from gateway.workflow.run.folder import new_run
from gateway.workflow.run.stages import simulated_set
from gateway.workflow.tooth.proposal import ToothOutcome, ToothWork, correct_site, work_of

# What tables could do for the tooth by the errors that a day's files told, before any control was asked; pure.

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
        ("present state", grinding),
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


HEAD = words("S-DAY-MADE")
MARK = "# Made by `trueflank day`"
ERRORS_FILE = "errors-etalon.txt"


@dataclass(frozen=True, slots=True)
class DayOutcome:
    """What a day came to: its site file, the run, what is known of the 21, and what the tooth would gain.

    ``forecast`` is None without a gear in the site file; ``proposal`` is None while no control was asked.
    """

    site_file: Path
    run_folder: Path
    plan: PlanOutcome
    forecast: ToothForecast | None
    proposal: ToothOutcome | None = None


def write_site(site_path: Path, folder: Path, setups: Sequence[SortedFile], where: Path | None = None) -> Path:
    """The site file with these set-ups in place of its own of the same errors; beside it, unless ``where`` says else.

    Raises ConfigError (E-DAY-SITE: a file of somebody else stands there; E-CFG-...).
    """
    path = where or site_path.with_name(f"{site_path.stem}-{folder.resolve().name}.toml")
    if path.exists() and not path.read_text(encoding="utf-8", errors="replace").startswith(MARK):
        raise ConfigError("E-DAY-SITE", str(path))
    load_site(site_path)
    tree = dict(read_site(site_path).tree)
    new = [{**one.setup, "path": _relative(one.file.path, path.parent)} for one in setups]
    taken = {(one["component"], one["axis"]) for one in new}
    names = {one["component"] for one in new}
    old = [one for one in tree.get("setups", ()) if (one.get("component"), one.get("axis")) not in taken]
    tree["setups"] = [*(one for one in old if one.get("source") != "none" or one["component"] not in names), *new]
    if any(one.file.measured is not None and simulated_set(one.file.measured) for one in setups):
        tree["site"] = {**tree["site"], "simulated": True}
    text = site_text(tree, HEAD.format(site=site_path.name, folder=folder.resolve().name))
    write_whole(path, text.encode())
    shutil.copymode(site_path, path)
    return path


def _relative(file: Path, folder: Path) -> str:
    """A path as the site file has it; absolute where there is no way between the two."""
    try:
        return Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix()
    except ValueError:
        return str(file.resolve())


def keys_of(site: SiteFile, setups: Sequence[SortedFile]) -> tuple[str, ...]:
    """Keys of the day's set-ups in the plan of its site."""
    mine = {key_of(one.setup) for one in plan_setups(site) if one.setup.source == "file"}
    wanted = {(one.setup["component"], one.setup["axis"]) for one in setups}
    return tuple(
        one.key for one in plan_setups(site) if one.key in mine and (one.setup.component, one.axis.name) in wanted
    )


def from_files(
    site: SiteFile,
    site_path: Path,
    setups: Sequence[SortedFile],
    *,
    folder: DayFolder,
    answers: Answers,
    utc: datetime,
    say: Say,
) -> DayOutcome:
    """Everything without a control: captures as the files have them, error model, forecast.

    No table can be pushed from it, for nobody knows what compensated. Raises CaptureError (E-CAP-OVERDUE), and what
    reading and evaluating raise; the run folder keeps the error.
    """
    report_overdue_calibrations(site, _measured_on(setups, utc.date()), say)
    run = new_run(site, site_path)
    RunStarted(str(run.path)).tell(say)
    work = work_of(site, site_path) if site.work is not None else None
    try:
        mine = {one.file.path.resolve(): one for one in setups}
        for one in plan_setups(site):
            path = (site_path.parent / Path(str(one.setup.path))).resolve()
            if one.key in keys_of(site, setups) and path in mine:
                _store(run, one, mine[path], folder=folder, answers=answers)
        keep_stated(run, setups, answers, site, utc=utc)
        plan = fit_error_model(site, run, work.tooth if work is not None else None)
        if any(one.positioning and run.has(stages.setup(one.key)) for one in plan_setups(site)):
            axes_from_setups(run, site)
    except TrueflankError as error:
        run.set_state("failed", error=error.as_record())
        raise
    outlook = forecast(plan.model, work, grids(site)) if work is not None else None
    return DayOutcome(site_path, run.path, plan, outlook)


def _measured_on(setups: Sequence[SortedFile], today: date) -> date:
    """The last day that the files say, today where one of them says none."""
    found = []
    for one in setups:
        last = days_of(one.file.words.get("Date", "")).last
        if last is None:
            return today
        found.append(last)
    return max(found, default=today)


def keep_stated(
    run: RunFolder, setups: Sequence[SortedFile], answers: Answers, site: SiteFile, *, utc: datetime
) -> None:
    """What the day's files state, what a person accepted of it, and the test conditions among the answers.

    Raises ConfigError (E-FACTS-DIFFER) where a statement differs that no answer accepts, StoreError.
    """
    stated = settle(day_facts(setups), site, accepted=accepted_words(answers), utc=utc)
    said: dict[str, Mapping[str, str]] = {}
    for axis in site.axes:
        names = [one.file.whole for one in setups if one.axis == axis.name]
        own = {key: answers.of(key, names[0] if names else "", axis.name) for key in STATED}
        found = {key: with_unit(key, value, axis.unit) for key, value in own.items() if value is not None}
        said |= {axis.name: found} if found else {}
    run.put(stages.STATED, replace(stated, conditions=said))


def _store(run: RunFolder, one: PlannedSetup, placed: SortedFile, *, folder: DayFolder, answers: Answers) -> None:
    path = placed.file.path
    measured = read_setup(path, one, folder.machine, folder.maps, how=folder.how(path, answers))
    capture = capture_of(one, measured, None, placed.file.whole)
    run.write_bytes(f"source-{one.key}{path.suffix.lower()}", path.read_bytes())
    run.write_text(f"setup-{one.key}.json", one.setup.model_dump_json())
    run.put(stages.setup(one.key), capture)


async def at_the_control(
    site: SiteFile, site_path: Path, setups: Sequence[SortedFile], *, answers: Answers, clock: Clock, say: Say
) -> DayOutcome:
    """The same with the tables that the control holds now, and a proposal that can be pushed.

    Raises what `measure_site` and `correct_site` raise.
    """
    work = work_of(site, site_path) if site.work is not None else None
    tooth, keys = work.tooth if work is not None else None, keys_of(site, setups)
    plan = await measure_site(site, site_path, clock=clock, say=say, wanted=keys, tooth=tooth)
    folder = RunFolder(Path(plan.run_folder))
    keep_stated(folder, setups, answers, site, utc=clock.utc())
    found = await correct_site(site, site_path, folder, clock=clock, say=say) if work is not None else None
    return DayOutcome(site_path, folder.path, plan, None, proposal=found)


def keep_day(outcome: DayOutcome, day: dict[str, Any]) -> None:
    """What was said of each file, beside the run's records; and the errors as a file that other programs read."""
    run = RunFolder(outcome.run_folder)
    run.write_text("day.json", json.dumps(day, indent=1, default=str))
    errors = errors_of_run(run)
    run.write_text(ERRORS_FILE, registry.load("etalon-exchange", "error-exchange")().text(errors, errors.notes))
