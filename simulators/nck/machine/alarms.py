"""Alarms of the control: number, text and what clears them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Clear = Literal["start", "cancel", "reset", "power_on"]

STOPPING = frozenset({"reset", "power_on"})
POWER_ON_LOCK = 4076


@dataclass(frozen=True, slots=True)
class Alarm:
    """One alarm; ``clear``: the next NC start, the cancel key, channel reset, or power on."""

    number: int
    text: str
    clear: Clear


class AlarmList:
    """The alarms standing, oldest first; one entry for each number."""

    def __init__(self) -> None:
        self._standing: list[Alarm] = []

    @property
    def standing(self) -> tuple[Alarm, ...]:
        """All alarms standing."""
        return tuple(self._standing)

    def __contains__(self, number: int) -> bool:
        return any(alarm.number == number for alarm in self._standing)

    def raise_(self, number: int, text: str, clear: Clear = "cancel") -> None:
        """Show an alarm; a number already standing is not shown twice."""
        if number not in self:
            self._standing.append(Alarm(number, text, clear))

    def show_while(self, cause: bool, number: int, text: str) -> None:
        """Show an alarm as long as its cause is there; power on clears it too."""
        if cause:
            self.raise_(number, text, "power_on")
        else:
            self.drop(number)

    def drop(self, number: int) -> None:
        """Its cause has gone."""
        self._standing = [alarm for alarm in self._standing if alarm.number != number]

    def clear(self, *kinds: Clear) -> tuple[Alarm, ...]:
        """Clear the alarms of these kinds; returns what was cleared."""
        gone = tuple(alarm for alarm in self._standing if alarm.clear in kinds)
        self._standing = [alarm for alarm in self._standing if alarm.clear not in kinds]
        return gone

    @property
    def lock_start(self) -> bool:
        """Whether NC start is locked."""
        return any(alarm.clear == "reset" or alarm.number == POWER_ON_LOCK for alarm in self._standing)
