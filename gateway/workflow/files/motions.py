"""Tables with several error motions in columns: which column is which, each with the column map that reads it; pure."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

from drivers.errors import ConfigError
from drivers.types.results import TableColumn, TableHeading
from gateway.evaluate.geometry.angular import COMPONENTS, Kind
from gateway.store.maps import Value

NAME = re.compile(r"(?<![A-Z0-9])E[XYZABC][XYZABCUVW](?![A-Z0-9])")
_LETTER = re.compile(r"(?<![A-Z0-9])([XYZ])\d?(?![A-Z0-9])")
# The field's words for a kind of error, in ten languages; each may be part of a longer word.
KINDS: Mapping[str, tuple[str, ...]] = {
    "straightness": (
        *("STRAIGHT", "GERADHEIT", "直线度", "真直度", "RECTITUD", "RETTILIN", "PROSTOLINIOWO", "ПРЯМОЛИНЕЙН"),
        "RECHTHEID",
    ),
    "pitch": ("PITCH", "NICK", "俯仰", "TANGAGE", "BECCHEGGI", "CABECEO", "POCHYLENI", "ТАНГАЖ", "ピッチ"),
    "yaw": ("YAW", "GIER", "偏摆", "偏航", "LACET", "IMBARDATA", "GUIÑADA", "MYSZKOWAN", "РЫСКАН", "ヨー"),
    "roll": ("ROLL", "WANK", "滚", "ROULIS", "ALABEO", "PRZECHYLENI", "КРЕН", "ロール"),
    "position": (
        *("POSITION", "LINEAR", "定位", "线性", "LINÉAIRE", "LINEAIRE", "LINEAL", "LINIOW", "ЛИНЕЙН", "LINEAIR"),
        "位置決め",
    ),
}
ACROSS: Mapping[str, tuple[str, ...]] = {
    "H": ("HORIZ", "水平", "ORIZZONT", "HORYZONT", "ГОРИЗОНТ", "POZIOM"),
    "V": ("VERTI", "垂直", "竖直", "PION", "ВЕРТИК"),
}
_SIDE = re.compile(r"(?<![^\W\d_])([HV])(?![^\W\d_])")
# Across a horizontal axis of a machine whose Z is vertical.
SIDES: Mapping[tuple[str, str], str] = {("X", "H"): "EYX", ("X", "V"): "EZX", ("Y", "H"): "EXY", ("Y", "V"): "EZY"}
READINGS = ("reading", "numbers")
READING_WORDS = {"deviation", "measured", "increment", "length", "passes"}
OWN = ("axis", "instrument")
"""What is said of a table's motions and of no column: the axis that moved, the instrument's serial number."""
CALLED = (
    *("instrument", "instrument serial", "instrument serial no", "instrument serial number", "laser", "laser serial"),
    *("laser serial no", "messgerät", "gerät", "geräte-nr", "仪器", "仪器编号", "激光头编号", "appareil", "strumento"),
    *("instrumento", "przyrząd", "прибор"),
)
"""Words above a table that name the instrument."""
FEWEST_KINDS = 3
"""Kinds of error by words alone from which on a table is one of an instrument with several channels."""


@dataclass(frozen=True, slots=True)
class MotionColumn:
    """One error motion of a table: its ISO 230-1 name, its column's heading, and the column map that reads it."""

    component: str
    heading: str
    columns: Mapping[str, Value]


@dataclass(frozen=True, slots=True)
class TableMotions:
    """The motions of a table, none where it holds a single reading, and headings of the columns that are left out."""

    motions: tuple[MotionColumn, ...] = ()
    left_out: tuple[str, ...] = ()


def instrument_of(heading: TableHeading | None, declared: Mapping[str, Value] | None) -> str:
    """The instrument that a person or the words above a table name, "" where nobody does."""
    said = str((declared or {}).get("instrument", "")).strip()
    words = heading.said.items() if heading is not None else ()
    return said or next((text.strip() for key, text in words if key.lower().strip(" .:#") in CALLED), "")


def senses_in(said: Mapping[str, Value] | None) -> dict[str, Value]:
    """What was said of the senses of an instrument's channels: EBX_sense=-1."""
    return {key.upper().replace("_SENSE", "_sense"): value for key, value in (said or {}).items() if _sense_of(key)}


