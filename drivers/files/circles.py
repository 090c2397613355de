"""Circular tests: samples of a ballbar or grid encoder by columns, and the results of a maker's .b5r; pure parsing.

A table holds radius or deviation over angle or time, or two positions. Units come from the headings or are declared.
Comment lines (``# Radius mm,150``) or declared words state radius, feed, plane and screw pitches. The sense of a pass
is told by a column, else by the way its angles go. In a .b5r only the elements of the results are public (one reader's
code): its samples are not read, and its features are never taken for an evaluation of ours.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isnan, nan
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import FileFormatError
from drivers.files.declared import declared
from drivers.files.numbers import decimal, missing, untaken
from drivers.files.safexml import Element, read_elements
from drivers.files.tables.headwords import head_cell
from drivers.files.tables.sheet import MARKS, cells
from drivers.files.text import end_doubts, other_texts, plain_minus, read_bytes
from drivers.local.textfile import decode_text
from drivers.message import Message, digits
from drivers.types.circles import CircleRecord, MakersFigure, MakersFigures
from drivers.types.values import FloatArray
from drivers.units import READING_UNITS, TARGET_UNITS, mm_to_um, unit_named

ROLES = ("time", "angle", "radius", "nominal", "deviation", "x", "y", "sense")
NAMES: Mapping[str, tuple[str, ...]] = {
    "sense": ("sense", "direction", "drehsinn", "richtung", "方向", "rotation", "ccw/cw"),
    "nominal": ("nominal", "soll", "名义", "radius_nominal"),
    "deviation": ("deviation", "abweichung", "偏差", "error", "écart"),
    "radius": ("radius", "radial", "半径", "rayon", "raggio", "radio"),
    "angle": ("angle", "winkel", "角度", "angolo", "ángulo"),
    "time": ("time", "zeit", "时间", "temps", "tempo"),
}
SENSES = {"ccw": 1, "+": 1, "+1": 1, "1": 1, "g3": 1, "g03": 1, "cw": -1, "-": -1, "-1": -1, "g2": -1, "g02": -1}
PLANES = ("XY", "YZ", "ZX")
TIMES = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "min": 60.0}
FEWEST, MOST = 36, 2_000_000
MOST_DEVIATION_UM = 5000.0
_BREAK = re.compile(r"\r\n|\n|\r")
_KEYS = {
    "radius": "radius_mm",
    "radius mm": "radius_mm",
    "feed": "feed_mm_min",
    "feed mm/min": "feed_mm_min",
    "plane": "plane",
    "pitch first mm": "pitch_first_mm",
    "pitch second mm": "pitch_second_mm",
}
FEATURE_UNITS: Mapping[str, tuple[str, float]] = {
    "UT_LENGTH_UM": ("um", 1.0),
    "UT_LENGTH_MM": ("um", 1e3),
    "UT_LENGTH_M": ("um", 1e6),
    "UT_SQUARENESS": ("um/m", 1.0),
    "UT_SERVO_MISMATCH": ("ms", 1.0),
    "UT_SCALE_ERROR": ("ppm", 1.0),
    "UT_FEEDRATE": ("mm/min", 1.0),
    "UT_ANGLE": ("deg", 1.0),
    "UT_PERCENT": ("%", 1.0),
    "UT_SPEED": ("mm/s", 1.0),
    "UT_RANKING": ("", 1.0),
}


@dataclass(frozen=True, slots=True)
class CircleColumns:
    """Which column holds what, from 1 (0: as the heading names it), units, and what no column tells.

    ``start_deg`` is where a pass begins: samples over time have no other angle, so it is demanded (nan: not stated).
    ``calibrated``: the bar's length is known.
    """

    time: int = 0
    angle: int = 0
    radius: int = 0
    nominal: int = 0
    deviation: int = 0
    x: int = 0
    y: int = 0
    sense: int = 0
    time_unit: str = ""
    angle_unit: str = ""
    reading_unit: str = ""
    radius_mm: float = 0.0
    feed_mm_min: float = 0.0
    plane: str = ""
    way: str = ""
    start_deg: float = nan
    pitch_first_mm: float = 0.0
    pitch_second_mm: float = 0.0
    calibrated: bool = False
    separator: str = ""

    def limits(self) -> Iterable[tuple[str, bool, str | Message]]:
        """See `drivers.files.declared.DeclaredFields`."""
        for role in ROLES:
            yield role, 0 <= getattr(self, role) <= 1000, Message.of("W-FILE-COLUMN")
        yield "time_unit", self.time_unit in ("", *TIMES), Message.of("W-FILE-ONE-OF", known=", ".join(TIMES))
        yield "angle_unit", TARGET_UNITS.get(self.angle_unit, ("deg", 1.0))[0] == "deg", Message.of("W-FILE-UNIT-ANGLE")
        yield (
            "reading_unit",
            READING_UNITS.get(self.reading_unit, ("mm", 1.0))[0] == "mm",
            Message.of("W-FILE-UNIT-LENGTH"),
        )
        yield "plane", self.plane.upper() in ("", *PLANES), Message.of("W-FILE-ONE-OF", known=", ".join(PLANES))
        yield "way", self.way.lower() in ("", "ccw", "cw"), Message.of("W-FILE-CCW-CW")
        for name in ("radius_mm", "feed_mm_min", "pitch_first_mm", "pitch_second_mm"):
            yield name, 0.0 <= getattr(self, name) <= 1e6, Message.of("W-FILE-ABOVE-0")
        yield "start_deg", isnan(self.start_deg) or abs(self.start_deg) <= 360.0, Message.of("W-FILE-ANGLE-DEG")
        yield "separator", len(self.separator) <= 1, Message.of("W-FILE-ONE-SIGN")


class CircleCsvFormat:
    """Circle file driver "circle-csv": a table of samples by its heading or by declared columns (`CircleColumns`)."""

    def __init__(self, codepage: str = "cp1252", columns: Mapping[str, Any] | None = None) -> None:
        self._codepage = codepage
        self._columns = declared(CircleColumns, columns or {}, "circle-csv")

    def read(self, path: Path) -> CircleRecord:
        """Read a file. Raises FileFormatError with line and reason, ConfigError (E-FILE-MAP)."""
        data = read_bytes(path)
        texts = map(plain_minus, (decode_text(data, self._codepage, str(path)), *other_texts(data)))
        every = tuple(texts)
        named = (text for text in every if _heading(_lines(text)[1], self._columns) is not None)
        return parse_circle(next(named, every[0]), self._columns, str(path))


class B5rFormat:
    """Circle file driver "b5r": the result figures of a maker's file, as its program stored them."""

    def read(self, path: Path) -> MakersFigures:
        """Read a file. Raises FileFormatError (E-FILE-XML.., E-CIRCLE-FEATURES)."""
        return parse_b5r(read_bytes(path), str(path))


