"""What a dynamic capture is told and tells: its trigger, the signal, the live view, how it ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from drivers.errors import ConfigError
from drivers.message import Message
from drivers.types.values import FloatArray
from drivers.units import ARCSEC_PER_DEG, ARCSEC_PER_RAD, UM_PER_MM, DeviationUnit

# What a channel's last word means: unit of the record and how many of them one is.
CHANNEL_UNITS: dict[str, tuple[DeviationUnit, float]] = {
    "mm": ("um", UM_PER_MM),
    "um": ("um", 1.0),
    "nm": ("um", 1e-3),
    "deg": ("arcsec", ARCSEC_PER_DEG),
    "arcsec": ("arcsec", 1.0),
    "mrad": ("arcsec", ARCSEC_PER_RAD / 1e3),
    "urad": ("arcsec", ARCSEC_PER_RAD / 1e6),
}
TriggerKind = Literal["none", "value", "level", "external"]


@dataclass(frozen=True, slots=True)
class Trigger:
    """When a capture begins.

    "none": at once. "value": the signal has gone ``at`` away from where it stood first. "level": it crosses
    ``at``, upward or downward. "external": the instrument says so by an event that begins with "trigger".
    ``at`` in the record's unit; ``pre_s`` of the samples before are kept.
    """

    kind: TriggerKind = "none"
    at: float = 0.0
    pre_s: float = 0.1


@dataclass(frozen=True, slots=True)
class StreamShape:
    """The signal's description, known with the first samples: ``values * scale`` is in ``unit``."""

    channel: str
    rate_hz: float
    unit: DeviationUnit
    scale: float
    trigger: int | None


class Sink(Protocol):
    """Where samples go; the store's recorder is one."""

    def append(self, block: FloatArray, lost: int = 0) -> None:
        """Take samples (n,); ``lost`` are missing just before them."""
        ...


@dataclass(frozen=True, slots=True)
class LiveView:
    """A decimated look at the last while: smallest, largest and mean in the record's unit; counts since the start."""

    time_s: float
    low: float
    high: float
    mean: float
    samples: int
    lost: int
    waiting: bool


@dataclass(frozen=True, slots=True)
class Ended:
    """How a capture ended: "complete", or "beam" where the beam was lost (what was before is whole)."""

    why: Literal["complete", "beam", "stream"]
    samples: int
    lost: int
    notes: tuple[Message, ...] = ()


def unit_of(channel: str) -> tuple[DeviationUnit, float]:
    """Unit and scale of a channel by its name. Raises ConfigError (E-CAP-CHANNEL)."""
    word = channel.rpartition("_")[2]
    if word not in CHANNEL_UNITS:
        raise ConfigError("E-CAP-CHANNEL", channel, known=", ".join(CHANNEL_UNITS))
    return CHANNEL_UNITS[word]
