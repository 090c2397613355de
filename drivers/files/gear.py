"""Measured flank points from tables by declared columns: space, flank, place, deviation; nothing is guessed.

A place is x, y, z, or radius (or diameter), angle and z about the gear's axis. A trace without angles gives radius (or
diameter), z and deviation: where such a point lies on the flank is calculated from the gear (`GearTraces`). Roll
lengths belong to an involute and are refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from drivers.errors import ConfigError, FileFormatError
from drivers.files.declared import declared
from drivers.files.numbers import decimal, whole
from drivers.files.signature import signature_of
from drivers.files.tables.sheet import cells
from drivers.files.text import end_doubts, read_bytes
from drivers.local.textfile import decode_text
from drivers.message import Message, digits
from drivers.types.gears import GearInspection, GearTraces
from drivers.units import MM_PER_INCH

LENGTHS = {"mm": 1.0, "um": 1e-3, "m": 1e3, "inch": MM_PER_INCH}
ANGLES = {"deg": np.pi / 180.0, "rad": 1.0, "mrad": 1e-3}
FLANKS = dict.fromkeys(("left", "l", "links", "+", "+1", "1"), 1)
FLANKS |= dict.fromkeys(("right", "r", "rechts", "-", "-1"), -1)
FLANKS |= {"左": 1, "右": -1}
MOST_SPACES = 10_000
LARGEST_MM, LARGEST_DEVIATION_UM = 5000.0, 5000.0
_BREAK = re.compile(r"\r\n|\n|\r")
M = TypeVar("M", bound="PointMap")


@dataclass(frozen=True, slots=True)
class PointMap:
    """Units and sides of flank points: what every declared map says. ``swap_flanks``: seen from the other face."""

    length_unit: str = "mm"
    angle_unit: str = "deg"
    deviation_unit: str = "um"
    swap_flanks: bool = False
    probe_u_um: float = 0.0

    @classmethod
    def read(cls: type[M], said: Mapping[str, Any], where: str) -> M:
        """From a user's words. Raises ConfigError (E-FILE-MAP) naming the key and what is allowed."""
        return declared(cls, said, where)

    def limits(self) -> Iterable[tuple[str, bool, str | Message]]:
        """See `drivers.files.declared.Declared`."""
        return (
            ("length_unit", self.length_unit in LENGTHS, Message.of("W-FILE-ONE-OF", known=", ".join(LENGTHS))),
            ("angle_unit", self.angle_unit in ANGLES, Message.of("W-FILE-ONE-OF", known=", ".join(ANGLES))),
            ("deviation_unit", self.deviation_unit in LENGTHS, Message.of("W-FILE-ONE-OF", known=", ".join(LENGTHS))),
            ("probe_u_um", 0.0 <= self.probe_u_um < 1000.0, Message.of("W-GEARFILE-0-1000")),
        )


@dataclass(frozen=True, slots=True)
class GearColumns(PointMap):
    """Which column holds what, from 1; 0: there is none. ``skip`` lines stand before the rows."""

    space: int = 1
    flank: int = 2
    x: int = 0
    y: int = 0
    z: int = 0
    radius: int = 0
    diameter: int = 0
    angle: int = 0
    deviation: int = 0
    skip: int = 1
    separator: str = ";"
    decimal_comma: bool = False

    def limits(self) -> Iterable[tuple[str, bool, str | Message]]:
        """See `PointMap.limits`."""
        # A trace has no angles: then the deviation says what was measured at the radius.
        round_one = bool(self.radius) != bool(self.diameter) and bool(self.angle or self.deviation)
        square = bool(self.x and self.y) and not (self.radius or self.diameter or self.angle)
        return (
            *PointMap.limits(self),
            ("space", self.space >= 1, Message.of("W-FILE-COLUMN")),
            ("flank", self.flank >= 1, Message.of("W-FILE-COLUMN")),
            ("z", self.z >= 1, Message.of("W-FILE-COLUMN-HEIGHT")),
            (
                "x",
                square or round_one,
                Message.of("W-GEARFILE-GIVE-PLACE"),
            ),
            ("skip", self.skip >= 0, Message.of("W-FILE-0-OR-MORE")),
            ("separator", len(self.separator) == 1, Message.of("W-FILE-ONE-SIGN")),
        )

    @property
    def numbers(self) -> tuple[int, ...]:
        """Columns that hold numbers: two of the place across the axis, z, and the deviation where there is one."""
        across = (self.x, self.y) if self.x else (self.radius or self.diameter, *((self.angle,) if self.angle else ()))
        return (*across, self.z, *((self.deviation,) if self.deviation else ()))


