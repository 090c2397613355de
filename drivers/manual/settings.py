"""What a site file may say about typed readings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from pydantic import Field

from drivers.errors import words
from drivers.manual.entry import DecimalMark, EntryRefused, ExpectedReading, read_entry
from drivers.settings import DriverSettings, Rule

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
