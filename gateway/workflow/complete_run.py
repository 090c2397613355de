"""Whole runs: `run_site` for the axes, `close_site` from all errors to the part that proves the tables.

`run_site`: measure every axis, store a proposal; with consent push it, measure the pushed axes again and judge.

`close_site`: measure all set-ups and fit one error model, grind and inspect the part "before", propose both layers and
set-up values, push the axis tables, judge the axes, push the cross tables, check each axis that they act on. Then a
part "trial" with the predicted set-up values and a part "after" with those that the trial asks for decide on the tooth.
Where the flank became worse, the tables are rolled back. Every step is stored before the next, and a resumed run does
only what is not stored.
"""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

from drivers.clock import Clock
from drivers.errors import ConfigError, TrueflankError
from drivers.message import Message
from gateway import audit
from gateway.capture.rig import turning_instrument
from gateway.config import SiteFile
from gateway.correct.part.inspected import setup_from_part
from gateway.domain.outcomes import Verdict
from gateway.domain.proposals import Proposal
from gateway.events import PartStarted, RunStarted
from gateway.model.error_model import ErrorModel
from gateway.say import Say
from gateway.store import RunFolder
from gateway.store.machine_books import SetupBook
from gateway.tooth import InspectedFlank, SetupValues, ToothProposal, ToothVerdict
from gateway.workflow.axes.measure import MeasuredAxis, measure_axis, plans_of_axis, store_equipment
from gateway.workflow.axes.propose import propose
from gateway.workflow.axes.short_capture import verify_combined_effect
from gateway.workflow.control.push import apply_proposal
from gateway.workflow.control.rollback import roll_back_run
from gateway.workflow.control.setup_values import hand_over_change, require_senses
from gateway.workflow.errors21.measurement import ChoosesSetups, measure_site
from gateway.workflow.errors21.setup_capture import axes_from_setups
from gateway.workflow.results.endings import closing_outcome, finish
from gateway.workflow.run import self_test, stages
from gateway.workflow.run.audit_trail import report_log_problem
from gateway.workflow.run.context import RunContext, check_name, open_context, with_axes
from gateway.workflow.run.folder import new_run
from gateway.workflow.run.live_tables import standing_alarms
from gateway.workflow.run.outcome import Outcome, with_alarms
from gateway.workflow.tooth.builder_cycle import cycle_of_run, grind_by_cycle
from gateway.workflow.tooth.grinding import grind_part, same_machine
from gateway.workflow.tooth.inspection import inspect_part, inspector_name
from gateway.workflow.tooth.part_plan import entry_instructions, work_section
from gateway.workflow.tooth.proposal import ToothWork, propose_tooth, work_of
from gateway.workflow.tooth.verdict import BEFORE, contradicts_model, judge_tooth


async def run_site(
    site: SiteFile,
    site_path: Path,
    *,
    apply: bool,
    machine_name: str,
    clock: Clock,
    say: Say,
    axes: Collection[str] = (),
) -> Outcome:
    """Do a whole run. Without `apply` it ends with a stored proposal and nothing is written.

    ``axes`` are the only ones to be measured; none named: all. `machine_name` must be the site's name when `apply` is
    set (WriteRefused E-RUN-NAME), and the site must have the axes (ConfigError E-RUN-AXIS), before anything is opened.
    Any failure is noted in the run folder and raised again.
    """
    check_name(site, apply, machine_name)
    site = with_axes(site, axes)
    folder = new_run(site, site_path, utc=clock.utc)
    RunStarted(str(folder.path)).tell(say)
    try:
        async with open_context(site, site_path, folder=folder, clock=clock, say=say) as at:
            return await _measure_and_push(at, apply=apply)
    except TrueflankError as error:
        folder.set_state("failed", error=error.as_record())
        raise


async def _measure_and_push(at: RunContext, *, apply: bool) -> Outcome:
    if apply:
        self_test.require_self_tests(at)
    live = [axis for axis in at.site.axes if axis.measure.file is None]
    for axis in live:
        if axis.kind == "rotary":
            turning_instrument(axis, at.rig(axis).instrument)  # before hours of the other axes
    store_equipment(at)
    await at.foresee([plan for axis in live for plan in plans_of_axis(axis, "before")])
    measured = {axis.name: await measure_axis(at, axis, "before") for axis in at.site.axes}
    await at.foresee(())
    proposal = await propose(at, measured)
    at.folder.set_state("proposed")
    verdict = await apply_proposal(at, proposal, measured) if apply else None
    return with_alarms(finish(at.folder, measured, proposal, verdict), standing_alarms(at))


# The closing run: every error measured, parts ground and inspected, both layers pushed, judged on axis and tooth.

