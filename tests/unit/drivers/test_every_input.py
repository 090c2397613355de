"""One random measurement in every layout, unit, mark, order and language: the same figures, or a refusal."""

from __future__ import annotations

import io
import random
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.errors import ConfigError, FileFormatError
from drivers.files.columns import ColumnMap
from drivers.files.csvmap import parse_csv
from drivers.files.readings import Reading, Readings
from drivers.files.workbook import workbook_text
from drivers.types.results import MeasuredSet
from tests.sizes import long, soak

# What one of a unit is in mm or deg, from the definitions and not from the reader.
LENGTHS = {"mm": 1.0, "um": 1e-3, "nm": 1e-6, "inch": 25.4, "m": 1e3}
ANGLES = {"deg": 1.0, "arcsec": 1 / 3600, "mrad": 0.18 / np.pi, "urad": 0.18e-3 / np.pi, "rad": 180 / np.pi}
TARGETS = {"mm": ("mm", "inch"), "deg": ("deg", "rad")}
SPELLED = {
    "um": ("um", "µm", "micron"),
    "inch": ("in", "inch"),
    "arcsec": ("arcsec", "角秒"),
    "deg": ("deg", "°"),
    "urad": ("urad", "µrad"),
}
LANGUAGES = {
    "en": ("Target", "Direction", "Run", "Deviation", "Measured"),
    "en2": ("Setpoint", "Approach", "Cycle", "Error", "Position"),
    "de": ("Soll", "Richtung", "Zyklus", "Abweichung", "Ist"),
    "fr": ("Cible", "Sens", "Cycle", "Écart", "Mesure"),
    "it": ("Posizione nominale", "Senso", "Ciclo", "Scostamento", "Posizione misurata"),
    "zh": ("目标位置", "方向", "次数", "偏差", "测量值"),
}
WAYS = (("+", "-"), ("up", "down"), ("forward", "backward"), ("1", "-1"), ("vorwärts", "rückwärts"), ("正向", "反向"))
LAYOUTS = ("row", "passes", "two tables", "declared", "workbook")
# Decimal mark, mark between thousands ("" none) and a cell separator that goes with both.
MARKS: tuple[tuple[str, str, str], ...] = (
    (".", "", ","),
    (".", "", ";"),
    (",", "", ";"),
    (".", ",", "\t"),
    (",", ".", ";"),
    (",", "\u00a0", ";"),
)
MARKS += ((".", "'", ";"), (".", "’", "|"), (",", " ", "\t"), (",", "\u202f", ";"))


@dataclass
class Case:
    """A measurement, mm and um or deg and arcsec: targets (m,), deviations (m, n, 2); and how it is written."""

    targets: np.ndarray
    deviations: np.ndarray
    kind: str
    layout: str
    quantity: str
    unit: str
    target_unit: str
    marks: tuple[str, str, str]
    words: tuple[str, str, str, str, str]
    ways: tuple[str, str]
    shuffled: bool
    chance: random.Random
    cells: dict[tuple[int, int, int], str] = field(default_factory=dict)


def made(chance: random.Random) -> Case:
    kind = chance.choice(["mm", "mm", "deg"])
    count, runs = chance.randint(4, 9), chance.randint(1, 4)
    step = chance.choice([25.0, 60.0, 250.0] if kind == "mm" else [10.0, 30.0, 36.0])
    first = chance.choice([0.0, -step * 2, step, step / 2])
    targets = first + step * np.arange(count)
    rng = np.random.default_rng(chance.randrange(1 << 30))
    curve = rng.uniform(-8.0, 8.0) * np.linspace(0.0, 1.0, count)[:, None, None]
    deviations = curve + rng.normal(0.0, 0.6, (count, runs, 2)) + np.array([0.0, rng.uniform(-3.0, 3.0)])
    unit = chance.choice(list(LENGTHS if kind == "mm" else ANGLES))
    layout = chance.choice(LAYOUTS)
    quantity = chance.choice(["deviation", "position"])
    if quantity == "position" and unit in ("nm", "m", "arcsec", "urad"):
        unit = kind
    return Case(
        targets, np.round(deviations, 2), kind, layout, quantity, unit, chance.choice(TARGETS[kind]),
        chance.choice(MARKS), LANGUAGES[chance.choice(list(LANGUAGES))], chance.choice(WAYS),
        chance.random() < 0.5, chance,
    )  # fmt: skip


