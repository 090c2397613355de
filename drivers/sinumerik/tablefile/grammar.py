"""Variables that a compensation file may assign to, and one line of it -> an assignment, with the numbers both ways.

Grammar: SINUMERIK Function Manual Extended Functions 03/2013, K3, p. 242 (EEC) and FM 802D sl 11/2012, p. 222 (CEC),
tolerant where published samples differ: blanks, case, name forms of an axis, whole numbers in hexadecimal as machine
data files print bit masks. What is not an assignment is refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from decimal import ROUND_HALF_EVEN, Decimal
from functools import lru_cache
from typing import Literal

from drivers.errors import FileFormatError

# Every variable that a compensation file may assign to: shapes of its indices and value, limits, machine data number.
#
# Names, types and numbers: SINUMERIK 840D sl system variables (EEC, CEC) and machine and setting data descriptions
# (32450-32457 backlash, 32750/32760 and 43900-43920 temperature, 32700-32730 and 41300/41310 switches and limits).

Shape = Literal["value", "position", "integer", "flag", "axis", "name"]


@dataclass(frozen=True, slots=True)
class TableVariable:
    """``indices``: "n" for each number, "a" for an axis. ``first_below`` bounds the first number (0 based).

    ``low``, ``high`` bound the value; ``number`` is that of the machine or setting datum, 0 for table variables;
    ``length``: a setting in the axis' own unit; ``fact``: it says what the machine is and compensates nothing.
    """

    indices: str
    shape: Shape
    number: int = 0
    first_below: int = 1_000_000
    low: float = -100_000.0
    high: float = 100_000.0
    length: bool = False
    fact: bool = False


ENCODERS = 2
AXES = 99  # machine axes are called AX1 to AX31, with link axes more; AX0 is none
TABLES = 1000  # twice the axes of the control; nobody has more

VARIABLES: dict[str, TableVariable] = {
    "$AA_ENC_COMP": TableVariable("nna", "value", first_below=ENCODERS),
    "$AA_ENC_COMP_STEP": TableVariable("na", "position", first_below=ENCODERS),
    "$AA_ENC_COMP_MIN": TableVariable("na", "position", first_below=ENCODERS),
    "$AA_ENC_COMP_MAX": TableVariable("na", "position", first_below=ENCODERS),
    "$AA_ENC_COMP_IS_MODULO": TableVariable("na", "flag", first_below=ENCODERS),
    "$AN_CEC": TableVariable("nn", "value", first_below=TABLES),
    "$AN_CEC_INPUT_AXIS": TableVariable("n", "axis", first_below=TABLES),
    "$AN_CEC_OUTPUT_AXIS": TableVariable("n", "axis", first_below=TABLES),
    "$AN_CEC_INPUT_NCU": TableVariable("n", "integer", first_below=TABLES, low=0, high=99),
    "$AN_CEC_OUTPUT_NCU": TableVariable("n", "integer", first_below=TABLES, low=0, high=99),
    "$AN_CEC_STEP": TableVariable("n", "position", first_below=TABLES),
    "$AN_CEC_MIN": TableVariable("n", "position", first_below=TABLES),
    "$AN_CEC_MAX": TableVariable("n", "position", first_below=TABLES),
    "$AN_CEC_DIRECTION": TableVariable("n", "integer", first_below=TABLES, low=-1, high=1),
    "$AN_CEC_MULT_BY_TABLE": TableVariable("n", "integer", first_below=TABLES, low=0, high=TABLES),
    "$AN_CEC_IS_MODULO": TableVariable("n", "flag", first_below=TABLES),
    "$AN_CEC_TYPE": TableVariable("n", "integer", first_below=TABLES, low=0, high=1),
    "$MA_ENC_COMP_ENABLE": TableVariable("na", "flag", 32700, ENCODERS),
    "$MA_CEC_ENABLE": TableVariable("a", "flag", 32710),
    "$MA_CEC_MAX_SUM": TableVariable("a", "value", 32720, low=0, length=True),
    "$MA_CEC_MAX_VELO": TableVariable("a", "value", 32730, low=0),
    "$SN_CEC_TABLE_ENABLE": TableVariable("n", "flag", 41300, TABLES),
    "$SN_CEC_TABLE_WEIGHT": TableVariable("n", "value", 41310, TABLES),
    "$MA_BACKLASH": TableVariable("na", "value", 32450, ENCODERS, length=True),
    "$MA_BACKLASH_FACTOR": TableVariable("na", "value", 32452, 6, low=0.01, high=100),
    "$MA_BACKLASH_MODE": TableVariable("na", "integer", 32454, ENCODERS, low=0, high=255),
    "$MA_BACKLASH_DYN": TableVariable("na", "value", 32456, ENCODERS, length=True),
    "$MA_BACKLASH_DYN_MAX_VELO": TableVariable("a", "value", 32457, low=0, high=100),
    "$MA_TEMP_COMP_TYPE": TableVariable("a", "integer", 32750, low=0, high=7),
    "$MA_COMP_ADD_VELO_FACTOR": TableVariable("a", "value", 32760, low=0, high=1),
    "$SA_TEMP_COMP_ABS_VALUE": TableVariable("a", "value", 43900, length=True),
    "$SA_TEMP_COMP_SLOPE": TableVariable("a", "value", 43910),
    "$SA_TEMP_COMP_REF_POSITION": TableVariable("a", "position", 43920, length=True),
    "$MN_AXCONF_MACHAX_NAME_TAB": TableVariable("n", "name", 10000, AXES, fact=True),
    "$MN_MM_CEC_MAX_POINTS": TableVariable("n", "integer", 18342, TABLES, low=0, fact=True),
    "$MA_NUM_ENCS": TableVariable("a", "integer", 30200, low=0, high=ENCODERS, fact=True),
    "$MA_IS_ROT_AX": TableVariable("a", "flag", 30300, fact=True),
    "$MA_MM_ENC_COMP_MAX_POINTS": TableVariable("na", "integer", 38000, ENCODERS, low=0, fact=True),
}


# Lines and numbers.

DECIMALS = 10  # the control prints REAL with about ten decimals: finer digits of a value do not survive it
LARGEST = Decimal(100000)
FINEST_POSITION = 1e-20  # mm or deg: smaller is zero
_PLACE = Decimal(1).scaleb(-DECIMALS)
_ASSIGNMENT = re.compile(r"(\$[A-Z]{2}_\w+)\s*\[([^\]]*)\]\s*(.*)", re.IGNORECASE | re.ASCII)
_NUMBER = re.compile(r"([+-]?(?:\d{1,40}(?:\.\d{0,60})?|\.\d{1,60}))(?:EX([+-]?\d{1,2}))?", re.IGNORECASE | re.ASCII)
_COMMA = re.compile(r"[+-]?\d+,\d+", re.ASCII)
_HEX = re.compile(r"'H([0-9A-F]{1,8})'", re.IGNORECASE | re.ASCII)
_AXIS = re.compile(r"\(\s*(\w+)\s*\)|\"(\w+)\"|([A-Z]\w*)", re.IGNORECASE | re.ASCII)
_INDEX_NUMBER = re.compile(r"\d{1,6}", re.ASCII)
_INDEX_AXIS = re.compile(r"(?!AX0)[A-Z]\w{0,31}", re.IGNORECASE | re.ASCII)  # AX1 is the first axis
_NAME = re.compile(r"\"(\w{0,32})\"", re.ASCII)


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


def read_assignment(body: str, number: int, where: str) -> Assignment:
    """A line without comment and block number. Raises FileFormatError with line and reason."""
    match = _ASSIGNMENT.fullmatch(body)
    if match is None:
        raise line_error("E-TABLE-SYNTAX", where, line=number, text=body)
    name, inside, rest = match[1].upper(), match[2], match[3]
    variable = VARIABLES.get(name)
    if variable is None:
        raise FileFormatError("E-TABLE-NAME", where, line=number, name=name)
    numbers, axis = _indices(inside, variable, name, number, where)
    if not rest.startswith("="):
        raise line_error("E-TABLE-EQUALS", where, line=number, text=body)
    value = _READERS[variable.shape](rest[1:].strip(), number, where)
    if isinstance(value, Decimal) and not variable.low <= value <= variable.high:
        raise FileFormatError(
            "E-TABLE-RANGE", where, line=number, name=name, value=value, low=variable.low, high=variable.high
        )
    return Assignment(number, name, numbers=numbers, axis=axis, value=value)


def _indices(inside: str, variable: TableVariable, name: str, number: int, where: str) -> tuple[tuple[int, ...], str]:
    found = _split_indices(inside, variable.indices)
    if found is None:
        raise FileFormatError("E-TABLE-INDEX", where, line=number, name=name, inside=inside[:40])
    if found[0] and found[0][0] >= variable.first_below:
        raise FileFormatError(
            "E-TABLE-FIRST", where, line=number, name=name, index=found[0][0], last=variable.first_below - 1
        )
    return found


@lru_cache(maxsize=4096)
def _split_indices(inside: str, shapes: str) -> tuple[tuple[int, ...], str] | None:
    parts = [part.strip() for part in inside.split(",")]
    if len(parts) != len(shapes):
        return None
    axis = parts.pop() if shapes[-1] == "a" else "X"
    if not _INDEX_AXIS.fullmatch(axis):
        return None
    if not all(_INDEX_NUMBER.fullmatch(part) for part in parts):
        return None
    return tuple(int(part) for part in parts), axis.upper() if shapes[-1] == "a" else ""


def parse_number(text: str) -> Decimal | None:
    """A number of the NC language with every digit; None if it is none or beyond 100 000."""
    match = _NUMBER.fullmatch(text)
    if match is None:
        return None
    value = Decimal(match[1])
    if match[2]:
        value = value.scaleb(int(match[2]))
    return value if abs(value) <= LARGEST else None


def _value(text: str, number: int, where: str) -> Decimal:
    return _exact(text, number, where).quantize(_PLACE, ROUND_HALF_EVEN) + 0


def _exact(text: str, number: int, where: str) -> Decimal:
    value = parse_number(text)
    if value is None:
        code = "E-TABLE-COMMA" if _COMMA.fullmatch(text) else "E-TABLE-NUMBER"
        raise line_error(code, where, line=number, text=text)
    return value


def _position(text: str, number: int, where: str) -> Decimal:
    """Grids keep every digit that a double has."""
    value = float(_exact(text, number, where))
    return Decimal(repr(value)) if abs(value) >= FINEST_POSITION else Decimal(0)


def _integer(text: str, number: int, where: str) -> Decimal:
    coded = _HEX.fullmatch(text)
    value = Decimal(int(coded[1], 16)) if coded else _value(text, number, where)
    if value != value.to_integral_value():
        raise line_error("E-TABLE-INTEGER", where, line=number, text=text)
    return value


def _flag(text: str, number: int, where: str) -> Decimal:
    words = {"TRUE": Decimal(1), "FALSE": Decimal(0)}
    value = words.get(text.upper()) if text.upper() in words else _integer(text, number, where)
    if value not in (0, 1):
        raise line_error("E-TABLE-FLAG", where, line=number, text=text)
    return Decimal(int(value))


def _axis(text: str, number: int, where: str) -> str:
    match = _AXIS.fullmatch(text)
    name = (match[1] or match[2] or match[3]) if match else ""
    if not _INDEX_AXIS.fullmatch(name):
        raise line_error("E-TABLE-AXIS", where, line=number, text=text)
    return name.upper()


def _name(text: str, number: int, where: str) -> str:
    """A name in quotes; an empty one means that there is none."""
    match = _NAME.fullmatch(text)
    if match is None:
        raise line_error("E-TABLE-SYNTAX", where, line=number, text=text)
    return match[1].upper()


_READERS: dict[Shape, Callable[[str, int, str], Decimal | str]] = {
    "value": _value,
    "position": _position,
    "integer": _integer,
    "flag": _flag,
    "axis": _axis,
    "name": _name,
}


def line_error(code: str, where: str, *, line: int, text: str) -> FileFormatError:
    """The error of one line, with as much of its text as helps."""
    return FileFormatError(code, where, line=line, text=text.strip()[:60])


def value_text(value: Decimal) -> str:
    """A compensation value as we write it: at least six decimals, at most ten, never an exponent."""
    return _decimals(value.quantize(_PLACE), 6)


def position_text(value: Decimal) -> str:
    """A position as we write it: at least one decimal, at most ten."""
    return _decimals(value.quantize(_PLACE), 1)


def grid_text(value: float) -> str:
    """STEP, MIN or MAX as we write it: every digit that brings the same number back, at least one decimal."""
    return _decimals(Decimal(repr(float(value))), 1)


def _decimals(value: Decimal, least: int) -> str:
    whole, _, fraction = f"{abs(value):f}".partition(".")
    sign = "-" if value < 0 else ""
    return f"{sign}{whole}.{fraction.rstrip('0').ljust(least, '0')}"
