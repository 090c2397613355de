"""Flank points by declared columns and names; and what an XML file may not do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers import registry
from drivers.errors import ConfigError, FileFormatError
from drivers.files.gde import GdeNames, read_gde, survey
from drivers.files.gear import GearColumns, read_gear_table

TABLE = "Luecke;Flanke;Durchmesser;Winkel;z;Abw\n1;links;120,0;10,0;-5,0;2,5\n1;rechts;120,0;-10,0;5,0;-1,5\n"
COLUMNS: dict[str, Any] = {
    "space": 1, "flank": 2, "diameter": 3, "angle": 4, "z": 5, "deviation": 6, "decimal_comma": True,
}  # fmt: skip
GDE = """<?xml version="1.0" encoding="UTF-8"?>
<x:gde xmlns:x="urn:x" version="3.4"><x:gear_data datum_face="top"><inspection>
<tooth no="7"><flank side="left"><pt><x>30.1</x><y>0.5</y><z>-2</z><dev>1.5</dev></pt>
<pt><x>30.2</x><y>0.6</y><z>2</z><dev>-1</dev></pt></flank>
<flank side="right"><pt><x>30.1</x><y>-0.5</y><z>0</z><dev>0</dev></pt></flank></tooth>
</inspection></x:gear_data><process/></x:gde>
"""
NAMES: dict[str, Any] = {"point": "pt", "space": "@no", "flank": "@side", "deviation": "dev"}


def test_a_table_in_cylinder_coordinates_becomes_points_of_the_part(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(TABLE, encoding="cp1252")
    found = registry.load("gear-csv", "gear-file")(columns=COLUMNS).read(path)
    radians = np.deg2rad([10.0, -10.0])
    wanted = np.column_stack([60.0 * np.cos(radians), 60.0 * np.sin(radians), [-5.0, 5.0]])
    np.testing.assert_allclose(found.points_mm, wanted, atol=1e-12)
    assert found.flank.tolist() == [1, -1]
    assert found.space.tolist() == [1, 1]
    assert found.deviation_um.tolist() == [2.5, -1.5]
    swapped = registry.load("gear-csv", "gear-file")(columns=COLUMNS | {"swap_flanks": True}).read(path)
    assert swapped.flank.tolist() == [-1, 1]


@pytest.mark.parametrize(
    ("said", "key"),
    [
        ({"radius": 3}, "x"),
        ({"diameter": 0}, "x"),
        ({"z": 0}, "z"),
        ({"length_unit": "foot"}, "length_unit"),
        ({"spaces": 1}, "spaces"),
        ({"flank": "two"}, "flank"),
    ],
)
def test_a_map_that_makes_no_sense_is_refused_by_its_key(said: dict[str, Any], key: str) -> None:
    with pytest.raises(ConfigError) as caught:
        GearColumns.read(COLUMNS | said, "x")
    assert (caught.value.code, caught.value.fields["key"]) == ("E-FILE-MAP", key)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("rechts", "middle", "line 3"),
        ("1;rechts", "one;rechts", "line 3"),
        ("-1,5", "x", "line 3"),
        (";-1,5", "", "line 3"),
        ("120,0;-10", "12000,0;-10", "unit or a column"),
    ],
)
def test_wrong_rows_are_refused_by_their_line(old: str, new: str, said: str) -> None:
    with pytest.raises(FileFormatError, match=said):
        read_gear_table(TABLE.replace(old, new), GearColumns.read(COLUMNS, "x"), "x")


def test_without_a_map_the_user_is_told_what_was_found_and_what_is_not_public(tmp_path: Path) -> None:
    path = tmp_path / "a.xml"
    path.write_text(GDE, encoding="utf-8")
    with pytest.raises(ConfigError, match="not public") as caught:
        registry.load("gde", "gear-file")().read(path)
    said = str(caught.value)
    assert all(word in said for word in ("3.4", "gear_data", "process", "pt (3)"))


def test_points_by_declared_names_and_the_warning_about_the_datum_face() -> None:
    found = read_gde(GDE.encode(), GdeNames.read(NAMES, "x"), "x")
    assert found.points_mm.tolist() == [[30.1, 0.5, -2.0], [30.2, 0.6, 2.0], [30.1, -0.5, 0.0]]
    assert (found.space.tolist(), found.flank.tolist()) == ([7, 7, 7], [1, 1, -1])
    assert found.deviation_um is not None
    assert found.deviation_um.tolist() == [1.5, -1.0, 0.0]
    assert found.header["Version"] == "3.4"
    assert "datum_face is 'top'" in str(found.warnings[0])
    no_face = read_gde(GDE.replace(' datum_face="top"', "").encode(), GdeNames.read(NAMES, "x"), "x")
    assert "no datum_face" in str(no_face.warnings[0])


def test_points_as_a_list_of_triples() -> None:
    text = '<gde><flank side="right" no="2"><xyz>1 2 3  4 5 6</xyz></flank></gde>'
    names = GdeNames.read({"triples": "xyz", "space": "@no", "flank": "@side"}, "x")
    found = read_gde(text.encode(), names, "x")
    assert found.points_mm.tolist() == [[1, 2, 3], [4, 5, 6]]
    with pytest.raises(FileFormatError, match="do not make triples"):
        read_gde(text.replace(" 6", "").encode(), names, "x")


BOMB = '<!DOCTYPE g [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><g>&b;</g>'
OUTSIDE = '<!DOCTYPE g [<!ENTITY x SYSTEM "file:///etc/passwd">]><g>&x;</g>'


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (BOMB, "E-FILE-XML-DTD"),
        (OUTSIDE, "E-FILE-XML-DTD"),
        ('<!DOCTYPE g SYSTEM "http://127.0.0.1:9/x.dtd"><g/>', "E-FILE-XML-DTD"),
        ("<g>&undefined;</g>", "E-FILE-XML"),
        ("<g><a></g>", "E-FILE-XML"),
        ("", "E-FILE-XML"),
        ("no xml", "E-FILE-XML"),
        ("<a>" * 60 + "</a>" * 60, "E-FILE-XML-LIMIT"),
        ('<?xml version="1.0" encoding="klingon"?><g/>', "E-FILE-XML"),
    ],
)
def test_fault_123_an_xml_file_cannot_harm(text: str, code: str) -> None:
    with pytest.raises(FileFormatError) as caught:
        survey(text.encode(), "x")
    assert caught.value.code == code
    assert "line" in caught.value.fields


def test_fault_123_size_and_number_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.files.safexml.MOST_ELEMENTS", 100)
    with pytest.raises(FileFormatError, match="100 elements"):
        survey(b"<g>" + b"<a/>" * 200 + b"</g>", "x")
    monkeypatch.setattr("drivers.files.safexml.LONGEST_TEXT", 1000)
    with pytest.raises(FileFormatError, match="letters"):
        survey(b"<g>" + b"x" * 2000 + b"</g>", "x")
    monkeypatch.setattr("drivers.files.safexml.MOST_BYTES", 10)
    with pytest.raises(FileFormatError, match="bytes"):
        survey(b"<g>aaaaaaaaa</g>", "x")


def test_points_under_another_name_are_missed_aloud() -> None:
    text = GDE.replace("<pt><x>30.2", "<pp><x>30.2").replace("<dev>-1</dev></pt>", "<dev>-1</dev></pp>")
    found = read_gde(text.encode(), GdeNames.read(NAMES, "x"), "x")
    assert len(found) == 2
    assert any("were not read: pp" in warning for warning in map(str, found.warnings))
