"""Who may come in to the pages of a store, and the record of what people did there."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from drivers.clock import Clock
from drivers.message import render
from gateway import audit
from gateway.broker import token_of
from gateway.config.service import ServiceSection
from gateway.users import RefusedSignIns, Sessions, Tries, UserAccounts
from gateway.web import Doorkeeping

SECRET_TRIES, SECRET_WITHIN_S = 5, 60.0
REQUESTS, REQUESTS_WITHIN_S = 600, 10.0
REFUSED_EVERY_S, REFUSED, RENAMED = 3600.0, "sign-in-refused", "user-renamed"
LOG = logging.getLogger("trueflank.accounts")


def sessions_of(clock: Clock, wanted: ServiceSection) -> Sessions:
    """Nobody has signed in yet."""
    return Sessions(clock.now, wanted.signout_min * 60.0)


def doors_of(
    root: Path,
    clock: Clock,
    accounts: UserAccounts,
    sessions: Sessions,
    *,
    hosts: Sequence[str] = (),
    secure: bool = False,
) -> Doorkeeping:
    """Who may come in to a store's service; makes the token of the first start, brings older accounts up to date.

    Raises StoreError.
    """
    accounts.first_token()
    for one in accounts.migrate(clock.utc()):
        LOG.warning("%s", render(one))
        audit.note(root, RENAMED, clock=clock, actor="nobody", role="service", details=dict(one.fields))
    return Doorkeeping(
        accounts=accounts,
        sessions=sessions,
        terminal=token_of(root),
        tries=Tries(clock.now, SECRET_TRIES, SECRET_WITHIN_S),
        asks=Tries(clock.now, REQUESTS, REQUESTS_WITHIN_S),
        hosts=tuple(hosts),
        secure=secure,
    )


@dataclass(frozen=True, slots=True)
class Moment:
    """One moment of a clock, for a thread that has no loop to ask."""

    at_utc: datetime
    at_s: float

    def utc(self) -> datetime:
        """The moment in UTC."""
        return self.at_utc

    def now(self) -> float:
        """Monotonic seconds."""
        return self.at_s


async def note_refused(doors: Doorkeeping, root: Path, clock: Clock) -> None:
    """Every hour, for ever, what `keep_refused` and the accounts have to keep."""
    while True:
        await clock.sleep(REFUSED_EVERY_S)
        await keep_what_was_seen(doors, root, clock)


async def keep_what_was_seen(doors: Doorkeeping, root: Path, clock: Clock) -> None:
    """Refused sign-ins into the audit log, and when tokens were used last into the accounts."""
    await keep_refused(doors.refused, root, clock)
    await asyncio.to_thread(doors.accounts.keep_uses)


async def keep_refused(refused: RefusedSignIns, root: Path, clock: Clock) -> None:
    """What was refused since the last time into the audit log, in a thread: nobody acted, the address is recorded.

    There is one record for each name and address.
    """
    found, moment = refused.take(), Moment(clock.utc(), clock.now())

    def keep() -> None:
        for one in found:
            audit.note(root, REFUSED, clock=moment, actor="nobody", role="service", details=one.as_data())

    if found:
        await asyncio.to_thread(keep)


def noting(root: Path, clock: Clock) -> Callable[..., str]:
    """Keeps what people did in a store's audit log."""

    def note(action: str, *, actor: str = "", details: dict[str, object] | None = None) -> str:
        return audit.note(root, action, clock=clock, actor=actor, role="service", details=details)

    return note
