"""A whole program, block by block, then what only the whole shows: structures, jumps, the end, one name one thing."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

from drivers.sinumerik.legality import jumps, structures
from drivers.sinumerik.legality.blocks import Commands, word
from drivers.sinumerik.legality.cursor import Cursor, Scope
from drivers.sinumerik.legality.definitions import definition, external, macro, procedure
from drivers.sinumerik.legality.findings import Finding, Illegal, finding
from drivers.sinumerik.legality.heads import BlockHead, head, judge_header, judge_path
from drivers.sinumerik.legality.lexer import Token, tokens
from drivers.sinumerik.legality.names import bare_name, judge_program_name
from drivers.sinumerik.legality.statements import JUMPS, STATEMENTS, Jump, conditional, jump

LONGEST_BLOCK = 512
_ENDS = frozenset({2, 17, 30})
_DECLARING = frozenset({"DEF", "PROC", "EXTERN", "DEFINE"})
_FIRST_WORD = re.compile(r"\s*/?[0-9]?\s*(?:N[0-9]+)?\s*([A-Z]+)", re.ASCII | re.IGNORECASE)


@dataclass(frozen=True)
class Block:
    """What the whole program needs to know of one block; ``ends`` also where a jump leaves it for certain."""

    line: int
    head: BlockHead
    word: str
    jumps: tuple[Jump, ...]
    ends: bool


@dataclass(frozen=True)
class Read:
    """What one block says wherever it stands, and what is wrong with it; ``works``: it is none of the head."""

    wrong: tuple[Illegal, ...]
    head: BlockHead
    word: str
    jumps: tuple[Jump, ...]
    ends: bool
    works: bool


class Program:
    """Reads the blocks of one program and keeps what is wrong with them.

    A program repeats itself. A block of the same text means the same until something more is declared: it is read once.
    """

    def __init__(self, name: str, scope: Scope) -> None:
        self._name = name
        self._scope = scope
        self._blocks: list[Block] = []
        self._found: list[Finding] = []
        self._headed = False
        self._working = False
        self._known: dict[str, Read] = {}

    def read(self, line: int, text: str) -> None:
        """One line of the program, counted from 1."""
        try:
            self._judge(line, text)
        except Illegal as wrong:
            self._found.append(finding(line, wrong))

    def findings(self, lines: int) -> tuple[Finding, ...]:
        """Everything wrong, by line; asked once, when all ``lines`` are read."""
        return tuple(sorted({*self._found, *self._whole(lines)}))

    def _judge(self, line: int, text: str) -> None:
        text = text.rstrip("\r")
        if line == 1 and text.startswith("%"):
            self._headed = True
            judge_header(text, self._name)
            return
        if text.lstrip().upper().startswith(";$PATH"):
            judge_path(text, behind_header=self._headed and line == 2)
        if len(text) > LONGEST_BLOCK:
            self._blocks.append(_unread(line, text))
            raise Illegal("E-LEGAL-LENGTH", length=len(text), limit=LONGEST_BLOCK)
        self._cut(line, text)

    def _cut(self, line: int, text: str) -> None:
        known = self._known.get(text)
        if known is None:
            try:
                found = tokens(text)
            except Illegal:
                self._blocks.append(_unread(line, text))
                raise
            if len(found) < len(("a word", "end")):
                return
            known = self._block(Cursor(found, self._scope), found)
            if _declares(found):
                self._known.clear()
            else:
                self._known[text] = known
        self._working = self._working or known.works
        self._found += [finding(line, wrong) for wrong in known.wrong]
        self._blocks.append(Block(line=line, head=known.head, word=known.word, jumps=known.jumps, ends=known.ends))

    def _block(self, cursor: Cursor, found: list[Token]) -> Read:
        place, steered, works = BlockHead(skipped=False, number="", label=""), "", False
        leaving: list[Jump] = []
        try:
            place = head(cursor)
            steered = _structure(cursor.token.text, found)
            _judge_place(place, steered)
            works = not cursor.at_end and cursor.token.text not in _DECLARING
            self._declare_or_work(cursor, leaving)
        except Illegal as wrong:
            cursor.noted.append(wrong)
        return Read(
            wrong=tuple(cursor.noted), head=place, word=steered, jumps=tuple(leaving), ends=_ends(found), works=works
        )

    def _declare_or_work(self, cursor: Cursor, leaving: list[Jump]) -> None:
        if cursor.at_end:
            return
        if cursor.token.text in _DECLARING:
            self._declare(cursor)
        else:
            _work(cursor, leaving)

    def _declare(self, cursor: Cursor) -> None:
        if self._working:
            cursor.noted.append(Illegal("E-LEGAL-LATE", word=cursor.token.text))
        kind = cursor.take().text
        if kind == "DEF":
            definition(cursor)
        elif kind == "PROC":
            self._procedure(cursor)
        else:
            (external if kind == "EXTERN" else macro)(cursor)

    def _procedure(self, cursor: Cursor) -> None:
        name = procedure(cursor)
        judge_program_name(name)
        if self._name and bare_name(name) != bare_name(self._name):
            raise Illegal("E-LEGAL-HEADER-NAME", given=name, name=self._name)

    def _whole(self, lines: int) -> Iterator[Finding]:
        yield from self._end(lines)
        paths, wrong = structures.judge([(block.line, block.word) for block in self._blocks])
        yield from wrong
        yield from self._names()
        yield from self._jumps([()] * len(paths) if wrong else paths)  # what is not closed has no inside

    def _end(self, lines: int) -> Iterator[Finding]:
        if not self._blocks:
            yield finding(max(1, lines), Illegal("E-LEGAL-END"))
        elif not self._blocks[-1].ends:
            yield finding(self._blocks[-1].line, Illegal("E-LEGAL-END"))

    def _names(self) -> Iterator[Finding]:
        """One name, one thing: no label twice, none that is a variable's or the program's."""
        taken = set(self._scope.variables) | ({bare_name(self._name)} if self._name else set())
        for block in self._blocks:
            label = block.head.label
            if label in taken:
                yield finding(block.line, Illegal("E-LEGAL-TWICE", name=label))
            if label:
                taken.add(label)

    def _jumps(self, paths: list[structures.Path]) -> Iterator[Finding]:
        places: defaultdict[str, list[tuple[int, structures.Path]]] = defaultdict(list)
        departures: list[jumps.Departure] = []
        for block, path in zip(self._blocks, paths, strict=True):
            for name in (block.head.label, block.head.number):
                if name:
                    places[name].append((block.line, path))
            departures += [jumps.Departure(block.line, path, leap) for leap in block.jumps]
        yield from jumps.judge(departures, places)


def _declares(found: list[Token]) -> bool:
    """Whether a word of the block may change what names mean after it; a label before it hides none."""
    return any(token.text in _DECLARING for token in found)


def _work(cursor: Cursor, leaving: list[Jump]) -> None:
    """Read the words of a block that does something."""
    statement = STATEMENTS.get(cursor.token.text)
    if statement is not None and cursor.token.kind == "name" and cursor.token.text not in cursor.scope.variables:
        cursor.take()
        leaving += statement(cursor)
        return
    commands = Commands()
    while not cursor.at_end:
        if cursor.token.text in JUMPS:
            leaving += jump(cursor)
            cursor.ended()
        elif cursor.accept("IF"):
            leaving += conditional(cursor)
        else:
            word(cursor, commands)


def _structure(first: str, found: list[Token]) -> str:
    """The word of a structure that this block is an element of; IF ... GOTO and REPEAT label are none."""
    if first not in structures.WORDS:
        return ""
    if first == "IF" and any(token.text in JUMPS for token in found):
        return ""
    if first == "REPEAT" and found[-2].text != "REPEAT":
        return ""
    return first


def _judge_place(place: BlockHead, steered: str) -> None:
    """Printed: blocks of a structure carry no label and are never skipped."""
    if steered and place.label:
        raise Illegal("E-LEGAL-LABELLED", word=steered, label=place.label)
    if steered and place.skipped:
        raise Illegal("E-LEGAL-SKIPPED", word=steered)


def _ends(found: list[Token]) -> bool:
    """M2, M17, M30, RET, or a jump without condition."""
    if any(token.kind == "name" and token.text == "RET" for token in found):
        return True
    if any(token.kind == "din" and token.text[0] == "M" and _end_number(token.text[1:]) for token in found):
        return True
    words = {token.text for token in found if token.kind == "name"}
    return not words.isdisjoint(JUMPS) and words.isdisjoint({"IF", "CASE"})


def _end_number(digits: str) -> bool:
    return digits.isdigit() and len(digits) < 9 and int(digits) in _ENDS


def _unread(line: int, text: str) -> Block:
    """A block that could not be cut still opens or closes what its first word says, and may be the end."""
    match = _FIRST_WORD.match(text)
    first = match[1].upper() if match else ""
    jumping = "GOTO" in text.upper()
    steered = first if first in structures.WORDS and not (first == "IF" and jumping) else ""
    ends = re.search(r"\b(?:M0*(?:2|17|30)|RET)\b", text, re.IGNORECASE) is not None
    return Block(line=line, head=BlockHead(skipped=False, number="", label=""), word=steered, jumps=(), ends=ends)
