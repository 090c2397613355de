"""Any value of a record to JSON data and back, exactly, led by the record's declared types.

JSON has no NaN, so inside arrays NaN is ``null`` and in a float field the text "nan"; infinities are "inf"
and "-inf"; other floats are written by `repr`, the shortest text that gives the same double back. Where the
declared type is `object`, tuples, mappings, arrays and odd floats carry a tag ("$tuple", "$map", "$array",
"$float").
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping
from enum import Enum
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

from drivers.message import Message
from gateway.errors import CorruptRecord, FutureSchema, StoreError
from gateway.store.scalars import (
    read_array,
    read_enum,
    read_exact,
    read_float,
    read_literal,
    read_none,
    write_array,
    write_bool,
    write_enum,
    write_float,
    write_int,
    write_literal,
    write_none,
    write_text,
)


@functools.cache
def _hints(kind: Any) -> dict[str, Any]:
    return get_type_hints(kind)


def write_typed(value: Any, hint: Any, path: str) -> object:
    """A value of a declared type as JSON data. Raises StoreError (E-STORE-ENCODE) naming the field."""
    writer = _WRITERS.get(_family(hint))
    if writer is None:
        raise StoreError("E-STORE-ENCODE", "store", what=path, why=f"no way to store {hint}")
    try:
        return writer(value, hint, path)
    except (TypeError, ValueError, AttributeError) as error:
        raise StoreError("E-STORE-ENCODE", "store", what=path, why=str(error)) from error


def read_typed(data: Any, hint: Any, path: str, where: str) -> Any:
    """A value of a declared type from JSON data. Raises CorruptRecord (E-STORE-FIELD), FutureSchema."""
    reader = _READERS.get(_family(hint))
    if reader is None:
        raise CorruptRecord("E-STORE-FIELD", where, field=path, why=f"no way to read {hint}")
    try:
        return reader(data, hint, path, where)
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise CorruptRecord("E-STORE-FIELD", where, field=path, why=str(error)) from error


@functools.cache
def _family(hint: Any) -> str:
    """Which kind of declared type this is, by one word."""
    origin = get_origin(hint)
    if origin is not None:
        return _ORIGINS.get(origin, "")
    if hint is Any or hint is object:
        return "any"
    if isinstance(hint, type) and issubclass(hint, Enum):
        return "enum"
    if hint is Message:
        return "message"
    if dataclasses.is_dataclass(hint):
        return "record"
    return _SCALARS.get(hint, "")


_ORIGINS: dict[Any, str] = {
    np.ndarray: "array",
    Literal: "literal",
    Union: "union",
    UnionType: "union",
    tuple: "tuple",
    Mapping: "mapping",
    dict: "mapping",
}
_SCALARS: dict[Any, str] = {float: "float", int: "int", bool: "bool", str: "str", NoneType: "none"}


def _write_record(value: Any, hint: Any, path: str) -> object:
    hints = _hints(hint)
    if type(value) is not hint:
        raise TypeError(f"{type(value).__name__} where {hint.__name__} belongs")
    names = [item.name for item in dataclasses.fields(hint)]
    return {name: write_typed(getattr(value, name), hints[name], f"{path}.{name}") for name in names}


def _read_record(data: Any, hint: Any, path: str, where: str) -> Any:
    if isinstance(data, str) and hasattr(hint, "older"):  # a sentence where there is a record today
        return hint.older(data)
    hints = _hints(hint)
    names = [item.name for item in dataclasses.fields(hint)]
    unknown = sorted(set(data) - set(names))
    if unknown:
        raise FutureSchema("E-STORE-UNKNOWN", where, field=path, unknown=", ".join(unknown))
    values = {name: read_typed(data[name], hints[name], f"{path}.{name}", where) for name in names if name in data}
    return hint(**values)


def _write_union(value: Any, hint: Any, path: str) -> object:
    if value is None and NoneType in get_args(hint):
        return None
    return write_typed(value, _other(hint), path)


def _read_union(data: Any, hint: Any, path: str, where: str) -> Any:
    if data is None and NoneType in get_args(hint):
        return None
    if data == "" and Message in get_args(hint):  # an older version's "no sentence"
        return None
    return read_typed(data, _other(hint), path, where)


def _other(hint: Any) -> Any:
    """The one type beside None; records say nothing more than "this or nothing"."""
    others = [choice for choice in get_args(hint) if choice is not NoneType]
    if len(others) != 1:
        raise TypeError(f"{hint} leaves open what it is")
    return others[0]


def _items(hint: Any, count: int) -> list[Any]:
    inner = get_args(hint)
    if len(inner) == 2 and inner[1] is Ellipsis:
        return [inner[0]] * count
    if len(inner) != count:
        raise ValueError(f"{count} items where {len(inner)} belong")
    return list(inner)


def _write_tuple(value: Any, hint: Any, path: str) -> object:
    if not isinstance(value, (tuple, list)):
        raise TypeError(f"{type(value).__name__} where a tuple belongs")
    kinds = _items(hint, len(value))
    return [write_typed(item, kind, f"{path}[{i}]") for i, (item, kind) in enumerate(zip(value, kinds, strict=True))]


def _read_tuple(data: Any, hint: Any, path: str, where: str) -> Any:
    if isinstance(data, str) and get_args(hint) == (Message, Ellipsis):  # sentences that an older version joined
        return (Message.stored(data),) if data else ()
    if not isinstance(data, list):
        raise TypeError(f"{type(data).__name__} where a list belongs")
    pairs = zip(data, _items(hint, len(data)), strict=True)
    return tuple(read_typed(item, kind, f"{path}[{i}]", where) for i, (item, kind) in enumerate(pairs))


def _write_mapping(value: Any, hint: Any, path: str) -> object:
    _keys, kind = get_args(hint)
    return {_text_key(key): write_typed(item, kind, f"{path}[{key}]") for key, item in value.items()}


def _read_mapping(data: Any, hint: Any, path: str, where: str) -> Any:
    _keys, kind = get_args(hint)
    return {key: read_typed(item, kind, f"{path}[{key}]", where) for key, item in data.items()}


def _text_key(key: object) -> str:
    if not isinstance(key, str):
        raise TypeError(f"key {key!r} is no text")
    return key


def write_any(value: Any, path: str) -> object:
    """A value of undeclared type as tagged JSON data. Raises StoreError (E-STORE-ENCODE)."""
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, (int, np.integer, np.bool_)):
        return value.item() if isinstance(value, np.generic) else value
    if isinstance(value, (float, np.floating)):
        number = write_float(value, float, path)
        return {"$float": number} if isinstance(number, str) else number
    return _write_compound(value, path)


def _write_compound(value: Any, path: str) -> object:
    if isinstance(value, np.ndarray):
        return {"$array": write_array(value, None, path)}
    if isinstance(value, Mapping):
        return {"$map": {_text_key(key): write_any(item, f"{path}[{key}]") for key, item in value.items()}}
    if isinstance(value, tuple):
        return {"$tuple": [write_any(item, path) for item in value]}
    if isinstance(value, list):
        return [write_any(item, path) for item in value]
    raise StoreError("E-STORE-ENCODE", "store", what=path, why=f"{type(value).__name__} has no stored form")


def read_any(data: Any, path: str, where: str) -> Any:
    """The value that `write_any` wrote."""
    if isinstance(data, list):
        return [read_any(item, path, where) for item in data]
    if not isinstance(data, dict):
        return data
    if len(data) != 1:
        raise ValueError("an object must carry exactly one tag")
    tag, inner = next(iter(data.items()))
    return _TAGS[tag](inner, path, where)


_TAGS: dict[str, Callable[[Any, str, str], Any]] = {
    "$float": lambda inner, path, where: read_float(inner, float, path, where),
    "$array": lambda inner, path, where: read_array(inner, None, path, where),
    "$tuple": lambda inner, path, where: tuple(read_any(item, path, where) for item in inner),
    "$map": lambda inner, path, where: {key: read_any(item, path, where) for key, item in inner.items()},
}
_WRITERS: dict[str, Callable[[Any, Any, str], object]] = {
    "message": lambda value, _hint, _path: value.as_data(),
    "record": _write_record,
    "float": write_float,
    "int": write_int,
    "bool": write_bool,
    "str": write_text,
    "none": write_none,
    "enum": write_enum,
    "literal": write_literal,
    "union": _write_union,
    "tuple": _write_tuple,
    "mapping": _write_mapping,
    "array": write_array,
    "any": lambda value, _hint, path: write_any(value, path),
}
_READERS: dict[str, Callable[[Any, Any, str, str], Any]] = {
    "message": lambda data, _hint, _path, _where: Message.from_data(data),
    "record": _read_record,
    "float": read_float,
    "int": read_exact,
    "bool": read_exact,
    "str": read_exact,
    "none": read_none,
    "enum": read_enum,
    "literal": read_literal,
    "union": _read_union,
    "tuple": _read_tuple,
    "mapping": _read_mapping,
    "array": read_array,
    "any": lambda data, _hint, path, where: read_any(data, path, where),
}
