"""A store that an earlier version wrote (tests/golden/older): today's commands read it, and its seals hold."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from gateway.cli import app
from gateway.push.history import committed_pushes
from gateway.push.journal import JOURNALS

KEPT = Path(__file__).parents[2] / "golden" / "older" / "runs"
PUSHED, IMPORTED = "20261124T075746412Z-demo-grinder-1757", "20261124T075810436Z-import-4fea"
SERIAL = "YK7350B-0042"


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """The site file as the run kept it, beside a copy of the store."""
    shutil.copytree(KEPT, tmp_path / "runs")
    return Path(shutil.copy(KEPT / PUSHED / "site.toml", tmp_path / "site.toml"))


def told(*words: str | Path) -> Any:
    """What a command prints with --json."""
    result = CliRunner().invoke(app, [*map(str, words), "--json"])
    assert result.exit_code == 0, (words, result.output, result.exception)
    return json.loads(result.stdout)


def test_runs_are_listed_shown_and_indexed(site: Path) -> None:
    store = site.parent / "runs"
    listed = told("runs", "list", "--store", store)
    found = [(one["run_id"], one["state"], one["problem"]) for one in listed]
    assert found == [(PUSHED, "better", ""), (IMPORTED, "imported", "")]
    shown = told("runs", "show", PUSHED[:20], "--store", store)
    assert (shown["machine"], len(shown["stages"]), shown["errors"]) == (SERIAL, 12, [])
    assert told("runs", "reindex", site) == {"runs": 2}
    assert [one["serial"] for one in told("runs", "compare", site, "M", "--axis", "C1")["machines"]] == [SERIAL]
    (table,) = told("tables", "list", site)["tables"]
    assert (table["serial"], table["name"], table["enabled"], len(table["table_id"])) == (SERIAL, "C1", True, 12)


def test_a_report_says_the_figures_that_were_kept_and_every_seal_holds(site: Path) -> None:
    store = site.parent / "runs"
    sound = told("audit", "verify", store)
    assert (sound["runs"], sound["wrong"], sound["head"].partition(":")[0]) == (2, [], "8")
    told("report", store / PUSHED)
    said = json.loads((store / PUSHED / "report.json").read_bytes())
    assert said["outcome"] == "better"
    (axis,) = said["axes"]
    rows = axis["parameters"]
    for phase in ("before", "after"):
        kept = json.loads((KEPT / PUSHED / f"evaluation-C1-{phase}.json").read_bytes())["record"]
        assert {name: rows[name][phase] for name in "ABEMR"} == pytest.approx({name: kept[name] for name in "ABEMR"})
    again = told("audit", "verify", store)
    assert (again["runs"], again["wrong"], again["head"]) == (2, [], sound["head"])


def test_its_push_can_still_be_taken_back() -> None:
    (push,) = committed_pushes(KEPT / JOURNALS, SERIAL, "C1")
    assert (push.axis, push.undoes, push.old.enabled, push.new.enabled) == ("C1", 0, False, True)
