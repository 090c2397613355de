"""A ground part inspected on the gear inspection machine or from a file, its drift over the spaces, and the guard.

The points are stored before anything is made of them. The guard compares a part of today with the one that a run
approved, by the flanks alone.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from drivers import registry
from drivers.clock import Clock
from drivers.errors import ConfigError, DeviceRefused, FileFormatError, TrueflankError
from drivers.message import Message, Quantity, fixed
from drivers.ports.instruments import GearInspector
from drivers.types.gearfiles import GearContour
from drivers.types.gears import ClampedPart, GearInspection, GearPlan, GearTraces, InspectedGear
from gateway.config import SiteFile
from gateway.correct.part.fitted_places import guard_flanks
from gateway.correct.part.inspected import InspectionSource, check_gear, inspected_flank
from gateway.domain.equipment import Equipment
from gateway.errors import IllegalTransition
from gateway.evaluate.uncertainty.budget import coverage_factor
from gateway.events import RunStarted
from gateway.gear.cycloid import CycloidGear
from gateway.gear.measured_points import Heights
from gateway.gear.process_drift import ProcessDrift, depth_running, index_running
from gateway.gear.traces import inspection_of_contour, inspection_of_traces
from gateway.guard import GuardVerdict
from gateway.say import Say
from gateway.store import Maps, RunFolder, Value, checked_name
from gateway.study.inputs import gear_of
from gateway.tooth import FlankMap, InspectedFlank
from gateway.workflow.axes.measure import store_equipment
from gateway.workflow.axes.short_capture import EXIT, GUARDED
from gateway.workflow.files.reading import ReadOptions, gear_driver, read_file
from gateway.workflow.run import stages
from gateway.workflow.run.context import RunContext, open_context
from gateway.workflow.run.folder import new_run, store_of
from gateway.workflow.tooth.part_plan import gear_of_site, work_section

INSPECTED = "inspected"
LEVELS = (-0.45, -0.225, 0.0, 0.225, 0.45)  # of the face width, from its middle
PROFILE_POINTS = 11
LOOK_S = 5.0
WARM_K = 0.1
TELL_PERCENT = 25


@dataclass(frozen=True, slots=True, eq=False)
class RawInspection:
    """One part's points as a machine gave them, plan by plan in one clamping, or as a file held them."""

    plans: tuple[InspectedGear, ...] = ()
    file: GearInspection | None = None

    @property
    def clamped(self) -> ClampedPart:
        """What was clamped; nothing for a file."""
        return self.plans[-1].part if self.plans else ClampedPart(clamped=False)

    @property
    def whole(self) -> GearInspection:
        """All flank points together."""
        if self.file is not None:
            return self.file
        parts = [plan.inspection for plan in self.plans]
        given = [part.deviation_um for part in parts if part.deviation_um is not None]
        probes = [part.probe_u_um for part in parts if part.probe_u_um]
        return GearInspection(
            points_mm=np.concatenate([part.points_mm for part in parts]),
            space=np.concatenate([part.space for part in parts]),
            flank=np.concatenate([part.flank for part in parts]),
            deviation_um=np.concatenate(given) if len(given) == len(parts) else None,
            probe_u_um=max(probes) if len(probes) == len(parts) else None,
            source=parts[0].source,
        )


@dataclass(frozen=True, slots=True)
class FlankFile:
    """A file of flank points: what its heights count from, and its columns where they are said now (else as before)."""

    path: Path
    heights: Heights = "lower-face"
    columns: Mapping[str, Value] | None = None


