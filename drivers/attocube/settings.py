"""What a site file may say about an IDS3010."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from drivers.errors import words
from drivers.settings import WIRES, DriverSettings, Rule


class AttocubeSettings(DriverSettings):
    """One axis of an interferometer that is asked for its position at a steady rate."""

    addresses: ClassVar[tuple[str, ...]] = WIRES
    axis: int = Field(default=1, ge=1, le=3, description="axis of the interferometer")
    poll_hz: float = Field(default=100.0, gt=0, le=1000, description="samples per second")
    block_s: float = Field(default=0.1, gt=0, le=5, description="length of one block, s")
    refractive_index: float = Field(
        default=0.0, ge=0, lt=1.01, description="refractive index used for its lengths; 0: ask the device"
    )
    timeout_s: float = Field(default=2.0, gt=0, description="longest wait for one answer, s")

    max_speed_mm_s: float = Field(
        default=0.0, ge=0, description="greatest speed of the reflector that it follows, mm/s; 0: not known"
    )
    counts_motion: ClassVar[bool] = True

    @property
    def followed_feed_mm_min(self) -> float | None:
        """By the speed that the site states; None where it states none."""
        return self.max_speed_mm_s * 60.0 or None

    @property
    def quantities(self) -> tuple[str, ...]:
        """Lengths."""
        return ("mm",)

    def doubts(self) -> tuple[Rule, ...]:
        """A speed that nobody stated."""
        return (self.speed_doubt(),)

    def rules(self) -> tuple[Rule, ...]:
        """An index of air is 1 or a little more."""
        return (
            ("refractive_index", self.refractive_index == 0 or self.refractive_index >= 1, words("W-KEY-AIR-INDEX")),
        )
