"""One set-up measured and stored: mounting proved, captured live or read from a file; every step before the next."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path

from drivers.terms import spoken
from drivers.types.stops import Stop, StopPlan, StopReached
from drivers.types.tables import LiveSet
from gateway.capture.corrected import from_live
from gateway.capture.errormotion import LARGEST, ErrorRig, capture_error, channel_of, error_capture
from gateway.capture.gathered.raw import RawCapture
from gateway.capture.live import capture_axis
from gateway.capture.mounting import prove_mounting
from gateway.capture.retaking import demand_complete
from gateway.capture.rig import setup_of, step_of
from gateway.capture.sense import prove_sense
from gateway.capture.targets import jog_plan, jog_start, measuring_plan, plan_of, step_plan, targets_of
from gateway.config import AxisSection, SiteFile, unchecked_feed
from gateway.domain.captures import Capture
from gateway.errors import CaptureError
from gateway.model.chain import LOCATIONS
from gateway.store import Maps, RunFolder
from gateway.walk import walk
from gateway.workflow import stages
from gateway.workflow.axes.conditions import stands
from gateway.workflow.axes.measure import check_stops, fetch_tables, keep_statements, more_targets, plans_of_axis
from gateway.workflow.axes.more import MoreTargets
from gateway.workflow.axes.toothplaces import tooth_places
from gateway.workflow.bench import Bench
from gateway.workflow.errors21.filesetup import capture_of, read_setup
from gateway.workflow.errors21.setups import Planned

OPTICS = {
    ("linear", "um"): ("straightness", "unknown"),
    ("linear", "arcsec"): ("angular", "unknown"),
    ("rotary", "um"): ("straightness", "unknown"),
    ("rotary", "arcsec"): ("angular", "straightness", "unknown"),
}
ARTEFACTS = {"B0Z": "square", "A0C": "bar", "B0C": "bar", "X0C": "ball", "Y0C": "ball"}


def optics_of(one: Planned) -> str:
    """What is mounted for a set-up: linear, rotary, straightness or angular optics, or an artefact by its kind."""
    if one.positioning:
        return one.axis.kind
    return ARTEFACTS.get(one.setup.name) or OPTICS[one.axis.kind, one.unit][0]


async def measure_setup(at: Bench, one: Planned, tables: dict[str, LiveSet] | None = None) -> Capture:
    """Measure a set-up and store proof, averages, tables as read, and the capture last; returns it.

    Raises Incomplete (E-CAP-INCOMPLETE) where readings stay out of line: the set-up is then measured anew.
    ``tables`` are those read for earlier files, by axis: files measured long ago share one look at what is live.
    """
    at.say("P-SETUP", setup=one.key, component=one.setup.component, axis=one.axis.name)
    if one.setup.source == "file":
        capture, parents = await _from_file(at, one, tables if tables is not None else {})
    else:
        await _park(at, one)
        at.folder.write_text(stands_name(one.key), json.dumps(await stands(at)))
        capture, parents = await (_positioning(at, one) if one.positioning else _error(at, one))
        demand_complete(capture)
    at.folder.write_text(f"setup-{one.key}.json", one.setup.model_dump_json())
    at.folder.put(stages.setup(one.key), capture, parents)
    return capture


def coming(site: SiteFile, left: Sequence[Planned]) -> tuple[StopPlan, ...]:
    """What the control will be sent for these set-ups, in order, as long as no reading asks for more."""
    axes = {axis.name: axis for axis in site.axes}
    out: list[StopPlan] = []
    for one in left:
        if one.setup.source == "live":
            out += [_parking(axes[name], place) for name, place in sorted(one.setup.park.items())]
            out += plans_of_axis(one.axis, "before") if one.positioning else _error_plans(one)
    return tuple(out)


def _error_plans(one: Planned) -> list[StopPlan]:
    jog = jog_plan(one.axis, jog_start(one.axis, one.jog), one.jog, setup_of(one.axis))
    start, step = jog_start(one.axis, one.jog), one.setup.step
    steps = [step_plan(one.axis, start, step_of(one.axis, moved)) for moved in (step, 0.0)] if step else []
    return [jog, *steps, measuring_plan(one.axis, targets_of(one.axis), "")]


def _parking(axis: AxisSection, place: float) -> StopPlan:
    return plan_of(axis, (Stop(place, 1),), "", name=f"TFPARK{axis.letter}", dwell_s=0.1, save=False)


async def _park(at: Bench, one: Planned) -> None:
    """Bring the other axes to where they must stand; writes nothing but the program."""

    async def at_stop(_index: int, _stop: Stop, _reached: StopReached) -> None:
        return None

    for name, place in sorted(one.setup.park.items()):
        plan = _parking(at.axis(name), place)
        await walk(at.supervisor.controller, plan, at_stop=at_stop, patience=at.patience, say=at.say)


def stands_name(key: str) -> str:
    """The file that keeps where all axes stood when a set-up began."""
    return f"stands-{key}.json"


def stood(site: SiteFile, folder: RunFolder, one: Planned) -> dict[str, float]:
    """Where the axes stood when a set-up began, by letter; of a file what its `park` says."""
    name = stands_name(one.key)
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


async def _positioning(at: Bench, one: Planned) -> tuple[Capture, tuple[str, ...]]:
    rig = at.rig(one.axis)
    proof = await prove_sense(rig)
    without_cross(await rig.controller.saved_tables(one.axis.name), at.moved)
    more = more_targets(at, one.axis, proof, rig.instrument.compensated_for)
    raw = await capture_axis(rig, proof, check_stops(one.axis, "before"), more)
    digest = at.folder.put(stages.setup_raw(one.key), raw)
    at.folder.write_text(f"tables-{one.key}{spoken().tables_suffix}", raw.live.native)
    capture = from_live(one.axis, raw, proof, rig.instrument.compensated_for)
    return replace(capture, notes=(*capture.notes, *unchecked_feed(at.site, one.axis))), (digest,)


async def _error(at: Bench, one: Planned) -> tuple[Capture, tuple[str, ...]]:
    rig = error_rig(at, one)
    mounted = await prove_mounting(rig)
    proved = at.folder.put(stages.setup_proof(one.key), mounted)
    without_cross(await rig.controller.saved_tables(one.axis.name), at.moved)
    absolute = one.setup.name in ("X0C", "Y0C")

    def corrected(raw: RawCapture) -> Capture:
        return error_capture(rig, raw, one.setup.sense, absolute=absolute, proved=mounted.sense)

    raw = await capture_error(rig, _finer(at, rig.axis, one.setup.name, corrected))
    digest = at.folder.put(stages.setup_raw(one.key), raw, (proved,))
    at.folder.write_text(f"tables-{one.key}{spoken().tables_suffix}", raw.live.native)
    return corrected(raw), (digest,)


def _finer(at: Bench, axis: AxisSection, name: str, corrected: Callable[[RawCapture], Capture]) -> MoreTargets | None:
    """More targets for an error motion, where the tooth is ground alone; a location is one number and needs none."""
    tooth = tooth_places(at.site, at.site_path, axis)
    if name[:2] in LOCATIONS or not tooth.size:
        return None
    return MoreTargets(axis, corrected, at.say, tooth=tooth, share=1.0)


def error_rig(at: Bench, one: Planned) -> ErrorRig:
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


async def _from_file(at: Bench, one: Planned, tables: dict[str, LiveSet]) -> tuple[Capture, tuple[str, ...]]:
    path = at.site_path.parent / Path(str(one.setup.path))
    measured = read_setup(path, one, at.site.site.name, Maps(at.store.root))
    keep_statements(at, path, measured, one.axis.measure.accept)
    at.folder.write_bytes(f"source-{one.key}{path.suffix}", path.read_bytes())
    if one.axis.name not in tables:
        tables[one.axis.name] = await fetch_tables(at, at.axis(one.axis.name))
    live = tables[one.axis.name]
    without_cross(live, at.moved)
    return capture_of(one, measured, live, path.name), ()
