"""The flank with part of a layer's tables, beside the flank with none of them: asked when the other tables failed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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
from gateway.workflow import stages
from gateway.workflow.axes.verdict import PUSHED
from gateway.workflow.bench import Bench
from gateway.workflow.tooth.proposal import PROFILE, WIDTH, ToothWork, work_of

SAME_UM = 1e-6


@dataclass(frozen=True, slots=True)
class Remains:
    """RMS of the flank with its set-up values right, um: with what would stay of a layer, and with none of it."""

    with_them_um: float
    without_um: float

    @property
    def harmless(self) -> bool:
        """Whether they leave the flank no worse than none of them."""
        return self.with_them_um <= self.without_um + SAME_UM


def remaining(at: Bench, stay: Sequence[TableChange]) -> Remains | None:
    """What these changes alone would leave, on top of all that this run pushed before.

    None where it cannot be said: no errors were measured, or one is a product of two tables. Raises ConfigError
    (E-CLOSE-WORK, E-STUDY-...), ModelError.
    """
    tables = [one for one in stay if one.new.kind != "reversal"]  # a constant reversal is a constant of every space
    if not at.folder.has(stages.ERRORS) or any(one.new.multiply_by for one in tables):
        return None
    model = at.folder.get(stages.ERRORS, ErrorModel)
    names = {axis.letter: axis.name for axis in at.site.axes}
    return flanks(model, work_of(at.site, at.site_path), names, before=pushed(at.folder), stay=tables)


def machine_with(
    model: ErrorModel, work: ToothWork, names: Mapping[str, str], changes: Sequence[TableChange]
) -> Grinding:
    """The fitted machine with these changes in; reversals change no flank. Pure. Raises ModelError."""
    grinding = Grinding(chain_of_errors(model, height_mm=work.height_mm), work.gear, work.centre_distance_mm)
    return with_tables(grinding, _added(grinding, [one for one in changes if one.new.kind != "reversal"], names))


def flanks(
    model: ErrorModel,
    work: ToothWork,
    names: Mapping[str, str],
    *,
    before: Sequence[TableChange],
    stay: Sequence[TableChange],
) -> Remains:
    """The same for a fitted machine; ``names`` gives machine axes by letter. Pure. Raises ModelError."""
    acting = machine_with(model, work, names, before)
    rest = with_tables(acting, _added(acting, stay, names))
    return Remains(_rms_um(rest, work), _rms_um(acting, work))


def _rms_um(machine: Grinding, work: ToothWork) -> float:
    grid = flank_grid(work.gear, profile=PROFILE, width=WIDTH)
    return set_right(flank_map(machine, grid), work.gear).rms_um


def _added(machine: Grinding, changes: Sequence[TableChange], names: Mapping[str, str]) -> list[Table]:
    """What changes add to the tables that acted while the errors were measured."""
    found = [_share(machine, one.new, names, 1.0) for one in changes]
    found += [_share(machine, one.old, names, -1.0) for one in changes if one.old_enabled]
    return [one for one in found if one is not None]


def _share(machine: Grinding, table: CompensationTable, names: Mapping[str, str], share: float) -> Table | None:
    found = table_of(machine.chain, table, names)
    return None if found is None else Table(found.grid, share * found.values)


def pushed(folder: RunFolder) -> tuple[TableChange, ...]:
    """What this run has put into the control before, reversals aside."""
    proposal = folder.get(stages.PROPOSAL, Proposal)
    held = {one.name: stages.push(one.name) for one in proposal.changes if folder.has(stages.push(one.name))}
    ended = {name: folder.get(stage, PushRecord).outcome for name, stage in held.items()}
    return tuple(one for one in proposal.changes if ended.get(one.name) in PUSHED and one.new.kind != "reversal")
