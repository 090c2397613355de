"""What a person says of a table of readings: which column means what, in which unit, and what no column tells.

Nothing is supposed: what is not said here comes from the table's heading, and what neither says is asked.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from drivers.errors import ConfigError
from drivers.files.declared import declared
from drivers.files.readings import Quantity
from drivers.files.tables.order import PASSES
from drivers.message import Message
from drivers.units import READING_UNITS, TARGET_UNITS, unit_named

WAYS = ("", "column", "runs", "order", "up", "down")


@dataclass(frozen=True, slots=True)
class ColumnMap:
    """What each column means. Columns count from 1; 0 and "": the heading says it.

    One of ``deviation``, ``measured`` (positions; then deviation = sense * measured - (target - ``datum``)),
    ``increment`` (steps from the stop before) and ``length`` holds the reading. ``direction``: "column"
    (``direction_column``), "runs" (odd ``run`` forward, even reverse), "order" (the way the targets go in the file) or
    one way only. ``passes``: every column from the reading on, to ``last`` (0: the end), is a pass; "alternate" forward
    and reverse in turn, "halves" all forward ones first, or one way only. ``sense`` -1 turns the readings' sign,
    ``factor`` multiplies them (1: they contain what their file says of a scale; 0: nothing was said).
    ``skip`` lines stand before the rows; -1: all that hold none. ``sheet`` of a workbook; ``beside``: the file of the
    other direction, in the same folder; ``confirmed``: a person has looked at readings that seem impossible, and
    they are right.
    """

    target: int = 0
    deviation: int = 0
    measured: int = 0
    increment: int = 0
    length: int = 0
    run: int = 0
    direction_column: int = 0
    direction: str = ""
    passes: str = ""
    last: int = 0
    target_unit: str = ""
    reading_unit: str = ""
    datum: float = 0.0
    sense: int = 1
    factor: float = 0.0
    skip: int = -1
    separator: str = ""
    decimal_comma: bool = False
    sheet: str = ""
    beside: str = ""
    confirmed: bool = False

    @classmethod
    def read(cls, said: Mapping[str, Any], where: str, *, mixed: bool = False) -> ColumnMap:
        """From a user's words; ``mixed`` lets angles stand over lengths and lengths over angles.

        Raises ConfigError (E-FILE-MAP) naming the key and what is allowed.
        """
        words = dict(said)
        if type(words.get("direction")) is int:  # a number there can only be its column
            words = words | {"direction": "column", "direction_column": words["direction"]}
        for key in ("target_unit", "reading_unit"):
            words[key] = unit_named(str(words[key])) or words[key] if key in words else ""
        found = declared(cls, words, where)
        if found.apart and (found.quantity not in ("", "deviation") or not mixed):
            why = Message.of("W-FILE-MIXED")
            raise ConfigError("E-FILE-MAP", where, key="reading_unit", why=why)
        return found

    @property
    def apart(self) -> bool:
        """Whether the units said of targets and readings are of different kinds: pitch over mm, run-out over deg."""
        if not (self.target_unit and self.reading_unit):
            return False
        return TARGET_UNITS[self.target_unit][0] != READING_UNITS[self.reading_unit][0]

    @property
    def quantity(self) -> Quantity | str:
        """What the declared column of readings holds; "" where none is declared."""
        named = (("deviation", self.deviation), ("position", self.measured), ("increment", self.increment))
        return next((name for name, column in (*named, ("length", self.length)) if column), "")

    @property
    def reading(self) -> int:
        """The declared column of readings, 0 for none."""
        return self.deviation or self.measured or self.increment or self.length

    @property
    def whole(self) -> bool:
        """Whether it names targets and readings, so that no heading is needed for them."""
        return self.target > 0 and self.reading > 0

    @property
    def scale(self) -> float:
        """What the readings are multiplied by, their sign included."""
        return self.sense * (self.factor or 1.0)

    @property
    def needed(self) -> int:
        """How many columns a line has at least."""
        return max(self.target, self.reading, self.run, self.direction_column)

    @property
    def ways(self) -> str:
        """How directions are told: of `PASSES` or `WAYS`, "" where the heading or the order tells them."""
        way = "column" if self.direction_column else self.direction
        return self.passes or way or ("order" if self.whole else "")

    def told(self) -> str:
        """What was said, for the record."""
        said = ((item.name, getattr(self, item.name), item.default) for item in fields(self))
        return ", ".join(f"{name}={value}" for name, value, default in said if value != default)

    def limits(self) -> tuple[tuple[str, bool, str | Message], ...]:
        """See `drivers.files.declared.Declared`."""
        counted = ("target", "deviation", "measured", "increment", "length", "run", "direction_column")
        readings = sum(1 for column in (self.deviation, self.measured, self.increment, self.length) if column)
        units = Message.of("W-FILE-ONE-OF", known=", ".join(TARGET_UNITS))
        return (
            *((name, getattr(self, name) >= 0, Message.of("W-FILE-COLUMN")) for name in counted),
            ("deviation", readings <= 1, Message.of("W-FILE-GIVE-READINGS")),
            ("direction", self.direction in WAYS, Message.of("W-FILE-ONE-OF", known=", ".join(WAYS[1:]))),
            ("direction_column", self.direction != "column" or self.direction_column >= 1, Message.of("W-FILE-COLUMN")),
            (
                "direction",
                not self.direction_column or self.direction in ("", "column"),
                Message.of("W-FILE-COLUMN-TELLS"),
            ),
            ("run", self.direction != "runs" or self.run >= 1 or not self.whole, Message.of("W-FILE-COLUMN")),
            ("passes", self.passes in PASSES, Message.of("W-FILE-ONE-OF", known=", ".join(PASSES[1:]))),
            ("last", self.last == 0 or self.last >= self.reading, Message.of("W-FILE-LAST-PASS")),
            ("target_unit", self.target_unit in ("", *TARGET_UNITS), units),
            ("reading_unit", self.reading_unit in ("", *READING_UNITS), units),
            ("sense", self.sense in (1, -1), Message.of("W-FILE-ONE-MINUS-ONE")),
            ("factor", self.factor >= 0.0, Message.of("W-FILE-SCALE")),
            ("skip", self.skip >= -1, Message.of("W-FILE-0-OR-MORE")),
            ("separator", len(self.separator) <= 1, Message.of("W-FILE-SEPARATOR")),
        )