async def inspect_site(
    site: SiteFile,
    site_path: Path,
    *,
    part: str,
    clock: Clock,
    say: Say,
    run: RunFolder | None = None,
    file: FlankFile | None = None,
) -> tuple[InspectedFlank, RunFolder]:
    """Inspect a part, in a run folder of its own or in ``run``, whose state stays what it was; or read a file of it.

    Raises IllegalTransition (E-SETUP-MACHINE: ``run`` is another machine's), and what `inspect_part` and
    `inspect_file` raise; the folder keeps the error.
    """
    inspector = "" if file is not None else inspector_name(site)
    folder = run or new_run(site, site_path, utc=clock.utc)
    before = folder.state
    RunStarted(str(folder.path)).tell(say)
    try:
        if file is not None:
            found = inspect_file(site, site_path, file=file, folder=folder, part=part, say=say, utc=clock.utc)
        else:
            async with open_context(
                site, site_path, folder=folder, clock=clock, say=say, instruments={inspector}
            ) as at:
                if not folder.has(stages.EQUIPMENT):
                    store_equipment(at)
                check_machine(at, folder)
                found = await inspect_part(at, part)
    except TrueflankError as error:
        folder.set_state(before if run is not None else "failed", error=error.as_record())
        raise
    except asyncio.CancelledError:
        folder.set_state(before if run is not None else "stopped")
        raise
    folder.set_state(before if run is not None else INSPECTED)
    return found, folder


def check_machine(at: RunContext, run: RunFolder) -> None:
    """Refuse a run of another machine. Raises IllegalTransition (E-SETUP-MACHINE)."""
    known = run.has(stages.EQUIPMENT)
    differ = run.get(stages.EQUIPMENT, Equipment).machine.differences(at.machine) if known else ()
    if differ:
        raise IllegalTransition("E-SETUP-MACHINE", run.run_id, fields=", ".join(differ))


def inspector_name(site: SiteFile) -> str:
    """The site's gear inspection machine. Raises ConfigError (E-GRIND-NO-WORK, E-INSPECT-INSPECTOR)."""
    name = work_section(site).inspector
    if name not in {one.name for one in site.instruments}:
        raise ConfigError("E-INSPECT-INSPECTOR", "[work] inspector", name=name or "nothing")
    return name


async def inspect_part(at: RunContext, part: str, others: Mapping[str, str] | None = None) -> InspectedFlank:
    """Inspect the part that is clamped and store it as stages ``inspected-<part>`` and ``inspected-<part>-raw``.

    Profile lines on both flanks of every space at five heights and one touch for pitch, in one clamping. Waits for a
    person to clamp it. ``others`` are numbers and names of parts it must not be, beside those of this run. Raises
    ConfigError (E-INSPECT-INSPECTOR), DeviceRefused (E-INSPECT-UNCLAMPED, E-GEAR-ENDED, E-INSPECT-SAME,
    E-INSPECT-RECLAMPED), ModelError (E-INSPECT-...: wrong gear, spaces missing, too many glitches), and what the wire
    raises; the machine's plan is stopped then.
    """
    checked_name(stages.inspected(part))
    name = inspector_name(at.site)
    machine = _inspector(at, name)
    gear = gear_of(gear_of_site(at.site, at.site_path))
    await _wait_for_part(at, machine, name, part, {**(others or {}), **part_numbers(at.folder, part)})
    raw = RawInspection(await _measure_plans(at, machine, gear, part))
    seen = next(one.identity for one in at.supervisor.picture() if one.name == name)
    about = InspectionSource(
        part=part,
        source=name,
        serial=seen.serial if seen is not None else "",
        measured_utc=raw.plans[-1].measured_utc,
        clamping_um=work_section(at.site).inspection_clamping_um,
        said=_plan_words(raw.plans),
    )
    return _store_inspection(at.folder, raw, gear, about, at.say)


def inspect_file(
    site: SiteFile,
    site_path: Path,
    file: FlankFile,
    folder: RunFolder,
    part: str,
    *,
    say: Say,
    utc: Callable[[], datetime] | None = None,
) -> InspectedFlank:
    """The same record from a file of flank points; columns said now are remembered for its like if ``utc`` is given.

    Raises ConfigError (E-GRIND-NO-WORK, E-INSPECT-FILE, E-FILE-...), FileFormatError, ModelError (E-INSPECT-...).
    """
    checked_name(stages.inspected(part))
    work, gear = work_section(site), gear_of(gear_of_site(site, site_path))
    maps = Maps(store_of(site, site_path).root)
    points, notes = _points_of(
        gear, file, ReadOptions(machine=site.site.name, columns=file.columns, gear=True), maps, utc=utc
    )
    clamping = work.inspection_clamping_um
    about = InspectionSource(part, file.path.name, clamping_um=clamping, heights=file.heights, said=notes)
    return _store_inspection(folder, RawInspection(file=points), gear, about, say)


