"""What an interrupted push left at a site, and the old table back on request."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

from drivers.clock import Clock
from drivers.errors import ConfigError, TrueflankError
from drivers.types import CompensationTable
from gateway.config import SiteFile
from gateway.domain import PushRecord
from gateway.errors import StoreError
from gateway.push import PushContext
from gateway.push.journal import JournalRead, machine_folder, tidy
from gateway.push.recovery import Finding, look, recover, tables_of, unfinished, verdict
from gateway.say import Say
from gateway.workflow.bench import Bench, bench, check_name, new_run
from gateway.workflow.consents import not_recovered, recovered, tell
from gateway.workflow.pushing import table_context
from gateway.workflow.witness import JOURNALS, Witness


async def recover_site(
    site: SiteFile, site_path: Path, *, apply: bool, machine_name: str, clock: Clock, say: Say
) -> tuple[Finding, ...]:
    """Every unfinished push of the site's machine; with `apply` what each finding offers is carried out.

    Looking reads the live tables and changes none. A journal that cannot be believed is told and left alone.
    Raises WriteRefused when nothing is offered.
    """
    check_name(site, apply, machine_name)
    folder = new_run(site, site_path)
    folder.set_state("recovering")
    findings: list[Finding] = []
    async with bench(site, site_path, folder, clock, say) as at:
        begun = Witness(at).begun
        for ended in tidy(machine_folder(at.store.root / JOURNALS, at.machine.serial), begun):
            if ended.entries:
                say("P-RECOVER", words=verdict(ended, None, 0.0).words)
        for found in unfinished(at.store.root / JOURNALS, at.machine.serial, begun):
            findings.append(await _one(at, found, apply=apply))
    folder.set_state("recovered" if apply else "looked")
    return tuple(findings)


async def _one(at: Bench, found: JournalRead, *, apply: bool) -> Finding:
    context = _context(at, found)
    if context is None:
        finding = verdict(found, None, 0.0)
        at.say("P-RECOVER", words=finding.words)
        return finding
    finding = await look(found, context)
    at.say("P-RECOVER", words=finding.words)
    if apply:
        record = await _recovered(at, found, context, finding)
        tell(at, recovered(at, finding.code, record))
    return finding


async def _recovered(at: Bench, found: JournalRead, context: PushContext, finding: Finding) -> PushRecord:
    """Carry out the offer; one that ends without a record is kept in the audit log too."""
    try:
        return await recover(found, context)
    except (TrueflankError, asyncio.CancelledError) as error:
        tell(at, not_recovered(at, finding.code, found.number, error))
        raise


def _context(at: Bench, found: JournalRead) -> PushContext | None:
    """What the journal's table is worked with; None where the journal does not say, or not of this site."""
    try:
        table: CompensationTable = tables_of(found)[1]
        return replace(table_context(at, table, None), log=Witness(at))
    except (StoreError, ConfigError):
        return None
