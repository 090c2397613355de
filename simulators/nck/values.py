"""Values of the NC language: types, conversions, comparison and their readable text."""

from __future__ import annotations

import math

from simulators.nck.spec import NckRefusal

INT_MAX = 2**31 - 1
TEXT_MAX = 200
_RELATIVE_EQUALITY = 1e-12


class AxisName(str):
    """The name of an axis as a value of type AXIS."""

    __slots__ = ()


Value = bool | int | float | str


def to_number(value: Value) -> int | float:
    """A value as an operand of arithmetic. Raises NckRefusal 12150 for text and axes."""
    if isinstance(value, str):
        raise NckRefusal(12150, "operation does not fit the data type")
    return value


def to_bool(value: Value) -> bool:
    """A value as a condition: not zero, not empty."""
    if isinstance(value, AxisName):
        raise NckRefusal(12150, "an axis is no condition")
    return bool(value)


def to_int(value: Value) -> int:
    """A value as INT, rounded half up. Raises NckRefusal 12160 beyond 32 bits."""
    plain = to_real(value)
    if not -INT_MAX - 1 <= plain <= INT_MAX:
        raise NckRefusal(12160, "value lies beyond the value range of INT")
    return math.floor(plain + 0.5) if isinstance(value, float) else int(plain)


def to_real(value: Value) -> float:
    """A value as REAL. Raises NckRefusal 12160 when it is not finite."""
    plain = float(to_number(value))
    if not math.isfinite(plain):
        raise NckRefusal(12160, "value lies beyond the value range of REAL")
    return plain


def format_value(value: Value) -> str:
    """A value as ``<<`` and MSG show it: REAL with up to ten decimals, BOOL as 0 or 1."""
    if isinstance(value, str):
        return str(value)
    if isinstance(value, float):
        if not math.isfinite(value):
            raise NckRefusal(12160, "value lies beyond the value range of REAL")
        text = f"{value:.10f}".rstrip("0").rstrip(".")
        return "0" if text == "-0" else text
    return str(int(value))


def concatenate(left: Value, right: Value) -> str:
    """``left << right``. Raises NckRefusal 12210 when the text grows too long."""
    text = format_value(left) + format_value(right)
    if len(text) > TEXT_MAX:
        raise NckRefusal(12210, f"string longer than {TEXT_MAX} characters")
    return text


def compare(operator: str, left: Value, right: Value) -> bool:
    """A comparison; numbers count as equal within a relative 1e-12 (Job Planning, "relative equality")."""
    if isinstance(left, str) or isinstance(right, str):
        return _compared_text(operator, left, right)
    gap = left - right
    if abs(gap) <= _RELATIVE_EQUALITY * max(abs(left), abs(right)):
        gap = 0
    return _satisfies(operator, (gap > 0) - (gap < 0))


def _compared_text(operator: str, left: Value, right: Value) -> bool:
    if not isinstance(left, str) or not isinstance(right, str):
        raise NckRefusal(12150, "text is compared with text only")
    if isinstance(left, AxisName) or isinstance(right, AxisName):
        left, right = left.upper(), right.upper()
        if operator not in ("==", "<>"):
            raise NckRefusal(12150, "axes are compared by == and <> only")
    return _satisfies(operator, (left > right) - (left < right))


def _satisfies(operator: str, order: int) -> bool:
    if operator == "==":
        return order == 0
    if operator == "<>":
        return order != 0
    if operator == "<":
        return order < 0
    if operator == ">":
        return order > 0
    return order <= 0 if operator == "<=" else order >= 0


def convert(kind: str, value: Value, length: int = TEXT_MAX) -> Value:
    """A value assigned to a variable of that type. Raises NckRefusal 12150, 12160, 12210."""
    if kind == "AXIS":
        if isinstance(value, AxisName):
            return value
        raise NckRefusal(12150, "only an axis can be assigned to AXIS")
    if isinstance(value, AxisName):
        raise NckRefusal(12150, f"an axis cannot be assigned to {kind}")
    if kind == "STRING":
        return _fit_text(value, length)
    if kind == "BOOL":
        return to_bool(value)
    if kind == "CHAR" and isinstance(value, str) and len(value) == 1:
        return ord(value)
    return to_int(value) if kind in ("INT", "CHAR") else to_real(value)


def _fit_text(value: Value, length: int) -> str:
    if not isinstance(value, str | bool):
        raise NckRefusal(12150, "only text can be assigned to STRING: use <<")
    text = format_value(value)
    if len(text) > length:
        raise NckRefusal(12210, f"string longer than {length} characters")
    return text


def initial_value(kind: str) -> Value:
    """What a variable holds when its DEF gives no value."""
    values: dict[str, Value] = {"STRING": "", "BOOL": False, "REAL": 0.0, "AXIS": AxisName("")}
    return values.get(kind, 0)
