"""Frozen records to canonical JSON in an envelope with schema version, type and parents' hashes, and back.

Canonical means: keys sorted, no spaces, ASCII; the same record gives the same bytes and so the same hash.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from typing import Any, TypeVar, cast

from drivers.terms import with_current_keys
from gateway.errors import CorruptRecord, FutureSchema, StoreError
from gateway.store.encoding import read_typed, write_typed

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
        raise StoreError("E-STORE-ENCODE", "store", what=type(record).__name__, why="not a record")
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
        raise CorruptRecord("E-STORE-FIELD", where, field=kind.__name__, why="the envelope is empty")
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
        raise CorruptRecord("E-STORE-JSON", where, why="no object with a schema version")
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
