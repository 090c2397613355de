"""NC programs as they cross the port: in whose name they are sent, their text, and what a control is without one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from drivers.types import DisableOrder, PushOrder, StopPlan, TableQuestion
from drivers.workpiece import GrindPlan


@dataclass(frozen=True, slots=True)
class Origin:
    """Whose programs these are, for the head of each: site, serial number of the machine, run, our version."""

    site: str = ""
    machine: str = ""
    run: str = ""
    version: str = ""


NOBODY = Origin()


@dataclass(frozen=True, slots=True)
class ProgramText:
    """A program: its path in the control (/_N_MPF_DIR/_N_TFMEAS_X1_MPF) and its blocks."""

    path: str
    text: str

    @property
    def file_name(self) -> str:
        """What the file is called outside a control: TFMEAS_X1.MPF."""
        name, _, ending = self.path.rpartition("/")[2].removeprefix("_N_").rpartition("_")
        return f"{name}.{ending}"


@dataclass(frozen=True, slots=True)
class SelfTest:
    """Try every word that our programs need, for one compensated axis and its measuring system; nothing moves."""

    axis: str
    encoder: int = 0


Order = StopPlan | TableQuestion | PushOrder | DisableOrder | GrindPlan | SelfTest
"""What a program is written for."""


@dataclass(frozen=True, slots=True)
class PaperMachine:
    """What a program must know of a control, where there is none to ask.

    ``axes``: machine axis names; ``modulo``: those that turn endlessly; ``own_points``: points that axis tables have
    reserved, by axis; ``cross_points``: those of cross tables, by number.
    """

    axes: tuple[str, ...]
    modulo: frozenset[str] = frozenset()
    own_points: Mapping[str, int] = field(default_factory=dict)
    cross_points: tuple[int, ...] = ()


@runtime_checkable
class SendsPrograms(Protocol):
    """A controller that sends programs: in somebody's name, and each is kept before it is sent."""

    def attend(self, origin: Origin, keep: Callable[[ProgramText], None]) -> None:
        """From now on programs carry ``origin`` in their head; ``keep`` is called with each before it is sent."""
        ...
