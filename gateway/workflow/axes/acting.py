"""One short capture of an axis that cross tables act on: does it deviate as was predicted for all tables together?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivers.message import Message, fixed
from drivers.types.stops import StopPlan
from drivers.types.values import FloatArray
from gateway.capture.corrected import from_live
from gateway.capture.live import capture_axis
from gateway.capture.rig import Rig, setup_of
from gateway.capture.sense import prove_sense, sense_plan
from gateway.capture.targets import measuring_plan, targets_of
from gateway.config import AxisSection, GuardSection, SiteFile
from gateway.domain.captures import Capture
from gateway.domain.outcomes import ActingCheck, PushRecord
from gateway.domain.proposals import Proposal, TableChange
from gateway.domain.values import COVERAGE
from gateway.events import ActingCheckStarted
from gateway.store import RunFolder
from gateway.tooth import AxisOutlook, ToothProposal
from gateway.workflow import stages
from gateway.workflow.aftercare import Look, compare_with, expected_of, keep_looks
from gateway.workflow.axes.explaining import WIDEN
from gateway.workflow.axes.guard import check_of, short_check
from gateway.workflow.axes.line import on_its_line
from gateway.workflow.axes.measure import live_again
from gateway.workflow.axes.verdict import PUSHED
from gateway.workflow.bench import Bench

AS_APPROVED = "as-approved"


def acting_plans(at: Bench, cross: Sequence[TableChange]) -> tuple[StopPlan, ...]:
    """What `check_acting` will visit once these cross tables are in."""
    if not at.supervisor.controller.capabilities.stops or not at.folder.has(stages.TOOTH):
        return ()
    return plans_of(at.site, at.folder.get(stages.TOOTH, ToothProposal), cross)


def plans_of(site: SiteFile, tooth: ToothProposal, cross: Sequence[TableChange]) -> tuple[StopPlan, ...]:
    """As `acting_plans`, of a control that runs stops; pure."""
    axes = {axis.name: axis for axis in site.axes}
    found: list[StopPlan] = []
    for outlook in tooth.axes:
        section = live_again(axes[outlook.axis], outlook.targets)
        if section is not None and any(_over_itself(one, outlook.axis) for one in cross):
            found += _plans(places(section, outlook, site.guard))
    return tuple(found)


def _plans(axis: AxisSection) -> tuple[StopPlan, ...]:
    return sense_plan(axis, setup_of(axis)), measuring_plan(axis, targets_of(axis), "")


async def check_acting(at: Bench) -> tuple[ActingCheck, ...]:
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
        if section is None or not spoilt(at.folder, proposal, outlook):
            continue
        if not at.folder.has(stages.acting(outlook.axis)):
            await _checked(at, at.rig(places(section, outlook, at.site.guard)), outlook)
        found.append(at.folder.get(stages.acting(outlook.axis), ActingCheck))
    return tuple(found)


def spoilt(folder: RunFolder, proposal: Proposal, outlook: AxisOutlook) -> bool:
    """Whether cross tables over the axis itself were pushed with this run: all of those that were proposed."""
    over = [one for one in proposal.changes if _over_itself(one, outlook.axis)]
    return bool(over) and all(
        folder.has(stages.push(one.name)) and folder.get(stages.push(one.name), PushRecord).outcome in PUSHED
        for one in over
    )


def _over_itself(change: TableChange, axis: str) -> bool:
    cross = change.layer == "cross" and not change.skipped
    return cross and change.axis == axis and change.new.input_axis == axis


def places(section: AxisSection, outlook: AxisOutlook, guard: GuardSection) -> AxisSection:
    """The axis measured at few targets, those of the highest and the lowest predicted deviation among them."""
    known = np.where(np.isfinite(outlook.deviation), outlook.deviation, np.nanmean(outlook.deviation))
    return short_check(section, outlook.targets, guard, also=(int(np.argmax(known)), int(np.argmin(known))))


async def _checked(at: Bench, rig: Rig, outlook: AxisOutlook) -> None:
    guard, axis = at.site.guard, rig.axis
    count = len(axis.measure.targets.positions) if axis.measure.targets else 0
    ActingCheckStarted(axis.name, count).tell(at.say)
    await at.foresee(_plans(axis))
    at.standing.note(None)
    proof = await prove_sense(rig)
    raw = await capture_axis(rig, proof)
    await at.foresee(())
    digest = at.folder.put(stages.raw(axis.name, "acting"), raw)
    capture = on_its_line(from_live(axis, raw, proof, rig.instrument.compensated_for), axis, at.site, at.folder)
    parent = at.folder.put(stages.capture(axis.name, "acting"), capture, (digest,))
    looks = compare_with(await expected_of(at, axis.name), raw.live)
    keep_looks(at, looks)
    check = judge_acting(outlook, check_u(axis, capture, guard), other_tables(looks))
    at.folder.put(stages.acting(axis.name), check, (parent, at.folder.digest(stages.TOOTH)))
    at.say("P-ACTING-DONE", axis=axis.name, words=check.words)


def other_tables(looks: tuple[Look, ...]) -> str:
    """Which tables that act are not as they were pushed, "" for none."""
    return ", ".join(one.name for one in looks if one.found.kind != AS_APPROVED)


def check_u(axis: AxisSection, capture: Capture, guard: GuardSection) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Targets, means and expanded uncertainties (m,) of a short capture; the mounting of another day included."""
    check = check_of(axis, capture, guard, same_instrument=True)
    return check.targets, check.means, COVERAGE * np.hypot(check.u, check.mounting)


def judge_acting(
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
    sizes = (*_range(measured, means_U), *_range(predicted, predicted_U))
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


def _range(values: FloatArray, U: FloatArray) -> tuple[float, float]:
    """Range and its U, from the U of both ends."""
    ends = [int(np.argmax(values)), int(np.argmin(values))]
    return float(np.ptp(values)), float(np.hypot(*U[ends]))
