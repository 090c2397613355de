"""A whole text of the control -> its assignments: headers, archive paths, block numbers, check sums, ends.

Forms: a file for transfer from outside (%_N_AX_EEC_INI, %_N_AXn_EEC_INI, %_N_NC_CEC_INI, then CHANDATA), an
ASCII archive (%_N_name_ext, then ;$PATH=/_N_dir in column 1, upper case, no blanks; several files may follow
each other), a program (no header). Back-ups may carry block numbers (MD11230: machine data numbers) and a
check sum of four hexadecimal digits after an apostrophe; how it is computed is not public, so it is not checked.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from drivers.errors import FileFormatError
from drivers.sinumerik.tablefile.grammar import Assignment, assignment, refused

_LINE_LIMIT = 512
_HEADER = re.compile(r"%_N_\w+", re.ASCII)
_PATH = re.compile(r";\$PATH=(/_N_[A-Z0-9_]+)+")
_CHANNEL = re.compile(r"CHANDATA\s*\(\s*\d{1,2}\s*\)", re.IGNORECASE | re.ASCII)
_CHECK_SUM = re.compile(r"'[0-9A-Fa-f]{4}\s*$")
_BLOCK_NUMBER = re.compile(r"N\d{1,9}(?=[\s$])\s*", re.IGNORECASE | re.ASCII)
_END = frozenset({"M17", "M30", "M2", "M02", "RET"})
_HOLD = frozenset({"M0", "M00"})
_PASSED = frozenset({"NEWCONF", "STOPRE"})


@dataclass(frozen=True, slots=True)
class Listing:
    """A text taken apart: assignments in order, everything refused, and whether an end word closed it.

    ``headers`` gives the line and name of each header, ``ends`` the line and word of each M0, M30, M17...,
    ``checked`` the lines with a check sum, ``lines`` how many lines there are.
    """

    assignments: tuple[Assignment, ...]
    errors: tuple[FileFormatError, ...]
    ended: bool
    headers: tuple[tuple[int, str], ...]
    ends: tuple[tuple[int, str], ...]
    checked: frozenset[int]
    lines: int


@dataclass(slots=True)
class _Scan:
    where: str
    found: list[Assignment] = field(default_factory=list)
    seen: set[tuple[str, tuple[int, ...], str]] = field(default_factory=set)
    headers: list[tuple[int, str]] = field(default_factory=list)
    ends: list[tuple[int, str]] = field(default_factory=list)
    checked: set[int] = field(default_factory=set)
    started: bool = False
    ended: bool = False
    holding: bool = False
    after_header: bool = False

    def line(self, raw: str, number: int) -> None:
        """Take one line in. Raises FileFormatError with line and reason."""
        if len(raw) > _LINE_LIMIT or not (raw.isprintable() or raw.replace("\t", "").isprintable()):
            raise refused("E-TABLE-SYNTAX", self.where, line=number, text=raw)
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

    def _path(self, raw: str, number: int) -> None:
        if not (self.after_header and _PATH.fullmatch(raw)):
            raise refused("E-TABLE-PATH", self.where, line=number, text=raw)
        self.after_header = False

    def _header(self, text: str, raw: str, number: int) -> None:
        if (self.started and not (self.ended or self.holding)) or not _HEADER.fullmatch(text):
            raise refused("E-TABLE-HEADER", self.where, line=number, text=raw)
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
        if word in _END or word in _HOLD:
            self.ends.append((number, word))
            self.ended, self.holding = self.ended or word in _END, word in _HOLD
        elif self.ended:
            raise refused("E-TABLE-AFTER-END", self.where, line=number, text=raw)
        elif word and word not in _PASSED and not _CHANNEL.fullmatch(word):
            self.holding = False
            self._assign(assignment(bare, number, self.where))

    def _assign(self, item: Assignment) -> None:
        if item.key in self.seen:
            raise FileFormatError("E-TABLE-TWICE", self.where, line=item.line, place=item.place)
        self.seen.add(item.key)
        self.found.append(item)


def listing(text: str, where: str) -> Listing:
    """Take a whole text apart without raising; each wrong line gives one error with line and reason."""
    scan, errors, lines = _Scan(where), [], text.splitlines()
    for number, raw in enumerate(lines, start=1):
        try:
            scan.line(raw, number)
        except FileFormatError as error:
            errors.append(error)
    return Listing(
        tuple(scan.found),
        tuple(errors),
        scan.ended or scan.holding,
        tuple(scan.headers),
        tuple(scan.ends),
        frozenset(scan.checked),
        len(lines),
    )
