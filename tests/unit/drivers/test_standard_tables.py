"""Tables as the standard's annex and the literature print them: read by what they say, asked about what they do not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from drivers.errors import FileFormatError
from drivers.files.csvmap import CsvFormat

# Made-up readings, um: by target (mm), then run 1 and 2, up and down each.
READINGS = {
    10.5: ((0.1, 1.2), (0.3, 1.6)),
    50.0: ((2.5, 3.5), (2.25, 3.75)),
    100.5: ((-4.125, -3.0), (-4.5, -2.75)),
}
WANTED = np.array(list(READINGS.values()))
TITLE = "Positional deviation (µm)\n"
INDEX = "i;1;;2;;3;\n"
ANNEX = (
    "Target position Pi (mm);10.5;;50;;100.5;\nApproach direction;↓;↑;↓;↑;↓;↑\n"
    "j = 1;1.2;0.1;3.5;2.5;-3;-4.125\nj = 2;1.6;0.3;3.75;2.25;-2.75;-4.5\nMean;1.4;0.2;3.6;2.4;-2.9;-4.3\n"
)
ROWS = [(target, *run[0], *run[1]) for target, run in READINGS.items()]
READ = {
    "annex, a target over both its ways": TITLE + INDEX + ANNEX,
    "annex, a target over each way": TITLE + ANNEX.replace("10.5;;50;;100.5;", "10.5;10.5;50;50;100.5;100.5"),
    "means, spreads and reversal beside the passes": "Target (mm),Fwd 1 (um),Rev 1 (um),Fwd 2 (um),Rev 2 (um),s fwd,B\n"
    + "".join(f"{t},{a},{b},{c},{d},0.3,-1.1\n" for t, a, b, c, d in ROWS),
    "symbols, units beneath": "Pi,x1↑,x1↓,x2↑,x2↓\nmm,µm,µm,µm,µm\n"
    + "".join(f"{t},{a},{b},{c},{d}\n" for t, a, b, c, d in ROWS),
    "quoted decimal commas": "Target (mm),Up 1 (µm),Down 1 (µm),Up 2 (µm),Down 2 (µm)\n"
    + "".join(",".join(f'"{value}"'.replace(".", ",") for value in row) + "\n" for row in ROWS),
    "italian": "Posizione nominale [mm];Senso;Ciclo;Scostamento [µm]\n"
    + "".join(
        f"{t};{word};{run + 1};{READINGS[t][run][way]}\n"
        for run in (0, 1)
        for way, word in enumerate(("andata", "ritorno"))
        for t in READINGS
    ),
    "russian": "Заданная позиция (мм);Направление;Цикл;Отклонение (мкм)\n"
    + "".join(
        f"{t};{word};{run + 1};{READINGS[t][run][way]}\n"
        for run in (0, 1)
        for way, word in enumerate(("прямое", "обратное"))
        for t in READINGS
    ),
}


def read(text: str, folder: Path, unit: str = "") -> np.ndarray:
    file = folder / "axis.csv"
    file.write_text(text, encoding="utf-8")
    found = CsvFormat(unit).read(file)
    assert found.targets.tolist() == list(READINGS)
    return found.deviations


@pytest.mark.parametrize("name", READ)
def test_a_printed_table_gives_its_readings(name: str, tmp_path: Path) -> None:
    np.testing.assert_allclose(read(READ[name], tmp_path), WANTED, rtol=0.0, atol=1e-9)


def test_readings_without_a_unit_are_asked_for(tmp_path: Path) -> None:
    text = "Target [mm],Direction,Run,Deviation\n" + "".join(
        f"{t},{'+-'[way]},{run + 1},{READINGS[t][run][way] / 1000:.6f}\n"
        for run in (0, 1)
        for way in (0, 1)
        for t in READINGS
    )
    with pytest.raises(FileFormatError, match="E-FILE-CSV-UNIT"):
        read(text, tmp_path)
    np.testing.assert_allclose(read(text, tmp_path, "mm"), WANTED, rtol=0.0, atol=1e-9)


def test_an_annex_without_its_unit_is_asked_for_and_runs_apart_are_not_lost(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="E-FILE-CSV-UNIT"):
        read(ANNEX, tmp_path)
    np.testing.assert_allclose(read(ANNEX, tmp_path, "um"), WANTED, rtol=0.0, atol=1e-9)
    with pytest.raises(FileFormatError, match="E-FILE-CSV-HEADER"):
        read(TITLE + ANNEX + "j = 3;1.2;0.1;3.5;2.5;-3;-4.125\n", tmp_path)


def test_a_quoted_thousand_is_no_decimal_comma(tmp_path: Path) -> None:
    text = 'Target (mm),Up 1 (µm),Down 1 (µm)\n"1,000",3,4\n"2,000",5,6\n"3,000",7,8\n'
    with pytest.raises(FileFormatError, match="E-FILE-CSV-MARKS"):
        read(text, tmp_path)


def lines(spoil: str = "", head: str = "Soll [mm];Anfahrt;Lauf;Abweichung [µm]", ways: str = "Hin Her") -> str:
    """The readings a row each, the ways of the first run first; the reading at 50 mm, run 2, from above is spoilt."""
    rows = [
        f"{at};{word};{run + 1};{spoil if spoil and (at, run, way) == (50.0, 1, 1) else READINGS[at][run][way]}"
        for at in reversed(READINGS)
        for run in (0, 1)
        for way, word in enumerate(ways.split())
    ]
    return "\n".join([head, *rows, ""])


@pytest.mark.parametrize("word", ["NaN", "#N/A", "#NV", "n/a", "---", "-", "Out of range", "over", "OVER-RANGE"])
def test_a_cell_without_a_reading_is_a_missing_one_in_a_row_and_in_a_column_of_a_pass(
    word: str, tmp_path: Path
) -> None:
    wanted = WANTED.copy()
    wanted[1, 1, 1] = np.nan
    np.testing.assert_array_equal(read(lines(word), tmp_path), wanted)
    wide = "Soll [mm];Hin 1 [µm];Rück 1 [µm];Hin 2 [µm];Rück 2 [µm]\n"
    wide += "".join(";".join(map(str, row)) + "\n" for row in ROWS)
    np.testing.assert_array_equal(read(wide.replace("3.75", word), tmp_path), wanted)


def test_a_minus_of_typesetters_and_a_column_of_moments_spoil_no_number(tmp_path: Path) -> None:
    text = lines().replace("-", "\u2212")
    np.testing.assert_array_equal(read(text, tmp_path), WANTED)
    head, *rows = text.replace(".", ",").splitlines()
    timed = "\n".join([f"Datum;{head}", *(f"12.03.2025;{row}" for row in rows), ""])
    np.testing.assert_array_equal(read(timed, tmp_path), WANTED)


def test_thousands_are_read_where_the_marks_leave_no_doubt_and_refused_where_they_do(tmp_path: Path) -> None:
    text = lines().replace(".", ",").replace("100,5;", "1.000,5;")
    file = tmp_path / "table.csv"
    file.write_text(text, encoding="utf-8")
    found = CsvFormat().read(file)
    assert found.targets.tolist() == [10.5, 50.0, 1000.5]
    np.testing.assert_array_equal(found.deviations, WANTED)
    with pytest.raises(FileFormatError, match="E-FILE-CSV-MARKS") as caught:
        read(lines().replace("100.5;", "100,5;"), tmp_path)
    assert "100,5" in caught.value.what


def test_a_line_without_any_reading_is_told_for_its_target_is_no_part_of_the_result(tmp_path: Path) -> None:
    wide = "Soll [mm];Hin 1 [µm];Rück 1 [µm];Hin 2 [µm];Rück 2 [µm]\n"
    wide += "".join(";".join(map(str, row)) + "\n" for row in ROWS)
    path = tmp_path / "table.csv"
    path.write_text(f"{wide}200;;NaN;-;#N/A\n", encoding="utf-8")
    found = CsvFormat().read(path)
    assert 200.0 not in found.targets
    (lost,) = found.doubts
    assert (lost.code, lost.names["stops"], lost.blocking) == ("S-READ-MISSING", f"line {len(ROWS) + 2} (200)", False)
    path.write_text(wide, encoding="utf-8")
    assert not CsvFormat().read(path).doubts
