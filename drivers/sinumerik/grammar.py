"""Text of the control -> assignments with their line numbers: the one reader of table and back-up files.

Grammar: SINUMERIK Function Manual Extended Functions 03/2013, K3, p. 242 (EEC) and FM 802D sl 11/2012,
p. 222 (CEC), tolerant where published samples differ: header and CHANDATA line optional, blanks, block
numbers, comments, line check sums, order of values and parameters. What is not an assignment is refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from typing import Literal

from drivers.errors import FileFormatError

Shape = Literal["value", "integer", "flag", "axis"]

DECIMALS = 10  # the control prints REAL with about ten decimals: finer digits do not survive it
LARGEST = Decimal(100000)
_LINE_LIMIT = 512
_HEADER = re.compile(r"%_N_\w+")
_CHANNEL = re.compile(r"CHANDATA\s*\(\s*\d{1,2}\s*\)", re.IGNORECASE)
_CHECK_SUM = re.compile(r"'[0-9A-Fa-f]{4}\s*$")
_BLOCK_NUMBER = re.compile(r"N\d{1,9}(?=[\s$])\s*", re.IGNORECASE)
_VARIABLE = re.compile(r"(?P<name>\$[A-Z]{2}_\w+)\s*\[(?P<inside>[^\]]*)\]\s*(?P<rest>.*)", re.IGNORECASE)
_NUMBER = re.compile(r"(?P<mantissa>[+-]?(?:\d+\.?\d*|\.\d+))(?:EX(?P<power>[+-]?\d{1,2}))?", re.IGNORECASE)
_AXIS = re.compile(r"\(\s*(?P<a>\w+)\s*\)|\"(?P<b>\w+)\"|(?P<c>[A-Za-z]\w*)")
_INDEX = re.compile(r"\d{1,6}|[A-Za-z]\w{0,31}")
_END = frozenset({"M17", "M30", "M2", "M02", "RET"})
_STOPS = frozenset({"M0", "M00", "NEWCONF", "STOPRE"})

# Each variable: the shapes of its indices ("n" number, "a" axis) and of its value.
VARIABLES: dict[str, tuple[str, Shape]] = {
    "$AA_ENC_COMP": ("nna", "value"),
    "$AA_ENC_COMP_STEP": ("na", "value"),
    "$AA_ENC_COMP_MIN": ("na", "value"),
    "$AA_ENC_COMP_MAX": ("na", "value"),
    "$AA_ENC_COMP_IS_MODULO": ("na", "flag"),
    "$AN_CEC": ("nn", "value"),
    "$AN_CEC_INPUT_AXIS": ("n", "axis"),
    "$AN_CEC_OUTPUT_AXIS": ("n", "axis"),
    "$AN_CEC_INPUT_NCU": ("n", "integer"),
    "$AN_CEC_OUTPUT_NCU": ("n", "integer"),
    "$AN_CEC_STEP": ("n", "value"),
    "$AN_CEC_MIN": ("n", "value"),
    "$AN_CEC_MAX": ("n", "value"),
    "$AN_CEC_DIRECTION": ("n", "integer"),
    "$AN_CEC_MULT_BY_TABLE": ("n", "integer"),
    "$AN_CEC_IS_MODULO": ("n", "flag"),
    "$AN_CEC_TYPE": ("n", "integer"),
    "$MA_ENC_COMP_ENABLE": ("na", "flag"),
    "$MA_BACKLASH": ("na", "value"),
    "$MA_CEC_ENABLE": ("a", "flag"),
    "$SN_CEC_TABLE_ENABLE": ("n", "flag"),
    "$SN_CEC_TABLE_WEIGHT": ("n", "value"),
}


@dataclass(frozen=True, slots=True)
class Assignment:
    """One ``variable[indices]=value`` with the line it stands in; ``value`` is exact, an axis is text."""

    line: int
    name: str
    numbers: tuple[int, ...]
    axis: str
    value: Decimal | str

    @property
    def key(self) -> tuple[str, tuple[int, ...], str]:
        """What is assigned to; a file may assign to each place once."""
        return self.name, self.numbers, self.axis

    @property
    def place(self) -> str:
        """The left side as the control writes it."""
        inside = [str(number) for number in self.numbers] + ([self.axis] if self.axis else [])
        return f"{self.name}[{','.join(inside)}]"


@dataclass(frozen=True, slots=True)
class Listing:
    """A text taken apart: assignments in order, everything refused, and whether an end word closed it."""

    assignments: tuple[Assignment, ...]
    errors: tuple[FileFormatError, ...]
    ended: bool


def listing(text: str, where: str) -> Listing:
    """Take a whole text apart without raising; each wrong line gives one error with line and reason."""
    found: list[Assignment] = []
    errors: list[FileFormatError] = []
    seen: set[tuple[str, tuple[int, ...], str]] = set()
    ended = started = False
    for number, raw in enumerate(text.splitlines(), start=1):
        try:
            body = _body(raw, number, where, first=not started)
            started = started or bool(raw.strip())
            if not body:
                continue
            if ended and body not in _END:
                raise _refused("E-TABLE-AFTER-END", where, line=number, text=raw)
            if body in _END or body in _STOPS:
                ended = ended or body in _END
                continue
            assignment = _assignment(body, number, where)
            if assignment.key in seen:
                raise FileFormatError("E-TABLE-TWICE", where, line=number, place=assignment.place)
            seen.add(assignment.key)
            found.append(assignment)
        except FileFormatError as error:
            errors.append(error)
    return Listing(tuple(found), tuple(errors), ended)


def _body(raw: str, number: int, where: str, *, first: bool) -> str:
    """The line without comment, block number and check sum; "" when nothing is left to read."""
    if len(raw) > _LINE_LIMIT or any(not char.isprintable() and char != "\t" for char in raw):
        raise _refused("E-TABLE-SYNTAX", where, line=number, text=raw)
    line = raw.partition(";")[0].strip()
    if line.startswith("%"):
        if first and _HEADER.fullmatch(line):
            return ""
        raise _refused("E-TABLE-HEADER", where, line=number, text=raw)
    line = _BLOCK_NUMBER.sub("", _CHECK_SUM.sub("", line).rstrip(), count=1)
    if _CHANNEL.fullmatch(line):
        return ""
    return line if line.startswith("$") else line.upper()


def _assignment(body: str, number: int, where: str) -> Assignment:
    match = _VARIABLE.fullmatch(body)
    if match is None:
        raise _refused("E-TABLE-SYNTAX", where, line=number, text=body)
    name = match["name"].upper()
    if name not in VARIABLES:
        raise FileFormatError("E-TABLE-NAME", where, line=number, name=name)
    indices, shape = VARIABLES[name]
    numbers, axis = _indices(match["inside"], indices, name, number, where)
    if not match["rest"].startswith("="):
        raise _refused("E-TABLE-EQUALS", where, line=number, text=body)
    value = _READERS[shape](match["rest"][1:].strip(), number, where)
    return Assignment(number, name, numbers, axis, value)


def _indices(inside: str, shapes: str, name: str, number: int, where: str) -> tuple[tuple[int, ...], str]:
    parts = [part.strip() for part in inside.split(",")]
    numeric = "".join("n" if part.isdecimal() else "a" for part in parts)
    if numeric != shapes or not all(_INDEX.fullmatch(part) and part.isascii() for part in parts):
        raise FileFormatError("E-TABLE-INDEX", where, line=number, name=name, inside=inside)
    axis = parts.pop().upper() if shapes.endswith("a") else ""
    return tuple(int(part) for part in parts), axis


def number_of(text: str) -> Decimal | None:
    """A number of the NC language (point as separator, exponent EX) to ten decimals; None if it is none."""
    match = _NUMBER.fullmatch(text) if text.isascii() else None
    if match is None:
        return None
    try:
        value = Decimal(match["mantissa"]).scaleb(int(match["power"] or 0))
        return value.quantize(Decimal(1).scaleb(-DECIMALS)) if abs(value) <= LARGEST else None
    except InvalidOperation:
        return None


def _value(text: str, number: int, where: str) -> Decimal:
    value = number_of(text)
    if value is None:
        raise _refused("E-TABLE-NUMBER", where, line=number, text=text)
    return value


def _integer(text: str, number: int, where: str) -> Decimal:
    value = _value(text, number, where)
    if value != value.to_integral_value():
        raise _refused("E-TABLE-INTEGER", where, line=number, text=text)
    return value


def _flag(text: str, number: int, where: str) -> Decimal:
    words = {"TRUE": Decimal(1), "FALSE": Decimal(0)}
    value = words.get(text.upper()) if text.upper() in words else _integer(text, number, where)
    if value not in (0, 1):
        raise _refused("E-TABLE-FLAG", where, line=number, text=text)
    return Decimal(int(value))


def _axis(text: str, number: int, where: str) -> str:
    match = _AXIS.fullmatch(text) if text.isascii() else None
    if match is None:
        raise _refused("E-TABLE-AXIS", where, line=number, text=text)
    return (match["a"] or match["b"] or match["c"]).upper()


_READERS: dict[Shape, Callable[[str, int, str], Decimal | str]] = {
    "value": _value,
    "integer": _integer,
    "flag": _flag,
    "axis": _axis,
}


def _refused(code: str, where: str, *, line: int, text: str) -> FileFormatError:
    return FileFormatError(code, where, line=line, text=text.strip()[:60])


def value_text(value: Decimal) -> str:
    """A compensation value as we write it: at least six decimals, at most ten, never an exponent."""
    return _decimals(value, 6)


def position_text(value: Decimal) -> str:
    """A position as we write it: at least one decimal, at most ten."""
    return _decimals(value, 1)


def _decimals(value: Decimal, least: int) -> str:
    rounded = value.quantize(Decimal(1).scaleb(-DECIMALS))
    whole, _, fraction = f"{abs(rounded):f}".partition(".")
    sign = "-" if rounded < 0 else ""
    return f"{sign}{whole}.{fraction.rstrip('0').ljust(least, '0')}"
