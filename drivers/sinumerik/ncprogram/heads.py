"""The comments of a program: a head that says what it is and does, and a line before each section.

What it moves and which R parameters it uses is read from its own blocks, so that the head cannot say otherwise.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby

from drivers.programs import NOBODY, Origin

WIDTH = 100
_UNSAID = re.compile(r"[^\x20-\x7e]")
_R_WORD = re.compile(r"\bR(\d+)\b")
_TEXT = re.compile(r'"[^"]*"')
_MOVE = re.compile(r"SUPA G1 ([A-Z]\w*)=(.+) F=([\d.]+)")
_PLACE = re.compile(r"(?:(DC|ACP|ACN|IC)\()?(-?[\d.]+)\)?")
_WRITTEN = re.compile(r"(\$[AMS][A-Z]*_[A-Z0-9_]+)(?:\[[^\]]*\])?=(?!=)")


@dataclass(frozen=True, slots=True)
class Head:
    """What only the writer of a program knows: its path, purpose, and what a person does if it stops.

    Neither run nor number: a program that was read and signed before is sent with the same head.
    """

    path: str
    purpose: str
    stops: str
    origin: Origin = NOBODY
    also: str = ""


def section(title: str) -> str:
    """The line before a section."""
    return f"; ---- {title}"


def headed(head: Head, blocks: Sequence[str], moves: Sequence[str] = ()) -> list[str]:
    """The blocks behind their head of comments; ``moves``: its moves, where the blocks take them from tables."""
    origin = head.origin
    name = head.path.rpartition("/")[2]
    whose = f"site {_said(origin.site)}, machine {_said(origin.machine)}"
    said = [
        f"{name}: {head.purpose}",
        f"{whose}, trueflank {_said(origin.version)}",
        f"Moves: {'; '.join(_moves(moves or blocks)) or 'nothing'}. {head.also}".rstrip(),
        f"Writes: {', '.join(_written(blocks)) or 'no table, no datum'}.",
        f"R parameters: {', '.join(_ranges(_numbers(blocks))) or 'none'}.",
        f"If it stops: {head.stops}",
    ]
    return [*(line for text in said for line in _comment(text)), *blocks]


def _comment(text: str) -> list[str]:
    plain = _UNSAID.sub("?", text)
    return textwrap.wrap(plain, WIDTH, initial_indent="; ", subsequent_indent=";   ", break_on_hyphens=False)


def _said(text: str) -> str:
    return text or "(not given)"


def _numbers(blocks: Iterable[str]) -> list[int]:
    code = (_TEXT.sub("", block.partition(";")[0]) for block in blocks)
    return sorted({int(number) for block in code for number in _R_WORD.findall(block)})


def _ranges(numbers: Sequence[int]) -> list[str]:
    """R80 to R85, R87: numbers in a row together."""
    found = []
    for _, group in groupby(enumerate(numbers), key=lambda item: item[1] - item[0]):
        row = [number for _, number in group]
        found.append(f"R{row[0]}" if len(row) == 1 else f"R{row[0]} to R{row[-1]}")
    return found


def _written(blocks: Iterable[str]) -> list[str]:
    """Names of the tables' variables and data that blocks assign to, each once."""
    found = (match[1] for block in blocks if (match := _WRITTEN.match(block)))
    return list(dict.fromkeys(found))


def _moves(blocks: Iterable[str]) -> list[str]:
    moves = [match.groups() for block in blocks if (match := _MOVE.fullmatch(block))]
    letters = dict.fromkeys(letter for letter, _, _ in moves)
    return [_of_letter(letter, [(place, feed) for each, place, feed in moves if each == letter]) for letter in letters]


def _of_letter(letter: str, moves: list[tuple[str, str]]) -> str:
    """X between -405.0 and 5.0, F 2000.0 to 6000.0 (machine coordinates, all else stands)."""
    asked = any(_R_WORD.search(place) for place, _ in moves)
    read = [_PLACE.fullmatch(place) for place, _ in moves if not _R_WORD.search(place)]
    fixed = sorted(float(found[2]) for found in read if found and found[1] != "IC")
    spans = [f"to {fixed[0]}" if fixed[0] == fixed[-1] else f"between {fixed[0]} and {fixed[-1]}"] if fixed else []
    ways = [f"{letter} {span}" for span in spans]
    ways += ["by steps"] if any(found and found[1] == "IC" for found in read) else []
    ways += [f"{letter} to places from set-up values"] if not all(read) else []
    ways += ["to places that readings ask for"] if asked else []
    feeds = sorted({float(feed) for _, feed in moves})
    return f"{', '.join(ways)}, F {feeds[0]:g}" + (f" to {feeds[-1]:g}" if len(feeds) > 1 else "")
