"""What a look at a stored proposal shows: one row a table, its points where they are wanted, each reason said once."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from drivers.errors import ConfigError
from drivers.limits import Limits
from drivers.local.names import shown as shown_name
from drivers.message import Message
from gateway.domain.proposals import Proposal, TableChange, torn
from gateway.interlocks import largest_change, steepest
from gateway.store import RunFolder
from gateway.workflow.outcome import Outcome, of_table

R = TypeVar("R")
HEADINGS = ("table", "unit", "points", "now", "new", "largest change", "steepest", "predicted (k=2)")


def shown(
    folder: RunFolder, proposal: Proposal, refusals: Mapping[str, list[Message]], *, refused_by: Collection[str]
) -> Outcome:
    """What `push` without consent shows: peak, change, prediction and limits of each table, every reason against it.

    ``refused_by``: codes of the reasons that would refuse the push; the others are told beforehand.
    """
    rows = tuple(_row(change) for change in proposal.changes if not change.skipped)
    lines = [of_table(names, reason) for names, reason in once((c.name, refusals[c.name]) for c in proposal.changes)]
    fine = [change.name for change in proposal.changes if not refusals[change.name]]
    lines += [Message.of("W-PUSH-FINE", tables=", ".join(fine))] if fine else []
    lines.append(Message.of("W-PUSH-SHOWN"))
    data: dict[str, Any] = {
        "refused": bool(refused_by),
        "refused_by": sorted(refused_by),
        "refusals": {name: list(map(str, against)) for name, against in refusals.items()},
        "not_corrected": {c.name: str(c.skipped) for c in proposal.changes if c.skipped},
    }
    return Outcome(
        state=folder.state,
        run_folder=str(folder.path),
        rows=rows,
        lines=tuple(lines),
        data=data,
        title="proposed tables, largest change and slope with their limits",
        headings=HEADINGS,
        points=tuple(line for change in proposal.changes if not change.skipped for line in points_of(change)),
    )


def narrowed(proposal: Proposal, tables: Collection[str]) -> Proposal:
    """The proposal of these tables alone, by their names. Raises ConfigError (E-RUN-AXIS, E-RUN-PAIR)."""
    known = [change.name for change in proposal.changes]
    for name in tables:
        if name not in known:
            raise ConfigError("E-RUN-AXIS", "proposal", axis=shown_name(name), known=", ".join(known))
    chosen = tuple(change for change in proposal.changes if change.name in tables)
    missing = torn(chosen, proposal.changes)
    if missing:
        raise ConfigError("E-RUN-PAIR", chosen[0].axis, missing=", ".join(missing))
    return replace(proposal, changes=chosen) if chosen else proposal


def once(told: Iterable[tuple[str, Iterable[R]]]) -> list[tuple[str, R]]:
    """(names, reason) with each reason once, in the order in which it came up first."""
    names: dict[R, list[str]] = {}
    for name, reasons in told:
        for reason in reasons:
            names.setdefault(reason, []).append(name)
    return [(", ".join(dict.fromkeys(found)), reason) for reason, found in names.items()]


def points_of(change: TableChange) -> list[str]:
    """Every interpolation point: where, what acts there now, what would."""
    new, places = change.new, change.new.positions
    lines = [f"{change.name}: {new.name} {len(new.deviations)} points, live {len(change.old.deviations)} points"]
    for place, was, becomes in zip(places, change.old.at(places), new.deviations, strict=True):
        acts = float(was) if change.old_enabled else 0.0
        lines.append(f"  {place:10.3f} {acts:+9.3f} -> {becomes:+9.3f} {new.deviation_unit}")
    return lines


def _row(change: TableChange) -> tuple[str, ...]:
    new, limits = change.new, Limits.of(change.new.output_unit)
    acting = change.old.deviations if change.old_enabled else (0.0,)
    return (
        change.name,
        new.deviation_unit,
        str(len(new.deviations)),
        _span(acting),
        _span(new.deviations),
        f"{largest_change(change):.2f} of {limits.change:g}",
        f"{steepest(new):.2f} of {limits.slope:g}",
        _predicted(change),
    )


def _span(values: Iterable[float]) -> str:
    low, high = float(min(values)), float(max(values))
    return f"{low:+.1f} .. {high:+.1f}" if low != high else f"{low:.1f}"


def _predicted(change: TableChange) -> str:
    """Largest deviation the axis will show, with its uncertainty; a cross table is judged on the flank instead."""
    if not change.predicted.size or change.layer == "cross":
        return "on the flank"
    return f"{np.nanmax(np.abs(change.predicted)):.2f} +- {np.nanmax(change.predicted_U):.2f}"
