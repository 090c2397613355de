"""What a value of the control must be: the one place where values, outputs of methods and times of a server enter.

Type, range, number of elements and special numbers are checked here against `nodes.kind_of`; what passes is of plain
Python: str, bool, int, float, a list of them for a block, bytes. Servers differ in the width of their numbers, so 2 and
2.0 are one, and a switch may be 0 or 1; a truth value is no number, NaN and infinity are none either.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from datetime import datetime
from typing import Any

from drivers.errors import RemoteProtocolError
from drivers.sinumerik.opcua.session import nodes

SHOWN = 80
_MOST = {"UInt16": 0xFFFF, "UInt32": 0xFFFFFFFF, "UInt64": 2**64 - 1}
# Properties of file nodes (OPC 10000-20, 4.2.1).
_OF_FILES = {"UserWritable": "Boolean", "Writable": "Boolean", "Size": "UInt64", "OpenCount": "UInt16"}
# Variables that know fewer values than their type can carry.
_FEW = {"basicLengthUnit": 1, "aaRef": 1, "accessLevel": 7}


def checked(path: str, value: Any, where: str) -> Any:
    """A value read from a node, as plain Python. Raises RemoteProtocolError (E-UA-VALUE)."""
    address = nodes.parse(path)
    if address is None or address.last is None:
        return _single(path, value, path, where)
    count = len(address.elements)
    if not isinstance(value, list) or len(value) != count:
        raise wrong(path, value, f"{count} numbers", where)
    return [_single(path, one, f"{path}, element {number}", where) for number, one in enumerate(value, start=1)]


def _single(path: str, value: Any, what: str, where: str) -> Any:
    address = nodes.parse(path)
    kind = _OF_FILES.get(path.rpartition(".")[2]) if address is None else nodes.kind_of(path)
    kind = kind or "String"
    if kind in _MOST:
        name = address.name if address is not None else ""
        return whole(value, what, where, _FEW.get(name, _MOST[kind]))
    return _CHECKS[kind](value, what, where)


def whole(value: Any, what: str, where: str, most: int = _MOST["UInt32"]) -> int:
    """A whole number from 0 to ``most``. Raises RemoteProtocolError (E-UA-VALUE)."""
    if not _is_number(value) or value != int(value) or not 0 <= value <= most:
        raise wrong(what, value, f"a whole number from 0 to {most}", where)
    return int(value)


def number(value: Any, what: str, where: str) -> float:
    """A finite number. Raises RemoteProtocolError (E-UA-VALUE)."""
    if not _is_number(value):
        raise wrong(what, value, "a number", where)
    return float(value)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:  # a whole number that no Double holds
        return False


def text(value: Any, what: str, where: str) -> str:
    """A text; one that is not there (a null String) is empty. Raises RemoteProtocolError (E-UA-VALUE)."""
    if value is not None and not isinstance(value, str):
        raise wrong(what, value, "a text", where)
    return value or ""


def label(value: Any, what: str, where: str) -> str:
    """A name or number as people read it: some controls give their version as a number. Raises as `text`."""
    return f"{value:g}" if _is_number(value) else text(value, what, where).strip()


def switch(value: Any, what: str, where: str) -> bool:
    """On or off. Raises RemoteProtocolError (E-UA-VALUE)."""
    if isinstance(value, bool):
        return value
    if not _is_number(value) or value not in (0, 1):
        raise wrong(what, value, "on or off", where)
    return bool(value)


def content(value: Any, what: str, where: str) -> bytes:
    """The bytes of a file. Raises RemoteProtocolError (E-UA-VALUE)."""
    if not isinstance(value, bytes):
        raise wrong(what, value, "bytes", where)
    return value


def moment(value: Any, what: str, where: str) -> datetime | None:
    """A time by the server's clock, UTC and naive; None where there is none. Raises as `text`."""
    if value is not None and not isinstance(value, datetime):
        raise wrong(what, value, "a time", where)
    return value.replace(tzinfo=None) if value is not None else None


def lasting_s(milliseconds: Any, what: str, where: str) -> float:
    """How long a server keeps something, s. Raises RemoteProtocolError (E-UA-VALUE) for what is no time at all."""
    if not _is_number(milliseconds) or milliseconds <= 0:
        raise wrong(what, milliseconds, "a time above 0 ms", where)
    return float(milliseconds) / 1000.0


def output(results: Sequence[Any], place: int, what: str, where: str) -> Any:
    """One output of a method. Raises RemoteProtocolError (E-UA-VALUE) where there are too few."""
    if len(results) <= place:
        raise wrong(what, list(results), f"{place + 1} outputs", where)
    return results[place]


def wrong(what: str, value: Any, wanted: str, where: str) -> RemoteProtocolError:
    """The error for a value that cannot be: which variable, what it was, what it must be."""
    return RemoteProtocolError("E-UA-VALUE", where, what=what, value=_shown(value), wanted=wanted)


def _shown(value: Any) -> str:
    if value is None:
        return "nothing"
    try:
        told = repr(value)
    except ValueError:  # Python does not write down a number of thousands of digits
        return "a number without end"
    return told if len(told) <= SHOWN else told[: SHOWN - 3] + "..."


_CHECKS: dict[str, Callable[[Any, str, str], Any]] = {"Double": number, "String": text, "Boolean": switch}
