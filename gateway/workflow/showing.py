"""What a look at a stored proposal shows: one row a table, its points where they are wanted, each reason said once."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from drivers.errors import ConfigError
from drivers.limits import Limits
from drivers.local.names import shown as shown_name
from drivers.message import Message, Quantity, fixed
from gateway.domain.proposals import Proposal, TableChange, torn
from gateway.interlocks import largest_change, steepest
from gateway.store import RunFolder
from gateway.workflow.outcome import Outcome, of_table

R = TypeVar("R")
HEADINGS = tuple(
    map(
        Message.of,
        (
            "S-HEAD-TABLE",
            "S-HEAD-UNIT",
            "S-HEAD-POINTS",
            "S-HEAD-NOW",
            "S-HEAD-NEW",
            "S-HEAD-CHANGE",
            "S-HEAD-STEEPEST",
            "S-HEAD-PREDICTED",
        ),
    )
)


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
        title=Message.of("S-TITLE-TABLES"),
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


def points_of(change: TableChange) -> list[Message]:
    """Every interpolation point: where, what acts there now, what would."""
    new, places = change.new, change.new.positions
    count, live = len(new.deviations), len(change.old.deviations)
    lines = [Message.of("S-POINTS-OF", name=change.name, table=new.name, count=count, live=live)]
    for place, was, becomes in zip(places, change.old.at(places), new.deviations, strict=True):
        acts = float(was) if change.old_enabled else 0.0
        told = {"place": fixed(float(place), 3), "was": fixed(acts, 3, signed=True), "unit": new.deviation_unit}
        lines.append(Message.of("S-POINT-CHANGE", becomes=fixed(becomes, 3, signed=True), **told))
    return lines


def _row(change: TableChange) -> tuple[Message | str, ...]:
    new, limits = change.new, Limits.of(change.new.output_unit)
    acting = change.old.deviations if change.old_enabled else (0.0,)
    return (
        change.name,
        new.deviation_unit,
        str(len(new.deviations)),
        _span(acting),
        _span(new.deviations),
        _of(largest_change(change), limits.change),
        _of(steepest(new), limits.slope),
        _predicted(change),
    )


def _of(value: float, limit: float) -> Message:
    return Message.of("S-CELL-OF", value=fixed(value), limit=Quantity(limit))


def _span(values: Iterable[float]) -> Message:
    low, high = float(min(values)), float(max(values))
    if low == high:
        return Message.of("S-CELL-ONE", value=fixed(low, 1))
    return Message.of("S-CELL-SPAN", low=fixed(low, 1, signed=True), high=fixed(high, 1, signed=True))


def _predicted(change: TableChange) -> Message:
    """Largest deviation the axis will show, with its uncertainty; a cross table is judged on the flank instead."""
    if not change.predicted.size or change.layer == "cross":
        return Message.of("S-CELL-FLANK")
    largest, U = float(np.nanmax(np.abs(change.predicted))), float(np.nanmax(change.predicted_U))
    return Message.of("S-CELL-WITH-U", value=fixed(largest), U=fixed(U))
