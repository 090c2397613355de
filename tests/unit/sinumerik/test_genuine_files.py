"""Files that a real control wrote, where they lie beside this checkout: read without an error, an archive at once."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from drivers.sinumerik.tablefile.format import TableFiles

FOLDER = Path(__file__).parents[4] / "shared" / "data" / "nck"
FILES = TableFiles()
MOST_S = 2.0  # of processor time, for a whole archive of a control


def genuine(pattern: str) -> list[Path]:
    """The files of that kind; a test that has none says so."""
    files = sorted(FOLDER.rglob(pattern))
    if not files:
        pytest.skip(f"NOT RUN: no {pattern} of a real control beside this checkout (../shared/data/nck)")
    return files


def test_table_files_of_a_real_control_are_read() -> None:
    for path in genuine("*.INI"):
        data = path.read_bytes()
        wrong = [str(one.error) for one in FILES.findings(data, path.name) if one.severity == "wrong"]
        assert not wrong
        content = FILES.read(data, path.name)
        assert len(content.tables) == len({(one.kind, one.index, one.output_axis) for one in content.tables})
        assert content.tables or "no compensation table" in str(content.notes[0])


def test_whole_archives_of_a_real_control_are_read_at_once() -> None:
    for path in genuine("*.arc"):
        data, start = path.read_bytes(), time.process_time()
        findings, content = FILES.findings(data, path.name), FILES.read(data, path.name)
        spent = time.process_time() - start
        members = FILES.members(data, path.name)
        print(f"{path.name}: {len(members)} members, {len(content.tables)} tables, {spent:.2f} s")
        assert [str(one.error) for one in findings if one.severity == "wrong"] == []
        assert content.tables
        assert content.names
        assert not content.unknown
        assert spent < MOST_S
