"""Numbers as files print them: plain decimals, a comma only where no point occurs at all; and room for them.

A short file may claim a huge grid: it is refused before it gets one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NoReturn

import numpy as np

from drivers.errors import FileFormatError
from drivers.message import Message
from drivers.types.values import FloatArray

MOST_READINGS = 4_000_000
LONGEST_FIXED = 18
MOST_TOLD = 8
NO_NUMBER_WORDS = (
    "nan, n/a, na, n.a., #n/a, #nv, #num!, #value!, #wert!, #div/0!, #ref!, #bezug!, null, none, nil, out of "
    "range, outofrange, out-of-range, oor, over, overrange, over range, overflow, over flow, ovl, ovr, ovld, "
    "o.l., ol, ofl, under, underrange, under range, underflow, no reading, no signal, no data, nodata, no value, "
    "no beam, beam lost, beam broken, beam interrupted, beam obstructed, signal lost, lost, invalid, error, err, "
    "err., fail, failed, missing, timeout, not measured, skipped, no target, außerhalb, außer bereich, "
    "ausserhalb, ausser bereich, bereich überschritten, messbereich überschritten, überlauf, kein wert, kein "
    "signal, keine messung, ungültig, fehlt, fehler, hors plage, hors gamme, hors limite, pas de mesure, fuori "
    "scala, fuori campo, fuera de rango, sin señal, 超量程, 超出范围, 超范围, 溢出, 无, 无效, 无信号, 无数据, 缺失, "
    "вне диапазона, нет "
    "данных"
)
NO_NUMBER = frozenset({"", *NO_NUMBER_WORDS.split(", ")})
# Of a target in mm or deg, of a deviation in um or arcsec: a kilometre that the axis is off is no measurement.
FARTHEST = 1e9
_DECIMAL = re.compile(r"[+-]?(?:\d{1,18}(?:\.\d{0,30})?|\.\d{1,30})(?:[eE][+-]?\d{1,2})?\Z", re.ASCII)
_WHOLE = re.compile(r"[0-9]{1,9}(\.0*)?\Z")


def decimal(token: str, *, comma: bool = False) -> float | None:
    """The number, or None where the token is none; with `comma` a comma stands for the point."""
    if comma:
        token = token.replace(",", ".") if token.count(",") <= 1 and "." not in token else ""
    return float(token) if _DECIMAL.match(token) else None


def missing(token: str) -> bool:
    """Whether a cell says that there is no reading: empty, dashes, or what counters and spreadsheets write instead."""
    plain = " ".join(token.strip("-–—*?./<>!# \t").lower().replace("_", " ").replace("-", " ").split())
    return plain in NO_NUMBER or token.strip().lower() in NO_NUMBER


def untaken(lines: Iterable[int], read: Iterable[int]) -> tuple[Message, ...]:
    """A note of lines that hold no reading at all: where all of a target's do, the result has no such target."""
    known = set(read)
    left = [str(line) for line in lines if line not in known]
    more, named = len(left) - MOST_TOLD, tuple(left[:MOST_TOLD])
    if more > 0:
        return (Message.of("S-FILE-UNTAKEN-MORE", lines=named, more=more),)
    return (Message.of("S-FILE-UNTAKEN", lines=named),) if left else ()


def whole(token: str) -> int | None:
    """The whole number from 0, or None; workbooks write 1.0 for 1."""
    return int(token.partition(".")[0]) if _WHOLE.match(token) else None


def uses_comma(tokens: str) -> bool:
    """True where these numbers are written with a decimal comma: commas occur and points do not."""
    return "," in tokens and "." not in tokens


# ---------------------------------------------------------------------------------- decimal marks and thousands

_BLANKS = " \N{NO-BREAK SPACE}\N{NARROW NO-BREAK SPACE}\N{THIN SPACE}\N{FIGURE SPACE}"
_APOSTROPHES = "'\N{RIGHT SINGLE QUOTATION MARK}"
_GROUPS = re.compile(
    rf"[+-]?[1-9]\d{{0,2}}(?P<by>[{_BLANKS}{_APOSTROPHES}])\d{{3}}(?:(?P=by)\d{{3}})*(?:[.,]\d*)?\Z",
    re.ASCII,
)
_THOUSANDS = {mark: re.compile(rf"[+-]?[1-9]\d{{0,2}}(?:[{mark}]\d{{3}})+\Z", re.ASCII) for mark in ".,"}
_BOTH = {
    mark: re.compile(rf"[+-]?[1-9]\d{{0,2}}(?:[{other}]\d{{3}})+[{mark}]\d*\Z", re.ASCII)
    for mark, other in (".,", ",.")
}
_LIKE = re.compile(r"[+-]?[\d.,]*\d[\d.,]*(?:[eE][+-]?\d{1,2})?\Z", re.ASCII)
_PLAIN = re.compile(r"[+-]?0*[1-9]\d*\Z", re.ASCII)


