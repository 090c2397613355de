"""What the words of a result file mean: its dates, its columns, and which column holds which error motion; pure.

A date that can be read in two ways means several days (`Days`), and only what holds for all of them is concluded. No
unit and no counting sense is supposed: what a heading leaves open is asked once for all tables with that heading.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime, timedelta
from typing import cast

from drivers.errors import ConfigError
from drivers.types.results import TableColumn, TableHeading
from gateway.evaluate.geometry.angular import COMPONENTS, Kind
from gateway.store import Value

DATE = "date, measured on, test date, datum, messdatum, 日期, 测量日期, data, fecha"
"""Headings under which a file states its day."""
_MONTHS = (
    "jan, januar, january, janvier, gennaio, enero, jän, jänner",
    "feb, februar, february, février, fevrier, febbraio, febrero",
    "mar, mär, mrz, märz, maerz, march, mars, marzo",
    "apr, april, avril, aprile, abril",
    "may, mai, maggio, mayo",
    "jun, juni, june, juin, giugno, junio",
    "jul, juli, july, juillet, luglio, julio",
    "aug, august, août, aout, agosto",
    "sep, sept, september, septembre, settembre, septiembre",
    "oct, okt, oktober, october, octobre, ottobre, octubre",
    "nov, november, novembre, noviembre",
    "dec, dez, dezember, december, décembre, decembre, dicembre, diciembre",
)
_MONTH = {word: number for number, words in enumerate(_MONTHS, 1) for word in words.split(", ")}
NEWEST = 69
"""A year of two digits up to this one is in this century."""
_ISO = re.compile(r"(\d{4})[-/.年 ](\d{1,2})[-/.月 ](\d{1,2})日?(?!\d)")
_RUN_TOGETHER = re.compile(r"((?:19|20)\d\d)(\d\d)(\d\d)(?!\d)")
_NUMBERS = re.compile(r"(\d{1,2})([./-])\s?(\d{1,2})\2\s?(\d{4}|\d{2})(?!\d)")
_DAY_FIRST = re.compile(r"(\d{1,2})(?:st|nd|rd|th|er)?[. -]*([^\W\d_]+)[. ,-]*(\d{4})")
_MONTH_FIRST = re.compile(r"([^\W\d_]+)[. ]*(\d{1,2})(?:st|nd|rd|th)?[ ,]+(\d{4})")
_CLOCK = re.compile(r"([^\W\d_]+) +(\d{1,2}) +\d{1,2}:\d\d(?::\d\d)? +(\d{4})")
_YEAR = re.compile(r"((?:19|20)\d\d)\Z")


@dataclass(frozen=True, slots=True)
class Days:
    """The days that a text can mean: one span, or several where day and month may be exchanged; none if unreadable."""

    spans: tuple[tuple[date, date], ...] = ()

    @property
    def day(self) -> date | None:
        """The day, where the text means exactly one."""
        single = len(self.spans) == 1 and self.spans[0][0] == self.spans[0][1]
        return self.spans[0][0] if single else None

    @property
    def last(self) -> date | None:
        """The latest day that the text can mean."""
        return max((last for _first, last in self.spans), default=None)

    @property
    def first(self) -> date | None:
        """The earliest day that the text can mean."""
        return min((first for first, _last in self.spans), default=None)

    def apart(self, other: Days) -> int:
        """Least number of days between two dates, by every reading of them; 0 where one cannot be read."""
        found = [_days_between(one, two) for one in self.spans for two in other.spans]
        return min(found, default=0)


def _days_between(one: tuple[date, date], two: tuple[date, date]) -> int:
    return max(0, (two[0] - one[1]).days, (one[0] - two[1]).days)


def days_of(text: str) -> Days:
    """The days that a date means, in the forms of English, German, Chinese and other files, a time behind it or not.

    "3/4/2024" may be March or April, "2024" is any day of that year.
    """
    plain = text.strip().lower()
    if found := _ISO.match(plain) or _RUN_TOGETHER.match(plain):
        return _days([(found[1], found[2], found[3])])
    if found := _NUMBERS.search(plain):
        first, mark, second, year = found.groups()
        if len(year) == len("24"):
            year = f"{'19' if int(year) > NEWEST else '20'}{year}"
        orders = [(year, second, first)] if mark == "." else [(year, second, first), (year, first, second)]
        return _days(orders)
    if (found := _DAY_FIRST.search(plain)) and found[2] in _MONTH:
        return _days([(found[3], str(_MONTH[found[2]]), found[1])])
    if (found := _CLOCK.search(plain) or _MONTH_FIRST.search(plain)) and found[1] in _MONTH:
        return _days([(found[3], str(_MONTH[found[1]]), found[2])])
    if found := _YEAR.match(plain):
        return Days(((date(int(found[1]), 1, 1), date(int(found[1]), 12, 31)),))
    return Days()


def _days(orders: Sequence[tuple[str, str, str]]) -> Days:
    found = []
    for year, month, day in orders:
        try:
            one = date(int(year), int(month), int(day))
        except ValueError:
            continue
        found.append((one, one))
    return Days(tuple(dict.fromkeys(found)))


def moment_of(text: str) -> str:
    """A date as ISO 8601 where it means one day, with its time where that is ISO; "" where it does not."""
    day = days_of(text).day
    if day is None:
        return ""
    plain = text.strip()
    try:
        return plain if datetime.fromisoformat(plain) and plain.startswith(day.isoformat()) else day.isoformat()
    except ValueError:
        return day.isoformat()


def date_in(header: Mapping[str, str]) -> str:
    """What a file's header states as its day, "" for nothing."""
    known = DATE.split(", ")
    return next((text for key, text in header.items() if key.replace("_", " ").lower().strip(" .:#") in known), "")


