"""What tables of one layout have in common: their heading, whatever dates and numbers stand above it."""

from __future__ import annotations

import hashlib
import re

from drivers.files.numbers import decimal

_BREAK = re.compile(r"\r\n|\n|\r")
_SPLIT = re.compile(r"[;\t|]|,(?!\d)|\s+")
_DIGITS = re.compile(r"\d+")
MOST_LINES = 100
FEWEST_NUMBERS = 2


def heading(text: str) -> tuple[str, ...]:
    """The lines before the first row of numbers, blank ones left out; empty where there is no such row."""
    found: list[str] = []
    for line in _BREAK.split(text, MOST_LINES)[:MOST_LINES]:
        if _numbers(line) >= FEWEST_NUMBERS:
            return tuple(found)
        if line.strip():
            found.append(" ".join(line.split()))
    return ()


def _numbers(line: str) -> int:
    """How many cells of a line are numbers, whichever way they are separated; 0 if its first words are none."""
    cells = [cell for cell in _SPLIT.split(line) if cell]
    plain = sum(decimal(cell.strip(' "'), comma="," in cell) is not None for cell in cells)
    commas = sum(decimal(cell.strip(' "')) is not None for cell in line.split(","))
    return max(plain, commas) if not cells or 2 * max(plain, commas) >= len(cells) else 0


def signature_of(text: str) -> str:
    """64 hex digits of the heading, "" without one.

    The line that names the columns counts letter by letter; in lines above it digits do not (dates, serial
    numbers, results change from file to file), words do (units).
    """
    lines = heading(text)
    if not lines:
        return ""
    above = [_DIGITS.sub("0", line) for line in lines[:-1]]
    return hashlib.sha256("\n".join([*above, lines[-1]]).encode("utf-8", "surrogatepass")).hexdigest()