def motions_of(
    heading: TableHeading | None, declared: Mapping[str, Value] | None, axis: str, where: str
) -> TableMotions:
    """The motions that a person declared (EXX=4, EAX=5), else those that the heading names.

    ``axis`` is the letter that the file states, for words such as "Pitch"; "" for none. A table of an instrument with
    several channels (`FEWEST_KINDS`), named by words, says nothing of the way its channels count: that is asked.
    Raises ConfigError (E-IMPORT-MOTION-UNIT) where neither heading nor declaration has a unit, (E-IMPORT-MOTION-TWICE)
    for two columns of one motion, (E-IMPORT-MOTION-AXIS) where no word says which axis moved, (E-IMPORT-MOTION-WHICH)
    where the axis leaves open what a word means, (E-IMPORT-MOTION-SENSE).
    """
    said = declared or {}
    axis = str(said.get("axis", "")).strip().upper()[:1] or axis
    senses = senses_in(said)
    said = {key: value for key, value in said.items() if key not in OWN and not _sense_of(key)}
    named = {key.upper(): value for key, value in said.items() if NAME.fullmatch(key.upper())}
    others = {
        key: value for key, value in said.items() if key.upper() not in named and not key.lower().endswith("_unit")
    }
    by_words = not named and not READING_WORDS & set(said)
    if not named and READING_WORDS & set(said):
        return TableMotions((), _beside(heading, said))
    if heading is None:
        return TableMotions() if not named else _declared(named, {**said, **others}, senses, where)
    if not named:
        named = _by_heading(heading, axis, where)
    if not named:
        return TableMotions((), _unread(heading))
    base = {**_frame(heading, others), **others}
    units = {key.lower(): str(value) for key, value in said.items() if key.lower().endswith("_unit")}
    by_number = {one.number: one for one in heading.columns}
    if by_words and _channels(heading) >= FEWEST_KINDS:
        _senses_known({key: by_number[int(value)] for key, value in named.items()}, senses, where)
    found = []
    for component, number in named.items():
        column = by_number.get(number) if isinstance(number, int) else None
        own = {"deviation": number, **_units(component, column, heading, units, where), **_sense(component, senses)}
        found.append(MotionColumn(component, column.heading if column else f"column {number}", {**base, **own}))
    used = set(named.values())
    left = tuple(one.heading for one in heading.columns if one.role in READINGS and one.number not in used)
    return TableMotions(tuple(found), left)


def _sense_of(key: str) -> str:
    """The motion whose sense a word declares, "" for any other word."""
    name, mark, _ = key.upper().partition("_SENSE")
    return name if mark and NAME.fullmatch(name) else ""


def _sense(component: str, senses: Mapping[str, Value]) -> dict[str, Value]:
    said = senses.get(f"{component}_sense")
    return {} if said is None else {"sense": said}


def _senses_known(columns: Mapping[str, TableColumn], senses: Mapping[str, Value], where: str) -> None:
    """Raises ConfigError (E-IMPORT-MOTION-SENSE) for channels named by words whose way of counting nobody said."""
    asked = {
        name: one
        for name, one in columns.items()
        if name[1] != name[2] and not NAME.search(_upper(one)) and f"{name}_sense" not in senses
    }
    if asked:
        raise ConfigError(
            "E-IMPORT-MOTION-SENSE",
            where,
            columns=", ".join(f"{one.heading} = {name}" for name, one in asked.items()),
            words=" ".join(f"--column {name}_sense=1" for name in asked),
        )


def _upper(one: TableColumn) -> str:
    return one.words.replace("_", " ").upper()


def _channels(heading: TableHeading) -> int:
    """How many kinds of error the words of a heading name."""
    return len({_word(_upper(one)) for one in heading.columns if one.role in READINGS} - {""})


def _word(text: str) -> str:
    return next((kind for kind, marks in KINDS.items() if any(mark in text for mark in marks)), "")


def _declared(
    named: Mapping[str, Value], said: Mapping[str, Value], senses: Mapping[str, Value], where: str
) -> TableMotions:
    """Columns of a table without a heading: everything comes from the declaration."""
    base = {key: value for key, value in said.items() if key.upper() not in named and not _of_motion(key)}
    found = []
    for component, number in named.items():
        unit = said.get(f"{component}_unit", said.get(f"{component.lower()}_unit", said.get("reading_unit", "")))
        if not unit or not said.get("target_unit"):
            raise ConfigError("E-IMPORT-MOTION-UNIT", where, columns=f"{component}={number}", component=component)
        own = {"deviation": number, "reading_unit": unit, **_sense(component, senses)}
        found.append(MotionColumn(component, f"column {number}", {**base, **own}))
    return TableMotions(tuple(found))


