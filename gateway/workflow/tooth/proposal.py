"""What a run proposes for the tooth: each axis' own tables, cross tables on top, set-up values, a prediction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from drivers.clock import Clock
from drivers.errors import ConfigError, TrueflankError
from drivers.message import Message, fixed
from drivers.terms import spoken
from drivers.types.tables import CompensationTable, LiveSet
from gateway.config import SiteFile
from gateway.correct.flank.compensability import tangential_cure
from gateway.correct.flank.noise import noise_patterns
from gateway.correct.flank.tables import Table
from gateway.correct.outlook.drive_outlook import costliest, drive_proposal
from gateway.correct.outlook.flank_uncertainty import ProcessUncertainty, ToothSpec, doubts, error_doubts
from gateway.correct.outlook.prediction import Prediction, diagnose_sampling, predict, select_cross_tables
from gateway.correct.outlook.ranking import cure_errors, rank_errors
from gateway.correct.plan.layers import LayeredCorrection, correct
from gateway.correct.plan.plan import CROSS, Plan, cross_specs, table_record
from gateway.domain.equipment import Equipment
from gateway.domain.proposals import Proposal, TableChange
from gateway.errors import IllegalTransition
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import FlankGrid, flank_grid
from gateway.gear.grinding import Grinding
from gateway.gear.process_drift import set_right
from gateway.model.error_model import ErrorModel, chain_of_errors
from gateway.reducer.goal import LIMITS, DriveGoal, goal_of
from gateway.say import Say
from gateway.store import RunFolder
from gateway.study.drive import reducer_of
from gateway.study.inputs import GearFile, gear_of, load_gear
from gateway.table.limits import second_person_finding
from gateway.tooth import DriveProposal, ToothProposal
from gateway.workflow.axes.cross_tables import acting_cross, cross_changes, table_places
from gateway.workflow.axes.measure import MeasuredAxis
from gateway.workflow.axes.propose import axis_changes, size_of, store_proposal
from gateway.workflow.errors21.measurement import grids
from gateway.workflow.errors21.setup_capture import axes_from_setups
from gateway.workflow.run import stages
from gateway.workflow.run.context import RunContext, open_context
from gateway.workflow.tooth.known_machine import drift_warning, noise_warning, shop_of, with_between
from gateway.workflow.tooth.messages import (
    doubted_tables_message,
    drive_messages,
    explanatory_messages,
    full_correction_outlooks,
    measure_better,
    one_way_message,
    outlook_messages,
    required_messages,
)
from gateway.workflow.tooth.verdict import compare_part_with_model

PROFILE, WIDTH = 11, 5


@dataclass(frozen=True, slots=True)
class ToothWork:
    """What is ground: the gear by its file's name, centre distance and height over the table's zero (mm), who inspects.

    ``inspector`` is the site's gear inspection machine; "" where results come as files. ``goal`` is what of the drive
    counts; None without a reducer in the gear file.
    """

    name: str
    gear: CycloidGear
    centre_distance_mm: float
    height_mm: float
    inspector: str = ""
    goal: DriveGoal | None = None

    @property
    def tooth(self) -> ToothSpec:
        """The same for the advice on what to measure."""
        return ToothSpec(self.gear, self.centre_distance_mm, self.height_mm)


def work_of(site: SiteFile, site_path: Path) -> ToothWork:
    """The work that the site file names. Raises ConfigError (E-CLOSE-WORK, E-STUDY-...), ModelError (E-GEAR-...)."""
    if site.work is None:
        raise ConfigError("E-CLOSE-WORK", site.site.name)
    file = load_gear(site_path.parent / site.work.gear)
    distance = file.grinding.centre_distance_mm
    gear = gear_of(file)
    return ToothWork(
        name=file.name,
        gear=gear,
        centre_distance_mm=distance,
        height_mm=site.work.height_mm,
        inspector=site.work.inspector,
        goal=_goal_of(site, file, gear),
    )


def _goal_of(site: SiteFile, file: GearFile, gear: CycloidGear) -> DriveGoal | None:
    """What the site asks of the drive. Raises ConfigError (E-GOAL-REDUCER) where the gear file names none."""
    asked = site.gear.goal
    limits = {name: value for name in LIMITS if (value := getattr(asked, name)) is not None}
    if file.reducer is None:
        if asked.kind != "rms" or limits:
            raise ConfigError("E-GOAL-REDUCER", site.site.name, kind=asked.kind, gear=file.name)
        return None
    weights = (asked.rms, asked.transmission, asked.lost_motion)
    return goal_of(asked.kind, reducer_of(file.reducer, gear), weights, limits)


async def propose_tooth(
    at: RunContext, model: ErrorModel, measured: Mapping[str, MeasuredAxis], work: ToothWork
) -> tuple[Proposal, ToothProposal]:
    """Work out, store and hand back both layers (axis tables first, then cross tables), set-up values and prediction.

    ``model`` is what the run's set-ups told, ``measured`` the axes' own positioning by machine axis; all of it was
    captured while the same tables acted. Nothing for the tooth is proposed that would correct less than its
    uncertainty, and nothing at all where the part that was ground before contradicts the model. Raises TableError
    (E-COMP-...), CaptureError (E-RUN-LIVE, E-PART-APART...), ModelError (E-CORRECT-...).
    """
    own = await axis_changes(at, measured)
    model = with_between(model, at.folder, at.site)
    live = {name: item.capture.live for name, item in measured.items() if item.capture.live is not None}
    task = _Task.of(at, model, measured, work, own=own, live=live)
    against = compare_part_with_model(
        at, measured, task.grinding, task.grid, plan=task.plan, model=model, shop=task.shop
    )
    paired = [one.new.index for one in own if one.new.kind == "cross" and not one.skipped]
    plan, nowhere = await task.placed(at, paired)
    chosen = select_cross_tables(plan, task.one)
    found, outlook, gains = chosen.found, chosen.outlook, chosen.told
    cross = await cross_changes(at, found.optimum.tables, task.grinding.chain, live=live, adds=False, spoken_for=paired)
    if not gains.sure:
        cross = tuple(_label_likely_gain(one, gains) for one in cross)
    parents = (at.folder.digest(stages.ERRORS), *(item.digest for item in measured.values()))
    proposal = store_proposal(at, tuple(_label_part_objection(one, against) for one in (*own, *cross)), parents)
    tooth = ToothProposal(
        setup=found.setup.rounded(),
        prediction=outlook.flank,
        cures=cure_errors(task.grinding, task.grid, task.plan, model),
        ranking=rank_errors(task.grinding, task.grid, task.plan, model),
        b_left=tangential_cure(work.gear, task.grid.thetas).eta,
        eccentricity_um=found.moved.eccentricity_um,
        tilt_arcsec=found.moved.tilt_arcsec,
    )
    looked = (Message.of("W-PART-LOOK", **against),) if against else ()
    left = (
        *looked,
        *nowhere,
        *(task.alone(plan, outlook) if nowhere else ()),
        *_left_alone(own),
        *doubted_tables_message(chosen),
    )
    worst = diagnose_sampling(task.grinding, task.grid, model, outlook.flank)
    needed = (*required_messages(tooth, model, found=found, gains=gains, left_alone=left), *measure_better(worst))
    if work.goal is not None:
        tooth = replace(tooth, drive=task.drive(plan, found, work.goal))
    axes = full_correction_outlooks(own, cross)
    index = task.names[task.grinding.index]
    turns = one_way_message(index, measured[index].capture, at.site.work, own, lever_mm=task.grid.section.h)
    why = (
        *explanatory_messages(tooth, model, found),
        *drift_warning(task.shop, at.site.work),
        *noise_warning(measured),
        *turns,
    )
    why = (*why, *outlook_messages(axes), *drive_messages(tooth.drive))
    tooth = replace(tooth, axes=axes, said=(*needed, *why), background=why)
    at.folder.put(stages.TOOTH, tooth, (at.folder.digest(stages.PROPOSAL), *parents))
    return proposal, tooth


def _label_likely_gain(change: TableChange, gains: Prediction) -> TableChange:
    """A cross table whose gain is likely but not certain: a second person is asked."""
    figures = {"gain": fixed(gains.gain_um), "u": fixed(gains.gain_u_um), "worse": fixed(100.0 * gains.worse, 0)}
    return replace(change, findings=(*change.findings, second_person_finding("W-TOOTH-CHANCE", change.name, **figures)))


def _label_part_objection(change: TableChange, against: Mapping[str, str]) -> TableChange:
    """A table with what the part has against it: a second person is asked."""
    if change.skipped or not against:
        return change
    return replace(change, findings=(*change.findings, second_person_finding("W-PART-LOOK", change.name, **against)))


def _left_alone(own: Sequence[TableChange]) -> tuple[Message, ...]:
    return tuple(Message.of("S-TABLE-WHY", name=change.name, why=change.skipped) for change in own if change.skipped)


@dataclass(frozen=True)
class _Task:
    """The fitted machine with its gear, what is planned and what acted, all in the chain's letters."""

    grinding: Grinding
    grid: FlankGrid
    plan: Plan
    model: ErrorModel
    shop: ProcessUncertainty
    own: tuple[CompensationTable, ...]
    acted: tuple[CompensationTable, ...]
    live: Mapping[str, LiveSet]
    names: Mapping[str, str]

    @classmethod
    def of(
        cls,
        at: RunContext,
        model: ErrorModel,
        measured: Mapping[str, MeasuredAxis],
        work: ToothWork,
        own: Sequence[TableChange],
        live: Mapping[str, LiveSet],
    ) -> _Task:
        letters = {axis.name: axis.letter for axis in at.site.axes}
        chain = chain_of_errors(model, height_mm=work.height_mm)
        grinding = Grinding(chain, work.gear, work.centre_distance_mm)
        grid = flank_grid(work.gear, profile=PROFILE, width=WIDTH)
        # A C zero turns the whole gear, which no figure counts: it stays as it is.
        plan = Plan(grids(at.site), zeros=("X",), goal=work.goal)
        plan = replace(plan, noise=noise_patterns(grinding, grid, doubts(model, chain, plan)))
        acting = [one.own.table for one in live.values() if one.own.enabled]
        return cls(
            grinding,
            grid,
            plan,
            model,
            shop_of(at.site.work, {letters.get(name, name): one.capture for name, one in measured.items()}, grinding),
            tuple(_in_chain_letters(one.new, letters) for one in own if one.new.kind == "axis" and not one.skipped),
            tuple(_in_chain_letters(one, letters) for one in (*acting, *acting_cross(at, live))),
            live,
            {letter: name for name, letter in letters.items()},
        )

    async def placed(self, at: RunContext, paired: Sequence[int]) -> tuple[Plan, tuple[Message, ...]]:
        """The plan with the cross tables that have room beside the ``paired`` numbers, and why the others have none."""
        chain = self.grinding.chain
        able = tuple(one for one in CROSS if self.names.get(one[0]) in self.live and self.plan.has(one[1]))
        specs = cross_specs(chain, replace(self.plan, cross=able))
        blank = [Table(spec.grid, np.zeros_like(spec.grid.nodes)) for spec in specs]
        records = [table_record(chain, one, "cross", names=self.names) for one in blank]
        places = await table_places(at, records, self.live, spoken_for=paired)
        if any(place.full for place in places):
            places = await table_places(at, records, self.live, self._by_gain(able), spoken_for=paired)
        cross = tuple(one for one, place in zip(able, places, strict=True) if not place.reason)
        return replace(self.plan, cross=cross), tuple(place.reason for place in places if place.reason)

    def _by_gain(self, able: tuple[tuple[str, str], ...]) -> tuple[int, ...]:
        """Which tables the flank would miss most, the first one first."""
        missed = [self._rms(tuple(one for one in able if one != left)) for left in able]
        return tuple(sorted(range(len(able)), key=lambda n: -missed[n]))

    def _rms(self, cross: tuple[tuple[str, str], ...]) -> float:
        """RMS of the flank with these cross tables at their best, mm."""
        plan = replace(self.plan, cross=cross)
        found = correct(self.grinding, self.grid, plan=plan, live=self.acted, own=self.own)
        return float(found.optimum.best.rms)

    def alone(self, plan: Plan, outlook: Prediction) -> tuple[Message, ...]:
        """What stays on the flank where the control has no place for any cross table, and what these would leave."""
        if plan.cross:
            return ()
        _, could = self.one(self.plan)
        return (
            Message.of("S-TOOTH-ALONE", left=fixed(outlook.flank.after.rms_um), least=fixed(could.flank.after.rms_um)),
        )

    def drive(self, plan: Plan, found: LayeredCorrection, goal: DriveGoal) -> DriveProposal:
        """The drive that the corrected machine's discs make, and what every goal costs in the others."""
        wrong = error_doubts(self.grinding, self.grid, plan, self.model)
        costs = costliest(goal.drive, found.machine, self.grid, doubt=wrong, measured=self.model.measured)
        return drive_proposal(
            self.grinding,
            self.grid,
            plan=plan,
            goal=goal,
            found=found,
            wrong=wrong,
            live=self.acted,
            own=self.own,
            doubts=costs,
        )

    def one(self, plan: Plan) -> tuple[LayeredCorrection, Prediction]:
        """The correction of a plan and its outlook."""
        found = correct(self.grinding, self.grid, plan=plan, live=self.acted, own=self.own)
        return found, predict(self.grinding, self.grid, plan=plan, model=self.model, found=found, shop=self.shop)