def scale(unit: str) -> float:
    return {**LENGTHS, **ANGLES}[unit]


def spelled(number: float, case: Case) -> str:
    """Twelve digits behind the mark, so that no unit loses anything; groups of thousands where the marks have them."""
    point, group, _separator = case.marks
    whole, _, rest = f"{abs(number):.12f}".partition(".")
    grouped = f"{int(whole):,}".replace(",", group)
    return f"{'-' if number < 0 else ''}{grouped}{point}{rest}"


def reading(case: Case, at: tuple[int, int, int]) -> str:
    if at in case.cells:
        return case.cells[at]
    deviation = case.deviations[at] / (1e3 if case.kind == "mm" else 3600.0)
    value = deviation if case.quantity == "deviation" else case.targets[at[0]] + deviation
    return spelled(value / scale(case.unit), case)


def headed(word: str, unit: str, case: Case) -> str:
    name = case.chance.choice(SPELLED.get(unit, (unit,)))
    return case.chance.choice([f"{word} [{name}]", f"{word} ({name})"])


def written(case: Case) -> tuple[str, dict[str, Any]]:
    """The text and what must be said of it beside."""
    count, runs, _ = case.deviations.shape
    separator = case.marks[2]
    target, direction, run, deviation, position = case.words
    head_target = headed(target, case.target_unit, case)
    head_reading = headed(deviation if case.quantity == "deviation" else position, case.unit, case)
    places = [spelled(value / scale(case.target_unit), case) for value in case.targets]
    stops = [(i, j, k) for j in range(runs) for k in (0, 1) for i in (range(count) if k == 0 else range(count)[::-1])]
    rows = [[places[i], case.ways[k], str(j + 1), reading(case, (i, j, k))] for i, j, k in stops]
    if case.shuffled:
        case.chance.shuffle(rows)
    said: dict[str, Any] = {}
    if case.layout == "passes":
        unit = case.chance.choice(SPELLED.get(case.unit, (case.unit,)))
        word = "" if case.quantity == "deviation" and case.unit in ("um", "arcsec") else f"{head_word(case)} "
        heads = [f"{word}Run {j + 1} {'fwd' if k == 0 else 'rev'} [{unit}]" for j in range(runs) for k in (0, 1)]
        table = [[head_target, *heads]]
        table += [[places[i], *(reading(case, (i, j, k)) for j in range(runs) for k in (0, 1))] for i in range(count)]
    elif case.layout == "two tables":
        table = []
        for k, title in enumerate(("forward", "backward")):
            table += [[f"# {title}"], [head_target, run, head_reading]]
            table += [[places[i], str(j + 1), reading(case, (i, j, k))] for j in range(runs) for i in range(count)]
            table += [[""]]
    elif case.layout == "declared":
        key = "deviation" if case.quantity == "deviation" else "measured"
        said = {"target": 2, key: 4, "run": 3, "direction_column": 1}
        table = [["a", headed("b", case.target_unit, case), "c", headed("d", case.unit, case)]]
        table += [[way, place, number, value] for place, way, number, value in rows]
    else:
        table = [[head_target, direction, run, head_reading], *rows]
    quote = separator == "," and "," in "".join(case.marks[:2])
    return "\n".join(separator.join(f'"{c}"' if quote else c for c in row) for row in table) + "\n", said


def head_word(case: Case) -> str:
    return "deviation" if case.quantity == "deviation" else "measured"


def book(text: str, separator: str) -> bytes:
    import openpyxl

    made_book = openpyxl.Workbook()
    sheet = made_book.active
    assert sheet is not None
    for line in text.splitlines():
        sheet.append(line.split(separator))
    out = io.BytesIO()
    made_book.save(out)
    return out.getvalue()


