"""The statements that steer a program: structures, jumps, repetitions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from drivers.sinumerik.legality.cursor import Cursor
from drivers.sinumerik.legality.expressions import condition, expression
from drivers.sinumerik.legality.findings import Illegal
from drivers.sinumerik.legality.types import NUMERIC, UNKNOWN, judge_assignment
from drivers.sinumerik.legality.variables import parameter, user_variable

JUMPS = frozenset({"GOTO", "GOTOF", "GOTOB", "GOTOC", "GOTOS"})
_COUNTING = frozenset({"INT", "REAL", UNKNOWN})


class Jump(NamedTuple):
    """Which word jumps, and to which label or block number."""

    word: str
    target: str


def conditional(cursor: Cursor) -> list[Jump]:
    """IF condition: alone it opens a structure; before GOTO it is one block with it."""
    condition(cursor)
    found: list[Jump] = []
    while cursor.token.text in JUMPS:
        found += jump(cursor)
        if not cursor.accept("IF"):
            break
        condition(cursor)
        if cursor.token.text not in JUMPS:
            raise cursor.wrong("GOTO")
    cursor.ended()
    return found


def jump(cursor: Cursor) -> list[Jump]:
    """GOTOF label, GOTOB N10, GOTO text variable (unjudged), GOTOS."""
    kind = cursor.take().text
    if kind == "GOTOS":
        return []
    return _target(cursor, kind)


def case(cursor: Cursor) -> list[Jump]:
    """CASE (value) OF constant GOTOF label ... DEFAULT GOTOF label."""
    expression(cursor)
    cursor.expect("OF")
    found: list[Jump] = []
    while not cursor.at_end:
        last = cursor.accept("DEFAULT")
        if not last:
            judge_assignment("REAL", "CASE", expression(cursor))
        if cursor.token.text not in JUMPS:
            raise cursor.wrong("GOTO")
        found += jump(cursor)
        if last:
            cursor.ended()
    if not found:
        raise cursor.wrong("a value and GOTO")
    return found


def repetition(cursor: Cursor) -> list[Jump]:
    """REPEAT alone opens a structure; REPEAT label [label] [P=n] and REPEATB label repeat what is marked."""
    found: list[Jump] = []
    while cursor.token.kind == "name" and cursor.token.text != "P":
        found += _target(cursor, "REPEAT")
    if cursor.accept("P"):
        cursor.expect("=")
        judge_assignment("INT", "P", expression(cursor))
    elif cursor.token.kind == "din" and cursor.token.text[0] == "P":
        cursor.take()  # P3
    cursor.ended()
    return found


def _counting(cursor: Cursor) -> list[Jump]:
    """FOR variable = first TO last; the variable counts, so it is INT, REAL or an R parameter."""
    text = cursor.token.text
    if text in cursor.scope.variables:
        kind = user_variable(cursor, expression)
    elif text == "R" or (cursor.token.kind == "din" and text[0] == "R"):
        kind = parameter(cursor, expression)
    elif cursor.token.kind == "name":
        raise Illegal("E-LEGAL-UNDEFINED", name=text)
    else:
        raise cursor.wrong("a variable that counts")
    if kind not in _COUNTING:
        raise Illegal("E-LEGAL-FOR", name=text, given=kind)
    cursor.expect("=")
    _number(expression(cursor), text)
    cursor.expect("TO")
    _number(expression(cursor), text)
    cursor.ended()
    return []


def _number(kind: str, name: str) -> None:
    if kind not in NUMERIC and kind != UNKNOWN:
        raise Illegal("E-LEGAL-TYPE", name=name, target="REAL", given=kind)


def _while(cursor: Cursor) -> list[Jump]:
    condition(cursor)
    cursor.ended()
    return []


def _alone(cursor: Cursor) -> list[Jump]:
    cursor.ended()
    return []


def _target(cursor: Cursor, kind: str) -> list[Jump]:
    """A label, N10 or :10; a STRING variable names its label when the program runs."""
    if cursor.accept(":"):
        return [Jump(kind, f":{cursor.take().text}")]
    token = cursor.token
    if token.kind not in ("name", "din"):
        raise cursor.wrong("a label")
    if token.text in cursor.scope.variables:
        user_variable(cursor, expression)
        return []
    cursor.take()
    return [Jump(kind, token.text)]


STATEMENTS: Mapping[str, Callable[[Cursor], list[Jump]]] = {
    "IF": conditional,
    "WHILE": _while,
    "UNTIL": _while,
    "FOR": _counting,
    "CASE": case,
    "REPEAT": repetition,
    "REPEATB": repetition,
    **dict.fromkeys(("ELSE", "ENDIF", "ENDFOR", "ENDWHILE", "LOOP", "ENDLOOP"), _alone),
}