TRIAL, AFTER = "trial", "after"


async def close_site(
    site: SiteFile,
    site_path: Path,
    *,
    apply: bool,
    machine_name: str,
    clock: Clock,
    say: Say,
    resume: RunFolder | None = None,
    back: bool = True,
    wanted: Sequence[str] = (),
    cycle: str = "",
    chooses: ChoosesSetups | None = None,
) -> Outcome:
    """Do the whole loop, or go on with a run that stopped: what is stored is not done again.

    ``wanted`` are the set-ups to be measured, by key; none: all of the plan, or those that ``chooses`` takes of it.
    ``cycle`` names the builder's program that a person runs for each part in place of ours.

    Without `apply` it ends with a stored proposal for the tooth; nothing is ground or written. Where the flank became
    worse than it was the run takes its tables ``back`` as its last step: part of the consent given here. Raises
    WriteRefused (E-RUN-NAME), ConfigError (E-CLOSE-WORK, E-CLOSE-AXES, E-CLOSE-PLACE, E-INSPECT-INSPECTOR),
    IllegalTransition (E-SETUP-MACHINE), CaptureError (E-PART-APART), and what the stages raise; the folder
    keeps every stage done and the error.
    """
    check_name(site, apply, machine_name)
    work = work_of(site, site_path)
    if apply and not cycle and resume is None and not work_section(site).wheel_place:
        raise ConfigError("E-CLOSE-PLACE", site.site.name)
    used = {axis.measure.instrument for axis in site.axes if axis.measure.instrument}
    used |= {inspector_name(site)} if apply else set()
    asked: dict[str, Any] = {"wanted": wanted, "resume": resume, "tooth": work.tooth, "chooses": chooses}
    plan = await measure_site(site, site_path, clock=clock, say=say, **asked)
    folder = RunFolder(Path(plan.run_folder))
    try:
        async with open_context(site, site_path, folder=folder, clock=clock, say=say, instruments=used) as at:
            await _ClosingRun(at, work, plan.model, axes_from_setups(folder, site), back, cycle).close(apply=apply)
            alarms = standing_alarms(at)
    except TrueflankError as error:
        folder.set_state("failed", error=error.as_record())
        raise
    except asyncio.CancelledError:
        folder.set_state("stopped")
        raise
    return with_alarms(closing_outcome(folder, site), alarms)


def _wheel_in_run() -> ModuleType:
    """What a closing run knows of the wheel: loaded when a part is there, for it takes its time."""
    from gateway.workflow.tooth import wheel_in_run  # noqa: PLC0415

    return wheel_in_run


