"""The drift guard from gears alone: a part inspected now against the one a run approved, and a plain answer."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.clock import Clock
from drivers.errors import TrueflankError
from drivers.message import Message, Quantity, fixed
from gateway.config import SiteFile
from gateway.correct.part.fitted_places import guard_flanks
from gateway.events import RunStarted
from gateway.guard import GuardVerdict
from gateway.say import Say
from gateway.store import RunFolder
from gateway.study.inputs import gear_of
from gateway.tooth import InspectedFlank
from gateway.workflow import stages
from gateway.workflow.axes.guard import EXIT, GUARDED
from gateway.workflow.axes.measure import store_equipment
from gateway.workflow.bench import bench
from gateway.workflow.part.inspecting import (
    FlankFile,
    check_machine,
    inspect_file,
    inspect_part,
    inspected_of,
    inspector_name,
    part_numbers,
)
from gateway.workflow.part.planning import gear_of_site
from gateway.workflow.runsite import new_run

PART = "guard"
ANSWERS = {"still valid": "S-GUARD-VALID", "re-measure this axis": "S-GUARD-AGAIN", "cannot tell": "S-GUARD-OPEN"}
"""The answers of a guard about a machine, as people read them."""


@dataclass(frozen=True, slots=True)
class GearGuardOutcome:
    """The verdict on one approved part and where the check is kept."""

    part: str
    verdict: GuardVerdict
    approved_run: str
    run_folder: str

    @property
    def exit_code(self) -> int:
        """0 still valid, 20 measure again, 21 cannot tell."""
        return EXIT[self.verdict.answer]

    @property
    def lines(self) -> tuple[Message, ...]:
        """For people."""
        seen = self.verdict
        numbers = {"largest": fixed(seen.largest, signed=True), "at": fixed(seen.at, 0), "margin": fixed(seen.margin)}
        answer = Message.of(ANSWERS[seen.answer])
        told = Message.of("W-INSPECT-GUARD", part=self.part, answer=answer, limit=Quantity(seen.limit), **numbers)
        return told, *seen.said, Message.of("S-REPORT-FOLDER", path=self.run_folder)

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        kept = {"gear": self.part, "approved_run": self.approved_run, "run_folder": self.run_folder}
        return {**kept, **self.verdict.as_data(), "exit_code": self.exit_code}


async def guard_gear_site(
    site: SiteFile,
    site_path: Path,
    run: RunFolder,
    *,
    clock: Clock,
    say: Say,
    part: str = "",
    file: FlankFile | None = None,
    limit_um: float | None = None,
) -> GearGuardOutcome:
    """Inspect the part that is clamped (or read a file) and judge it against ``part`` of ``run``. Writes no table.

    The approved part itself proves nothing and is refused. Which tables acted while the new part was ground is for the
    operator to know: other tables, another flank. Raises
    IllegalTransition (E-INSPECT-WHICH, E-SETUP-MACHINE), and what `inspect_part` and `inspect_file` raise.
    """
    approved = inspected_of(run, part)
    inspector = "" if file is not None else inspector_name(site)
    folder = new_run(site, site_path, utc=clock.utc)
    RunStarted(str(folder.path)).tell(say)
    try:
        if file is not None:
            now = inspect_file(site, site_path, file=file, folder=folder, part=PART, say=say)
        else:
            async with bench(site, site_path, folder=folder, clock=clock, say=say, instruments={inspector}) as at:
                check_machine(at, run)
                store_equipment(at)
                now = await inspect_part(at, PART, part_numbers(run))
        verdict = _judged(site, site_path, approved, now, limit_um)
    except TrueflankError as error:
        folder.set_state("failed", error=error.as_record())
        raise
    except asyncio.CancelledError:
        folder.set_state("stopped")
        raise
    folder.put(stages.GUARD, verdict, (folder.digest(stages.inspected(PART)),))
    folder.set_state(GUARDED)
    return GearGuardOutcome(approved.part, verdict, run.run_id, str(folder.path))


def _judged(
    site: SiteFile, site_path: Path, approved: InspectedFlank, now: InspectedFlank, limit_um: float | None
) -> GuardVerdict:
    gear = gear_of(gear_of_site(site, site_path))
    return guard_flanks(approved, now, gear, limit_um or site.guard.limit_um)
