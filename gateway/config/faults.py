"""Faults of a site file, the place of each in its text, and what in that text is no TOML.

`read_tree` reads what can be read: a line that tomllib refuses is taken out and kept as a fault with what was probably
meant, and the rest is read again. `places_in` finds the offset of every key and value, so each fault names its line.
"""

from __future__ import annotations

import contextlib
import re
import tomllib
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

from drivers.errors import ConfigError, words
from drivers.local.names import shown

# Where each key and each value of a TOML text stands; what stands behind the first thing that is no TOML has none.

Path = tuple[str | int, ...]
"""A way into the tree: keys, and numbers of list items."""
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_BLANK = re.compile(r"[ \t]*")
_EMPTY = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_PLAIN = re.compile(r"[^,\]}#\n]+")
_TEXTS = (
    re.compile(r'"""(?:\\.|[^\\])*?"""+', re.DOTALL),
    re.compile(r"'''.*?'''+", re.DOTALL),
    re.compile(r'"(?:\\.|[^"\\\n])*"'),
    re.compile(r"'[^'\n]*'"),
)


@dataclass(slots=True)
class TextPlaces:
    """Offsets in ``text`` of keys and of values, by their way into the tree."""

    text: str
    keys: dict[Path, int] = field(default_factory=dict)
    values: dict[Path, int] = field(default_factory=dict)

    def of(self, path: Path, *, key: bool = False) -> tuple[int, int] | None:
        """Line and column, from 1, of a value (or its key); of the nearest section around it; None: nowhere."""
        while path:
            first, second = (self.keys, self.values) if key else (self.values, self.keys)
            offset = first.get(path, second.get(path))
            if offset is not None:
                return self.text.count("\n", 0, offset) + 1, offset - (self.text.rfind("\n", 0, offset) + 1) + 1
            path, key = path[:-1], True
        return None


def places_in(text: str) -> TextPlaces:
    """All of a text; what stands behind the first thing that is no TOML has no place."""
    reader = _Reader(text)
    with contextlib.suppress(IndexError, ValueError, RecursionError):
        reader.read()
    return reader.found


class _Reader:
    def __init__(self, text: str) -> None:
        self.found = TextPlaces(text)
        self._text = text
        self._at = 0
        self._tables: dict[Path, int] = {}

    def read(self) -> None:
        around: Path = ()
        self._skip(_EMPTY)
        while self._at < len(self._text):
            if self._text[self._at] == "[":
                around = self._header()
            else:
                self._entry(around)
            self._skip(_EMPTY)

    def _skip(self, what: re.Pattern[str]) -> str:
        match = what.match(self._text, self._at)
        if match is None:
            raise ValueError(self._at)
        self._at = match.end()
        return match.group()

    def _header(self) -> Path:
        start = self._at
        many = self._text.startswith("[[", start)
        self._at += 2 if many else 1
        path: Path = ()
        parts = self._dotted_key()
        for number, (name, _) in enumerate(parts, start=1):
            path += (name,)
            if many and number == len(parts):
                self._tables[path] = self._tables.get(path, -1) + 1
            self.found.keys.setdefault(path, start)
            if path in self._tables:
                path += (self._tables[path],)
        self.found.keys[path] = start
        self._at += 2 if many else 1
        return path

    def _dotted_key(self) -> list[tuple[str, int]]:
        """The parts of a key with their offsets; the end stands behind the blanks that follow."""
        parts = []
        while True:
            self._skip(_BLANK)
            start = self._at
            parts.append((self._name(), start))
            self._skip(_BLANK)
            if self._text[self._at] != ".":
                return parts
            self._at += 1

    def _name(self) -> str:
        if self._text[self._at] in "\"'":
            return self._string()[1:-1]
        return self._skip(_BARE)

    def _string(self) -> str:
        for form in _TEXTS:
            if form.match(self._text, self._at):
                return self._skip(form)
        raise ValueError(self._at)

    def _entry(self, around: Path) -> None:
        path = around
        for name, start in self._dotted_key():
            path += (name,)
            self.found.keys.setdefault(path, start)
        self._at += 1  # the sign of equality
        self._skip(_BLANK)
        self._value(path)

    def _value(self, path: Path) -> None:
        self.found.values[path] = self._at
        first = self._text[self._at]
        if first in "\"'":
            self._string()
        elif first == "[":
            self._list(path)
        elif first == "{":
            self._inline(path)
        else:
            self._skip(_PLAIN)

    def _list(self, path: Path) -> None:
        self._at += 1
        number = 0
        self._skip(_EMPTY)
        while self._text[self._at] != "]":
            self._value((*path, number))
            number += 1
            self._skip(_EMPTY)
            self._at += self._text[self._at] == ","
            self._skip(_EMPTY)
        self._at += 1

    def _inline(self, path: Path) -> None:
        self._at += 1
        self._skip(_EMPTY)
        while self._text[self._at] != "}":
            self._entry(path)
            self._skip(_EMPTY)
            self._at += self._text[self._at] == ","
            self._skip(_EMPTY)
        self._at += 1


