"""What a site file may say about a gauge that answers a question."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from drivers.errors import words
from drivers.settings import WIRES, DriverSettings, Rule

LENGTHS = ("_mm", "_um")


class GaugeSettings(DriverSettings):
    """A display that is asked for its reading at a steady rate; line and unit as set at the display."""

    addresses: ClassVar[tuple[str, ...]] = WIRES
    question: str = Field(default="?", description="what it is asked: ?, M1? for one feature, PRI")
    unit: Literal["", "mm", "inch", "um"] = Field(
        default="",
        description="unit of its readings: mm, inch or um; left out: as its answers name it",
    )
    resolution_um: float = Field(
        default=0.0,
        ge=0,
        le=1000,
        description="its resolution, um; a reading between two steps is refused; 0: no check",
    )
    channel: str = Field(default="gauge_um", description="quantity; its name ends in the unit: _mm or _um")
    scale: float = Field(default=1.0, description="+1 or -1: turns the display's count into the channel's sense")
    baudrate: int = Field(default=9600, gt=0, le=4_000_000, description="of the serial line, Bd")
    data_bits: Literal[7, 8] = Field(default=8, description="data bits of the serial line; 7 for many displays")
    parity: Literal["N", "E", "O"] = Field(default="N", description="of the serial line: N, E or O; E with 7 bits")
    stop_bits: Literal[1, 2] = Field(default=1, description="stop bits of the serial line")
    poll_hz: float = Field(default=5.0, gt=0, le=50, description="questions a second")
    block_s: float = Field(default=1.0, gt=0, le=10, description="length of one block, s")
    timeout_s: float = Field(default=2.0, gt=0, description="longest wait for one answer, s")

    @property
    def quantities(self) -> tuple[str, ...]:
        """The channel's unit."""
        return (self.channel.rpartition("_")[2],)

    def rules(self) -> tuple[Rule, ...]:
        """A channel says its unit; a sense is a sign."""
        return (
            ("channel", self.channel.endswith(LENGTHS), words("W-KEY-UNIT", known=" ".join(LENGTHS))),
            ("scale", self.scale in (1.0, -1.0), words("W-KEY-SIGN")),
        )
