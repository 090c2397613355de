"""What an interrupted push left at a site, and the old table back on request."""

from __future__ import annotations

from pathlib import Path

from drivers.clock import Clock
from drivers.errors import ConfigError
from drivers.types import CompensationTable
from gateway.config import SiteFile
from gateway.domain import PushRecord
from gateway.errors import StoreError
from gateway.push import PushContext, outcome_error
from gateway.push.finding import Finding, tables_of, verdict
from gateway.push.journal import JournalRead, machine_folder, tidy
from gateway.push.recovery import look, recover, unfinished
from gateway.say import Say
from gateway.workflow.bench import Bench, bench, check_name, new_run
from gateway.workflow.consents import recovered, tell
from gateway.workflow.pushing import JOURNALS, push_context, table_context


async def recover_site(
    site: SiteFile, site_path: Path, *, apply: bool, machine_name: str, clock: Clock, say: Say
) -> tuple[Finding, ...]:
    """Every unfinished push of the site's machine; with `apply` what each finding offers is carried out.

    Looking reads the live tables and changes none. A journal that cannot be believed is told and left alone. The
    findings with something still on come first. Raises WriteRefused when nothing is offered, StillOn
    (E-PUSH-HELD-ON) when what was carried out left something on.
    """
    check_name(site, apply, machine_name)
    folder = new_run(site, site_path)
    folder.set_state("recovering")
    findings: list[Finding] = []
    left_on: list[PushRecord] = []
    async with bench(site, site_path, folder, clock, say, instruments=()) as at:
        for ended in tidy(machine_folder(at.store.root / JOURNALS, at.machine.serial)):
            if ended.entries:
                say("P-RECOVER", words=verdict(ended, None, 0.0).words)
        for found in unfinished(at.store.root / JOURNALS, at.machine.serial):
            finding, record = await _one(at, found, apply=apply)
            findings.append(finding)
            left_on += [record] if record is not None and record.outcome == "held-on" else []
    folder.set_state(("held-on" if left_on else "recovered") if apply else "looked")
    for record in left_on:
        failure = outcome_error(record)
        if failure is not None:
            raise failure
    return tuple(sorted(findings, key=lambda finding: not finding.still_on))


async def _one(at: Bench, found: JournalRead, *, apply: bool) -> tuple[Finding, PushRecord | None]:
    context = _context(at, found)
    if context is None:
        finding = verdict(found, None, 0.0)
        at.say("P-RECOVER", words=finding.words)
        return finding, None
    finding = await look(found, context)
    at.say("P-RECOVER", words=finding.words)
    if not apply:
        return finding, None
    record = await recover(found, context)
    tell(at, recovered(at, finding.code, record))
    return finding, record


def _context(at: Bench, found: JournalRead) -> PushContext | None:
    """What the journal's table is worked with; None where the journal does not say, or not of this site."""
    try:
        if found.latest("purpose") == "disable":
            return push_context(at, at.axis(str(found.latest("axis"))), None)
        table: CompensationTable = tables_of(found)[1]
        return table_context(at, table, None)
    except (StoreError, ConfigError):
        return None
