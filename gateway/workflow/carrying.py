"""A push to a control that files are carried to: what it began with, so that it can be taken up when they came back."""

from __future__ import annotations

import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Literal

from drivers.carried import PieceOfWork, carrying
from drivers.errors import ConfigError
from gateway.domain.proposals import Approval, TableChange
from gateway.push import PushContext
from gateway.store import RunFolder
from gateway.workflow import stages
from gateway.workflow.bench import Bench
from gateway.workflow.consents import Taken

Way = Literal["", "begin", "resume"]


@dataclass(frozen=True, slots=True)
class CarriedPush:
    """What a push began with: its key, when, and the approvals it used up, by the table's name. ``over``: it ended."""

    key: str
    begun_utc: str
    approvals: tuple[tuple[str, tuple[Approval, ...]], ...]
    over: bool = False

    @property
    def taken(self) -> dict[str, Taken]:
        """The approvals as `gateway.workflow.consents.take_up` gave them."""
        at_utc = datetime.fromisoformat(self.begun_utc)
        return {name: Taken(approvals, at_utc) for name, approvals in self.approvals}


_way: ContextVar[Way] = ContextVar("way to a control without a wire", default="")


@contextmanager
def way_of(*, offline: bool, resume: bool) -> Iterator[None]:
    """In the block a push goes by files that are carried: it begins, or what waits for its files goes on.

    Raises ConfigError (E-OFF-RESUME) for what goes on by the wire.
    """
    if resume and not offline:
        raise ConfigError("E-OFF-RESUME", "--resume")
    before = _way.set(("resume" if resume else "begin") if offline else "")
    try:
        yield
    finally:
        _way.reset(before)


@contextmanager
def carried_for(folder: RunFolder, driver: str, *, apply: bool) -> Iterator[None]:
    """The piece of work of a push of this run; as on the wire where nobody asked for files.

    Raises ConfigError: E-OFF-ROAD where the control has a wire, E-OFF-APPLY where nothing is to be written. What is
    resumed and was never begun, or has ended, is refused when the control is opened.
    """
    way = _way.get()
    if not way:
        yield
        return
    if not driver.endswith("-offline"):
        raise ConfigError("E-OFF-ROAD", "--offline", driver=driver)
    if not apply:
        raise ConfigError("E-OFF-APPLY", "--offline")
    again: Literal["go-on", "resume"] = "go-on" if _waits(folder) else "resume"
    with carrying(PieceOfWork(f"push {folder.run_id}", again if way == "resume" else "fresh", ends=True)):
        yield


def going_on(at: Bench) -> CarriedPush | None:
    """The push of this run that waits for its files; None where none has begun, or this is none by files."""
    return _waits(at.folder) if _way.get() == "resume" else None


def _waits(folder: RunFolder) -> CarriedPush | None:
    """The push of a run that was begun and has not ended."""
    found = folder.get(stages.CARRIED, CarriedPush) if folder.has(stages.CARRIED) else None
    return None if found is None or found.over else found


def begun(at: Bench, approvals: Mapping[str, Taken]) -> CarriedPush | None:
    """Keep what a push by files begins with, before anything is carried for it. Raises StoreError."""
    if not _way.get():
        return None
    held = tuple((name, taken.approvals) for name, taken in approvals.items())
    utc = at.clock.utc() if not approvals else next(iter(approvals.values())).at_utc
    made = CarriedPush(secrets.token_hex(8), utc.isoformat(), held)
    at.folder.put(stages.CARRIED, made)
    return made


def ended(at: Bench, going: CarriedPush | None) -> None:
    """Keep that a push by files has ended: it is not taken up again. Raises StoreError."""
    if going is not None:
        at.folder.put(stages.CARRIED, replace(going, over=True))


def keyed(context: PushContext, going: CarriedPush | None, changes: list[TableChange]) -> PushContext:
    """The context of one transaction of a push by files: its key, so that it is found when the files came back."""
    if going is None:
        return context
    names = ",".join(change.name for change in changes)
    return replace(context, key=f"{going.key} {names}", resumes=_way.get() == "resume")
