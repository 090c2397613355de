"""What a push works with: the machine's port, the axis, the consent, the clock and where to keep things."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from drivers.clock import Clock
from drivers.ports import Controller
from drivers.types import Ambient, MachineIdentity, SignProof
from drivers.units import AxisUnit
from gateway.domain import Capture
from gateway.say import Say, silence


class Keeper(Protocol):
    """Where texts are kept for good: a run folder. Returns the path once the text is durable."""

    def write_text(self, name: str, text: str) -> Path:
        """Keep a text exactly as given."""
        ...


@dataclass(frozen=True, slots=True)
class AxisFacts:
    """One axis: ``name`` as in MD10000, ``letter`` as programs call it; positions and overrun in its unit.

    ``feed`` in mm/min or deg/min; ``dwell_s`` before each hand-shake.
    """

    name: str
    letter: str
    unit: AxisUnit
    rotary: bool
    modulo: bool
    travel: tuple[float, float]
    reference: float
    feed: float
    overrun: float = 5.0
    dwell_s: float = 1.0
    encoder: int = 0


@dataclass(frozen=True, slots=True)
class PushContext:
    """Everything a push may use.

    ``journals`` is the folder of all machines' journals; ``machine`` the fingerprint the run was made on;
    ``typed_name`` what the operator gave as the machine's name, ``site_name`` what it must be. Timeouts in s of
    the clock: for a person to press NC START or do a reference run, and for one move to end.
    """

    controller: Controller
    clock: Clock
    folder: Keeper
    journals: Path
    axis: AxisFacts
    machine: MachineIdentity
    typed_name: str
    site_name: str
    proof: SignProof | None = None
    capture: Capture | None = None
    ambient_now: Ambient | None = None
    start_timeout_s: float = 600.0
    stop_timeout_s: float = 120.0
    modes: tuple[str, ...] = ("AUTO",)
    harmless_alarms: tuple[int, ...] = ()
    access_level_needed: int = 3
    say: Say = field(default=silence)
