"""What a site file may say about the dial gauge; a module of its own, so that `trueflank check` reads it alone."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from drivers.settings import WIRES, DriverSettings


class DialSettings(DriverSettings):
    """Every key has a default, its limits and a description."""

    addresses: ClassVar[tuple[str, ...]] = WIRES
    baudrate: int = Field(default=9600, ge=300, le=4_000_000, description="of the serial line, Bd")
    rate_hz: float = Field(default=10.0, gt=0, le=100, description="questions a second")
    timeout_s: float = Field(default=1.0, gt=0, description="longest wait for one answer, s")
