"""HEIDENHAIN axis error tables (.COM): positions, a column for each dependent axis, values of the negative direction.

Described in the technical manuals of MANUALplus 620 (p. 716-718: ``BEGIN AXIS_X.COM MM``, heading ``NR AXISPOS
BACKLASH`` and a column for each axis, ``[END]``) and of TNC 407 and iTNC 530 (``DATUM:`` and ``DISTANCE:`` in the
first line). Lengths are mm, positions count from the machine datum; BACKLASH holds the values of the negative
direction. No public text states whether a value is the error or its correction, so that is asked: form "error" or
"correction".

A table does not name the axis whose positions it holds; its own name usually does (AXIS_X, XCORR), else it is declared:
``--column input=X``. The value that stands in the input axis' own column is its positioning error, in another axis'
column that axis' deviation. A datum that is not zero must be the first position: else it is open what positions count
from. Which tables act is settled by a second file (.CMA), which holds no values.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from drivers.errors import FileFormatError, TableError
from drivers.exchange.lines import curves_of, directed, letter_of, number, one_axis, own_table, rising, shown_line
from drivers.message import digits
from drivers.types.exchange import ReadAs
from drivers.types.tables import CompensationTable
from drivers.types.values import FloatArray
from drivers.units import MM_PER_INCH, AxisUnit, deviation_scale

MOST_ROWS = 256
EVEN = 2e-4  # of the positions, where a file states their distance with four decimals
_BEGIN = re.compile(
    r"BEGIN\s+(?P<name>[\w-]{1,32})\s*\.(?P<kind>COM|CMA)\b\s*(?P<unit>MM|INCH)?"
    r"(?:\s*DATUM:\s*(?P<datum>[+-]?[\d.]+))?(?:\s*DISTANCE:\s*(?P<step>[+-]?[\d.]+))?\s*\Z",
    re.ASCII | re.IGNORECASE,
)
_NAMED = re.compile(r"(?:AXIS[-_]?([XYZABCUVW])|([XYZABCUVW])[-_]?CORR)[-_]?\Z", re.IGNORECASE)
LETTERS = "XYZABCUVW"
_AXIS = re.compile(rf"[{LETTERS}]\Z")
BACKLASH = "BACKLASH"


@dataclass(frozen=True, slots=True)
class _Head:
    """The first line: table's name, length of its unit in mm, datum, distance of positions (0: not stated)."""

    name: str
    scale: float
    datum: float
    step: float


class HeidenhainCom:
    """Axis error tables (implements ports.TableExchange); form "error" or "correction": what a positive value is."""

    suffix = ".com"
    forms = ("", "error", "correction")

    def text(self, tables: Sequence[CompensationTable], form: str, comments: Sequence[str]) -> str:
        """The table of one axis, mm or deg. The format has no comment lines, so ``comments`` are left out.

        Raises TableError (E-EXCHANGE-ONE, E-EXCHANGE-LETTER, E-EXCHANGE-ROWS), FileFormatError (E-EXCHANGE-SIGN).
        """
        del comments
        table = one_axis(tables, "heidenhain")
        at, *curves = curves_of(table)
        if at.size > MOST_ROWS:
            raise TableError("E-EXCHANGE-ROWS", "heidenhain", rows=at.size, limit=MOST_ROWS)
        scale = deviation_scale(table.output_unit)
        forward, reverse = (directed(one / scale, form, "heidenhain", "HEIDENHAIN .COM") for one in curves)
        axis = letter_of(table, "heidenhain", LETTERS)
        lines = [f"BEGIN AXIS_{axis}.COM MM", f"NR   AXISPOS       BACKLASH     {axis}"]
        lines += [
            f"{row:<4d} {place:<+13.4f} {back:<+12.5f} {value:+.5f}"
            for row, (place, back, value) in enumerate(zip(at, reverse, forward, strict=True))
        ]
        return "\n".join([*lines, "[END]"]) + "\n"

    def read(self, text: str, where: str, known: ReadAs) -> tuple[CompensationTable, ...]:
        """The own table of ``known.axis``, or its cross table over the input axis.

        Raises FileFormatError (E-EXCHANGE-...; -SIGN and -DECLARE: what to say).
        """
        head, columns, rows = _parsed(text, where)
        own = _input_axis(head, known, where)
        table = np.asarray(rows, dtype=np.float64)
        at = table[:, 1] * (head.scale if _unit(own) == "mm" else 1.0)
        rising(at, where)
        _check_places(at, head, where)
        if not known.axis or known.axis not in columns:
            listed = ", ".join(one for one in columns if _AXIS.match(one))
            raise FileFormatError("E-EXCHANGE-AXIS", where, axis=known.axis or "-", known=listed)
        scale = deviation_scale(known.unit) * (head.scale if known.unit == "mm" else 1.0)
        read = {name: table[:, place] * scale for place, name in enumerate(columns)}
        forward = directed(read[known.axis], known.form, where, "HEIDENHAIN .COM")
        if own != known.axis:
            return (_cross(own, known, at, forward),)
        back = directed(read.get(BACKLASH, read[known.axis]), known.form, where, "HEIDENHAIN .COM")
        return (own_table(known, at, np.round(forward, 6), np.round(back, 6)),)


