"""Text of a positioning test by indices, as motion tests with ecmc write it: TGT_DATA[i]=, REF_DATA_FWD[i,j]=.

Layout as two public programs describe and read it: lines NAME=VALUE in any order, "#" begins a comment; i counts
targets, j cycles, from 1; UNIT may be missing. Values are positions; FWD is the way up.
"""

from __future__ import annotations

import re
from math import nan
from typing import Any

from drivers.errors import FileFormatError
from drivers.files.numbers import decimal, missing
from drivers.message import Message
from drivers.units import TARGET_UNITS, unit_named

_BREAK = re.compile(r"\r\n|\n|\r")
_TARGET = re.compile(r"\s*TGT_DATA\[(\d{1,4})\]\s*=\s*(\S+)\s*\Z")
_READING = re.compile(r"\s*REF_DATA_(FWD|BWD)\[(\d{1,4}),\s*(\d{1,4})\]\s*=\s*(\S+)\s*\Z")
_UNIT = re.compile(r"\s*UNIT\s*=\s*(\S+)\s*\Z")
_BEGINS = re.compile(r"^\s*TGT_DATA\[\d", re.MULTILINE)


def is_indexed(text: str) -> bool:
    """Whether a text is of this kind."""
    return "TGT_DATA[" in text and _BEGINS.search(text) is not None


def indexed(text: str, where: str) -> tuple[str, list[tuple[int, tuple[float, int, int], float]]]:
    """The unit ("": none named), and every position: line, (target, 0 up or 1 down, cycle), position; pure.

    Raises FileFormatError (E-FILE-LINE) with the line and reason.
    """
    targets: dict[int, float] = {}
    readings: dict[tuple[int, int, int], tuple[float, int]] = {}
    unit = ""
    for at, line in enumerate(_BREAK.split(text), start=1):
        if found := _UNIT.match(line):
            unit = unit_named(found[1])
            if not unit:
                raise _wrong(
                    where, at, Message.of("W-FILE-UNIT-EXPECTED", found=found[1], target_units=", ".join(TARGET_UNITS))
                )
        elif found := _TARGET.match(line):
            _once(targets, int(found[1]), _number(found[2], at, where), at, where)
        elif found := _READING.match(line):
            key = (int(found[2]), int(found[1] == "BWD"), int(found[3]))
            _once(readings, key, (nan if missing(found[4]) else _number(found[4], at, where), at), at, where)
    lost = next(((index, at) for (index, _w, _c), (_v, at) in readings.items() if index not in targets), None)
    if lost is not None:
        raise _wrong(where, lost[1], Message.of("W-FILE-TARGET-UNKNOWN", lost=lost[0]))
    return unit, [(at, (targets[index], way, cycle), value) for (index, way, cycle), (value, at) in readings.items()]


def _once(found: dict[Any, Any], key: object, value: object, at: int, where: str) -> None:
    if key in found:
        raise _wrong(where, at, Message.of("W-FILE-VALUE-TWICE"))
    found[key] = value


def _number(text: str, at: int, where: str) -> float:
    value = decimal(text)
    if value is None:
        raise _wrong(where, at, Message.of("W-FILE-NO-NUMBER", bad=text))
    return float(value)


def _wrong(where: str, line: int, why: str | Message) -> FileFormatError:
    return FileFormatError("E-FILE-LINE", where, line=line, why=why)
