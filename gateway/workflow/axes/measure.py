"""One axis from instrument or file to evaluation: sense proved, captured, corrected, evaluated, stored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

import numpy as np

from drivers.errors import ConfigError, UnsupportedDevice
from drivers.message import Message, fixed
from drivers.terms import spoken
from drivers.types.results import MeasuredSet
from drivers.types.stops import StopPlan
from drivers.types.tables import LiveSet
from drivers.types.values import CompensatedFor, FloatArray
from drivers.units import deviation_unit
from gateway import audit
from gateway.capture.corrections import from_file, from_live
from gateway.capture.live import capture_axis
from gateway.capture.revisits import require_complete
from gateway.capture.rig import prove_sense, sense_plan, setup_of
from gateway.capture.targets import between_places, measuring_plan, targets_of, with_checks
from gateway.config import AxisSection, SiteFile, Targets, unchecked_feed
from gateway.domain.captures import Capture, Conditions
from gateway.domain.equipment import Equipment, Item, SenseProof
from gateway.domain.figures import Evaluation
from gateway.domain.stated import StatedFacts
from gateway.errors import CaptureError
from gateway.evaluate.behaviour.doubts import notable_doubts, remarks
from gateway.evaluate.behaviour.fine_structure import over_travel
from gateway.evaluate.geometry.measurement import Lever
from gateway.evaluate.standards.iso230_2 import describe_incurable, evaluate_iso230_2
from gateway.evaluate.uncertainty.budget import budget_of
from gateway.events import AxisMeasurementStarted
from gateway.model.error_model import ErrorModel
from gateway.moves import question
from gateway.say import Say
from gateway.store import Maps, RunFolder
from gateway.workflow.axes.structure import AdaptiveTargets, tooth_places
from gateway.workflow.files.reading import ReadOptions, read_file, result_endings
from gateway.workflow.files.statements import facts_of, settle_setup
from gateway.workflow.run import stages
from gateway.workflow.run.context import RunContext
from gateway.workflow.run.live_tables import compare_live_tables

# A push is proved at so many places that were not measured before, at least.
PROOF_STOPS = 6


@dataclass(frozen=True, slots=True)
class MeasuredAxis:
    """A measured axis: what was captured and what ISO 230-2 says of it."""

    capture: Capture
    evaluation: Evaluation
    digest: str


def store_equipment(at: RunContext) -> None:
    """Store who every device said it was; a calibration that is overdue is told.

    Raises as `report_overdue_calibrations`.
    """
    report_overdue_calibrations(at.site, at.clock.utc().date(), at.say)
    items = tuple(
        Item(seen.name, seen.identity, _notices(at, seen.name))
        for seen in at.supervisor.picture()
        if seen.identity is not None
    )
    began = at.clock.utc().isoformat(timespec="seconds")
    at.folder.put(stages.EQUIPMENT, Equipment(at.machine, items, began, at.accepted))


def _notices(at: RunContext, name: str) -> tuple[str, ...]:
    if name == at.supervisor.CONTROLLER:
        return ()
    return at.supervisor.instrument(name).notices


async def measure_axis(at: RunContext, axis: AxisSection, phase: stages.Phase) -> MeasuredAxis:
    """Measure one axis and store every step before the next. Raises what capture and evaluation raise."""
    AxisMeasurementStarted(axis.name, axis.measure.component, phase).tell(at.say)
    stood: dict[str, float] = {}
    if axis.measure.file is not None:
        capture, parents = await _from_file(at, axis)
    else:
        stood = await axis_positions(at)
        capture, parents = await _live(at, axis, phase)
    capture = with_conditions(move_to_functional_line(capture, axis, at.site, at.folder), axis, at.site, stood)
    measured = evaluate_capture(at.folder, axis, phase=phase, capture=capture, parents=parents)
    if phase == "before":
        await compare_live_tables(at, capture.live)
    result = measured.evaluation
    figures = {"M": _figure(result.M), "B": _figure(result.B), "travel": _figure(result.M_travel)}
    at.say("P-EVALUATED", axis=axis.name, **figures, unit=result.unit)
    return measured


def evaluate_capture(
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


async def _live(at: RunContext, axis: AxisSection, phase: stages.Phase) -> tuple[Capture, tuple[str, ...]]:
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
        require_complete(capture)
    return capture, (digest,)


def plans_of_axis(axis: AxisSection, phase: stages.Phase, *, stands: bool = False) -> list[StopPlan]:
    """What measuring an axis live sends at first: the proof of the instrument's sense, then all visits.

    ``stands``: the optics are mounted already.
    """
    targets, checks = with_checks(targets_of(axis), check_stops(axis, phase))
    setup = "" if stands else setup_of(axis)
    return [sense_plan(axis, setup), measuring_plan(axis, targets, "", checks=checks)]


def more_targets(at: RunContext, axis: AxisSection, proof: SenseProof, already: CompensatedFor) -> AdaptiveTargets:
    """What names more targets for an axis of the site while its capture stands. Raises as `tooth_places`."""
    tooth = tooth_places(at.site, at.site_path, axis)
    return AdaptiveTargets(axis, lambda raw: from_live(axis, raw, proof, already), at.say, tooth=tooth)


def check_stops(axis: AxisSection, phase: stages.Phase) -> FloatArray:
    """Check stops: after a push at other places than before, and never none: a table cannot have been fitted there."""
    seed, after = axis.measure.targets.seed if axis.measure.targets is not None else 0, phase == "after"
    count = max(axis.measure.between, PROOF_STOPS) if after else axis.measure.between
    return between_places(targets_of(axis), count, 2 * seed + after)


async def _from_file(at: RunContext, axis: AxisSection) -> tuple[Capture, tuple[str, ...]]:
    path = at.site_path.parent / Path(str(axis.measure.file))
    measured = read_result(path, axis.measure.file_unit, at)
    keep_statements(at, path, measured, axis.measure.accept)
    at.folder.write_bytes(f"source-{axis.name}{path.suffix}", path.read_bytes())
    live = await fetch_tables(at, axis)
    return from_file(axis, measured, live, path.name), ()


def keep_statements(at: RunContext, path: Path, measured: MeasuredSet, accepted: Sequence[str]) -> None:
    """Compare what a set-up's file states with the site and the run's other files, and keep it with the run.

    Raises ConfigError (E-FACTS-SETUP, E-FACTS-ACCEPT), StoreError.
    """
    before = at.folder.get(stages.STATED, StatedFacts) if at.folder.has(stages.STATED) else StatedFacts()
    file, maps = facts_of(path.name, measured.header), Maps(at.store.root)
    stated = settle_setup(file, at.site, before, maps=maps, accepted=accepted, utc=at.clock.utc())
    if stated.facts:
        at.folder.put(stages.STATED, stated)


def read_result(path: Path, unit: str, at: RunContext) -> MeasuredSet:
    """A result file, its unit and columns as the site file or an earlier import said them.

    Raises ConfigError (E-RUN-FILE) for an ending that holds no results, and what `read_file` raises.
    """
    if path.suffix.lower() not in result_endings():
        raise ConfigError("E-RUN-FILE", str(path), known=", ".join(result_endings()))
    content = read_file(path, ReadOptions(unit, at.site.site.name), Maps(at.store.root)).content
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


async def fetch_tables(at: RunContext, axis: AxisSection) -> LiveSet:
    """Read what compensates an axis now; writes no table and moves nothing."""
    asked = question(axis.facts, at.patience)
    return await at.supervisor.controller.live_tables(asked, at.say)


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


# Under which conditions an axis is captured, by site file and live tables, and what certificates state.

STATED = ("um_per_m", "arcsec", "kelvin")


async def axis_positions(at: RunContext) -> dict[str, float]:
    """Where the site's axes stand now, by letter. Raises what the wire raises."""
    axes = (await at.supervisor.controller.state()).axes
    return {axis.letter: axes[axis.name].position for axis in at.site.axes if axis.name in axes}


