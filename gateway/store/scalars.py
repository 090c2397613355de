"""Single values and arrays to JSON data and back, each by its declared type; the wrong type is refused.

Writers take (value, declared type, path), readers (data, declared type, path, where); both raise TypeError or
ValueError, which `encoding` turns into our exceptions with the field's name.
"""

from __future__ import annotations

import math
from typing import Any, get_args

import numpy as np

_DTYPES = {"float64": np.float64, "int64": np.int64, "bool": np.bool_}
_NUMBERS = {float, int}


def write_float(value: Any, _hint: Any, _path: str) -> object:
    """A number; NaN and infinities as text."""
    if isinstance(value, (bool, np.bool_, str)):
        raise TypeError(f"{value!r} is no number")
    number = float(value)
    return number if math.isfinite(number) else str(number)


def read_float(data: Any, _hint: Any, _path: str, _where: str) -> float:
    """What `write_float` wrote."""
    if isinstance(data, str) and data in ("nan", "inf", "-inf"):
        return float(data)
    if isinstance(data, bool) or not isinstance(data, (int, float)):
        raise TypeError(f"{data!r} is no number")
    return float(data)


def write_int(value: Any, _hint: Any, _path: str) -> object:
    """A whole number."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise TypeError(f"{value!r} is no whole number")
    return int(value)


def write_bool(value: Any, _hint: Any, _path: str) -> object:
    """True or false."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{value!r} is neither true nor false")
    return bool(value)


def read_exact(data: Any, hint: Any, _path: str, _where: str) -> Any:
    """A value of exactly the declared type."""
    if type(data) is not hint:
        raise TypeError(f"{data!r} is no {hint.__name__}")
    return data


def write_text(value: Any, _hint: Any, _path: str) -> object:
    """A text."""
    if not isinstance(value, str):
        raise TypeError(f"{value!r} is no text")
    return str(value)


def write_none(value: Any, _hint: Any, _path: str) -> object:
    """Nothing."""
    if value is not None:
        raise TypeError(f"{value!r} where nothing belongs")
    return None


def read_none(data: Any, hint: Any, path: str, _where: str) -> Any:
    """Nothing."""
    return write_none(data, hint, path)


def write_enum(value: Any, hint: Any, _path: str) -> object:
    """An enum's value."""
    return hint(value).value


def read_enum(data: Any, hint: Any, _path: str, _where: str) -> Any:
    """An enum member from its value."""
    return hint(data)


def write_literal(value: Any, hint: Any, _path: str) -> object:
    """One of the values listed."""
    return _one_of(value, hint)


def read_literal(data: Any, hint: Any, _path: str, _where: str) -> Any:
    """One of the values listed."""
    return _one_of(data, hint)


def _one_of(value: Any, hint: Any) -> Any:
    for choice in get_args(hint):
        if value == choice and isinstance(value, bool) == isinstance(choice, bool):
            return choice
    raise ValueError(f"{value!r} is none of {get_args(hint)}")


def write_array(value: Any, _hint: Any, _path: str) -> object:
    """An array with dtype and shape; NaN as null."""
    array = np.asarray(value)
    if array.dtype.name not in _DTYPES:
        raise TypeError(f"arrays of {array.dtype.name} are not stored")
    flat = array.ravel().tolist()
    if array.dtype.name == "float64":
        flat = [_array_float(item) for item in flat]
    return {"dtype": array.dtype.name, "shape": list(array.shape), "values": flat}


def _array_float(item: float) -> object:
    if math.isnan(item):
        return None
    return item if math.isfinite(item) else str(item)


def read_array(data: Any, _hint: Any, _path: str, _where: str) -> Any:
    """What `write_array` wrote."""
    values = data["values"]
    if data["dtype"] == "float64" and not {type(item) for item in values} <= _NUMBERS:
        values = [math.nan if item is None else read_float(item, float, "", "") for item in values]
    return np.array(values, dtype=_DTYPES[data["dtype"]]).reshape(data["shape"])