@dataclass(frozen=True)
class _ClosingRun:
    """One closing run at the machine: the gear, what is known of the machine, its axes as measured."""

    at: RunContext
    work: ToothWork
    model: ErrorModel
    measured: dict[str, MeasuredAxis]
    back: bool = True
    asked: str = ""

    async def close(self, *, apply: bool) -> None:
        at, folder = self.at, self.at.folder
        same_machine(at)
        if apply and not folder.has(stages.VERDICT):
            self_test.require_self_tests(at)
        if self._was_rolled_back:
            folder.set_state("worse")
            return
        if apply and not folder.has(stages.VERDICT):
            at.say("P-CLOSE-BACK" if self.back else "P-CLOSE-BACK-NOT")
        cycle = cycle_of_run(at, self.asked, BEFORE)
        if apply and cycle:
            require_senses(at)
        elif apply and not work_section(at.site).wheel_place:
            raise ConfigError("E-CLOSE-PLACE", at.site.site.name)
        book, name = SetupBook(at.store.root), f"{self.work.name} {cycle}".strip()
        now = book.current(at.machine, name)
        before = await self._part(BEFORE, now, cycle) if apply else None
        proposal, tooth = await self._proposal()
        if before is None:
            folder.set_state("proposed")
            return
        wheel = _wheel_in_run()
        wheel.propose_wheel(at, before, tooth, self.work.goal)
        verdict = await self._push_tables(proposal)
        if verdict.outcome == "not-pushed":
            lacks = setup_from_part(before, self.work.gear).setup.rounded()
            at.say("P-CLOSE-NOTHING", x=lacks.x_um, c=lacks.c_arcsec, dressing=lacks.dressing_um)
            folder.set_state(verdict.outcome)
            return
        await verify_combined_effect(self.at)
        tooth = folder.get(stages.TOOTH, ToothProposal)  # as it is with the tables that were pushed
        first = now.plus(self._expected_flank(before, tooth))
        wheel.tell_dressing(at, TRIAL)
        trial = await self._part(TRIAL, first, cycle, had=now)
        setup = first.plus(setup_from_part(trial, self.work.gear).setup)
        after = await self._part(AFTER, setup, cycle, had=first)
        wheel.judge_wheel(at, BEFORE, after)
        wheel.tell_unexplained(at, trial, after, tooth)
        judged = judge_tooth(before, after, tooth.prediction, gear=self.work.gear, trial=trial)
        if judged.outcome != "worse":
            book.save(at.machine, name, setup, run=folder.run_id, clock=at.clock)
            if not cycle:
                at.say("P-SETUP-ENTER", words=entry_instructions(work_section(at.site), setup))
        folder.put(stages.TOOTH_VERDICT, judged, (folder.digest(stages.inspected(AFTER)),))
        worse = "worse" in (judged.outcome, verdict.outcome)
        if worse and judged.outcome != "better":
            await self._roll_back_tables(judged)
            if cycle and self.back:
                at.say("P-HAND-STAYS", site=str(at.site_path))
        folder.set_state("worse" if worse else judged.outcome)

    @property
    def _was_rolled_back(self) -> bool:
        stored = self.at.folder.has(stages.TOOTH_VERDICT)
        return stored and bool(self.at.folder.get(stages.TOOTH_VERDICT, ToothVerdict).taken_back)

    async def _roll_back_tables(self, judged: ToothVerdict) -> None:
        """All tables that acted before are put back as the run's next step, and the verdict says so.

        Raises as `roll_back_run`, after it is known what is back and what stays on: then the next resume tries again.
        """
        at = self.at
        if not self.back:
            at.say("P-CLOSE-STAYS")
            return
        at.say("P-CLOSE-GOING-BACK")
        told = {
            "run": at.folder.run_id,
            "flank": judged.outcome,
            "before": judged.before_anew_um,
            "after": judged.after_um,
        }
        report_log_problem(
            at, audit.note(at.store.root, "close-goes-back", clock=at.clock, serial=at.machine.serial, details=told)
        )
        done = await roll_back_run(at)
        if done is not None:
            said = (*judged.words, Message.of("W-CLOSE-TAKEN-BACK"), *done.lines)
            record = replace(judged, words=said, taken_back=done.lines)
            at.folder.put(stages.TOOTH_VERDICT, record, at.folder.parents(stages.TOOTH_VERDICT))

    def _expected_flank(self, before: InspectedFlank, tooth: ToothProposal) -> SetupValues:
        """What the part before lacks, and what the tables will change of that by the model."""
        modelled = setup_from_part(replace(before, fitted=tooth.prediction.before), self.work.gear).setup
        return setup_from_part(before, self.work.gear).setup.plus(tooth.setup).less(modelled)

    async def _part(self, part: str, setup: SetupValues, cycle: str, had: SetupValues | None = None) -> InspectedFlank:
        """Grind and inspect a part; what the folder holds already is not done again. ``had`` are the values before it.

        But for the inspection of a part that contradicts the model where no error explains it.
        """
        folder = self.at.folder
        if folder.has(stages.inspected(part)) and not (part == BEFORE and contradicts_model(folder)):
            return folder.get(stages.inspected(part), InspectedFlank)
        PartStarted(part, **asdict(setup)).tell(self.at.say)
        if not folder.has(stages.ground(part)) and cycle:
            if had is not None:
                await hand_over_change(self.at, part, setup.less(had))
            await grind_by_cycle(self.at, part, setup, cycle)
        elif not folder.has(stages.ground(part)):
            await grind_part(self.at, part, setup)
        found = await inspect_part(self.at, part)
        self.at.say("P-PART-DONE", part=part, rms_um=found.fitted.rms_um)
        return found

    async def _proposal(self) -> tuple[Proposal, ToothProposal]:
        """The stored one, unless it rests on what was measured anew since and nothing of it was pushed."""
        folder = self.at.folder
        if folder.has(stages.TOOTH) and (self._push_has_started or folder.parents(stages.PROPOSAL) == self._parents):
            return folder.get(stages.PROPOSAL, Proposal), folder.get(stages.TOOTH, ToothProposal)
        return await propose_tooth(self.at, self.model, self.measured, self.work)

    @property
    def _push_has_started(self) -> bool:
        return any(stage.startswith(stages.push("")) for stage in self.at.folder.stages)

    @property
    def _parents(self) -> tuple[str, ...]:
        return self.at.folder.digest(stages.ERRORS), *(item.digest for item in self.measured.values())

    async def _push_tables(self, proposal: Proposal) -> Verdict:
        folder = self.at.folder
        if folder.has(stages.VERDICT):
            return folder.get(stages.VERDICT, Verdict)
        return await apply_proposal(self.at, proposal, self.measured)
