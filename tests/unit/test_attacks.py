"""Counts of attacks add up over processes, and a wrong one is on the page."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests import attacks


def test_counts_of_two_processes_become_one_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TRUEFLANK_ATTACKS", str(tmp_path))
    attacks.counted("line lost", "OPC UA", 19)
    attacks.counted("line lost", "mailbox", 4)
    (tmp_path / "other.jsonl").write_text(
        json.dumps({"family": "line lost", "road": "OPC UA", "tries": 1200, "wrong_tables": 1, "false_words": 2}) + "\n"
    )
    assert attacks.added(tmp_path) == (
        attacks.Count("line lost", "OPC UA", 1219, 1, 2),
        attacks.Count("line lost", "mailbox", 4, 0, 0),
    )
    (tmp_path / "page.md").write_text("# Old\n\n| old | row |\n\n## The service\n\nBy hand.\n")
    assert attacks.main(str(tmp_path), str(tmp_path / "page.md"), "make attacks") == 1
    text = (tmp_path / "page.md").read_text()
    assert text.endswith("\n\n## The service\n\nBy hand.\n")
    assert "| old |" not in text
    rows = (tmp_path / "page.md").read_text().splitlines()
    assert "| line lost | OPC UA | 1 219 | 1 | 2 |" in rows
    assert "| **all** |  | 1 223 | 1 | 2 |" in rows


def test_a_run_that_counted_nothing_is_no_success(tmp_path: Path) -> None:
    assert attacks.main(str(tmp_path), str(tmp_path / "page.md"), "make attacks") == 1


def test_without_a_folder_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TRUEFLANK_ATTACKS", raising=False)
    monkeypatch.chdir(tmp_path)
    attacks.counted("line lost", "OPC UA", 19)
    assert list(tmp_path.iterdir()) == []
