"""One axis from instrument or file to evaluation: sense proved, captured, corrected, evaluated, stored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from drivers.errors import ConfigError, UnsupportedDevice
from drivers.message import Message
from drivers.terms import spoken
from drivers.types.results import MeasuredSet
from drivers.types.stops import StopPlan
from drivers.types.tables import LiveSet
from drivers.types.values import CompensatedFor, FloatArray
from drivers.units import deviation_unit
from gateway.capture.corrected import from_file, from_live
from gateway.capture.live import capture_axis
from gateway.capture.retaking import demand_complete
from gateway.capture.rig import setup_of
from gateway.capture.sense import prove_sense, sense_plan
from gateway.capture.targets import between_places, measuring_plan, targets_of, with_checks
from gateway.config import AxisSection, Targets, unchecked_feed
from gateway.domain.captures import Capture
from gateway.domain.equipment import Equipment, Item, SenseProof
from gateway.domain.figures import Evaluation
from gateway.domain.stated import StatedFacts
from gateway.evaluate.behaviour.doubts import notable_doubts, remarks
from gateway.evaluate.behaviour.fine_structure import over_travel
from gateway.evaluate.standards.iso230_2 import describe_incurable, evaluate_iso230_2
from gateway.evaluate.uncertainty.budget import budget_of
from gateway.events import AxisMeasurementStarted
from gateway.store import Maps, RunFolder
from gateway.walk import question
from gateway.workflow import stages
from gateway.workflow.aftercare import look_at
from gateway.workflow.axes.conditions import stands, tell_overdue, with_conditions
from gateway.workflow.axes.line import line_remark, on_its_line
from gateway.workflow.axes.more import MoreTargets
from gateway.workflow.axes.toothplaces import tooth_places
from gateway.workflow.bench import Bench
from gateway.workflow.files.facts import facts_of, settle_setup
from gateway.workflow.files.reading import How, read_file, result_endings

# A push is proved at so many places that were not measured before, at least.
PROOF_STOPS = 6


@dataclass(frozen=True, slots=True)
class MeasuredAxis:
    """A measured axis: what was captured and what ISO 230-2 says of it."""

    capture: Capture
    evaluation: Evaluation
    digest: str


def store_equipment(at: Bench) -> None:
    """Store who every device said it was; a calibration that is overdue is told. Raises as `tell_overdue`."""
    tell_overdue(at.site, at.clock.utc().date(), at.say)
    items = tuple(
        Item(seen.name, seen.identity, _notices(at, seen.name))
        for seen in at.supervisor.picture()
        if seen.identity is not None
    )
    began = at.clock.utc().isoformat(timespec="seconds")
    at.folder.put(stages.EQUIPMENT, Equipment(at.machine, items, began, at.accepted))


def _notices(at: Bench, name: str) -> tuple[str, ...]:
    if name == at.supervisor.CONTROLLER:
        return ()
    return at.supervisor.instrument(name).notices


async def measure_axis(at: Bench, axis: AxisSection, phase: stages.Phase) -> MeasuredAxis:
    """Measure one axis and store every step before the next. Raises what capture and evaluation raise."""
    AxisMeasurementStarted(axis.name, axis.measure.component, phase).tell(at.say)
    stood: dict[str, float] = {}
    if axis.measure.file is not None:
        capture, parents = await _from_file(at, axis)
    else:
        stood = await stands(at)
        capture, parents = await _live(at, axis, phase)
    capture = with_conditions(on_its_line(capture, axis, at.site, at.folder), axis, at.site, stood)
    measured = evaluated(at.folder, axis, phase=phase, capture=capture, parents=parents)
    if phase == "before":
        await look_at(at, capture.live)
    result = measured.evaluation
    figures = {"M": _figure(result.M), "B": _figure(result.B), "travel": _figure(result.M_travel)}
    at.say("P-EVALUATED", axis=axis.name, **figures, unit=result.unit)
    return measured


def evaluated(
    folder: RunFolder, axis: AxisSection, phase: stages.Phase, capture: Capture, parents: tuple[str, ...]
) -> MeasuredAxis:
    """A capture of an axis, stored and evaluated."""
    digest = folder.put(stages.capture(axis.name, phase), capture, parents)
    result = evaluate_iso230_2(
        capture.targets, capture.deviations, deviation_unit(axis.unit), budget=budget_of(capture)
    )
    result = over_travel(result, capture)
    if capture.cycle != "standard":
        result = replace(result, flags=(*result.flags, Message.of("S-EVAL-CYCLE", cycle=capture.cycle)))
    line = (line_remark(capture),) if axis.kind == "linear" else ()
    doubtful = remarks(notable_doubts(capture.doubts))
    result = replace(result, flags=(*result.flags, *doubtful, *describe_incurable(result), *line))
    folder.put(stages.evaluation(axis.name, phase), result, (digest,))
    return MeasuredAxis(capture, result, digest)


async def _live(at: Bench, axis: AxisSection, phase: stages.Phase) -> tuple[Capture, tuple[str, ...]]:
    if not at.supervisor.controller.capabilities.stops:
        raise UnsupportedDevice("E-RUN-NO-PROGRAMS", axis.name)
    rig = at.rig(axis)
    stands = phase == "after" and at.standing.holds(axis)
    if stands:
        at.say("P-STANDS", component=axis.measure.component, axis=axis.name)
    proof = await prove_sense(rig, stands=stands)
    at.standing.note(axis)
    more = more_targets(at, axis, proof, rig.instrument.compensated_for) if phase == "before" else None
    raw = await capture_axis(rig, proof, check_stops(axis, phase), more)
    digest = at.folder.put(stages.raw(axis.name, phase), raw)
    at.folder.write_text(f"tables-{axis.name}-{phase}{spoken().tables_suffix}", raw.live.native)
    capture = from_live(axis, raw, proof, rig.instrument.compensated_for)
    capture = replace(capture, notes=(*capture.notes, *unchecked_feed(at.site, axis)))
    if phase == "before":  # afterwards the table is in the control, and what was measured of it is judged as it is
        demand_complete(capture)
    return capture, (digest,)


def plans_of_axis(axis: AxisSection, phase: stages.Phase, *, stands: bool = False) -> list[StopPlan]:
    """What measuring an axis live sends at first: the proof of the instrument's sense, then all visits.

    ``stands``: the optics are mounted already.
    """
    targets, checks = with_checks(targets_of(axis), check_stops(axis, phase))
    setup = "" if stands else setup_of(axis)
    return [sense_plan(axis, setup), measuring_plan(axis, targets, "", checks=checks)]


def more_targets(at: Bench, axis: AxisSection, proof: SenseProof, already: CompensatedFor) -> MoreTargets:
    """What names more targets for an axis of the site while its capture stands. Raises as `tooth_places`."""
    tooth = tooth_places(at.site, at.site_path, axis)
    return MoreTargets(axis, lambda raw: from_live(axis, raw, proof, already), at.say, tooth=tooth)


def check_stops(axis: AxisSection, phase: stages.Phase) -> FloatArray:
    """Check stops: after a push at other places than before, and never none: a table cannot have been fitted there."""
    seed, after = axis.measure.targets.seed if axis.measure.targets is not None else 0, phase == "after"
    count = max(axis.measure.between, PROOF_STOPS) if after else axis.measure.between
    return between_places(targets_of(axis), count, 2 * seed + after)


async def _from_file(at: Bench, axis: AxisSection) -> tuple[Capture, tuple[str, ...]]:
    path = at.site_path.parent / Path(str(axis.measure.file))
    measured = read_result(path, axis.measure.file_unit, at)
    keep_statements(at, path, measured, axis.measure.accept)
    at.folder.write_bytes(f"source-{axis.name}{path.suffix}", path.read_bytes())
    live = await fetch_tables(at, axis)
    return from_file(axis, measured, live, path.name), ()


def keep_statements(at: Bench, path: Path, measured: MeasuredSet, accepted: Sequence[str]) -> None:
    """Compare what a set-up's file states with the site and the run's other files, and keep it with the run.

    Raises ConfigError (E-FACTS-SETUP, E-FACTS-ACCEPT), StoreError.
    """
    before = at.folder.get(stages.STATED, StatedFacts) if at.folder.has(stages.STATED) else StatedFacts()
    file, maps = facts_of(path.name, measured.header), Maps(at.store.root)
    stated = settle_setup(file, at.site, before, maps=maps, accepted=accepted, utc=at.clock.utc())
    if stated.facts:
        at.folder.put(stages.STATED, stated)


def read_result(path: Path, unit: str, at: Bench) -> MeasuredSet:
    """A result file, its unit and columns as the site file or an earlier import said them.

    Raises ConfigError (E-RUN-FILE) for an ending that holds no results, and what `read_file` raises.
    """
    if path.suffix.lower() not in result_endings():
        raise ConfigError("E-RUN-FILE", str(path), known=", ".join(result_endings()))
    content = read_file(path, How(unit, at.site.site.name), Maps(at.store.root)).content
    if not isinstance(content, MeasuredSet):
        raise ConfigError("E-RUN-FILE", str(path), known=", ".join(result_endings()))
    return content


def live_again(axis: AxisSection, targets: FloatArray) -> AxisSection | None:
    """How an axis can be measured again, live at these targets; None without instrument.

    They are those of its file, or more than the site names, where the run measured more of them.
    """
    if axis.measure.file is not None and not axis.measure.instrument:
        return None
    if axis.measure.file is None and np.array_equal(targets_of(axis), targets):
        return axis
    same = Targets(positions=tuple(float(target) for target in targets))
    return axis.model_copy(update={"measure": axis.measure.model_copy(update={"file": None, "targets": same})})


async def fetch_tables(at: Bench, axis: AxisSection) -> LiveSet:
    """Read what compensates an axis now; writes no table and moves nothing."""
    asked = question(axis.facts, at.patience)
    return await at.supervisor.controller.live_tables(asked, at.say)


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
