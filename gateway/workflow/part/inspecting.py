"""Inspects a ground part on the gear inspection machine, or reads what another machine wrote of it, and stores both."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from drivers import registry
from drivers.clock import Clock
from drivers.errors import ConfigError, DeviceRefused, FileFormatError, TrueflankError
from drivers.message import Message, fixed
from drivers.ports.instruments import GearInspector
from drivers.types.gearfiles import GearContour
from drivers.types.gears import ClampedPart, GearInspection, GearPlan, GearTraces, InspectedGear
from gateway.config import SiteFile
from gateway.correct.part.inspected import InspectionSource, check_gear, inspected_flank
from gateway.domain.equipment import Equipment
from gateway.errors import IllegalTransition
from gateway.events import RunStarted
from gateway.gear.cycloid import CycloidGear
from gateway.gear.measured_points import Heights
from gateway.gear.traces import inspection_of_contour, inspection_of_traces
from gateway.say import Say
from gateway.store import Maps, RunFolder
from gateway.store.disk import checked_name
from gateway.store.maps import Value
from gateway.study.inputs import gear_of
from gateway.tooth import InspectedFlank
from gateway.workflow import stages
from gateway.workflow.axes.measure import store_equipment
from gateway.workflow.bench import Bench, bench
from gateway.workflow.files.reading import How, gear_driver, read_file
from gateway.workflow.part.planning import gear_of_site, work_section
from gateway.workflow.part.running import running_words
from gateway.workflow.runsite import new_run, store_of

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
            async with bench(site, site_path, folder=folder, clock=clock, say=say, instruments={inspector}) as at:
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


def check_machine(at: Bench, run: RunFolder) -> None:
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


async def inspect_part(at: Bench, part: str, others: Mapping[str, str] | None = None) -> InspectedFlank:
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
    await _clamped(at, machine, name, part, {**(others or {}), **part_numbers(at.folder, part)})
    raw = RawInspection(await _measured(at, machine, gear, part))
    seen = next(one.identity for one in at.supervisor.picture() if one.name == name)
    about = InspectionSource(
        part=part,
        source=name,
        serial=seen.serial if seen is not None else "",
        measured_utc=raw.plans[-1].measured_utc,
        clamping_um=work_section(at.site).inspection_clamping_um,
        said=_said(raw.plans),
    )
    return _kept(at.folder, raw, gear, about, at.say)


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
    points, notes = _points_of(gear, file, How(machine=site.site.name, columns=file.columns, gear=True), maps, utc=utc)
    clamping = work.inspection_clamping_um
    about = InspectionSource(part, file.path.name, clamping_um=clamping, heights=file.heights, said=notes)
    return _kept(folder, RawInspection(file=points), gear, about, say)


def _points_of(
    gear: CycloidGear, file: FlankFile, how: How, maps: Maps, *, utc: Callable[[], datetime] | None
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


def _inspector(at: Bench, name: str) -> GearInspector:
    device: object = at.supervisor.instrument(name)
    if not isinstance(device, GearInspector):
        raise ConfigError("E-INSPECT-INSPECTOR", "[work] inspector", name=name)
    return device


async def _clamped(at: Bench, machine: GearInspector, name: str, part: str, known: Mapping[str, str]) -> None:
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


async def _measured(at: Bench, machine: GearInspector, gear: CycloidGear, part: str) -> tuple[InspectedGear, ...]:
    plans = plans_of(gear)
    done: list[InspectedGear] = []
    for number, plan in enumerate(plans, start=1):
        done.append(await machine.inspect(plan, _told(at.say, part, number, len(plans))))
        if done[0].part != done[-1].part:
            first, now = (f"{one.part.part} {one.part.clamping}" for one in (done[0], done[-1]))
            raise DeviceRefused("E-INSPECT-RECLAMPED", "gear inspection", first=first, now=now)
        if number == 1:
            check_gear(gear, done[0].inspection)
    return tuple(done)


def _told(say: Say, part: str, number: int, total: int) -> Callable[[str, int, int], None]:
    """Tells every quarter of a plan."""
    before = 0

    def told(_trace: str, done: int, points: int) -> None:
        nonlocal before
        percent = 100 * done // max(points, 1)
        if percent // TELL_PERCENT > before // TELL_PERCENT:
            say("P-INSPECT", part=part, number=number, total=total, percent=percent, points=points)
        before = percent

    return told


def _said(plans: tuple[InspectedGear, ...]) -> tuple[Message, ...]:
    part, warm = plans[-1].part, plans[-1].temperature_degc
    said = [Message.of("S-INSPECT-PART", number=part.part, clamping=part.clamping or "-")] if part.part else []
    if warm is not None and abs(warm - 20.0) > WARM_K:
        said.append(Message.of("S-INSPECT-WARM", degc=fixed(warm)))
    return tuple(said)


def _kept(
    folder: RunFolder, raw: RawInspection, gear: CycloidGear, about: InspectionSource, say: Say
) -> InspectedFlank:
    """The points stored before anything is made of them, then the record."""
    parents = [folder.put(stages.inspected_raw(about.part), raw)]
    if folder.has(stages.ground(about.part)):
        parents.append(folder.digest(stages.ground(about.part)))
    found = inspected_flank(gear, raw.whole, about)
    if folder.has(stages.ground(about.part)):  # of parts made elsewhere nobody knows in which order
        found = replace(found, said=(*found.said, *running_words(found.fitted, gear)))
    folder.put(stages.inspected(about.part), found, tuple(parents))
    told = {"rms": fixed(found.fitted.rms_um), "u": fixed(found.rms_u_um), "points": found.k.size}
    say("P-INSPECTED", part=about.part, **told)
    return found
