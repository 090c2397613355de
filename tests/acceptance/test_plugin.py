"""The plugin and the example package, run as a person runs them."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path
from xml.etree import ElementTree

import pytest

from simulators.pytest_plugin import CellStarter

EXAMPLE = Path(__file__).parents[2] / "examples" / "own-acceptance" / "tests"
PLUGIN = "gateway.acceptance.pytest_plugin"


def ran(folder: Path, *given: str) -> subprocess.CompletedProcess[str]:
    named = any(point.value == PLUGIN for point in entry_points(group="pytest11"))
    plugin = () if named else ("-p", PLUGIN)
    command = [sys.executable, "-m", "pytest", "-q", "-rs", "-p", "no:cacheprovider", *plugin, *given]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=280, check=False)


@pytest.mark.long
def test_the_shipped_suite_accepts_a_cell_and_leaves_junit_and_a_sheet(
    trueflank_cell: CellStarter, tmp_path: Path
) -> None:
    cell = trueflank_cell("zero", speed=100.0)
    ended = ran(tmp_path, "--trueflank-site", str(cell.site), "--junitxml", "out.xml")
    assert ended.returncode == 0, ended.stdout + ended.stderr
    suite = ElementTree.parse(tmp_path / "out.xml").getroot()  # noqa: S314 - written by our own pytest
    told = {
        case.get("name", ""): {one.get("name"): one.get("value") for one in case.iter("property")}
        for case in suite.iter("testcase")
    }
    # A new cell has not passed the self-test: reading cannot tell, and what lies above it is skipped.
    assert told["test_acceptance[connection]"]["outcome"] == "unknown"
    assert "test_acceptance[self-test-X1]" in told
    assert all(one["outcome"] == "skipped" for one in told.values() if one["level"] != "read")
    assert "Accepted by" in (tmp_path / "acceptance.html").read_text()


def test_an_acceptance_by_several_processes_is_refused_before_anything_is_opened(tmp_path: Path) -> None:
    (tmp_path / "site.toml").write_text("", encoding="utf-8")
    ended = ran(tmp_path, "--trueflank-site", "site.toml", "-n", "2")
    assert ended.returncode == 4, ended.stdout + ended.stderr
    assert "one process at one machine: give -n 0" in ended.stderr


@pytest.mark.long
def test_writing_asks_for_the_machines_name_and_the_example_runs(trueflank_cell: CellStarter, tmp_path: Path) -> None:
    cell = trueflank_cell("zero", speed=100.0)
    refused = ran(tmp_path, "--trueflank-site", str(cell.site), "--allow", "write")
    assert refused.returncode == 4
    assert "E-PYTEST-NAME [--trueflank-machine]: --allow write needs --trueflank-machine" in refused.stderr
    assert "--apply" not in refused.stderr
    own = ran(tmp_path, str(EXAMPLE), "--trueflank-site", str(cell.site), "-p", "no:xdist")
    assert own.returncode == 0, own.stdout + own.stderr
    assert "4 passed" in own.stdout
