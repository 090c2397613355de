"""Tables as spreadsheets and programs of others write them: one measurement in every layout gives the same numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import FileFormatError
from drivers.files.csvmap import CsvFormat
from drivers.files.headwords import HeadPass, head_cell, pass_of

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
        long("nominal,measured,run,dir", lambda t, n, w, v: f"{t},{t + v / 1000:.6f},{n},{['up', 'down'][w]}"),
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
    "passes in chinese": (wide("目标位置,正向1偏差,反向1偏差,正向2偏差,反向2偏差", ",", in_turn), "gb18030"),
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
        "Position,Forward 1,Forward 2,Backward 1,Backward 2",  # neither unit nor what is read
        "Target,Run 1 fwd [mm],Run 1 rev [mm],Run 2 fwd [mm],Run 2 rev [mm]",  # positions, or deviations in mm
        "Target,Run 1 fwd [um],Run 1 fwd [um],Run 2 fwd [um],Run 2 rev [um]",  # one pass twice
        "Target,Run 1 [um],Run 2 [um],Run 3 [um],Run 4 [um]",  # which way is not said
        "Target,Run 1 fwd [um],Run 1 rev [um],Run 2 fwd [um],Temperature [um]",
        "Target,Run 1 fwd [um],Run 1 rev [mm],Run 2 fwd [um],Run 2 rev [um]",
    ],
)
def test_what_a_heading_leaves_open_is_not_guessed(heading: str, tmp_path: Path) -> None:
    file = tmp_path / "axis.csv"
    file.write_text(wide(heading, ",", in_turn), encoding="utf-8")
    with pytest.raises(FileFormatError, match="E-FILE-CSV-HEADER"):
        CsvFormat().read(file)


def test_an_empty_cell_of_a_pass_is_a_missing_reading(tmp_path: Path) -> None:
    file = tmp_path / "axis.csv"
    file.write_text("target,up 1 [um],down 1 [um]\n0,1.5,\n10,2,3\n", encoding="utf-8")
    found = CsvFormat().read(file)
    assert np.isnan(found.deviations[0, 0, 1])
    assert "1 readings are missing" in found.warnings


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("TGT_DATA[1]=0\nREF_DATA_FWD[2,1]=0\n", "target 2"),
        ("TGT_DATA[1]=0\nTGT_DATA[1]=1\n", "twice"),
        ("TGT_DATA[1]=0\nREF_DATA_FWD[1,1]=x\n", "no number"),
        ("TGT_DATA[1]=0\nREF_DATA_FWD[1,1]=1e30\n", "no measurement"),
        ("TGT_DATA[1]=0\nUNIT=furlong\n", "furlong"),
        ("TGT_DATA[1]=0\n", "E-FILE-ROWS"),
        ("TGT_DATA[1]=0\nTGT_DATA[2]=0.0\nREF_DATA_FWD[1,1]=0\nREF_DATA_FWD[2,1]=0\n", "occurs twice"),
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
