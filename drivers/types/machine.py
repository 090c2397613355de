"""A control's state in one read: channel, mode, axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from drivers.units import AxisUnit


class ChannelStatus(Enum):
    """State of the NC channel (chanStatus)."""

    RESET = 0
    ACTIVE = 1
    INTERRUPTED = 2


@dataclass(frozen=True, slots=True)
class AxisState:
    """One axis as the controller reports it. ``in_position`` is aaStat 4 (exact stop fine)."""

    name: str
    position: float
    referenced: bool
    in_position: bool
    encoder_compensation: float
    cross_compensation: float
    unit: AxisUnit


@dataclass(frozen=True, slots=True)
class MachineState:
    """The controller's state in one read; ``axes`` by machine axis name."""

    channel: ChannelStatus
    mode: str
    message: str
    alarms: tuple[int, ...]
    access_level: int
    axes: Mapping[str, AxisState]
    program: str = ""
