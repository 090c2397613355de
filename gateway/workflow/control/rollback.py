"""What the last consent changed, put back on request as transactions of their own."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from drivers.clock import Clock
from drivers.errors import ConfigError, TrueflankError
from drivers.message import Message, fixed
from drivers.stale_programs import StaleProgram
from drivers.terms import spoken
from drivers.types.tables import CompensationTable
from drivers.types.values import Sense
from gateway import audit
from gateway.config import SiteFile
from gateway.domain.outcomes import PushRecord
from gateway.errors import StillOn, StoreError, VerifyError, WriteRefused
from gateway.push import (
    JOURNALS,
    Choice,
    CommittedPush,
    ConsentSet,
    JournalRead,
    LiveReadings,
    PushContext,
    PushFinding,
    RollbackPreview,
    RollbackRequest,
    all_pushes,
    consent_set,
    group_rollbacks,
    inspect_unfinished,
    machine_folder,
    make_finding,
    outcome_alarms,
    outcome_error,
    point_changes,
    preflight_rollbacks,
    recover_table,
    roll_back_pushes,
    rollback_previews,
    set_ended_aside,
    tables_of,
    unfinished_tables,
    with_rest,
)
from gateway.say import Say
from gateway.table.comparison import effective
from gateway.workflow.run.audit_trail import (
    AuditAdapter,
    audit_problem,
    error_words,
    outcome_word,
    record_failed_recovery,
    record_look,
    record_recovery,
    report_log_problem,
)
from gateway.workflow.run.context import (
    LeftoverFinding,
    RunContext,
    axis_named,
    check_name,
    clear_leftovers,
    open_context,
    run_or_look,
)
from gateway.workflow.run.outcome import WORSE_EXIT, Outcome, of_table, with_alarms
from gateway.workflow.run.push_context import push_context, table_context


async def roll_back_site(
    site: SiteFile, site_path: Path, *, table: str, apply: bool, machine_name: str, clock: Clock, say: Say
) -> Outcome:
    """Take back what the last consent changed; without `apply` only say what would be.

    ``table`` is a machine axis (every table that moves it), one table by its name, or "" for all of the consent.
    Raises WriteRefused (E-RUN-NAME, E-ROLLBACK-NOTHING, E-PUSH-REFUSED, E-RUN-NO-PROOF), ConfigError (E-RUN-AXIS),
    VerifyError (the rollback failed and the newer tables act again, or part of them does), RollbackFailed (held),
    CorruptRecord (E-AUDIT-BROKEN).
    """
    check_name(site, apply, machine_name)
    if table:
        axis_named(site, site_path, spoken().axis_of(table))
    with run_or_look(site, site_path, "rolling-back", look=not apply) as folder:
        async with open_context(site, site_path, folder=folder, clock=clock, say=say) as at:
            found = rollback_set(at, table)
            if found is None:
                raise WriteRefused("E-ROLLBACK-NOTHING", table, table=table or "any table", serial=at.machine.serial)
            undos = group_rollbacks([(done, rollback_context(at, done.new.table)) for done in found.tables])
            return await (_roll_back(at, found, undos) if apply else _preview_rollback(at, found, undos))


async def roll_back_run(at: RunContext) -> Outcome | None:
    """Take back what this very run changed, by the consent it was begun with; None where nothing of it is left.

    Raises as `roll_back_site`.
    """
    found = rollback_set(at, "")
    if found is None or found.tables[0].consent.split(" ")[0] != at.folder.run_id:
        return None
    return await _roll_back(
        at, found, group_rollbacks([(done, rollback_context(at, done.new.table)) for done in found.tables])
    )


def rollback_set(at: RunContext, asked: str) -> ConsentSet | None:
    """The set that a rollback of an axis, a table or everything ("") restores at this machine.

    Cross tables are deviations by the machine's proof. Raises WriteRefused (E-RUN-NO-PROOF) where the sign of one of
    them is not proved any more, StoreError.
    """
    proofs = {axis.name: at.proofs.find(at.machine, "cross", axis.name) for axis in at.site.axes}
    controller = at.supervisor.controller

    def meant(kept: CompensationTable, sense: Sense) -> CompensationTable:
        proof = proofs.get(kept.output_axis) if kept.kind == "cross" else None
        return kept if kept.kind == "cross" and proof is None else controller.table_by(kept, sense, proof)

    found = consent_set(all_pushes(at.store.root / JOURNALS, at.machine.serial, meant), asked)
    unproved = [
        one for one in (found.tables if found else ()) if spoken().is_cross(one.table) and not proofs.get(one.axis)
    ]
    if unproved:
        raise WriteRefused("E-RUN-NO-PROOF", ", ".join(one.table for one in unproved))
    return found


def rollback_context(at: RunContext, table: CompensationTable) -> PushContext:
    """What a transaction without a capture works with, with who asks for it and the state of the audit."""
    broken = audit_problem(at)
    return replace(
        table_context(at, table, None), actor=audit.acting_person(), audit_broken=broken, log=AuditAdapter(at)
    )


async def _preview_rollback(at: RunContext, found: ConsentSet, undos: Sequence[Sequence[RollbackRequest]]) -> Outcome:
    against: dict[Message, list[str]] = {}
    codes: dict[str, None] = {}
    for group in undos:
        for (done, _), asked in zip(group, await preflight_rollbacks(group), strict=True):
            for refusal in asked.refusals:
                against.setdefault(refusal.message, []).append(done.table)
                codes[refusal.code] = None
    reasons = [of_table(", ".join(names), reason) for reason, names in against.items()]
    seen = _table_states(at, found)
    lines = [line for one in seen.values() for line in one.lines]
    lines += reasons or [Message.of("W-ROLLBACK-FREE")]
    lines += [*_tables_staying(found), Message.of("W-ROLLBACK-DRY")]
    for done in found.tables:
        record_look(at, "rollback", table=done.table, undoes=done.transaction)
    data = {**_data(found), "refusals": list(map(str, reasons)), "refused_by": list(codes), "applied": False}
    points = tuple(line for done in found.tables for line in _difference(done))
    return Outcome(state="looked", run_folder="", rows=(), lines=tuple(lines), points=points, data=data)


def _table_states(at: RunContext, found: ConsentSet) -> Mapping[str, RollbackPreview]:
    """What acts in each table's place until the rollback, and after it. Raises StoreError."""
    return rollback_previews(all_pushes(at.store.root / JOURNALS, at.machine.serial), found)


