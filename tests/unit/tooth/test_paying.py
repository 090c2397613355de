"""Which set-ups the demo measures: chosen by the ranking of the site as it is, and what the rest is worth."""

from __future__ import annotations

from pathlib import Path

import pytest

from gateway.config import SiteFile, load_site
from gateway.correct.outlook.flank_uncertainty import OpenDoubt
from gateway.workflow.errors21.measurement import choose_worthwhile, worthwhile_setups
from gateway.workflow.errors21.setups import plan_setups
from gateway.workflow.forecast import day_of_closing
from gateway.workflow.tooth.proposal import work_of
from tests.unit.programs.sites import site_file


@pytest.fixture
def site(tmp_path: Path) -> tuple[SiteFile, Path]:
    path = site_file(tmp_path, "demo")
    return load_site(path), path


def open_(**sizes: float) -> list[OpenDoubt]:
    return [OpenDoubt(name, size, 0.0, 0.0, measured=False) for name, size in sizes.items()]


def test_what_takes_most_for_each_setup_comes_first(site: tuple[SiteFile, Path]) -> None:
    """By hand: 9 + 16 + 16 + 1 = 42 um squared. B0C, two set-ups, shows B0Z (four) with it: 32 of them, 16 each."""
    plan = plan_setups(site[0])
    doubts = open_(EXC=3.0, B0Z=4.0, B0C=4.0, EAC=1.0)
    most = choose_worthwhile(plan, doubts, 0.7)
    assert most.keys == ("B0C-Z1-C1at0", "B0C-Z1-C1at180", "ECC-C1", "EXX-X1", "EZZ-Z1")
    assert (most.of, most.share, most.rest_um) == (28, pytest.approx(32 / 42), pytest.approx(10**0.5))
    more = choose_worthwhile(plan, doubts, 0.97)
    assert set(more.keys) - set(most.keys) == {"EXC-C1"}
    assert more.rest_um == pytest.approx(1.0)
    assert "B0Z-X1" not in choose_worthwhile(plan, doubts, 1.0).keys


def test_the_choice_follows_what_the_site_says_is_unknown(site: tuple[SiteFile, Path]) -> None:
    """Nothing is listed by hand: where an error is known within little, its set-up falls out, and another comes in."""
    tree, path = site
    tooth = work_of(tree, path).tooth
    usual = worthwhile_setups(tree, tooth)
    assert usual.share >= 0.99
    assert "EXC-C1" in usual.keys
    assert len(usual.keys) < usual.of / 2
    text = path.read_text(encoding="utf-8")
    head, _, rest = text.partition('component = "EXC"')
    path.write_text(f'{head}component = "EXC"\nassumed = 0.01{rest}', encoding="utf-8")
    known = load_site(path)
    found = worthwhile_setups(known, tooth)
    assert "EXC-C1" not in found.keys
    assert found.rest_um < usual.rest_um + 0.2


def test_the_day_of_the_setups_that_pay_is_as_much_shorter(site: tuple[SiteFile, Path]) -> None:
    tree, path = site
    keys = worthwhile_setups(tree, work_of(tree, path).tooth).keys
    day = day_of_closing(tree, path, apply=True, wanted=keys)
    measured = [piece.name for piece in day.pieces if piece.stage == "measure"]
    assert measured == list(keys)
    assert day.hours < day_of_closing(tree, path, apply=True).hours
