"""A run that goes on without some of its tables: which of the others still help the tooth, and what the flank will be.

Tables for a tooth are found together, so the flank is worked out again with those that can be pushed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.message import Message, fixed
from drivers.types.tables import CompensationTable
from gateway.correct.flank.tables import Table, with_tables
from gateway.correct.outlook.prediction import flank_map
from gateway.correct.plan.plan import table_of
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import Proposal, TableChange
from gateway.gear.flank import flank_grid
from gateway.gear.grinding import Grinding
from gateway.gear.process_drift import set_right
from gateway.model.error_model import ErrorModel, chain_of_errors
from gateway.store import RunFolder
from gateway.tooth import FlankMap, FlankPrediction, ToothProposal
from gateway.workflow.axes.verdict import PUSHED
from gateway.workflow.run import stages
from gateway.workflow.run.context import RunContext
from gateway.workflow.tooth.proposal import PROFILE, WIDTH, ToothWork, work_of


@dataclass(frozen=True, slots=True)
class TableTrial:
    """A fitted machine on which tables of a proposal are tried; ``names`` gives machine axes by letter."""

    model: ErrorModel
    work: ToothWork
    names: Mapping[str, str]

    def flank(self, changes: Sequence[TableChange]) -> FlankMap:
        """The flank with these tables."""
        machine = machine_with(self.model, self.work, self.names, changes)
        return flank_map(machine, flank_grid(self.work.gear, profile=PROFILE, width=WIDTH))

    def right(self, changes: Sequence[TableChange]) -> FlankMap:
        """The same with its set-up values right."""
        return set_right(self.flank(changes), self.work.gear)


@dataclass(frozen=True, slots=True)
class RemainingTables:
    """The tables that go on, and the flank's RMS with them, with every table and with none, um."""

    changes: tuple[TableChange, ...]
    rms_um: float
    all_um: float
    none_um: float


def trial_of_run(at: RunContext, changes: Sequence[TableChange]) -> TableTrial | None:
    """The machine as this run measured it; None where no errors were measured, or a table is one of a product.

    Raises ConfigError (E-CLOSE-WORK, E-STUDY-...), ModelError.
    """
    if not at.folder.has(stages.ERRORS) or any(one.new.multiply_by for one in changes):
        return None
    names = {axis.letter: axis.name for axis in at.site.axes}
    return TableTrial(at.folder.get(stages.ERRORS, ErrorModel), work_of(at.site, at.site_path), names)


def best_remaining_tables(
    tried: TableTrial, every: Sequence[TableChange], left: Sequence[TableChange]
) -> RemainingTables:
    """Of ``left``, all of them or the axes' own alone, whichever leaves the better flank; none where both are worse.

    A cross table is worth having with the tables that it was found with, so it may spoil what is left of them. Pure.
    """
    own = tuple(one for one in left if one.layer == "axis")
    all_um, none_um = tried.right(every).rms_um, tried.right(()).rms_um
    tries = [(changes, tried.right(changes).rms_um) for changes in (tuple(left), own)]
    best, rms_um = min(tries, key=lambda one: one[1])
    if rms_um > none_um + SAME_UM:
        return RemainingTables((), none_um, all_um, none_um)
    return RemainingTables(best, rms_um, all_um, none_um)


def predict_without(at: RunContext, proposal: Proposal) -> None:
    """Where not every table of a proposal was pushed, the tooth's prediction becomes that of those which were.

    What is predicted of an axis with everything acting goes where a table of it is missing.
    """
    every = [one for one in proposal.changes if not one.skipped and one.new.kind != "reversal"]
    acting = pushed_changes(at.folder)
    names = {one.name for one in acting}
    missing = [one for one in every if one.name not in names]
    if not missing or not acting or not at.folder.has(stages.TOOTH):
        return
    tried = trial_of_run(at, every)
    if tried is None:
        return
    tooth = revise_prediction(at.folder.get(stages.TOOTH, ToothProposal), tried, every, acting)
    why = tuple(
        Message.of("S-TABLE-WHY", name=one.name, why=why) for one in missing for why in _reasons(at.folder, one)
    )
    at.folder.put(stages.TOOTH, replace(tooth, said=(*why, *tooth.said)), at.folder.parents(stages.TOOTH))


def _reasons(folder: RunFolder, change: TableChange) -> tuple[Message, ...]:
    """Why a table of the run was not pushed, as its record has it."""
    stage = stages.push(change.name)
    return folder.get(stage, PushRecord).reasons if folder.has(stage) else ()


def revise_prediction(
    tooth: ToothProposal, tried: TableTrial, every: Sequence[TableChange], acting: Sequence[TableChange]
) -> ToothProposal:
    """The proposal as it is with the tables ``acting`` alone of ``every``; pure."""
    names = {one.name for one in acting}
    missing = [one for one in every if one.name not in names]
    own = [[one for one in changes if one.layer == "axis"] for changes in (acting, every)]
    now, was = tried.right(acting), tried.right(every)
    told = tooth.prediction
    found = _move_flank(told, now.deviation_um - was.deviation_um)
    alone = told.with_own.deviation_um + tried.flank(own[0]).deviation_um - tried.flank(own[1]).deviation_um
    figures = {"rest": fixed(found.rms_um), "all": fixed(told.rms_um)}
    said = Message.of("S-TOOTH-WITHOUT", names=", ".join(one.name for one in missing), **figures)
    axes = {one.axis for one in missing}
    return replace(
        tooth,
        prediction=replace(found, with_own=replace(told.with_own, deviation_um=alone)),
        axes=tuple(one for one in tooth.axes if one.axis not in axes),
        said=(said, *tooth.said),
    )


