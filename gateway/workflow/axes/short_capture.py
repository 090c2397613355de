"""Short captures of one axis against a curve: the drift guard of an approved run, and all tables acting together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from drivers.clock import Clock
from drivers.errors import ConfigError, TrueflankError
from drivers.message import Message, Quantity, fixed
from drivers.types.stops import StopPlan
from drivers.types.tables import CompensationTable, LiveSet
from drivers.types.values import FloatArray
from drivers.units import DeviationUnit, deviation_unit
from gateway.capture.corrections import from_live
from gateway.capture.live import capture_axis
from gateway.capture.rig import Rig, prove_sense, sense_plan, setup_of
from gateway.capture.targets import measuring_plan, targets_of
from gateway.config import AxisSection, GuardSection, SiteFile, Targets
from gateway.domain.captures import Capture
from gateway.domain.equipment import Equipment
from gateway.domain.outcomes import ActingCheck, PushRecord
from gateway.domain.proposals import Proposal, TableChange
from gateway.domain.values import COVERAGE
from gateway.errors import CaptureError, IllegalTransition
from gateway.evaluate.behaviour.repetitions import robust_means
from gateway.events import ActingCheckStarted, RunStarted
from gateway.guard import Approved, Check, GuardVerdict, guard_axis
from gateway.model.fit import fit_positioning
from gateway.say import Say
from gateway.store import RunFolder
from gateway.table.comparison import differences, taken_by_cross
from gateway.table.proposal import InstrumentU
from gateway.tooth import AxisOutlook, ToothProposal
from gateway.workflow.axes.measure import live_again, move_to_functional_line, store_equipment
from gateway.workflow.axes.verdict import PUSHED, WIDEN
from gateway.workflow.run import stages
from gateway.workflow.run.context import RunContext, open_context
from gateway.workflow.run.folder import new_run
from gateway.workflow.run.live_tables import TableLook, compare_with, expected_tables, record_looks

ANSWERS = {
    "still valid": "S-GUARD-VALID",
    "re-measure this axis": "S-GUARD-REMEASURE",
    "cannot tell": "S-GUARD-OPEN",
}
"""The answers of the guard, as people read them."""
EXIT = {"still valid": 0, "re-measure this axis": 20, "cannot tell": 21}
GUARDED = "guarded"


@dataclass(frozen=True, slots=True)
class GuardOutcome:
    """The verdict of one axis and where the check is kept."""

    axis: str
    verdict: GuardVerdict
    approved_run: str
    run_folder: str

    @property
    def exit_code(self) -> int:
        """0 still valid, 20 re-measure, 21 cannot tell."""
        return EXIT[self.verdict.answer]

    @property
    def lines(self) -> tuple[Message, ...]:
        """For people."""
        seen = self.verdict
        numbers = {"largest": fixed(seen.largest, signed=True), "at": Quantity(seen.at), "margin": fixed(seen.margin)}
        answer = Message.of(ANSWERS[seen.answer])
        limit = Quantity(seen.limit)
        told = Message.of("W-GUARD", axis=self.axis, answer=answer, limit=limit, unit=seen.unit, **numbers)
        return told, *seen.said, Message.of("S-REPORT-FOLDER", path=self.run_folder)

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        kept = {"axis": self.axis, "approved_run": self.approved_run, "run_folder": self.run_folder}
        return {**kept, **self.verdict.as_data(), "exit_code": self.exit_code}


@dataclass(frozen=True, slots=True)
class ApprovedCurve:
    """What the check is compared with: the curve, under which tables, by which instrument, and its lever taken off.

    ``pushed`` are the axis' tables by name where the run pushed cross tables after it had measured the axis: the curve
    is then the measured one less what they take off it.
    """

    approved: Approved
    live: LiveSet
    serial: str
    on_line: bool = False
    pushed: Mapping[str, CompensationTable] = field(default_factory=dict)


async def guard_site(
    site: SiteFile,
    site_path: Path,
    run: RunFolder,
    axis_name: str,
    *,
    clock: Clock,
    say: Say,
    limit: float | None = None,
) -> GuardOutcome:
    """Capture an axis at few targets and judge it against what `run` approved. Writes no table.

    Raises ConfigError (E-RUN-AXIS, E-GUARD-INSTRUMENT), IllegalTransition (E-GUARD-NOTHING: the run approved no
    curve of that axis; E-SETUP-MACHINE), CaptureError (E-GUARD-TABLES), and what capturing raises.
    """
    axis = _axis(site, site_path, axis_name)
    known = approved_curve(run, axis)
    section = short_check(axis, known.approved.targets, site.guard)
    folder = new_run(site, site_path, utc=clock.utc)
    RunStarted(str(folder.path)).tell(say)
    try:
        async with open_context(
            site, site_path, folder=folder, clock=clock, say=say, instruments={axis.measure.instrument}
        ) as at:
            verdict = await _guard_axis(at, section, run, known, limit)
    except TrueflankError as error:
        folder.set_state("failed", error=error.as_record())
        raise
    folder.set_state(GUARDED)
    return GuardOutcome(axis.name, verdict, run.run_id, str(folder.path))


def _axis(site: SiteFile, site_path: Path, name: str) -> AxisSection:
    axis = next((one for one in site.axes if one.name == name), None)
    if axis is None:
        raise ConfigError("E-RUN-AXIS", str(site_path), axis=name, known=", ".join(one.name for one in site.axes))
    if not axis.measure.instrument:
        raise ConfigError("E-GUARD-INSTRUMENT", str(site_path), axis=name)
    return axis


async def _guard_axis(
    at: RunContext, axis: AxisSection, run: RunFolder, known: ApprovedCurve, limit: float | None
) -> GuardVerdict:
    different = run.get(stages.EQUIPMENT, Equipment).machine.differences(at.machine)
    if different:
        raise IllegalTransition("E-SETUP-MACHINE", run.run_id, fields=", ".join(different))
    store_equipment(at)
    rig = at.rig(axis)
    proof = await prove_sense(rig)
    await _same_tables(at, await rig.controller.saved_tables(axis.name), known, run)
    raw = await capture_axis(rig, proof)
    await _same_tables(at, raw.live, known, run)
    digest = at.folder.put(stages.raw(axis.name, "after"), raw)
    capture = from_live(axis, raw, proof, rig.instrument.compensated_for)
    if known.on_line:
        capture = move_to_functional_line(capture, axis, at.site, run)
    parents = (at.folder.put(stages.capture(axis.name, "after"), capture, (digest,)),)
    same = _serial(at.folder, axis.measure.instrument) == known.serial
    unit = deviation_unit(axis.unit)
    guard = at.site.guard
    allowed = limit or (guard.limit_um if unit == "um" else guard.limit_arcsec)
    verdict = guard_axis(known.approved, check_of(axis, capture, guard, same_instrument=same), allowed)
    at.folder.put(stages.GUARD, verdict, parents)
    return verdict


async def _same_tables(at: RunContext, live: LiveSet, known: ApprovedCurve, run: RunFolder) -> None:
    same = live.digest == known.live.digest
    if known.pushed:
        looks = compare_with(await expected_tables(at, live.axis), live)
        kept = [one.name for one in looks if one.found.kind == "as-approved" and _matches_run(one, known.pushed)]
        same = sorted(kept) == sorted(known.pushed) and live.backlash == known.live.backlash
    if not same:
        raise CaptureError("E-GUARD-TABLES", live.axis, run=run.run_id)


def _matches_run(look: TableLook, pushed: Mapping[str, CompensationTable]) -> bool:
    """Whether the last push of that table left what this run proposed."""
    here, last = pushed.get(look.name), look.expected
    return here is not None and not differences(here, last.table, last.allowed)


def approved_curve(run: RunFolder, axis: AxisSection) -> ApprovedCurve:
    """The curve a run leaves an axis with: measured after its push, or as measured if nothing was pushed.

    Raises IllegalTransition (E-GUARD-NOTHING), also after a push that was never measured again.
    """
    alone = stages.setup(f"{axis.measure.component}-{axis.name}")
    names = (stages.capture(axis.name, "after"), stages.capture(axis.name, "before"), alone)
    stored = next((name for name in names if run.has(name)), "")
    pushed = run.has(stages.push(axis.name))
    capture = run.get(stored, Capture) if stored else None
    if capture is None or capture.live is None or (pushed and stored != names[0]):
        raise IllegalTransition("E-GUARD-NOTHING", run.run_id, axis=axis.name)
    means = robust_means(capture.targets, capture.deviations)
    tables = _pushed_tables(run, axis.name)
    cross = [one for one in tables.values() if one.kind == "cross"]
    mean = means.mean - taken_by_cross(cross, axis.name, capture.targets)
    curve = fit_positioning(
        capture.targets,
        mean,
        means.u,
        name=axis.measure.component,
        axis=axis.name,
        axis_unit=axis.unit,
        kind=axis.kind,
        modulo=axis.modulo,
    )
    approved = Approved(
        curve=curve,
        targets=capture.targets,
        means=mean,
        u=means.u,
        freedom=_freedom(capture, len(means.suspects)),
    )
    serial, on_line = _serial(run, axis.measure.instrument), capture.line_mm is not None
    return ApprovedCurve(approved, capture.live, serial, on_line, pushed=tables if cross else {})


def _pushed_tables(run: RunFolder, axis: str) -> dict[str, CompensationTable]:
    """The axis' tables that the run pushed, by name, cross tables among them."""
    changes = run.get(stages.PROPOSAL, Proposal).changes if run.has(stages.PROPOSAL) else ()
    mine = [one for one in changes if one.axis == axis and run.has(stages.push(one.name))]
    return {one.name: one.new for one in mine if run.get(stages.push(one.name), PushRecord).outcome in PUSHED}