def _of_motion(key: str) -> bool:
    return NAME.fullmatch(key.upper().removesuffix("_UNIT")) is not None


def _frame(heading: TableHeading, others: Mapping[str, Value]) -> dict[str, Value]:
    """What all columns of a table share: targets, direction, run, where the rows begin."""
    found: dict[str, Value] = {"target": heading.column("target"), "skip": heading.skip}
    if heading.separator:
        found["separator"] = heading.separator
    run, way = heading.column("repetition"), heading.column("direction")
    if run:
        found["run"] = run
    if "direction" not in others and "passes" not in others and way:
        found |= {"direction": "column", "direction_column": way}
    return found


def _units(
    component: str, column: TableColumn | None, heading: TableHeading, said: Mapping[str, str], where: str
) -> dict[str, Value]:
    """Units of targets and readings: as declared, else as the heading has them; never supposed."""
    target = next((one for one in heading.columns if one.role == "target"), None)
    own = said.get(f"{component.lower()}_unit", "") or (column.unit if column else "") or said.get("reading_unit", "")
    of_targets = said.get("target_unit", "") or (target.unit if target else "")
    if not own or not of_targets:
        lacking = [one.heading for one, unit in ((target, of_targets), (column, own)) if one is not None and not unit]
        raise ConfigError("E-IMPORT-MOTION-UNIT", where, columns=", ".join(lacking), component=component)
    return {"reading_unit": own, "target_unit": of_targets}


def _by_heading(heading: TableHeading, axis: str, where: str) -> dict[str, Value]:
    """Column by motion, for the columns that name one; none where fewer than two do and a reading is named anyhow."""
    several = _channels(heading) >= FEWEST_KINDS
    found: dict[str, Value] = {}
    open_: list[str] = []
    for one in heading.columns:
        if one.role not in READINGS:
            continue
        name = _motion(one, axis)
        if not name:
            open_ += [one.heading] if several and _word(_upper(one)) else []
            continue
        if name in found:
            columns = f"{found[name]}, {one.number}"
            raise ConfigError("E-IMPORT-MOTION-TWICE", where, component=name, columns=columns)
        found[name] = one.number
    if open_:
        code = "E-IMPORT-MOTION-WHICH" if axis else "E-IMPORT-MOTION-AXIS"
        raise ConfigError(code, where, columns=", ".join(open_), axis=axis)
    plain = any(one.role == "reading" for one in heading.columns if one.number not in found.values())
    return {} if plain and len(found) == 1 else found


def _motion(one: TableColumn, axis: str) -> str:
    """The motion that a column's heading names: by its letters, or by its word where the axis is known."""
    text = _upper(one)
    letters = NAME.search(text)
    if letters is not None:
        return letters[0]
    kind = _word(text)
    if not kind or not axis or one.words == "position":
        return ""
    if kind == "straightness":
        across = [letter for letter in _LETTER.findall(text) if letter != axis]
        return f"E{across[0]}{axis}" if len(across) == 1 else SIDES.get((axis, _side(text)), "")
    return f"E{axis}{axis}" if kind == "position" else COMPONENTS.get((axis, cast(Kind, kind)), "")


def _side(text: str) -> str:
    """H or V where a heading says horizontal or vertical, "" for neither or both."""
    sides = {side for side, marks in ACROSS.items() if any(mark in text for mark in marks)} or set(_SIDE.findall(text))
    return sides.pop() if len(sides) == 1 else ""


def _unread(heading: TableHeading) -> tuple[str, ...]:
    """Columns of numbers beside the one that is read."""
    return tuple(one.heading for one in heading.columns if one.role == "numbers")


def _beside(heading: TableHeading | None, said: Mapping[str, Value]) -> tuple[str, ...]:
    """Columns of readings that a declaration does not name."""
    if heading is None or "passes" in said or not ({"deviation", "measured"} & set(said)):
        return ()
    used = {value for value in said.values() if isinstance(value, int) and not isinstance(value, bool)}
    return tuple(one.heading for one in heading.columns if one.role in READINGS and one.number not in used)
