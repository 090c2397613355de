"""What a site file may say about an instrument behind the bridge."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from drivers.settings import WIRES, DriverSettings


class BridgeSettings(DriverSettings):
    """An instrument or a gear inspection machine that speaks the bridge's dialect."""

    addresses: ClassVar[tuple[str, ...]] = WIRES
    baudrate: int = Field(default=115_200, gt=0, le=4_000_000, description="of a serial line, Bd")
    turn_timeout_s: float = Field(
        default=60.0, gt=0, description="longest turn, hold or track of a rotary calibrator, s"
    )
    stale_s: float = Field(default=5.0, gt=0, description="longest silence of the stream, s")
    battery_refuse_pct: float = Field(
        default=10.0, ge=0, le=100, description="nothing begins below this charge of the battery, %"
    )
    battery_stop_pct: float = Field(default=5.0, ge=0, le=100, description="measuring ends below this charge, %")
    battery_warn_pct: float = Field(default=20.0, ge=0, le=100, description="a warning below this charge, %")
    framing: Literal["", "json", "binary"] = Field(
        default="", description="json or binary insists; left out: binary frames where the bridge offers them"
    )
    echo: bool = Field(default=False, description="the line gives our own questions back")
    gear_quiet_s: float = Field(
        default=120.0, gt=0, description="longest silence of a gear inspection machine between two chunks of points, s"
    )
