"""Reasons against a table that the axis itself gives: a cross table on, fine structure, reversal, scatter; pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivers.message import Form, Message
from drivers.types.doubts import Doubt
from drivers.types.tables import CompensationTable, LiveSet
from drivers.units import DeviationUnit
from gateway.domain.proposals import TableFinding
from gateway.domain.values import FloatArray
from gateway.table.chances import Chance
from gateway.table.limits import finding, reason, reasons_of

MOST_UNSEEN = 0.5
WORTH_SAYING = 0.25
OUTWEIGHS = 2.0


def in_doubt(axis: str, doubts: Sequence[Doubt]) -> Message | None:
    """Why no table is made of readings that leave a doubt which nobody settled; None without such."""
    said = tuple(replace(one.message, form=Form.REASON, where="") for one in doubts if one.blocking)
    return reason("S-DOUBT-TABLE", axis, doubts=said) if said else None


def accepted(axis: str, doubts: Sequence[Doubt]) -> tuple[TableFinding, ...]:
    """A finding for each doubt that a person settled: another person reads it before the push."""
    return tuple(
        finding("W-DOUBT-ACCEPTED", axis, named=one.code, reason=one.settled, doubt=one.message)
        for one in doubts
        if one.settled
    )


def other_layer(axis: str, live: LiveSet) -> Message | None:
    """One by the axis' own position looks like its deviation; by another axis' position it is a constant here.

    One of each direction is a reversal: half of it up and half of it down leave the mean of both as it is.
    """
    acted = [
        str(one.table.index)
        for one in live.cross
        if one.enabled and _by_itself(one.table) and any(one.table.deviations)
    ]
    return reason("S-COMP-CROSS-ON", axis, tables=", ".join(acted)) if acted else None


def _by_itself(table: CompensationTable) -> bool:
    return table.input_axis == table.output_axis and table.direction == 0


def unseen(axis: str, unit: DeviationUnit, hidden: float, taken: float, chance: Chance | None = None) -> Message:
    """Why ``hidden`` structure (RMS) forbids a table that takes ``taken`` (RMS) away, and what its chances would be."""
    why = reason("S-COMP-HIDDEN", axis, hidden=f"{hidden:.2g}", gain=f"{taken:.2g}", unit=unit)
    if chance is None:
        return why
    return reasons_of(why, reason("S-COMP-CHANCE", axis, unit=unit, **_figures(chance)))


def by_chance(axis: str, unit: DeviationUnit, hidden: float, chance: Chance) -> TableFinding:
    """The label of a table that is proposed although ``hidden`` structure (RMS) stays: a second person is asked for."""
    return finding("W-COMP-CHANCE", axis, hidden=f"{hidden:.2g}", unit=unit, **_figures(chance))


def by_gain(axis: str, unit: DeviationUnit, before: float, left: float, chance: Chance) -> TableFinding:
    """The label of a table that leaves more than half (RMS) of an axis and gains all the same: a second person too."""
    sizes = {"before": f"{before:.2g}", "left": f"{left:.2g}"}
    return finding("W-COMP-LEAVES", axis, unit=unit, **sizes, **_figures(chance))


def by_scatter(axis: str, unit: DeviationUnit, scatter: float, chance: Chance) -> TableFinding:
    """The label of a table on an axis whose single readings scatter much (s), and that gains all the same."""
    return finding("W-COMP-SCATTERS", axis, unit=unit, scatter=f"{scatter:.2g}", **_figures(chance))


def _figures(chance: Chance) -> dict[str, str]:
    return {"gain": f"{chance.gain:.2g}", "u": f"{chance.u:.2g}", "worse": f"{100.0 * chance.worse:.0f}"}


def may_harm(hidden: float, taken: float) -> bool:
    """Whether the axis might get worse, however unlucky the hidden structure lies to the correction.

    With correction c and hidden h (RMS over the axis) the square of the error falls by |c|^2 + 2 <c, h> at least
    |c|^2 - 2 |c| |h| (Cauchy and Schwarz): never below zero while |h| <= |c| / 2.
    """
    return hidden > MOST_UNSEEN * taken


def doubtful(axis: str, unit: DeviationUnit, hidden: float, taken: float) -> tuple[TableFinding, ...]:
    """A warning where hidden structure stays that is worth a second look."""
    if hidden <= WORTH_SAYING * taken:
        return ()
    return (finding("W-COMP-HIDDEN", axis, hidden=f"{hidden:.2g}", gain=f"{taken:.2g}", unit=unit),)


def one_place(
    axis: str, unit: DeviationUnit, per: str, place: tuple[float, float], taken: float
) -> tuple[TableFinding, ...]:
    """A warning of the target furthest out of the line of its neighbours, however smooth the axis is elsewhere.

    One place is little of an RMS over the travel, and still all that a table may do wrong there.
    """
    at, off = place
    if off <= WORTH_SAYING * taken:
        return ()
    return (finding("W-COMP-PLACE", axis, at=f"{at:.4g}", per=per, off=f"{off:.2g}", unit=unit),)


def outweighed(
    axis: str, unit: DeviationUnit, means: FloatArray, after: FloatArray, rest: float, U: FloatArray
) -> Message | None:
    """Where reversal and scatter (``rest``, RMS) are most of the error, the whole must fall by more than the table's U.

    ``means`` and ``after`` (m,) are the means of both directions now and as predicted, ``U`` (m,) of these (k = 2).
    """
    now, then, bound = float(np.nanstd(means)), float(np.nanstd(after)), float(np.sqrt(np.nanmean(U**2)))
    before, left = float(np.hypot(now, rest)), float(np.hypot(then, rest))
    if rest <= OUTWEIGHS * now or before - left > bound:
        return None
    fields = {"before": f"{before:.3g}", "after": f"{left:.3g}", "U": f"{bound:.2g}", "rest": f"{rest:.3g}"}
    return reason("S-COMP-REVERSAL", axis, **fields, unit=unit)
