"""A whole text of the control -> its assignments: headers, archive paths, block numbers, check sums, ends.

Forms: a file for transfer from outside (%_N_AX_EEC_INI, %_N_AXn_EEC_INI, %_N_NC_CEC_INI, then CHANDATA), an
ASCII archive (%_N_name_ext, then ;$PATH=/_N_dir in column 1, upper case, no blanks; several files may follow
each other), a program (no header). Back-ups may carry block numbers (MD11230: machine data numbers) and a
check sum of four hexadecimal digits after an apostrophe; how it is computed is not public, so it is not checked.
A file that the control wrote says METRIC or INCH, the unit of all lengths after it, and may hold any other data of the
machine: those lines are passed over and counted. So is another machine datum under its own number (N10020 $MN_...).
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from decimal import Decimal

from drivers.errors import FileFormatError
from drivers.sinumerik.tablefile.grammar import VARIABLES, Assignment, line_error, read_assignment
from drivers.units import MM_PER_INCH, AxisUnit

# A whole text of the control -> its assignments: headers, archive paths, block numbers, check sums, ends.
#
# Forms: a file for transfer from outside (%_N_AX_EEC_INI, %_N_AXn_EEC_INI, %_N_NC_CEC_INI, then CHANDATA), an ASCII
# archive (%_N_name_ext, then ;$PATH=/_N_dir in column 1, upper case, no blanks; several files may follow each other),
# a program (no header). Back-ups may carry block numbers (MD11230: machine data numbers) and a check sum of four
# hexadecimal digits after an apostrophe; how it is computed is not public, so it is not checked. A file that the
# control wrote says METRIC or INCH, the unit of all lengths after it, and may hold any other data of the machine:
# those lines are passed over and counted. So is another machine datum under its own number (N10020 $MN_...).

_LINE_LIMIT = 512
_HEADER = re.compile(r"%_N_\w+", re.ASCII)
_PATH = re.compile(r";\$PATH=(/_N_[A-Z0-9_]+)+")
_CHANNEL = re.compile(r"CHANDATA\s*\(\s*\d{1,2}\s*\)", re.IGNORECASE | re.ASCII)
_CHECK_SUM = re.compile(r"'[0-9A-Fa-f]{4}\s*$")
_BLOCK_NUMBER = re.compile(r"N\d{1,9}(?=[\s$])\s*", re.IGNORECASE | re.ASCII)
_END = frozenset({"M17", "M30", "M2", "M02", "RET"})
STOPS = frozenset({"M0", "M00"})
_PASSED = frozenset({"NEWCONF", "STOPRE"})
_UNITS = frozenset({"METRIC", "INCH"})
_OTHER = re.compile(r"N([1-9]\d{4})\s+(\$[A-Z]{1,2}_\w+)", re.IGNORECASE | re.ASCII)  # numbers of machine data
_OUR_NUMBERS = frozenset(variable.number for variable in VARIABLES.values())
_TABLE = re.compile(r"\$AA_ENC|\$AN_CEC", re.IGNORECASE)
_OURS = re.compile(r"\$AA_|\$AN_|_COMP|_CEC|BACKLASH", re.IGNORECASE)
MOST_ERRORS = 100
"""More wrong lines than these of one file help nobody; the rest is counted."""


@dataclass(frozen=True, slots=True)
class Listing:
    """A text taken apart: assignments in order, everything refused, and whether an end word closed it.

    ``headers`` gives the line and name of each header, ``ends`` the line and word of each M0, M30, M17...,
    ``checked`` the lines with a check sum, ``lines`` how many lines there are. ``units`` has the line and word of each
    METRIC and INCH; ``passed`` counts the lines with other data of the machine, from ``first_passed`` on.
    """

    assignments: tuple[Assignment, ...]
    errors: tuple[FileFormatError, ...]
    ended: bool
    headers: tuple[tuple[int, str], ...]
    ends: tuple[tuple[int, str], ...]
    checked: frozenset[int]
    lines: int
    units: tuple[tuple[int, str], ...] = ()
    passed: int = 0
    first_passed: int = 0

    @property
    def by_control(self) -> bool:
        """Whether the control wrote this text: only it says METRIC or INCH."""
        return bool(self.units)


@dataclass(slots=True)
class _Scan:
    where: str
    found: list[Assignment] = field(default_factory=list)
    seen: set[tuple[str, tuple[int, ...], str]] = field(default_factory=set)
    headers: list[tuple[int, str]] = field(default_factory=list)
    ends: list[tuple[int, str]] = field(default_factory=list)
    checked: set[int] = field(default_factory=set)
    units: list[tuple[int, str]] = field(default_factory=list)
    passed: int = 0
    first_passed: int = 0
    started: bool = False
    ended: bool = False
    holding: bool = False
    after_header: bool = False

    def line(self, raw: str, number: int) -> None:
        """Take one line in. Raises FileFormatError with line and reason."""
        if self._of_others(raw):
            self.passed, self.first_passed = self.passed + 1, self.first_passed or number
            self.after_header, self.started = False, True
            return
        if len(raw) > _LINE_LIMIT or not (raw.isprintable() or raw.replace("\t", "").isprintable()):
            raise line_error("E-TABLE-SYNTAX", self.where, line=number, text=raw)
        if raw.startswith(";$PATH"):
            self._path(raw, number)
            return
        text = raw.partition(";")[0].strip()
        if not text:
            return
        if text[0] == "%":
            self._header(text, raw, number)
            return
        self.after_header, self.started = False, True
        self._block(text, raw, number)

    def _of_others(self, raw: str) -> bool:
        """A machine datum that is not ours, under its number; in a file of the control whatever else assigns."""
        if self.ended or "=" not in raw or raw[:1] in ";%":
            return False
        match = _OTHER.match(raw)
        if match:
            return int(match[1]) not in _OUR_NUMBERS
        left = raw.partition("=")[0]
        return bool(self.units) and not _TABLE.search(left) and left.partition("[")[0].strip().upper() not in VARIABLES

    def _path(self, raw: str, number: int) -> None:
        if not (self.after_header and _PATH.fullmatch(raw)):
            raise line_error("E-TABLE-PATH", self.where, line=number, text=raw)
        self.after_header = False

    def _header(self, text: str, raw: str, number: int) -> None:
        if (self.started and not (self.ended or self.holding)) or not _HEADER.fullmatch(text):
            raise line_error("E-TABLE-HEADER", self.where, line=number, text=raw)
        self.headers.append((number, text.upper()))
        self.after_header, self.started, self.ended, self.holding = True, True, False, False

    def _block(self, text: str, raw: str, number: int) -> None:
        bare = text
        if "'" in text:
            bare = _CHECK_SUM.sub("", text)
            if bare != text:
                self.checked.add(number)
        if bare[:1] in "Nn":
            bare = _BLOCK_NUMBER.sub("", bare, count=1)
        bare = bare.rstrip()
        word = bare if bare.startswith("$") else bare.upper()
        if word in _UNITS:
            self.units.append((number, word))
            return
        if word in _END or word in STOPS:
            self.ends.append((number, word))
            self.ended, self.holding = self.ended or word in _END, word in STOPS
        elif self.ended:
            raise line_error("E-TABLE-AFTER-END", self.where, line=number, text=raw)
        elif word and word not in _PASSED and not _CHANNEL.fullmatch(word):
            self.holding = False
            self._assign(read_assignment(bare, number, self.where))

    def _assign(self, item: Assignment) -> None:
        if item.key in self.seen:
            raise FileFormatError("E-TABLE-TWICE", self.where, line=item.line, place=item.place)
        self.seen.add(item.key)
        self.found.append(item)


def read_listing(text: str, where: str) -> Listing:
    """Take a whole text apart without raising; each wrong line gives one error with line and reason.

    A text of which no line looks like compensation data gives one error in all (E-TABLE-NONE); of more than
    `MOST_ERRORS` wrong lines the rest is counted (E-TABLE-MORE).
    """
    scan, errors, lines = _Scan(where), [], text.splitlines()
    wrong, looks = 0, False
    for number, raw in enumerate(lines, start=1):
        try:
            scan.line(raw, number)
        except FileFormatError as error:
            wrong, looks = wrong + 1, looks or bool(_OURS.search(raw)) or raw[0] in ";%"
            if wrong <= MOST_ERRORS:
                errors.append(error)
    if errors and not looks and not scan.found:
        errors = [FileFormatError("E-TABLE-NONE", where, line=errors[0].fields["line"], lines=len(lines))]
    elif wrong > MOST_ERRORS:
        errors.append(FileFormatError("E-TABLE-MORE", where, count=wrong - MOST_ERRORS))
    return Listing(
        tuple(scan.found),
        tuple(errors),
        ended=scan.ended or scan.holding,
        headers=tuple(scan.headers),
        ends=tuple(scan.ends),
        checked=frozenset(scan.checked),
        lines=len(lines),
        units=tuple(scan.units),
        passed=scan.passed,
        first_passed=scan.first_passed,
    )


# Lines that stand under INCH -> the same in mm: positions by their input axis, values by their output axis.
#
# The unit line (METRIC, INCH) is the control's word for all lengths after it. Angles stay. An axis of which nobody
# says whether it is linear or rotary cannot be converted and is refused by name.

Known = Callable[[str], AxisUnit | None]
_INCH = Decimal(repr(MM_PER_INCH))
_GRID = ("_STEP", "_MIN", "_MAX")


def convert_to_metric(found: Listing, known: Known, where: str) -> Listing:
    """The listing with every length in mm. Raises FileFormatError (E-TABLE-INCH-AXIS)."""
    if not any(word == "INCH" for _line, word in found.units):
        return found
    lines = [line for line, _word in found.units]
    cross = {(item.name, item.numbers[0]): str(item.value) for item in found.assignments if "_AXIS" in item.name}
    converted = []
    for item in found.assignments:
        at = bisect_right(lines, item.line)
        inch = at > 0 and found.units[at - 1][1] == "INCH"
        converted.append(_converted(item, _axis_of(item, cross), known, where) if inch else item)
    return replace(found, assignments=tuple(converted))


def _axis_of(item: Assignment, cross: dict[tuple[str, int], str]) -> str:
    """The axis whose unit the value has; "" if it is no length at all."""
    if item.name == "$AN_CEC":
        return cross.get(("$AN_CEC_OUTPUT_AXIS", item.numbers[0]), "?")
    if item.name.startswith("$AN_CEC") and item.name.endswith(_GRID):
        return cross.get(("$AN_CEC_INPUT_AXIS", item.numbers[0]), "?")
    own = item.name == "$AA_ENC_COMP" or (item.name.startswith("$AA_") and item.name.endswith(_GRID))
    return item.axis if own or VARIABLES[item.name].length else ""


def _converted(item: Assignment, axis: str, known: Known, where: str) -> Assignment:
    if not axis or not isinstance(item.value, Decimal) or not item.value:
        return item
    unit = known(axis)
    if unit is None:
        raise FileFormatError("E-TABLE-INCH-AXIS", f"{where}, line {item.line}", line=item.line, axis=axis)
    return replace(item, value=item.value * _INCH) if unit == "mm" else item