def value_at(tree: Any, path: Path) -> Any:
    """The value at a place of a tree; None where there is none."""
    for part in path:
        try:
            tree = tree[part]
        except (KeyError, IndexError, TypeError):
            return None
    return tree


# One thing that is wrong in a site file, said with its place, and all of them as one exception.

_NAMED = {"axes": "axis", "instruments": "instrument"}
_TITLED = {"equipment": ("equipment", "name"), "tolerances": ("tolerance of", "axis")}


@dataclass(frozen=True, slots=True)
class Fault:
    """``path`` leads to the key in the tree; ``code`` and ``fields`` are of the catalogue.

    ``line`` and ``column`` count from 1, 0 where there is no place. ``on_key``: the key itself is wrong, not its
    value. ``doubt``: worth a look, no reason to refuse the file.
    ``later``: a driver or a command refuses it by itself when its turn comes; others can use the file before.
    """

    path: Path
    code: str
    fields: dict[str, Any] = field(default_factory=dict)
    line: int = 0
    column: int = 0
    on_key: bool = False
    doubt: bool = False
    later: bool = False

    def error(self, file: str) -> ConfigError:
        """As an exception at FILE:LINE:COLUMN."""
        where = f"{file}:{self.line}:{self.column}" if self.line else file
        return ConfigError(self.code, where, **self.fields)

    def as_record(self, file: str) -> dict[str, object]:
        """As data."""
        place = {"line": self.line or None, "column": self.column or None}
        return {"file": file, **place, "doubt": self.doubt, **self.error(file).as_record()}


class SiteFaults(ConfigError):
    """A site file with faults: code and fields are those of the first, ``causes`` holds every one."""

    def __init__(self, file: str, faults: Sequence[Fault]) -> None:
        errors = [fault.error(file) for fault in faults]
        super().__init__(errors[0].code, errors[0].where, **faults[0].fields)
        self.faults = tuple(faults)
        self.causes = tuple((str(number), error) for number, error in enumerate(errors, start=1))

    def __str__(self) -> str:
        return "\n".join(str(error) for _, error in self.causes)


def place_name(tree: Any, path: Path) -> str:
    """A place in people's words: "axis X1: measure.feed", "controller.settings.r_first"."""
    if not path:
        return "(file)"
    rest = ".".join(map(str, path[2:]))
    if path[0] in _NAMED and len(path) > 1:
        name = value_at(tree, (*path[:2], "name"))
        who = f"{_NAMED[str(path[0])]} {name if isinstance(name, str) and name else f'number {int(path[1]) + 1}'}"
    elif path[0] in _TITLED and len(path) > 1:
        what, key = _TITLED[str(path[0])]
        name = value_at(tree, (*path[:2], key))
        who = f"{what} {name if isinstance(name, str) and name else f'number {int(path[1]) + 1}'}"
    elif path[0] == "setups" and len(path) > 1:
        one = {key: value_at(tree, (*path[:2], key)) for key in ("component", "axis")}
        who = f"set-up {one['component'] or '?'} on {one['axis'] or '?'}"
    else:
        return ".".join(map(str, path))
    return f"{who}: {rest}" if rest else who


# Everything that is no TOML in a text, with its place and what was probably meant; the rest of it is read.

