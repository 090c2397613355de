"""One table of the site's machine switched off on request, and nothing else done to it."""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import replace
from pathlib import Path
from typing import Any

from drivers.clock import Clock
from drivers.errors import ConfigError, TrueflankError
from drivers.message import Message
from drivers.offline_exchange import OfflineExchange
from drivers.terms import spoken
from drivers.types.orders import DisableOrder
from gateway import audit
from gateway.config import AxisSection, SiteFile
from gateway.domain.outcomes import SwitchRecord
from gateway.errors import StillOn, StoreError, WriteRefused
from gateway.push import (
    JOURNALS,
    DisablePreflight,
    JournalRead,
    PushContext,
    disable_order,
    disable_table,
    preflight_disable,
    tables_of,
    unfinished_tables,
)
from gateway.say import Say
from gateway.workflow.run.audit_trail import error_words, outcome_word, record_look, report_log_problem
from gateway.workflow.run.context import RunContext, axis_named, check_name, open_context, run_or_look
from gateway.workflow.run.outcome import Outcome
from gateway.workflow.run.push_context import push_context


async def disable_site(
    site: SiteFile, site_path: Path, *, axis: str, table: str, apply: bool, machine_name: str, clock: Clock, say: Say
) -> Outcome:
    """Switch a table off; without `apply` only say what acts, and so how far the axis would move.

    ``table`` "" is the axis' own, else a cross table as people name it. No instrument is opened. Raises WriteRefused
    (E-RUN-NAME, E-PUSH-REFUSED), ConfigError (E-RUN-AXIS, E-DISABLE-TABLE), StillOn (E-DISABLE-STILL-ON), BusyError.
    """
    check_name(site, apply, machine_name)
    name, _, cross = axis.partition("-")
    section = axis_named(site, site_path, name)
    order = order_named(section, table or cross)
    with run_or_look(site, site_path, "disabling", look=not apply) as folder:
        async with open_context(site, site_path, folder=folder, clock=clock, say=say, instruments=()) as at:
            await _exists(at, order, table or cross)
            context = replace(push_context(at, section, None), actor=audit.acting_person())
            if not apply:
                return _preview(at, await preflight_disable(order, context))
            return _outcome(at, await _disable(at, order, context))


async def _exists(at: RunContext, order: DisableOrder, table: str) -> None:
    """A cross table that the control does not have is none; one that cannot be asked after is taken to be there.

    Raises ConfigError (E-DISABLE-TABLE).
    """
    if order.kind != "cross":
        return
    controller = at.supervisor.controller
    found = controller.capabilities.table("cross") is not None
    with contextlib.suppress(TrueflankError):
        found = found and (await controller.table_limits(order.axis, "cross", order.index)).reserved_points > 0
    if not found:
        raise ConfigError("E-DISABLE-TABLE", "--table", table=table, axis=order.axis)


def order_named(axis: AxisSection, table: str) -> DisableOrder:
    """The table of an axis that is meant: its own by no word, its reversal or a cross table as people name them.

    Raises ConfigError (E-DISABLE-TABLE).
    """
    plain = table.removeprefix(f"{axis.name}-").lower()
    cross = spoken().cross_index(plain)
    if cross is not None:
        return DisableOrder(0, "cross", axis.name, cross)
    if plain == spoken().reversal_key:
        return DisableOrder(0, "reversal", axis.name, axis.encoder)
    if plain not in ("", spoken().own_key, axis.name.lower()):
        raise ConfigError("E-DISABLE-TABLE", "--table", table=table, axis=axis.name)
    return DisableOrder(0, "axis", axis.name, axis.encoder)


