"""What steers a program: jumps and statements in a block, then structures and labels over all blocks.

A block only says which word it is and where it jumps to. `check_structures` keeps a stack of open structures and gives
each block the path of those it lies in; `check_jumps` compares the path of a jump with that of its label: a target is
legal when its path is a beginning of the jump's own path, that is, when the jump leads out of structures, never into
one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from drivers.message import Message
from drivers.sinumerik.legality.expressions import (
    NUMERIC,
    UNKNOWN,
    check_assignment,
    read_condition,
    read_expression,
    read_r_parameter,
    read_user_variable,
)
from drivers.sinumerik.legality.lexer import Cursor, Finding, IllegalBlock, make_finding

# Jumps and statements of one block.

JUMPS = frozenset({"GOTO", "GOTOF", "GOTOB", "GOTOC", "GOTOS"})
_COUNTING = frozenset({"INT", "REAL", UNKNOWN})


class Jump(NamedTuple):
    """Which word jumps, and to which label or block number."""

    word: str
    target: str


def read_if(cursor: Cursor) -> list[Jump]:
    """IF condition: alone it opens a structure; before GOTO it is one block with it."""
    read_condition(cursor)
    found: list[Jump] = []
    while cursor.token.text in JUMPS:
        found += read_jump(cursor)
        if not cursor.accept("IF"):
            break
        read_condition(cursor)
        if cursor.token.text not in JUMPS:
            raise cursor.wrong("GOTO")
    cursor.ended()
    return found


def read_jump(cursor: Cursor) -> list[Jump]:
    """GOTOF label, GOTOB N10, GOTO text variable (unjudged), GOTOS."""
    kind = cursor.take().text
    if kind == "GOTOS":
        return []
    return _read_target(cursor, kind)


def read_case(cursor: Cursor) -> list[Jump]:
    """CASE (value) OF constant GOTOF label ... DEFAULT GOTOF label."""
    read_expression(cursor)
    cursor.expect("OF")
    found: list[Jump] = []
    while not cursor.at_end:
        last = cursor.accept("DEFAULT")
        if not last:
            check_assignment("REAL", "CASE", read_expression(cursor))
        if cursor.token.text not in JUMPS:
            raise cursor.wrong("GOTO")
        found += read_jump(cursor)
        if last:
            cursor.ended()
    if not found:
        raise cursor.wrong(Message.of("W-NC-VALUE-GOTO"))
    return found


def read_repeat(cursor: Cursor) -> list[Jump]:
    """REPEAT alone opens a structure; REPEAT label [label] [P=n] and REPEATB label repeat what is marked."""
    found: list[Jump] = []
    while cursor.token.kind == "name" and cursor.token.text != "P":
        found += _read_target(cursor, "REPEAT")
    if cursor.accept("P"):
        cursor.expect("=")
        check_assignment("INT", "P", read_expression(cursor))
    elif cursor.token.kind == "din" and cursor.token.text[0] == "P":
        cursor.take()  # P3
    cursor.ended()
    return found


def _read_for(cursor: Cursor) -> list[Jump]:
    """FOR variable = first TO last; the variable counts, so it is INT, REAL or an R parameter."""
    text = cursor.token.text
    if text in cursor.scope.variables:
        kind = read_user_variable(cursor, read_expression)
    elif text == "R" or (cursor.token.kind == "din" and text[0] == "R"):
        kind = read_r_parameter(cursor, read_expression)
    elif cursor.token.kind == "name":
        raise IllegalBlock("E-LEGAL-UNDEFINED", name=text)
    else:
        raise cursor.wrong(Message.of("W-NC-COUNTER"))
    if kind not in _COUNTING:
        raise IllegalBlock("E-LEGAL-FOR", name=text, given=kind)
    cursor.expect("=")
    _check_number_type(read_expression(cursor), text)
    cursor.expect("TO")
    _check_number_type(read_expression(cursor), text)
    cursor.ended()
    return []


def _check_number_type(kind: str, name: str) -> None:
    if kind not in NUMERIC and kind != UNKNOWN:
        raise IllegalBlock("E-LEGAL-TYPE", name=name, target="REAL", given=kind)


def _read_while(cursor: Cursor) -> list[Jump]:
    read_condition(cursor)
    cursor.ended()
    return []


def _read_alone(cursor: Cursor) -> list[Jump]:
    cursor.ended()
    return []


def _read_target(cursor: Cursor, kind: str) -> list[Jump]:
    """A label, N10 or :10; a STRING variable names its label when the program runs."""
    if cursor.accept(":"):
        return [Jump(kind, f":{cursor.take().text}")]
    token = cursor.token
    if token.kind not in ("name", "din"):
        raise cursor.wrong("a label")
    if token.text in cursor.scope.variables:
        read_user_variable(cursor, read_expression)
        return []
    cursor.take()
    return [Jump(kind, token.text)]


STATEMENTS: Mapping[str, Callable[[Cursor], list[Jump]]] = {
    "IF": read_if,
    "WHILE": _read_while,
    "UNTIL": _read_while,
    "FOR": _read_for,
    "CASE": read_case,
    "REPEAT": read_repeat,
    "REPEATB": read_repeat,
    **dict.fromkeys(("ELSE", "ENDIF", "ENDFOR", "ENDWHILE", "LOOP", "ENDLOOP"), _read_alone),
}


# IF, FOR, WHILE, LOOP and REPEAT: every one closed, by its own word, in order, not too deep.

DEEPEST_STRUCTURE = 16
CLOSED_BY = {"IF": "ENDIF", "FOR": "ENDFOR", "WHILE": "ENDWHILE", "LOOP": "ENDLOOP", "REPEAT": "UNTIL"}
_OPENED_BY = {closer: opener for opener, closer in CLOSED_BY.items()}
STRUCTURE_WORDS = frozenset(CLOSED_BY) | frozenset(_OPENED_BY) | {"ELSE"}


class OpenStructure(NamedTuple):
    """A structure that stands open: its word, its line, 1 behind ELSE."""

    word: str
    line: int
    branch: int


OpenPath = tuple[OpenStructure, ...]


def check_structures(events: Sequence[tuple[int, str]]) -> tuple[list[OpenPath], list[Finding]]:
    """The structures that are open behind each (line, word), and what is wrong with them."""
    stack: list[OpenStructure] = []
    paths: list[OpenPath] = []
    findings: list[Finding] = []
    for line, word in events:
        findings += [make_finding(place, wrong) for place, wrong in _follow(stack, line, word)]
        paths.append(tuple(stack))
    findings += [make_finding(left.line, _unclosed(left)) for left in stack]
    return paths, findings


def _follow(stack: list[OpenStructure], line: int, word: str) -> Iterator[tuple[int, IllegalBlock]]:
    if word in CLOSED_BY:
        stack.append(OpenStructure(word, line, 0))
        if len(stack) > DEEPEST_STRUCTURE:
            yield line, IllegalBlock("E-LEGAL-DEPTH", depth=len(stack), limit=DEEPEST_STRUCTURE)
    elif word == "ELSE":
        yield from _follow_else(stack, line)
    elif word in _OPENED_BY:
        yield from _follow_close(stack, line, word)


def _follow_else(stack: list[OpenStructure], line: int) -> Iterator[tuple[int, IllegalBlock]]:
    if not stack or stack[-1].word != "IF" or stack[-1].branch:
        yield line, IllegalBlock("E-LEGAL-ELSE")
    else:
        stack[-1] = stack[-1]._replace(branch=1)


def _follow_close(stack: list[OpenStructure], line: int, word: str) -> Iterator[tuple[int, IllegalBlock]]:
    """Close the nearest structure of this kind; what stands open inside it was forgotten."""
    opener = _OPENED_BY[word]
    if not any(item.word == opener for item in stack):
        yield line, IllegalBlock("E-LEGAL-CLOSE", word=word, opener=opener)
        return
    while stack[-1].word != opener:
        left = stack.pop()
        yield left.line, _unclosed(left)
    stack.pop()


def _unclosed(left: OpenStructure) -> IllegalBlock:
    return IllegalBlock("E-LEGAL-UNCLOSED", word=left.word, closer=CLOSED_BY[left.word])


# Labels and the jumps to them: there, in the right direction, not into a structure.

LabelPlaces = Mapping[str, Sequence[tuple[int, OpenPath]]]  # label: the lines where it stands, and what is open there


@dataclass(frozen=True)
class PlacedJump:
    """A jump with its line and the structures that are open there."""

    line: int
    path: OpenPath
    jump: Jump


def check_jumps(departures: Sequence[PlacedJump], places: LabelPlaces) -> Iterator[Finding]:
    """Everything wrong with these jumps."""
    for departure in departures:
        wrong = _check_jump(departure, places.get(departure.jump.target, ()))
        if wrong is not None:
            yield make_finding(departure.line, wrong)


def _check_jump(departure: PlacedJump, there: Sequence[tuple[int, OpenPath]]) -> IllegalBlock | None:
    word, target = departure.jump
    if not there:
        return None if word == "GOTOC" else IllegalBlock("E-LEGAL-LABEL", word=word, label=target)
    reached = [(line, path) for line, path in there if _is_in_direction(word, departure.line, line)]
    if not reached:
        return IllegalBlock("E-LEGAL-DIRECTION", word=word, label=target, line=there[0][0])
    if all(path != departure.path[: len(path)] for _, path in reached):
        return IllegalBlock("E-LEGAL-INTO", word=word, label=target, structure=reached[0][1][-1].word)
    return None


def _is_in_direction(word: str, here: int, there: int) -> bool:
    """GOTOF looks below, GOTOB above (its own block included), every other word everywhere."""
    if word == "GOTOF":
        return there > here
    return word != "GOTOB" or there <= here
