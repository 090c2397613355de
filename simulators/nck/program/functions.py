"""Functions of the NC language that need nothing but their arguments."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from simulators.nck.spec import NckRefusal
from simulators.nck.values import Value, number, readable, real, truth, whole

Function = Callable[[Sequence[Value]], Value]


def _one(work: Callable[[float], float]) -> tuple[int, int, Function]:
    return 1, 1, lambda given: work(real(given[0]))


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
        return real(float(f"{mantissa}e{power or 0}"))
    except ValueError as error:
        raise NckRefusal(12160, "text is no number") from error


def _part(given: Sequence[Value]) -> str:
    text, start = _text(given[0]), whole(given[1])
    count = whole(given[2]) if len(given) > 2 else len(text)
    if start < 0 or count < 0:
        raise NckRefusal(12160, "SUBSTR outside the text")
    return text[start : start + count]


def _bound(given: Sequence[Value]) -> Value:
    low, high, value = (number(item) for item in given)
    return min(max(value, low), high)


def _absolute(given: Sequence[Value]) -> Value:
    value = number(given[0])
    return abs(value)


FUNCTIONS: dict[str, tuple[int, int, Function]] = {
    "SIN": _one(lambda x: math.sin(math.radians(x))),
    "COS": _one(lambda x: math.cos(math.radians(x))),
    "TAN": _one(_tangent),
    "ASIN": _one(lambda x: math.degrees(math.asin(x))),
    "ACOS": _one(lambda x: math.degrees(math.acos(x))),
    "ATAN2": (2, 2, lambda given: math.degrees(math.atan2(real(given[0]), real(given[1])))),
    "SQRT": _one(math.sqrt),
    "POT": _one(lambda x: x * x),
    "LN": _one(math.log),
    "EXP": _one(math.exp),
    "ABS": (1, 1, _absolute),
    "ROUND": _one(lambda x: float(math.floor(x + 0.5))),
    "ROUNDUP": _one(lambda x: float(math.ceil(x))),
    "TRUNC": _one(lambda x: float(math.trunc(x))),
    "MINVAL": (2, 2, lambda given: min(number(given[0]), number(given[1]))),
    "MAXVAL": (2, 2, lambda given: max(number(given[0]), number(given[1]))),
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


def called(name: str, given: Sequence[Value]) -> Value:
    """The value of a function. Raises NckRefusal: 12340 (parameters), 14092 (not defined there), 12160."""
    fewest, most, work = FUNCTIONS[name]
    if not fewest <= len(given) <= most:
        raise NckRefusal(12340, f"{name} takes {fewest} parameters, not {len(given)}")
    try:
        value = work(given)
    except (ValueError, ZeroDivisionError) as error:
        raise NckRefusal(14092, f"{name} is not defined for {readable(given[0])}") from error
    except OverflowError as error:
        raise NckRefusal(12160, f"{name}: value lies beyond the value range") from error
    return value


def calculated(operator: str, left: Value, right: Value) -> Value:
    """An arithmetic or logical operation. Raises NckRefusal 12150, 12160, 14092 (division by zero)."""
    if operator in ("AND", "OR", "XOR"):
        one, two = truth(left), truth(right)
        return (one and two) if operator == "AND" else (one or two) if operator == "OR" else one != two
    if operator.startswith("B_"):
        return _bits(operator, whole(left), whole(right))
    a, b = number(left), number(right)
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
