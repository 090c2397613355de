"""Everything that is no TOML in a text, with its place and what was probably meant; the rest of it is read."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Collection
from typing import Any

from drivers.errors import words
from drivers.local.names import shown
from gateway.config.faults import Fault

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
    text, last = _doubled(text if text.endswith("\n") else f"{text}\n", lists, faults), 0
    while True:
        try:
            tree = tomllib.loads(text)
            return {key: part for key, part in tree.items() if not key.startswith(_PUT_IN)}, tuple(faults), text
        except ValueError as error:
            why, line, column = _opened(text, *_said(str(error), text))
            # An end of the document, or a line twice: there is no place behind which reading could go on.
            if line <= last or len(faults) >= MOST:
                return {}, tuple(faults) or (_fault(text, why, line, column),), ""
            faults.append(_fault(text, why, line, column))
            text, last = _without(text, line), line


def _doubled(text: str, lists: Collection[str], faults: list[Fault]) -> str:
    """The text with double brackets around each section of a list; each that has single ones is a fault."""
    lines = text.split("\n")
    for number, row in enumerate(lines):
        header = _ONE.match(row)
        if header and header[2] in lists:
            fields = {"key": header[2], "value": "", "why": words("W-CFG-MANY", key=header[2])}
            faults.append(Fault((), "E-CFG-VALUE", fields, line=number + 1, column=len(header[1]) + 1))
            lines[number] = f"{header[1]}[[{header[2]}]]"
    return "\n".join(lines)


def _said(message: str, text: str) -> tuple[str, int, int]:
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


def _opened(text: str, why: str, line: int, column: int) -> tuple[str, int, int]:
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
        value = _bare(_line(text, number)).partition("=")[2]
        if value.count("[") > value.count("]") or value.count("{") > value.count("}"):
            return why, number, _line(text, number).find(value.strip()) + 1
    return why, line, column


def _bare(row: str) -> str:
    """The line without its comment."""
    return row.partition("#")[0]


def _line(text: str, line: int) -> str:
    return text.split("\n")[line - 1].rstrip("\r") if line else ""


def _without(text: str, line: int) -> str:
    """The text with the line taken out; a header is replaced, or what follows would join another section.

    A table in braces that goes on over more lines is taken out whole.
    """
    lines = text.split("\n")
    last = _closing(lines, line - 1)
    lines[line - 1] = f'["{_PUT_IN}{line}"]' if _HEADER.match(lines[line - 1]) else ""
    lines[line : last + 1] = [""] * (last + 1 - line)
    return "\n".join(lines)


def _closing(lines: list[str], first: int) -> int:
    """The line on which the braces of the first one are closed; the first one where they are not."""
    depth = 0
    for number in range(first, min(first + LOOK_BACK, len(lines))):
        row = _bare(lines[number])
        depth += row.count("{") - row.count("}")
        if depth <= 0 or (number > first and row.lstrip().startswith("[")):
            return number if depth <= 0 else first
    return first


def _fault(text: str, why: str, line: int, column: int) -> Fault:
    row = _line(text, line)
    if (inner := _INNER.search(why)) is not None:
        column = max(row.rfind(inner[1]), 0) + 1
    elif _is_twice(why):
        column = len(row) - len(row.lstrip()) + 1
    fields = {"why": shown(why), "meant": _meant(row, why)}
    return Fault((), "E-CFG-TOML", fields, line=line, column=column)


def _is_twice(why: str) -> bool:
    return any(word in why for word in ("overwrite", "twice", "Duplicate", "defined"))


def _meant(row: str, why: str) -> str:
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
    bare = _bare(row).rstrip()
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
