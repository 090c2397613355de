"""The one record of a machine axis that rooms hand around; the site file's section makes it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class AxisRecord:
    """One axis: ``name`` as the control has it, ``letter`` as programs call it; positions and overrun in its unit.

    ``reference`` is where its tables must be zero. ``feed`` in mm/min or deg/min; ``dwell_s`` before each hand-shake.
    ``encoder`` is the measuring system whose table acts, ``encoder_said`` whether the site file names it.
    ``safe`` is where programs of the compensation may move it (None: nobody said).
    """

    name: str
    letter: str
    unit: Literal["mm", "deg"]
    rotary: bool
    modulo: bool
    travel: tuple[float, float]
    reference: float
    feed: float
    overrun: float = 5.0
    dwell_s: float = 1.0
    encoder: int = 0
    encoder_said: bool = True
    safe: tuple[float, float] | None = None

    @property
    def room(self) -> tuple[float, float]:
        """Where a compensation's own moves lead: the travel, as far as it is safe."""
        if self.safe is None:
            return self.travel
        return max(self.travel[0], self.safe[0]), min(self.travel[1], self.safe[1])
