"""What a machine is known by, and which changes of it a person accepted: the facts of one site in their order."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class KnownFact:
    """One fact of `drivers.types.identity.FACTS` of the machine that is kept under ``serial``.

    It was read for the first time at ``utc`` (``reason`` ""), or ``who`` accepted then that it is ``value`` and no
    longer ``was``. ``number`` counts the facts of a machine from 1.
    """

    number: int
    serial: str
    fact: str
    value: str
    utc: str
    was: str = ""
    who: str = ""
    reason: str = ""

    @property
    def accepted(self) -> bool:
        """Whether a person answers for it."""
        return bool(self.reason)

    @property
    def fields(self) -> dict[str, str]:
        """An accepted change, for the texts that tell it."""
        told = {"fact": self.fact, "was": self.was, "now": self.value, "who": self.who, "reason": self.reason}
        return {**told, "utc": self.utc[:10]}


@dataclass(frozen=True, slots=True)
class KnownMachine:
    """``facts`` by name, as they must be read now; ``accepted`` are the changes that led there, oldest first."""

    facts: Mapping[str, str]
    accepted: tuple[KnownFact, ...] = ()


def known_machine(stated: Mapping[str, str], kept: Iterable[KnownFact]) -> KnownMachine:
    """The facts that a site file states, then what was kept since, in its order.

    A change counts while it begins at what was known: who corrects a fact in the site file takes it back with that.
    """
    facts, accepted = dict(stated), list[KnownFact]()
    for one in sorted(kept, key=lambda one: one.number):
        if not one.accepted:
            facts.setdefault(one.fact, one.value)
        elif facts.get(one.fact) == one.was:
            facts[one.fact] = one.value
            accepted.append(one)
    return KnownMachine(facts, tuple(accepted))
