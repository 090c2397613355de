"""What a site file may say about an instrument behind the bridge."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from drivers.settings import WIRES, DriverSettings, Rule, usual_rate


class BridgeSettings(DriverSettings):
    """An instrument or a gear inspection machine that speaks the bridge's dialect."""

    addresses: ClassVar[tuple[str, ...]] = WIRES
    baudrate: int = Field(default=115_200, gt=0, le=4_000_000, description="of a serial line, Bd")
    turn_timeout_s: float = Field(
        default=60.0, gt=0, description="longest turn, hold or track of a rotary calibrator, s"
    )
    stale_s: float = Field(default=5.0, gt=0, description="longest gap in the stream, s")
    battery_refuse_pct: float = Field(
        default=10.0, ge=0, le=100, description="no measurement starts below this battery charge, %"
    )
    battery_stop_pct: float = Field(
        default=5.0, ge=0, le=100, description="a measurement ends below this battery charge, %"
    )
    battery_warn_pct: float = Field(default=20.0, ge=0, le=100, description="warning below this battery charge, %")
    framing: Literal["", "json", "binary"] = Field(
        default="", description="json or binary; left out: binary frames if the bridge offers them"
    )
    echo: bool = Field(default=False, description="the line echoes what is sent")
    max_speed_mm_s: float = Field(
        default=0.0, ge=0, description="greatest speed of the reflector that it follows, mm/s; 0: not known"
    )
    max_speed_deg_s: float = Field(
        default=0.0, ge=0, description="greatest angular speed that it follows, deg/s; 0: not known"
    )
    gear_quiet_s: float = Field(
        default=120.0, gt=0, description="longest gap between two chunks of points of a gear inspection machine, s"
    )

    counts_motion: ClassVar[bool] = True

    @property
    def followed_feed_mm_min(self) -> float | None:
        """By the speed that the site states; None where it states none."""
        return self.max_speed_mm_s * 60.0 or None

    @property
    def followed_feed_deg_min(self) -> float | None:
        """By the angular speed that the site states; None where it states none."""
        return self.max_speed_deg_s * 60.0 or None

    def doubts(self) -> tuple[Rule, ...]:
        """A rate that no line has, and a speed that nobody stated."""
        speed = (self.speed_doubt(),) if self.counts_motion else ()
        return (usual_rate(self.baudrate), *speed)


class BridgeGearSettings(BridgeSettings):
    """A gear inspection machine: it moves its own axes, and no feed of ours."""

    counts_motion: ClassVar[bool] = False
