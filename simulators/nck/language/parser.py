"""The parser of the SINUMERIK 840D language subset: grammar, nodes, one block, a whole program.

The LALR grammar says what a block may look like, and nothing of what it means. Order of operators: Programming Manual
Job Planning, "Priority of the operations" (NOT, B_NOT; * / DIV MOD; + -; B_AND; B_XOR; B_OR; AND; XOR; OR; <<;
comparisons last), so two comparisons joined by AND need brackets. Lines get their labels and structures matched first;
blocks are parsed when they are reached.
"""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass, field
from typing import Any

import lark

from simulators.nck.language.syntax import (
    Address,
    Assign,
    BareWord,
    Binary,
    Block,
    Call,
    Case,
    Control,
    Declared,
    Define,
    Expression,
    Extern,
    IfJump,
    Indexed,
    Item,
    Jump,
    Name,
    NcSyntaxError,
    Number,
    OrdinaryBlock,
    Parameter,
    Proc,
    Procedure,
    Text,
    Unary,
    ValueList,
)

GRAMMAR = r"""
?start: words | control | "IF" expr jump -> if_jump | case | define | proc | extern

control: IF expr -> conditional | WHILE expr -> conditional | UNTIL expr -> conditional
       | (ELSE | ENDIF | ENDFOR | ENDWHILE | REPEAT | LOOP | ENDLOOP) -> structural
       | "FOR" target "=" expr "TO" expr -> counting
words: word* [jump]
?word: ADDRESS -> address
     | NAME -> bare
     | NAME "(" [args] ")" -> procedure
     | target "=" value -> assign
jump: (GOTOF | GOTOB | GOTO | GOTOC) NAME
case: "CASE" expr "OF" arm+ ["DEFAULT" jump]
arm: signed jump
signed: [MINUS] NUMBER
define: "DEF" NAME ["[" expr "]"] declared ("," declared)*
declared: NAME ["[" args "]"] ["=" value]
proc: "PROC" NAME ["(" [parameter ("," parameter)*] ")"] NAME*
parameter: [VAR] NAME ["[" expr "]"] NAME ["=" expr]
extern: "EXTERN" NAME ["(" [kind ("," kind)*] ")"]
kind: [VAR] NAME ["[" [expr] "]"]

target: NAME -> name | NAME "[" args "]" -> indexed | SYSVAR -> name | SYSVAR "[" args "]" -> indexed
?value: expr | "(" expr ("," expr)+ ")" -> listing
args: expr ("," expr)*

?expr: concat | concat COMPARE concat -> binary | expr_chain
expr_chain: concat COMPARE concat (COMPARE concat)+
?concat: or_ | concat SHL or_ -> binary | SHL or_ -> unary
?or_: xor_ | or_ OR xor_ -> binary
?xor_: and_ | xor_ XOR and_ -> binary
?and_: bor | and_ AND bor -> binary
?bor: bxor | bor B_OR bxor -> binary
?bxor: band | bxor B_XOR band -> binary
?band: sum | band B_AND sum -> binary
?sum: product | sum (PLUS | MINUS) product -> binary
?product: factor | product (TIMES | OVER | DIV | MOD) factor -> binary
?factor: atom | (MINUS | PLUS | NOT | B_NOT) factor -> unary
?atom: NUMBER -> number | RADIX -> radix | STRING -> text
     | NAME -> name | NAME "[" args "]" -> indexed | NAME "(" [args] ")" -> call
     | SYSVAR -> name | SYSVAR "[" args "]" -> indexed | "(" expr ")" -> bracket

IF: "IF"
WHILE: "WHILE"
UNTIL: "UNTIL"
ELSE: "ELSE"
ENDIF: "ENDIF"
ENDFOR: "ENDFOR"
ENDWHILE: "ENDWHILE"
REPEAT: "REPEAT"
LOOP: "LOOP"
ENDLOOP: "ENDLOOP"
GOTOF: "GOTOF"
GOTOB: "GOTOB"
GOTO: "GOTO"
GOTOC: "GOTOC"
VAR: "VAR"
OR: "OR"
XOR: "XOR"
AND: "AND"
B_OR: "B_OR"
B_XOR: "B_XOR"
B_AND: "B_AND"
NOT: "NOT"
B_NOT: "B_NOT"
DIV: "DIV"
MOD: "MOD"
PLUS: "+"
MINUS: "-"
TIMES: "*"
OVER: "/"
SHL.4: "<<"
COMPARE: "==" | "<>" | "<=" | ">=" | "<" | ">"
ADDRESS.3: /[A-Z] *[+-]? *(?:\d+\.?\d*|\.\d+)(?:EX[+-]?\d+)?(?![\d.]|\s*[=\[(])/
NUMBER: /(?:\d+\.?\d*|\.\d+)(?:EX[+-]?\d+)?/
RADIX: /'[HB][0-9A-F]+'/
STRING: /"[^"]*"/
SYSVAR: /\$[A-Z]{1,3}_[A-Z0-9_]+/
NAME: /[A-Z_][A-Z0-9_]*/
%ignore /[ \t]+/
"""


