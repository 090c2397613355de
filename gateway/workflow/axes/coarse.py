"""What no table of an axis can hold, in words, and whether one that holds little is worth writing; pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivers.limits import Limits
from drivers.message import Message, Quantity, digits
from drivers.types.tables import LiveTable
from drivers.types.values import FloatArray
from gateway.config import AxisSection
from gateway.domain.proposals import TableChange
from gateway.interlocks import Refusal, gain_refusals
from gateway.model.components import value
from gateway.table import Grid, proposal
from gateway.table.benefit_probability import held_by
from gateway.table.comparison import effective
from gateway.table.limits import reasons_of
from gateway.table.proposal import InstrumentU, probability_for
from gateway.workflow.axes.structure import Structure

FINER = (2, 4, 5, 8, 10)
MUCH_LESS = 0.25


def cannot_hold(axis: AxisSection, shown: Structure) -> tuple[Message, ...]:
    """What the control's grid leaves of the axis' curve, and the grid that would hold it; () where it leaves little."""
    lattice, step = shown.seen.lattice, axis.table.step
    curve = value(shown.component, lattice)
    rest = _rest(axis, lattice, curve, step)
    unit = shown.capture.unit
    if rest <= InstrumentU.usual(unit).constant / 2.0:
        return ()
    fields = {"step": Quantity(step), "rest": digits(rest), "unit": unit, "per": axis.unit}
    slope, limit = float(np.max(np.abs(np.gradient(curve, lattice)))), Limits.of(axis.unit).slope
    if slope > limit:
        return (Message.of("S-COMP-TOO-STEEP", slope=digits(slope), limit=Quantity(limit), **fields),)
    for times in FINER:
        left = _rest(axis, lattice, curve, step / times)
        if left <= MUCH_LESS * rest:
            points = round((axis.table.maximum - axis.table.minimum) / step * times) + 1
            finer = {"finer": Quantity(step / times), "points": points, "left": digits(left)}
            return (Message.of("S-COMP-COARSE", **fields, **finer),)
    return (Message.of("S-COMP-COARSE-ANY", **fields),)


def _rest(axis: AxisSection, lattice: FloatArray, curve: FloatArray, step: float) -> float:
    held = held_by(Grid(axis.table.minimum, axis.table.maximum, step), lattice, modulo=axis.modulo)
    return float(np.std(curve - held @ curve))


def if_worth(change: TableChange, shown: Structure, instrument: InstrumentU) -> TableChange:
    """The change, labelled where its chances speak for it; or skipped with every reason why it gains too little."""
    if change.skipped:
        return change
    against = gain_refusals(shown.capture, change)
    if against:
        change = by_its_chances(change, shown, instrument, against)
        against = gain_refusals(shown.capture, change)
    return replace(change, skipped=reasons_of(*(one.message for one in against))) if against else change


def by_its_chances(
    change: TableChange, shown: Structure, instrument: InstrumentU, against: Sequence[Refusal]
) -> TableChange:
    """The change with its chance by all axes that explain the readings, labelled where that makes it worth writing.

    A wrong sign or datum gains nothing on any of them. Each label answers one reason ``against`` it and asks for a
    second person.
    """
    acts = effective(LiveTable(change.old, enabled=change.old_enabled))
    chance = probability_for(shown.possible(), instrument, acts, change.new)
    if chance is None or not chance.worth:
        return change
    unit, labels = change.new.deviation_unit, []
    for one in against:
        if one.code == "E-INT-GAIN":
            before, left = float(np.nanstd(shown.means.mean)), float(np.nanstd(change.predicted))
            labels.append(proposal.by_gain(change.axis, unit, before, left, chance=chance))
        else:
            labels.append(proposal.by_scatter(change.axis, unit, shown.means.s, chance))
    return replace(change, chance=chance, findings=(*change.findings, *labels))
