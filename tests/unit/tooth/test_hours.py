"""The plan of a site for limited hours: what it takes, what it leaves out, and how a run follows it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from drivers.clock import LoopClock
from drivers.errors import ConfigError
from drivers.message import prose
from gateway.config import SiteFile, load_site
from gateway.domain.captures import Capture
from gateway.errors import ModelError
from gateway.say import silence
from gateway.store import RunFolder
from gateway.workflow.errors21.measurement import measure_site
from gateway.workflow.errors21.setups import plan_setups, with_way
from gateway.workflow.hours import HoursRequest, SiteHoursPlanner, closing_hours, goal_of_site, ways_of
from simulators.cell import Cell
from tests.cell.test_components import on_cell, only
from tests.unit.programs.sites import site_file


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> tuple[SiteFile, Path]:
    path = site_file(tmp_path_factory.mktemp("hours"), "demo")
    found = load_site(path)
    return found.model_copy(update={"times": type(found.times)()}), path  # a person's usual times


def planner(
    site: tuple[SiteFile, Path], goal: str, hours: float | None, tolerance: float | None = None
) -> SiteHoursPlanner:
    return SiteHoursPlanner(site[0], goal_of_site(*site, goal), HoursRequest(hours, tolerance, goal))


def test_the_demo_takes_what_the_flank_needs_and_prices_the_rest(site: tuple[SiteFile, Path]) -> None:
    """A shift of C's axis across the wheel comes first; where a ball lies is worth nothing."""
    one = planner(site, "flank", 4.0)
    found = one.plan()
    data = found.as_data()
    assert {"B0C-Z1-C1at0", "B0C-Z1-C1at180"} <= set(found.plan.keys), "a lean that looks like X over Z"
    keys = [way["setup"] for step in data["steps"] for way in step["setups"]]
    assert {"EXC-C1", "EYC-C1", "EAC-C1", "EBC-C1"} <= set(keys[:4])
    assert keys[-3:] == ["ECC-C1", "EXX-X1", "EZZ-Z1"]
    assert data["hours"] == pytest.approx(sum(step["hours"] for step in data["steps"]), abs=0.01)
    assert data["hours"] <= 4.0
    assert data["hours"] / data["hours_of_all"] <= 0.45
    assert data["u_with_all"] <= data["u"] < 0.2 * data["u_before"]
    left = {key: part["u_with"] for part in data["left_out"] for key in part["setups"]}
    assert set(left) | set(keys) == {setup.key for setup in plan_setups(site[0]) if setup.measured}
    assert left["X0C-C1"] == pytest.approx(data["u"])
    # What was left out must not lower u by a tenth together.
    assert data["u_with_all"] >= 0.89 * data["u"]
    assert f"{data['hours']:.1f} h" in prose(found.said)


def test_a_known_error_is_no_longer_worth_a_mounting(site: tuple[SiteFile, Path]) -> None:
    """Both directions of the ball: one of them would still show how eccentric it lies for the other."""
    tree, path = site
    text = path.read_text(encoding="utf-8")
    for name in ("EXC", "EYC"):
        text = text.replace(f'component = "{name}"', f'component = "{name}"\nassumed = 0.01')
    known = (load_site(_beside(path, text)).model_copy(update={"times": tree.times}), path)
    keys = planner(known, "flank", 4.0).plan().plan.keys
    assert {"EXC-C1", "EYC-C1"}.isdisjoint(keys)
    assert "EBC-C1" in keys


def _beside(path: Path, text: str) -> Path:
    other = path.with_name("other.toml")
    other.write_text(text, encoding="utf-8")
    return other


def test_an_axis_asks_for_its_own_set_up_and_the_angles_of_its_lever(site: tuple[SiteFile, Path]) -> None:
    """X is read 18 mm above and 12 mm beside its line: pitch and yaw count, nothing else does."""
    found = planner(site, "X1", 1.5).plan()
    assert found.plan.keys[0] == "EXX-X1"
    assert set(found.plan.keys) <= {"EXX-X1", "EBX-X1", "ECX-X1"}
    proved = planner(site, "X1", None, tolerance=1.0).plan()
    assert proved.plan.ended == "proved"
    assert proved.plan.bound <= 1.0


def test_what_cannot_be_planned_is_refused(site: tuple[SiteFile, Path]) -> None:
    with pytest.raises(ConfigError) as goal:
        planner(site, "Q7", 1.0)
    assert goal.value.code == "E-HOURS-GOAL"
    with pytest.raises(ConfigError) as drive:
        planner(site, "drive", 1.0)
    assert drive.value.code == "E-HOURS-DRIVE"
    with pytest.raises(ModelError) as few:
        planner(site, "flank", 0.5).plan()
    assert few.value.code == "E-PLAN-HOURS"
    with pytest.raises(ConfigError) as rest:
        closing_hours(*site, HoursRequest(2.0), apply=True)
    assert rest.value.code == "E-HOURS-REST"
    left = closing_hours(*site, HoursRequest(6.0), apply=False).hours
    assert left == pytest.approx(6.0 - site[0].times.warm_up_min / 60.0)


def test_fewer_targets_keep_both_ends_and_a_positioning_stays_whole(site: tuple[SiteFile, Path]) -> None:
    by = {one.key: one for one in plan_setups(site[0])}
    assert len(ways_of(site[0], by["EXX-X1"])) == 1
    motion = with_way(by["EYX-X1"], [*range(-400, 1, 20)], 3)
    whole, fewer, half = ways_of(site[0], motion)
    assert (whole.repetitions, fewer.repetitions, half.targets.size) == (3, 2, 11)
    assert (half.targets[0], half.targets[-1]) == (-400.0, 0.0)
    assert whole.hours > fewer.hours > half.hours


@pytest.mark.long
def test_a_run_measures_by_the_plan_and_goes_on_by_it(tmp_path: Path) -> None:
    """On a cell: the axis X as goal; what it stored with fewer repetitions is no changed set-up when it goes on."""

    async def story(cell: Cell, tree: SiteFile, clock: LoopClock) -> None:
        far = {"offset_mm": (0.0, 0.0, 80.0)}  # a pitch of an arcsec is 0.4 um there
        more = {"EXX": far, "EBX": {"repetitions": 3}}
        setups = tuple(one.model_copy(update=more.get(one.component, {})) for one in tree.setups)
        tree = tree.model_copy(update={"setups": setups})
        chooses = planner((tree, cell.site_path), "X1", 5.0)
        asked = {"clock": clock, "say": silence}
        outcome = await measure_site(tree, cell.site_path, chooses=chooses, **asked)
        folder = RunFolder(Path(outcome.run_folder))
        done = [one for one in plan_setups(tree) if folder.has(f"setup-{one.key}")]
        assert {one.key for one in done} == {"EBX-X1", "EXX-X1"}
        assert outcome.remaining == ("EYX-X1",)
        assert outcome.advice == chooses.lines
        short = json.loads(folder.read_text("shortened-EBX-X1.json"))
        assert short == {"targets": 11, "repetitions": 2}
        assert folder.get("setup-EBX-X1", Capture).deviations.shape[1] == 2
        again = await measure_site(tree, cell.site_path, resume=folder, **asked)
        assert again.remaining == ()

    on_cell(tmp_path, only(("EXX", "EBX", "EYX"), ("X1",), 8, 3), story)
