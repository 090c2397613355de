"""Tables as spreadsheets and programs of others write them: one measurement in every layout gives the same numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import FileFormatError
from drivers.files.csvmap import CsvFormat
from drivers.files.tables.headwords import HeadPass, head_cell, pass_of

# Made-up readings, um: by target (mm), then run 1 and 2, up and down each.
READINGS = {
    -20.0: ((0.1, 1.2), (0.3, 1.6)),
    0.0: ((2.5, 3.5), (2.25, 3.75)),
    30.5: ((-4.125, -3.0), (-4.5, -2.75)),
}
NUMBERED = tuple(enumerate(("up", "down")))


def long(heading: str, row: Callable[[float, int, int, float], str]) -> str:
    rows = (
        row(target, run + 1, way, READINGS[target][run][way])
        for run in (0, 1)
        for way, _word in NUMBERED
        for target in (sorted(READINGS) if way == 0 else sorted(READINGS, reverse=True))
    )
    return "\n".join((heading, *rows, ""))


def wide(heading: str, separator: str, values: Callable[[float], Iterable[float]]) -> str:
    rows = (separator.join(f"{value:g}" for value in (target, *values(target))) for target in READINGS)
    return "\n".join((heading, *rows, ""))


def in_turn(target: float) -> tuple[float, ...]:
    return tuple(value for run in READINGS[target] for value in run)


def by_way(target: float) -> tuple[float, ...]:
    return tuple(run[way] for way in (0, 1) for run in READINGS[target])


GERMAN = wide("Zielposition (mm);Lauf 1 + [µm];Lauf 1 - [µm];Lauf 2 + [µm];Lauf 2 - [µm]", ";", in_turn)
TABLES: dict[str, tuple[str, str]] = {
    "long": (
        long(
            "Nominal position (mm),Direction,Cycle,Deviation (um)",
            lambda t, n, w, v: f"{t},{('forward', 'backward')[w]},{n},{v}",
        ),
        "utf-8",
    ),
    "positions": (
        long("nominal [mm],measured,run,dir", lambda t, n, w, v: f"{t},{t + v / 1000:.6f},{n},{['up', 'down'][w]}"),
        "utf-8",
    ),
    "german": (
        long(
            "Soll mm;Richtung;Zyklus;Ist mm",
            lambda t, n, w, v: f"{t};{['vorwärts', 'rückwärts'][w]};{n};{t + v / 1000:.6f}".replace(".", ","),
        ),
        "cp1252",
    ),
    "chinese": (
        long("目标位置(mm),方向,次数,偏差(um)", lambda t, n, w, v: f"{t},{['正向', '反向'][w]},{n},{v}"),
        "gb18030",
    ),
    "passes": (wide("Target [mm],Run 1 fwd [um],Run 1 rev [um],Run 2 fwd [um],Run 2 rev [um]", ",", in_turn), "utf-8"),
    "passes by way": (
        wide("Position (mm)\tForward 1 (um)\tForward 2 (um)\tBackward 1 (um)\tBackward 2 (um)", "\t", by_way),
        "utf-8",
    ),
    "passes with arrows": (wide("P_i [mm];x_i1↑ [µm];x_i1↓ [µm];x_i2↑ [µm];x_i2↓ [µm]", ";", in_turn), "utf-16"),
    "passes without numbers": (wide("target_mm,up_um,down_um,up_um,down_um", ",", in_turn), "utf-8"),
    "passes in german": (GERMAN.replace(".", ","), "cp1252"),
    "passes in chinese": (
        wide("目标位置[mm],正向1偏差[um],反向1偏差[um],正向2偏差[um],反向2偏差[um]", ",", in_turn),
        "gb18030",
    ),
    "by indices": (
        "\n".join(
            (
                "# made up, in the layout of ecmc's motion tests",
                *(f"TGT_DATA[{i}]={t:g}" for i, t in enumerate(READINGS, 1)),
                *(
                    f"REF_DATA_{way}[{i},{run + 1}]={t + READINGS[t][run][w] / 1000:.7f}"
                    for run in (1, 0)
                    for w, way in enumerate(("FWD", "BWD"))
                    for i, t in enumerate(READINGS, 1)
                ),
                "UNIT=mm",
                "",
            )
        ),
        "utf-8",
    ),
}


RUNS = ("+", "-")
TABLES |= {
    "french": (
        long(
            "Position cible (mm);Sens;Passage;Écart (µm)",
            lambda t, n, w, v: f"{t};{['aller', 'retour'][w]};{n};{v}".replace(".", ","),
        ),
        "cp1252",
    ),
    "russian": (
        long("Позиция, мм;Направление;Проход;Отклонение, мкм", lambda t, n, w, v: f"{t};{RUNS[w]};{n};{v}"),
        "cp1251",
    ),
    "millionths of an inch": (
        long(
            "target (in),direction,run,deviation (uin)", lambda t, n, w, v: f"{t / 25.4!r},{RUNS[w]},{n},{v / 0.0254!r}"
        ),
        "utf-8",
    ),
    "a report above": (
        "Positioning test;;\nMachine;Mill 7;\nDate: 2024-03-02;;\n;;\n"
        + wide("Target [mm];Run 1 + [um];Run 1 - [um];Run 2 + [um];Run 2 - [um]", ";", in_turn),
        "utf-8",
    ),
    "statistics below": (
        wide("No.,Target [mm],up 1 [um],down 1 [um],up 2 [um],down 2 [um],Mean", ",", lambda t: (t, *in_turn(t), 0.5))
        + "\nMean,,1,2,3,4,5\n",
        "utf-8",
    ),
    "units below the names": (
        long("Target,Direction,Run,Deviation\nmm,,,µm", lambda t, n, w, v: f"{t},{RUNS[w]},{n},{v}"),
        "utf-16-le",
    ),
    "ways above the numbers": (
        wide(",Forward,,Reverse,\nTarget [mm],1 [um],2 [um],1 [um],2 [um]", ",", by_way),
        "utf-8-sig",
    ),
    "positions by pass": (
        "Target [mm],Run 1 +,Run 1 -,Run 2 +,Run 2 -\n"
        + "".join(f"{t},{','.join(f'{t + v / 1000:.6f}' for v in in_turn(t))}\n" for t in READINGS),
        "utf-8",
    ),
    "turned over": (
        "Sollposition [mm];"
        + ";".join(f"{t:g}" for t in READINGS)
        + "".join(
            f"\nLauf {run + 1} {'↑↓'[way]} [µm];" + ";".join(f"{READINGS[t][run][way]}" for t in READINGS)
            for run in (0, 1)
            for way in (0, 1)
        )
        + "\n",
        "utf-8",
    ),
    "in the order of the rows": (
        long("Target (mm),Measured (mm)", lambda t, n, w, v: f"{t},{t + v / 1000:.6f}"),
        "utf-8",
    ),
    "for a web page": (
        "| target_mm | direction | run | deviation_um |\n|---|---|---|---|\n"
        + long("", lambda t, n, w, v: f"| {t} | {RUNS[w]} | {n} | {v} |").lstrip(),
        "utf-8",
    ),
    "blanks between, heading as a remark": (
        long("# target_mm direction run deviation_um", lambda t, n, w, v: f"{t} {RUNS[w]} {n} {v}"),
        "utf-8",
    ),
}


@pytest.mark.parametrize("name", TABLES)
def test_one_measurement_in_every_layout_gives_the_same_numbers(name: str, tmp_path: Path) -> None:
    text, encoding = TABLES[name]
    file = tmp_path / "axis.csv"
    file.write_bytes(text.encode(encoding))
    found = CsvFormat().read(file)
    assert found.axis_unit == "mm"
    assert found.targets.tolist() == sorted(READINGS)
    wanted = np.array([READINGS[target] for target in sorted(READINGS)])
    np.testing.assert_allclose(found.deviations, wanted, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize(
    "heading",
    [
        "Target [mm],Run 1 fwd [um],Run 1 fwd [um],Run 2 fwd [um],Run 2 rev [um]",  # one pass twice
        "Target [mm],Run 1 fwd [um],Run 1 rev [um],Run 2 fwd [um],Temperature [um]",
        "Target [mm],Run 1 fwd [um],Run 1 rev [mm],Run 2 fwd [um],Run 2 rev [um]",
    ],
)
def test_what_a_heading_leaves_open_is_not_guessed(heading: str, tmp_path: Path) -> None:
    file = tmp_path / "axis.csv"
    file.write_text(wide(heading, ",", in_turn), encoding="utf-8")
    with pytest.raises(FileFormatError, match="E-FILE-CSV-HEADER"):
        CsvFormat().read(file)


@pytest.mark.parametrize(
    ("heading", "code"),
    [
        ("Position,Forward 1,Forward 2,Backward 1,Backward 2", "E-FILE-CSV-UNIT"),  # neither unit nor what is read
        (
            "Target [mm],Run 1 fwd [mm],Run 1 rev [mm],Run 2 fwd [mm],Run 2 rev [mm]",
            "E-FILE-CSV-UNIT",
        ),  # positions or not
        ("Target [mm],Run 1 [um],Run 2 [um],Run 3 [um],Run 4 [um]", "E-FILE-CSV-WAYS"),
    ],
)
def test_what_only_a_person_knows_is_asked_by_itself(heading: str, code: str, tmp_path: Path) -> None:
    file = tmp_path / "axis.csv"
    file.write_text(wide(heading, ",", in_turn), encoding="utf-8")
    with pytest.raises(FileFormatError, match=code):
        CsvFormat().read(file)
    if code == "E-FILE-CSV-WAYS":
        found = CsvFormat(columns={"passes": "alternate"}).read(file)
        np.testing.assert_allclose(found.deviations, [READINGS[target] for target in sorted(READINGS)])
        halves = CsvFormat(columns={"passes": "halves"}).read(file)
        assert halves.deviations[0].tolist() == [[0.1, 0.3], [1.2, 1.6]]
        whole = {"target": 1, "deviation": 2, "passes": "alternate"}
        np.testing.assert_array_equal(CsvFormat(columns=whole).read(file).deviations, found.deviations)


def test_words_above_a_table_are_kept_and_lines_below_it_told(tmp_path: Path) -> None:
    file = tmp_path / "axis.csv"
    file.write_text("Machine: Mill 7\ntarget [mm],up [um],down [um]\n0,1,2\n9,1,2\n\nA,12\n", encoding="utf-8")
    found = CsvFormat().read(file)
    assert found.header["Machine"] == "Mill 7"
    assert tuple(map(str, found.warnings)) == ("1 line below the table is not read, the first is line 6",)
    file.write_text("target [mm],up [um],down [um]\n0,1,2\n\ntarget [mm],up [um],down [um]\n0,1,2\n", encoding="utf-8")
    with pytest.raises(FileFormatError, match=r"E-FILE-CSV-SECOND.*line 4"):
        CsvFormat().read(file)


def test_sweeps_that_all_go_one_way_tell_no_direction(tmp_path: Path) -> None:
    file = tmp_path / "axis.csv"
    file.write_text("target [mm],deviation [um]\n0,1\n9,2\n0,1\n9,2\n", encoding="utf-8")
    with pytest.raises(FileFormatError, match="E-FILE-CSV-RUNS"):
        CsvFormat().read(file)
    assert CsvFormat(columns={"direction": "up"}).read(file).deviations.shape == (2, 2, 2)


def test_an_empty_cell_of_a_pass_is_a_missing_reading(tmp_path: Path) -> None:
    file = tmp_path / "axis.csv"
    file.write_text("target [mm],up 1 [um],down 1 [um]\n0,1.5,\n10,2,3\n", encoding="utf-8")
    found = CsvFormat().read(file)
    assert np.isnan(found.deviations[0, 0, 1])
    assert "readings missing: 1" in map(str, found.warnings)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("TGT_DATA[1]=0\nREF_DATA_FWD[2,1]=0\n", "target 2"),
        ("TGT_DATA[1]=0\nTGT_DATA[1]=1\n", "twice"),
        ("TGT_DATA[1]=0\nREF_DATA_FWD[1,1]=x\n", "not a number"),
        ("UNIT=mm\nTGT_DATA[1]=0\nREF_DATA_FWD[1,1]=1e30\n", "not a measurement"),
        ("TGT_DATA[1]=0\nUNIT=furlong\n", "furlong"),
        ("UNIT=mm\nTGT_DATA[1]=0\n", "E-FILE-ROWS"),
        ("TGT_DATA[1]=0\nREF_DATA_FWD[1,1]=0\n", "E-FILE-CSV-UNIT"),
        ("UNIT=mm\nTGT_DATA[1]=0\nTGT_DATA[2]=0.0\nREF_DATA_FWD[1,1]=0\nREF_DATA_FWD[2,1]=0\n", "occurs twice"),
    ],
)
def test_indices_that_do_not_fit_are_refused_with_their_line(text: str, why: str, tmp_path: Path) -> None:
    file = tmp_path / "axis.dat"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(FileFormatError, match=why):
        CsvFormat().read(file)


@pytest.mark.parametrize(
    ("cell", "wanted"),
    [
        ("Run 3 fwd", HeadPass(3, 0, "")),
        ("x_i2↓ [µm]", HeadPass(2, 1, "")),
        ("反向3偏差", HeadPass(3, 1, "deviation")),
        ("Lauf 4 -", HeadPass(4, 1, "")),
        ("measured up 1", HeadPass(1, 0, "position")),
        ("Temperature up", None),
        ("up down 1", None),
        ("2026-11-23", None),
    ],
)
def test_a_cell_names_one_pass_or_none(cell: str, wanted: HeadPass | None) -> None:
    assert pass_of(head_cell(cell)) == wanted
