"""A table read column by column is the table read cell by cell: the same readings, notes, doubts and faults."""

from __future__ import annotations

import re
from collections.abc import Callable
from random import Random

import numpy as np
import pytest

from drivers.errors import FileFormatError
from drivers.files import csvmap
from drivers.files.columns import ColumnMap
from drivers.files.tables.plain import plain_table
from drivers.types.results import MeasuredSet

TARGETS, RUNS = 28, 4
SAID = ColumnMap()


def table(separator: str = ",", *, mark: str = ".", end: str = "\n", above: str = "", more: str = "") -> str:
    """Up and down over the targets, run after run; ``more`` is a column that nobody reads."""
    random = Random(7)
    heads = ["target [mm]", "direction", "repetition", "deviation [um]", *([more] if more else [])]
    lines = [*([above] if above else []), separator.join(heads)]
    for run in range(1, RUNS + 1):
        for way in (0, 1):
            for at in range(TARGETS) if way == 0 else reversed(range(TARGETS)):
                cells = [f"{at * 12.5:.4f}", "+-"[way], str(run), f"{random.gauss(at / 10.0, 0.2):.4f}"]
                lines.append(separator.join([*(one.replace(".", mark) for one in cells), *(["x y"] if more else [])]))
    return end.join([*lines, ""])


FORMS: dict[str, str] = {
    "comma": table(),
    "a spreadsheet's": table(";", mark=",", end="\r\n"),
    "tabs, words above": table("\t", above="Machine: Mill 7"),
    "another column": table(more="air [degC]"),
    "positions": table().replace("deviation [um]", "position [um]"),
    "no reading in two lines": re.sub(r"(12\.5000,.,2,)\S+", r"\1n/a", table()),
    "cut after a number": table().rstrip("\n"),
}


def read(text: str) -> MeasuredSet | tuple[object, ...]:
    """What the table is read as, or the fault with its fields."""
    try:
        return csvmap.parse_csv(text, SAID, "here")
    except FileFormatError as error:
        return error.code, error.where, tuple(sorted((key, str(value)) for key, value in error.fields.items()))


def by_cells(text: str, monkeypatch: pytest.MonkeyPatch) -> MeasuredSet | tuple[object, ...]:
    with monkeypatch.context() as slow:
        slow.setattr(csvmap, "plain_table", lambda *_given, **_named: None)
        return read(text)


def assert_alike(one: MeasuredSet | tuple[object, ...], other: MeasuredSet | tuple[object, ...]) -> None:
    if isinstance(one, tuple) or isinstance(other, tuple):
        assert one == other
        return
    assert one.targets.tobytes() == other.targets.tobytes()
    assert one.deviations.tobytes() == other.deviations.tobytes()
    assert (one.axis_unit, one.header, one.warnings, one.doubts) == (
        other.axis_unit,
        other.header,
        other.warnings,
        other.doubts,
    )


@pytest.mark.parametrize("form", FORMS)
def test_a_plain_table_is_read_by_its_columns_as_by_its_cells(form: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert plain_table(FORMS[form], SAID, "here", mixed=False) is not None
    found = read(FORMS[form])
    assert isinstance(found, MeasuredSet) or form == "positions"
    assert_alike(found, by_cells(FORMS[form], monkeypatch))


def test_the_readings_are_those_of_the_text() -> None:
    found = read(FORMS["a spreadsheet's"])
    assert isinstance(found, MeasuredSet)
    assert found.deviations.shape == (TARGETS, RUNS, 2)
    line = FORMS["a spreadsheet's"].split("\r\n")[2 * TARGETS]  # run 1, down, the last: target 0
    assert line.startswith("0,0000;-;1;")
    assert found.deviations[0, 0, 1] == float(line.rpartition(";")[2].replace(",", "."))


Change = Callable[[list[str], int], None]


def _set(text: str) -> Change:
    return lambda lines, at: lines.__setitem__(at, text)


def _cell(number: int, text: str) -> Change:
    def change(lines: list[str], at: int) -> None:
        cells = lines[at].split(",")
        cells[number] = text
        lines[at] = ",".join(cells)

    return change


CHANGES: dict[str, Change] = {
    "blank line": _set(""),
    "remark": _set("# moved the tripod"),
    "heading again": lambda lines, at: lines.__setitem__(at, lines[0]),
    "statistics": _set("mean,,,1.2"),
    "rule": _set("-----"),
    "a cell too few": lambda lines, at: lines.__setitem__(at, lines[at].rpartition(",")[0]),
    "a cell too many": lambda lines, at: lines.__setitem__(at, lines[at] + ",7"),
    "an empty cell too many": lambda lines, at: lines.__setitem__(at, lines[at] + ","),
    "line twice": lambda lines, at: lines.insert(at, lines[at]),
    "quotes": _cell(3, '"1.5"'),
    "quotes open": _cell(3, '"1.5'),
    "return in a line": _cell(3, "1\r5"),
    "blanks": _cell(3, "  1.5 "),
    "thousands": _cell(0, "1 012.5"),
    "two marks": _cell(3, "1.2.3"),
    "exponent": _cell(3, "1.5e-1"),
    "large exponent": _cell(3, "1e400"),
    "many digits": _cell(3, "0.1234567890123456789012345678901"),
    "nan": _cell(3, "NaN"),
    "infinity": _cell(3, "inf"),
    "underscore": _cell(3, "1_0"),
    "other digits": _cell(3, "١"),
    "empty": _cell(3, ""),
    "dashes": _cell(3, "--"),
    "words": _cell(3, "out of range"),
    "no target": _cell(0, ""),
    "minus zero": _cell(0, "-0.0000"),
    "another way's word": _cell(1, "UP"),
    "no way": _cell(1, "sideways"),
    "no run": _cell(2, "x"),
    "run as a workbook has it": _cell(2, "2.0"),
    "run out of bounds": _cell(2, "10000"),
    "wild": _cell(3, "99999.9"),
    "no measurement": _cell(3, "9e12"),
}


IN_THE_BEGINNING = ("a cell too few", "quotes open", "blank line", "exponent")
AT_THE_END = ("empty", "dashes", "words", "nan", "a cell too few", "remark", "blanks")
PLACES = [(215, "\n", name) for name in CHANGES]  # behind what is looked at first
PLACES += [(2, "\n", name) for name in IN_THE_BEGINNING] + [(-1, "", name) for name in AT_THE_END]


@pytest.mark.parametrize(("at", "end", "name"), PLACES)
def test_whatever_a_line_holds_is_read_alike(at: int, end: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = FORMS["comma"].rstrip("\n").split("\n")
    CHANGES[name](lines, at % len(lines))
    text = "\n".join(lines) + end
    assert_alike(read(text), by_cells(text, monkeypatch))


def test_a_large_table_takes_no_cell_by_cell_way() -> None:
    text = FORMS["comma"]
    head, _, body = text.partition("\n")
    rows = [line.split(",") for line in body.splitlines()]
    many = [",".join([a, b, str(int(run) + RUNS * more), v]) for more in range(40) for a, b, run, v in rows]
    found = plain_table("\n".join([head, *many, ""]), SAID, "here", mixed=False)
    assert found is not None
    readings = found[2]
    assert len(readings) == 2 * TARGETS * RUNS * 40
    assert np.array_equal(readings.line[[0, -1]], [2, len(many) + 1])
