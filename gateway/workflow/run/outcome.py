"""What a run hands back to whoever started it: rows, lines, data and an exit code."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from drivers.message import Message

WORSE_EXIT = 9
LIMIT_EXCEEDED, CANNOT_TELL = 13, 21


@dataclass(frozen=True, slots=True)
class Outcome:
    """A finished run: the rows of its table, with ``headings`` for each column, what is said, and where all is kept.

    ``lines`` are what became of it, the most important one last; ``places`` say where its files are.
    ``points`` are lines for who asks for every interpolation point, ``details`` for who wants to read everything that
    the report says.
    """

    state: str
    run_folder: str
    rows: tuple[tuple[Message | str, ...], ...]
    lines: tuple[Message, ...]
    data: dict[str, Any]
    exit_code: int = 0
    title: Message | str = ""
    headings: tuple[Message | str, ...] = ()
    points: tuple[Message, ...] = ()
    details: tuple[Message, ...] = ()
    places: tuple[Message, ...] = ()

    def as_data(self) -> dict[str, Any]:
        """The outcome as JSON data."""
        return {"state": self.state, "run_folder": self.run_folder, **self.data}


def of_table(name: str, *said: Message) -> Message:
    """What is said of a table or axis."""
    return Message.of("S-REPORT-AXIS", axis=name, said=said)


def of_verdicts(verdicts: Iterable[str]) -> int:
    """The code of some verdicts ("pass", "fail", "not decidable"): one that fails stands before one that is open."""
    said = set(verdicts)
    if "fail" in said:
        return LIMIT_EXCEEDED
    return CANNOT_TELL if "not decidable" in said else 0


def with_alarms(outcome: Outcome, alarms: tuple[Message, ...]) -> Outcome:
    """The outcome of a run that has met alarms: it says them and ends with exit code 9."""
    if not alarms:
        return outcome
    lines = (*outcome.lines, *(Message.of("W-TABLE-ALARM", alarm=alarm) for alarm in alarms))
    data = {**outcome.data, "alarms": list(map(str, alarms))}
    return replace(outcome, lines=lines, data=data, exit_code=outcome.exit_code or WORSE_EXIT)
