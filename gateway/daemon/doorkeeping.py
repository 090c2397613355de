"""Who may come in to the pages of a store, and the record of what people did there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from drivers.clock import Clock
from gateway import audit
from gateway.broker import token_of
from gateway.config.service import ServiceSection
from gateway.users import Sessions, Tries, UserAccounts
from gateway.web import Doorkeeping

SECRET_TRIES, SECRET_WITHIN_S = 5, 60.0
REQUESTS, REQUESTS_WITHIN_S = 600, 10.0


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
    """Who may come in to a store's service; the token of the first start is made. Raises StoreError."""
    accounts.first_token()
    return Doorkeeping(
        accounts=accounts,
        sessions=sessions,
        terminal=token_of(root),
        tries=Tries(clock.now, SECRET_TRIES, SECRET_WITHIN_S),
        asks=Tries(clock.now, REQUESTS, REQUESTS_WITHIN_S),
        hosts=tuple(hosts),
        secure=secure,
    )


def noting(root: Path, clock: Clock) -> Callable[..., str]:
    """Keeps what people did in a store's audit log."""

    def note(action: str, *, actor: str = "", details: dict[str, object] | None = None) -> str:
        return audit.note(root, action, clock=clock, actor=actor, role="service", details=details)

    return note