def _tables_staying(found: ConsentSet) -> list[Message]:
    """Tables of the same consent that were not asked for: they go on acting."""
    return [Message.of("W-ROLLBACK-REST", tables=", ".join(one.table for one in found.rest))] if found.rest else []


def rollback_lines(found: ConsentSet | None) -> list[Message]:
    """What a rollback would take back together, and what of the same consent would stay on; nothing without a set."""
    if found is None:
        return []
    return [Message.of("W-ROLLBACK-SET", tables=found.names, transactions=found.transactions), *_tables_staying(found)]


def _data(found: ConsentSet) -> dict[str, Any]:
    first = found.tables[0]
    told = [{"table": one.table, "transaction": one.transaction} for one in found.tables]
    rest = [one.table for one in found.rest]
    return {"transaction": first.transaction, "table": found.names, "tables": told, "rest": rest}


def _difference(done: CommittedPush) -> list[Message]:
    """What the table would become, at the points of the larger of both."""
    new, old = done.new, done.old
    if new.table.kind == "reversal":
        was, becomes = (effective(one).deviations[0] for one in (new, old))
        return [_changes("S-VALUE-CHANGE", was, becomes, new.table.deviation_unit)]
    unit, both = new.table.deviation_unit, bool(new.table.reverse or old.table.reverse)
    lines = [Message.of("W-ROLLBACK-POINTS", table=done.table)]
    for place, way, was, becomes in point_changes(done):
        side = {"way": "+-"[way < 0]} if both else {}
        code = "S-POINT-CHANGE-WAY" if both else "S-POINT-CHANGE"
        lines.append(_changes(code, was, becomes, unit, place=fixed(place, 3), **side))
    return lines


def _changes(code: str, was: float, becomes: float, unit: str, /, **more: object) -> Message:
    both = {"was": fixed(was, 3, signed=True), "becomes": fixed(becomes, 3, signed=True)}
    return Message(code, {**both, "unit": unit, **more})


