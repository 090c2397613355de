"""Expressions by the printed priority of operators, their types with them."""

from __future__ import annotations

from drivers.sinumerik.legality.cursor import Cursor
from drivers.sinumerik.legality.dictionary import dictionary
from drivers.sinumerik.legality.findings import Illegal
from drivers.sinumerik.legality.functions import SIGNATURES, judge_values
from drivers.sinumerik.legality.names import judge_file_name
from drivers.sinumerik.legality.types import UNKNOWN, arithmetic, judge_comparison, judge_operand
from drivers.sinumerik.legality.variables import parameter, system_variable, user_variable

COMPARISONS = frozenset({"==", "<>", "<", ">", "<=", ">="})
_LOGIC = frozenset({"AND", "OR", "XOR"})
_COMPARING, _CHAINING, _PRODUCT = 0, 1, 9
_PRIORITY = {  # printed, strongest first; a comparison binds weakest of all
    **dict.fromkeys(("*", "/", "DIV", "MOD"), _PRODUCT),
    **dict.fromkeys(("+", "-"), 8),
    "B_AND": 7,
    "B_XOR": 6,
    "B_OR": 5,
    "AND": 4,
    "XOR": 3,
    "OR": 2,
    "<<": _CHAINING,
    **dict.fromkeys(COMPARISONS, _COMPARING),
}
_CONSTANTS = {"TRUE": "BOOL", "FALSE": "BOOL", "NO_AXIS": "AXIS"}
_AXIS_PARTS = frozenset({"TR", "FI", "RT", "SC", "MI"})


def expression(cursor: Cursor) -> str:
    """Read one expression and return its type ("?" where it cannot be known). Raises Illegal."""
    kind, _ = _operation(cursor, _COMPARING)
    while kind in ("FRAME", UNKNOWN) and cursor.accept(":"):  # frames are chained
        _operation(cursor, _COMPARING)
    if cursor.sees("="):
        raise Illegal("E-LEGAL-OPERATOR", operator="=", wanted="==")
    return kind


def condition(cursor: Cursor) -> None:
    """An expression that is true or false. Raises Illegal for one that is neither."""
    judge_operand("a condition", expression(cursor), text=True)


def values(cursor: Cursor) -> list[str]:
    """The values of a call in round brackets; places may be left empty. Returns their types."""
    cursor.expect("(")
    given: list[str] = []
    if cursor.accept(")"):
        return given
    while True:
        given.append(UNKNOWN if cursor.sees(",", ")") else expression(cursor))
        if not cursor.accept(","):
            break
    cursor.expect(")")
    return given


def _operation(cursor: Cursor, floor: int) -> tuple[str, str]:
    """Read operators at least as strong as ``floor``; returns the type and the weakest operator used."""
    kind, used = _operand(cursor)
    while (operator := cursor.token.text) in _PRIORITY and cursor.token.kind in ("op", "name"):
        priority = _PRIORITY[operator]
        if priority < floor:
            break
        cursor.take()
        right, used_right = _operation(cursor, priority + 1)
        if priority == _COMPARING:
            _judge_brackets(operator, used, used_right)
        kind, used = _combine(operator, kind, right), operator
    _refuse_foreign(cursor)
    return kind, used


def _judge_brackets(operator: str, left: str, right: str) -> None:
    """A == 1 AND B == 2 reads A == (1 AND B) == 2: nobody means that."""
    for other in (left, right):
        if other in _LOGIC or other in COMPARISONS or other == "NOT":
            raise Illegal("E-LEGAL-PRIORITY", operator=operator, other=other)


def _refuse_foreign(cursor: Cursor) -> None:
    """Signs that other languages use where this one has its own."""
    pair = cursor.token.text + cursor.after.text
    if pair in ("=>", "=<", "=="):
        raise Illegal("E-LEGAL-OPERATOR", operator=pair, wanted=">= <= ==")


