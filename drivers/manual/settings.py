"""Typed readings in a site file, and the rule by which a typed text becomes a number: nothing is guessed."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal

from pydantic import Field

from drivers.errors import words
from drivers.settings import DriverSettings, Rule

# What a person typed to a number: one explicit rule for point and comma, nothing guessed, pure.

DecimalMark = Literal["point", "comma"]
# Plain decimals only: no exponent, no group marks, no words, and no more digits than any display has.
_NUMBER: dict[DecimalMark, re.Pattern[str]] = {
    "point": re.compile(r"[+-]?[0-9]{1,9}(?:\.[0-9]{1,9})?\Z"),
    "comma": re.compile(r"[+-]?[0-9]{1,9}(?:,[0-9]{1,9})?\Z"),
}
NO_NUMBER, OTHER_MARK, FAR = "W-MANUAL-NUMBER", "W-MANUAL-MARK", "W-MANUAL-FAR"
_MARK: dict[DecimalMark, str] = {"point": ".", "comma": ","}


@dataclass(frozen=True, slots=True)
class ExpectedReading:
    """What the next reading is of and where it should lie: ``value`` +- ``limit`` in the channel's unit."""

    label: str = ""
    value: float = 0.0
    limit: float = float("inf")


@dataclass(frozen=True, slots=True)
class EntryRefused:
    """Why a typed text is no reading: a code of the catalogue with its fields."""

    code: str
    fields: dict[str, str]


def read_entry(
    text: str, mark: DecimalMark, expected: ExpectedReading, unit: str, *, sure: bool
) -> float | EntryRefused:
    """A typed text as a number, or why not.

    The other decimal mark is refused, not turned around: 1.234 may be a thousand. A value outside ``expected`` is
    taken only when it is typed a second time (``sure``).
    """
    typed = text.strip()
    if not typed.isascii() or not _NUMBER[mark].match(typed):
        other: DecimalMark = "comma" if mark == "point" else "point"
        return EntryRefused(
            OTHER_MARK if _NUMBER[other].match(typed) else NO_NUMBER, {"typed": repr(typed[:40]), "mark": mark}
        )
    value = float(typed.replace(_MARK[mark], "."))
    if abs(value - expected.value) > expected.limit and not sure:
        limits = f"{expected.value - expected.limit:g} .. {expected.value + expected.limit:g} {unit}"
        return EntryRefused(FAR, {"typed": typed, "limits": limits})
    return value


# Settings.

PLAUSIBLE = {
    "air_degc": ExpectedReading("air", 20.0, 30.0),
    "pressure_hpa": ExpectedReading("pressure", 900.0, 250.0),
    "humidity_pct": ExpectedReading("humidity", 50.0, 50.0),
    "material_degc": ExpectedReading("material", 20.0, 40.0),
}
UNITS = ("_mm", "_um", "_deg", "_arcsec")


class ManualSettings(DriverSettings):
    """A display that a person reads and types; one typed value is averaged like any other."""

    channel: str = Field(
        default="displacement_mm", description="typed quantity; its name ends in the unit: _mm, _um, _deg or _arcsec"
    )
    decimal: DecimalMark = Field(default="point", description="decimal mark of the display, point or comma")
    scale: float = Field(default=1.0, description="+1 or -1: turns the display's count into the channel's sense")
    hold_s: float = Field(default=10.0, gt=0, description="duration that one typed value represents, s")
    samples: int = Field(default=20, ge=3, le=10_000, description="number of samples that one typed value represents")
    who: str = Field(default="", description="person who types; left out: the user of this PC")
    air_degc: str = Field(default="", description="typed air temperature, degC, as a text; left out: unknown")
    pressure_hpa: str = Field(default="", description="typed air pressure, hPa, as a text; left out: unknown")
    humidity_pct: str = Field(default="", description="typed humidity, %, as a text; left out: unknown")
    material_degc: str = Field(
        default="", description="typed material temperatures, degC, as a text with ; between them; left out: unknown"
    )

    addresses: ClassVar[tuple[str, ...]] = ("terminal", "folder")
    typed: ClassVar[bool] = True

    def rules(self) -> tuple[Rule, ...]:
        """A channel says its unit; a sense is a sign."""
        return (
            *((key, not why, why) for key, why in self._untypable()),
            ("channel", self.channel.endswith(UNITS), words("W-KEY-UNIT", known=" ".join(UNITS))),
            ("scale", self.scale in (1.0, -1.0), words("W-KEY-SIGN")),
        )

    def _untypable(self) -> Iterator[tuple[str, str]]:
        """Keys of typed surroundings, and why one is no possible reading ("" where it is)."""
        for key, expected in PLAUSIBLE.items():
            for text in filter(None, getattr(self, key).split(";") if key == "material_degc" else [getattr(self, key)]):
                found = read_entry(text, self.mark, expected, key.rpartition("_")[2], sure=False)
                yield key, words(found.code, **found.fields) if isinstance(found, EntryRefused) else ""

    @property
    def mark(self) -> DecimalMark:
        """The decimal mark that is typed."""
        return self.decimal

    @property
    def quantities(self) -> tuple[str, ...]:
        """The channel's unit."""
        return (self.unit,)

    @property
    def unit(self) -> str:
        """The channel's unit."""
        return self.channel.rpartition("_")[2]
