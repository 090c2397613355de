"""Safe places for machines of tests: wide, so that what a test moves may move."""

from __future__ import annotations

from typing import TypeVar

from drivers.safe_positions import SafePositionMixin
from drivers.types.moves import SafePlaces

Device = TypeVar("Device", bound=SafePositionMixin)

WIDE = (-9999.0, 9999.0)
PLACES = SafePlaces(dict.fromkeys(("X1", "Y1", "Z1", "A1", "C1"), WIDE), feed_mm=6000.0, feed_deg=6000.0)
"""Feeds as the tests' machines are measured with: their time is simulated."""


def placed(device: Device) -> Device:
    """A controller that was told where the axes of its machine may stand."""
    device.keep_to(PLACES)
    return device
