"""The wheel in a closing run: what it has to do with the part, when it is dressed, and whether that did what it should.

The run's consent covers the advice to dress; a person gives the dresser its table and dresses. Where the site names no
dresser, or its sense is not proved, the wheel stays as it is and its form stays on the floor.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drivers.errors import ConfigError
from drivers.message import Message, fixed
from gateway.domain.grinding_process import (
    CorrectionOrder,
    CorrectionStep,
    Separation,
    UnexplainedField,
    WheelVerdict,
)
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear
from gateway.process.order import DriveOfOrder, form_on, order_corrections
from gateway.process.wheel import WheelCorrection, predicted_form, wheel_correction
from gateway.reducer.goal import DriveGoal
from gateway.study.dresser import Dresser, dresser_text, load_dresser, wheel_text
from gateway.study.inputs import gear_of
from gateway.tooth import FlankMap, InspectedFlank, ToothProposal
from gateway.workflow.run import stages
from gateway.workflow.run.context import RunContext
from gateway.workflow.tooth.part_plan import gear_of_site, work_section
from gateway.workflow.tooth.processing import separate_part
from gateway.workflow.tooth.verdict import beside

COVERAGE, LEAST_UM = 2.0, 0.1
DRESSER_FILE, POINTS_FILE = "wheel-dresser.csv", "wheel-points.csv"


def propose_wheel(
    at: RunContext, before: InspectedFlank, tooth: ToothProposal, goal: DriveGoal | None
) -> CorrectionOrder | None:
    """Store and tell what tables, set-up values and wheel give on the part, the best first; files for the dresser.

    None where the part does not tell: that is said, and stops nothing. Raises StoreError, ConfigError (E-STUDY-...).
    """
    folder = at.folder
    if folder.has(stages.ORDER):
        return folder.get(stages.ORDER, CorrectionOrder)
    drive = None
    if goal is not None:
        told = tooth.drive
        drive = DriveOfOrder(goal.drive, 0.0 if told is None else told.transmission_u_arcsec)
    try:
        outcome = separate_part(at.site, at.site_path, folder, before)
        gear = gear_of(outcome.gear)
        dresser = _dresser(at)
        dressed = None if dresser is None else _correction(at, outcome.found, dresser)
        order = order_corrections(
            gear,
            before,
            outcome.found,
            tooth.prediction,
            correction_um=None if dressed is None else dressed.correction_um,
            drive=drive,
        )
    except ModelError as error:
        at.say("P-WHEEL-UNKNOWN", part=before.part, why=error.message)
        return None
    folder.put(stages.ORDER, order, (folder.digest(stages.separated(before.part)), folder.digest(stages.TOOTH)))
    for line in order_lines(order):
        at.say("P-CORRECTIONS", line=line)
    if dresser is not None and dressed is not None:
        folder.write_text(DRESSER_FILE, dresser_text(dresser.data, dressed))
        folder.write_text(POINTS_FILE, wheel_text(dressed))
    return order


def order_lines(order: CorrectionOrder) -> tuple[Message, ...]:
    """The order for people, a line for each step and one for the floor."""
    floor = Message.of("S-CORRECTIONS-FLOOR", floor=fixed(order.floor_um), with_form=fixed(order.undressed_floor_um))
    return (*map(_step_line, order.steps), floor)


def _step_line(step: CorrectionStep) -> Message:
    told = {"name": Message.of(_NAMES[step.name]), "flank": fixed(step.flank_um), "u": fixed(step.u_um)}
    if step.transmission_arcsec is None or step.transmission_u_arcsec is None:
        return Message("S-CORRECTIONS-STEP", told)
    told |= {"drive": fixed(step.transmission_arcsec, 1), "drive_u": fixed(step.transmission_u_arcsec, 1)}
    return Message("S-CORRECTIONS-STEP-DRIVE", told)


_NAMES = {
    "as ground": "S-CORRECTION-AS-GROUND",
    "set-up": "S-CORRECTION-SETUP",
    "tables": "S-CORRECTION-TABLES",
    "wheel": "S-CORRECTION-WHEEL",
}


def _dresser(at: RunContext) -> Dresser | None:
    """The site's dresser, if its sense is proved; why not is said. Raises ConfigError (E-STUDY-...)."""
    named = work_section(at.site).dresser_file
    if not named:
        return None
    dresser = load_dresser(at.site_path.parent / Path(named))
    try:
        dresser.demand_proved()
    except ConfigError as error:
        at.say("P-WHEEL-STAYS", why=error.message)
        return None
    return dresser


