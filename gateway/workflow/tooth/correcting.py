"""A measured run's proposal for the tooth, worked out at the machine it was measured on; nothing is written to it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from drivers.clock import Clock
from drivers.errors import TrueflankError
from drivers.terms import spoken
from gateway.config import SiteFile
from gateway.domain.equipment import Equipment
from gateway.domain.proposals import Proposal, TableChange
from gateway.errors import IllegalTransition
from gateway.gear.process_drift import set_right
from gateway.model.error_model import ErrorModel
from gateway.say import Say
from gateway.store import RunFolder
from gateway.tooth import ToothProposal
from gateway.workflow import stages
from gateway.workflow.axes.propose import size_of
from gateway.workflow.bench import Bench, bench
from gateway.workflow.errors21.fromsetups import axes_measured
from gateway.workflow.tooth.proposal import ToothWork, propose_tooth, work_of


@dataclass(frozen=True, slots=True)
class ToothOutcome:
    """What was proposed and stored; ``fair_before_um`` is the RMS before with the set-up values right."""

    run_folder: str
    proposal: Proposal
    tooth: ToothProposal
    fair_before_um: float

    @property
    def tables(self) -> tuple[tuple[str, str, str], ...]:
        """Each table's name in the proposal, what it is, and its size or why it is none."""
        return tuple(
            (change.name, f"{spoken().kind(change.new.kind)} {change.new.name}", str(change.skipped or size_of(change)))
            for change in self.proposal.changes
        )

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        tooth, flank = self.tooth, self.tooth.prediction
        return {
            "state": "proposed",
            "run_folder": self.run_folder,
            "tables": [_table(change) for change in self.proposal.changes],
            "setup": asdict(tooth.setup),
            "flank": {
                "before_um": flank.before.rms_um,
                "before_set_right_um": self.fair_before_um,
                "with_own_um": flank.with_own.rms_um,
                "after_um": flank.after.rms_um,
                "expected_um": flank.rms_um,
                "expected_u_um": flank.rms_u_um,
                "u_um": flank.u_um,
                "floor_um": flank.floor_um,
                "parts_um": dict(flank.parts_um),
            },
            "ranking": [asdict(one) for one in tooth.ranking],
            "cures": [asdict(one) for one in tooth.cures],
            "b_left": tooth.b_left,
            "eccentricity_um": list(tooth.eccentricity_um),
            "tilt_arcsec": list(tooth.tilt_arcsec),
            "axes": [
                {
                    "axis": one.axis,
                    "M": one.M,
                    "U": one.M_U,
                    "M_alone": one.M_alone,
                    "unit": one.unit,
                    "targets": one.targets.tolist(),
                    "deviation": one.deviation.tolist(),
                    "moved_by": dict(one.moved_by),
                }
                for one in tooth.axes
            ],
            "drive": None if tooth.drive is None else asdict(tooth.drive),
            "said": list(map(str, tooth.said)),
        }


def _table(change: TableChange) -> dict[str, Any]:
    new = change.new
    return {
        "name": change.name,
        "layer": spoken().kind(change.new.kind),
        "table": new.name,
        "index": new.index,
        "points": len(new.deviations),
        "low": min(new.deviations),
        "high": max(new.deviations),
        "unit": new.deviation_unit,
        "skipped": str(change.skipped or ""),
        "findings": [str(one.message) for one in change.findings],
    }


async def correct_site(site: SiteFile, site_path: Path, folder: RunFolder, *, clock: Clock, say: Say) -> ToothOutcome:
    """Propose both layers and set-up values from a measured run; needs the control, no instrument.

    Raises ConfigError (E-CLOSE-WORK, E-CLOSE-AXES), StoreError (E-STORE-STAGE) for a run without an error model,
    IllegalTransition (E-SETUP-MACHINE) at another machine, and what `propose_tooth` raises; the folder keeps the error.
    """
    work = work_of(site, site_path)
    model = folder.get(stages.ERRORS, ErrorModel)
    try:
        async with bench(site, site_path, folder=folder, clock=clock, say=say, instruments=()) as at:
            return await _proposed(at, model, work)
    except TrueflankError as error:
        folder.set_state("failed", error=error.as_record())
        raise


async def _proposed(at: Bench, model: ErrorModel, work: ToothWork) -> ToothOutcome:
    folder = at.folder
    different = folder.get(stages.EQUIPMENT, Equipment).machine.differences(at.machine)
    if different:
        raise IllegalTransition("E-SETUP-MACHINE", folder.run_id, fields=", ".join(different))
    proposal, tooth = await propose_tooth(at, model, axes_measured(folder, at.site), work)
    folder.set_state("proposed")
    fair = set_right(tooth.prediction.before, work.gear).rms_um
    return ToothOutcome(str(folder.path), proposal, tooth, fair)