MOST = 20
_PUT_IN = "#"
_PLACE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")
_BACKSLASH = re.compile(r'"[^"]*\\[^"]*"?')
_HEADER = re.compile(r"[^\w\"'=#]*[\[(<]")
_ONE = re.compile(r"^(\s*)\[\s*(\w+)\s*\]\s*(?:#.*)?$")
_WORD = re.compile(r"=\s*([A-Za-z_][^\s#,\]}]*)")
_INNER = re.compile(r"inline table key '([^']*)'")
LINE_END = "Illegal character '\\n'"
_TEXT_ENDS = (LINE_END, 'Expected "\'"')
LOOK_BACK = 50
_NUMBER = r"[+-]?\d[\d.]*"
_MEANT = (
    ("W-CFG-STRAIGHT", re.compile("[\u201c\u201d\u201e\u2018\u2019\u201a\u00ab\u00bb]")),
    ("W-CFG-INVISIBLE", re.compile("[\u00a0\u1680\u2000-\u200f\u2028-\u202f\u205f-\u2064\u3000\ufeff]")),
    ("W-CFG-FULLWIDTH", re.compile("[\uff01-\uff5e\u3001\u3002]")),
    ("W-CFG-MINUS", re.compile("[\u2010-\u2015\u2212]")),
    ("W-CFG-DATE", re.compile(r"=\s*(?:\d{1,2}[./]\d{1,2}[./]\d{2,4}|\d{4}[-./]\d{1,2}[-./]\d{1,2})")),
    ("W-CFG-POINTS", re.compile(r"=\s*[+-]?(?:\d+\.\d+\.\d+|\d{1,3}(?:,\d{3})+\.\d|\d{1,3}(?:[ ']\d{3})+\b)")),
    ("W-CFG-COMMA", re.compile(r"(?:=|[\[,{]|\d\.\.)\s*[+-]?\d+,\d+(?:$|\s*[,}\]](?=.*[}\]]))")),
    ("W-CFG-COMMENT", re.compile(r"=.*\s(?://|--|/\*|;\s*\w)|^\s*(?://|;|/\*|--\s|[%!]|rem\s)", re.IGNORECASE)),
    ("W-CFG-HEADER", re.compile(r"^\s*[\[(<]")),
    ("W-CFG-EQUALS", re.compile(r"^[^=]*$|^\s*[\w.-]+\s*(?::|==|=>)|\{\s*\w+\s*:")),
    ("W-CFG-KEY-NAME", re.compile(r"^\s*(?:=|[^\s=\"'.]+\s+[^\s=]|[^=\"']*[^\x00-\x7f])")),
    ("W-CFG-NO-VALUE", re.compile(r"=$")),
    ("W-CFG-DIGITS", re.compile(r"[=\[,]\s*[+-]?(?:0\d|\.\d|\d+\.(?![\d.]))")),
    ("W-CFG-BRACKETS", re.compile(r"=\s*\(")),
    ("W-CFG-ONE-LINE", re.compile(r"=\s*\{[^}]*$")),
    ("W-CFG-LAST-COMMA", re.compile(r",\s*\}|^[^\[{]*,$")),
    ("W-CFG-SEMICOLON", re.compile(r"[\[{][^\]}]*;")),
    ("W-CFG-OWN-LINE", re.compile(rf"=\s*(?:\"[^\"]*\"|'[^']*'|{_NUMBER}|true|false)\s+[\w.-]+\s*=")),
    ("W-CFG-DOUBLED", re.compile(r"=\s*\"\"[^\"]")),
    ("W-CFG-CALCULATED", re.compile(rf"=\s*{_NUMBER}\s*[*/+^-]")),
    ("W-CFG-UNIT", re.compile(rf"=\s*{_NUMBER}\s*[A-Za-z\u00b0\u00b5\u03bc%]")),
)
"""What a line looks like without its comment, and what was probably meant; the first that fits is told."""


def read_tree(text: str, lists: Collection[str] = ()) -> tuple[dict[str, Any], tuple[Fault, ...], str]:
    """The tree of what can be read, the faults, and the text without the faulty lines. Raises RecursionError.

    ``lists`` are sections of which there can be several: one in single brackets is read as it was meant.
    """
    faults = list[Fault]()
    text, last = _with_double_brackets(text if text.endswith("\n") else f"{text}\n", lists, faults), 0
    while True:
        try:
            tree = tomllib.loads(text)
            return {key: part for key, part in tree.items() if not key.startswith(_PUT_IN)}, tuple(faults), text
        except ValueError as error:
            why, line, column = _unclosed_start(text, *_parser_message(str(error), text))
            # An end of the document, or a line twice: there is no place behind which reading could go on.
            if line <= last or len(faults) >= MOST:
                return {}, tuple(faults) or (_toml_fault(text, why, line, column),), ""
            faults.append(_toml_fault(text, why, line, column))
            text, last = _without_line(text, line), line


def _with_double_brackets(text: str, lists: Collection[str], faults: list[Fault]) -> str:
    """The text with double brackets around each section of a list; each that has single ones is a fault."""
    lines = text.split("\n")
    for number, row in enumerate(lines):
        header = _ONE.match(row)
        if header and header[2] in lists:
            fields = {"key": header[2], "value": "", "why": words("W-CFG-MANY", key=header[2])}
            faults.append(Fault((), "E-CFG-VALUE", fields, line=number + 1, column=len(header[1]) + 1))
            lines[number] = f"{header[1]}[[{header[2]}]]"
    return "\n".join(lines)


