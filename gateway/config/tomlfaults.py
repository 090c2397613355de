"""Everything that is no TOML in a text, with its place and what was probably meant; the rest of it is read."""

from __future__ import annotations

import re
import tomllib
from typing import Any

from drivers.errors import words
from drivers.local.names import shown
from gateway.config.faults import Fault

MOST = 20
_PUT_IN = "#"
_PLACE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")
_COMMA = re.compile(r"(?:=|[\[,{]|\d\.\.)\s*[+-]?\d+,\d+\s*(?:#.*)?$")
_BACKSLASH = re.compile(r'"[^"]*\\[^"]*"?')
_WORD = re.compile(r"=\s*([A-Za-z_][^\s#,\]}]*)")
_DATE = re.compile(r"=\s*\d+\.\d+\.\d+")


def read_tree(text: str) -> tuple[dict[str, Any], tuple[Fault, ...], str]:
    """The tree of what can be read, the faults, and the text without the faulty lines. Raises RecursionError."""
    text, faults, last = text if text.endswith("\n") else f"{text}\n", list[Fault](), 0
    while True:
        try:
            tree = tomllib.loads(text)
            return {key: part for key, part in tree.items() if not key.startswith(_PUT_IN)}, tuple(faults), text
        except ValueError as error:
            why, line, column = _said(str(error), text)
            # An end of the document, or a line twice: there is no place behind which reading could go on.
            if line <= last or len(faults) >= MOST:
                return {}, tuple(faults) or (_fault(text, why, line, column),), ""
            faults.append(_fault(text, why, line, column))
            text, last = _without(text, line), line


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


def _line(text: str, line: int) -> str:
    return text.split("\n")[line - 1].rstrip("\r") if line else ""


def _without(text: str, line: int) -> str:
    """The text with the line taken out; a header is replaced, or what follows would join another section."""
    lines = text.split("\n")
    lines[line - 1] = f'["{_PUT_IN}{line}"]' if lines[line - 1].lstrip().startswith("[") else ""
    return "\n".join(lines)


def _fault(text: str, why: str, line: int, column: int) -> Fault:
    row = _line(text, line)
    if _is_twice(why):
        column = len(row) - len(row.lstrip()) + 1
    fields = {"why": shown(why), "meant": _meant(row, why)}
    return Fault((), "E-CFG-TOML", fields, line=line, column=column)


def _is_twice(why: str) -> bool:
    return any(word in why for word in ("overwrite", "twice", "Duplicate", "defined"))


def _meant(row: str, why: str) -> str:
    """What is probably meant, in words; "" where nothing is known."""
    if _is_twice(why):
        return words("W-CFG-TWICE", key=shown(row.partition("=")[0].strip()))
    if "\\" in why or "escape" in why.lower() or ("hex" in why and _BACKSLASH.search(row)):
        return words("W-CFG-BACKSLASH")
    if _COMMA.search(row):
        return words("W-CFG-COMMA")
    word = _WORD.search(row)
    if word and word[1].lower() in ("true", "false", "yes", "no", "on", "off"):
        return words("W-CFG-TRUE")
    if word:
        return words("W-CFG-QUOTES", word=shown(word[1]))
    if _DATE.search(row):
        return words("W-CFG-POINTS")
    if ";" in row.partition("#")[0]:
        return words("W-CFG-SEMICOLON")
    return ""
