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
# The field's words for a kind of error, in the languages of the product; each may be part of a longer word.
KINDS: Mapping[str, tuple[str, ...]] = {
    "straightness": ("STRAIGHT", "GERADHEIT", "直线度"),
    "pitch": ("PITCH", "NICK", "俯仰"),
    "yaw": ("YAW", "GIER", "偏摆"),
    "roll": ("ROLL", "WANK", "滚"),
    "position": ("POSITION", "LINEAR", "定位"),
}
READINGS = ("reading", "numbers")


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


def motions_of(
    heading: TableHeading | None, declared: Mapping[str, Value] | None, axis: str, where: str
) -> TableMotions:
    """The motions that a person declared (EXX=4, EAX=5), else those that the heading names.

    ``axis`` is the letter that the file states, for words such as "Pitch"; "" for none. Raises ConfigError
    (E-IMPORT-MOTION-UNIT) where neither heading nor declaration has a unit, (E-IMPORT-MOTION-TWICE) for two columns of
    one motion.
    """
    said = declared or {}
    named = {key.upper(): value for key, value in said.items() if NAME.fullmatch(key.upper())}
    others = {
        key: value for key, value in said.items() if key.upper() not in named and not key.lower().endswith("_unit")
    }
    if not named and said:
        return TableMotions((), _beside(heading, said))
    if heading is None:
        return TableMotions() if not named else _declared(named, {**said, **others}, where)
    if not named:
        named = _by_heading(heading, axis, where)
    if not named:
        return TableMotions((), _unread(heading))
    base = {**_frame(heading, others), **others}
    units = {key.lower(): str(value) for key, value in said.items() if key.lower().endswith("_unit")}
    by_number = {one.number: one for one in heading.columns}
    found = []
    for component, number in named.items():
        column = by_number.get(number) if isinstance(number, int) else None
        own = {"deviation": number, **_units(component, column, heading, units, where)}
        found.append(MotionColumn(component, column.heading if column else f"column {number}", {**base, **own}))
    used = set(named.values())
    left = tuple(one.heading for one in heading.columns if one.role in READINGS and one.number not in used)
    return TableMotions(tuple(found), left)


def _declared(named: Mapping[str, Value], said: Mapping[str, Value], where: str) -> TableMotions:
    """Columns of a table without a heading: everything comes from the declaration."""
    base = {key: value for key, value in said.items() if key.upper() not in named and not _of_motion(key)}
    found = []
    for component, number in named.items():
        unit = said.get(f"{component}_unit", said.get(f"{component.lower()}_unit", said.get("reading_unit", "")))
        if not unit or not said.get("target_unit"):
            raise ConfigError("E-IMPORT-MOTION-UNIT", where, columns=f"{component}={number}", component=component)
        found.append(MotionColumn(component, f"column {number}", {**base, "deviation": number, "reading_unit": unit}))
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
    found: dict[str, Value] = {}
    for one in heading.columns:
        name = _motion(one, axis) if one.role in READINGS else ""
        if not name:
            continue
        if name in found:
            columns = f"{found[name]}, {one.number}"
            raise ConfigError("E-IMPORT-MOTION-TWICE", where, component=name, columns=columns)
        found[name] = one.number
    plain = any(one.role == "reading" for one in heading.columns if one.number not in found.values())
    return {} if plain and len(found) == 1 else found


def _motion(one: TableColumn, axis: str) -> str:
    """The motion that a column's heading names: by its letters, or by its word where the axis is known."""
    text = one.words.replace("_", " ").upper()
    letters = NAME.search(text)
    if letters is not None:
        return letters[0]
    kind = next((kind for kind, marks in KINDS.items() if any(mark in text for mark in marks)), "")
    if not kind or not axis or one.words == "position":
        return ""
    if kind == "straightness":
        across = [letter for letter in _LETTER.findall(text) if letter != axis]
        return f"E{across[0]}{axis}" if len(across) == 1 else ""
    return f"E{axis}{axis}" if kind == "position" else COMPONENTS.get((axis, cast(Kind, kind)), "")


def _unread(heading: TableHeading) -> tuple[str, ...]:
    """Columns of numbers beside the one that is read."""
    return tuple(one.heading for one in heading.columns if one.role == "numbers")


def _beside(heading: TableHeading | None, said: Mapping[str, Value]) -> tuple[str, ...]:
    """Columns of readings that a declaration does not name."""
    if heading is None or "passes" in said or not ({"deviation", "measured"} & set(said)):
        return ()
    used = {value for value in said.values() if isinstance(value, int) and not isinstance(value, bool)}
    return tuple(one.heading for one in heading.columns if one.role in READINGS and one.number not in used)
