"""The drift guard at the machine: a short capture of one axis against the curve a run approved, and a plain answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from drivers.clock import Clock
from drivers.errors import ConfigError, TrueflankError
from drivers.message import Message, Quantity, fixed
from drivers.types.tables import CompensationTable, LiveSet
from drivers.types.values import FloatArray
from drivers.units import DeviationUnit, deviation_unit
from gateway.capture.corrected import from_live
from gateway.capture.live import capture_axis
from gateway.capture.sense import prove_sense
from gateway.config import AxisSection, GuardSection, SiteFile, Targets
from gateway.domain.captures import Capture
from gateway.domain.equipment import Equipment
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import Proposal
from gateway.domain.values import COVERAGE
from gateway.errors import CaptureError, IllegalTransition
from gateway.evaluate.behaviour.repetitions import robust_means
from gateway.events import RunStarted
from gateway.guard import Approved, Check, GuardVerdict, guard_axis
from gateway.model.fit import fit_positioning
from gateway.say import Say
from gateway.store import RunFolder
from gateway.table.comparison import differences, taken_by_cross
from gateway.table.proposal import InstrumentU
from gateway.workflow import stages
from gateway.workflow.aftercare import Look, compare_with, expected_of
from gateway.workflow.axes.line import on_its_line
from gateway.workflow.axes.measure import store_equipment
from gateway.workflow.axes.verdict import PUSHED
from gateway.workflow.bench import Bench, bench
from gateway.workflow.runsite import new_run

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
class Standard:
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
    known = standard_of(run, axis)
    section = short_check(axis, known.approved.targets, site.guard)
    folder = new_run(site, site_path, utc=clock.utc)
    RunStarted(str(folder.path)).tell(say)
    try:
        async with bench(
            site, site_path, folder=folder, clock=clock, say=say, instruments={axis.measure.instrument}
        ) as at:
            verdict = await _checked(at, section, run, known, limit)
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


async def _checked(at: Bench, axis: AxisSection, run: RunFolder, known: Standard, limit: float | None) -> GuardVerdict:
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
        capture = on_its_line(capture, axis, at.site, run)
    parents = (at.folder.put(stages.capture(axis.name, "after"), capture, (digest,)),)
    same = _serial(at.folder, axis.measure.instrument) == known.serial
    unit = deviation_unit(axis.unit)
    guard = at.site.guard
    allowed = limit or (guard.limit_um if unit == "um" else guard.limit_arcsec)
    verdict = guard_axis(known.approved, check_of(axis, capture, guard, same_instrument=same), allowed)
    at.folder.put(stages.GUARD, verdict, parents)
    return verdict


async def _same_tables(at: Bench, live: LiveSet, known: Standard, run: RunFolder) -> None:
    same = live.digest == known.live.digest
    if known.pushed:
        looks = compare_with(await expected_of(at, live.axis), live)
        kept = [one.name for one in looks if one.found.kind == "as-approved" and _as_here(one, known.pushed)]
        same = sorted(kept) == sorted(known.pushed) and live.backlash == known.live.backlash
    if not same:
        raise CaptureError("E-GUARD-TABLES", live.axis, run=run.run_id)


def _as_here(look: Look, pushed: Mapping[str, CompensationTable]) -> bool:
    """Whether the last push of that table left what this run proposed."""
    here, last = pushed.get(look.name), look.expected
    return here is not None and not differences(here, last.table, last.allowed)


def standard_of(run: RunFolder, axis: AxisSection) -> Standard:
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
    tables = _pushed(run, axis.name)
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
    return Standard(approved, capture.live, serial, on_line, pushed=tables if cross else {})


def _pushed(run: RunFolder, axis: str) -> dict[str, CompensationTable]:
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