def _combine(operator: str, left: str, right: str) -> str:
    if operator in COMPARISONS:
        judge_comparison(operator, left, right)
        return "BOOL"
    if operator == "<<":
        judge_operand(operator, left, text=True)
        judge_operand(operator, right, text=True)
        return "STRING"
    if operator in _LOGIC:
        judge_operand(operator, left)
        judge_operand(operator, right)
        return "BOOL"
    return arithmetic(operator, left, right)


def _operand(cursor: Cursor) -> tuple[str, str]:
    """One operand with its signs; the second item is "NOT" where that stood before it."""
    if cursor.sees("NOT", "B_NOT"):
        operator = cursor.take().text
        kind, _ = _operand(cursor)
        judge_operand(operator, kind)
        doubtful = operator == "NOT" and kind != "BOOL"  # NOT R1 == 2 reads (NOT R1) == 2
        return ("BOOL" if operator == "NOT" else "INT"), "NOT" if doubtful else ""
    if cursor.sees("-", "+"):
        return _signed(cursor), ""
    if cursor.accept("<<"):
        if cursor.sees("<<"):
            raise cursor.wrong("a value")
        kind, _ = _operation(cursor, _CHAINING + 1)
        judge_operand("<<", kind, text=True)
        return "STRING", "<<"
    return _value(cursor), ""


def _signed(cursor: Cursor) -> str:
    sign = ""
    while cursor.sees("-", "+"):
        sign = cursor.take().text
    kind, _ = _operand(cursor)
    judge_operand(sign, kind)
    return kind


def _value(cursor: Cursor) -> str:
    token = cursor.token
    if token.kind == "number":
        cursor.take()
        return "REAL" if "." in token.text or "EX" in token.text else "INT"
    if token.kind in ("string", "constant"):
        cursor.take()
        return "STRING" if token.kind == "string" else "INT"
    if token.kind == "variable":
        return system_variable(cursor, expression)
    if token.kind == "din":
        return _numbered(cursor)
    if token.kind == "name":
        return _named(cursor)
    return _bracketed(cursor)


def _bracketed(cursor: Cursor) -> str:
    if not cursor.sees("("):
        raise cursor.wrong("a value")
    cursor.take()
    kind = expression(cursor)
    cursor.expect(")")
    return kind


def _numbered(cursor: Cursor) -> str:
    """R10 is a parameter, X1 an axis; any other letter with a number is no value."""
    text = cursor.token.text
    if text[0] == "R":
        return parameter(cursor, expression)
    if not cursor.scope.is_axis(text):
        raise cursor.wrong("a value")
    cursor.take()
    return "AXIS"


def _named(cursor: Cursor) -> str:
    text = cursor.token.text
    if text in cursor.scope.variables:
        return user_variable(cursor, expression)
    if text == "R":
        return parameter(cursor, expression)
    if cursor.after.text == "(" and cursor.after.kind == "op":
        return _call(cursor)
    if text in _CONSTANTS or text in _AXIS_PARTS:
        cursor.take()
        return _CONSTANTS.get(text, UNKNOWN)
    if cursor.scope.is_axis(text):
        cursor.take()
        return "AXIS"
    return _foreign(cursor)


def _foreign(cursor: Cursor) -> str:
    text = cursor.token.text
    if text in cursor.scope.macros or text in dictionary().data:
        cursor.take()
        return UNKNOWN
    if text in dictionary().reserved:
        raise cursor.wrong("a value")
    raise Illegal("E-LEGAL-UNDEFINED", name=text)


def _call(cursor: Cursor) -> str:
    name = cursor.token.text
    if name not in dictionary().functions:
        known = name in dictionary().reserved
        raise cursor.wrong("a function") if known else Illegal("E-LEGAL-WORD", word=name)
    cursor.take()
    parts = cursor.arguments()
    given = values(cursor)
    signature = SIGNATURES.get(name)
    if signature is None:
        return UNKNOWN
    judge_values(name, signature, given)
    if name == "ISFILE" and parts[0][0].kind == "string" and len(parts[0]) == 1:
        judge_file_name(parts[0][0].text[1:-1])
    return signature.gives
