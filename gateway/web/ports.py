"""What the routes need of the daemon: its sites, each with its desk and stream, and the doors' books."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from drivers.clock import Clock
from gateway.config import SiteFile
from gateway.index import SiteIndex
from gateway.live import Asked
from gateway.mqtt import Outgoing
from gateway.remaining import RemainingTime
from gateway.say import Say
from gateway.store import Store
from gateway.users import KnownBrowsers, RefusedSignIns, Sessions, Tries, UserAccounts
from gateway.views import JobView, StatusView

Work = Callable[[Say], Awaitable[object]]


class ServedSite(Protocol):
    """One site as the daemon serves it."""

    @property
    def site(self) -> SiteFile: ...
    @property
    def path(self) -> Path: ...
    @property
    def store(self) -> Store: ...

    def picture(self) -> StatusView:
        """Everything as it is now."""
        ...

    def jobs(self) -> tuple[JobView, ...]:
        """The newest commands, newest first."""
        ...

    def begin(self, work: Work, *, kind: str, who: str, remaining: RemainingTime | None = None) -> JobView:
        """Give a command; ``remaining`` reckons its time to go. Raises BusyError."""
        ...

    def stop_job(self, by: str) -> bool:
        """Ask the command at work to end; false where there is none."""
        ...

    def ask_again(self, axis: str, stop: Asked) -> bool:
        """Have a reading taken again by the run at work; false where too many wait."""
        ...

    def taken(self) -> tuple[Mapping[str, object], ...]:
        """The readings that the command at work, or the last one, has taken so far."""
        ...

    def airs(self) -> tuple[Mapping[str, object], ...]:
        """Air and material as they were read since the command at work, or the last one, began; each with its utc."""
        ...

    def stream(self, who: str = "", *, operates: bool = True) -> AsyncIterator[str]:
        """The live stream as server-sent events, for one person. Raises BusyError (E-WEB-STREAMS)."""
        ...

    def stream_counts(self) -> tuple[int, int]:
        """How many pages listen, and how many frames slow ones lost since the start."""
        ...

    def outgoing(self) -> Outgoing | None:
        """How messages to other systems stand; None where the site names no server for them."""
        ...

    @property
    def index(self) -> SiteIndex:
        """The index of its runs."""
        ...

    async def doctor(self, say: Say) -> object:
        """Look at the road to the control."""
        ...


class SiteMaking(Protocol):
    """The questions of `init`, where a service has no site file yet."""

    def ask(self, answers: Mapping[str, str], who: str, *, anew: bool = False) -> Mapping[str, Any]:
        """The next question behind these answers, with what was found; it blocks while the control is asked."""
        ...

    def write(self, answers: Mapping[str, str], who: str) -> Mapping[str, Any]:
        """Write the site file. Raises ConfigError."""
        ...


@dataclass(frozen=True, slots=True)
class Making:
    """A site file in the making; ``made`` is set once it is written."""

    site: SiteMaking
    made: asyncio.Event


@dataclass(frozen=True, slots=True)
class Doorkeeping:
    """Everything that decides who may come in.

    ``terminal`` is the token in the state folder: who can read it is at this computer. ``secrets_at_once`` bounds how
    many passwords are checked together; ``tries`` how often secrets, ``asks`` how often anything may be tried.
    ``refused`` sums refused sign-ins, ``browsers`` are those that have signed in before.
    """

    accounts: UserAccounts
    sessions: Sessions
    terminal: str
    tries: Tries
    asks: Tries
    hosts: tuple[str, ...] = ()
    secure: bool = False
    refused: RefusedSignIns = field(default_factory=RefusedSignIns)
    browsers: KnownBrowsers = field(default_factory=KnownBrowsers)
    secrets_at_once: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(2))


@dataclass(frozen=True, slots=True)
class Service:
    """What an application serves. ``health`` answers /healthz; ``note`` keeps what people did in the audit log."""

    sites: Mapping[str, ServedSite]
    doors: Doorkeeping
    clock: Clock
    health: Callable[[], dict[str, object]]
    note: Callable[..., str]
    software: str
    making: Making | None = None
    keys: dict[str, tuple[str, Any]] = field(default_factory=dict)
