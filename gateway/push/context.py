"""What a push works with: the machine's port, the axis, the consent, the clock and where to keep things."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from drivers.clock import Clock
from drivers.ports import Controller
from drivers.types import Ambient, CompensationTable, MachineIdentity, SignProof
from drivers.units import AxisUnit
from gateway.domain import Approval, Capture
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

    ``axis`` is the table's output axis, ``input`` its input axis where that is another (CEC). ``proof`` must be
    that of the table's function and output axis. ``pushed`` are tables this run has committed before: they are
    expected in the live set although the capture did not see them.

    ``actor`` is who pushes, ``approvals`` who else agreed, ``approvals_needed`` how many people the site asks
    for (None: one, two when anything warns). ``audit_broken`` says why the audit cannot be trusted. ``key`` is
    the caller's transaction key: the same key with the same plan gives the same answer.

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
    input: AxisFacts | None = None
    pushed: tuple[CompensationTable, ...] = ()
    actor: str = ""
    approvals: tuple[Approval, ...] = ()
    approvals_needed: int | None = None
    audit_broken: str = ""
    key: str = ""

    @property
    def moved(self) -> AxisFacts:
        """The axis that must stand where old and new table agree: the input axis."""
        return self.input or self.axis

    @property
    def sign(self) -> int:
        """What stored CEC values are multiplied with to become deviations; +1 without a proof."""
        return self.proof.sign if self.proof is not None and self.proof.function == "CEC" else 1
