"""What a site file may say about a uMD counter, and how many millimetres one count is."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from drivers.errors import words
from drivers.message import fixed
from drivers.settings import WIRES, DriverSettings, Rule, usual_rate
from drivers.units import arcsec_of_path, followed_feed_mm_min, path_of_fringes_mm, rad_to_deg

# Vacuum wavelength of the XL/ML lasers, nm; reproduces the Env factor of a real result file to its last digit.
VACUUM_WAVELENGTH_NM = 632.990577
HELIUM_NEON_NM = 0.5
"""Makers' figures for the red line, in air or in vacuum, lie nearer than this to that wavelength."""
MM_PER_NM = 1e-6
USUAL_AIR = 1.00027
"""Index of air for a difference of paths: shop air differs from it by 30 ppm at most, 0.1 arcsec in a degree."""


class UmdSettings(DriverSettings):
    """Zero or empty means: as the counter says."""

    addresses: ClassVar[tuple[str, ...]] = WIRES
    baudrate: int = Field(default=115_200, gt=0, le=4_000_000, description="of the serial line, Bd")
    wavelength_nm: float = Field(
        default=VACUUM_WAVELENGTH_NM, gt=100.0, lt=2000.0, description="vacuum wavelength of the laser, nm"
    )
    counts_per_cycle: int = Field(
        default=0,
        ge=0,
        le=65536,
        description="counts for each half wavelength of path (4 coarse, 16 fine quadrature); 0: as the counter says",
    )
    count_size_nm: float = Field(
        default=0.0,
        ge=0,
        description="length of one count of a scaled quadrature output, nm; 0: not scaled",
    )
    compensated_for: Literal["", "nothing", "air", "air+material"] = Field(
        default="", description="corrections that count_size_nm already contains; left out without count_size_nm"
    )
    optics_spacing_mm: float = Field(
        default=0.0,
        ge=0,
        le=1000,
        description="angular optics: distance of their two reflectors, mm; readings are then angles; 0: linear optics",
    )
    optics_factor: float = Field(
        default=1.0, ge=0.9, le=1.1, description="calibrated factor on that distance, from the optics' certificate"
    )
    axis: int = Field(default=1, ge=1, le=3, description="channel of the counter")
    sample_rate_hz: float = Field(default=0.0, ge=0, description="samples a second; 0: as the counter says")
    max_fringe_hz: float = Field(
        default=0.0,
        ge=0,
        description="greatest fringe rate (2 v / wavelength) that the counter follows, Hz; 0: not known",
    )
    max_speed_mm_s: float = Field(default=4000.0, gt=0, description="a faster step is rejected, mm/s")
    least_signal: int = Field(default=0, ge=0, description="samples below this signal strength are rejected; 0: none")
    stale_s: float = Field(default=5.0, gt=0, description="longest gap in the counter's data, s")

    def rules(self) -> tuple[Rule, ...]:
        """The scaling says what it holds, and only it."""
        allowed = ("nothing", "air", "air+material") if self.count_size_nm > 0 else ("", "nothing")
        why = words("W-KEY-COMPENSATED")
        return (
            ("compensated_for", self.compensated_for in allowed, why),
            ("optics_factor", self.optics_factor == 1.0 or self.angular, words("W-KEY-SPACING")),
        )

    def doubts(self) -> tuple[Rule, ...]:
        """Another laser than those whose quadrature outputs the counter reads; a rate that no line has."""
        usual = abs(self.wavelength_nm - VACUUM_WAVELENGTH_NM) < HELIUM_NEON_NM
        why = words("W-UMD-WAVELENGTH", usual=fixed(VACUUM_WAVELENGTH_NM, 2))
        return (usual_rate(self.baudrate), self.speed_doubt(), ("wavelength_nm", usual, why))

    counts_motion: ClassVar[bool] = True

    @property
    def followed_feed_mm_min(self) -> float | None:
        """The least of what the stated fringe rate and the stated speed allow; None where neither is stated.

        None with angular optics too: their path changes with the angle, not with the way of a linear axis.
        """
        return None if self.angular else self._followed

    @property
    def followed_feed_deg_min(self) -> float | None:
        """Turning, angular optics change their path by their spacing times the angle, and most about zero."""
        return float(rad_to_deg(self._followed / self.optics_spacing_mm)) if self.angular and self._followed else None

    @property
    def _followed(self) -> float | None:
        """Of the path, mm/min."""
        limits = [self.max_speed_mm_s * 60.0] if "max_speed_mm_s" in self.model_fields_set else []
        if self.max_fringe_hz:
            limits.append(followed_feed_mm_min(self.max_fringe_hz, self.wavelength_nm))
        return min(limits, default=None)

    @property
    def angular(self) -> bool:
        """Whether the counts are differences of path between the reflectors of angular optics."""
        return self.optics_spacing_mm > 0

    @property
    def quantities(self) -> tuple[str, ...]:
        """Lengths, or with angular optics angles."""
        return ("arcsec",) if self.angular else ("mm",)

    @property
    def channels(self) -> tuple[str, ...]:
        """What the readings are."""
        return ("angle_arcsec",) if self.angular else ("displacement_mm",)

    def reading(self, path_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """The optical path (n,) in mm as it is, or the angle in arcsec that angular optics make of it; NaN: none."""
        if not self.angular:
            return path_mm
        index = USUAL_AIR if self.compensation == "nothing" else 1.0
        return arcsec_of_path(path_mm / index, self.optics_spacing_mm * self.optics_factor)

    @property
    def compensation(self) -> Literal["nothing", "air", "air+material"]:
        """What the counts already hold."""
        return self.compensated_for or "nothing"

    def mm_per_count(self, counts_per_cycle: int) -> float:
        """The given count size, or lambda_vac / 2 / counts per cycle: one cycle of a retro-reflector."""
        if self.count_size_nm > 0:
            return self.count_size_nm * MM_PER_NM
        return path_of_fringes_mm(1.0 / counts_per_cycle, self.wavelength_nm)