def _freedom(capture: Capture, suspects: int) -> float:
    """Degrees of freedom of the pooled scatter: readings less targets each way less passes beyond the first."""
    readings = int(np.isfinite(capture.deviations).sum()) - suspects
    passes = 2 * capture.deviations.shape[1] - 2
    return float(max(readings - 2 * capture.targets.size - passes, 1))


def _serial(folder: RunFolder, instrument: str) -> str:
    items = folder.get(stages.EQUIPMENT, Equipment).items
    return next((item.identity.serial for item in items if item.name == instrument), "")


def short_check(axis: AxisSection, targets: FloatArray, guard: GuardSection, also: tuple[int, ...] = ()) -> AxisSection:
    """The axis measured at few of the targets, few times: both ends, and those that ``also`` counts from 0."""
    count = min(guard.targets, len(targets))
    few = np.unique([*np.round(np.linspace(0, len(targets) - 1, count)).astype(int), *also])
    chosen = Targets(positions=tuple(float(targets[index]) for index in few))
    changes = {"targets": chosen, "repetitions": guard.repetitions, "file": None, "cycle": "standard"}
    return axis.model_copy(update={"measure": axis.measure.model_copy(update=changes)})


def check_of(axis: AxisSection, capture: Capture, guard: GuardSection, *, same_instrument: bool) -> Check:
    """Means of a short capture, and how far another mounting (or another instrument) may move them."""
    means = robust_means(capture.targets, capture.deviations)
    freedom = _freedom(capture, len(means.suspects))
    unit: DeviationUnit = deviation_unit(axis.unit)
    usual = InstrumentU.usual(unit)
    mounting = (guard.mounting_um if unit == "um" else guard.mounting_arcsec) / COVERAGE
    growing = usual.standard(capture.targets - axis.reference) - usual.constant / COVERAGE
    own = 0.0 if same_instrument else float(np.sqrt(2.0)) * usual.constant / COVERAGE
    u = np.sqrt(means.u**2 + growing**2)
    return Check(
        targets=capture.targets,
        means=means.mean,
        u=np.asarray(u),
        freedom=freedom,
        mounting=float(np.hypot(mounting, own)),
    )