# Parse results become nodes while the text is parsed, so nothing recurses afterwards. A chain of comparisons is
# refused here (12180) where the control would silently compute something else.


class NodeRefused(Exception):
    """A node that cannot stand; carries reason and alarm number out of the parser's callbacks."""

    def __init__(self, reason: str, number: int = 12080) -> None:
        super().__init__(reason)
        self.reason = reason
        self.number = number


def _number(text: str) -> int | float:
    if text.isdecimal():
        value = int(text)
        if value < 2**31:
            return value
        return float(value)
    mantissa, _, power = text.partition("EX")
    if power and abs(int(power)) > 300:
        raise NodeRefused(f"{text} lies beyond the range of REAL", 12160)
    return float(f"{mantissa}e{power or 0}")


class Nodes:
    """One method for each rule of the grammar."""

    def words(self, items: list[Any]) -> OrdinaryBlock:
        jump = items.pop() if items else None
        return OrdinaryBlock(tuple(items), jump)

    def address(self, items: list[Any]) -> Item:
        text = str(items[0]).replace(" ", "")
        sign = -1 if text[1] == "-" else 1
        return Address(text[0], sign * _number(text[1:].lstrip("+-")))

    def bare(self, items: list[Any]) -> Item:
        return BareWord(str(items[0]))

    def procedure(self, items: list[Any]) -> Item:
        return Procedure(str(items[0]), items[1] or ())

    def assign(self, items: list[Any]) -> Item:
        return Assign(items[0], items[1])

    def jump(self, items: list[Any]) -> Jump:
        return Jump(str(items[0]), str(items[1]))

    def if_jump(self, items: list[Any]) -> Block:
        return IfJump(items[0], items[1])

    def conditional(self, items: list[Any]) -> Block:
        return Control(str(items[0]), condition=items[1])

    def structural(self, items: list[Any]) -> Block:
        return Control(str(items[0]))

    def counting(self, items: list[Any]) -> Block:
        return Control("FOR", condition=items[2], target=items[0], start=items[1])

    def case(self, items: list[Any]) -> Block:
        return Case(items[0], tuple(items[1:-1]), items[-1])

    def arm(self, items: list[Any]) -> tuple[int | float, Jump]:
        return items[0], items[1]

    def signed(self, items: list[Any]) -> int | float:
        value = _number(str(items[1]))
        return -value if items[0] else value

    def define(self, items: list[Any]) -> Block:
        return Define(str(items[0]), items[1], tuple(items[2:]))

    def declared(self, items: list[Any]) -> Declared:
        return Declared(str(items[0]), items[1] or (), items[2])

    def proc(self, items: list[Any]) -> Block:
        return Proc(str(items[0]), tuple(item for item in items if isinstance(item, Parameter)))

    def parameter(self, items: list[Any]) -> Parameter:
        return Parameter(str(items[1]), str(items[3]), items[0] is not None, items[4])

    def extern(self, items: list[Any]) -> Block:
        return Extern(str(items[0]))

    def kind(self, items: list[Any]) -> str:
        return str(items[1])

    def listing(self, items: list[Any]) -> Expression:
        return ValueList(tuple(items))

    def args(self, items: list[Any]) -> tuple[Expression, ...]:
        return tuple(items)

    def name(self, items: list[Any]) -> Name:
        return Name(str(items[0]))

    def indexed(self, items: list[Any]) -> Indexed:
        return Indexed(str(items[0]), items[1])

    def call(self, items: list[Any]) -> Expression:
        return Call(str(items[0]), items[1] or ())

    def number(self, items: list[Any]) -> Expression:
        return Number(_number(str(items[0])))

    def radix(self, items: list[Any]) -> Expression:
        """Raises NodeRefused for digits that the radix does not have."""
        text = str(items[0])
        try:
            return Number(int(text[2:-1], 16 if text[1] == "H" else 2))
        except ValueError as error:
            raise NodeRefused(f"{text} is no number") from error

    def text(self, items: list[Any]) -> Expression:
        return Text(str(items[0])[1:-1])

    def bracket(self, items: list[Any]) -> Expression:
        found: Expression = items[0]
        return found

    def unary(self, items: list[Any]) -> Expression:
        return Unary(str(items[0]), items[1])

    def binary(self, items: list[Any]) -> Expression:
        return Binary(str(items[1]), items[0], items[2])

    def expr_chain(self, _items: list[Any]) -> Expression:
        raise NodeRefused("comparisons bind last: put each in brackets", 12180)


