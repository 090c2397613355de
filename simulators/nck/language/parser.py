"""NC program text -> Program: lines with labels and structures matched, blocks parsed when first reached.

`parse` reads everything at once and raises on the first block it cannot read. `outline` reads only the
frame, as the control does: a block with an error stops the program when it is reached, not before.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from simulators.nck.language.grammar import parse_block
from simulators.nck.language.syntax import Block, NcSyntaxError

__all__ = ["NcSyntaxError", "Program", "SourceLine", "outline", "parse"]

_FRONT = re.compile(
    r"\s*(?P<skip>/\d?)?\s*(?P<number>(?:N|:)\d+)?\s*(?P<skip2>/\d?)?\s*"
    r"(?:(?P<label>[A-Z_][A-Z0-9_]+)\s*:(?![=]))?\s*"
)
_KEYWORD = re.compile(r"(IF|ELSE|ENDIF|FOR|ENDFOR|WHILE|ENDWHILE|REPEAT|UNTIL|LOOP|ENDLOOP)\b")
_JUMP = re.compile(r"\bGOTO[FBC]?\b")
_STRING = re.compile(r'"[^"]*"')
_OPENERS = {"ENDIF": "IF", "ELSE": "IF", "ENDFOR": "FOR", "ENDWHILE": "WHILE", "UNTIL": "REPEAT"}
_OPENERS["ENDLOOP"] = "LOOP"
_NESTING_LIMIT = 16


@dataclass(frozen=True, slots=True)
class SourceLine:
    """One line: upper-case block text, its block number, label and whether it may be skipped."""

    text: str
    number: str
    label: str
    skippable: bool


@dataclass(slots=True)
class Program:
    """The lines of a program, where its structures lead, and its blocks as far as they have been read.

    ``partner``: for IF the line of ELSE or ENDIF, for ELSE its ENDIF, for loop heads their end and for loop
    ends their head. Line indices here count from 0; NcSyntaxError and the control's displays count from 1.
    """

    lines: tuple[SourceLine, ...]
    partner: dict[int, int]
    labels: dict[str, list[int]]
    _blocks: dict[int, Block] = field(default_factory=dict)

    def block(self, index: int) -> Block:
        """The block of that line, parsed once. Raises NcSyntaxError."""
        found = self._blocks.get(index)
        if found is None:
            found = self._blocks[index] = parse_block(self.lines[index].text, index + 1)
        return found

    def find_label(self, kind: str, label: str, here: int) -> int | None:
        """The line a jump leads to: GOTOF after here, GOTOB before, GOTO after, then before."""
        places = self.labels.get(label, ())
        after = next((place for place in places if place > here), None)
        before = next((place for place in reversed(places) if place <= here), None)
        if kind == "GOTOF":
            return after
        if kind == "GOTOB":
            return before
        return before if after is None else after


def _without_comment(line: str) -> tuple[str, bool]:
    """Cut the comment, lift the case outside strings; the flag says whether the quotes close."""
    parts = line.split('"')
    kept = []
    for place, part in enumerate(parts):
        if place % 2:
            kept.append(part)
            continue
        code, comment, _ = part.partition(";")
        kept.append(code.upper())
        if comment:
            return '"'.join(kept), True
    return '"'.join(kept), len(parts) % 2 == 1


def _read_line(line: str, index: int) -> SourceLine:
    text, closed = _without_comment(line.replace("\t", " "))
    if not closed:
        raise NcSyntaxError(index + 1, "a string is not closed")
    front = _FRONT.match(text)
    if front is None:
        return SourceLine(text.strip(), "", "", False)
    skip = bool(front["skip"] or front["skip2"])
    return SourceLine(text[front.end() :].strip(), front["number"] or "", front["label"] or "", skip)


def _keyword(line: SourceLine) -> str:
    found = _KEYWORD.match(line.text)
    if found is None:
        return ""
    if found[1] == "IF" and _JUMP.search(_STRING.sub("", line.text)):
        return ""
    return found[1]


def _match_structures(lines: tuple[SourceLine, ...]) -> dict[int, int]:
    partner: dict[int, int] = {}
    open_: list[tuple[str, int]] = []
    for index, line in enumerate(lines):
        keyword = _keyword(line)
        opener = _OPENERS.get(keyword)
        if opener is not None:
            if not open_ or open_[-1][0] != opener:
                raise NcSyntaxError(index + 1, f"{keyword} without {opener}", 12640)
            _close(keyword, index, open_, partner)
        elif keyword:
            open_.append((keyword, index))
            if len(open_) > _NESTING_LIMIT:
                raise NcSyntaxError(index + 1, "control structures nested too deeply", 12641)
    if open_:
        raise NcSyntaxError(open_[-1][1] + 1, f"{open_[-1][0]} without its end", 12640)
    return partner


def _close(keyword: str, index: int, open_: list[tuple[str, int]], partner: dict[int, int]) -> None:
    _, head = open_.pop()
    if keyword == "ELSE":
        if head in partner:
            raise NcSyntaxError(index + 1, "a second ELSE", 12640)
        partner[head] = index
        open_.append(("IF", head))
        return
    if keyword == "ENDIF":
        partner[partner.get(head, head)] = index
        return
    partner[head] = index
    partner[index] = head


def _labels(lines: tuple[SourceLine, ...]) -> dict[str, list[int]]:
    found: dict[str, list[int]] = {}
    for index, line in enumerate(lines):
        for label in (line.label, line.number):
            if label:
                found.setdefault(label, []).append(index)
    return found


def outline(text: str) -> Program:
    """Read the frame of a program: comments, labels, structures. Raises NcSyntaxError."""
    lines = tuple(_read_line(line, index) for index, line in enumerate(text.splitlines()))
    return Program(lines, _match_structures(lines), _labels(lines))


def parse(text: str) -> Program:
    """Read a whole program, every block of it. Raises NcSyntaxError with the first bad line."""
    program = outline(text)
    for index in range(len(program.lines)):
        program.block(index)
    return program
