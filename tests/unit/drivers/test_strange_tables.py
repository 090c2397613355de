"""Tables of strangers whose words or numbers mean something else than they seem to; right answers by hand."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.errors import FileFormatError
from drivers.files.columns import ColumnMap
from drivers.files.csvmap import parse_csv

VALUES = ((0.0, 1.0, 0.5), (100.0, 3.0, 2.5), (200.0, 6.0, 5.0), (300.0, 8.0, 7.5))


def table(head: str, cell: str = "{0:g}") -> str:
    rows = [f"{at:g};{way};{cell.format(value, at)}" for way in "+-" for at, *both in VALUES
            for value in (both["+-".index(way)],)]  # fmt: skip
    return "\n".join((f"Target [mm];Direction;{head}", *rows)) + "\n"


@pytest.mark.parametrize(
    "head",
    [
        "Correction [µm]", "Compensation value [µm]", "Error (target - actual) [µm]", "|Deviation| [µm]",
        "RMS deviation [µm]", "Standard deviation [µm]", "Deviation x0.1 [µm]",
    ],
)  # fmt: skip
def test_a_word_that_nobody_knows_says_neither_sign_nor_meaning(head: str) -> None:
    with pytest.raises(FileFormatError) as refused:
        parse_csv(table(head), ColumnMap(), "x")
    assert refused.value.code == "E-FILE-CSV-UNIT"
    assert "deviation=3" in str(refused.value.fields["columns"])
    said = parse_csv(table(head), ColumnMap.read({"deviation": 3, "sense": -1}, "x"), "x")
    np.testing.assert_allclose(said.deviations[:, 0, 0], [-1.0, -3.0, -6.0, -8.0])


def test_an_instrument_by_its_own_name_is_read_where_its_numbers_are_positions() -> None:
    text = table("ILD2300 [mm]", "{0:.0f}")
    for at, *both in VALUES:
        for value in both:
            text = text.replace(f"{at:g};+;{value:.0f}\n", f"{at:g};+;{at + value / 1000:.4f}\n", 1)
            text = text.replace(f"{at:g};-;{value:.0f}\n", f"{at:g};-;{at + value / 1000:.4f}\n", 1)
    assert parse_csv(text, ColumnMap(), "x").deviations[1, 0, 0] == pytest.approx(3.0)


def test_targets_in_the_column_of_positions_are_refused() -> None:
    rng = np.random.default_rng(3)
    rows = [f"{at + rng.normal(0, 1e-3):.6f};+;{at:g}" for _run in range(4) for at, *_ in VALUES]
    with pytest.raises(FileFormatError, match="E-FILE-EXCHANGED"):
        parse_csv("Target [mm];Direction;Measured [mm]\n" + "\n".join(rows) + "\n", ColumnMap(), "x")


@pytest.mark.parametrize("stated", ["Machine: Mill {}", "Axis: {}", "Serial No: 47{}", "Date: 3.4.201{}"])
def test_two_tables_of_two_machines_are_no_test(stated: str) -> None:
    def text(other: int) -> str:
        parts = [
            f"{stated.format(number)}\n{way}\nTarget [mm];Deviation [um]\n0;{number}\n50;2\n100;3\n"
            for way, number in (("Forward", 7), ("Backward", other))
        ]
        return "\n".join(parts)

    np.testing.assert_allclose(parse_csv(text(7), ColumnMap(), "x").deviations[0, 0], [7.0, 7.0])
    with pytest.raises(FileFormatError, match="E-FILE-BESIDE"):
        parse_csv(text(8), ColumnMap(), "x")


def test_a_workbook_counts_runs_with_a_point() -> None:
    text = "Target [mm];Run;Deviation [um]\n0;1.0;1\n50;1.0;2\n0;3.0;3\n50;3.0;4\n"
    found = parse_csv(text, ColumnMap.read({"direction": "up"}, "x"), "x")
    np.testing.assert_allclose(found.deviations[:, :, 0], [[1.0, 3.0], [2.0, 4.0]])
