"""The work behind each command: the same workflows that the command line calls, with the same outcomes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from drivers.clock import Clock
from gateway.approve import take_risk
from gateway.config import SiteFile
from gateway.correct.outlook.flank_uncertainty import ToothSpec
from gateway.domain.proposals import Approval
from gateway.remaining import RemainingTime
from gateway.say import Say
from gateway.store import RunFolder
from gateway.study.inputs import gear_of, load_gear
from gateway.users import Signer
from gateway.web import bodies
from gateway.web.ports import ServedSite, Work
from gateway.workflow.complete_run import close_site, run_site
from gateway.workflow.control.disable import disable_site
from gateway.workflow.control.push import approve_plan, push_run
from gateway.workflow.control.rollback import recover_site, roll_back_site
from gateway.workflow.control.verify import verify_table
from gateway.workflow.errors21.measurement import measure_site
from gateway.workflow.forecast import day_of_closing, day_of_measuring, day_of_run, remaining_of
from gateway.workflow.results.report import ReportPaths, write_report
from gateway.workflow.run.outcome import Outcome
from gateway.workflow.run.self_test import self_test_site


def run(at: ServedSite, clock: Clock) -> Work:
    """Measure every axis and propose."""

    async def work(say: Say) -> object:
        return await run_site(at.site, at.path, apply=False, machine_name="", clock=clock, say=say)

    return work


def remaining_of_run(at: ServedSite) -> RemainingTime:
    """The time to go of `run`, by the forecast of its day."""
    return remaining_of(lambda: day_of_run(at.site, apply=False))


def remaining_of_measuring(at: ServedSite, wanted: tuple[str, ...]) -> RemainingTime:
    """The time to go of `measure`."""
    return remaining_of(lambda: day_of_measuring(at.site, wanted))


def remaining_of_closing(at: ServedSite, *, apply: bool) -> RemainingTime:
    """The time to go of `close`."""
    return remaining_of(lambda: day_of_closing(at.site, at.path, apply=apply))


def measure(at: ServedSite, clock: Clock, wanted: tuple[str, ...], resume: RunFolder | None) -> Work:
    """Measure the plan, then make the report."""

    async def work(say: Say) -> object:
        tooth = _tooth(at.site, at.path)
        outcome = await measure_site(at.site, at.path, clock=clock, say=say, wanted=wanted, resume=resume, tooth=tooth)
        write_report(RunFolder(Path(outcome.run_folder)))
        return Outcome(outcome.state, outcome.run_folder, rows=(), lines=outcome.advice, data=outcome.as_data())

    return work


def _tooth(site: SiteFile, path: Path) -> Any:
    """The work the site file names; None without. Raises what reading a gear file raises."""
    if site.work is None:
        return None
    file = load_gear(path.parent / site.work.gear)
    return ToothSpec(gear_of(file), file.grinding.centre_distance_mm, site.work.height_mm)


def close(at: ServedSite, clock: Clock, body: bodies.Close, resume: RunFolder | None) -> Work:
    """The whole loop."""

    async def work(say: Say) -> object:
        asked: dict[str, Any] = {"apply": body.apply, "machine_name": body.machine, "resume": resume}
        asked["back"] = not body.keep_worse
        with take_risk(body.risk):
            return await close_site(at.site, at.path, clock=clock, say=say, **asked)

    return work


def push(folder: RunFolder, clock: Clock, body: bodies.Push) -> Work:
    """A stored proposal shown, or written."""

    async def work(say: Say) -> object:
        with take_risk(body.risk):
            return await push_run(folder, apply=body.apply, machine_name=body.machine, clock=clock, say=say)

    return work


def disable(at: ServedSite, clock: Clock, body: bodies.Disable) -> Work:
    """One table off."""

    async def work(say: Say) -> object:
        asked: dict[str, Any] = {"axis": body.axis, "table": body.table, "apply": body.apply}
        return await disable_site(at.site, at.path, machine_name=body.machine, clock=clock, say=say, **asked)

    return work


def roll_back(at: ServedSite, clock: Clock, body: bodies.RollBack) -> Work:
    """The table before the last push."""

    async def work(say: Say) -> object:
        asked: dict[str, Any] = {"table": body.table, "apply": body.apply, "machine_name": body.machine}
        return await roll_back_site(at.site, at.path, clock=clock, say=say, **asked)

    return work


def recover(at: ServedSite, clock: Clock, body: bodies.Recover) -> Work:
    """What was left, and what was done about it."""

    async def work(say: Say) -> object:
        asked: dict[str, Any] = {"apply": body.apply, "machine_name": body.machine, "choice": body.choice}
        found = await recover_site(at.site, at.path, clock=clock, say=say, **asked)
        data = {"findings": [one.as_data() for one in found]}
        lines = tuple(line for one in found for line in one.said_at_last)
        return Outcome("recovered", "", rows=(), lines=lines, data=data)

    return work


def verify(at: ServedSite, clock: Clock, body: bodies.Verify, run: RunFolder | None) -> Work:
    """Live tables against what was pushed or proposed."""

    async def work(say: Say) -> object:
        return await verify_table(at.site, at.path, table=body.table, run=run, clock=clock, say=say)

    return work


def self_test(at: ServedSite, clock: Clock, axis: str) -> Work:
    """Every word of our programs, tried by the control."""

    async def work(say: Say) -> object:
        return await self_test_site(at.site, at.path, axis=axis, clock=clock, say=say)

    return work


async def approved(
    folder: RunFolder,
    clock: Clock,
    *,
    table: str,
    typed_name: str,
    actor: str,
    kept_by: tuple[str, ...],
    signer: Signer | None,
) -> tuple[Approval, ...]:
    """Consent, as on the command line: the same single-use record."""
    who: dict[str, Any] = {"actor": actor, "kept_by": kept_by, "signer": signer}
    return await approve_plan(folder, table=table, typed_name=typed_name, clock=clock, **who)


def reported(folder: RunFolder) -> ReportPaths:
    """A run's report, made anew."""
    return write_report(folder)
