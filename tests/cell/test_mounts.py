"""Three probes at a ball on the table: one mounting and one turn read three error motions of C."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import ConfigError
from gateway.config import SiteFile, load_site
from gateway.domain.captures import Capture
from gateway.model.components import value
from gateway.say import silence
from gateway.store import RunFolder
from gateway.workflow.errors21.measurement import measure_site
from gateway.workflow.errors21.setups import plan_setups, remountings
from gateway.workflow.forecast import day_of_measuring, setup_hours
from gateway.workflow.hours import HoursRequest, SiteHoursPlanner, goal_of_site
from simulators.cell.site import gear_text, site_text
from simulators.cellfile import CellFile, load_cell, with_plan
from tests.cell.test_components import only, turning_truth, without_positioning
from tests.selftested import cell_running

BALL = ("EXC", "EYC", "EZC")


def with_probes() -> CellFile:
    """The demo cell with one head of three probes in place of an indicator that is turned twice."""
    raw: dict[str, Any] = with_plan(load_cell("demo")).model_dump()
    usual = next(one for one in raw["instruments"] if one["name"] == "indicator")
    head = usual | {"name": "probes", "serial": "RT-0001", "probes": ("X", "Y", "Z")}
    raw["instruments"] = [*raw["instruments"], head]
    for one in raw["setups"]:
        if one["component"] in BALL:
            channel = f"{one['component'][1].lower()}_um"
            one |= {"instrument": "probes", "plan": one["plan"] | {"mount": "ball", "channel": channel}}
    return CellFile.model_validate(raw)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> tuple[SiteFile, Path]:
    cell, folder = with_probes(), tmp_path_factory.mktemp("mounts")
    assert cell.part is not None
    (folder / "gear.toml").write_text(gear_text(cell.part), encoding="utf-8")
    path = folder / "site.toml"
    urls = {one.name: "tcp://127.0.0.1:1" for one in cell.instruments}
    control = {"url": "opc.tcp://127.0.0.1:1", "settings": {"security": "None"}}
    path.write_text(site_text(cell, cell.machine.serial, control, urls, str(folder / "gear.toml")), encoding="utf-8")
    found = load_site(path)
    return found.model_copy(update={"times": type(found.times)()}), path


def test_one_mounting_counts_once_in_plan_forecast_and_hours(site: tuple[SiteFile, Path]) -> None:
    tree, _ = site
    plan = plan_setups(tree)
    at = [one.key for one in plan].index("EXC-C1")
    assert [one.key for one in plan[at : at + 3]] == ["EXC-C1", "EYC-C1", "EZC-C1"]
    assert [one.leader for one in plan[at : at + 3]] == ["", "EXC-C1", "EXC-C1"]
    names = [piece.name for piece in day_of_measuring(tree).pieces]
    assert "EXC-C1" in names
    assert {"EYC-C1", "EZC-C1"}.isdisjoint(names)
    apart = tree.model_copy(update={"setups": tuple(one.model_copy(update={"mount": ""}) for one in tree.setups)})
    saved = day_of_measuring(apart).hours - day_of_measuring(tree).hours
    assert saved == pytest.approx(2.0 * setup_hours(tree, plan[at]), abs=0.01)
    assert remountings(plan) < len(plan)

    planner = SiteHoursPlanner(tree, goal_of_site(*site, "flank"), HoursRequest(4.0))
    found = planner.plan()
    first = found.plan.steps[0].keys
    assert first[0] == "EXC-C1"
    told = [one.key for one in found.setups]
    assert told[:3] == ["EXC-C1", "EYC-C1", "EZC-C1"]
    whole = SiteHoursPlanner(apart, goal_of_site(apart, site[1], "flank"), HoursRequest(4.0)).plan().plan
    assert found.plan.hours < whole.hours
    assert found.plan.u == pytest.approx(whole.u, rel=0.15)


def test_a_mounting_is_of_one_instrument_axis_and_place(site: tuple[SiteFile, Path]) -> None:
    tree, _ = site
    other = tuple(
        one.model_copy(update={"instrument": "indicator"}) if one.component == "EZC" else one for one in tree.setups
    )
    with pytest.raises(ConfigError) as refused:
        plan_setups(tree.model_copy(update={"setups": other}))
    assert refused.value.code == "E-SETUP-MOUNT"


@pytest.mark.long
def test_one_turn_reads_three_errors_by_their_truth(tmp_path: Path) -> None:
    async def job() -> None:
        clock = LoopClock()
        async with cell_running(with_probes(), tmp_path / "cell", clock, wires="memory", block_s=1.0) as cell:
            edit = only(BALL, ("C1",), 16, 2)
            cell.site_path.write_text(edit(cell.site_path.read_text(encoding="utf-8")), encoding="utf-8")
            tree = without_positioning(load_site(cell.site_path))
            outcome = await measure_site(tree, cell.site_path, clock=clock, say=silence)
            mounted = [line for line in cell.operator.log if line.startswith("mounted")]
            assert mounted == ["mounted EXC on C"]
            folder = RunFolder(Path(outcome.run_folder))
            for one in outcome.model.motions:
                at = folder.get(f"setup-{one.name}-C1", Capture).targets
                true = turning_truth(cell, one.name, at)
                off = value(one, at) - true
                print(one.name, np.max(np.abs(off - off.mean())))
                assert np.max(np.abs(off - off.mean())) < 0.3, one.name
            assert {one.name for one in outcome.model.motions} == set(BALL)

    run_virtual(job)