def with_conditions(capture: Capture, axis: AxisSection, site: SiteFile, stood: Mapping[str, float]) -> Capture:
    """The capture with what acted on it and on its uncertainty, and where the axes ``stood`` by letter.

    One from a file has no feed and no dwell, and nobody knows where the other axes stood.
    """
    own = axis.measure.file is None
    # A file's set-up names no instrument: what made it is the one that the site has for this axis.
    usual = (one.measure.instrument for one in site.axes if one.name == axis.name)
    return replace(
        capture,
        conditions=Conditions(
            feed=axis.measure.feed if own else None,
            overrun=axis.measure.overrun if own else None,
            dwell_s=axis.measure.dwell_s if own else None,
            warm_up=site.report.warm_up,
            operator=site.report.operator or (audit.signed_in() if own else ""),
            compensation=_active_tables(capture.live),
            stated=stated_uncertainties(site, axis.measure.instrument or next(usual, "")),
            stands=stood,
        ),
    )


def stated_uncertainties(site: SiteFile, instrument: str) -> dict[str, float]:
    """Uncertainties (k = 2) that the register states for an instrument, or for equipment of no single one."""
    found: dict[str, float] = {}
    for one in site.equipment:
        if one.instrument in ("", instrument):
            found |= {key: value for key in STATED if (value := getattr(one, key)) is not None}
    return found