# One block, within limits of length and depth.

BLOCK_LIMIT = 512
DEPTH_LIMIT = 60


class _Builder(Nodes, lark.Transformer):
    """The parser calls it while it reads."""


@functools.cache
def _parser() -> lark.Lark:
    return lark.Lark(GRAMMAR, parser="lalr", lexer="contextual", transformer=_Builder(), maybe_placeholders=True)


@functools.lru_cache(maxsize=4096)
def _read(text: str) -> Block:
    """Parse, once for each text: programs repeat themselves, and nodes are frozen."""
    block: Block = _parser().parse(text)
    return block


def _too_deep(text: str) -> bool:
    depth = deepest = run = longest = 0
    for sign in text:
        if sign in "([":
            depth += 1
        elif sign in ")]":
            depth -= 1
        run = run + 1 if sign in "+-" else 0 if sign != " " else run
        deepest, longest = max(deepest, depth), max(longest, run)
    return deepest > DEPTH_LIMIT or longest > DEPTH_LIMIT or text.count("NOT") > DEPTH_LIMIT


def parse_block(text: str, line: int = 1) -> Block:
    """Parse one block: upper case outside strings, without comment, number and label.

    Raises NcSyntaxError (with ``line``) when the text is no block of the subset, too long or too deep.
    """
    if len(text) > BLOCK_LIMIT or _too_deep(text):
        raise NcSyntaxError(line, "block is too long or too complex", 12540)
    try:
        return _read(text)
    except lark.exceptions.VisitError as error:
        raise _translated(error.orig_exc, line) from error
    except NodeRefused as error:
        raise _translated(error, line) from error
    except lark.exceptions.UnexpectedInput as error:
        column = error.column if isinstance(error.column, int) else 0
        near = text[max(column - 1, 0) : max(column - 1, 0) + 20] if column > 0 else "end of block"
        raise NcSyntaxError(line, f"syntax error at {near!r}") from error


def _translated(error: Exception, line: int) -> NcSyntaxError:
    if isinstance(error, NodeRefused):
        return NcSyntaxError(line, error.reason, error.number)
    return NcSyntaxError(line, f"syntax error: {error}")


# A whole program. `parse` reads everything at once and raises on the first block it cannot read. `outline_program`
# reads only the frame, as the control does: a block with an error stops the program when it is reached, not before.

__all__ = ["NcSyntaxError", "Program", "SourceLine", "outline_program", "parse"]

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


def outline_program(text: str) -> Program:
    """Read the frame of a program: comments, labels, structures. Raises NcSyntaxError."""
    lines = tuple(_read_line(line, index) for index, line in enumerate(text.splitlines()))
    return Program(lines, _match_structures(lines), _labels(lines))


def parse(text: str) -> Program:
    """Read a whole program, every block of it. Raises NcSyntaxError with the first bad line."""
    program = outline_program(text)
    for index in range(len(program.lines)):
        program.block(index)
    return program
