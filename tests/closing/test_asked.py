"""The shipped demo cell closed as a whole, every set-up live: all that it asks of the person, each with its cause."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from simulators.cellfile import load_cell, with_plan
from tests.closing.presses import by_kind
from tests.closing.reckoned import unlike
from tests.closing.runs import run_machine

RESETS = 3  # trial tables of all signs, axis layer, cross layer
BLANKS = 3
MOUNTINGS = {"before": 28, "signs": 3, "axis layer judged": 3, "C with every table": 1}
# Two places of C; signs proved and tables judged, where the laser and the calibrator stand on one axis at a time.
AGAIN = {"A0C on Z": 2, "B0C on Z": 2, "EXX on X": 3, "EZZ on Z": 3, "ECC on C": 4}
HOURS_WITHIN = 0.25  # nobody foresees how many readings of 28 set-ups are taken again
# Presses of NC START beyond those that confirm what was mounted or clamped, by their cause: the most of each.
MOST_PRESSES = 13
PRESSED = {
    "P-START-SETUP TFSENSE": 2,  # all set-ups; all sign proofs
    "P-GRIND-PREPARED": 3,  # of each part
    "P-NC-READ": 2,  # before the trial tables and the axis layer; elsewhere in a program that runs or has just ended
    "P-PUSH-START": 4,  # trial tables, the old ones again, axis layer, cross layer
    "P-PUSH-EFFECT": 2,  # of each layer; measuring again goes on from there
}


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_the_whole_demo_asks_for_what_is_listed_and_the_day_foretells_it(tmp_path: Path) -> None:
    file = with_plan(load_cell("demo"))
    found = run_machine(file, file.seed, tmp_path, short=False, least=False)
    presses = found.presses
    print(presses.listed())
    assert found.failed == ""
    mounted = Counter(one.removeprefix("mounted ") for one in presses.handled if one.startswith("mounted "))
    assert sum(mounted.values()) <= sum(MOUNTINGS.values())
    assert {one: count for one, count in mounted.items() if count > 1} == AGAIN
    assert presses.counts[1] == BLANKS
    assert len(presses.resets) <= RESETS
    pressed = by_kind(presses.starts)
    assert sum(pressed.values()) <= MOST_PRESSES, pressed
    assert all(count <= PRESSED.get(cause, 0) for cause, count in pressed.items()), pressed
    assert unlike(tmp_path / "site.toml", presses, found.virtual_s, HOURS_WITHIN) == []