def ungrouped(token: str) -> str:
    """A number without the blanks or apostrophes between its thousands; any other text as it is."""
    found = _GROUPS.match(token)
    return token.replace(found["by"], "") if found else token


def like_number(token: str) -> bool:
    """Whether a cell is a number in any spelling: with either decimal mark, with thousands or without."""
    return _LIKE.match(ungrouped(token)) is not None


def spelled(token: str, mark: str) -> str | None:
    """The number with a plain decimal point where ``mark`` is its decimal mark, None where its marks do not fit.

    Text that is no number stays as it is.
    """
    if not like_number(token):
        return token
    plain = ungrouped(token)
    other = "," if mark == "." else "."
    if other in plain:
        if not (_THOUSANDS[other].match(plain) or _BOTH[mark].match(plain)):
            return None
        plain = plain.replace(other, "")
    return plain.replace(mark, ".") if plain.count(mark) <= 1 else None


def decimal_mark(columns: Iterable[Iterable[tuple[int, str]]], where: str, *, quoted: bool = False) -> str:
    """ "." or ",": the one decimal mark of a table, by what its cells (line, text) leave no doubt of.

    A mark that is no mark of thousands (0,5 or 12.75) is a decimal mark; then the other one separates thousands. Where
    no cell decides, 1,000 beside 200 in one column may be either. ``quoted``: commas separate the cells, so that one in
    a number stands in quotes. Raises FileFormatError (E-FILE-CSV-MARKS) with the line of a number that contradicts.
    """
    proof: dict[str, tuple[int, str]] = {}
    open_ones: dict[str, tuple[int, str]] = {}
    plain_beside: tuple[int, str] | None = None
    for column in columns:
        cells = [(line, ungrouped(cell), cell) for line, cell in column if like_number(cell)]
        neutral = False
        for line, cell, written in cells:
            said = _mark_of(cell, grouped=cell != written)
            if said in (".", ","):
                proof.setdefault(said, (line, written))
            elif said:
                neutral = True
                open_ones.setdefault(said[0], (line, written))
        if neutral:
            plain_beside = plain_beside or next(((at, cell) for at, cell, _ in cells if _PLAIN.match(cell)), None)
    if len(proof) > 1 or (not proof and len(open_ones) > 1):
        return _marks_differ(proof if len(proof) > 1 else open_ones, where)
    if proof:
        return next(iter(proof))
    for mark, one in open_ones.items():
        if plain_beside is not None or (quoted and mark == ","):
            raise _marks(where, (one, plain_beside or one))
        return mark
    return "."


def mark_of(cell: str) -> str:
    """The decimal mark that a cell proves by itself, as `_mark_of`; its thousands may stand apart."""
    plain = ungrouped(cell)
    return _mark_of(plain, grouped=plain != cell)


def _mark_of(cell: str, *, grouped: bool) -> str:
    """The decimal mark that a number proves; "mark?" for one that may stand for thousands; "" without any mark."""
    mantissa = re.split("[eE]", cell)[0]
    marks = [mark for mark in ".," if mark in mantissa]
    if not marks:
        return ""
    if len(marks) > 1:
        return next((mark for mark in ".," if _BOTH[mark].match(mantissa)), "")
    (mark,) = marks
    if grouped or mantissa != cell or not _THOUSANDS[mark].match(mantissa):
        return mark if mantissa.count(mark) == 1 else ""
    return ("," if mark == "." else ".") if mantissa.count(mark) > 1 else f"{mark}?"


def _marks_differ(found: dict[str, tuple[int, str]], where: str) -> NoReturn:
    raise _marks(where, (found["."], found[","]))


def _marks(where: str, two: tuple[tuple[int, str], tuple[int, str]]) -> FileFormatError:
    (first, one), (second, other) = two
    return FileFormatError("E-FILE-CSV-MARKS", where, line=max(first, second), one=one, other=other)


def fixed(value: float) -> str:
    """Six decimals as capture programs print them, or as many as it takes to give the same double back."""
    text = f"{value:.6f}"
    return text if float(text) == value and len(text) < LONGEST_FIXED else repr(value)


def no_readings(targets: int, repetitions: int, where: str) -> FloatArray:
    """Room for readings of both directions, all NaN, shape (targets, repetitions, 2).

    Raises FileFormatError (E-FILE-SIZE) where the file asks for more than any measurement has.
    """
    if 2 * targets * repetitions > MOST_READINGS:
        raise FileFormatError("E-FILE-SIZE", where, targets=targets, repetitions=repetitions, limit=MOST_READINGS)
    return np.full((targets, repetitions, 2), np.nan)


UNIT_LINES = (
    *("stated unit", "units", "unit system", "unit of measure", "measurement unit", "measurement units", "einheit"),
    *("einheiten", "maßeinheit", "unité", "unités", "unidad", "unidades", "unità", "单位", "единицы"),
)
"""What result files call the line that states a unit."""
