"""What a site file may say about a uMD counter, and how many millimetres one count is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

from drivers.link import read_settings, wrong_setting
from drivers.types import CompensatedFor

# Vacuum wavelength of the XL/ML lasers, nm; reproduces the Env factor of a real result file to its last digit.
VACUUM_WAVELENGTH_NM = 632.990577
MM_PER_NM = 1e-6


@dataclass(frozen=True, slots=True)
class UmdSettings:
    """Zero or empty means: as the counter says.

    ``counts_per_cycle`` counts for each half wavelength of path (4 coarse, 16 fine quadrature).
    ``count_size_nm`` for a quadrature output already scaled to a length; ``compensated_for`` must then say
    what that scaling holds. Samples while the counter tells a signal strength (code 2) below ``least_signal``
    are not believed. ``axis`` 1..3. ``max_speed_mm_s``: a faster step is not believed.
    """

    baudrate: int = 115_200
    wavelength_nm: float = VACUUM_WAVELENGTH_NM
    counts_per_cycle: int = 0
    count_size_nm: float = 0.0
    compensated_for: str = ""
    axis: int = 1
    sample_rate_hz: float = 0.0
    max_speed_mm_s: float = 4000.0
    least_signal: int = 0
    stale_s: float = 5.0

    @classmethod
    def read(cls, settings: Mapping[str, Any], where: str) -> UmdSettings:
        """From the site file. Raises ConfigError (E-CFG-SETTING, E-CFG-SETTING-VALUE)."""
        found = read_settings(cls, settings, where)
        for key, good, why in found.limits():
            if not good:
                raise wrong_setting(key, why, where)
        return found

    def limits(self) -> tuple[tuple[str, bool, str], ...]:
        """Key, whether its value is allowed, and what is allowed."""
        scaled = self.count_size_nm > 0
        return (
            ("baudrate", self.baudrate > 0, "must be above 0"),
            ("wavelength_nm", 100.0 < self.wavelength_nm < 2000.0, "must be a wavelength in nm"),
            ("counts_per_cycle", 0 <= self.counts_per_cycle <= 65536, "must be 0 .. 65536"),
            ("count_size_nm", self.count_size_nm >= 0, "must be 0 or more"),
            ("axis", self.axis in (1, 2, 3), "must be 1, 2 or 3"),
            ("sample_rate_hz", self.sample_rate_hz >= 0, "must be 0 or more"),
            ("max_speed_mm_s", self.max_speed_mm_s > 0, "must be above 0"),
            ("least_signal", self.least_signal >= 0, "must be 0 or more"),
            ("stale_s", self.stale_s > 0, "must be above 0"),
            (
                "compensated_for",
                self.compensated_for in (("nothing", "air", "air+material") if scaled else ("", "nothing")),
                "must say nothing, air or air+material with count_size_nm, and be left out without",
            ),
        )

    @property
    def compensation(self) -> CompensatedFor:
        """What the counts already hold."""
        return cast(CompensatedFor, self.compensated_for or "nothing")

    def mm_per_count(self, counts_per_cycle: int) -> float:
        """The given count size, or lambda_vac / 2 / counts per cycle: one cycle of a retro-reflector."""
        if self.count_size_nm > 0:
            return self.count_size_nm * MM_PER_NM
        return self.wavelength_nm * MM_PER_NM / (2.0 * counts_per_cycle)
