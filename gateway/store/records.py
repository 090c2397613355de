"""Frozen records to canonical JSON in an envelope with schema version, type and parents' hashes, and back.

Values are led by the record's declared types. JSON has no NaN, so inside arrays NaN is ``null`` and in a float field
the text "nan"; infinities are "inf" and "-inf"; other floats are written by `repr`, the shortest text that gives the
same double back. Where the declared type is `object`, tuples, mappings, arrays and odd floats carry a tag ("$tuple",
"$map", "$array", "$float"). The name of a record's class is part of its file: a renamed class needs its old name here.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import math
from collections.abc import Callable, Mapping
from enum import Enum
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np

from drivers.message import Message
from drivers.terms import with_current_keys
from gateway.errors import CorruptRecord, FutureSchema, StoreError

# Frozen records to canonical JSON in an envelope with schema version, type and parents' hashes, and back.
#
# Canonical means: keys sorted, no spaces, ASCII; the same record gives the same bytes and so the same hash.

SCHEMA = 3
RENAMED = 2
"""From this schema on records say "axis" and "cross"; older ones have the control's own words."""
MESSAGES = 3
"""From this schema on records contain messages; the sentences of older ones are shown as stored."""
_GONE = {"PushRecord": ("codes",)}  # fields of older records that nothing takes the place of
R = TypeVar("R")


def canonical(value: object) -> bytes:
    """JSON data as canonical bytes, ended by a newline."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return text.encode("ascii") + b"\n"


def sha256(data: bytes) -> str:
    """Hash of bytes as 64 hex digits."""
    return hashlib.sha256(data).hexdigest()


def encode(record: object, parents: tuple[str, ...] = ()) -> bytes:
    """A record in its envelope: schema version, type name, parents' hashes.

    Raises StoreError (E-STORE-ENCODE) naming the field that has no stored form.
    """
    if not dataclasses.is_dataclass(record) or isinstance(record, type):
        raise StoreError("E-STORE-ENCODE", "store", what=type(record).__name__, why=Message.of("W-STORE-NO-RECORD"))
    body = write_typed(record, type(record), type(record).__name__)
    name = type(record).__name__
    return canonical({"schema": SCHEMA, "type": name, "parents": list(parents), "record": body})


def decode(data: bytes, kind: type[R], where: str = "store") -> R:
    """The record of that type in an envelope.

    Raises CorruptRecord (E-STORE-JSON, E-STORE-TYPE, E-STORE-FIELD) and FutureSchema (E-STORE-FUTURE).
    """
    envelope = open_envelope(data, where)
    if envelope.get("type") != kind.__name__:
        found = str(envelope.get("type"))
        raise CorruptRecord("E-STORE-TYPE", where, found=found, wanted=kind.__name__)
    if "record" not in envelope:
        raise CorruptRecord("E-STORE-FIELD", where, field=kind.__name__, why=Message.of("W-STORE-ENVELOPE"))
    body = envelope["record"] if envelope["schema"] >= RENAMED else with_current_keys(envelope["record"])
    if envelope["schema"] < MESSAGES and isinstance(body, dict):
        body = {key: value for key, value in body.items() if key not in _GONE.get(kind.__name__, ())}
    return cast(R, read_typed(body, kind, kind.__name__, where))


def open_envelope(data: bytes, where: str) -> dict[str, Any]:
    """Parse JSON that must be an object with a schema version we know; what is in it is not yet checked."""
    try:
        envelope = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise CorruptRecord("E-STORE-JSON", where, why=str(error)) from error
    if not isinstance(envelope, dict) or not isinstance(envelope.get("schema"), int):
        raise CorruptRecord("E-STORE-JSON", where, why=Message.of("W-STORE-NO-SCHEMA"))
    check_schema(envelope["schema"], where)
    return envelope


def check_schema(found: int, where: str) -> None:
    """Raises FutureSchema when a newer program wrote this."""
    if found > SCHEMA:
        raise FutureSchema("E-STORE-FUTURE", where, found=found, known=SCHEMA)


def plain(value: object) -> object:
    """Any value made of scalars, tuples, lists, mappings and arrays as tagged JSON data."""
    return write_typed(value, object, "value")


def from_plain(data: object, where: str = "store") -> Any:
    """The value that `plain` wrote."""
    return read_typed(data, object, "value", where)


# Single values and arrays to JSON data and back, each by its declared type; the wrong type is refused.
#
# Writers take (value, declared type, path), readers (data, declared type, path, where); both raise TypeError or
# ValueError, which `encoding` turns into our exceptions with the field's name.

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


# Any value of a record to JSON data and back, exactly, led by the record's declared types.


@functools.cache
def _hints(kind: Any) -> dict[str, Any]:
    return get_type_hints(kind)


def write_typed(value: Any, hint: Any, path: str) -> object:
    """A value of a declared type as JSON data. Raises StoreError (E-STORE-ENCODE) naming the field."""
    writer = _WRITERS.get(_family(hint))
    if writer is None:
        raise StoreError("E-STORE-ENCODE", "store", what=path, why=Message.of("W-STORE-NO-WAY", hint=hint))
    try:
        return writer(value, hint, path)
    except (TypeError, ValueError, AttributeError) as error:
        raise StoreError("E-STORE-ENCODE", "store", what=path, why=str(error)) from error


def read_typed(data: Any, hint: Any, path: str, where: str) -> Any:
    """A value of a declared type from JSON data. Raises CorruptRecord (E-STORE-FIELD), FutureSchema."""
    reader = _READERS.get(_family(hint))
    if reader is None:
        raise CorruptRecord("E-STORE-FIELD", where, field=path, why=Message.of("W-STORE-NO-READ", hint=hint))
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
    raise StoreError("E-STORE-ENCODE", "store", what=path, why=Message.of("W-STORE-NO-FORM", name=type(value).__name__))


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
