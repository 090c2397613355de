"""What was read at the stops of one axis, as a file has it: the type between a layout and a measured set."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from drivers.errors import ConfigError
from drivers.types.doubts import Doubt
from drivers.units import READING_UNITS, TARGET_UNITS, AxisUnit

Quantity = Literal["deviation", "position", "increment", "length"]


@dataclass(frozen=True, slots=True)
class Reading:
    """One reading: ``approach`` is 0 (+) or 1 (-), ``run`` its number; ``value`` is NaN where nothing was read."""

    line: int
    target: float
    approach: int
    run: int
    value: float


@dataclass(frozen=True, slots=True)
class Readings:
    """The readings of one axis in the order in which they were written, each number in the unit that it has there.

    ``quantity``: a "deviation" from the target, a "position" that counts from ``datum`` (in the targets' unit), an
    "increment" from the stop before in the same run, or a "length" of something, which is no position of an axis.
    ``sense`` -1 turns the readings' sign. Raises ConfigError (E-FILE-UNIT) without a unit, or with one that does not
    fit; ``mixed`` lets angles stand over lengths and lengths over angles.
    """

    quantity: Quantity
    unit: str
    target_unit: str
    rows: tuple[Reading, ...]
    axis: str = ""
    datum: float = 0.0
    sense: int = 1
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
