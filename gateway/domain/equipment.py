"""What a run was made with, and how an instrument's sense was proved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from drivers.types.identity import Identity, MachineIdentity
from gateway.domain.identity import KnownFact


@dataclass(frozen=True, slots=True)
class Item:
    """One device of the run: who it said it was and what it cannot see."""

    name: str
    identity: Identity
    notices: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Equipment:
    """What the run was made with; ``accepted`` are changes of the machine's identity that a person answers for."""

    machine: MachineIdentity
    items: tuple[Item, ...]
    started_utc: str
    accepted: tuple[KnownFact, ...] = ()


@dataclass(frozen=True, slots=True)
class SenseProof:
    """How an instrument's sense was proved: ``sense`` multiplies its readings; scale is reading / jog."""

    instrument: str
    axis: str
    sense: Literal[1, -1]
    scale: float
    evidence: tuple[float, ...]
