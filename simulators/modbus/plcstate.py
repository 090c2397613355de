"""The PLC program's desk: what its commands find there, what outlives a power cut, and how a command runs."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Protocol

from simulators.modbus.registers import Image, PlcCommand
from simulators.modbus.release import PlcRelease
from simulators.modbus.switches import PlcSettings
from simulators.modbus.target import Target
from simulators.nck.whims import Forgotten

# A command gives the seconds until it is called again, and ends by returning or by PlcFault.
Work = Generator[float, None, None]


class PlcPowerCut(Exception):
    """The mains fail."""


@dataclass(slots=True)
class Load:
    """A table being loaded: the begin command, and the points' values and words received so far."""

    begin: PlcCommand
    target: Target
    values: list[int] = field(default_factory=list)
    words: list[int] = field(default_factory=list)
    lost: set[int] = field(default_factory=set)


@dataclass(slots=True)
class Retentive:
    """What outlives a power cut."""

    marker: tuple[int, ...] = (0,) * 8
    marker_state: int = 0
    marker_head: tuple[int, ...] = (0,) * 4
    half: set[tuple[int, int, int]] = field(default_factory=set)


class PlcDesk(Protocol):
    """What the commands need of the PLC around them."""

    image: Image
    settings: PlcSettings
    memory: Retentive
    load: Load | None
    session: int
    waiting: bool
    confirmed: bool
    lied: set[tuple[int, int, int]]
    loads_done: int

    backlash: dict[tuple[int, int, int], int]
    release: PlcRelease

    def now(self) -> float:
        """Seconds of the PLC's clock."""
        ...

    def turn_key_back(self) -> None:
        """The person takes the release back."""
        ...

    def open_session(self, number: int) -> None:
        """A session begins."""
        ...

    def close_session(self) -> None:
        """The session ends."""
        ...

    def forget(self, what: Forgotten) -> None:
        """What was kept is lost: words of the PLC, or points or switches of the control."""
        ...

    def do_again(self, target: Target) -> None:
        """A table that was just switched on is switched on once more, later, whatever was done to it since."""
        ...

    def switches(self, target: Target) -> int:
        """The switch bits as the PLC shows them."""
        ...

    def is_off(self, target: Target) -> bool:
        """Whether the PLC takes the table for off."""
        ...