def _points_of(
    gear: CycloidGear, file: FlankFile, how: ReadOptions, maps: Maps, *, utc: Callable[[], datetime] | None
) -> tuple[GearInspection, tuple[Message, ...]]:
    """Flank points of a file, whether it has points, traces or plane contour scans; and notes of its reading.

    Raises ConfigError (E-INSPECT-FILE), FileFormatError (E-GEARFILE-INVOLUTE), ModelError, and what `read_file` raises.
    """
    own = gear_driver(file.path)
    if own:
        content = registry.load(own, "gear-curves")().read(file.path)
        if not isinstance(content, GearContour):
            raise FileFormatError("E-GEARFILE-INVOLUTE", str(file.path))
        return inspection_of_contour(gear, content), (Message.of("S-GEARFILE-CONTOUR"),)
    read = read_file(file.path, how, maps, utc)
    if isinstance(read.content, GearTraces):
        return inspection_of_traces(gear, read.content), read.notes
    if not isinstance(read.content, GearInspection):
        raise ConfigError("E-INSPECT-FILE", str(file.path))
    return read.content, read.notes


def plans_of(gear: CycloidGear) -> tuple[GearPlan, ...]:
    """What is asked of the machine, height by height; on its wire heights count from the lower face."""
    spaces, middle = tuple(range(gear.zc)), 0.5 * gear.b
    heights = [middle + level * gear.b for level in LEVELS]
    plans = [GearPlan(gear.zc, spaces, profile_points=PROFILE_POINTS, profile_z_mm=height) for height in heights]
    pitch = GearPlan(gear.zc, spaces, profile_points=PROFILE_POINTS, profile_z_mm=middle, pitch=True)
    return tuple(pitch if plan.profile_z_mm == middle else plan for plan in plans)


def inspected_parts(folder: RunFolder) -> tuple[str, ...]:
    """Names of the parts that a run holds inspected."""
    names = [stage.removeprefix("inspected-") for stage in folder.stages if stage.startswith("inspected-")]
    return tuple(name for name in names if not name.endswith("-raw"))


def inspected_of(folder: RunFolder, part: str = "") -> InspectedFlank:
    """A run's inspected part: the one named, else "after", else the only one.

    Raises IllegalTransition (E-INSPECT-WHICH).
    """
    known = inspected_parts(folder)
    usual = "after" if "after" in known else (known[0] if len(known) == 1 else "")
    if (part or usual) not in known:
        raise IllegalTransition("E-INSPECT-WHICH", folder.run_id, part=part, known=", ".join(known) or "none")
    return folder.get(stages.inspected(part or usual), InspectedFlank)


def _inspector(at: RunContext, name: str) -> GearInspector:
    device: object = at.supervisor.instrument(name)
    if not isinstance(device, GearInspector):
        raise ConfigError("E-INSPECT-INSPECTOR", "[work] inspector", name=name)
    return device


async def _wait_for_part(
    at: RunContext, machine: GearInspector, name: str, part: str, known: Mapping[str, str]
) -> None:
    """Wait until a part is clamped that is none of those known by number."""
    waited, asked = 0.0, False
    while True:
        seen = await machine.part()
        if seen.clamped and seen.part not in known:
            return
        if waited >= at.patience.start_s:
            break
        if not asked:
            at.say("P-INSPECT-CLAMP", part=part, name=name)
            asked = True
        await at.clock.sleep(LOOK_S)
        waited += LOOK_S
    if seen.clamped:
        raise DeviceRefused("E-INSPECT-SAME", name, number=seen.part, other=known[seen.part], part=part)
    raise DeviceRefused("E-INSPECT-UNCLAMPED", name)


