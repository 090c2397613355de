"""Records of a reducer's test bench as tables: input and output angle, torque, temperature, time; units in headings.

Comment lines (``# Pins,40``) before the heading state the reducer. A heading is a name with its unit: ``output_deg``,
``Output angle [arcsec]``, ``Drehmoment (Nm)``. What it leaves open is declared: a column by its number from 1, its
unit. No unit is supposed. Lines in which a reading is missing are left out and told; a number that no bench reads (a
counter's 9999999) is refused with its line.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import FileFormatError
from drivers.files.declared import declared
from drivers.files.numbers import decimal, missing, untaken
from drivers.files.tables.sheet import cells
from drivers.files.text import end_doubts, plain_minus, read_bytes
from drivers.local.textfile import decode_text
from drivers.message import Message, digits
from drivers.types.drives import STATEMENTS, DriveRecord
from drivers.types.values import FloatArray
from drivers.units import KELVIN_OFFSET, TARGET_UNITS, unit_named

ROLES = ("time", "input", "output", "torque", "temperature")
NAMES: Mapping[str, tuple[str, ...]] = {
    "time": ("time", "zeit", "时间"),
    "input": ("input", "antrieb", "eingang", "motor", "输入"),
    "output": ("output", "abtrieb", "ausgang", "输出"),
    "torque": ("torque", "moment", "扭矩", "转矩"),
    "temperature": ("temp", "温度"),
}
TIMES = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0}
TORQUES = {"nm": 1.0, "n m": 1.0, "n*m": 1.0, "n·m": 1.0, "knm": 1e3, "nmm": 1e-3, "mnm": 1e-3}
DEGREES = {"degc": 0.0, "°c": 0.0, "c": 0.0, "celsius": 0.0, "k": -KELVIN_OFFSET, "kelvin": -KELVIN_OFFSET}
LARGEST = {"time": 1e9, "input": 1e8, "output": 1e6, "torque": 1e6, "temperature": 300.0}
"""In s, deg, Nm, degC: beyond it a number is a mark of the recorder, not a reading."""
MOST_ROWS = 2_000_000
FEWEST_ROWS = 8
WRAPS_DEG = 360.0
_BREAK = re.compile(r"\r\n|\n|\r")
_UNIT = re.compile(r"^(?P<name>.*?)\s*(?:\[(?P<a>[^\]]*)\]|\((?P<b>[^)]*)\))\s*$")


@dataclass(frozen=True, slots=True)
class DriveColumns:
    """Which column holds what, from 1 (0: as the heading names it), and units that the heading lacks."""

    time: int = 0
    input: int = 0
    output: int = 0
    torque: int = 0
    temperature: int = 0
    time_unit: str = ""
    input_unit: str = ""
    output_unit: str = ""
    torque_unit: str = ""
    temperature_unit: str = ""
    skip: int = 0
    separator: str = ""

    def limits(self) -> Iterable[tuple[str, bool, str | Message]]:
        """See `drivers.files.declared.DeclaredFields`."""
        for role in ROLES:
            unit = getattr(self, f"{role}_unit")
            yield role, 0 <= getattr(self, role) <= 1000, Message.of("W-FILE-COLUMN")
            yield f"{role}_unit", not unit or _scale(role, unit) is not None, Message.of("W-FILE-NO-UNIT", unit=unit)
        yield "skip", 0 <= self.skip <= 10_000, Message.of("W-FILE-0-10000")
        yield "separator", len(self.separator) <= 1, Message.of("W-FILE-ONE-SIGN")


class DriveCsvFormat:
    """Drive file driver "drive-csv": a table of the test bench by its heading or declared columns (`DriveColumns`)."""

    def __init__(self, codepage: str = "cp1252", columns: Mapping[str, Any] | None = None) -> None:
        self._codepage = codepage
        self._columns = declared(DriveColumns, columns or {}, "drive-csv")

    def read(self, path: Path) -> DriveRecord:
        """Read a file. Raises FileFormatError with line and reason, ConfigError (E-FILE-MAP)."""
        text = plain_minus(decode_text(read_bytes(path), self._codepage, str(path)))
        return parse_drive(text, self._columns, str(path))


@dataclass(frozen=True, slots=True)
class _Column:
    """One column that is read: its role, number from 0 and unit."""

    role: str
    at: int
    heading: str
    unit: str


def parse_drive(text: str, said: DriveColumns, where: str) -> DriveRecord:
    """A whole table, pure.

    Raises FileFormatError (E-DRIVE-HEADING: no column of the input's or the output's angle; E-DRIVE-UNIT; E-DRIVE-TIME:
    time goes back; E-DRIVE-STATED; E-FILE-LINE with the line; E-FILE-ROWS; E-FILE-SIZE).
    """
    lines = [(at, line) for at, line in enumerate(_BREAK.split(text), start=1) if line.strip()]
    header = dict(_comment(line) for _, line in lines if line.lstrip().startswith("#"))
    rows = [(at, line) for at, line in lines if not line.lstrip().startswith("#")][said.skip :]
    if not rows:
        raise FileFormatError("E-FILE-ROWS", where)
    if len(rows) > MOST_ROWS:
        raise FileFormatError("E-FILE-SIZE", where, targets=len(rows), repetitions=1, limit=MOST_ROWS)
    separator = said.separator or _separator(rows[0][1])
    heads = cells(rows[0][1], separator)
    headed = not any(decimal(cell, comma=separator != ",") is not None for cell in heads)
    columns = _columns(heads if headed else [""] * len(heads), said, where)
    read = {one.role: one for one in columns}
    body = rows[1:] if headed else rows
    kept, table = _table(body, columns, separator, where)
    values = {one.role: _scaled(table[:, k], one) for k, one in enumerate(columns)}
    _check(values, kept, where)
    notes: list[Message] = []
    for role, code in (("input", "S-DRIVE-TURNED-INPUT"), ("output", "S-DRIVE-TURNED-OUTPUT")):
        values[role], turned = _counted_on(values[role])
        notes += [Message.of(code, turned=turned)] if turned else []
    notes += untaken([at for at, _ in body], kept)
    stated = {name: _stated(header, name, where) for name, one in STATEMENTS.items() if one.key in header}
    units = {f"Unit of {role}": one.unit for role, one in read.items()}
    return DriveRecord(
        input_deg=values["input"],
        output_deg=values["output"],
        lines=np.asarray(kept, dtype=np.float64),
        time_s=values.get("time"),
        torque_nm=values.get("torque"),
        temperature_degc=values.get("temperature"),
        stated=stated,
        header={**header, **units},
        warnings=(*notes, *end_doubts(text)),
    )


def _comment(line: str) -> tuple[str, str]:
    key, _, value = line.lstrip("# \t").replace(";", ",").replace("\t", ",").partition(",")
    return key.strip(), value.strip().lstrip("'")


def _stated(header: Mapping[str, str], name: str, where: str) -> float:
    one = STATEMENTS[name]
    value = decimal(header[one.key])
    if value is None or (one.whole and value != int(value)):
        raise FileFormatError("E-DRIVE-STATED", where, key=one.key, value=header[one.key][:40])
    return value


def _separator(line: str) -> str:
    return next((mark for mark in ("\t", ";") if mark in line), ",")


def _columns(heads: Sequence[str], said: DriveColumns, where: str) -> list[_Column]:
    """The columns that are read, by declaration before heading; a role that two headings name is the first one's."""
    found = []
    for role in ROLES:
        at = getattr(said, role) - 1
        if at < 0:
            at = next((k for k, head in enumerate(heads) if _role(head) == role), -1)
        if at < 0:
            continue
        if at >= len(heads):
            raise FileFormatError(
                "E-FILE-LINE",
                where,
                line=1,
                why=Message.of("W-FILE-ROLE-COLUMN", count=len(heads), role=role, column=at + 1),
            )
        unit = getattr(said, f"{role}_unit") or _unit(heads[at])
        if _scale(role, unit) is None:
            raise FileFormatError("E-DRIVE-UNIT", where, role=role, column=at + 1, heading=heads[at][:60] or "(none)")
        found.append(_Column(role, at, heads[at], unit))
    roles = {one.role for one in found}
    if not {"input", "output"} <= roles:
        lacking = ", ".join(sorted({"input", "output"} - roles))
        raise FileFormatError("E-DRIVE-HEADING", where, lacking=lacking, found=", ".join(heads)[:120])
    return found


