"""The shipped demo cell closed as a whole, every set-up live: all that it asks of the person, each with its cause."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from gateway import audit
from gateway.config import load_site
from gateway.workflow.forecast import day_of_closing
from simulators.cellfile import load_cell, with_plan
from tests.closing.presses import by_kind
from tests.closing.reckoned import unlike
from tests.closing.runs import run_machine
from tests.closing.test_short import kept

RESETS = 3  # trial tables of all signs, axis layer, cross layer
BLANKS = 3
# Every error once; then what a part ground between, or a restart that a calibrator does not outlast, has taken off.
MOUNTINGS = {
    "measure": {"every set-up of the plan": 28},
    "sign proofs": {"C1": 1, "X1": 1, "Z1": 1},
    "measure again": {"X1": 1, "C1": 2},  # after the axis layer Z's laser stands from its sign proof; C with all tables
}
# Two places of C; before, signs and after.
AGAIN = {"A0C on Z": 2, "B0C on Z": 2, "EXX on X": 3, "EZZ on Z": 2, "ECC on C": 4}
HOURS_WITHIN = 0.1  # nobody foresees how many readings of 28 set-ups are taken again
# Presses of NC START beyond those that confirm what was mounted or clamped, by their cause: the most of each.
MOST_PRESSES = 12
PRESSED = {
    "P-START-SETUP TFSENSE": 2,  # all set-ups; all sign proofs
    "P-GRIND-PREPARED": 3,  # of each part
    "P-NC-READ": 1,  # before the trial tables; elsewhere in a program that runs, or by one that has just ended
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
    assert kept(found) == []
    assert found.done_twice == ()
    assert found.after_um < 0.5 * found.set_right_um
    assert found.outcome == "better"
    assert audit.read_log_state(tmp_path / "runs", file.machine.serial).alarms == {}
    mounted = Counter(one.removeprefix("mounted ") for one in presses.handled if one.startswith("mounted "))
    day = day_of_closing(load_site(tmp_path / "site.toml"), tmp_path / "site.toml", apply=True)
    causes = [(piece.stage, piece.name, piece.mounting.words) for piece in day.pieces if piece.mounting is not None]
    print("\n".join(f"{stage}: {name}: {words}" for stage, name, words in causes))
    once = [name for stage, name, _ in causes if stage == "measure"]
    assert len(once) == len(set(once)) == MOUNTINGS["measure"]["every set-up of the plan"]
    for cause in ("sign proofs", "measure again"):
        assert Counter(name for stage, name, _ in causes if stage == cause) == MOUNTINGS[cause]
    assert sum(mounted.values()) == len(causes)  # in this order: `unlike`
    assert {one: count for one, count in mounted.items() if count > 1} == AGAIN
    assert presses.counts[1] == BLANKS
    assert len(presses.resets) <= RESETS
    pressed = by_kind(presses.starts)
    assert sum(pressed.values()) <= MOST_PRESSES, pressed
    assert all(count <= PRESSED.get(cause, 0) for cause, count in pressed.items()), pressed
    assert unlike(tmp_path / "site.toml", presses, found.virtual_s, HOURS_WITHIN) == []