@dataclass(frozen=True, slots=True)
class Touch:
    """One point as written: space, flank +1 or -1, numbers (place, then the deviation where there is one)."""

    space: int
    flank: int
    numbers: tuple[float, ...]


class GearCsvFormat:
    """Gear file driver "gear-csv": a table of flank points by declared columns (`GearColumns`)."""

    def __init__(self, codepage: str = "cp1252", columns: Mapping[str, Any] | None = None) -> None:
        self._codepage = codepage
        self._columns = GearColumns.read(columns, "gear-csv") if columns is not None else None

    def signature(self, path: Path) -> str:
        """What tables of the same layout have in common, "" for one without a heading."""
        return signature_of(decode_text(read_bytes(path), self._codepage, str(path)))

    def read(self, path: Path) -> GearInspection | GearTraces:
        """Read a file. Raises ConfigError (E-FILE-GEAR-MAP) without columns, FileFormatError with the line."""
        where = str(path)
        if self._columns is None:
            raise ConfigError("E-FILE-GEAR-MAP", where)
        return read_gear_table(decode_text(read_bytes(path), self._codepage, where), self._columns, where)


def read_gear_table(text: str, columns: GearColumns, where: str) -> GearInspection | GearTraces:
    """A whole table, pure: points, or traces without angles. Raises FileFormatError (E-FILE-LINE, E-FILE-ROWS)."""
    lines = list(enumerate(_BREAK.split(text), start=1))[columns.skip :]
    touches = [_touch(line, columns, at, where) for at, line in lines if line.strip()]
    if not (columns.x or columns.angle):
        return _traces(touches, columns, where, end_doubts(text))
    return inspection(
        touches, columns, where, polar=not columns.x, diameter=bool(columns.diameter), warnings=end_doubts(text)
    )


def _traces(touches: list[Touch], columns: GearColumns, where: str, doubts: tuple[Message, ...]) -> GearTraces:
    """Radius, z and deviation of each touch. Raises FileFormatError (E-FILE-ROWS, E-FILE-GEAR-SIZE)."""
    if not touches:
        raise FileFormatError("E-FILE-ROWS", where)
    numbers = np.asarray([one.numbers for one in touches], dtype=np.float64)
    length = LENGTHS[columns.length_unit]
    radius, z = numbers[:, 0] * length * (0.5 if columns.diameter else 1.0), numbers[:, 1] * length
    deviation = numbers[:, 2] * LENGTHS[columns.deviation_unit] * 1000.0
    _check_size(np.column_stack([radius, z]), deviation, where)
    return GearTraces(
        radius_mm=radius,
        z_mm=z,
        deviation_um=deviation,
        space=np.asarray([one.space for one in touches], dtype=np.int64),
        flank=np.asarray([one.flank for one in touches], dtype=np.int64) * (-1 if columns.swap_flanks else 1),
        probe_u_um=columns.probe_u_um or None,
        source=where,
        warnings=(*doubts, Message.of("S-GEARFILE-TRACES")),
    )