def _role(head: str) -> str:
    """The role that a heading names first: an input torque is none that is read."""
    plain = head.lower()
    torque = any(mark in plain for mark in NAMES["torque"])
    if torque and any(mark in plain for mark in NAMES["input"]):
        return ""
    order = ("torque", "temperature", "input", "output", "time")
    return next((role for role in order if any(mark in plain for mark in NAMES[role])), "")


def _unit(head: str) -> str:
    """The unit in a heading: in brackets, or the last word after a blank or an underscore."""
    inside = _UNIT.match(head.strip())
    if inside is not None:
        return (inside["a"] or inside["b"] or "").strip()
    words = re.split(r"[\s_]+", head.strip())
    return words[-1] if len(words) > 1 else ""


def _scale(role: str, unit: str) -> tuple[float, float] | None:
    """Factor and offset to s, deg, Nm or degC; None for what is no unit of the role."""
    plain = unit.strip().lower()
    if role in ("input", "output"):
        kind, factor = TARGET_UNITS.get(unit_named(unit), ("", 0.0))
        return (factor, 0.0) if kind == "deg" else None
    if role == "temperature":
        return (1.0, DEGREES[plain]) if plain in DEGREES else None
    scale = (TIMES if role == "time" else TORQUES).get(plain)
    return (scale, 0.0) if scale is not None else None