def _move_flank(told: FlankPrediction, change_um: np.ndarray) -> FlankPrediction:
    """The flank after moved by a map: its doubts stay, and so what they add to its RMS in squares.

    The square of an RMS varies by 4 m'Vm + 2 tr V^2 over a map m with doubts V. Where these prefer no pattern that
    grows as 2 |m|^2 + u^2.
    """
    after = replace(told.after, deviation_um=told.after.deviation_um + change_um)
    doubt = max(told.rms_um**2 - told.after.rms_um**2, 0.0)
    rms = float(np.sqrt(after.rms_um**2 + doubt))
    varies = [2.0 * one.rms_um**2 + told.u_um**2 for one in (after, told.after)]
    wider = float(np.sqrt(varies[0] / varies[1])) * told.rms_um / rms if rms > 0.0 and varies[1] > 0.0 else 1.0
    return replace(told, after=after, rms_um=rms, rms_u_um=told.rms_u_um * wider)


# The flank with part of a layer's tables, beside the flank with none of them: asked when the other tables failed.

SAME_UM = 1e-6


@dataclass(frozen=True, slots=True)
class ResidualAfterPartialPush:
    """RMS of the flank with its set-up values right, um: with what would stay of a layer, and with none of it."""

    with_them_um: float
    without_um: float

    @property
    def harmless(self) -> bool:
        """Whether they leave the flank no worse than none of them."""
        return self.with_them_um <= self.without_um + SAME_UM


def residual_after_partial_push(at: RunContext, stay: Sequence[TableChange]) -> ResidualAfterPartialPush | None:
    """What these changes alone would leave, on top of all that this run pushed before.

    None where it cannot be said: no errors were measured, or one is a product of two tables. Raises ConfigError
    (E-CLOSE-WORK, E-STUDY-...), ModelError.
    """
    tables = [one for one in stay if one.new.kind != "reversal"]  # a constant reversal is a constant of every space
    if not at.folder.has(stages.ERRORS) or any(one.new.multiply_by for one in tables):
        return None
    model = at.folder.get(stages.ERRORS, ErrorModel)
    names = {axis.letter: axis.name for axis in at.site.axes}
    return flanks_with_and_without(
        model, work_of(at.site, at.site_path), names, before=pushed_changes(at.folder), stay=tables
    )


def machine_with(
    model: ErrorModel, work: ToothWork, names: Mapping[str, str], changes: Sequence[TableChange]
) -> Grinding:
    """The fitted machine with these changes in; reversals change no flank. Pure. Raises ModelError."""
    grinding = Grinding(chain_of_errors(model, height_mm=work.height_mm), work.gear, work.centre_distance_mm)
    return with_tables(grinding, _added_tables(grinding, [one for one in changes if one.new.kind != "reversal"], names))


def flanks_with_and_without(
    model: ErrorModel,
    work: ToothWork,
    names: Mapping[str, str],
    *,
    before: Sequence[TableChange],
    stay: Sequence[TableChange],
) -> ResidualAfterPartialPush:
    """The same for a fitted machine; ``names`` gives machine axes by letter. Pure. Raises ModelError."""
    acting = machine_with(model, work, names, before)
    rest = with_tables(acting, _added_tables(acting, stay, names))
    return ResidualAfterPartialPush(_rms_um(rest, work), _rms_um(acting, work))


def _rms_um(machine: Grinding, work: ToothWork) -> float:
    grid = flank_grid(work.gear, profile=PROFILE, width=WIDTH)
    return set_right(flank_map(machine, grid), work.gear).rms_um


def _added_tables(machine: Grinding, changes: Sequence[TableChange], names: Mapping[str, str]) -> list[Table]:
    """What changes add to the tables that acted while the errors were measured."""
    found = [_share(machine, one.new, names, 1.0) for one in changes]
    found += [_share(machine, one.old, names, -1.0) for one in changes if one.old_enabled]
    return [one for one in found if one is not None]


def _share(machine: Grinding, table: CompensationTable, names: Mapping[str, str], share: float) -> Table | None:
    found = table_of(machine.chain, table, names)
    return None if found is None else Table(found.grid, share * found.values)


def pushed_changes(folder: RunFolder) -> tuple[TableChange, ...]:
    """What this run has put into the control before, reversals aside."""
    proposal = folder.get(stages.PROPOSAL, Proposal)
    held = {one.name: stages.push(one.name) for one in proposal.changes if folder.has(stages.push(one.name))}
    ended = {name: folder.get(stage, PushRecord).outcome for name, stage in held.items()}
    return tuple(one for one in proposal.changes if ended.get(one.name) in PUSHED and one.new.kind != "reversal")