def part_numbers(folder: RunFolder, part: str = "") -> dict[str, str]:
    """What the machine called the other parts of a run: number to name."""
    found = {}
    for other in inspected_parts(folder):
        if other != part and folder.has(stages.inspected_raw(other)):
            found[folder.get(stages.inspected_raw(other), RawInspection).clamped.part] = other
    return {number: other for number, other in found.items() if number}


async def _measure_plans(
    at: RunContext, machine: GearInspector, gear: CycloidGear, part: str
) -> tuple[InspectedGear, ...]:
    plans = plans_of(gear)
    done: list[InspectedGear] = []
    for number, plan in enumerate(plans, start=1):
        done.append(await machine.inspect(plan, _progress_teller(at.say, part, number, len(plans))))
        if done[0].part != done[-1].part:
            first, now = (f"{one.part.part} {one.part.clamping}" for one in (done[0], done[-1]))
            raise DeviceRefused("E-INSPECT-RECLAMPED", "gear inspection", first=first, now=now)
        if number == 1:
            check_gear(gear, done[0].inspection)
    return tuple(done)


def _progress_teller(say: Say, part: str, number: int, total: int) -> Callable[[str, int, int], None]:
    """Tells every quarter of a plan."""
    before = 0

    def told(_trace: str, done: int, points: int) -> None:
        nonlocal before
        percent = 100 * done // max(points, 1)
        if percent // TELL_PERCENT > before // TELL_PERCENT:
            say("P-INSPECT", part=part, number=number, total=total, percent=percent, points=points)
        before = percent

    return told


def _plan_words(plans: tuple[InspectedGear, ...]) -> tuple[Message, ...]:
    part, warm = plans[-1].part, plans[-1].temperature_degc
    said = [Message.of("S-INSPECT-PART", number=part.part, clamping=part.clamping or "-")] if part.part else []
    if warm is not None and abs(warm - 20.0) > WARM_K:
        said.append(Message.of("S-INSPECT-WARM", degc=fixed(warm)))
    return tuple(said)


def _store_inspection(
    folder: RunFolder, raw: RawInspection, gear: CycloidGear, about: InspectionSource, say: Say
) -> InspectedFlank:
    """The points stored before anything is made of them, then the record."""
    parents = [folder.put(stages.inspected_raw(about.part), raw)]
    if folder.has(stages.ground(about.part)):
        parents.append(folder.digest(stages.ground(about.part)))
    found = inspected_flank(gear, raw.whole, about)
    if folder.has(stages.ground(about.part)):  # of parts made elsewhere nobody knows in which order
        found = replace(found, said=(*found.said, *drift_messages(found.fitted, gear)))
    folder.put(stages.inspected(about.part), found, tuple(parents))
    told = {"rms": fixed(found.fitted.rms_um), "u": fixed(found.rms_u_um), "points": found.k.size}
    say("P-INSPECTED", part=about.part, **told)
    return found


# What ran while a part was ground, said of the part: wear and heat, which no table takes.

# Two figures of each of three parts are looked at: one false word in fifty runs or so.
CONFIDENCE = 0.997
LEAST_UM = 0.1  # on the flank; what is smaller is nobody's business


def drift_messages(flank: FlankMap, gear: CycloidGear) -> tuple[Message, ...]:
    """What of a flank ran on from the first space ground (0) to the last; nothing where that is not sure."""
    depth, index = depth_running(flank, gear), index_running(flank, gear)
    found = (("S-INSPECT-DEPTH-RUNS", depth, 2), ("S-INSPECT-INDEX-RUNS", index, 1))
    return tuple(Message.of(code, **_figures(one, digits)) for code, one, digits in found if is_significant(one))


def expanded_uncertainty(one: ProcessDrift) -> float:
    """Its expanded uncertainty, at least as sure as `CONFIDENCE` says; infinite where nobody can tell."""
    return coverage_factor(CONFIDENCE, one.freedom) * one.u if one.freedom else float("inf")


