"""What a run hands back to whoever started it: rows, lines, data and an exit code."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from drivers.errors import words
from gateway.domain.proposals import Proposal
from gateway.store import RunFolder

WORSE_EXIT = 9


@dataclass(frozen=True, slots=True)
class Outcome:
    """A finished run: before/after rows (axis, parameter, before, after, unit, change) and where all is kept."""

    state: str
    run_folder: str
    rows: tuple[tuple[str, str, str, str, str, str], ...]
    lines: tuple[str, ...]
    data: dict[str, Any]
    exit_code: int = 0

    def as_data(self) -> dict[str, Any]:
        """The outcome as JSON data."""
        return {"state": self.state, "run_folder": self.run_folder, **self.data}


def shown(folder: RunFolder, proposal: Proposal, refusals: Mapping[str, list[str]]) -> Outcome:
    """What `push` without consent shows: each table's difference and every reason against writing it."""
    lines: list[str] = []
    for change in proposal.changes:
        old, new = change.old, change.new
        lines.append(f"{change.name}: {new.name} {len(new.deviations)} points, live {len(old.deviations)} points")
        if not change.skipped:
            places = new.positions
            for place, was, becomes in zip(places, old.at(places), new.deviations, strict=True):
                acts = float(was) if change.old_enabled else 0.0
                lines.append(f"  {place:10.3f} {acts:+9.3f} -> {becomes:+9.3f} {new.deviation_unit}")
        lines += [f"  {reason}" for reason in refusals[change.name]] or ["  nothing speaks against it"]
    lines.append("nothing was written; live tables are compared when the push is applied")
    data = {"refusals": dict(refusals), "not_corrected": {c.axis: c.skipped for c in proposal.changes if c.skipped}}
    return Outcome(state=folder.state, run_folder=str(folder.path), rows=(), lines=tuple(lines), data=data)


def alarmed(outcome: Outcome, alarms: tuple[str, ...]) -> Outcome:
    """The outcome of a run that has met alarms: it says them and ends with exit code 9."""
    if not alarms:
        return outcome
    lines = (*outcome.lines, *(words("W-TABLE-ALARM", alarm=alarm) for alarm in alarms))
    data = {**outcome.data, "alarms": list(alarms)}
    return replace(outcome, lines=lines, data=data, exit_code=outcome.exit_code or WORSE_EXIT)
