"""Who a device and a machine say they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class Identity:
    """Who a device says it is. ``fingerprint`` holds what must stay the same for a controller."""

    driver: str
    model: str
    serial: str
    firmware: str = ""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class MachineIdentity:
    """The fingerprint of a machine: three fields and more, all of them compared before every write."""

    serial: str
    version: str
    axis_names: tuple[str, ...]
    unit_system: Literal["metric", "inch"] = "metric"

    def differences(self, other: MachineIdentity) -> tuple[str, ...]:
        """Names of the fields that differ."""
        names = ("serial", "version", "axis_names", "unit_system")
        return tuple(name for name in names if getattr(self, name) != getattr(other, name))
