"""Errors other than positioning measured on the cell, set-up by set-up; judged by the cell's truth."""

from __future__ import annotations

import tomllib
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import ConfigError, TrueflankError, UnsupportedDevice
from gateway.config import SiteFile, load_site
from gateway.correct.outlook.flank_uncertainty import ToothSpec
from gateway.domain.captures import Capture
from gateway.errors import CaptureError
from gateway.model.components import value
from gateway.say import silence
from gateway.store import RunFolder, Store
from gateway.study.inputs import gear_of, load_gear
from gateway.supervisor import DevicesFailed, Supervisor
from gateway.workflow.axes.short_capture import GuardOutcome, guard_site
from gateway.workflow.complete_run import run_site
from gateway.workflow.errors21.measurement import PlanOutcome, measure_site
from gateway.workflow.errors21.setups import plan_setups
from gateway.workflow.run.folder import store_of
from simulators.cell import Cell
from simulators.cell.backdoor import BackDoor
from simulators.cell.setup_files import write_site_of_files
from simulators.cell.site import section
from simulators.cellfile import load_cell, with_plan
from simulators.truth import Truth
from tests.cell.bench import short
from tests.selftested import cell_running


def only(keys: tuple[str, ...], axes: tuple[str, ...], count: int, repetitions: int) -> Callable[[str], str]:
    """An edit of a site file: only these axes and components, fewer stops."""

    def edit(text: str) -> str:
        site = tomllib.loads(text)
        setups = [one for one in site["setups"] if one["component"] in keys and one["axis"] in axes]
        used = {one["instrument"] for one in setups}
        parts = [section(name, site[name]) for name in ("site", "controller", "operator", "moves") if name in site]
        parts += [section("[instruments]", item) for item in site["instruments"] if item["name"] in used]
        for axis in (axis for axis in site["axes"] if axis["name"] in axes):
            targets = {**axis["measure"]["targets"], "count": count}
            measure = {**axis["measure"], "targets": targets, "repetitions": repetitions}
            measure["instrument"] = next(one["instrument"] for one in setups if one["axis"] == axis["name"])
            parts += [section("[axes]", {k: v for k, v in axis.items() if k not in ("measure", "table")})]
            parts += [section("axes.measure", measure), section("axes.table", axis["table"])]
        parts += [section("[setups]", one) for one in setups]
        return "\n".join(parts)

    return edit


def without_positioning(site: SiteFile) -> SiteFile:
    """The plan's set-ups alone: no axis is measured for itself."""
    axes = [
        axis.model_copy(update={"measure": axis.measure.model_copy(update={"component": "none"})}) for axis in site.axes
    ]
    return site.model_copy(update={"axes": axes})


def on_cell(
    folder: Path, edit: Callable[[str], str], story: Callable[[Cell, SiteFile, LoopClock], Awaitable[Any]]
) -> Any:
    async def job() -> Any:
        clock = LoopClock()
        plan = with_plan(load_cell("demo"))
        async with cell_running(plan, folder / "cell", clock, wires="memory", block_s=1.0) as cell:
            cell.site_path.write_text(edit(cell.site_path.read_text(encoding="utf-8")), encoding="utf-8")
            return await story(cell, load_site(cell.site_path), clock)

    return run_virtual(job)


async def truth_of(cell: Cell, name: str, at: np.ndarray) -> np.ndarray:
    """The true motion without its least-squares line, zero at the reference, as the model tells it."""
    answer = await BackDoor(cell).answer({"ask": "motion", "name": name, "positions": at.tolist()})
    true = np.asarray(answer["motion"])
    if name[1] in "XYZ" and name[1] != name[2]:
        true = true - np.polyval(np.polyfit(at, true, 1), at)
    return true - np.interp(0.0, at, true)


def with_file(edit: Callable[[str], str], path: Path) -> Callable[[str], str]:
    """Pitch comes from a table of urad that somebody else measured."""

    def edited(text: str) -> str:
        keys = {"axis": "X1", "component": "EBX", "source": "file", "path": str(path), "datum": 0.0, "unit": "urad"}
        return f"{edit(text)}\n{section('[setups]', keys)}"

    return edited