# One short capture of an axis that cross tables act on: does it deviate as was predicted for all tables together?

AS_APPROVED = "as-approved"


def combined_effect_plans(at: RunContext, cross: Sequence[TableChange]) -> tuple[StopPlan, ...]:
    """What `verify_combined_effect` will visit once these cross tables are in."""
    if not at.supervisor.controller.capabilities.stops or not at.folder.has(stages.TOOTH):
        return ()
    return plans_of_combined_effect(at.site, at.folder.get(stages.TOOTH, ToothProposal), cross)


def plans_of_combined_effect(
    site: SiteFile, tooth: ToothProposal, cross: Sequence[TableChange]
) -> tuple[StopPlan, ...]:
    """As `combined_effect_plans`, of a control that runs stops; pure."""
    axes = {axis.name: axis for axis in site.axes}
    found: list[StopPlan] = []
    for outlook in tooth.axes:
        section = live_again(axes[outlook.axis], outlook.targets)
        if section is not None and any(_over_itself(one, outlook.axis) for one in cross):
            found += _short_capture_plans(short_capture_axis(section, outlook, site.guard))
    return tuple(found)


def _short_capture_plans(axis: AxisSection) -> tuple[StopPlan, ...]:
    return sense_plan(axis, setup_of(axis)), measuring_plan(axis, targets_of(axis), "")


