"""What an interrupted push left at a site, and the old table back on request."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

from drivers.clock import Clock
from drivers.errors import ConfigError, TrueflankError
from drivers.leftover import LeftOver
from drivers.types.tables import CompensationTable
from gateway.config import SiteFile
from gateway.domain.outcomes import PushRecord
from gateway.errors import StoreError
from gateway.push import (
    JOURNALS,
    Choice,
    CommittedPush,
    JournalRead,
    LiveReadings,
    PushContext,
    PushFinding,
    all_pushes,
    inspect_unfinished,
    machine_folder,
    make_finding,
    outcome_error,
    recover_table,
    set_ended_aside,
    tables_of,
    unfinished_tables,
    with_rest,
)
from gateway.say import Say
from gateway.workflow.bench import Bench, bench, check_name, run_or_look
from gateway.workflow.consents import looked, not_recovered, recovered, tell
from gateway.workflow.control.contexts import push_context, table_context
from gateway.workflow.leaving import LeftFinding, clear
from gateway.workflow.witness import Witness

HELD = ("held-on", "held")


async def recover_site(
    site: SiteFile,
    site_path: Path,
    *,
    apply: bool,
    machine_name: str,
    clock: Clock,
    say: Say,
    choice: Choice = "offered",
) -> tuple[PushFinding | LeftFinding, ...]:
    """What an earlier gateway left in the control, and every unfinished push of the site's machine.

    With `apply` what each finding offers is carried out; a program that stands until a person presses keeps the rest.
    ``choice`` says whether an interrupted rollback is finished or undone; it counts for nothing else.

    Looking reads the live tables and changes none. A journal that cannot be believed is told and left alone. The
    findings with something still on come first. Raises WriteRefused when nothing is offered, or a rollback is to be
    finished or undone and nobody has chosen (E-RECOVER-CHOOSE); where the old table did
    not come back StillOn (E-PUSH-HELD-ON) or, once all is off, RollbackFailed (E-PUSH-HELD).
    """
    check_name(site, apply, machine_name)
    with run_or_look(site, site_path, "recovering", look=not apply) as folder:
        async with bench(site, site_path, folder=folder, clock=clock, say=say, instruments=()) as at:
            findings, held = await _all(at, apply=apply, choice=choice)
            if not apply:
                looked(at, "recover", found=len(findings))
        folder.set_state(held[0].outcome if held else "recovered")
    failure = outcome_error(held[0]) if held else None
    if failure is not None:
        raise failure
    return tuple(sorted(findings, key=lambda finding: not finding.still_on))


async def _all(at: Bench, *, apply: bool, choice: Choice) -> tuple[list[PushFinding | LeftFinding], list[PushRecord]]:
    """What is found, and what of it did not go back to the old table, what is still on first."""
    findings: list[PushFinding] = []
    others: list[LeftFinding] = []
    held: list[PushRecord] = []
    left, may_write = at.supervisor.left, apply
    if not left.clear:
        others.append(told := await _left(at, left, apply=apply))
        may_write = apply and told.after is not None and told.after.clear
    begun = Witness(at).begun
    for ended in set_ended_aside(machine_folder(at.store.root / JOURNALS, at.machine.serial), begun):
        if ended.entries:
            at.say("P-RECOVER", words=make_finding(ended, None, 0.0).said)
    read: LiveReadings | None = None if may_write else {}
    open_ = unfinished_tables(at.store.root / JOURNALS, at.machine.serial, begun)
    for found in open_:
        finding, record = await _one(at, found, choice if may_write else None, read=read)
        findings.append(finding)
        held += [record] if record is not None and record.outcome in HELD else []
    named = with_rest(findings, open_, _pushes(at))
    return [*others, *named], sorted(held, key=lambda record: HELD.index(record.outcome))


def _pushes(at: Bench) -> tuple[CommittedPush, ...]:
    """What is committed by now; nothing where a journal cannot be believed, which a finding says."""
    try:
        return all_pushes(at.store.root / JOURNALS, at.machine.serial)
    except StoreError:
        return ()


async def _left(at: Bench, found: LeftOver, *, apply: bool) -> LeftFinding:
    """A program of ours is asked to end and its words are given back, before anything else is begun there."""
    if not apply:
        return LeftFinding(found)
    after = await clear(at.supervisor, at.patience.start_s)
    at.say("P-RECOVER", words=after.said.message)
    return LeftFinding(found, after)


async def _one(
    at: Bench, found: JournalRead, choice: Choice | None, read: LiveReadings | None
) -> tuple[PushFinding, PushRecord | None]:
    """One finding, looked at (None) or carried out."""
    context = _context(at, found)
    if context is None or choice is None:
        finding = make_finding(found, None, 0.0) if context is None else await inspect_unfinished(found, context, read)
        if choice is not None:
            at.say("P-RECOVER", words=finding.said)
        return finding, None
    return await _recovered(at, found, context, choice)


async def _recovered(
    at: Bench, found: JournalRead, context: PushContext, choice: Choice
) -> tuple[PushFinding, PushRecord]:
    """Look and carry out the offer; one that ends without a record is kept in the audit log too."""
    finding = make_finding(found, None, 0.0)

    def hear(seen: PushFinding) -> None:
        nonlocal finding
        finding = seen
        at.say("P-RECOVER", words=seen.said)

    try:
        record = await recover_table(found, context, _chosen(found, choice), tell=hear)
    except (TrueflankError, asyncio.CancelledError) as error:
        tell(at, not_recovered(at, finding.code, found.number, error))
        raise
    tell(at, recovered(at, finding.code, record))
    return replace(finding, ended=record.outcome), record


def _chosen(found: JournalRead, choice: Choice) -> Choice:
    """What a person chose, of a rollback; anything else is as it is offered."""
    return choice if found.purpose == "restore" else "offered"


def _context(at: Bench, found: JournalRead) -> PushContext | None:
    """What the journal's table is worked with; None where the journal does not say, or not of this site."""
    try:
        if found.latest("purpose") == "disable":
            return push_context(at, at.axis(str(found.latest("axis"))), None)
        table: CompensationTable = tables_of(found)[1]
        return replace(table_context(at, table, None), log=Witness(at))
    except (StoreError, ConfigError):
        return None