def _correction(at: RunContext, found: Separation, dresser: Dresser) -> WheelCorrection | None:
    """What to give the dresser; None where that is nothing, or more than it may take, which is said."""
    file = gear_of_site(at.site, at.site_path)
    distance = file.grinding.centre_distance_mm
    limits = {"diamond_mm": dresser.data.diamond_radius_mm, "limit_um": dresser.data.limit_um}
    try:
        return wheel_correction(gear_of(file), distance, found, **limits)
    except ModelError as error:
        at.say("P-WHEEL-STAYS", why=error.message)
        return None


def tell_dressing(at: RunContext, part: str) -> None:
    """What a person gives the dresser before this part is ground; nothing where the wheel stays."""
    folder = at.folder
    if DRESSER_FILE in folder.files and not folder.has(stages.ground(part)):
        at.say("P-WHEEL-DRESS", part=part, file=str(folder.path / DRESSER_FILE))


def judge_wheel(at: RunContext, first: str, part: InspectedFlank) -> WheelVerdict | None:
    """Whether the dressing left of the wheel's form what it should, by the parts before and after it; stored and told.

    None where nothing was to be dressed, or the part does not tell.
    """
    folder = at.folder
    if DRESSER_FILE not in folder.files:
        return None
    before = folder.get(stages.separated(first), Separation)
    dresser = _dresser(at)
    dressed = None if dresser is None else _correction(at, before, dresser)
    if dressed is None:
        return None
    try:
        after = separate_part(at.site, at.site_path, folder, part).found
    except ModelError as error:
        at.say("P-WHEEL-UNKNOWN", part=part.part, why=error.message)
        return None
    wanted = predicted_form(before.form, dressed)
    theta = np.asarray(after.form.theta_rad)
    missed = np.asarray(after.form.deviation_um) - form_on(theta, wanted, np.asarray(wanted.deviation_um))
    square = np.asarray(after.form.u_um) ** 2 + form_on(theta, wanted, np.asarray(wanted.u_um)) ** 2
    u = float(np.sqrt(np.mean(square)))
    verdict = WheelVerdict(
        before_um=before.share("wheel").rms_um,
        predicted_um=_rms(np.asarray(wanted.deviation_um)),
        after_um=after.share("wheel").rms_um,
        missed_um=_rms(missed),
        u_um=u,
        held=_rms(missed) <= max(COVERAGE * u, LEAST_UM),
    )
    folder.put(stages.WHEEL_VERDICT, verdict, (folder.digest(stages.separated(part.part)),))
    told = {"before": verdict.before_um, "after": verdict.after_um, "missed": verdict.missed_um, "u": u}
    figures = {key: fixed(value) for key, value in told.items()}
    at.say("P-WHEEL-HELD" if verdict.held else "P-WHEEL-MISSED", part=part.part, **figures)
    return verdict


def tell_unexplained(at: RunContext, trial: InspectedFlank, after: InspectedFlank, tooth: ToothProposal) -> None:
    """What both corrected parts show alike beside the prediction: no measurement explains it, and tables may hold it.

    Stored, and told with the command that proposes such tables where it is surely there.
    """
    gear = gear_of(gear_of_site(at.site, at.site_path))
    found = unexplained_field(gear, trial, after, tooth.prediction.after)
    at.folder.put(stages.UNEXPLAINED, found, (at.folder.digest(stages.inspected(after.part)),))
    if found.sure:
        told = {"common": found.common_um, "u": found.u_um, "stroke": found.over_z_um, "turn": found.over_c_um}
        figures = {key: fixed(value) for key, value in told.items()}
        at.say("P-CLOSE-UNEXPLAINED", run=at.folder.run_id, part=after.part, site=str(at.site_path), **figures)


def unexplained_field(
    gear: CycloidGear, first: InspectedFlank, second: InspectedFlank, predicted: FlankMap
) -> UnexplainedField:
    """What two parts ground with the same tables show alike beside their prediction, without set-up and clamping; pure.

    Half the difference of the parts is how well the common part is known.
    """
    maps = [beside(gear, one.fitted, predicted) for one in (first, second)]
    common, half = 0.5 * (maps[0] + maps[1]), 0.5 * (maps[0] - maps[1])
    u = _rms(half)
    along = common.mean(axis=0, keepdims=True)
    size = float(np.sqrt(max(_rms(common) ** 2 - u**2, 0.0)))
    return UnexplainedField(common_um=size, u_um=u, over_z_um=_rms(along), over_c_um=_rms(common - along))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.asarray(values) ** 2)))
