"""The main job: measure every axis, store a proposal; with consent push it, measure again and judge."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from drivers.clock import Clock
from drivers.errors import TrueflankError
from gateway.capture.sense import turning
from gateway.config import SiteFile
from gateway.events import RunStarted
from gateway.say import Say
from gateway.workflow import selftests
from gateway.workflow.aftercare import standing_alarms
from gateway.workflow.axes.measure import measure_axis, plans_of_axis, store_equipment
from gateway.workflow.axes.propose import propose
from gateway.workflow.bench import Bench, bench, check_name, with_axes
from gateway.workflow.control.pushing import apply_proposal
from gateway.workflow.outcome import Outcome, alarmed
from gateway.workflow.results.ending import finish
from gateway.workflow.runsite import new_run


async def run_site(
    site: SiteFile,
    site_path: Path,
    *,
    apply: bool,
    machine_name: str,
    clock: Clock,
    say: Say,
    axes: Collection[str] = (),
) -> Outcome:
    """Do a whole run. Without `apply` it ends with a stored proposal and nothing is written.

    ``axes`` are the only ones to be measured; none named: all. `machine_name` must be the site's name when `apply` is
    set (WriteRefused E-RUN-NAME), and the site must have the axes (ConfigError E-RUN-AXIS), before anything is opened.
    Any failure is noted in the run folder and raised again.
    """
    check_name(site, apply, machine_name)
    site = with_axes(site, axes)
    folder = new_run(site, site_path, utc=clock.utc)
    RunStarted(str(folder.path)).tell(say)
    try:
        async with bench(site, site_path, folder=folder, clock=clock, say=say) as at:
            return await _work(at, apply=apply)
    except TrueflankError as error:
        folder.set_state("failed", error=error.as_record())
        raise


async def _work(at: Bench, *, apply: bool) -> Outcome:
    if apply:
        selftests.demand(at)
    live = [axis for axis in at.site.axes if axis.measure.file is None]
    for axis in live:
        if axis.kind == "rotary":
            turning(axis, at.rig(axis).instrument)  # before hours of the other axes
    store_equipment(at)
    await at.foresee([plan for axis in live for plan in plans_of_axis(axis, "before")])
    measured = {axis.name: await measure_axis(at, axis, "before") for axis in at.site.axes}
    await at.foresee(())
    proposal = await propose(at, measured)
    at.folder.set_state("proposed")
    verdict = await apply_proposal(at, proposal, measured) if apply else None
    return alarmed(finish(at.folder, measured, proposal, verdict), standing_alarms(at))