def parse_b5r(data: bytes, where: str) -> MakersFigures:
    """Every FEATURE with its unit, at any depth; no DTD, no entities."""
    figures: list[MakersFigure] = []
    header: dict[str, str] = {}
    plane: list[str] = []

    def ended(element: Element, _above: list[Element]) -> None:
        text = "".join(element.text).strip()
        if element.name == "FEATURE":
            name, kind = element.attributes.get("NAME", ""), element.attributes.get("DT", "")
            value = decimal(text)
            if not name or value is None:
                raise FileFormatError(
                    "E-FILE-LINE", where, line=element.line, why=Message.of("W-FILE-FEATURE", name=name)
                )
            unit, factor = FEATURE_UNITS.get(kind, ("", 1.0))
            figures.append(MakersFigure(name=name, kind=kind, value=float(value) * factor, unit=unit))
        elif element.name == "PLANE":
            plane.append(element.attributes.get("TEST_PLANE", "").upper())
        elif element.name in ("TEST_SPEC", "MACHINE_TESTED"):
            header[element.name] = element.attributes.get("NAME", "")
        elif element.name in ("OPERATOR", "DATE_STARTED", "SERIAL_NUMBER", "LAST_CALIBRATED", "PART_NUMBER") and text:
            header[element.name] = text

    read_elements(data, ended, where)
    if not figures:
        raise FileFormatError("E-CIRCLE-FEATURES", where)
    return MakersFigures(tuple(figures), plane[-1] if plane else "", header)