def written(cell: Cell, path: Path) -> None:
    """The true pitch in urad at 11 places, with a hundredth of scatter, as a table."""
    at = np.linspace(-400.0, 0.0, 11)
    rows = ["target_mm,direction,repetition,deviation"]
    for place, arcsec in zip(at, cell.truth.motion("EBX", at), strict=True):
        for repetition in (1, 2):
            urad = arcsec * 4.8481368 + 0.02 * repetition
            rows += [f"{place},{sign},{repetition},{urad}" for sign in "+-"]
    path.write_text("\n".join(rows), encoding="utf-8")


def test_a_plan_is_walked_stopped_and_resumed_and_every_component_identified(tmp_path: Path) -> None:
    """Wrong optics are refused; the run is resumed, nothing twice; another plan, machine or table refuses it."""
    table = tmp_path / "pitch.csv"

    async def story(cell: Cell, whole: SiteFile, clock: LoopClock) -> None:
        site = without_positioning(whole)
        root = store_of(site, cell.site_path).root
        written(cell, table)

        async def measured(wanted: tuple[str, ...] = (), run: str = "", of: SiteFile = site) -> PlanOutcome:
            folder = Store(root).open(run) if run else None
            return await measure_site(of, cell.site_path, clock=clock, say=silence, wanted=wanted, resume=folder)

        async def refused(run: str, of: SiteFile = site) -> str:
            with pytest.raises(TrueflankError) as caught:
                await measured((), run, of)
            return caught.value.code

        cell.operator.change(mounts_wrong=("EAX",))
        with pytest.raises(UnsupportedDevice) as caught:
            await measured(("EAX",))
        assert caught.value.code == "E-SETUP-LIGHT"
        cell.operator.change(mounts_wrong=())
        first = await measured(("EAX",))
        assert (first.state, first.remaining) == ("partly-measured", ("EBX-X1", "EYX-X1"))
        assumed = {row.name for row in first.rows if row.state == "assumed"}
        assert assumed == {"EXX", "EYX", "EZX", "EBX", "ECX"}, "of the machine's errors: this site has one axis"

        changed = tuple(one.model_copy(update={"sense": -1}) for one in site.setups)
        assert await refused(first.run_folder, site.model_copy(update={"setups": changed})) == "E-SETUP-CHANGED"
        cell.nck.set("$MA_BACKLASH[0,X1]", 0.001, 0)
        assert await refused(first.run_folder) == "E-SETUP-TABLES"
        cell.nck.set("$MA_BACKLASH[0,X1]", 0.0, 0)
        await BackDoor(cell).answer({"set": "serial", "value": "another"})
        other = site.model_copy(update={"controller": site.controller.model_copy(update={"serial": "another"})})
        assert await refused(first.run_folder, other) == "E-SETUP-MACHINE"
        await BackDoor(cell).answer({"set": "serial", "value": site.controller.serial})

        before = len(cell.operator.log)
        second = await measured((), first.run_folder)
        assert (second.state, second.remaining) == ("measured", ())
        mounted = [line for line in cell.operator.log[before:] if line.startswith("mounted")]
        assert set(mounted) == {"mounted EYX on X"}
        folder = Store(root).open(second.run_folder)
        for one in second.model.motions:
            at = folder.get(f"setup-{one.name}-X1", Capture).targets
            true = await truth_of(cell, one.name, at)
            limit = max(0.3, 0.05 * float(np.ptp(true)))
            assert np.max(np.abs(value(one, at) - true)) < limit, one.name
        assert {one.name for one in second.model.motions} == {"EAX", "EBX", "EYX"}

    on_cell(tmp_path, with_file(only(("EAX", "EYX"), ("X1",), 11, 2), table), story)


def few(count: int, repetitions: int, drop: tuple[str, ...] = ()) -> Callable[[str], str]:
    """An edit: every set-up (but some), fewer stops."""

    def edit(text: str) -> str:
        site = tomllib.loads(text)
        setups = [one for one in site["setups"] if one["component"] not in drop]
        parts = [
            section(name, site[name]) for name in ("site", "controller", "operator", "moves", "work") if name in site
        ]
        parts += [section("[instruments]", item) for item in site["instruments"]]
        for axis in site["axes"]:
            targets = {**axis["measure"]["targets"], "count": count + 4 * (axis["kind"] == "rotary")}
            measure = {**axis["measure"], "targets": targets, "repetitions": repetitions}
            parts += [section("[axes]", {k: v for k, v in axis.items() if k not in ("measure", "table")})]
            parts += [section("axes.measure", measure), section("axes.table", axis["table"])]
        return "\n".join([*parts, *(section("[setups]", one) for one in setups)])

    return edit


