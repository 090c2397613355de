"""What was read at the stops of one axis, as a file has it: the type between a layout and a measured set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from drivers.errors import ConfigError
from drivers.types.doubts import Doubt
from drivers.types.values import FloatArray
from drivers.units import READING_UNITS, TARGET_UNITS, AxisUnit

Whole = NDArray[np.integer[Any]]
Quantity = Literal["deviation", "position", "increment", "length"]


@dataclass(frozen=True, slots=True)
class Reading:
    """One reading: ``approach`` is 0 (+) or 1 (-), ``run`` its number; ``value`` is NaN where nothing was read."""

    line: int
    target: float
    approach: int
    run: int
    value: float


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Readings by column, each (k,), in the order in which they were written: a million take no million objects."""

    line: Whole
    target: FloatArray
    approach: Whole
    run: Whole
    value: FloatArray

    @classmethod
    def of(cls, rows: Sequence[Reading]) -> Rows:
        """The same readings by column."""
        whole = (np.array([getattr(row, name) for row in rows], np.int64) for name in ("line", "approach", "run"))
        line, approach, run = whole
        target, value = (np.array([getattr(row, name) for row in rows], np.float64) for name in ("target", "value"))
        return cls(line, target, approach, run, value=value)

    def __len__(self) -> int:
        return int(self.line.size)

    def row(self, at: int) -> Reading:
        """One of them."""
        line, approach, run = (int(column[at]) for column in (self.line, self.approach, self.run))
        return Reading(line, float(self.target[at]), approach, run, value=float(self.value[at]))

    def where(self, which: NDArray[np.bool_]) -> Rows:
        """Those that are chosen (k,)."""
        return Rows(
            self.line[which], self.target[which], self.approach[which], self.run[which], value=self.value[which]
        )

    def and_then(self, other: Rows) -> Rows:
        """These, and the others behind them."""
        return Rows(
            np.concatenate((self.line, other.line)),
            np.concatenate((self.target, other.target)),
            np.concatenate((self.approach, other.approach)),
            np.concatenate((self.run, other.run)),
            value=np.concatenate((self.value, other.value)),
        )


@dataclass(frozen=True, slots=True)
class Readings:
    """The readings of one axis in the order in which they were written, each number in the unit that it has there.

    ``quantity``: a "deviation" from the target, a "position" that counts from ``datum`` (in the targets' unit), an
    "increment" from the stop before in the same run, or a "length" of something, which is no position of an axis.
    ``scale`` multiplies the readings, -1 turns their sign. Raises ConfigError (E-FILE-UNIT) without a unit, or with one
    that does not fit; ``mixed`` lets angles stand over lengths and lengths over angles.
    """

    quantity: Quantity
    unit: str
    target_unit: str
    rows: Rows
    axis: str = ""
    datum: float = 0.0
    scale: float = 1.0
    mixed: bool = False
    doubts: tuple[Doubt, ...] = ()

    def __post_init__(self) -> None:
        if self.quantity not in get_args(Quantity):
            raise ConfigError("E-FILE-UNIT", self.axis, unit=self.quantity, known=", ".join(get_args(Quantity)))
        for unit, known in ((self.unit, READING_UNITS), (self.target_unit, TARGET_UNITS)):
            if unit not in known:
                raise ConfigError("E-FILE-UNIT", self.axis, unit=unit, known=", ".join(known))
        if self.apart and (not self.mixed or self.quantity != "deviation"):
            wanted = TARGET_UNITS[self.target_unit][0]
            able = ", ".join(one for one, (kind, _scale) in READING_UNITS.items() if kind == wanted)
            raise ConfigError("E-FILE-UNIT", self.axis, unit=self.unit, known=able)

    @property
    def apart(self) -> bool:
        """Whether targets and readings are of different kinds: pitch over mm, run-out over deg."""
        return READING_UNITS[self.unit][0] != TARGET_UNITS[self.target_unit][0]

    @property
    def axis_unit(self) -> AxisUnit:
        """The unit that the record of these readings has: mm where they are lengths, deg where they are angles."""
        return READING_UNITS[self.unit][0]

    @property
    def circular(self) -> bool:
        """Whether a reading repeats after a whole turn."""
        return self.axis_unit == "deg"