async def _roll_back(at: RunContext, found: ConsentSet, undos: Sequence[Sequence[RollbackRequest]]) -> Outcome:
    """One transaction after the other, the newest pushed first; what one of them leaves on keeps the rest as it is.

    Raises what became of the first that did not end as asked, with what is back and what stays on.
    """
    seen = _table_states(at, found)
    records: dict[str, PushRecord] = {}
    failure: TrueflankError | None = None
    for group in undos:
        try:
            ended = await _roll_back_group(at, group)
        except TrueflankError as error:
            if not records:
                raise
            failure = error  # nothing of this group was written
            break
        records |= ended
        failures = map(outcome_error, ended.values())
        failure = next((one for one in failures if one is not None), None)
        if failure is not None:
            break
    back = [name for name, record in records.items() if record.outcome in ("committed", "already-applied")]
    state = "rollback-committed" if failure is None else _worst(records) if not back else "rollback-in-part"
    at.folder.set_state(state)
    if failure is not None:
        raise failure if not back else _partial_rollback_outcome(failure, [one.table for one in found.tables], back)
    return _rollback_outcome(at, found, records, seen)


def _worst(records: Mapping[str, PushRecord]) -> str:
    outcomes = {record.outcome for record in records.values()}
    return "rollback-" + next(
        one for one in ("held-on", "held", "rolled-back", "untouched", "refused") if one in outcomes
    )


def _partial_rollback_outcome(failure: TrueflankError, tables: Sequence[str], back: Sequence[str]) -> TrueflankError:
    """Part of the set is back and the rest is not: said, with the exit code of who must act now."""
    on = ", ".join(name for name in tables if name not in back)
    kind = StillOn if isinstance(failure, StillOn) else VerifyError
    return kind("E-ROLLBACK-PART", ", ".join(tables), back=", ".join(back), on=on, why=str(failure))


def _rollback_outcome(
    at: RunContext, found: ConsentSet, records: Mapping[str, PushRecord], seen: Mapping[str, RollbackPreview]
) -> Outcome:
    """Everything asked for is back. A table of the same consent that stays on: exit code 9."""
    codes = {"committed": "W-ROLLBACK-DONE", "already-applied": "W-ROLLBACK-THERE"}
    lines = [
        Message.of(codes[records[one.table].outcome], table=one.table, acts=seen[one.table].older.message)
        for one in found.tables
    ]
    data = {**_data(found), "undoes": found.tables[0].transaction, "applied": True, "outcome": "committed"}
    data |= {"transaction": records[found.tables[0].table].transaction}
    data |= {"outcomes": {name: record.outcome for name, record in records.items()}}
    outcome = Outcome(
        state=at.folder.state,
        run_folder=str(at.folder.path),
        rows=(),
        lines=(*lines, *_tables_staying(found)),
        data=data,
        exit_code=WORSE_EXIT if found.rest else 0,
    )
    return with_alarms(outcome, outcome_alarms(records.values()))


async def _roll_back_group(at: RunContext, group: Sequence[RollbackRequest]) -> dict[str, PushRecord]:
    """One transaction, kept in the audit log at both ends, each table with its record in the run folder."""
    told = {done.table: {"table": done.table, "undoes": done.transaction, "run": at.folder.run_id} for done, _ in group}
    root, serial = at.store.root, at.machine.serial
    for details in told.values():
        audit.record(root, "rollback-start", clock=at.clock, serial=serial, details=details)
    try:
        records = await roll_back_pushes(group)
    except (TrueflankError, asyncio.CancelledError) as error:
        for details in told.values():
            action, why = f"rollback-{outcome_word(error)}", {**details, "why": error_words(error)}
            report_log_problem(at, audit.note(root, action, clock=at.clock, serial=serial, details=why))
        raise
    ended = {done.table: record for (done, _), record in zip(group, records, strict=True)}
    for name, record in ended.items():
        at.folder.put(f"rollback-{name}", record)
        action, number = f"rollback-{record.outcome}", record.transaction
        why = {"why": record.why} if record.why else {}
        details = {**told[name], **why}
        report_log_problem(
            at, audit.note(root, action, clock=at.clock, serial=serial, transaction=number, details=details)
        )
    return ended