def is_future(text: str, today: date) -> bool:
    """Whether a date means a day after tomorrow by every reading of it; a day for time zones."""
    first = days_of(text).first
    return first is not None and first > today + timedelta(days=1)


# A map of columns as a person types it: NAME=VALUE words; and what is asked where a table leaves something open.

# What a table leaves open, and the question that a person answers once for all tables with its heading.
ASKS = {
    "E-FILE-CSV-HEADER": "E-IMPORT-COLUMNS",
    "E-FILE-CSV-WAYS": "E-IMPORT-WAYS",
    "E-FILE-CSV-RUNS": "E-IMPORT-RUNS",
    "E-FILE-CSV-UNIT": "E-IMPORT-READINGS",
    "E-FILE-CSV-SEVERAL": "E-IMPORT-CHOOSE",
    "E-FILE-SHEET": "E-IMPORT-SHEET",
}
_WHOLE, _NUMBER = re.compile(r"[+-]?\d{1,8}\Z", re.ASCII), re.compile(r"[+-]?\d{1,8}\.\d{0,9}\Z", re.ASCII)
WORDS: dict[str, str | bool] = {"tab": "\t", "semicolon": ";", "comma": ",", "blank": ""}
WORDS |= {"yes": True, "true": True, "no": False, "false": False}


def columns_of(words: Sequence[str]) -> dict[str, Value]:
    """A column map from NAME=VALUE words. Raises ConfigError (E-CLI-COLUMN)."""
    found: dict[str, Value] = {}
    for word in words:
        name, mark, value = word.partition("=")
        if not mark or not name.strip():
            raise ConfigError("E-CLI-COLUMN", "--column", text=word)
        found[name.strip()] = _value(value.strip())
    return found


def _value(text: str) -> Value:
    plain = text.lower()
    if _WHOLE.match(plain):
        return int(plain)
    return float(plain) if _NUMBER.match(plain) else WORDS.get(plain, text)


# Tables with several error motions in columns: which column is which, each with the column map that reads it; pure.

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
        return TableMotions((), _undeclared_columns(heading, said))
    if heading is None:
        return TableMotions() if not named else _declared_columns(named, {**said, **others}, senses, where)
    if not named:
        named = _by_heading(heading, axis, where)
    if not named:
        return TableMotions((), _unread_columns(heading))
    base = {**_frame(heading, others), **others}
    units = {key.lower(): str(value) for key, value in said.items() if key.lower().endswith("_unit")}
    by_number = {one.number: one for one in heading.columns}
    if by_words and _channels(heading) >= FEWEST_KINDS:
        _require_senses({key: by_number[int(value)] for key, value in named.items()}, senses, where)
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


def _require_senses(columns: Mapping[str, TableColumn], senses: Mapping[str, Value], where: str) -> None:
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


def _declared_columns(
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
        name = _motion_of_heading(one, axis)
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


def _motion_of_heading(one: TableColumn, axis: str) -> str:
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


def _unread_columns(heading: TableHeading) -> tuple[str, ...]:
    """Columns of numbers beside the one that is read."""
    return tuple(one.heading for one in heading.columns if one.role == "numbers")


def _undeclared_columns(heading: TableHeading | None, said: Mapping[str, Value]) -> tuple[str, ...]:
    """Columns of readings that a declaration does not name."""
    if heading is None or "passes" in said or not ({"deviation", "measured"} & set(said)):
        return ()
    used = {value for value in said.values() if isinstance(value, int) and not isinstance(value, bool)}
    return tuple(one.heading for one in heading.columns if one.role in READINGS and one.number not in used)
