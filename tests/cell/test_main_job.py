"""The main job on simulated machines, judged by their truth on a 0.1 mm / 0.1 deg grid."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cell.bench import Judged, main_job


def _never_worse(judged: Judged) -> None:
    for axis, before in judged.before.items():
        assert judged.after[axis]["M"] <= before["M"] + 0.05, axis


def test_the_demo_machine_gets_better_as_promised(tmp_path: Path) -> None:
    judged = main_job(tmp_path)
    after, before = judged.after["C1"], judged.before["C1"]
    assert before["M"] > 15.0
    assert after["M"] <= 0.1 * before["M"]
    assert after["M"] <= 1.5
    assert after["E"] <= after["M"] + after["B"] + 0.3
    for axis in ("X1", "Z1"):
        assert judged.after[axis]["M"] <= max(0.15 * judged.before[axis]["M"], 2.0)
    assert judged.outcome.data["outcome"] == "better"
    assert Path(judged.outcome.data["report"]["html"]).exists()


@pytest.mark.parametrize(("seed", "flip"), [(2, False), (3, True)])
def test_other_machines_are_never_made_worse(tmp_path: Path, seed: int, flip: bool) -> None:
    _never_worse(main_job(tmp_path, seed=seed, flip=flip))


def test_a_machine_without_errors_gets_no_table(tmp_path: Path) -> None:
    judged = main_job(tmp_path, "zero")
    assert judged.outcome.data["outcome"] == "not-pushed"
    assert set(judged.outcome.data["not_corrected"]) == set(judged.before)
