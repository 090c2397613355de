"""From measured axes to a stored proposal: fit, sample on the controller's grid, merge, judge."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from drivers.limits import Limits
from drivers.message import Message, Quantity, digits, fixed
from drivers.types.abilities import Capabilities, TableLimits
from drivers.types.tables import LiveSet, LiveTable
from drivers.types.values import FloatArray
from drivers.units import deviation_scale
from gateway.config import AxisSection
from gateway.domain.captures import Capture
from gateway.domain.proposals import Proposal, TableChange
from gateway.errors import CaptureError
from gateway.evaluate.behaviour.doubts import blocking_doubts
from gateway.evaluate.behaviour.repetitions import RobustMeans
from gateway.interlocks import Refusal, gain_refusals
from gateway.model.components import value
from gateway.table import Grid, MeasuredMeans, proposal
from gateway.table import propose as propose_table
from gateway.table.benefit_probability import held_by
from gateway.table.comparison import effective
from gateway.table.limits import reasons_of
from gateway.table.proposal import InstrumentU, probability_for
from gateway.workflow.axes.measure import MeasuredAxis
from gateway.workflow.axes.reversal import remaining_reversal, reversal_changes, reversal_of_capture, split_by_direction
from gateway.workflow.axes.structure import Structure, structure_of
from gateway.workflow.run import stages
from gateway.workflow.run.audit_trail import record_proposal, report_log_problem
from gateway.workflow.run.context import RunContext
from gateway.workflow.run.self_test import self_test_warnings


async def propose(at: RunContext, measured: Mapping[str, MeasuredAxis]) -> Proposal:
    """Fit every measured axis and store the proposal for the machine. Raises TableError, ModelError."""
    changes = await axis_changes(at, measured)
    return store_proposal(at, changes, tuple(item.digest for item in measured.values()))


async def axis_changes(at: RunContext, measured: Mapping[str, MeasuredAxis]) -> tuple[TableChange, ...]:
    """The changes of every measured axis, its table and its reversal, the fit stored. Raises TableError, ModelError."""
    found: list[TableChange] = []
    for name, item in measured.items():
        taken = {one.new.index for one in found if one.new.kind == "cross"}
        found += await _changes(at, at.axis(name), item, taken)
    return tuple(found)


def store_proposal(at: RunContext, changes: tuple[TableChange, ...], parents: tuple[str, ...]) -> Proposal:
    """Store a proposal of these changes for the machine, and tell it."""
    said = self_test_warnings(at, (change.axis for change in changes if not change.skipped))
    proposal = Proposal(at.machine, changes, parents, at.clock.utc().isoformat(timespec="seconds"), warnings=said)
    at.folder.put(stages.PROPOSAL, proposal, parents)
    report_log_problem(at, record_proposal(at, proposal))
    for change in changes:
        at.say("P-PROPOSED", axis=change.name, words=change.skipped or size_of(change))
    return proposal


async def _changes(at: RunContext, axis: AxisSection, item: MeasuredAxis, taken: Collection[int]) -> list[TableChange]:
    capture = item.capture
    if capture.live is None:
        raise CaptureError("E-RUN-LIVE", axis.name)
    shown = structure_of(axis, capture)
    hidden = replace(shown.hidden, words=(*shown.hidden.words, *describe_coarse_grid(axis, shown)))
    at.say("P-HIDDEN", axis=axis.name, words=hidden.words)
    at.folder.put(stages.hidden(axis.name), hidden, (item.digest,))
    at.folder.put(stages.component(axis.name), shown.doubted, (item.digest,))
    can = at.supervisor.controller.capabilities
    limits = await at.supervisor.controller.table_limits(axis.name, "axis", axis.encoder)
    if blocking_doubts(capture.doubts):
        return [change_of(axis, shown, capture.live, limits)]
    beside = await reversal_changes(at, axis, shown, capture.live, resolution=limits.resolution, taken=taken)
    turned = next(iter(beside), None)
    seen = reversal_of_capture(axis, shown) if _in_columns(can) else None
    if seen is not None and turned is not None:
        turned = remaining_reversal(turned, seen)
    change = change_of(axis, shown, capture.live, limits, turned=turned)
    if seen is not None:
        change, beside = split_by_direction(axis, change, capture.live, limits=limits, seen=seen), ()
    return [judge_benefit(change, shown, instrument_of(capture)), *beside]


def _in_columns(can: Capabilities) -> bool:
    """Whether its own table holds a curve for each direction, so that a reversal needs no place of its own."""
    own = can.table("axis")
    return own is not None and own.directions == "columns"


def change_of(
    axis: AxisSection, shown: Structure, live: LiveSet, limits: TableLimits, turned: TableChange | None = None
) -> TableChange:
    """The axis table's change for what a capture shows, while ``live`` acted. Raises as `gateway.table.propose`.

    ``turned`` is the change of the reversal beside it: what that takes, the table need not outweigh.
    """
    capture, means = shown.capture, shown.means
    return propose_table(
        axis.facts,
        shown.doubted,
        measured=MeasuredMeans(
            targets=capture.targets,
            means=means.mean,
            u=means.u,
            rest=_without_reversal(means, turned),
            unseen=shown.unseen,
            possible=shown.possible() if shown.found else None,
            place=shown.place,
            doubts=capture.doubts,
        ),
        live=live,
        grid=Grid(axis.table.minimum, axis.table.maximum, axis.table.step),
        instrument=instrument_of(capture),
        resolution=limits.resolution * deviation_scale(axis.unit),
        reserved_points=limits.reserved_points,
    )


def instrument_of(capture: Capture) -> InstrumentU:
    """The usual one; a rotary calibrator with what its certificate states."""
    stated = capture.conditions.stated if capture.conditions is not None else {}
    if capture.unit == "arcsec" and "arcsec" in stated:
        return InstrumentU(stated["arcsec"])
    return InstrumentU.usual(capture.unit)


def _without_reversal(means: RobustMeans, turned: TableChange | None) -> float:
    B = means.mean_up - means.mean_down if turned is None else turned.predicted
    half = B / 2.0
    reversal = float(np.mean(half[np.isfinite(half)] ** 2)) if np.isfinite(half).any() else 0.0
    return float(np.sqrt(reversal + np.nan_to_num(means.s) ** 2))


def size_of(change: TableChange) -> Message:
    """Points, span and direction of the new table; of a reversal what acts, what will, and what B is left."""
    unit = change.new.deviation_unit
    if change.new.kind == "reversal":
        was = change.old.deviations[0] if change.old_enabled else 0.0
        left, U = float(np.nanmax(np.abs(change.predicted))), float(np.nanmax(change.predicted_U))
        return Message.of(
            "W-REVERSAL-SIZE",
            was=fixed(was, signed=True),
            value=fixed(change.new.deviations[0], signed=True),
            left=fixed(left),
            U=fixed(U),
            unit=unit,
        )
    new = change.new
    span = {
        "low": fixed(min(new.deviations), signed=True),
        "high": fixed(max(new.deviations), signed=True),
        "unit": unit,
    }
    size = Message.of("W-TABLE-SPAN", points=len(new.deviations), **span)
    if new.direction == 0:
        return size
    return Message.of("W-TABLE-ONE-WAY", size=size, axis=new.input_axis, way="+" if new.direction > 0 else "-")


# What no table of an axis can hold, in words, and whether one that holds little is worth writing; pure.

FINER = (2, 4, 5, 8, 10)
MUCH_LESS = 0.25


def describe_coarse_grid(axis: AxisSection, shown: Structure) -> tuple[Message, ...]:
    """What the control's grid leaves of the axis' curve, and the grid that would hold it; () where it leaves little."""
    lattice, step = shown.seen.lattice, axis.table.step
    curve = value(shown.component, lattice)
    rest = _unresolved_rest(axis, lattice, curve, step)
    unit = shown.capture.unit
    if rest <= InstrumentU.usual(unit).constant / 2.0:
        return ()
    fields = {"step": Quantity(step), "rest": digits(rest), "unit": unit, "per": axis.unit}
    slope, limit = float(np.max(np.abs(np.gradient(curve, lattice)))), Limits.of(axis.unit).slope
    if slope > limit:
        return (Message.of("S-COMP-TOO-STEEP", slope=digits(slope), limit=Quantity(limit), **fields),)
    for times in FINER:
        left = _unresolved_rest(axis, lattice, curve, step / times)
        if left <= MUCH_LESS * rest:
            points = round((axis.table.maximum - axis.table.minimum) / step * times) + 1
            finer = {"finer": Quantity(step / times), "points": points, "left": digits(left)}
            return (Message.of("S-COMP-COARSE", **fields, **finer),)
    return (Message.of("S-COMP-COARSE-ANY", **fields),)


def _unresolved_rest(axis: AxisSection, lattice: FloatArray, curve: FloatArray, step: float) -> float:
    held = held_by(Grid(axis.table.minimum, axis.table.maximum, step), lattice, modulo=axis.modulo)
    return float(np.std(curve - held @ curve))


def judge_benefit(change: TableChange, shown: Structure, instrument: InstrumentU) -> TableChange:
    """The change, labelled where its chances speak for it; or skipped with every reason why it gains too little."""
    if change.skipped:
        return change
    against = gain_refusals(shown.capture, change)
    if against:
        change = label_by_probability(change, shown, instrument, against)
        against = gain_refusals(shown.capture, change)
    return replace(change, skipped=reasons_of(*(one.message for one in against))) if against else change


def label_by_probability(
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