def _table(
    body: Sequence[tuple[int, str]], columns: Sequence[_Column], separator: str, where: str
) -> tuple[list[int], FloatArray]:
    """Lines that hold every reading and these (n, columns)."""
    needed = max(one.at for one in columns) + 1
    kept, found = [], []
    for at, line in body:
        row = cells(line, separator)
        if len(row) < needed:
            raise FileFormatError(
                "E-FILE-LINE", where, line=at, why=Message.of("W-FILE-COLUMNS-NEEDED", count=len(row), needed=needed)
            )
        texts = [row[one.at].strip() for one in columns]
        if any(missing(text) for text in texts):
            continue
        numbers = [decimal(text, comma=separator != "," and "," in text) for text in texts]
        bad = next((text for text, number in zip(texts, numbers, strict=True) if number is None), None)
        if bad is not None:
            raise FileFormatError("E-FILE-LINE", where, line=at, why=Message.of("W-FILE-NO-NUMBER", bad=bad[:40]))
        kept.append(at)
        found.append(numbers)
    if len(found) < FEWEST_ROWS:
        raise FileFormatError("E-FILE-ROWS", where)
    return kept, np.asarray(found, dtype=np.float64)


def _scaled(values: FloatArray, column: _Column) -> FloatArray:
    factor, offset = _scale(column.role, column.unit) or (1.0, 0.0)
    return np.asarray(values * factor + offset)


def _check(values: Mapping[str, FloatArray], lines: Sequence[int], where: str) -> None:
    for role, one in values.items():
        far = np.flatnonzero(~(np.abs(one) <= LARGEST[role]))
        if far.size:
            why = Message.of("W-FILE-NO-READING-OF", one=one[far[0]], role=role)
            raise FileFormatError("E-FILE-LINE", where, line=lines[int(far[0])], why=why)
    if "time" in values:
        back = np.flatnonzero(np.diff(values["time"]) <= 0.0)
        if back.size:
            at = int(back[0])
            first, second = values["time"][at], values["time"][at + 1]
            raise FileFormatError(
                "E-DRIVE-TIME", where, line=lines[at + 1], before=digits(first, 6), after=digits(second, 6)
            )


def _counted_on(angle: FloatArray) -> tuple[FloatArray, int]:
    """An angle that starts again at each turn, continued, and how often it started again."""
    jumps = np.abs(np.diff(angle)) > 0.5 * WRAPS_DEG
    within = float(angle.max() - angle.min()) <= WRAPS_DEG
    if not (within and jumps.any()) or np.count_nonzero(jumps) > 0.25 * len(angle):
        return angle, 0
    return np.asarray(np.unwrap(angle, period=WRAPS_DEG)), int(np.count_nonzero(jumps))


DECLARED = tuple(item.name for item in fields(DriveColumns))
"""Every word that declares something of a drive's table."""