async def verify_combined_effect(at: RunContext) -> tuple[ActingCheck, ...]:
    """Measure each axis at few places whose own curve the cross tables of this run change, and store what it says.

    Nothing without such a table, without an instrument, or where the road runs no stops; what is stored already is not
    measured again. Raises what capturing raises.
    """
    if not at.supervisor.controller.capabilities.stops or not at.folder.has(stages.TOOTH):
        return ()
    tooth, proposal = at.folder.get(stages.TOOTH, ToothProposal), at.folder.get(stages.PROPOSAL, Proposal)
    found = []
    for outlook in tooth.axes:
        section = live_again(at.axis(outlook.axis), outlook.targets)
        if section is None or not cross_tables_incomplete(at.folder, proposal, outlook):
            continue
        if not at.folder.has(stages.acting(outlook.axis)):
            await _measure_short(at, at.rig(short_capture_axis(section, outlook, at.site.guard)), outlook)
        found.append(at.folder.get(stages.acting(outlook.axis), ActingCheck))
    return tuple(found)


def cross_tables_incomplete(folder: RunFolder, proposal: Proposal, outlook: AxisOutlook) -> bool:
    """Whether cross tables over the axis itself were pushed with this run: all of those that were proposed."""
    over = [one for one in proposal.changes if _over_itself(one, outlook.axis)]
    return bool(over) and all(
        folder.has(stages.push(one.name)) and folder.get(stages.push(one.name), PushRecord).outcome in PUSHED
        for one in over
    )


def _over_itself(change: TableChange, axis: str) -> bool:
    cross = change.layer == "cross" and not change.skipped
    return cross and change.axis == axis and change.new.input_axis == axis


def short_capture_axis(section: AxisSection, outlook: AxisOutlook, guard: GuardSection) -> AxisSection:
    """The axis measured at few targets, those of the highest and the lowest predicted deviation among them."""
    known = np.where(np.isfinite(outlook.deviation), outlook.deviation, np.nanmean(outlook.deviation))
    return short_check(section, outlook.targets, guard, also=(int(np.argmax(known)), int(np.argmin(known))))


