"""Expressions and functions of the NC language, compiled once for each block into closures over a scope.

Functions here need nothing but their arguments; those that need the control are in `names`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import Protocol

from simulators.nck.language.syntax import Binary, Call, Expression, Indexed, Name, Number, Text, Unary, ValueList
from simulators.nck.spec import NckRefusal
from simulators.nck.values import Value, compare, concatenate, format_value, to_bool, to_int, to_number, to_real

Function = Callable[[Sequence[Value]], Value]


def _one(work: Callable[[float], float]) -> tuple[int, int, Function]:
    return 1, 1, lambda given: work(to_real(given[0]))


def _text(value: Value) -> str:
    if not isinstance(value, str):
        raise NckRefusal(12330, "parameter must be text")
    return str(value)


def _tangent(degrees: float) -> float:
    if abs(math.cos(math.radians(degrees))) < 1e-15:
        raise NckRefusal(14092, "TAN is not defined there")
    return math.tan(math.radians(degrees))


def _is_number(given: Sequence[Value]) -> bool:
    try:
        _from_text(given)
    except NckRefusal:
        return False
    return True


def _from_text(given: Sequence[Value]) -> float:
    mantissa, _, power = _text(given[0]).strip().upper().partition("EX")
    if not mantissa or set(mantissa + power) - set("0123456789+-."):
        raise NckRefusal(12160, "text is no number")
    try:
        return to_real(float(f"{mantissa}e{power or 0}"))
    except ValueError as error:
        raise NckRefusal(12160, "text is no number") from error


def _part(given: Sequence[Value]) -> str:
    text, start = _text(given[0]), to_int(given[1])
    count = to_int(given[2]) if len(given) > 2 else len(text)
    if start < 0 or count < 0:
        raise NckRefusal(12160, "SUBSTR outside the text")
    return text[start : start + count]


def _bound(given: Sequence[Value]) -> Value:
    low, high, value = (to_number(item) for item in given)
    return min(max(value, low), high)


def _absolute(given: Sequence[Value]) -> Value:
    value = to_number(given[0])
    return abs(value)


FUNCTIONS: dict[str, tuple[int, int, Function]] = {
    "SIN": _one(lambda x: math.sin(math.radians(x))),
    "COS": _one(lambda x: math.cos(math.radians(x))),
    "TAN": _one(_tangent),
    "ASIN": _one(lambda x: math.degrees(math.asin(x))),
    "ACOS": _one(lambda x: math.degrees(math.acos(x))),
    "ATAN2": (2, 2, lambda given: math.degrees(math.atan2(to_real(given[0]), to_real(given[1])))),
    "SQRT": _one(math.sqrt),
    "POT": _one(lambda x: x * x),
    "LN": _one(math.log),
    "EXP": _one(math.exp),
    "ABS": (1, 1, _absolute),
    "ROUND": _one(lambda x: float(math.floor(x + 0.5))),
    "ROUNDUP": _one(lambda x: float(math.ceil(x))),
    "TRUNC": _one(lambda x: float(math.trunc(x))),
    "MINVAL": (2, 2, lambda given: min(to_number(given[0]), to_number(given[1]))),
    "MAXVAL": (2, 2, lambda given: max(to_number(given[0]), to_number(given[1]))),
    "BOUND": (3, 3, _bound),
    "STRLEN": (1, 1, lambda given: len(_text(given[0]))),
    "INDEX": (2, 2, lambda given: _text(given[0]).find(_text(given[1])[:1] or "\0")),
    "RINDEX": (2, 2, lambda given: _text(given[0]).rfind(_text(given[1])[:1] or "\0")),
    "MINDEX": (2, 2, lambda given: _first_of(_text(given[0]), _text(given[1]))),
    "MATCH": (2, 2, lambda given: _text(given[0]).find(_text(given[1]))),
    "SUBSTR": (2, 3, _part),
    "TOUPPER": (1, 1, lambda given: _text(given[0]).upper()),
    "TOLOWER": (1, 1, lambda given: _text(given[0]).lower()),
    "ISNUMBER": (1, 1, _is_number),
    "NUMBER": (1, 1, _from_text),
}


def _first_of(text: str, signs: str) -> int:
    places = [text.find(sign) for sign in signs if sign in text]
    return min(places) if places else -1


def call_function(name: str, given: Sequence[Value]) -> Value:
    """The value of a function. Raises NckRefusal: 12340 (parameters), 14092 (not defined there), 12160."""
    fewest, most, work = FUNCTIONS[name]
    if not fewest <= len(given) <= most:
        raise NckRefusal(12340, f"{name} takes {fewest} parameters, not {len(given)}")
    try:
        value = work(given)
    except (ValueError, ZeroDivisionError) as error:
        raise NckRefusal(14092, f"{name} is not defined for {format_value(given[0])}") from error
    except OverflowError as error:
        raise NckRefusal(12160, f"{name}: value lies beyond the value range") from error
    return value


def apply_operator(operator: str, left: Value, right: Value) -> Value:
    """An arithmetic or logical operation. Raises NckRefusal 12150, 12160, 14092 (division by zero)."""
    if operator in ("AND", "OR", "XOR"):
        one, two = to_bool(left), to_bool(right)
        return (one and two) if operator == "AND" else (one or two) if operator == "OR" else one != two
    if operator.startswith("B_"):
        return _bits(operator, to_int(left), to_int(right))
    a, b = to_number(left), to_number(right)
    if operator == "+":
        return _limited(a + b)
    if operator == "-":
        return _limited(a - b)
    if operator == "*":
        return _limited(a * b)
    if b == 0:
        raise NckRefusal(14092, "division by zero")
    if operator == "/":
        return _limited(a / b)
    return _limited(math.trunc(a / b)) if operator == "DIV" else _remainder(a, b)


def _remainder(a: int | float, b: int | float) -> int | float:
    rest = math.fmod(a, b)
    return int(rest) if isinstance(a, int) and isinstance(b, int) else rest


def _limited(value: int | float) -> int | float:
    if isinstance(value, int) and abs(value) > 2**31:
        return float(value)
    if isinstance(value, float) and not math.isfinite(value):
        raise NckRefusal(12160, "value lies beyond the value range of REAL")
    return value


def _bits(operator: str, left: int, right: int) -> int:
    if operator == "B_AND":
        return left & right
    return left | right if operator == "B_OR" else left ^ right


# Compilation.

COMPARISONS = frozenset({"==", "<>", "<", ">", "<=", ">="})
R_NAME = re.compile(r"R(\d{1,5})")


class Scope(Protocol):
    """What an expression may ask of its surroundings."""

    def variable(self, name: str, indices: tuple[Value, ...]) -> Value:
        """A local variable, R parameter, ``$`` variable or axis by name. Raises NckRefusal 12550."""
        ...

    def function(self, name: str, given: tuple[Value, ...]) -> Value:
        """A function that needs the machine (ISFILE, AXNAME ...). Raises NckRefusal 12550."""
        ...


Evaluate = Callable[[Scope], Value]


def compile_expression(node: Expression) -> Evaluate:
    """The closure that evaluates an expression."""
    if isinstance(node, Number | Text):
        constant: Value = node.value
        return lambda _scope: constant
    if isinstance(node, Name):
        return _name(node.name)
    if isinstance(node, Indexed):
        return _indexed(node)
    if isinstance(node, Call):
        return _call(node)
    if isinstance(node, Unary):
        return _unary(node)
    if isinstance(node, ValueList):
        raise NckRefusal(12150, "a list of values stands in assignments to arrays only")
    return _binary(node)


def _name(name: str) -> Evaluate:
    if name in ("TRUE", "FALSE"):
        flag = name == "TRUE"
        return lambda _scope: flag
    if name in ("PI", "$PI"):
        return lambda _scope: 3.141592653589793
    r_name = R_NAME.fullmatch(name)
    if r_name is not None:
        index = (int(r_name[1]),)
        return lambda scope: scope.variable("R", index)
    return lambda scope: scope.variable(name, ())


def _indexed(node: Indexed) -> Evaluate:
    name = node.name
    indices = [compile_expression(index) for index in node.indices]
    if len(indices) == 1:
        only = indices[0]
        return lambda scope: scope.variable(name, (only(scope),))
    return lambda scope: scope.variable(name, tuple([index(scope) for index in indices]))


def _call(node: Call) -> Evaluate:
    name = node.name
    if name in ("ISVAR", "GETVARTYP") and len(node.arguments) == 1 and isinstance(node.arguments[0], Text):
        text = node.arguments[0].value
        return lambda scope: scope.function(name, (text,))
    given = [compile_expression(argument) for argument in node.arguments]
    if name in FUNCTIONS:
        return lambda scope: call_function(name, [argument(scope) for argument in given])
    return lambda scope: scope.function(name, tuple([argument(scope) for argument in given]))


def _unary(node: Unary) -> Evaluate:
    operand = compile_expression(node.operand)
    if node.operator == "-":
        return lambda scope: -to_number(operand(scope))
    if node.operator == "+":
        return lambda scope: to_number(operand(scope))
    if node.operator == "NOT":
        return lambda scope: not to_bool(operand(scope))
    if node.operator == "B_NOT":
        return lambda scope: ~to_int(operand(scope))
    return lambda scope: format_value(operand(scope))


def _binary(node: Binary) -> Evaluate:
    operator = node.operator
    left, right = compile_expression(node.left), compile_expression(node.right)
    if operator in COMPARISONS:
        return lambda scope: compare(operator, left(scope), right(scope))
    if operator == "<<":
        return lambda scope: concatenate(left(scope), right(scope))
    return lambda scope: apply_operator(operator, left(scope), right(scope))
