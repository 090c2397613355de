"""A sorted day made: a site file with its set-ups, a run of its captures, error model, forecast and reports."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date, datetime
from pathlib import Path
from typing import Any

from drivers.clock import Clock
from drivers.errors import ConfigError, TrueflankError
from gateway.config import SiteFile, load_site, read_site
from gateway.config.writing import site_text
from gateway.events import RunStarted
from gateway.say import Say
from gateway.store import RunFolder
from gateway.store.disk import write_whole
from gateway.workflow import stages
from gateway.workflow.axes.conditions import tell_overdue
from gateway.workflow.day.answers import Answers
from gateway.workflow.day.forecast import ToothForecast, forecast
from gateway.workflow.day.gathering import DayFolder
from gateway.workflow.day.sorting import Placed, accepted_words, day_facts
from gateway.workflow.doubles import simulated_set
from gateway.workflow.errors21.components import PlanOutcome, conclude, grids, measure_site
from gateway.workflow.errors21.filesetup import capture_of, read_setup
from gateway.workflow.errors21.fromsetups import axes_measured
from gateway.workflow.errors21.setups import Planned, key_of, planned
from gateway.workflow.files.days import days_of
from gateway.workflow.files.facts import settle
from gateway.workflow.results.testconditions import STATED, with_unit
from gateway.workflow.runsite import new_run
from gateway.workflow.tooth.correcting import ToothOutcome, correct_site
from gateway.workflow.tooth.proposal import work_of

HEAD = "Made by `trueflank day` from {site} and the files of {folder}; the next `trueflank day` writes it anew."
MARK = "# Made by `trueflank day`"


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


def write_site(site_path: Path, folder: Path, setups: Sequence[Placed], where: Path | None = None) -> Path:
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


def keys_of(site: SiteFile, setups: Sequence[Placed]) -> tuple[str, ...]:
    """Keys of the day's set-ups in the plan of its site."""
    mine = {key_of(one.setup) for one in planned(site) if one.setup.source == "file"}
    wanted = {(one.setup["component"], one.setup["axis"]) for one in setups}
    return tuple(one.key for one in planned(site) if one.key in mine and (one.setup.component, one.axis.name) in wanted)


def from_files(
    site: SiteFile,
    site_path: Path,
    setups: Sequence[Placed],
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
    tell_overdue(site, _measured_on(setups, utc.date()), say)
    run = new_run(site, site_path)
    RunStarted(str(run.path)).tell(say)
    work = work_of(site, site_path) if site.work is not None else None
    try:
        mine = {one.file.path.resolve(): one for one in setups}
        for one in planned(site):
            path = (site_path.parent / Path(str(one.setup.path))).resolve()
            if one.key in keys_of(site, setups) and path in mine:
                _store(run, one, mine[path], folder=folder, answers=answers)
        keep_stated(run, setups, answers, site, utc=utc)
        plan = conclude(site, run, work.tooth if work is not None else None)
        if any(one.positioning and run.has(stages.setup(one.key)) for one in planned(site)):
            axes_measured(run, site)
    except TrueflankError as error:
        run.set_state("failed", error=error.as_record())
        raise
    outlook = forecast(plan.model, work, grids(site)) if work is not None else None
    return DayOutcome(site_path, run.path, plan, outlook)


def _measured_on(setups: Sequence[Placed], today: date) -> date:
    """The last day that the files say, today where one of them says none."""
    found = []
    for one in setups:
        last = days_of(one.file.words.get("Date", "")).last
        if last is None:
            return today
        found.append(last)
    return max(found, default=today)


def keep_stated(run: RunFolder, setups: Sequence[Placed], answers: Answers, site: SiteFile, *, utc: datetime) -> None:
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


def _store(run: RunFolder, one: Planned, placed: Placed, *, folder: DayFolder, answers: Answers) -> None:
    path = placed.file.path
    measured = read_setup(path, one, folder.machine, folder.maps, how=folder.how(path, answers))
    capture = capture_of(one, measured, None, placed.file.whole)
    run.write_bytes(f"source-{one.key}{path.suffix.lower()}", path.read_bytes())
    run.write_text(f"setup-{one.key}.json", one.setup.model_dump_json())
    run.put(stages.setup(one.key), capture)


async def at_the_control(
    site: SiteFile, site_path: Path, setups: Sequence[Placed], *, answers: Answers, clock: Clock, say: Say
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
    """What was said of each file, beside the run's records."""
    RunFolder(outcome.run_folder).write_text("day.json", json.dumps(day, indent=1, default=str))
