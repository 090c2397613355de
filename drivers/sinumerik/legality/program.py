"""A whole program, block by block, then what only the whole shows: structures, jumps, the end, one name one thing.

One pass reads the blocks in order, because a declaration changes what later words mean. A block that was read once is
not read again: the same text means the same until something more is declared. A block that cannot be read keeps its
place, with the structure that its first word opens or closes, so that one fault is not reported as many.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from drivers.sinumerik.legality import control_flow
from drivers.sinumerik.legality.blocks import (
    CommandGroups,
    read_definition,
    read_external,
    read_macro,
    read_procedure,
    read_word,
)
from drivers.sinumerik.legality.control_flow import JUMPS, STATEMENTS, Jump, read_if, read_jump
from drivers.sinumerik.legality.lexer import (
    Cursor,
    Finding,
    IllegalBlock,
    Scope,
    Token,
    bare_name,
    check_name,
    check_program_name,
    make_finding,
    tokenize,
)

# What stands before the words of a block: skip sign, block number, label; and the file's own first lines.

_HEADER = re.compile(r"%(?P<name>[A-Z0-9_]+_[A-Z0-9]{3})[ \t\r]*", re.ASCII | re.IGNORECASE)
_PATH = re.compile(r";\$PATH=(?:/_N_[A-Z0-9_]+_(?:DIR|WPD))+[ \t\r]*", re.ASCII)
_LONGEST_NUMBER = 8


@dataclass(frozen=True)
class BlockHead:
    """Skip sign or not, block number ("N10", ":10" or nothing), label (or nothing)."""

    skipped: bool
    number: str
    label: str


def read_head(cursor: Cursor) -> BlockHead:
    """Read the head of a block; a wrong label is noted and kept. Raises IllegalBlock for a wrong block number."""
    skipped = _read_skip_sign(cursor)
    number = _read_block_number(cursor)
    label = ""
    if cursor.after.text == ":" and cursor.token.kind in ("name", "din") and cursor.token.text not in JUMPS:
        label = cursor.take().text
        cursor.take()
        try:
            check_name(label, "label")
        except IllegalBlock as wrong:
            cursor.noted.append(wrong)
    return BlockHead(skipped, number, label)


def check_header(line: str, name: str) -> None:
    """Raise IllegalBlock unless %_N_NAME_MPF names this program (``name`` may be unknown: "")."""
    match = _HEADER.fullmatch(line)
    if match is None:
        raise IllegalBlock("E-LEGAL-HEADER", line=line[:40])
    check_program_name(match["name"])
    if name and bare_name(match["name"]) != bare_name(name):
        raise IllegalBlock("E-LEGAL-HEADER-NAME", given=match["name"], name=name)


def check_path(line: str, behind_header: bool) -> None:
    """;$PATH= stands right behind the header, from the first column, and names directories from the root."""
    if not behind_header or not _PATH.fullmatch(line):
        raise IllegalBlock("E-LEGAL-PATH", line=line.strip()[:40])


def _read_skip_sign(cursor: Cursor) -> bool:
    """/ or /0 to /9."""
    if not cursor.accept("/"):
        return False
    if cursor.token.kind == "number":
        level = cursor.take().text
        if len(level) > 1:
            raise IllegalBlock("E-LEGAL-BLOCK-NUMBER", text=f"/{level}")
    return True


def _read_block_number(cursor: Cursor) -> str:
    """N10, or :10 for a main block."""
    token = cursor.token
    if cursor.accept(":"):
        digits = cursor.take().text
        _check_block_number(f":{digits}", digits)
        return f":{digits}"
    if token.kind == "din" and token.text[0] == "N" and cursor.after.text not in ("=", ":"):
        cursor.take()
        _check_block_number(token.text, token.text[1:])
        return f"N{int(token.text[1:])}"
    return ""


def _check_block_number(text: str, digits: str) -> None:
    if not digits.isdigit() or len(digits) > _LONGEST_NUMBER:
        raise IllegalBlock("E-LEGAL-BLOCK-NUMBER", text=text)


# The program.

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
class BlockReading:
    """What one block says wherever it stands, and what is wrong with it; ``works``: it is none of the head."""

    wrong: tuple[IllegalBlock, ...]
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
        self._known: dict[str, BlockReading] = {}

    def read(self, line: int, text: str) -> None:
        """One line of the program, counted from 1."""
        try:
            self._judge(line, text)
        except IllegalBlock as wrong:
            self._found.append(make_finding(line, wrong))

    def findings(self, lines: int) -> tuple[Finding, ...]:
        """Everything wrong, by line; asked once, when all ``lines`` are read."""
        return tuple(sorted({*self._found, *self._whole(lines)}))

    def _judge(self, line: int, text: str) -> None:
        text = text.rstrip("\r")
        if line == 1 and text.startswith("%"):
            self._headed = True
            check_header(text, self._name)
            return
        if text.lstrip().upper().startswith(";$PATH"):
            check_path(text, behind_header=self._headed and line == 2)
        if len(text) > LONGEST_BLOCK:
            self._blocks.append(_unreadable_block(line, text))
            raise IllegalBlock("E-LEGAL-LENGTH", length=len(text), limit=LONGEST_BLOCK)
        self._cut(line, text)

    def _cut(self, line: int, text: str) -> None:
        known = self._known.get(text)
        if known is None:
            try:
                found = tokenize(text)
            except IllegalBlock:
                self._blocks.append(_unreadable_block(line, text))
                raise
            if len(found) < len(("a word", "end")):
                return
            known = self._block(Cursor(found, self._scope), found)
            if _declares(found):
                self._known.clear()
            else:
                self._known[text] = known
        self._working = self._working or known.works
        self._found += [make_finding(line, wrong) for wrong in known.wrong]
        self._blocks.append(Block(line=line, head=known.head, word=known.word, jumps=known.jumps, ends=known.ends))

    def _block(self, cursor: Cursor, found: Sequence[Token]) -> BlockReading:
        place, steered, works = BlockHead(skipped=False, number="", label=""), "", False
        leaving: list[Jump] = []
        try:
            place = read_head(cursor)
            steered = _structure_word(cursor.token.text, found)
            _check_structure_head(place, steered)
            works = not cursor.at_end and cursor.token.text not in _DECLARING
            self._declare_or_work(cursor, leaving)
        except IllegalBlock as wrong:
            cursor.noted.append(wrong)
        return BlockReading(
            wrong=tuple(cursor.noted),
            head=place,
            word=steered,
            jumps=tuple(leaving),
            ends=_ends_program(found),
            works=works,
        )

    def _declare_or_work(self, cursor: Cursor, leaving: list[Jump]) -> None:
        if cursor.at_end:
            return
        if cursor.token.text in _DECLARING:
            self._declare(cursor)
        else:
            _read_block(cursor, leaving)

    def _declare(self, cursor: Cursor) -> None:
        if self._working:
            cursor.noted.append(IllegalBlock("E-LEGAL-LATE", word=cursor.token.text))
        kind = cursor.take().text
        if kind == "DEF":
            read_definition(cursor)
        elif kind == "PROC":
            self._procedure(cursor)
        else:
            (read_external if kind == "EXTERN" else read_macro)(cursor)

    def _procedure(self, cursor: Cursor) -> None:
        name = read_procedure(cursor)
        check_program_name(name)
        if self._name and bare_name(name) != bare_name(self._name):
            raise IllegalBlock("E-LEGAL-HEADER-NAME", given=name, name=self._name)

    def _whole(self, lines: int) -> Iterator[Finding]:
        yield from self._end(lines)
        paths, wrong = control_flow.check_structures([(block.line, block.word) for block in self._blocks])
        yield from wrong
        yield from self._names()
        yield from self._jumps([()] * len(paths) if wrong else paths)  # what is not closed has no inside

    def _end(self, lines: int) -> Iterator[Finding]:
        if not self._blocks:
            yield make_finding(max(1, lines), IllegalBlock("E-LEGAL-END"))
        elif not self._blocks[-1].ends:
            yield make_finding(self._blocks[-1].line, IllegalBlock("E-LEGAL-END"))

    def _names(self) -> Iterator[Finding]:
        """One name, one thing: no label twice, none that is a variable's or the program's."""
        taken = set(self._scope.variables) | ({bare_name(self._name)} if self._name else set())
        for block in self._blocks:
            label = block.head.label
            if label in taken:
                yield make_finding(block.line, IllegalBlock("E-LEGAL-TWICE", name=label))
            if label:
                taken.add(label)

    def _jumps(self, paths: list[control_flow.OpenPath]) -> Iterator[Finding]:
        places: defaultdict[str, list[tuple[int, control_flow.OpenPath]]] = defaultdict(list)
        departures: list[control_flow.PlacedJump] = []
        for block, path in zip(self._blocks, paths, strict=True):
            for name in (block.head.label, block.head.number):
                if name:
                    places[name].append((block.line, path))
            departures += [control_flow.PlacedJump(block.line, path, leap) for leap in block.jumps]
        yield from control_flow.check_jumps(departures, places)


def _declares(found: Sequence[Token]) -> bool:
    """Whether a word of the block may change what names mean after it; a label before it hides none."""
    return any(token.text in _DECLARING for token in found)


def _read_block(cursor: Cursor, leaving: list[Jump]) -> None:
    """Read the words of a block that does something."""
    statement = STATEMENTS.get(cursor.token.text)
    if statement is not None and cursor.token.kind == "name" and cursor.token.text not in cursor.scope.variables:
        cursor.take()
        leaving += statement(cursor)
        return
    commands = CommandGroups()
    while not cursor.at_end:
        if cursor.token.text in JUMPS:
            leaving += read_jump(cursor)
            cursor.ended()
        elif cursor.accept("IF"):
            leaving += read_if(cursor)
        else:
            read_word(cursor, commands)


def _structure_word(first: str, found: Sequence[Token]) -> str:
    """The word of a structure that this block is an element of; IF ... GOTO and REPEAT label are none."""
    if first not in control_flow.STRUCTURE_WORDS:
        return ""
    if first == "IF" and any(token.text in JUMPS for token in found):
        return ""
    if first == "REPEAT" and found[-2].text != "REPEAT":
        return ""
    return first


def _check_structure_head(place: BlockHead, steered: str) -> None:
    """Printed: blocks of a structure carry no label and are never skipped."""
    if steered and place.label:
        raise IllegalBlock("E-LEGAL-LABELLED", word=steered, label=place.label)
    if steered and place.skipped:
        raise IllegalBlock("E-LEGAL-SKIPPED", word=steered)


def _ends_program(found: Sequence[Token]) -> bool:
    """M2, M17, M30, RET, or a jump without condition."""
    if any(token.kind == "name" and token.text == "RET" for token in found):
        return True
    if any(token.kind == "din" and token.text[0] == "M" and _end_number(token.text[1:]) for token in found):
        return True
    words = {token.text for token in found if token.kind == "name"}
    return not words.isdisjoint(JUMPS) and words.isdisjoint({"IF", "CASE"})


def _end_number(digits: str) -> bool:
    return digits.isdigit() and len(digits) < 9 and int(digits) in _ENDS


def _unreadable_block(line: int, text: str) -> Block:
    """A block that could not be cut still opens or closes what its first word says, and may be the end."""
    match = _FIRST_WORD.match(text)
    first = match[1].upper() if match else ""
    jumping = "GOTO" in text.upper()
    steered = first if first in control_flow.STRUCTURE_WORDS and not (first == "IF" and jumping) else ""
    ends = re.search(r"\b(?:M0*(?:2|17|30)|RET)\b", text, re.IGNORECASE) is not None
    return Block(line=line, head=BlockHead(skipped=False, number="", label=""), word=steered, jumps=(), ends=ends)