def _unit(letter: str) -> AxisUnit:
    return "deg" if letter in "ABC" else "mm"


def _cross(own: str, known: ReadAs, at: FloatArray, values: FloatArray) -> CompensationTable:
    return CompensationTable(
        kind="cross",
        input_axis=own,
        output_axis=known.axis,
        minimum=float(at[0]),
        maximum=float(at[-1]),
        step=0.0,
        deviations=tuple(float(value) for value in np.round(values, 6)),
        input_unit=_unit(own),
        output_unit=known.unit,
        places=tuple(float(value) for value in at),
    )


def _input_axis(head: _Head, known: ReadAs, where: str) -> str:
    """The axis whose positions the table holds, by its name or as declared. Raises FileFormatError."""
    said = str(known.declared.get("input", "")).strip().upper()
    named = _NAMED.match(head.name)
    found = (named[1] or named[2]).upper() if named else ""
    if said and not _AXIS.match(said):
        raise FileFormatError("E-EXCHANGE-DECLARE", where, missing="input", example="--column input=X")
    if not (said or found):
        raise FileFormatError("E-EXCHANGE-DECLARE", where, missing="input", example="--column input=X")
    return said or found


def _check_places(at: FloatArray, head: _Head, where: str) -> None:
    """Raises FileFormatError (E-EXCHANGE-STEP) where distance or datum of the first line contradict the positions."""
    apart = next((b - a for a, b in pairwise(at) if head.step and abs(b - a - head.step) > EVEN), None)
    if apart is not None:
        raise FileFormatError("E-EXCHANGE-STEP", where, stated=digits(head.step, 6), found=digits(apart, 6))
    if head.datum and abs(head.datum * head.scale - at[0]) > EVEN:
        raise FileFormatError("E-EXCHANGE-STEP", where, stated=digits(head.datum, 6), found=digits(at[0], 6))


def _parsed(text: str, where: str) -> tuple[_Head, list[str], list[list[float]]]:
    lines = [(line, told.strip()) for line, told in enumerate(text.splitlines(), 1) if told.strip(" \t\0\x1a")]
    first = _BEGIN.match(lines[0][1]) if lines else None
    if first is None or first["kind"].upper() != "COM":
        line, told = lines[0] if lines else (1, "")
        raise FileFormatError("E-EXCHANGE-KEY", where, line=line, found=shown_line(told))
    scale = MM_PER_INCH if (first["unit"] or "").upper() == "INCH" else 1.0
    datum, step = (number(first[key] or "0", where, lines[0][0]) for key in ("datum", "step"))
    head = _Head(first["name"], scale, datum, abs(step) * scale)
    columns = lines[1][1].upper().split() if len(lines) > 1 else []
    axes = [one for one in columns if _AXIS.match(one)]
    shaped = len(columns) >= 3 and columns[0] == "NR" and set(columns[2:]) <= {BACKLASH, *axes}
    if not shaped or len(set(columns)) != len(columns) or columns[1] in axes:
        told = lines[1][1] if len(lines) > 1 else ""
        raise FileFormatError("E-EXCHANGE-HEADER", where, line=lines[min(1, len(lines) - 1)][0], found=shown_line(told))
    rows: list[list[float]] = []
    for line, told in lines[2:]:
        if told.upper() == "[END]":
            break
        words = told.split()
        if len(words) != len(columns):
            raise FileFormatError("E-EXCHANGE-WIDTH", where, line=line, found=len(words), width=len(columns))
        rows.append([number(word, where, line) for word in words])
        if rows[-1][0] != len(rows) - 1:
            raise FileFormatError("E-EXCHANGE-GAP", where, place=len(rows) - 1, key="NR")
    else:
        raise FileFormatError("E-EXCHANGE-OPEN", where, name=head.name)
    if not 2 <= len(rows) <= MOST_ROWS:
        raise FileFormatError("E-EXCHANGE-COUNT", where, rows=len(rows), least=2, most=MOST_ROWS)
    return head, columns, rows