def is_significant(one: ProcessDrift) -> bool:
    """Beyond its uncertainty, and of a size that matters."""
    return abs(one.value) > expanded_uncertainty(one) and one.flank_um > LEAST_UM


def _figures(one: ProcessDrift, digits: int) -> dict[str, Quantity | str]:
    return {
        "value": fixed(one.value, digits, signed=True),
        "U": fixed(expanded_uncertainty(one), digits),
        "flank": fixed(one.flank_um),
    }


# The drift guard from gears alone: a part inspected now against the one a run approved, and a plain answer.

PART = "guard"
ANSWERS = {"still valid": "S-GUARD-VALID", "re-measure this axis": "S-GUARD-AGAIN", "cannot tell": "S-GUARD-OPEN"}
"""The answers of a guard about a machine, as people read them."""


@dataclass(frozen=True, slots=True)
class GearGuardOutcome:
    """The verdict on one approved part and where the check is kept."""

    part: str
    verdict: GuardVerdict
    approved_run: str
    run_folder: str

    @property
    def exit_code(self) -> int:
        """0 still valid, 20 measure again, 21 cannot tell."""
        return EXIT[self.verdict.answer]

    @property
    def lines(self) -> tuple[Message, ...]:
        """For people."""
        seen = self.verdict
        numbers = {"largest": fixed(seen.largest, signed=True), "at": fixed(seen.at, 0), "margin": fixed(seen.margin)}
        answer = Message.of(ANSWERS[seen.answer])
        told = Message.of("W-INSPECT-GUARD", part=self.part, answer=answer, limit=Quantity(seen.limit), **numbers)
        return told, *seen.said, Message.of("S-REPORT-FOLDER", path=self.run_folder)

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        kept = {"gear": self.part, "approved_run": self.approved_run, "run_folder": self.run_folder}
        return {**kept, **self.verdict.as_data(), "exit_code": self.exit_code}


async def guard_gear_site(
    site: SiteFile,
    site_path: Path,
    run: RunFolder,
    *,
    clock: Clock,
    say: Say,
    part: str = "",
    file: FlankFile | None = None,
    limit_um: float | None = None,
) -> GearGuardOutcome:
    """Inspect the part that is clamped (or read a file) and judge it against ``part`` of ``run``. Writes no table.

    The approved part itself proves nothing and is refused. Which tables acted while the new part was ground is for the
    operator to know: other tables, another flank. Raises
    IllegalTransition (E-INSPECT-WHICH, E-SETUP-MACHINE), and what `inspect_part` and `inspect_file` raise.
    """
    approved = inspected_of(run, part)
    inspector = "" if file is not None else inspector_name(site)
    folder = new_run(site, site_path, utc=clock.utc)
    RunStarted(str(folder.path)).tell(say)
    try:
        if file is not None:
            now = inspect_file(site, site_path, file=file, folder=folder, part=PART, say=say)
        else:
            async with open_context(
                site, site_path, folder=folder, clock=clock, say=say, instruments={inspector}
            ) as at:
                check_machine(at, run)
                store_equipment(at)
                now = await inspect_part(at, PART, part_numbers(run))
        verdict = _judge_part(site, site_path, approved, now, limit_um)
    except TrueflankError as error:
        folder.set_state("failed", error=error.as_record())
        raise
    except asyncio.CancelledError:
        folder.set_state("stopped")
        raise
    folder.put(stages.GUARD, verdict, (folder.digest(stages.inspected(PART)),))
    folder.set_state(GUARDED)
    return GearGuardOutcome(approved.part, verdict, run.run_id, str(folder.path))


def _judge_part(
    site: SiteFile, site_path: Path, approved: InspectedFlank, now: InspectedFlank, limit_um: float | None
) -> GuardVerdict:
    gear = gear_of(gear_of_site(site, site_path))
    return guard_flanks(approved, now, gear, limit_um or site.guard.limit_um)
