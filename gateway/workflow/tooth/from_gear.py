"""A run that starts from an inspected gear: tables and set-up values from its flanks alone, proposed and stored."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from drivers.clock import Clock
from drivers.errors import TrueflankError
from drivers.message import Message, fixed
from drivers.types.tables import CompensationTable, LiveSet
from drivers.types.values import FloatArray
from drivers.units import UM_PER_MM
from gateway.config import SiteFile
from gateway.correct.flank.flank_model import places_of_grid, setup_tables, table_terms
from gateway.correct.flank.mounting import mounting_terms
from gateway.correct.flank.tables import Correction, Table
from gateway.correct.part.from_gear import FromGear, correct_from_gear
from gateway.correct.plan.plan import Plan
from gateway.domain.proposals import Proposal, TableChange
from gateway.errors import CaptureError
from gateway.events import RunStarted
from gateway.gear.flank import FlankGrid, flank_figure
from gateway.gear.grinding import Grinding
from gateway.model.error_model import ErrorModel, chain_of_errors
from gateway.say import Say
from gateway.store import RunFolder
from gateway.study.inputs import gear_of
from gateway.tooth import FlankMap, GearProposal, GroundPart, InspectedFlank
from gateway.workflow.axes.cross_tables import acting_cross, cross_changes
from gateway.workflow.axes.measure import fetch_tables, store_equipment
from gateway.workflow.axes.propose import size_of
from gateway.workflow.errors21.measurement import grids
from gateway.workflow.run import stages
from gateway.workflow.run.audit_trail import record_proposal, report_log_problem
from gateway.workflow.run.context import RunContext, open_context
from gateway.workflow.run.folder import new_run
from gateway.workflow.run.self_test import self_test_warnings
from gateway.workflow.tooth.inspection import FlankFile, check_machine, inspect_file, inspected_of
from gateway.workflow.tooth.part_plan import gear_of_site, work_section

OUTPUTS = ("X", "C")


@dataclass(frozen=True, slots=True)
class FromGearOutcome:
    """What one part asks for: the proposal for the control, set-up values, and where both are kept."""

    gear: GearProposal
    proposal: Proposal
    run_folder: str

    @property
    def lines(self) -> tuple[Message, ...]:
        """For people."""
        setup = self.gear.setup
        values = {
            "x": fixed(setup.x_um, 1, signed=True),
            "c": fixed(setup.c_arcsec, 1, signed=True),
            "dressing": fixed(setup.dressing_um, 1, signed=True),
        }
        before, after = fixed(self.gear.before.rms_um), fixed(self.gear.after.rms_um)
        count = sum(not change.skipped for change in self.proposal.changes)
        told = Message.of("P-FROM-GEAR", part=self.gear.part, before=before, after=after, tables=count)
        changes = [
            Message.of("S-FROM-TABLE", name=one.name, table=one.new.name, said=one.skipped or size_of(one))
            for one in self.proposal.changes
        ]
        notes = [Message.of("S-NOTE", said=line) for line in self.gear.said]
        folder = Message.of("S-REPORT-FOLDER", path=self.run_folder)
        return told, Message.of("W-INSPECT-SETUP", **values), *changes, *notes, folder

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        gear = self.gear
        tables = [
            {"name": one.name, "table": one.new.name, "skipped": str(one.skipped or "")}
            for one in self.proposal.changes
        ]
        figures = {"before_um": gear.before.rms_um, "after_um": gear.after.rms_um, "u_um": gear.u_um}
        said = {"eccentricity_um": list(gear.eccentricity_um), "said": list(map(str, gear.said))}
        return {
            "part": gear.part,
            "setup": asdict(gear.setup),
            "tables": tables,
            **figures,
            **said,
            "run_folder": self.run_folder,
        }


async def propose_from_gear(
    site: SiteFile,
    site_path: Path,
    source: RunFolder | FlankFile,
    *,
    clock: Clock,
    say: Say,
    part: str = "",
) -> FromGearOutcome:
    """Propose from a part that a run inspected, or from a file of flank points; nothing is written to the control.

    The proposal is stored for `push`; its tables add to those that act. Raises IllegalTransition (E-INSPECT-WHICH,
    E-SETUP-MACHINE), CaptureError (E-INSPECT-TABLES: other tables act than while the part was ground), ModelError,
    TableError, and what opening and reading raise.
    """
    known = inspected_of(source, part) if isinstance(source, RunFolder) else None
    folder = new_run(site, site_path, utc=clock.utc)
    RunStarted(str(folder.path)).tell(say)
    try:
        if isinstance(source, FlankFile):
            known = inspect_file(site, site_path, file=source, folder=folder, part=part or "part", say=say)
        async with open_context(site, site_path, folder=folder, clock=clock, say=say, instruments=()) as at:
            store_equipment(at)
            run = source if isinstance(source, RunFolder) else folder
            return await _propose(at, known or inspected_of(folder), run)
    except TrueflankError as error:
        folder.set_state("failed", error=error.as_record())
        raise
    except asyncio.CancelledError:
        folder.set_state("stopped")
        raise


async def _propose(at: RunContext, flank: InspectedFlank, run: RunFolder) -> FromGearOutcome:
    check_machine(at, run)
    outputs = [axis for axis in at.site.axes if axis.letter in OUTPUTS]
    live = {axis.name: await fetch_tables(at, axis) for axis in outputs}
    said = _same_tables(run, flank.part, live)
    parents = (at.folder.put(stages.inspected(flank.part), flank),)
    gear, tables = from_flank(at.site, at.site_path, flank, acting_cross(at, live))
    work = work_section(at.site)
    changes = await cross_changes(
        at, tables, chain_of_errors(ErrorModel(), height_mm=work.height_mm), live=live, adds=True
    )
    untried = self_test_warnings(at, (change.axis for change in changes if not change.skipped))
    gear = replace(gear, said=(*gear.said, *said, *_is_empty(changes), *untried))
    proposal = Proposal(at.machine, changes, parents, at.clock.utc().isoformat(timespec="seconds"), warnings=untried)
    at.folder.put(stages.FROM_GEAR, gear, parents)
    at.folder.put(stages.PROPOSAL, proposal, parents)
    report_log_problem(at, record_proposal(at, proposal))
    at.folder.set_state("proposed")
    for change in changes:
        at.say("P-PROPOSED", axis=change.name, words=change.skipped or size_of(change))
    return FromGearOutcome(gear, proposal, str(at.folder.path))


def _same_tables(run: RunFolder, part: str, live: Mapping[str, LiveSet]) -> tuple[Message, ...]:
    """Refuse tables that have changed since the part was ground; a word where nobody knows."""
    if not run.has(stages.ground(part)):
        return (Message.of("S-INSPECT-ANY-TABLES"),)
    acted = run.get(stages.ground(part), GroundPart).live
    other = [name for name, one in live.items() if acted.get(name, one.digest) != one.digest]
    if other:
        raise CaptureError("E-INSPECT-TABLES", run.run_id, axes=", ".join(other), part=part)
    return ()


def _is_empty(changes: Sequence[TableChange]) -> tuple[Message, ...]:
    return () if changes else (Message.of("S-INSPECT-NO-CROSS"),)


def from_flank(
    site: SiteFile, site_path: Path, flank: InspectedFlank, live: Sequence[CompensationTable] = ()
) -> tuple[GearProposal, tuple[Table, ...]]:
    """What a flank asks for: set-up values with the flank they leave, and corrections that add to what acted.

    ``live`` are the cross tables that acted, by machine axis. Raises ConfigError, ModelError.
    """
    file, work = gear_of_site(site, site_path), work_section(site)
    chain = chain_of_errors(ErrorModel(), height_mm=work.height_mm)
    grinding = Grinding(chain, gear_of(file), file.grinding.centre_distance_mm)
    letters = {axis.name: axis.letter for axis in site.axes}
    acted = [_in_chain_letters(one, letters) for one in live]
    points = (flank.k, flank.theta_rad, flank.z_mm)
    found = correct_from_gear(grinding, points, flank.deviation_um / UM_PER_MM, Plan(grids(site)), live=acted)
    proposal = GearProposal(
        part=flank.part,
        setup=found.optimum.setup,
        before=flank.fitted,
        after=_flank_after(grinding, flank.fitted, found),
        u_um=flank.rms_u_um,
        eccentricity_um=found.mounting.eccentricity_um,
        tilt_arcsec=found.mounting.tilt_arcsec,
        said=found.said,
    )
    return proposal, found.optimum.tables


def _in_chain_letters(table: CompensationTable, letters: Mapping[str, str]) -> CompensationTable:
    """A table named by the chain's axes."""
    inside, outside = (letters.get(name, name) for name in (table.input_axis, table.output_axis))
    return replace(table, input_axis=inside, output_axis=outside)


def _flank_after(grinding: Grinding, before: FlankMap, found: FromGear) -> FlankMap:
    """The fitted flank with everything proposed and the work centred, one rotation removed."""
    grid = FlankGrid(grinding.gear, np.arange(float(grinding.gear.zc)), before.theta_rad, before.z_mm)
    places = places_of_grid(grid)
    setup = found.optimum.setup
    tables: list[Correction] = [*found.optimum.tables, *setup_tables(grinding, setup)]
    terms = table_terms(grinding, places, tables) - mounting_terms(grinding, places) @ np.array(found.mounting.values)
    terms[:, 1] += setup.dressing_mm
    deviation = before.deviation_um + places.along_normal(terms).reshape(grid.shape) * UM_PER_MM
    return replace(before, deviation_um=_without_rotation(grid, deviation))


def _without_rotation(grid: FlankGrid, deviation: FloatArray) -> FloatArray:
    lever = grid.section.h
    return np.asarray(deviation - flank_figure(deviation, lever).rotation * lever)