def stated_uncertainties_of(site: SiteFile, axis: str) -> dict[str, float]:
    """`stated` for what measures an axis, by its name or letter; for an axis that is unknown, of no instrument."""
    meant = site.meant(axis)
    return stated_uncertainties(site, (meant.measure.instrument or "") if meant is not None else "")


def _active_tables(live: LiveSet | None) -> str:
    """Names of the tables that were on: "X1, X1(C1)"; "-" for none, "" where nobody knows."""
    if live is None:
        return ""
    acting = [one.table.output_axis for one in (live.own,) if one.enabled]
    acting += [f"{one.table.output_axis}({one.table.input_axis})" for one in live.cross if one.enabled]
    return ", ".join(acting) or "-"


def overdue_calibrations(site: SiteFile, today: date) -> tuple[str, ...]:
    """Equipment whose next calibration was due before today, by name and day."""
    return tuple(f"{one.name} ({one.due})" for one in site.equipment if one.due is not None and one.due < today)


def report_overdue_calibrations(site: SiteFile, today: date, say: Say) -> None:
    """A warning for each overdue calibration. Raises CaptureError (E-CAP-OVERDUE) where the site file refuses."""
    late = overdue_calibrations(site, today)
    if late and site.report.refuse_overdue:
        raise CaptureError("E-CAP-OVERDUE", site.site.name, names=", ".join(late))
    for name in late:
        say("P-CAP-OVERDUE", name=name)


# The line that an axis' figures hold for: a lever is taken off where a set-up says how far off the reflector stood.

DIRECTIONS = "XYZ"


def move_to_functional_line(capture: Capture, axis: AxisSection, site: SiteFile, folder: RunFolder) -> Capture:
    """A positioning capture on the line its component is meant for, by the angles that the run's error model knows.

    As it is for a rotary axis, and where no set-up of the site says where the reflector stood. Angles nobody measured
    leave their share in ``lever_u``. Raises what the store raises.
    """
    offset = offset_of(axis, site)
    if axis.kind != "linear" or offset is None:
        return capture
    lever = _lever_deviation(axis, offset, site, folder)
    between = capture.between
    if between is not None:
        seen = between.deviations - _from_datum(lever, between.targets, capture)[:, None, None]
        between = replace(between, deviations=seen)
    return replace(
        capture,
        deviations=capture.deviations - _from_datum(lever, capture.targets, capture)[:, None, None],
        between=between,
        unsteady_u=float(np.hypot(capture.unsteady_u, np.max(lever.u(capture.targets), initial=0.0))),
        line_mm=offset,
        lever_u=lever.open_u,
        notes=(*capture.notes, *lever.estimated(capture.targets)),
    )


def offset_of(axis: AxisSection, site: SiteFile) -> tuple[float, float, float] | None:
    """Where the reflector of an axis' positioning stands beside the line that counts, mm; None: nobody said."""
    fitting = (one for one in site.setups if (one.component, one.axis) == (axis.measure.component, axis.name))
    return next((one.offset_mm for one in fitting), None)


def line_remark(capture: Capture) -> Message:
    """Which line the figures of a linear axis hold for."""
    if capture.line_mm is None:
        return Message.of("S-LINE-MEASURED")
    where = ", ".join(f"{way} {part:+g}" for way, part in zip(DIRECTIONS, capture.line_mm, strict=True) if part)
    if capture.lever_u:
        return Message.of("S-LINE-PART", component=capture.component, where=where, u=fixed(capture.lever_u))
    return Message.of("S-LINE-COUNTS", component=capture.component, where=where or "0")


def _lever_deviation(axis: AxisSection, offset: tuple[float, float, float], site: SiteFile, folder: RunFolder) -> Lever:
    model = folder.get(stages.ERRORS, ErrorModel) if folder.has(stages.ERRORS) else ErrorModel()
    return Lever.of(
        axis.measure.component,
        axis.letter,
        offset,
        angles={one.name: one for one in model.motions},
        spans={one.name: one.assumed for one in site.setups if one.assumed is not None},
        usual_arcsec=site.assumed.angular_arcsec,
    )


def _from_datum(lever: Lever, at: FloatArray, capture: Capture) -> FloatArray:
    """What the lever adds from the first target on, which stays the zero."""
    return np.asarray(lever.um(at) - lever.um(capture.targets[:1])[0])