async def _measure_short(at: RunContext, rig: Rig, outlook: AxisOutlook) -> None:
    guard, axis = at.site.guard, rig.axis
    count = len(axis.measure.targets.positions) if axis.measure.targets else 0
    ActingCheckStarted(axis.name, count).tell(at.say)
    await at.foresee(_short_capture_plans(axis))
    at.standing.note(None)
    proof = await prove_sense(rig)
    raw = await capture_axis(rig, proof)
    await at.foresee(())
    digest = at.folder.put(stages.raw(axis.name, "acting"), raw)
    capture = move_to_functional_line(
        from_live(axis, raw, proof, rig.instrument.compensated_for), axis, at.site, at.folder
    )
    parent = at.folder.put(stages.capture(axis.name, "acting"), capture, (digest,))
    looks = compare_with(await expected_tables(at, axis.name), raw.live)
    record_looks(at, looks)
    check = judge_combined_effect(outlook, check_u(axis, capture, guard), other_tables(looks))
    at.folder.put(stages.acting(axis.name), check, (parent, at.folder.digest(stages.TOOTH)))
    at.say("P-ACTING-DONE", axis=axis.name, words=check.words)


def other_tables(looks: tuple[TableLook, ...]) -> str:
    """Which tables that act are not as they were pushed, "" for none."""
    return ", ".join(one.name for one in looks if one.found.kind != AS_APPROVED)


def check_u(axis: AxisSection, capture: Capture, guard: GuardSection) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Targets, means and expanded uncertainties (m,) of a short capture; the mounting of another day included."""
    check = check_of(axis, capture, guard, same_instrument=True)
    return check.targets, check.means, COVERAGE * np.hypot(check.u, check.mounting)


def judge_combined_effect(
    outlook: AxisOutlook, seen: tuple[FloatArray, FloatArray, FloatArray], others: str = ""
) -> ActingCheck:
    """``seen``: targets, means and their U (m,) of the short capture, held against the outlook target by target.

    The common offset is the datum's. ``others``: tables that are not as pushed, with which nothing is judged; pure.
    """
    good = np.isfinite(seen[1]) & np.isfinite(seen[2])
    at, means, means_U = (values[good] for values in seen)
    predicted = np.interp(at, outlook.targets, outlook.deviation)
    predicted_U = np.interp(at, outlook.targets, outlook.U)
    U = np.hypot(means_U, predicted_U)
    measured = means - np.average(means - predicted, weights=U**-2.0)
    held = None if others else bool(np.all(np.abs(measured - predicted) <= WIDEN * U))
    sizes = (*_range_with_U(measured, means_U), *_range_with_U(predicted, predicted_U))
    told = {"axis": outlook.axis, "unit": outlook.unit, "count": at.size, "tables": others, "alone": outlook.M_alone}
    figures = dict(zip(("M", "U", "predicted", "predicted_U"), sizes, strict=True))
    code = "W-ACTING-OTHER" if held is None else "W-ACTING-HELD" if held else "W-ACTING-MISSED"
    off = float(np.max(np.abs(measured - predicted), initial=0.0))
    numbers = {name: fixed(value) for name, value in (figures | {"alone": outlook.M_alone, "off": off}).items()}
    return ActingCheck(
        axis=outlook.axis,
        unit=outlook.unit,
        targets=at,
        predicted=predicted,
        measured=measured,
        U=U,
        M=figures["M"],
        M_U=figures["U"],
        M_predicted=figures["predicted"],
        M_predicted_U=figures["predicted_U"],
        held=held,
        words=Message.of(code, **told | numbers),
    )


def _range_with_U(values: FloatArray, U: FloatArray) -> tuple[float, float]:
    """Range and its U, from the U of both ends."""
    ends = [int(np.argmax(values)), int(np.argmin(values))]
    return float(np.ptp(values)), float(np.hypot(*U[ends]))