def turning_truth(cell: Cell, name: str, at: np.ndarray) -> np.ndarray:
    """The true motion of C without mean and, pairs, without what turns with the axis."""
    dense = np.arange(720) / 2.0
    wave = np.exp(1j * np.deg2rad(dense))
    pair = {"EXC": "EYC", "EYC": "EXC", "EAC": "EBC", "EBC": "EAC"}.get(name)
    true = cell.truth.motion(name, at) - np.mean(cell.truth.motion(name, dense))
    if pair is None:
        return true
    # first = u cos - v sin, second = u sin + v cos: u + iv is the part of first + i second that turns with the axis.
    first, second = (cell.truth.motion(one, dense) for one in sorted((name, pair)))
    turned = np.mean((first + 1j * second) * np.conj(wave)) * np.exp(1j * np.deg2rad(at))
    return true - (turned.real if name < pair else turned.imag)


def true_leans(cell: Cell, folder: RunFolder, parked: str = "") -> dict[str, float]:
    """Location errors as the model tells them, arcsec: slopes of straightness, X's tilt at 0 and C's mean in them.

    ``parked`` ends the keys of set-ups along a bar that say where more than C stood.
    """

    def slope(name: str, key: str) -> float:
        at = folder.get(f"setup-{key}", Capture).targets
        return float(np.polyfit(at, cell.truth.motion(name, at), 1)[0]) * 1e-3 * 648000.0 / np.pi

    def lean(about: str) -> float:
        turn = cell.truth.motion(f"E{about}C", np.arange(720) / 2.0)
        return cell.truth.location(f"{about}0C") + float(
            cell.truth.motion(f"E{about}X", np.zeros(1))[0] + np.mean(turn)
        )

    square = cell.truth.location("B0Z") + slope("EXZ", "B0Z-Z1") + slope("EZX", "B0Z-X1")
    bar = cell.truth.location("B0Z") + slope("EXZ", f"B0C-Z1-C1at0{parked}") - lean("B")
    return {"B0Z": square, "A0C": lean("A") + slope("EYZ", f"A0C-Z1-C1at0{parked}"), "B0C": square - bar}


async def judged(cell: Cell, folder: RunFolder, found: PlanOutcome, parked: str = "") -> None:
    """Every error motion within 0.3 or 5 % of the truth, every lean within 0.3 arcsec."""
    wrong = []
    for one in found.model.motions:
        at = folder.get(f"setup-{one.name}-{one.axis}1", Capture).targets
        turning = one.axis == "C" and one.name != "ECC"
        true = turning_truth(cell, one.name, at) if turning else await truth_of(cell, one.name, at)
        limit = max(0.3, 0.05 * float(np.ptp(true)))
        off = value(one, at) - true
        off = off - off.mean()
        print(one.name, f"{np.max(np.abs(off)):.3f} of {np.ptp(true):.2f}, limit {limit:.2f}")
        wrong += [one.name] if np.max(np.abs(off)) > limit else []
    assert not wrong
    told = {place.name: place.value for place in found.model.locations}
    for name, true in true_leans(cell, folder, parked).items():
        print(name, f"{told[name]:+.3f} true {true:+.3f}")
        assert told[name] == pytest.approx(true, abs=0.3)


@pytest.mark.soak
def test_the_whole_plan_identifies_all_21(tmp_path: Path) -> None:
    """Every set-up of the demo cell but one, then that one: the advice names it, and all 21 are told."""

    async def story(cell: Cell, site: SiteFile, clock: LoopClock) -> None:
        assert site.work is not None
        file = load_gear(cell.site_path.parent / site.work.gear)
        tooth = ToothSpec(gear_of(file), file.grinding.centre_distance_mm, site.work.height_mm)
        ask: dict[str, Any] = {"clock": clock, "say": silence, "tooth": tooth}
        part = tuple(one.key for one in plan_setups(site) if one.setup.component != "EBC")
        first = await measure_site(site, cell.site_path, wanted=part, **ask)
        print(first.advice)
        assert first.advice.startswith("Next: EBC-C1")
        folder = Store(tmp_path).open(first.run_folder)
        found = await measure_site(site, cell.site_path, resume=folder, **ask)
        print(found.advice, *found.model.said, sep="\n")
        assert found.state == "measured"
        assert not found.model.unknown
        await judged(cell, folder, found)

    on_cell(tmp_path, few(11, 2), story)