def _in_chain_letters(table: CompensationTable, letters: Mapping[str, str]) -> CompensationTable:
    """A table of the control in the chain's letters."""
    out, over = (letters.get(name, name) for name in (table.output_axis, table.input_axis))
    return replace(table, output_axis=out, input_axis=over)


# A measured run's proposal for the tooth, worked out at the machine it was measured on; nothing is written to it.


@dataclass(frozen=True, slots=True)
class ToothOutcome:
    """What was proposed and stored; ``fair_before_um`` is the RMS before with the set-up values right."""

    run_folder: str
    proposal: Proposal
    tooth: ToothProposal
    fair_before_um: float

    @property
    def tables(self) -> tuple[tuple[str, str, str], ...]:
        """Each table's name in the proposal, what it is, and its size or why it is none."""
        return tuple(
            (change.name, f"{spoken().kind(change.new.kind)} {change.new.name}", str(change.skipped or size_of(change)))
            for change in self.proposal.changes
        )

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        tooth, flank = self.tooth, self.tooth.prediction
        return {
            "state": "proposed",
            "run_folder": self.run_folder,
            "tables": [_table(change) for change in self.proposal.changes],
            "setup": asdict(tooth.setup),
            "flank": {
                "before_um": flank.before.rms_um,
                "before_set_right_um": self.fair_before_um,
                "with_own_um": flank.with_own.rms_um,
                "after_um": flank.after.rms_um,
                "expected_um": flank.rms_um,
                "expected_u_um": flank.rms_u_um,
                "u_um": flank.u_um,
                "floor_um": flank.floor_um,
                "parts_um": dict(flank.parts_um),
            },
            "ranking": [asdict(one) for one in tooth.ranking],
            "cures": [asdict(one) for one in tooth.cures],
            "b_left": tooth.b_left,
            "eccentricity_um": list(tooth.eccentricity_um),
            "tilt_arcsec": list(tooth.tilt_arcsec),
            "axes": [
                {
                    "axis": one.axis,
                    "M": one.M,
                    "U": one.M_U,
                    "M_alone": one.M_alone,
                    "unit": one.unit,
                    "targets": one.targets.tolist(),
                    "deviation": one.deviation.tolist(),
                    "moved_by": dict(one.moved_by),
                }
                for one in tooth.axes
            ],
            "drive": None if tooth.drive is None else asdict(tooth.drive),
            "said": list(map(str, tooth.said)),
        }


