"""Text of a positioning test by indices, as motion tests with ecmc write it: TGT_DATA[i]=, REF_DATA_FWD[i,j]=.

Layout as two public programs describe and read it: lines NAME=VALUE in any order, "#" begins a comment; i counts
targets, j cycles, from 1; UNIT is mm where nobody says otherwise. Values are positions; FWD is the way up.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from drivers.errors import FileFormatError
from drivers.files.columns import TARGET_UNITS
from drivers.files.numbers import beyond, decimal, no_readings
from drivers.files.text import end_doubts
from drivers.types.results import MeasuredSet
from drivers.units import deviation_scale

_BREAK = re.compile(r"\r\n|\n|\r")
_TARGET = re.compile(r"\s*TGT_DATA\[(\d{1,4})\]\s*=\s*(\S+)\s*\Z")
_READING = re.compile(r"\s*REF_DATA_(FWD|BWD)\[(\d{1,4}),\s*(\d{1,4})\]\s*=\s*(\S+)\s*\Z")
_UNIT = re.compile(r"\s*UNIT\s*=\s*(\S+)\s*\Z")
_BEGINS = re.compile(r"^\s*TGT_DATA\[\d", re.MULTILINE)
LAYOUT = "TGT_DATA[i], REF_DATA_FWD[i,j], REF_DATA_BWD[i,j]"


def is_indexed(text: str) -> bool:
    """Whether a text is of this kind."""
    return _BEGINS.search(text) is not None


def parse_indexed(text: str, where: str) -> MeasuredSet:
    """A whole file, pure; a reading that is not there is NaN.

    Raises FileFormatError (E-FILE-LINE with the line and reason, E-FILE-ROWS).
    """
    targets: dict[int, float] = {}
    readings: dict[tuple[int, int, int], tuple[float, int]] = {}
    unit = "mm"
    for at, line in enumerate(_BREAK.split(text), start=1):
        if found := _UNIT.match(line):
            unit = found[1].lower()
            if unit not in TARGET_UNITS:
                raise _wrong(where, at, f"unit {found[1]!r}, expected one of {', '.join(TARGET_UNITS)}")
        elif found := _TARGET.match(line):
            _once(targets, int(found[1]), _number(found[2], at, where), at, where)
        elif found := _READING.match(line):
            key = (int(found[2]), int(found[3]), int(found[1] == "BWD"))
            _once(readings, key, (_number(found[4], at, where), at), at, where)
    if not readings:
        raise FileFormatError("E-FILE-ROWS", where)
    return _arranged(targets, readings, unit, where, end_doubts(text))


def _arranged(
    targets: dict[int, float],
    readings: dict[tuple[int, int, int], tuple[float, int]],
    unit: str,
    where: str,
    doubts: tuple[str, ...],
) -> MeasuredSet:
    axis_unit, scale = TARGET_UNITS[unit]
    read = {index for index, _cycle, _way in readings}
    order = sorted(read & set(targets), key=lambda index: targets[index])
    row = {index: at for at, index in enumerate(order)}
    cycles = sorted({cycle for _index, cycle, _way in readings})
    deviations = no_readings(len(order), len(cycles), where)
    for (index, cycle, way), (value, at) in readings.items():
        if index not in row:
            raise _wrong(where, at, f"a reading of target {index}, which the file does not name")
        deviation = (value - targets[index]) * scale * deviation_scale(axis_unit)
        if beyond(targets[index] * scale, deviation):
            raise _wrong(where, at, f"target {targets[index]:g} with position {value:g} is no measurement")
        deviations[row[index], cycles.index(cycle), way] = deviation
    places = np.array([targets[index] * scale for index in order], np.float64)
    if len(set(places.tolist())) != len(places):
        raise FileFormatError("E-FILE-LINE", where, line=0, why="two targets are the same")
    ways = [way for way in (0, 1) if not np.isnan(deviations[:, :, way]).all()]
    missing = int(np.isnan(deviations[:, :, ways]).sum())
    said = [f"{missing} readings are missing"] if missing else []
    said += ["measured in one direction only"] if len(ways) == 1 else []
    said += [f"{len(targets) - len(order)} targets have no reading"] if len(order) < len(targets) else []
    header = {"Format": LAYOUT, "Unit": unit, "Reading": "position"}
    return MeasuredSet(places, deviations, axis_unit, header=header, warnings=(*said, *doubts))


def _once(found: dict[Any, Any], key: object, value: object, at: int, where: str) -> None:
    if key in found:
        raise _wrong(where, at, "this value stands there twice")
    found[key] = value


def _number(text: str, at: int, where: str) -> float:
    value = decimal(text)
    if value is None:
        raise _wrong(where, at, f"{text!r} is no number")
    return float(value)


def _wrong(where: str, line: int, why: str) -> FileFormatError:
    return FileFormatError("E-FILE-LINE", where, line=line, why=why)
