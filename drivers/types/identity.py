"""Who a device and a machine say they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal, Protocol, runtime_checkable

FACTS = ("serial", "version", "axes", "type", "marker")
"""What a machine is known by, as a site file names it: no one of them is the machine."""


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
    """The fingerprint of a machine, all of it compared before every write.

    ``type`` (of the control's hardware) and ``marker`` (of the site, in an R parameter) are "" where they are not read,
    and then nothing is compared with them.
    """

    serial: str
    version: str
    axis_names: tuple[str, ...]
    unit_system: Literal["metric", "inch"] = "metric"
    type: str = ""
    marker: str = ""

    def differences(self, other: MachineIdentity) -> tuple[str, ...]:
        """Names of the fields that differ."""
        always = [
            name
            for name in ("serial", "version", "axis_names", "unit_system")
            if getattr(self, name) != getattr(other, name)
        ]
        read = [(name, getattr(self, name), getattr(other, name)) for name in ("type", "marker")]
        return (*always, *(name for name, one, two in read if one and two and one != two))

    @property
    def facts(self) -> Mapping[str, str]:
        """The facts of `FACTS` that were read, as text; axes in machine order."""
        read = (self.serial, self.version, " ".join(self.axis_names), self.type, self.marker)
        return {name: value for name, value in zip(FACTS, read, strict=True) if value}


@dataclass(frozen=True, slots=True)
class FactChange:
    """One fact of `FACTS` that is another than it was."""

    fact: str
    was: str
    now: str


@dataclass(frozen=True, slots=True)
class Likeness:
    """A machine beside what is known of it: what is another now, what agrees, what nobody could read or knew."""

    changed: tuple[FactChange, ...]
    same: tuple[str, ...]
    unread: tuple[str, ...]

    @property
    def is_known(self) -> bool:
        """Every fact that could be compared agrees."""
        return not self.changed

    @property
    def is_asked(self) -> bool:
        """One fact is another and at least one more agrees: a person can say whether it is the same machine."""
        return len(self.changed) == 1 and bool(self.same)

    @property
    def told(self) -> str:
        """What is another, in one line."""
        return "; ".join(f"{one.fact}: {one.was} -> {one.now}" for one in self.changed)


def likeness(known: Mapping[str, str], machine: MachineIdentity) -> Likeness:
    """What a machine tells of itself beside the facts that are ``known``, by `FACTS`; "" is unknown."""
    now = machine.facts
    both = [fact for fact in FACTS if known.get(fact) and fact in now]
    changed = tuple(FactChange(fact, known[fact], now[fact]) for fact in both if known[fact] != now[fact])
    others = {one.fact for one in changed}
    return Likeness(
        changed, tuple(fact for fact in both if fact not in others), tuple(fact for fact in FACTS if fact not in both)
    )


@runtime_checkable
class Renamed(Protocol):
    """A controller that can tell a machine by the serial number under which everything of it is kept."""

    known_as: Mapping[str, str]


class KnownAs:
    """A controller's part of it: ``known_as`` are numbers that its control gives, with those they stand for.

    A person accepted each (a memory card that was exchanged at service), or there is none.
    """

    known_as: Mapping[str, str] = MappingProxyType({})

    def called(self, machine: MachineIdentity) -> MachineIdentity:
        """The machine by the serial number that everything kept of it carries.

        A control that gives that very number now is another one: the card that was taken out works elsewhere.
        """
        if machine.serial not in self.known_as and machine.serial in self.known_as.values():
            return replace(machine, serial=f"{machine.serial} (elsewhere)")
        return replace(machine, serial=self.known_as.get(machine.serial, machine.serial))