def _table(change: TableChange) -> dict[str, Any]:
    new = change.new
    return {
        "name": change.name,
        "layer": spoken().kind(change.new.kind),
        "table": new.name,
        "index": new.index,
        "points": len(new.deviations),
        "low": min(new.deviations),
        "high": max(new.deviations),
        "unit": new.deviation_unit,
        "skipped": str(change.skipped or ""),
        "findings": [str(one.message) for one in change.findings],
    }


async def correct_site(site: SiteFile, site_path: Path, folder: RunFolder, *, clock: Clock, say: Say) -> ToothOutcome:
    """Propose both layers and set-up values from a measured run; needs the control, no instrument.

    Raises ConfigError (E-CLOSE-WORK, E-CLOSE-AXES), StoreError (E-STORE-STAGE) for a run without an error model,
    IllegalTransition (E-SETUP-MACHINE) at another machine, and what `propose_tooth` raises; the folder keeps the error.
    """
    work = work_of(site, site_path)
    model = folder.get(stages.ERRORS, ErrorModel)
    try:
        async with open_context(site, site_path, folder=folder, clock=clock, say=say, instruments=()) as at:
            return await _propose_at_control(at, model, work)
    except TrueflankError as error:
        folder.set_state("failed", error=error.as_record())
        raise


async def _propose_at_control(at: RunContext, model: ErrorModel, work: ToothWork) -> ToothOutcome:
    folder = at.folder
    different = folder.get(stages.EQUIPMENT, Equipment).machine.differences(at.machine)
    if different:
        raise IllegalTransition("E-SETUP-MACHINE", folder.run_id, fields=", ".join(different))
    proposal, tooth = await propose_tooth(at, model, axes_from_setups(folder, at.site), work)
    folder.set_state("proposed")
    fair = set_right(tooth.prediction.before, work.gear).rms_um
    return ToothOutcome(str(folder.path), proposal, tooth, fair)
