"""The context of a push in a run: the table's axes, proof and consent; and the state of a push by carried files."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Awaitable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Literal, TypeVar

from drivers.errors import ConfigError, TrueflankError
from drivers.offline_exchange import PieceOfWork, exchange_files_for
from drivers.types.tables import CompensationTable
from drivers.types.uptime import Uptime
from gateway.approve import is_risk_taken
from gateway.config import AxisSection
from gateway.domain.captures import Capture
from gateway.domain.proposals import Approval, TableChange
from gateway.push import JOURNALS, PushContext
from gateway.store import RunFolder
from gateway.workflow.run import stages
from gateway.workflow.run.audit_trail import ConsumedApproval, record_failure, report_log_problem
from gateway.workflow.run.context import RunContext
from gateway.workflow.run.self_test import last_self_test

Done = TypeVar("Done")


def table_context(at: RunContext, table: CompensationTable, capture: Capture | None) -> PushContext:
    """What a push of this very table works with: its axes, and the proof of its kind if there is one."""
    context = push_context(at, at.axis(table.output_axis), capture)
    other = at.facts(at.axis(table.input_axis)) if table.input_axis != table.output_axis else None
    return replace(context, input=other, proof=at.proofs.find(at.machine, table.kind, table.output_axis))


def push_context(at: RunContext, axis: AxisSection, capture: Capture | None) -> PushContext:
    """What a push of this axis works with; the operator's consent was checked before the devices were opened."""
    operator, name = at.site.operator, at.site.site.name
    return PushContext(
        controller=at.supervisor.controller,
        clock=at.clock,
        folder=at.folder,
        journals=at.store.root / JOURNALS,
        axis=at.facts(axis),
        machine=at.machine,
        typed_name=name,
        site_name=name,
        capture=capture,
        start_timeout_s=operator.start_timeout_s,
        stop_timeout_s=operator.stop_timeout_s,
        approvals_needed=at.site.site.approvals,
        access_level_needed=at.site.controller.access_level,
        say=at.say,
        self_test=last_self_test(at, axis),
        risk_taken=is_risk_taken(),
    )


async def record_failed_push(at: RunContext, changes: Sequence[TableChange], work: Awaitable[Done]) -> Done:
    """Keep in the audit log how a push or sign proof ended that leaves no record, a stop from outside included."""
    try:
        return await work
    except (TrueflankError, asyncio.CancelledError) as error:
        for change in changes:
            if not change.skipped:
                report_log_problem(at, record_failure(at, change, error))
        raise


# A push to a control that files are carried to: what it began with, so that it can be taken up when they came back.

OfflineChoice = Literal["", "begin", "resume"]


@dataclass(frozen=True, slots=True)
class CarriedPush:
    """What a push began with: its key, when, and the approvals it used up, by the table's name. ``over``: it ended."""

    key: str
    begun_utc: str
    approvals: tuple[tuple[str, tuple[Approval, ...]], ...]
    over: bool = False
    begun_at: Uptime = field(default_factory=Uptime)

    @property
    def taken(self) -> dict[str, ConsumedApproval]:
        """The approvals as `gateway.workflow.run.audit_trail.consume_approvals` gave them."""
        at_utc = datetime.fromisoformat(self.begun_utc)
        return {name: ConsumedApproval(approvals, at_utc, self.begun_at) for name, approvals in self.approvals}


_offline_choice: ContextVar[OfflineChoice] = ContextVar("way to a control without a wire", default="")


@contextmanager
def push_by_files(*, offline: bool, resume: bool) -> Iterator[None]:
    """In the block a push goes by files that are carried: it begins, or what waits for its files goes on.

    Raises ConfigError (E-OFF-RESUME) for what goes on by the wire.
    """
    if resume and not offline:
        raise ConfigError("E-OFF-RESUME", "--resume")
    before = _offline_choice.set(("resume" if resume else "begin") if offline else "")
    try:
        yield
    finally:
        _offline_choice.reset(before)


@contextmanager
def offline_work_of(folder: RunFolder, driver: str, *, apply: bool) -> Iterator[None]:
    """The piece of work of a push of this run; as on the wire where nobody asked for files.

    Raises ConfigError: E-OFF-ROAD where the control has a wire, E-OFF-APPLY where nothing is to be written. What is
    resumed and was never begun, or has ended, is refused when the control is opened.
    """
    way = _offline_choice.get()
    if not way:
        yield
        return
    if not driver.endswith("-offline"):
        raise ConfigError("E-OFF-ROAD", "--offline", driver=driver)
    if not apply:
        raise ConfigError("E-OFF-APPLY", "--offline")
    again: Literal["go-on", "resume"] = "go-on" if _waits(folder) else "resume"
    with exchange_files_for(PieceOfWork(f"push {folder.run_id}", again if way == "resume" else "fresh", ends=True)):
        yield


def unfinished_offline_push(at: RunContext) -> CarriedPush | None:
    """The push of this run that waits for its files; None where none has begun, or this is none by files."""
    return _waits(at.folder) if _offline_choice.get() == "resume" else None


def _waits(folder: RunFolder) -> CarriedPush | None:
    """The push of a run that was begun and has not ended."""
    found = folder.get(stages.CARRIED, CarriedPush) if folder.has(stages.CARRIED) else None
    return None if found is None or found.over else found


def begin_offline_push(at: RunContext, approvals: Mapping[str, ConsumedApproval]) -> CarriedPush | None:
    """Keep what a push by files begins with, before anything is carried for it. Raises StoreError."""
    if not _offline_choice.get():
        return None
    held = tuple((name, taken.approvals) for name, taken in approvals.items())
    utc = at.clock.utc() if not approvals else next(iter(approvals.values())).at_utc
    began = at.clock.uptime() if not approvals else next(iter(approvals.values())).at_uptime
    made = CarriedPush(secrets.token_hex(8), utc.isoformat(), held, begun_at=began)
    at.folder.put(stages.CARRIED, made)
    return made


def end_offline_push(at: RunContext, going: CarriedPush | None) -> None:
    """Keep that a push by files has ended: it is not taken up again. Raises StoreError."""
    if going is not None:
        at.folder.put(stages.CARRIED, replace(going, over=True))


def with_transaction_key(context: PushContext, going: CarriedPush | None, changes: list[TableChange]) -> PushContext:
    """The context of one transaction of a push by files: its key, so that it is found when the files came back."""
    if going is None:
        return context
    names = ",".join(change.name for change in changes)
    return replace(context, key=f"{going.key} {names}", resumes=_offline_choice.get() == "resume")
