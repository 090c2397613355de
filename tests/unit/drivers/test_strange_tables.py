"""Tables of strangers whose words or numbers mean something else than they seem to; right answers by hand."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from drivers.errors import FileFormatError
from drivers.files.columns import ColumnMap
from drivers.files.csvmap import parse_csv

HEAD = "Target [mm];Direction;Run;Error [um]"
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


def passes(place: Callable[[float], str], value: Callable[[float], str], head: str) -> str:
    """Two runs there and back at five targets; each number as the formats write it, um and mm given."""
    places = (0.0, 100.0, 200.0, 300.0, 400.0)
    lines = [
        f"{place(at)};{way};{run};{value(at / 50.0 + run / 10.0 + (way == '-'))}"
        for run in (1, 2)
        for way, order in (("+", places), ("-", places[::-1]))
        for at in order
    ]
    return "\n".join([head, *lines, ""])


def test_targets_that_each_pass_wrote_a_little_different_are_the_places_that_were_meant() -> None:
    """Each alone would be a target of one reading: no scatter, and a third of the repeatability."""
    plain = parse_csv(passes("{:g}".format, "{:.4f}".format, HEAD), ColumnMap(), "x")
    rng = np.random.default_rng(1)
    jitter = passes(lambda at: f"{at + rng.uniform(-0.001, 0.001):.4f}", "{:.4f}".format, HEAD)
    found = parse_csv(jitter, ColumnMap(), "x")
    np.testing.assert_allclose(found.deviations, plain.deviations)
    np.testing.assert_allclose(found.targets, plain.targets, atol=0.001)
    assert [(one.code, one.numbers["places"]) for one in found.doubts] == [("S-READ-NEAR", 5)]
    assert plain.doubts == ()
    shifted = passes("{:g}".format, "{:.4f}".format, HEAD) + passes(
        lambda at: f"{at + 0.5:g}", "{:.4f}".format, HEAD
    ).split("\n", 1)[1].replace(";1;", ";3;").replace(";2;", ";4;")
    assert parse_csv(shifted, ColumnMap(), "x").targets.size == 10, "half a millimetre off is another target"
    dense = "\n".join(["target_mm;direction;run;deviation_um", *(f"{at};+;1;1" for at in (0, 1, 2, 999, 1000)), ""])
    assert parse_csv(dense, ColumnMap(), "x").targets.size == 5, "one pass stopped at each of them"


def test_the_mark_of_inches_and_of_arcsec_is_asked_about_beside_lengths() -> None:
    """A table in inches gave 0.000 arcsec."""
    inches = passes(
        lambda at: f"{at / 25.4:.6f}", lambda um: f"{um / 25400.0:.9f}", 'Target ["];Direction;Run;Error ["]'
    )
    with pytest.raises(FileFormatError, match="E-FILE-CSV-UNIT") as asked:
        parse_csv(inches, ColumnMap(), "x")
    assert asked.value.fields["columns"] == "target_unit=inch reading_unit=inch"
    said = ColumnMap.read({"target_unit": "inch", "reading_unit": "inch"}, "x")
    plain = parse_csv(passes("{:g}".format, "{:.4f}".format, HEAD), ColumnMap(), "x")
    found = parse_csv(inches, said, "x")
    np.testing.assert_allclose(found.deviations, plain.deviations, atol=1e-3)
    np.testing.assert_allclose(found.targets, plain.targets, atol=1e-4)
    for head in ('Target [inch];Direction;Run;Error ["]', 'Target ["];Direction;Run;Error [inch]'):
        with pytest.raises(FileFormatError, match="E-FILE-CSV-UNIT"):
            parse_csv(passes("{:g}".format, "{:.4f}".format, head), ColumnMap(), "x")
    turned = parse_csv(passes("{:g}".format, "{:.4f}".format, 'Target [deg];Direction;Run;Error ["]'), ColumnMap(), "x")
    np.testing.assert_allclose(turned.deviations, plain.deviations)


def test_thousandths_of_a_degree_are_a_unit() -> None:
    head = "Target [deg];Direction;Run;Error [mdeg]"
    plain = parse_csv(passes("{:g}".format, "{:.4f}".format, HEAD), ColumnMap(), "x")
    found = parse_csv(passes("{:g}".format, lambda arcsec: f"{arcsec / 3.6:.9f}", head), ColumnMap(), "x")
    np.testing.assert_allclose(found.deviations, plain.deviations)


@pytest.mark.parametrize(
    ("line", "head", "doubted"),
    [
        ("Units: inch", HEAD, True),
        ("Units: imperial", HEAD, True),
        ("Unit;mm", "Target [inch];Direction;Run;Error [inch]", True),
        ("Einheit: mm", HEAD, False),
        ("Units: metric", HEAD, False),
        ("Units: um", HEAD, False),
        ("Units: inch", "Target [inch];Direction;Run;Error [um]", False),
    ],
)
def test_a_line_that_names_another_unit_than_the_columns_stops_the_verdict(line: str, head: str, doubted: bool) -> None:
    small = head.count("inch") == 2
    text = passes("{:g}".format, lambda um: f"{um / 25400.0 if small else um:.9f}", head)
    found = parse_csv(f"{line}\n{text}", ColumnMap(), "x")
    assert [one.code for one in found.doubts if one.blocking] == (["S-READ-UNITS"] if doubted else [])