def _parser_message(message: str, text: str) -> tuple[str, int, int]:
    """tomllib's words, and the line and column they are about; 0 where nobody knows."""
    place = _PLACE.search(message)
    if place is None:
        return message, 0, 0
    why = message[: place.start()]
    if place[1]:
        return why, int(place[1]), int(place[2])
    opening = '"""' if "string" in why else "["
    open_ones = [line for line, row in enumerate(text.split("\n"), start=1) if opening in row.partition("=")[2]]
    line = open_ones[-1] if open_ones else text.count("\n")
    return why, line, _line(text, line).find(opening) + 1


def _unclosed_start(text: str, why: str, line: int, column: int) -> tuple[str, int, int]:
    """The same, about where that begins which is not closed: tomllib tells where it looked for the end."""
    if why in _TEXT_ENDS:
        quote = '"' if why == LINE_END else "'"
        if quote == "'":
            line = max((at for at, row in enumerate(text.split("\n"), 1) if row.count(quote) % 2), default=0)
        row = _line(text, line)
        return why, line, max(row.find(quote, row.find("=")) + 1, 1)
    if not why.startswith("Unclosed"):
        return why, line, column
    for number in range(line, max(line - LOOK_BACK, 0), -1):
        value = _without_comment(_line(text, number)).partition("=")[2]
        if value.count("[") > value.count("]") or value.count("{") > value.count("}"):
            return why, number, _line(text, number).find(value.strip()) + 1
    return why, line, column


def _without_comment(row: str) -> str:
    """The line without its comment."""
    return row.partition("#")[0]


def _line(text: str, line: int) -> str:
    return text.split("\n")[line - 1].rstrip("\r") if line else ""


def _without_line(text: str, line: int) -> str:
    """The text with the line taken out; a header is replaced, or what follows would join another section.

    A table in braces that goes on over more lines is taken out whole.
    """
    lines = text.split("\n")
    last = _closing_line(lines, line - 1)
    lines[line - 1] = f'["{_PUT_IN}{line}"]' if _HEADER.match(lines[line - 1]) else ""
    lines[line : last + 1] = [""] * (last + 1 - line)
    return "\n".join(lines)


def _closing_line(lines: list[str], first: int) -> int:
    """The line on which the braces of the first one are closed; the first one where they are not."""
    depth = 0
    for number in range(first, min(first + LOOK_BACK, len(lines))):
        row = _without_comment(lines[number])
        depth += row.count("{") - row.count("}")
        if depth <= 0 or (number > first and row.lstrip().startswith("[")):
            return number if depth <= 0 else first
    return first


def _toml_fault(text: str, why: str, line: int, column: int) -> Fault:
    row = _line(text, line)
    if (inner := _INNER.search(why)) is not None:
        column = max(row.rfind(inner[1]), 0) + 1
    elif _is_twice(why):
        column = len(row) - len(row.lstrip()) + 1
    fields = {"why": shown(why), "meant": _suggestion(row, why)}
    return Fault((), "E-CFG-TOML", fields, line=line, column=column)


def _is_twice(why: str) -> bool:
    return any(word in why for word in ("overwrite", "twice", "Duplicate", "defined"))


def _suggestion(row: str, why: str) -> str:
    """What is probably meant, in words; "" where nothing is known."""
    if _is_twice(why):
        inner = _INNER.search(why)
        return words("W-CFG-TWICE", key=shown(inner[1] if inner else row.partition("=")[0].strip()))
    if why in _TEXT_ENDS:
        return words("W-CFG-UNCLOSED-TEXT")
    if why.startswith("Illegal character"):
        return words("W-CFG-INVISIBLE")
    if "\\" in why or "escape" in why.lower() or ("hex" in why and _BACKSLASH.search(row)):
        return words("W-CFG-BACKSLASH")
    bare = _without_comment(row).rstrip()
    for code, form in _MEANT:
        if form.search(bare):
            return words(code)
    if why.startswith("Unclosed"):
        return words("W-CFG-UNCLOSED")
    word = _WORD.search(row)
    if word and word[1].lower() in ("true", "false", "yes", "no", "on", "off"):
        return words("W-CFG-TRUE")
    if word and word[1].lower() in ("nan", "inf", "infinity"):
        return words("W-CFG-A-NUMBER")
    if word and word[1].lower() in ("null", "none", "nil"):
        return words("W-CFG-NO-VALUE")
    if word:
        return words("W-CFG-QUOTES", word=shown(word[1]))
    return words("W-CFG-SEMICOLON") if ";" in bare else ""