def test_only_the_instrument_in_use_is_held_open(tmp_path: Path) -> None:
    """All are met before anything moves; one that was let go may be carried away, and is missed when it is needed."""

    async def story(cell: Cell, site: SiteFile, clock: LoopClock) -> None:
        supervisor = Supervisor(site, clock, only={"laser", "level", "angular"})

        def states() -> dict[str, str]:
            return {seen.name: seen.state for seen in supervisor.picture() if seen.name != "controller"}

        await cell.pull("level")
        with pytest.raises(DevicesFailed, match="level"):
            await supervisor.open_all()
        await supervisor.close_all()
        await cell.plug("level")
        await supervisor.open_all()
        assert set(states().values()) == {"open"}
        await supervisor.hold({"laser"})
        assert states() == {"laser": "open", "level": "closed", "angular": "closed"}
        await cell.pull("level")
        await supervisor.hold({"angular"})
        assert states() == {"laser": "closed", "level": "closed", "angular": "open"}
        with pytest.raises(DevicesFailed, match="level"):
            await supervisor.hold({"level"})
        await cell.plug("level")
        await supervisor.hold({"level"})
        assert states() == {"laser": "closed", "level": "open", "angular": "closed"}
        assert (await supervisor.controller.state()).axes
        await supervisor.close_all()

    on_cell(tmp_path, str, story)


def test_all_21_are_told_from_tables_as_well_as_live(tmp_path: Path) -> None:
    """Nothing is mounted; where X stood along the bars is told by `park`; what is not chosen stays live."""

    async def story(cell: Cell, live: SiteFile, clock: LoopClock) -> None:
        part = load_site(write_site_of_files(cell, tmp_path / "part.toml", ("EYX", "B0Z-R")))
        assert {one.component for one in part.setups if one.source == "file"} == {"EYX", "B0Z-R"}
        assert len(part.setups) == len(live.setups)
        with pytest.raises(ConfigError, match="E-CELL-SETUP"):
            write_site_of_files(cell, tmp_path / "none.toml", ("EYY",))
        path = write_site_of_files(cell, tmp_path / "filed.toml")
        site = load_site(path)
        found = await measure_site(site, path, clock=clock, say=silence)
        assert (found.state, found.model.unknown) == ("measured", ())
        assert not [line for line in cell.operator.log if line.startswith("mounted")]
        await judged(cell, Store(tmp_path).open(found.run_folder), found, "-X1at0")
        # Not knowing where X stood would leave all of EAX and EBX in these.
        assert all(place.u < 0.4 for place in found.model.locations if place.unit == "arcsec")

    on_cell(tmp_path, str, story)


@pytest.mark.long
def test_the_guard_says_whether_an_approved_curve_still_holds(tmp_path: Path) -> None:
    """The same machine: still valid; its errors turned round: re-measure; its backlash changed: no comparison."""

    def edit(text: str) -> str:
        guard = section("guard", {"targets": 6, "repetitions": 2})
        return f"{short(('C1',), 12, 2)(text)}\n{guard}"

    async def story(cell: Cell, site: SiteFile, clock: LoopClock) -> None:
        path = cell.site_path
        made = await run_site(site, path, apply=False, machine_name="", clock=clock, say=silence)
        run = Store(tmp_path).open(made.run_folder)

        async def guarded() -> GuardOutcome:
            return await guard_site(site, path, run, "C1", clock=clock, say=silence)

        same = await guarded()
        assert (same.verdict.answer, same.exit_code) == ("still valid", 0), same
        cell.bench.truth = Truth(cell.file, cell.truth.seed, flip=True)
        other = await guarded()
        assert (other.verdict.answer, other.exit_code) == ("re-measure this axis", 20)
        assert any("harmonic 1 changed" in str(line) for line in other.lines)
        cell.nck.set("$MA_BACKLASH[0,C1]", 0.001, 0)
        with pytest.raises(CaptureError) as caught:
            await guarded()
        assert caught.value.code == "E-GUARD-TABLES"

    on_cell(tmp_path, edit, story)