def read(case: Case) -> MeasuredSet:
    text, said = written(case)
    columns = ColumnMap.read(said, "x")
    if case.layout == "workbook" and case.chance.random() < 0.1:  # unpacking is slow, and the sheet is then a text
        text = workbook_text(book(text, case.marks[2]), columns, "x")
    return parse_csv(text, columns, "x")


def same(found: MeasuredSet, case: Case) -> None:
    assert found.axis_unit == case.kind
    np.testing.assert_allclose(found.targets, case.targets, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.deviations, case.deviations, atol=2e-4)
    assert not [one for one in found.doubts if one.blocking]


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("count", [350, long(1400), soak(70_000)])
def test_one_measurement_in_every_form_gives_the_same_figures(count: int) -> None:
    chance = random.Random(count)
    layouts = set()
    for _ in range(count):
        case = made(chance)
        layouts.add(case.layout)
        same(read(case), case)
    assert layouts == set(LAYOUTS)


SENTINELS = (9999.0, 99999.0, -9999.0, 999.0, 1e9)


def spoilt(case: Case, chance: random.Random) -> tuple[str, set[tuple[int, int, int]]]:
    """One foreign fact put in: its kind, and the readings that may be left out because of it."""
    count, runs, _ = case.deviations.shape
    able = ["word", "unit unsaid", "letter", "unit contradicts"]
    able += ["sentinel"] if case.deviations.size >= 8 else []
    able += ["turn"] if case.kind == "deg" else []
    fact = chance.choice(able)
    places = {(chance.randrange(count), chance.randrange(runs), chance.randrange(2)) for _ in range(1 + runs // 2)}
    if fact == "word":
        case.cells = dict.fromkeys(places, chance.choice(["Out of range", "---", "over", "", "NaN", "#N/A", "n/a"]))
    elif fact == "sentinel":
        # 999 nm is a reading like others: a mark that no reading can be is far beyond all of them.
        far = [one for one in SENTINELS if case.unit != "nm" or abs(one) > 50_000.0]
        own = chance.choice([*far, 0.0] if case.quantity == "position" else far)
        # 0 read at 0, or 99999 um at 100 mm, is a reading like others.
        beside = case.quantity == "position"
        places = {at for at in places if not beside or abs(own * scale(case.unit) - case.targets[at[0]]) > 5.0}
        case.cells = dict.fromkeys(places, spelled(own, case))
    elif fact == "letter":
        case.cells = {next(iter(places)): "12x"}
    elif fact == "turn":
        turn = 360.0 / scale(case.unit) * chance.choice([1, -1, 2])
        extra = {
            at: case.deviations[at] / 3600.0 + (case.targets[at[0]] if case.quantity == "position" else 0.0)
            for at in places
        }
        case.cells = {at: spelled(value / scale(case.unit) + turn, case) for at, value in extra.items()}
        places = set()
    return fact, places


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("count", [200, long(600), soak(30_000)])
def test_one_foreign_fact_never_gives_other_figures(count: int) -> None:
    chance = random.Random(count + 1)
    outcomes: dict[str, set[str]] = {}
    refused: list[str] = []
    for _ in range(count):
        case = made(chance)
        fact, lost = spoilt(case, chance)
        wanted = case.deviations.copy()
        for at in lost if fact in ("word", "sentinel") else ():
            wanted[at] = np.nan
        try:
            found = told_otherwise(case, fact) if fact.startswith("unit") else read(case)
        except (FileFormatError, ConfigError) as error:
            outcomes.setdefault(fact, set()).add("refused")
            refused.append(error.code)
            continue
        outcomes.setdefault(fact, set()).add("read")
        if any(one.blocking for one in found.doubts):
            continue
        there = ~np.isnan(wanted).all(axis=(1, 2))
        np.testing.assert_allclose(found.targets, case.targets[there], rtol=1e-9, atol=1e-9, err_msg=fact)
        kept = wanted[there]
        runs = ~np.isnan(kept).all(axis=(0, 2))
        shown = found.deviations[:, ~np.isnan(found.deviations).all(axis=(0, 2)), :]
        # A true reading of nought or nines beside the mark may count as one; nothing else may differ.
        np.testing.assert_allclose(shown, kept[:, runs], atol=2e-3 if fact == "turn" else 2e-4, err_msg=fact)
        if np.isnan(kept).any() or fact == "turn":
            assert found.doubts, fact
    assert outcomes["letter"] == outcomes["unit unsaid"] == outcomes["unit contradicts"] == {"refused"}
    asked = ("E-FILE-CSV-UNIT", "E-FILE-CSV-CONTRADICTS", "E-FILE-LINE", "E-FILE-CSV-MARKS")
    assert set(refused) <= set(asked)
    assert "read" in outcomes["word"]
    assert "read" in outcomes["sentinel"]


def told_otherwise(case: Case, fact: str) -> MeasuredSet:
    """The table without the unit of its readings, or read as if they had another one."""
    text, said = written(case)
    if fact == "unit unsaid":
        for word in SPELLED.get(case.unit, (case.unit,)):
            for opened, closed in ("[]", "()"):
                text = text.replace(f"{opened}{word}{closed}", "")
        return parse_csv(text, ColumnMap.read(said, "x"), "x")
    units = [one for one in (LENGTHS if case.kind == "mm" else ANGLES) if one != case.unit]
    return parse_csv(text, ColumnMap.read({**said, "reading_unit": case.chance.choice(units)}, "x"), "x")


def test_readings_cannot_be_made_without_a_unit() -> None:
    rows = (Reading(2, 0.0, 0, run=1, value=1.0),)
    for unit, target_unit in (("", "mm"), ("um", ""), ("furlong", "mm"), ("arcsec", "mm")):
        with pytest.raises(ConfigError, match="E-FILE-UNIT"):
            Readings("deviation", unit, target_unit, rows)
    assert Readings("deviation", "arcsec", "mm", rows, mixed=True).axis_unit == "deg"
    assert Readings("position", "mrad", "deg", rows).circular


def table(*rows: str, head: str = "target_mm,direction,repetition,measured_mm", **said: Any) -> MeasuredSet:
    return parse_csv("\n".join([head, *rows, ""]), ColumnMap.read(said, "x"), "x")


@pytest.mark.parametrize(
    ("value", "lost"),
    [("9999", True), ("0.0000", True), ("99999", True), ("-9999", True), ("33", False)],
)
def test_marks_for_no_reading_are_left_out_by_name_and_wild_readings_block(value: str, lost: bool) -> None:
    rows = [f"{at},+,1,{value if at in (100, 200) else at + 0.001 * (at % 7)}" for at in range(100, 1100, 100)]
    if value == "33":
        rows[1] = "200,+,1,44"
        (doubt,) = table(*rows).doubts
        assert (doubt.code, doubt.blocking) == ("S-READ-SIZE", True)
        assert "line 2 (target 100: 33), line 3 (target 200: 44)" in doubt.text
        assert not table(*rows, confirmed=True).doubts[-1].blocking
        return
    found = table(*rows)
    assert found.targets.tolist() == [float(at) for at in range(300, 1100, 100)]
    assert [one.code for one in found.doubts] == ["S-READ-MARKS"]
    assert "line 2 (target 100" in found.doubts[0].text


def test_one_length_at_several_places_is_no_position() -> None:
    rows = [f"{at},+,{run},{25.0 + 0.0005 * run}" for run in (1, 2) for at in (0, 100, 200)]
    with pytest.raises(FileFormatError, match="E-FILE-SAME"):
        table(*rows)
    with pytest.raises(FileFormatError, match="E-FILE-LENGTH"):
        table(*rows, target=1, length=4, direction_column=2, run=3)


def test_steps_are_summed_from_the_first_stop_of_each_run() -> None:
    rows = ["0,+,1,0", "25,+,1,25.001", "50,+,1,25.002", "75,+,1,24.999"]
    found = table(*rows, target=1, increment=4, direction_column=2, run=3)
    np.testing.assert_allclose(found.deviations[:, 0, 0], [0.0, 1.0, 3.0, 2.0], atol=1e-9)


def test_angles_are_subtracted_as_angles_and_a_run_through_zero_stays_together() -> None:
    head = "target_deg,direction,repetition,measured_deg"
    whole = table("0,+,1,359.9999", "180,+,1,180.0002", "360,+,1,0.0001", "350,+,1,350", head=head)
    np.testing.assert_allclose(whole.deviations[:, 0, 0], [-0.36, 0.72, 0.0, 0.36], atol=1e-6)
    assert [one.code for one in whole.doubts] == ["S-READ-TURNS"]
    rows = [f"{at},+,1,{at + 0.0001}" for at in (340, 350, 0, 10, 20)]
    through = table(*rows, *[f"{at},-,1,{at}" for at in (20, 10, 0, 350, 340)], head=head)
    assert through.targets.tolist() == [-20.0, -10.0, 0.0, 10.0, 20.0]
    np.testing.assert_allclose(through.deviations[:, 0, :], [[0.36, 0.0]] * 5, atol=1e-6)
    assert [one.code for one in through.doubts] == ["S-READ-CROSSED"]


def test_positions_from_another_zero_need_their_datum() -> None:
    rows = [f"{at},+,1,{at - 150 + 0.001}" for at in range(150, 450, 50)]
    (doubt,) = table(*rows).doubts
    assert (doubt.code, doubt.blocking) == ("S-READ-SIZE", True)
    found = table(*rows, datum=150.0)
    np.testing.assert_allclose(found.deviations[:, 0, 0], 1.0, atol=1e-6)
    assert not found.doubts


def test_a_return_to_the_start_is_no_reading_from_the_other_side() -> None:
    rows = [f"{at},{at / 100}" for _ in (1, 2) for at in (0, 100, 200)]
    with pytest.raises(FileFormatError, match="line 5: the order of the rows does not say"):
        table(*rows, head="a [mm],b [um]", target=1, deviation=2)


@pytest.mark.parametrize(("name", "data", "code"), [
    ("a.csv", b"PK\x03\x04dummy", "E-FILE-WORKBOOK-NAME"),
    ("a.xlsx", b"target,x\n1,2\n", "E-FILE-WORKBOOK "),
    ("a.xlsx", b"PK\x03\x04dummy", "E-FILE-WORKBOOK "),
    ("a.xls", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1rest", "E-FILE-WORKBOOK-OLD"),
])  # fmt: skip
def test_what_is_no_workbook_gets_one_clear_sentence(name: str, data: bytes, code: str, tmp_path: Path) -> None:
    from drivers.files.csvmap import CsvFormat

    (tmp_path / name).write_bytes(data)
    with pytest.raises(FileFormatError, match=code):
        CsvFormat().read(tmp_path / name)


def test_a_direction_that_every_pass_contradicts_stops_the_verdict() -> None:
    """A column that names where the axis goes to, or is swapped, turns the sign of the reversal."""
    up, down = (0, 100, 200, 300), (300, 200, 100, 0)
    deviation = {"direction_column": 2, "target": 1, "run": 3, "deviation": 4}
    head = "target_mm,direction,repetition,deviation_um"

    def read(first: str, second: str, one: tuple[int, ...], two: tuple[int, ...]) -> list[str]:
        rows = [f"{at},{way},1,{at / 100}" for way, ats in ((first, one), (second, two)) for at in ats]
        return [doubt.code for doubt in table(*rows, head=head, **deviation).doubts if doubt.blocking]

    assert read("+", "-", up, down) == []
    assert read("-", "+", up, down) == ["S-READ-DIRECTION"]
    assert read("-", "+", up, up) == []  # sorted: the order tells nothing
    assert read("+", "-", down, down) == []
