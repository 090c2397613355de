"""The site's goal for the gear: what it asks of the work, what is refused, and what a proposal says of the drive."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pydantic import ValidationError

from drivers.errors import ConfigError
from gateway.siteplan import GearSection
from gateway.tooth import DriveLimit, DriveProposal, GoalRow
from gateway.workflow.tooth.messages import drive_messages
from gateway.workflow.tooth.proposal import work_of

GEAR = """
name = "disc"
[gear]
rp = 64.0
rrp = 3.0
a = 1.3
zp = 40
zc = 39
[grinding]
centre_distance_mm = 160.0
"""
REDUCER = '[reducer]\ndatum = "bore"\nrated_nm = 400.0\n'


def _site(goal: dict[str, object], gear: str) -> Any:
    work = SimpleNamespace(gear=gear, height_mm=0.0, inspector="")
    return SimpleNamespace(
        site=SimpleNamespace(name="site"), work=work, gear=GearSection.model_validate({"goal": goal})
    )


def test_a_goal_of_the_drive_takes_the_reducer_of_the_gear_file(tmp_path: Path) -> None:
    (tmp_path / "gear.toml").write_text(GEAR + REDUCER, encoding="utf-8")
    asked = {"kind": "weights", "rms": 0.5, "transmission": 2.0, "transmission_arcsec": 30.0}
    work = work_of(_site(asked, "gear.toml"), tmp_path / "site.toml")
    assert work.goal is not None
    assert (work.goal.rms, work.goal.transmission, work.goal.lost_motion) == (0.5, 2.0, 0.0)
    assert work.goal.limits == {"transmission_arcsec": 30.0}
    assert (work.goal.drive.datum, work.goal.drive.rated_nm) == ("bore", 400.0)


def test_without_a_reducer_only_the_flank_can_be_asked_for(tmp_path: Path) -> None:
    (tmp_path / "gear.toml").write_text(GEAR, encoding="utf-8")
    assert work_of(_site({}, "gear.toml"), tmp_path / "site.toml").goal is None
    for asked in ({"kind": "transmission"}, {"lost_motion_arcsec": 40.0}):
        with pytest.raises(ConfigError, match="E-GOAL-REDUCER"):
            work_of(_site(asked, "gear.toml"), tmp_path / "site.toml")


@pytest.mark.parametrize("goal", [{"kind": "speed"}, {"transmission_arcsec": 0.0}, {"rms": 0.0}, {"limit": 3.0}])
def test_a_goal_that_cannot_be_is_refused_by_the_site_file(goal: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        GearSection.model_validate({"goal": goal})


def test_a_proposal_says_what_is_expected_what_each_goal_costs_and_the_verdict() -> None:
    drive = DriveProposal(
        reducer="disc",
        datum="bore",
        goal="transmission",
        rows=(GoalRow("rms", 0.08, 1.8, 68.0), GoalRow("this goal: transmission", 0.16, 0.3, 68.0)),
        transmission_arcsec=38.2,
        transmission_u_arcsec=6.1,
        lost_motion_arcsec=68.0,
        lost_motion_u_arcsec=4.0,
        trials=30,
        limits=(DriveLimit("transmission_arcsec", 38.2, 12.2, 30.0, "not decidable"),),
    )
    expected, first, mine, verdict = map(str, drive_messages(drive))
    assert "38.2" in expected
    assert "predicted, not tested" in expected
    assert "0.08" in first
    assert "0.3 arcsec" in mine
    assert "NOT DECIDABLE" in verdict
    assert drive_messages(None) == ()
