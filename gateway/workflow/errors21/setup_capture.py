"""One set-up measured and stored: mounting proved, captured live or read from a file; every step before the next."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from drivers.errors import ConfigError
from drivers.terms import spoken
from drivers.types.results import MeasuredSet
from drivers.types.stops import Stop, StopPlan, StopReached
from drivers.types.tables import LiveSet
from drivers.units import deg_to_arcsec, rad_to_arcsec
from gateway.capture.collection import RawCapture
from gateway.capture.corrections import from_file, from_live, with_capture_doubts
from gateway.capture.error_motion import LARGEST, ErrorRig, capture_error, channel_of, error_capture, prove_mounting
from gateway.capture.live import capture_axis
from gateway.capture.revisits import require_complete
from gateway.capture.rig import prove_sense, setup_of, step_of
from gateway.capture.targets import jog_plan, jog_start, measuring_plan, plan_of, step_plan, targets_of
from gateway.config import AxisSection, SiteFile, unchecked_feed
from gateway.domain.captures import Capture
from gateway.errors import CaptureError
from gateway.model.chain import LOCATIONS
from gateway.moves import walk_plan
from gateway.store import Maps, RunFolder
from gateway.workflow.axes.measure import (
    MeasuredAxis,
    axis_positions,
    check_stops,
    evaluate_capture,
    fetch_tables,
    keep_statements,
    more_targets,
    move_to_functional_line,
    plans_of_axis,
    with_conditions,
)
from gateway.workflow.axes.structure import AdaptiveTargets, tooth_places
from gateway.workflow.errors21.setups import PlannedSetup, mounted_setups, plan_setups
from gateway.workflow.files.reading import ReadOptions, driver_of, read_file, result_endings
from gateway.workflow.run import stages
from gateway.workflow.run.context import RunContext

OPTICS = {
    ("linear", "um"): ("straightness", "unknown"),
    ("linear", "arcsec"): ("angular", "unknown"),
    ("rotary", "um"): ("straightness", "unknown"),
    ("rotary", "arcsec"): ("angular", "straightness", "unknown"),
}
ARTEFACTS = {"B0Z": "square", "A0C": "bar", "B0C": "bar", "X0C": "ball", "Y0C": "ball"}


def optics_of(one: PlannedSetup) -> str:
    """What is mounted for a set-up: linear, rotary, straightness or angular optics, or an artefact by its kind."""
    if one.positioning:
        return one.axis.kind
    return ARTEFACTS.get(one.setup.name) or OPTICS[one.axis.kind, one.unit][0]


async def measure_setup(at: RunContext, one: PlannedSetup, tables: dict[str, LiveSet] | None = None) -> Capture:
    """Measure a set-up and store proof, averages, tables as read, and the capture last; returns it.

    Raises Incomplete (E-CAP-INCOMPLETE) where readings stay out of line: the set-up is then measured anew.
    ``tables`` are those read for earlier files, by axis: files measured long ago share one look at what is live.
    """
    at.say("P-SETUP", setup=one.key, component=one.setup.component, axis=one.axis.name)
    if one.setup.source == "file":
        capture, parents = await _from_file(at, one, tables if tables is not None else {})
    else:
        if one.leader and at.folder.has(stages.setup_raw(one.leader)):
            return _from_the_same_stops(at, one)
        await _park(at, one)
        at.folder.write_text(start_positions_file(one.key), json.dumps(await axis_positions(at)))
        capture, parents = await (_measure_positioning(at, one) if one.positioning else _measure_error_motion(at, one))
        require_complete(capture)
    at.folder.write_text(f"setup-{one.key}.json", one.setup.model_dump_json())
    at.folder.put(stages.setup(one.key), capture, parents)
    return capture


def _from_the_same_stops(at: RunContext, one: PlannedSetup) -> Capture:
    """Another channel of what the leader's stops read: the same mounting, places, moments and tables.

    Raises ConfigError (E-SETUP-CHANNEL), CaptureError (E-SETUP-DEAD) for a channel that never changed, Incomplete.
    """
    raw = at.folder.get(stages.setup_raw(one.leader), RawCapture)
    rig = error_rig(at, one)
    if float(np.ptp(raw.values[..., rig.column])) == 0.0:
        raise CaptureError("E-SETUP-DEAD", f"{rig.instrument.name} {raw.channels[rig.column]}", count=raw.time_s.size)
    # How steady a window was is known of the leader's quantity alone.
    raw = replace(raw, window_sigma=np.zeros_like(raw.window_sigma))
    capture = error_capture(rig, raw, one.setup.sense, absolute=one.setup.name in ("X0C", "Y0C"))
    require_complete(capture)
    where = start_positions_file(one.leader)
    at.folder.write_text(start_positions_file(one.key), at.folder.read_text(where))
    at.folder.write_text(f"setup-{one.key}.json", one.setup.model_dump_json())
    at.folder.put(stages.setup(one.key), capture, (at.folder.digest(stages.setup_raw(one.leader)),))
    return capture


def foreseen_plans(site: SiteFile, left: Sequence[PlannedSetup]) -> tuple[StopPlan, ...]:
    """What the control will be sent for these set-ups, in order, as long as no reading asks for more."""
    axes = {axis.name: axis for axis in site.axes}
    out: list[StopPlan] = []
    for one in mounted_setups(left):
        if one.setup.source == "live":
            out += [_parking_plan(axes[name], place) for name, place in sorted(one.setup.park.items())]
            out += plans_of_axis(one.axis, "before") if one.positioning else _error_plans(one)
    return tuple(out)


def _error_plans(one: PlannedSetup) -> list[StopPlan]:
    jog = jog_plan(one.axis, jog_start(one.axis, one.jog), one.jog, setup_of(one.axis))
    start, step = jog_start(one.axis, one.jog), one.setup.step
    steps = [step_plan(one.axis, start, step_of(one.axis, moved)) for moved in (step, 0.0)] if step else []
    return [jog, *steps, measuring_plan(one.axis, targets_of(one.axis), "")]


def _parking_plan(axis: AxisSection, place: float) -> StopPlan:
    return plan_of(axis, (Stop(place, 1),), "", name=f"TFPARK{axis.letter}", dwell_s=0.1, save=False)


async def _park(at: RunContext, one: PlannedSetup) -> None:
    """Bring the other axes to where they must stand; writes nothing but the program."""

    async def at_stop(_index: int, _stop: Stop, _reached: StopReached) -> None:
        return None

    for name, place in sorted(one.setup.park.items()):
        plan = _parking_plan(at.axis(name), place)
        await walk_plan(at.supervisor.controller, plan, at_stop=at_stop, patience=at.patience, say=at.say)


def start_positions_file(key: str) -> str:
    """The file that keeps where all axes stood when a set-up began."""
    return f"stands-{key}.json"


def start_positions(site: SiteFile, folder: RunFolder, one: PlannedSetup) -> dict[str, float]:
    """Where the axes stood when a set-up began, by letter; of a file what its `park` says."""
    name = start_positions_file(one.key)
    if name in folder.facts["files"]:
        return dict(json.loads(folder.read_text(name)))
    return {axis.letter: one.setup.park[axis.name] for axis in site.axes if axis.name in one.setup.park}


def without_cross(live: LiveSet, moved: Collection[str]) -> None:
    """Errors are measured without cross tables: a set-up that sees the output axis would see it, another would not.

    That holds for tables between the axes ``moved`` (machine names) while the errors are measured. Any other stays as
    it is: what it moves is not measured, or its input stands still and the table is a constant. Raises CaptureError
    (E-SETUP-CROSS) naming every table that disturbs.
    """
    cross = [one.table for one in (*live.cross, *live.others) if one.table.kind == "cross" and one.enabled]
    between = [table for table in cross if {table.input_axis, table.output_axis} <= set(moved)]
    acting = sorted({f"{table.name} (table {table.index})" for table in between if any(table.deviations)})
    if acting:
        raise CaptureError("E-SETUP-CROSS", live.axis, tables=", ".join(acting))


async def _measure_positioning(at: RunContext, one: PlannedSetup) -> tuple[Capture, tuple[str, ...]]:
    rig = at.rig(one.axis)
    proof = await prove_sense(rig)
    without_cross(await rig.controller.saved_tables(one.axis.name), at.moved)
    more = more_targets(at, one.axis, proof, rig.instrument.compensated_for)
    raw = await capture_axis(rig, proof, check_stops(one.axis, "before"), more)
    digest = at.folder.put(stages.setup_raw(one.key), raw)
    at.folder.write_text(f"tables-{one.key}{spoken().tables_suffix}", raw.live.native)
    capture = from_live(one.axis, raw, proof, rig.instrument.compensated_for)
    return replace(capture, notes=(*capture.notes, *unchecked_feed(at.site, one.axis))), (digest,)


async def _measure_error_motion(at: RunContext, one: PlannedSetup) -> tuple[Capture, tuple[str, ...]]:
    rig = error_rig(at, one)
    mounted = await prove_mounting(rig)
    proved = at.folder.put(stages.setup_proof(one.key), mounted)
    without_cross(await rig.controller.saved_tables(one.axis.name), at.moved)
    absolute = one.setup.name in ("X0C", "Y0C")

    def corrected(raw: RawCapture) -> Capture:
        return error_capture(rig, raw, one.setup.sense, absolute=absolute, proved=mounted.sense)

    raw = await capture_error(rig, _error_motion_targets(at, rig.axis, one.setup.name, corrected))
    digest = at.folder.put(stages.setup_raw(one.key), raw, (proved,))
    at.folder.write_text(f"tables-{one.key}{spoken().tables_suffix}", raw.live.native)
    return corrected(raw), (digest,)


def _error_motion_targets(
    at: RunContext, axis: AxisSection, name: str, corrected: Callable[[RawCapture], Capture]
) -> AdaptiveTargets | None:
    """More targets for an error motion, where the tooth is ground alone; a location is one number and needs none."""
    tooth = tooth_places(at.site, at.site_path, axis)
    if name[:2] in LOCATIONS or not tooth.size:
        return None
    return AdaptiveTargets(axis, corrected, at.say, tooth=tooth, share=1.0)


def error_rig(at: RunContext, one: PlannedSetup) -> ErrorRig:
    """The rig of an error motion. Raises ConfigError (E-SETUP-CHANNEL)."""
    rig = at.rig(one.axis)
    column, scale = channel_of(rig.instrument, one.setup.channel, one.unit)
    return ErrorRig(
        axis=one.axis,
        controller=rig.controller,
        instrument=rig.instrument,
        clock=rig.clock,
        patience=rig.patience,
        say=rig.say,
        unit=one.unit,
        column=column,
        factor=one.setup.sense * scale,
        largest=one.setup.largest or LARGEST[one.unit],
        jog=one.jog,
        optics=OPTICS[one.axis.kind, one.unit],
        step=one.setup.step or 0.0,
    )


async def _from_file(at: RunContext, one: PlannedSetup, tables: dict[str, LiveSet]) -> tuple[Capture, tuple[str, ...]]:
    path = at.site_path.parent / Path(str(one.setup.path))
    measured = read_setup(path, one, at.site.site.name, Maps(at.store.root))
    keep_statements(at, path, measured, one.axis.measure.accept)
    at.folder.write_bytes(f"source-{one.key}{path.suffix}", path.read_bytes())
    if one.axis.name not in tables:
        tables[one.axis.name] = await fetch_tables(at, at.axis(one.axis.name))
    live = tables[one.axis.name]
    without_cross(live, at.moved)
    return capture_of(one, measured, live, path.name), ()


# A result file as the capture of one set-up: its readings in the error's own unit, its targets in the machine's.

ANGLES = ("mrad", "urad", "arcsec", "deg")
ARCSEC = {"mrad": rad_to_arcsec(1e-3), "urad": rad_to_arcsec(1e-6), "deg": deg_to_arcsec(1.0)}
# Drivers that bring deviations to um or arcsec themselves, once they are told the file's unit.
CONVERTING = ("rta", "csv")


def read_setup(
    path: Path, one: PlannedSetup, machine: str, maps: Maps | None, how: ReadOptions | None = None
) -> MeasuredSet:
    """The readings of a set-up's file, in um or arcsec as its error needs them, its targets those of its axis.

    ``how`` says more of the file than the site file does. Raises ConfigError (E-RUN-FILE) for a file that holds no
    targets, CaptureError (E-DAY-UNIT) for lengths where the error is an angle and the other way round, and what
    `read_file` raises.
    """
    driver, unit = driver_of(path, ReadOptions()), one.setup.unit
    how = how or ReadOptions(machine=machine)
    told = how.unit or (unit if _is_told_by(driver, unit) else "")
    how = replace(how, unit=told, mixed=not one.positioning, motion=one.setup.component)
    content = _read_set(path, how, maps)
    if driver in CONVERTING:
        return _as_error(content, one, path)
    return replace(content, deviations=_factor(one) * content.deviations)


def _read_set(path: Path, how: ReadOptions, maps: Maps | None) -> MeasuredSet:
    content = read_file(path, how, maps).content
    if not isinstance(content, MeasuredSet):
        raise ConfigError("E-RUN-FILE", str(path), known=", ".join(result_endings()))
    return content


def _fits(content: MeasuredSet, one: PlannedSetup) -> bool:
    return ("um" if content.axis_unit == "mm" else "arcsec") == one.unit


def _is_told_by(driver: str, unit: str) -> bool:
    return driver == "rta" or (driver == "csv" and unit in ANGLES)


def _as_error(content: MeasuredSet, one: PlannedSetup, path: Path) -> MeasuredSet:
    """Deviations that say their own kind: it must be the error's; the targets are those of the axis that moved."""
    if not _fits(content, one):
        found = "um" if content.axis_unit == "mm" else "arcsec"
        raise CaptureError("E-DAY-UNIT", path.name, error=one.setup.component, found=found, wanted=one.unit)
    return replace(content, axis_unit=one.axis.unit)


