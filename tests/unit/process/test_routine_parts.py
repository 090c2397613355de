"""Routine parts in the store: the history of a gear, its answers, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.errors import TrueflankError
from drivers.message import render
from gateway.process.separation import separate
from gateway.process.wheel_form import ProcessPart
from gateway.study.inputs import GearFile, validate_file
from gateway.workflow.tooth.processing import SeparationOutcome, keep_routine_part, read_history
from tests.unit.process.shop import DISC, DISC_DISTANCE, ORDER, Shop
from tests.unit.simulators.test_grinding import ELEVEN

FILE = validate_file(
    {"name": "disc", "gear": ELEVEN, "grinding": {"centre_distance_mm": DISC_DISTANCE}}, GearFile, "disc"
)


def test_parts_are_kept_and_judged_together(tmp_path: Path) -> None:
    """One part, inspected again and again: nothing but noise and clamping, so the process is valid."""
    shop = Shop({"form": [{"waves": 1.5, "left_um": 0.8, "right_um": 0.6}]})
    work = shop.grind()
    answers = []
    for n in range(7):
        found = shop.inspect(work)
        outcome = SeparationOutcome(FILE, separate(DISC, [ProcessPart.of(found, order=ORDER)]))
        seen = keep_routine_part(tmp_path, outcome, found, 5.0, dressed=0 if n else 3)
        answers.append(seen)
    assert [one.exit_code for one in answers] == [21] * 5 + [0, 0]
    assert [one.lines[0].code for one in answers[4:6]] == ["W-PROCESS-FEW-PARTS", "W-PROCESS-VALID"]
    assert "valid" in render(answers[-1].lines[0])
    path = tmp_path / "process" / "disc.jsonl"
    known = read_history(path)
    assert [one.dressed for one in known] == list(range(3, 10))
    with pytest.raises(TrueflankError) as refused:
        keep_routine_part(tmp_path, outcome, found, 5.0)
    assert refused.value.code == "E-PROCESS-TWICE"
    path.write_text(path.read_text() + "{}\n")
    with pytest.raises(TrueflankError) as refused:
        read_history(path)
    assert refused.value.code == "E-PROCESS-HISTORY"