@dataclass(frozen=True, slots=True)
class _Column:
    role: str
    at: int
    unit: str


def parse_circle(text: str, said: CircleColumns, where: str) -> CircleRecord:
    """A whole table, pure.

    Raises FileFormatError (E-CIRCLE-HEADING: no radius or no angle; E-CIRCLE-UNIT; E-CIRCLE-STATED: radius or feed
    is needed and not stated; E-CIRCLE-SENSE; E-CIRCLE-SIZE: deviations that no machine has; E-FILE-LINE; E-FILE-ROWS).
    """
    comments, rows = _lines(text)
    stated = _stated(comments, said, where)
    begun = _heading(rows, said)
    if begun is None:
        raise FileFormatError("E-CIRCLE-HEADING", where, found=(rows[0][1][:100] if rows else "-"))
    place, separator, columns = begun
    columns = _with_units(columns, where)
    body = rows[place:]
    kept, table, senses = _table(body, columns, separator, where)
    warnings = (*untaken([at for at, _ in body], kept), *end_doubts(text))
    values = {one.role: table[:, k] for k, one in enumerate(columns)}
    radial, angle = _radial(values, stated, where), _angle(values, stated, said, senses, where)
    if float(np.max(np.abs(radial))) > MOST_DEVIATION_UM:
        at = kept[int(np.argmax(np.abs(radial)))]
        raise FileFormatError(
            "E-CIRCLE-SIZE",
            where,
            line=at,
            found=digits(np.max(np.abs(radial)), 4),
            limit=digits(MOST_DEVIATION_UM, 6),
        )
    told = senses if senses is not None else _ways(angle, said, where)
    return CircleRecord(
        angle_deg=angle,
        radial_um=radial,
        sense=told,
        radius_mm=stated["radius_mm"] or None,
        feed_mm_min=stated["feed_mm_min"] or None,
        plane=stated["plane"],
        calibrated=said.calibrated,
        pitch_mm={key: stated[f"pitch_{key}_mm"] for key in ("first", "second") if stated[f"pitch_{key}_mm"]},
        header={"Columns": ", ".join(f"{one.role}={one.at + 1}" for one in columns)},
        warnings=warnings,
    )


def _lines(text: str) -> tuple[list[str], list[tuple[int, str]]]:
    """Comment lines, and the others with their numbers; blank ones left out."""
    lines = [(at, line) for at, line in enumerate(_BREAK.split(text), start=1) if line.strip()]
    comments = [line for _, line in lines if line.lstrip().startswith("#")]
    return comments, [(at, line) for at, line in lines if not line.lstrip().startswith("#")]


