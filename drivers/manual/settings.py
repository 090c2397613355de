"""What a site file may say about typed readings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

from drivers.link import read_settings, wrong_setting
from drivers.manual.entry import DecimalMark

UNITS = ("_mm", "_um", "_deg", "_arcsec")


@dataclass(frozen=True, slots=True)
class ManualSettings:
    """``channel`` names what is typed, with its unit; ``decimal`` "point" or "comma".

    ``scale`` turns the display's count into the channel's sense (+1 or -1). One typed value stands for
    ``samples`` samples over ``hold_s``, so that it is averaged like any other. ``air_degc``, ``pressure_hpa``,
    ``humidity_pct`` and ``material_degc`` are typed environment readings, each "" where there is none.
    """

    channel: str = "displacement_mm"
    decimal: str = "point"
    scale: float = 1.0
    hold_s: float = 10.0
    samples: int = 20
    who: str = ""
    air_degc: str = ""
    pressure_hpa: str = ""
    humidity_pct: str = ""
    material_degc: str = ""

    @classmethod
    def read(cls, settings: Mapping[str, Any], where: str) -> ManualSettings:
        """From the site file. Raises ConfigError (E-CFG-SETTING, E-CFG-SETTING-VALUE)."""
        found = read_settings(cls, settings, where)
        for key, good, why in (
            ("channel", found.channel.endswith(UNITS), "must end in a unit: " + " ".join(UNITS)),
            ("decimal", found.decimal in ("point", "comma"), 'must be "point" or "comma"'),
            ("scale", found.scale in (1.0, -1.0), "must be 1.0 or -1.0"),
            ("hold_s", found.hold_s > 0, "must be above 0"),
            ("samples", 3 <= found.samples <= 10_000, "must be 3 .. 10000"),
        ):
            if not good:
                raise wrong_setting(key, why, where)
        return found

    @property
    def mark(self) -> DecimalMark:
        """The decimal mark that is typed."""
        return cast(DecimalMark, self.decimal)

    @property
    def unit(self) -> str:
        """The channel's unit."""
        return self.channel.rpartition("_")[2]