# What an interrupted push left at a site, and the old table back on request.

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
) -> tuple[PushFinding | LeftoverFinding, ...]:
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
        async with open_context(site, site_path, folder=folder, clock=clock, say=say, instruments=()) as at:
            findings, held = await _handle_all(at, apply=apply, choice=choice)
            if not apply:
                record_look(at, "recover", found=len(findings))
        folder.set_state(held[0].outcome if held else "recovered")
    failure = outcome_error(held[0]) if held else None
    if failure is not None:
        raise failure
    return tuple(sorted(findings, key=lambda finding: not finding.still_on))


async def _handle_all(
    at: RunContext, *, apply: bool, choice: Choice
) -> tuple[list[PushFinding | LeftoverFinding], list[PushRecord]]:
    """What is found, and what of it did not go back to the old table, what is still on first."""
    findings: list[PushFinding] = []
    others: list[LeftoverFinding] = []
    held: list[PushRecord] = []
    left, may_write = at.supervisor.left, apply
    if not left.clear:
        others.append(told := await _withdraw_program(at, left, apply=apply))
        may_write = apply and told.after is not None and told.after.clear
    begun = AuditAdapter(at).begun
    for ended in set_ended_aside(machine_folder(at.store.root / JOURNALS, at.machine.serial), begun):
        if ended.entries:
            at.say("P-RECOVER", words=make_finding(ended, None, 0.0).said)
    read: LiveReadings | None = None if may_write else {}
    open_ = unfinished_tables(at.store.root / JOURNALS, at.machine.serial, begun)
    for found in open_:
        finding, record = await _handle_one(at, found, choice if may_write else None, read=read)
        findings.append(finding)
        held += [record] if record is not None and record.outcome in HELD else []
    named = with_rest(findings, open_, _committed_pushes(at))
    return [*others, *named], sorted(held, key=lambda record: HELD.index(record.outcome))


def _committed_pushes(at: RunContext) -> tuple[CommittedPush, ...]:
    """What is committed by now; nothing where a journal cannot be believed, which a finding says."""
    try:
        return all_pushes(at.store.root / JOURNALS, at.machine.serial)
    except StoreError:
        return ()


async def _withdraw_program(at: RunContext, found: StaleProgram, *, apply: bool) -> LeftoverFinding:
    """A program of ours is asked to end and its words are given back, before anything else is begun there."""
    if not apply:
        return LeftoverFinding(found)
    after = await clear_leftovers(at.supervisor, at.patience.start_s)
    at.say("P-RECOVER", words=after.said.message)
    return LeftoverFinding(found, after)


async def _handle_one(
    at: RunContext, found: JournalRead, choice: Choice | None, read: LiveReadings | None
) -> tuple[PushFinding, PushRecord | None]:
    """One finding, looked at (None) or carried out."""
    context = _context(at, found)
    if context is None or choice is None:
        finding = make_finding(found, None, 0.0) if context is None else await inspect_unfinished(found, context, read)
        if choice is not None:
            at.say("P-RECOVER", words=finding.said)
        return finding, None
    return await _recover_one(at, found, context, choice)


async def _recover_one(
    at: RunContext, found: JournalRead, context: PushContext, choice: Choice
) -> tuple[PushFinding, PushRecord]:
    """Look and carry out the offer; one that ends without a record is kept in the audit log too."""
    finding = make_finding(found, None, 0.0)

    def hear(seen: PushFinding) -> None:
        nonlocal finding
        finding = seen
        at.say("P-RECOVER", words=seen.said)

    try:
        record = await recover_table(found, context, _chosen_action(found, choice), tell=hear)
    except (TrueflankError, asyncio.CancelledError) as error:
        report_log_problem(at, record_failed_recovery(at, finding.code, found.number, error))
        raise
    report_log_problem(at, record_recovery(at, finding.code, record))
    return replace(finding, ended=record.outcome), record


def _chosen_action(found: JournalRead, choice: Choice) -> Choice:
    """What a person chose, of a rollback; anything else is as it is offered."""
    return choice if found.purpose == "restore" else "offered"


def _context(at: RunContext, found: JournalRead) -> PushContext | None:
    """What the journal's table is worked with; None where the journal does not say, or not of this site."""
    try:
        if found.latest("purpose") == "disable":
            return push_context(at, at.axis(str(found.latest("axis"))), None)
        table: CompensationTable = tables_of(found)[1]
        return replace(table_context(at, table, None), log=AuditAdapter(at))
    except (StoreError, ConfigError):
        return None
