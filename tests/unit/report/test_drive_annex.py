"""The annex' section on the drive: in every language, with its verdicts, and only where there is a goal."""

from __future__ import annotations

import pytest

from gateway.report.document.content import Heading, Paragraph, TableBlock, Whole
from gateway.report.document.records import drive_annex
from gateway.report.document.words import LANGUAGES, Tongue
from gateway.tooth import DriveDoubt, DriveLimit, DriveProposal, GoalRow

DRIVE = DriveProposal(
    reducer="disc",
    datum="crank-holes",
    goal="transmission",
    rows=(GoalRow("rms", 0.08, 1.8, 68.0), GoalRow("this goal: transmission", 0.16, 0.3, 68.4)),
    transmission_arcsec=38.0,
    transmission_u_arcsec=3.0,
    lost_motion_arcsec=68.0,
    lost_motion_u_arcsec=4.0,
    trials=30,
    limits=(DriveLimit("transmission_arcsec", 38.0, 6.0, 30.0, "fail"),),
    doubts=(DriveDoubt("ECC", 9.0, True), DriveDoubt("EXC", 8.0, False), DriveDoubt("EYC", 3.0, False)),
)


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_section_says_value_u_and_verdict_in_every_language(language: str) -> None:
    t = Tongue(language)
    (whole,) = drive_annex(DRIVE, t)
    assert isinstance(whole, Whole)
    heading, said, goals, _, limits, following = whole.blocks
    assert isinstance(following, Paragraph)
    assert "EXC" in following.text
    assert "8.0" in following.text
    assert isinstance(heading, Heading)
    assert heading.text == t("drive")
    assert isinstance(said, Paragraph)
    assert "38.0 ± 6.0" in said.text
    assert isinstance(goals, TableBlock)
    assert [row[0] for row in goals.rows] == ["rms", "this goal: transmission"]
    assert isinstance(limits, TableBlock)
    assert limits.rows[0][-1] == t("drive_fail")
    assert "_" not in limits.rows[0][0]


def test_a_run_without_a_goal_has_no_such_section() -> None:
    assert drive_annex(None, Tongue("en")) == ()