def _stated(comments: Sequence[str], said: CircleColumns, where: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for line in comments:
        key, _, value = line.lstrip("# \t").replace(";", ",").replace(":", ",").partition(",")
        name = _KEYS.get(" ".join(key.lower().replace("_", " ").split()))
        if name is None:
            continue
        number = decimal(value.strip())
        if name != "plane" and (number is None or number <= 0):
            raise FileFormatError("E-CIRCLE-STATED", where, key=name, value=value.strip()[:40])
        found[name] = value.strip().upper() if name == "plane" else float(number or 0.0)
    own: dict[str, Any] = {"radius_mm": said.radius_mm, "feed_mm_min": said.feed_mm_min, "plane": said.plane.upper()}
    own |= {"pitch_first_mm": said.pitch_first_mm, "pitch_second_mm": said.pitch_second_mm}
    for name, value in own.items():
        if value and found.get(name, value) != value:
            raise FileFormatError("E-CIRCLE-STATED", where, key=name, value=f"{found[name]} / {value}")
        found[name] = value if value else found.get(name, value)
    if found["plane"] not in ("", *PLANES):
        raise FileFormatError("E-CIRCLE-STATED", where, key="plane", value=str(found["plane"])[:40])
    return found


def _heading(rows: Sequence[tuple[int, str]], said: CircleColumns) -> tuple[int, str, list[_Column]] | None:
    """Where the rows begin, what separates cells and the columns; declared columns need no heading."""
    told = {role: getattr(said, role) - 1 for role in ROLES if getattr(said, role)}
    for place, (_at, line) in enumerate(rows[:200]):
        separator = said.separator or next((mark for mark in MARKS if mark in line), "")
        heads = cells(line, separator)
        numbers = [decimal(cell, comma=separator != "," and "," in cell) is not None for cell in heads]
        if any(numbers):
            wide = len(heads) > max(told.values(), default=0)
            if _complete(set(told)) and wide and all(numbers[at] for role, at in told.items() if role != "sense"):
                return place, separator, [_Column(role, at, _declared_unit(role, said)) for role, at in told.items()]
            continue
        found = dict(told)
        for at, head in enumerate(heads):
            role = _role(head)
            if role and role not in found and at not in found.values():
                found[role] = at
        if _complete(set(found)) and max(found.values()) < len(heads):
            columns = [
                _Column(role, at, _declared_unit(role, said) or _unit_of(heads[at], role)) for role, at in found.items()
            ]
            return place + 1, separator, columns
    return None


def _complete(roles: set[str]) -> bool:
    return {"x", "y"} <= roles or (bool({"radius", "deviation"} & roles) and bool({"angle", "time"} & roles))


def _role(head: str) -> str:
    words = head_cell(head).words.strip()
    if words in ("x", "y"):
        return words
    if words in ("radius nominal", "nominal radius"):
        return "nominal"
    if "measured" in words and "radius" in words:
        return "radius"
    return next((role for role, marks in NAMES.items() if any(mark in words for mark in marks)), "")


def _declared_unit(role: str, said: CircleColumns) -> str:
    if role in ("time", "angle"):
        return str(getattr(said, f"{role}_unit"))
    return "" if role == "sense" else said.reading_unit


def _unit_of(head: str, role: str) -> str:
    if role == "time":
        inside = re.search(r"[\[(_ ](ms|sec|min|s)[\])]?\s*$", head.strip().lower())
        return inside[1] if inside else ""
    return unit_named(head_cell(head).unit)


def _with_units(columns: Sequence[_Column], where: str) -> list[_Column]:
    """Raises FileFormatError (E-CIRCLE-UNIT)."""
    for one in columns:
        if one.role == "sense":
            continue
        known = one.unit in TIMES if one.role == "time" else bool(one.unit)
        kind = "" if one.role == "time" or not known else READING_UNITS.get(one.unit, TARGET_UNITS[one.unit])[0]
        if not known or (one.role != "time" and kind != ("deg" if one.role == "angle" else "mm")):
            raise FileFormatError("E-CIRCLE-UNIT", where, role=one.role, column=one.at + 1)
    return list(columns)


def _table(
    body: Sequence[tuple[int, str]], columns: Sequence[_Column], separator: str, where: str
) -> tuple[list[int], FloatArray, FloatArray | None]:
    """Lines kept, values (n, columns) in s, deg and mm, and the sense of each where a column tells it."""
    needed = max(one.at for one in columns) + 1
    numbers = [one for one in columns if one.role != "sense"]
    way = next((one for one in columns if one.role == "sense"), None)
    kept, found, senses = [], [], []
    if len(body) > MOST:
        raise FileFormatError("E-FILE-SIZE", where, targets=len(body), repetitions=1, limit=MOST)
    for at, line in body:
        row = cells(line, separator)
        if len(row) < needed:
            raise FileFormatError(
                "E-FILE-LINE", where, line=at, why=Message.of("W-FILE-COLUMNS-NEEDED", count=len(row), needed=needed)
            )
        texts = [row[one.at].strip() for one in numbers]
        if any(missing(text) for text in texts):
            continue
        values = [decimal(text, comma=separator != "," and "," in text) for text in texts]
        bad = next((text for text, value in zip(texts, values, strict=True) if value is None), None)
        if bad is not None:
            raise FileFormatError("E-FILE-LINE", where, line=at, why=Message.of("W-FILE-NO-NUMBER", bad=bad[:40]))
        if way is not None:
            sense = SENSES.get(row[way.at].strip().lower())
            if sense is None:
                raise FileFormatError("E-CIRCLE-SENSE", where, line=at, found=row[way.at][:40])
            senses.append(sense)
        kept.append(at)
        found.append(
            [float(value) * _scale(one) for one, value in zip(numbers, values, strict=True) if value is not None]
        )
    if len(found) < FEWEST:
        raise FileFormatError("E-FILE-ROWS", where)
    table = np.asarray(found, dtype=np.float64)
    if way is not None:
        at = columns.index(way)
        table = np.insert(table, at, senses, axis=1)
    return kept, table, np.asarray(senses, dtype=np.float64) if way is not None else None


def _scale(one: _Column) -> float:
    if one.role == "time":
        return TIMES[one.unit]
    return TARGET_UNITS[one.unit][1]


def _needed(stated: Mapping[str, Any], key: str, where: str) -> float:
    if not stated[key]:
        raise FileFormatError("E-CIRCLE-STATED", where, key=key, value="-")
    return float(stated[key])


def _radial(values: Mapping[str, FloatArray], stated: Mapping[str, Any], where: str) -> FloatArray:
    """Outward deviation (n,) in um."""
    if "deviation" in values:
        return np.asarray(mm_to_um(values["deviation"]))
    read = values["radius"] if "radius" in values else np.hypot(values["x"], values["y"])
    nominal = values["nominal"] if "nominal" in values else _needed(stated, "radius_mm", where)
    return np.asarray(mm_to_um(read - nominal))


def _angle(
    values: Mapping[str, FloatArray],
    stated: Mapping[str, Any],
    said: CircleColumns,
    senses: FloatArray | None,
    where: str,
) -> FloatArray:
    """Commanded angle (n,) in deg."""
    if "angle" in values:
        return values["angle"]
    if "x" in values:
        return np.asarray(np.rad2deg(np.arctan2(values["y"], values["x"])))
    way = (
        senses
        if senses is not None
        else np.full(values["time"].size, {"ccw": 1.0, "cw": -1.0}.get(said.way.lower(), 0.0))
    )
    if not way.all():
        raise FileFormatError("E-CIRCLE-SENSE", where, line=1, found="-")
    speed = _needed(stated, "feed_mm_min", where) / 60.0 / _needed(stated, "radius_mm", where)
    if isnan(said.start_deg):
        # A wrong start turns scale into squareness: it is never taken as 0.
        raise FileFormatError("E-CIRCLE-STATED", where, key="start_deg", value="-")
    time, found = values["time"], np.empty(values["time"].size)
    for own in (1.0, -1.0):
        mine = way == own
        if mine.any():
            found[mine] = said.start_deg + own * np.rad2deg(speed * (time[mine] - time[mine][0]))
    return found


def _ways(angle: FloatArray, said: CircleColumns, where: str) -> FloatArray:
    """Sense (n,) by the way the angles go, a step across 360 deg as the short way; as declared for one pass."""
    if said.way:
        return np.full(angle.size, 1.0 if said.way.lower() == "ccw" else -1.0)
    step = (np.diff(angle) + 180.0) % 360.0 - 180.0
    step = np.append(step, step[-1])
    ways = np.sign(step)
    for at in range(1, ways.size):
        ways[at] = ways[at] or ways[at - 1]
    turns = int(np.count_nonzero(np.diff(ways)))
    if not ways.all() or turns > max(4, angle.size // 50):
        raise FileFormatError("E-CIRCLE-SENSE", where, line=1, found="-")
    return np.asarray(ways)
