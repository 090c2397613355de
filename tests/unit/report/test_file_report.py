"""The report of result files alone: it names the files, and calls what no file names by its file."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from gateway.report.document.whole import document
from gateway.store import Store
from gateway.workflow.files.reading import ReadOptions
from gateway.workflow.results.from_files import material_of_files

TABLE = "target_mm,direction,run,deviation_um\n0,+,1,1\n9,+,1,2\n9,-,1,3\n0,-,1,2\n0,+,2,1\n9,+,2,3\n9,-,2,3\n0,-,2,1\n"


def test_a_report_of_files_names_them_and_what_stands_above_their_tables(tmp_path: Path) -> None:
    named, bare = tmp_path / "a.csv", tmp_path / "cross slide.csv"
    named.write_text(f"Maschine;Mill 7\nSeriennummer;4711\nAchse;X\nDatum;2024-03-02\n{TABLE.replace(',', ';')}")
    bare.write_text(TABLE)
    found = material_of_files([named, bare], ReadOptions(), Store(tmp_path / "runs"))
    assert (found.site, found.machine.serial, found.started_utc) == ("Mill 7", "4711", "2024-03-02")
    assert [axis.axis for axis in found.axes] == ["X", "cross slide"]
    said = str(document(found).blocks)
    assert "a.csv, cross slide.csv" in said
    assert all(f"{one.path}: sha256 {one.sha256}" in said for one in found.files)
    assert "report.json" not in said
    assert "degC" not in said


def test_the_number_of_a_report_of_files_is_day_files_and_content(tmp_path: Path) -> None:
    """The day they were measured where one says it; the same files in two languages share all but the last part."""
    for said, form in (("Date,2024-03-02\n", r"20240302-[0-9a-f]{6}-[0-9a-f]{6}"), ("", "[0-9a-f]{6}-[0-9a-f]{6}")):
        (tmp_path / "a.csv").write_text(f"{said}{TABLE}")
        found = material_of_files([tmp_path / "a.csv"], ReadOptions(), Store(tmp_path / "runs"))
        german = replace(found, particulars=replace(found.particulars, language="de"))
        one, again, other = (document(said).number for said in (found, found, german))
        assert re.fullmatch(form, one)
        assert one == again != other
        assert one.rpartition("-")[0] == other.rpartition("-")[0]


def test_two_files_of_one_axis_have_two_names(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / f"{name}.csv").write_text(f"Axis: X\n{TABLE}")
    found = material_of_files([tmp_path / "a.csv", tmp_path / "b.csv"], ReadOptions(), Store(tmp_path / "runs"))
    assert [axis.axis for axis in found.axes] == ["X", "X (2)"]


def test_a_report_of_files_prints_what_they_state_and_names_every_condition_that_nobody_stated(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(f"Axis: X\nOperator: Li Na\nFeed: 500 mm/min\nLaser: XL-80\nPlace: Hall 3\n{TABLE}")
    store = Store(tmp_path / "runs")
    material_of_files([tmp_path / "a.csv"], ReadOptions(), store, conditions={"": {"tables": "none"}})
    (axis,) = (found := material_of_files([tmp_path / "a.csv"], ReadOptions(), store)).axes
    assert dict(axis.test_before) == {"instrument": "XL-80", "feed": "500 mm/min", "tables": "none"}
    said = str(document(found).blocks)
    assert "Li Na (stated in the files)" in said
    assert "Hall 3 (stated in the files)" in said
    assert "No register of equipment" in said
    assert "UNPROTECTED" not in said
    for name in ("Dwell at the target", "Overrun before reversing", "Warm-up", "Readings compensated for"):
        assert f"('{name}', 'not stated')" in said