def _touch(line: str, columns: GearColumns, at: int, where: str) -> Touch:
    row = cells(line, columns.separator)
    needed = max(columns.space, columns.flank, *columns.numbers)
    if len(row) < needed:
        raise wrong_line(where, at, Message.of("W-FILE-COLUMN-NEEDED", count=len(row), needed=needed))
    numbers = [decimal(row[column - 1], comma=columns.decimal_comma) for column in columns.numbers]
    return touch(row[columns.space - 1], row[columns.flank - 1], numbers=numbers, at=at, where=where)


def touch(space: str, flank: str, numbers: list[float | None], at: int, where: str) -> Touch:
    """One point, checked. Raises FileFormatError (E-FILE-LINE)."""
    number, side = whole(space.strip()), FLANKS.get(flank.strip().lower())
    if number is None or number > MOST_SPACES:
        raise wrong_line(where, at, Message.of("W-GEARFILE-NO-SPACE", space=space))
    if side is None:
        raise wrong_line(where, at, Message.of("W-GEARFILE-NO-FLANK", flank=flank))
    known = [value for value in numbers if value is not None]
    if len(known) != len(numbers):
        raise wrong_line(where, at, Message.of("W-GEARFILE-NO-PLACE"))
    return Touch(number, side, tuple(known))


def inspection(
    touches: list[Touch], units: PointMap, where: str, *, polar: bool = False, diameter: bool = False, **more: Any
) -> GearInspection:
    """The record, in mm and um. Raises FileFormatError (E-FILE-ROWS, E-FILE-GEAR-SIZE)."""
    if not touches:
        raise FileFormatError("E-FILE-ROWS", where)
    numbers = np.asarray([one.numbers for one in touches], dtype=np.float64)
    places = _places(numbers[:, :3], units, polar=polar, diameter=diameter)
    said = numbers.shape[1] > 3
    deviation = numbers[:, 3] * LENGTHS[units.deviation_unit] * 1000.0 if said else None
    _check_size(places, deviation, where)
    flank = np.asarray([one.flank for one in touches], dtype=np.int64) * (-1 if units.swap_flanks else 1)
    space = np.asarray([one.space for one in touches], dtype=np.int64)
    warnings = (*more.pop("warnings", ()), *_doubts(places, space, flank))
    probe = units.probe_u_um or None
    return GearInspection(
        points_mm=places,
        space=space,
        flank=flank,
        deviation_um=deviation,
        probe_u_um=probe,
        source=where,
        header=more.pop("header", {}),
        warnings=warnings,
    )


def _places(numbers: np.ndarray, units: PointMap, *, polar: bool, diameter: bool) -> np.ndarray:
    length = LENGTHS[units.length_unit]
    if not polar:
        return np.ascontiguousarray(numbers * length)
    radius = numbers[:, 0] * length * (0.5 if diameter else 1.0)
    angle = numbers[:, 1] * ANGLES[units.angle_unit]
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), numbers[:, 2] * length])


def _check_size(places: np.ndarray, deviation: np.ndarray | None, where: str) -> None:
    """No gear of ours is 5 m wide and no deviation 5 mm: then a unit or a column is wrong."""
    far = float(np.abs(places).max())
    off = 0.0 if deviation is None else float(np.abs(deviation).max())
    if far > LARGEST_MM or off > LARGEST_DEVIATION_UM:
        raise FileFormatError("E-FILE-GEAR-SIZE", where, place=digits(far, 4), deviation=digits(off, 4))


def _doubts(places: np.ndarray, space: np.ndarray, flank: np.ndarray) -> list[Message]:
    rows = np.column_stack([np.round(places, 6), space, flank])
    repeated = len(rows) - len(np.unique(rows, axis=0))
    found = [Message.of("S-FILE-POINTS-TWICE", count=repeated)] if repeated else []
    if len(set(flank.tolist())) == 1:
        found.append(Message.of("S-FILE-ONE-FLANK"))
    return found


def wrong_line(where: str, line: int, why: str | Message) -> FileFormatError:
    """The error for one line."""
    return FileFormatError("E-FILE-LINE", where, line=line, why=why)
