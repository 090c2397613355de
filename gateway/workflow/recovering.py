"""What an interrupted push left at a site, and the old table back on request."""

from __future__ import annotations

from pathlib import Path

from drivers.clock import Clock
from gateway.config import SiteFile
from gateway.push.recovery import Finding, look, recover, unfinished
from gateway.say import Say
from gateway.workflow.bench import bench, check_name, new_run
from gateway.workflow.pushing import JOURNALS, push_context


async def recover_site(
    site: SiteFile, site_path: Path, *, apply: bool, machine_name: str, clock: Clock, say: Say
) -> tuple[Finding, ...]:
    """Every unfinished push of the site's machine; with `apply` what each finding offers is carried out.

    Looking runs a program that only saves the live tables. Raises WriteRefused when nothing is offered.
    """
    check_name(site, apply, machine_name)
    folder = new_run(site, site_path)
    folder.set_state("recovering")
    findings: list[Finding] = []
    async with bench(site, site_path, folder, clock, say) as at:
        for found in unfinished(at.store.root / JOURNALS, at.machine.serial):
            axis = at.axis(str(found.latest("axis")))
            context = push_context(at, axis, None)
            finding = await look(found, context)
            findings.append(finding)
            say("P-RECOVER", words=finding.words)
            if apply:
                await recover(found, context)
    folder.set_state("recovered" if apply else "looked")
    return tuple(findings)