def _factor(one: PlannedSetup) -> float:
    """From the numbers of a file of lengths to um or arcsec; nothing of a positioning is scaled."""
    if one.positioning:
        return 1.0
    return ARCSEC.get(one.setup.unit, 1.0)


def capture_of(one: PlannedSetup, measured: MeasuredSet, live: LiveSet | None, source: str) -> Capture:
    """A set-up's readings as its capture, in machine coordinates. Raises what `from_file` raises."""
    if one.positioning:
        return from_file(one.axis, measured, live, source)
    flip = one.setup.sense * one.axis.measure.file_axis_sense
    # Nothing of the air or material acts on it, and a turned axis does not turn what is read across it.
    across = replace(
        measured, deviations=flip * measured.deviations, axis_unit=one.axis.unit, compensated_for="air+material"
    )
    return from_file(one.axis, across, live, source)


# The axes' own positioning out of a measured plan: as `run` would have stored it, so that a push finds it.


def axes_from_setups(folder: RunFolder, site: SiteFile) -> dict[str, MeasuredAxis]:
    """Capture and evaluation of each axis whose positioning the plan measured, by name, in the order of the site.

    Each is brought to the line it is meant for, and stored as the axis' capture and evaluation "before". Raises
    ConfigError (E-CLOSE-AXES) when no axis was.
    """
    found: dict[str, MeasuredAxis] = {}
    for one in plan_setups(site):
        if one.positioning and folder.has(stages.setup(one.key)):
            capture = with_capture_doubts(folder.get(stages.setup(one.key), Capture), one.axis)
            capture = move_to_functional_line(capture, one.axis, site, folder)
            capture = with_conditions(capture, one.axis, site, start_positions(site, folder, one))
            parents = (folder.digest(stages.setup(one.key)),)
            found[one.axis.name] = evaluate_capture(folder, one.axis, phase="before", capture=capture, parents=parents)
    if not found:
        raise ConfigError("E-CLOSE-AXES", folder.run_id)
    return {axis.name: found[axis.name] for axis in site.axes if axis.name in found}
