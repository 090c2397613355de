"""The table from before the last committed push, put back on request as a transaction of its own."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

from drivers.clock import Clock
from drivers.errors import TrueflankError, words
from drivers.terms import spoken
from drivers.types.tables import CompensationTable
from drivers.types.values import Approach
from gateway import audit
from gateway.config import SiteFile
from gateway.errors import WriteRefused
from gateway.moving import shown
from gateway.push import PushContext, outcome_error
from gateway.push.records.history import Committed, committed, to_undo
from gateway.push.records.journal import JOURNALS
from gateway.push.undoing import ask_undo, undo
from gateway.say import Say
from gateway.table.comparison import effective, toward
from gateway.workflow.bench import Bench, bench, check_name, run_or_look
from gateway.workflow.consents import audit_problem, looked, tell, why_of, word_of
from gateway.workflow.control.contexts import table_context
from gateway.workflow.outcome import Outcome
from gateway.workflow.witness import Witness


async def roll_back_site(
    site: SiteFile, site_path: Path, *, table: str, apply: bool, machine_name: str, clock: Clock, say: Say
) -> Outcome:
    """Take back the last committed push of a table by its name; without `apply` only say what would be.

    Raises WriteRefused (E-RUN-NAME, E-ROLLBACK-NOTHING, E-PUSH-REFUSED), ConfigError (E-RUN-AXIS), VerifyError (the
    rollback failed and the newer table is live again), RollbackFailed (held), CorruptRecord (E-AUDIT-BROKEN).
    """
    check_name(site, apply, machine_name)
    with run_or_look(site, site_path, "rolling-back", look=not apply) as folder:
        async with bench(site, site_path, folder=folder, clock=clock, say=say) as at:
            done = to_undo(history(at, table))
            if done is None:
                raise WriteRefused("E-ROLLBACK-NOTHING", table, table=table, serial=at.machine.serial)
            context = context_of(at, done.new.table)
            return await (_applied(at, done, context) if apply else _shown(at, done, context))


def history(at: Bench, table: str) -> tuple[Committed, ...]:
    """Every committed push of a table of this machine, cross tables as deviations by its proof.

    Raises ConfigError (E-RUN-AXIS), WriteRefused (E-RUN-NO-PROOF), StoreError.
    """
    axis, cross = spoken().axis_of(table), spoken().is_cross(table)
    at.axis(axis)
    proof = at.proofs.find(at.machine, "cross", axis) if cross else None
    if cross and proof is None:
        raise WriteRefused("E-RUN-NO-PROOF", table)
    meant = partial(at.supervisor.controller.table_by, proof=proof)
    return committed(at.store.root / JOURNALS, at.machine.serial, table, meant)


def context_of(at: Bench, table: CompensationTable) -> PushContext:
    """What a transaction without a capture works with, with who asks for it and the state of the audit."""
    broken = audit_problem(at)
    return replace(table_context(at, table, None), actor=audit.person(), audit_broken=broken, log=Witness(at))


async def _shown(at: Bench, done: Committed, context: PushContext) -> Outcome:
    asked = await ask_undo(done, context)
    reasons = [reason.words for reason in asked.refusals]
    points = _difference(done)
    lines = [words("W-ROLLBACK-PLAN", table=done.table, transaction=done.transaction, utc=done.utc), _largest(done)]
    lines += [f"  {reason}" for reason in reasons] or ["  " + words("W-ROLLBACK-FREE")]
    lines.append(words("W-ROLLBACK-DRY"))
    looked(at, "rollback", table=done.table, undoes=done.transaction)
    data = {"transaction": done.transaction, "table": done.table, "refusals": reasons, "applied": False}
    return Outcome(state="looked", run_folder="", rows=(), lines=tuple(lines), points=tuple(points), data=data)


def _largest(done: Committed) -> str:
    """The point at which the table changes most, in words."""
    unit, new = done.new.table.deviation_unit, done.new.table
    if new.kind == "reversal":
        was, becomes = (effective(one).deviations[0] for one in (done.new, done.old))
        return words("W-ROLLBACK-REVERSAL", was=round(was, 2), becomes=round(becomes, 2), unit=unit)
    changes = [(becomes - was, float(place), was, becomes) for place, _, was, becomes in _changes(done)]
    _, place, was, becomes = max(changes, key=lambda one: abs(one[0]))
    told = {"was": round(was, 2), "becomes": round(becomes, 2), "unit": unit}
    return words("W-ROLLBACK-LARGEST", place=shown(place), place_unit=new.input_unit, count=len(changes), **told)


def _difference(done: Committed) -> list[str]:
    """What the table would become, at the points of the larger of both."""
    new, old = done.new, done.old
    if new.table.kind == "reversal":
        was, becomes = (effective(one).deviations[0] for one in (new, old))
        return [f"  {was:+9.3f} -> {becomes:+9.3f} {new.table.deviation_unit}"]
    unit, both = new.table.deviation_unit, bool(new.table.reverse or old.table.reverse)
    lines = [words("W-ROLLBACK-POINTS", table=done.table)]
    for place, way, was, becomes in _changes(done):
        side = f"  {'+-'[way < 0]}" if both else ""
        lines.append(f"  {place:10.3f}{side} {was:+9.3f} -> {becomes:+9.3f} {unit}")
    return lines


def _changes(done: Committed) -> Iterator[tuple[float, Approach, float, float]]:
    """Each point of the larger of both tables, the direction of travel, what acts there now and what would act."""
    new, old = done.new, done.old
    places = max((new.table, old.table), key=lambda table: len(table.deviations)).positions
    ways: tuple[Approach, ...] = (1, -1) if new.table.reverse or old.table.reverse else (1,)
    for way in ways:
        now, then = toward(effective(new), places, way), toward(effective(old), places, way)
        for place, was, becomes in zip(places, now, then, strict=True):
            yield float(place), way, float(was), float(becomes)


async def _applied(at: Bench, done: Committed, context: PushContext) -> Outcome:
    root, serial = at.store.root, at.machine.serial
    told = {"table": done.table, "undoes": done.transaction, "run": at.folder.run_id}
    audit.record(root, "rollback-start", clock=at.clock, serial=serial, details=told)
    try:
        record = await undo(done, context)
    except (TrueflankError, asyncio.CancelledError) as error:
        why = {**told, "why": why_of(error)}
        action = f"rollback-{word_of(error)}"
        tell(at, audit.note(root, action, clock=at.clock, serial=serial, details=why))
        raise
    at.folder.put(f"rollback-{done.table}", record)
    at.folder.set_state(f"rollback-{record.outcome}")
    action = f"rollback-{record.outcome}"
    problem = audit.note(root, action, clock=at.clock, serial=serial, transaction=record.transaction, details=told)
    failure = outcome_error(record)
    if failure is not None:
        raise failure
    lines = [words("W-ROLLBACK-DONE", table=done.table, transaction=done.transaction), *([problem] if problem else [])]
    data = {"transaction": record.transaction, "undoes": done.transaction, "table": done.table, "applied": True}
    return Outcome(
        state=at.folder.state,
        run_folder=str(at.folder.path),
        rows=(),
        lines=tuple(lines),
        data={**data, "outcome": record.outcome},
    )
