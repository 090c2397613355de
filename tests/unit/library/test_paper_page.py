"""The handbook's table of the paper: every call is made and gives numbers of the shape that stands there."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trueflank as tf

ROOT = Path(__file__).parents[3]
ROW = re.compile(r"^\| (.+?) \| ([\d.]+) \| (.*?) \| `(.+)` \| (\(.*\)) \|$", re.MULTILINE)
ROWS = ROW.findall((ROOT / "docs" / "paper.md").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def known() -> dict[str, Any]:
    machine = tf.Machine.load(ROOT / "examples" / "errors" / "seeded-machine.toml")
    gear = tf.Gear.load(ROOT / "examples" / "gears" / "rv-40e-like.toml")
    return {
        "tf": tf,
        "machine": machine,
        "gear": gear,
        "measured": tf.read(ROOT / "tests" / "golden" / "files" / "basic.rtl"),
        "repeated": tf.evaluate(tf.read(ROOT / "tests" / "golden" / "files" / "environment.rtl")),
        "flank": tf.flank(machine, gear),
        "touch": tf.contact(machine, gear, heights=[-5.0, 5.0]),
        "ranking": tf.rank(machine, gear, trajectories=2),
        "best": tf.correct(machine, gear),
        "in_work": lambda T, points: points @ T[:3, :3].T + T[:3, 3],
    }


def test_every_symbol_of_the_papers_sections_is_called_as_the_page_says(known: dict[str, Any]) -> None:
    wrong = []
    for symbol, _, _, call, shape in ROWS:
        found = np.asarray(eval(call, known), dtype=np.float64)  # noqa: S307  the page is ours
        if str(found.shape) != shape or not np.isfinite(found).all():
            wrong.append(f"{symbol}: {found.shape}")
    assert wrong == []


def test_the_page_has_every_section_of_the_paper() -> None:
    assert {where for _, where, *_ in ROWS} == {"3.1", "3.2", "3.3", "4.1", "4.2", "4.3", "5", "5.1", "5.2", "5.3"}
    table = (
        (ROOT / "docs" / "paper.md").read_text(encoding="utf-8").split("|---|---|---|---|---|\n")[1].split("\n\n")[0]
    )
    assert len(ROWS) == len(table.splitlines()), "every row is read"
    assert len(ROWS) > 50