async def _disable(at: RunContext, order: DisableOrder, context: PushContext) -> SwitchRecord:
    """Kept in the audit at both ends, but a log that cannot be written is told and keeps no table on."""
    report_log_problem(at, _note(at, "disable-start", order.name, 0))
    try:
        record = await disable_table(order, context, _unfinished_push_of(at, order))
    except (TrueflankError, asyncio.CancelledError) as error:
        report_log_problem(at, _note(at, f"disable-{outcome_word(error)}", order.name, 0, why=error_words(error)))
        raise
    at.folder.put(f"disable-{order.name}", record)
    told = {"before": record.before, "after": record.after, "unit": record.unit}
    report_log_problem(at, _note(at, f"disable-{record.outcome}", order.name, record.transaction, **told))
    at.folder.set_state(f"disable-{record.outcome}")
    return record


def _note(at: RunContext, action: str, table: str, transaction: int, **told: Any) -> str:
    details = {"table": table, "run": at.folder.run_id, **told}
    root, serial = at.store.root, at.machine.serial
    return audit.note(root, action, clock=at.clock, serial=serial, transaction=transaction, details=details)


def _unfinished_push_of(at: RunContext, order: DisableOrder) -> JournalRead | None:
    """The journal of a push of this very table that did not end: its hold is told there."""
    for found in unfinished_tables(at.store.root / JOURNALS, at.machine.serial):
        try:
            same = not found.broken and disable_order(tables_of(found)[1]) == order
        except StoreError:
            continue
        if same:
            return found
    return None


def _preview(at: RunContext, asked: DisablePreflight) -> Outcome:
    record_look(at, "disable", table=asked.order.name)
    carried = isinstance(
        at.supervisor.controller, OfflineExchange
    )  # what its files say is not what its switch reads now
    lines = [_line(asked, carried=carried), *(reason.message for reason in asked.refusals)]
    lines.append(Message.of("W-DISABLE-DRY"))
    reading, reasons = asked.reading, [reason.words for reason in asked.refusals]
    data: dict[str, Any] = {"table": asked.order.name, "unit": asked.unit, "applied": False, "refusals": reasons}
    data["refused_by"] = [reason.code for reason in asked.refusals]
    data |= {"enabled": None, "acting": None, "off": None}
    if reading is not None:
        data |= {"enabled": reading.enabled, "acting": reading.acting, "off": reading.off and not carried}
    if data["off"]:
        lines.pop()  # nothing is left to switch off
    return Outcome(state="looked", run_folder="", rows=(), lines=tuple(lines), data=data)


def _line(asked: DisablePreflight, *, carried: bool) -> Message:
    fields = {"table": asked.order.name, "axis": asked.order.axis, "unit": asked.unit}
    if asked.reading is None:
        return Message.of("W-DISABLE-UNREAD", **fields)
    if carried:
        return Message.of("W-DISABLE-WAS-OFF" if asked.reading.off else "W-DISABLE-WAS-ON", **fields)
    if asked.reading.off:
        return Message.of("W-DISABLE-OFF", **fields)
    return Message.of("W-DISABLE-PLAN", acting=round(asked.reading.acting, 3), **fields)


def _outcome(at: RunContext, record: SwitchRecord) -> Outcome:
    """Raises WriteRefused (E-PUSH-REFUSED), StillOn (E-DISABLE-STILL-ON)."""
    if record.outcome == "refused":
        raise WriteRefused("E-PUSH-REFUSED", record.table, count=len(record.reasons), reasons=record.reasons)
    if record.outcome == "still-on":
        why = record.reasons or Message.of("W-DISABLE-NO-ANSWER")
        raise StillOn("E-DISABLE-STILL-ON", record.table, table=record.table, axis=record.axis, why=why)
    code = "W-DISABLE-OFF" if record.outcome == "already-off" else "W-DISABLE-DONE"
    lines = (Message.of(code, table=record.table, axis=record.axis),)
    data = {"transaction": record.transaction, "table": record.table, "applied": True, "outcome": record.outcome}
    data |= {"unit": record.unit, "before": record.before, "after": record.after}
    return Outcome(state=at.folder.state, run_folder=str(at.folder.path), rows=(), lines=lines, data=data)
