"""An invented service for the routes: one site that notes what is asked of it, accounts with cheap hashes."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.clock import LoopClock
from gateway.config import SiteFile
from gateway.errors import BusyError
from gateway.index import SiteIndex
from gateway.live import Asked
from gateway.mqtt import Outgoing
from gateway.remaining import RemainingTime
from gateway.say import Say
from gateway.store import Store
from gateway.users import Person, Sessions, Tries, UserAccounts, UserRole
from gateway.users.passwords import Hasher
from gateway.views import JobView, StatusView
from gateway.web import Doorkeeping, Service, Work, create_app
from tests.unit.web.pictures import status

TOKEN = "t" * 43
PASSWORD = "a long sentence"
PIN = "246802"
CHEAP = Hasher(time_cost=1, memory_kib=8)


class Time:
    """Seconds that a test moves."""

    def __init__(self) -> None:
        self.s = 0.0

    def __call__(self) -> float:
        return self.s


@dataclass
class FakeSite:
    """A site without a daemon."""

    site: SiteFile
    path: Path
    store: Store
    shown: Callable[[], StatusView] = status
    given: list[tuple[str, str]] = field(default_factory=list)
    asked: list[tuple[str, Asked]] = field(default_factory=list)
    stopped: list[str] = field(default_factory=list)
    busy: bool = False

    def picture(self) -> StatusView:
        return self.shown()

    def jobs(self) -> tuple[JobView, ...]:
        return tuple(
            JobView(number, kind, who, "running", "", "2026-03-02T09:00:00+00:00")
            for number, (kind, who) in enumerate(self.given, 1)
        )

    def begin(self, work: Work, *, kind: str, who: str, remaining: RemainingTime | None = None) -> JobView:
        if self.busy:
            raise BusyError("E-WEB-BUSY", "daemon", run="r-3", who="anna")
        self.given.append((kind, who))
        return self.jobs()[-1]

    def stop_job(self, by: str) -> bool:
        self.stopped.append(by)
        return True

    def ask_again(self, axis: str, stop: Asked) -> bool:
        self.asked.append((axis, stop))
        return len(self.asked) < 3

    async def _frames(self) -> AsyncIterator[str]:
        yield "event: picture\ndata: {}\n\n"

    def stream(self, who: str = "", *, operates: bool = True) -> AsyncIterator[str]:
        return self._frames()

    def taken(self) -> tuple[Mapping[str, object], ...]:
        return ({"axis": "X1", "target": 1.0, "repetition": 1, "approach": 1, "deviation": 0.5},)

    def airs(self) -> tuple[Mapping[str, object], ...]:
        return ({"utc": "2026-03-02T09:00:00+00:00", "air_degc": 20.4, "material_degc": [20.1]},)

    def stream_counts(self) -> tuple[int, int]:
        return 2, 7

    def outgoing(self) -> Outgoing | None:
        return Outgoing(connected=True, queued=3, confirmed=40, dropped=2)

    @property
    def index(self) -> SiteIndex:
        return SiteIndex(self.site, self.path, self.store)

    async def doctor(self, _say: Say) -> object:
        return None


@dataclass
class Offered:
    """A service with its parts, for a test to look into."""

    service: Service
    at: FakeSite
    time: Time
    notes: list[tuple[str, str]]

    @property
    def app(self) -> Any:
        """The one application of these tests, with this service behind it: to describe all routes takes a while."""
        one = _one_app()
        one.state.service = self.service
        return one

    def signed_in(self, *roles: UserRole, name: str = "anna") -> dict[str, str]:
        """Headers of a session with these roles, the key for changes among them."""
        key, session = self.service.doors.sessions.begin(Person(name, frozenset(roles)))
        return {"cookie": f"trueflank-session={key}", "x-csrf-token": session.csrf}


@functools.cache
def _one_app() -> Any:
    return create_app(Service({}, None, None, dict, str, ""))  # type: ignore[arg-type]


def offered(folder: Path, site: SiteFile, **more: Any) -> Offered:
    """A service of one site; ``more`` are fields of its doors."""
    time, notes = Time(), list[tuple[str, str]]()
    at = FakeSite(site, folder / "site.toml", Store(folder))
    doors: dict[str, Any] = {
        "accounts": UserAccounts(folder, CHEAP),
        "sessions": Sessions(time, 900.0),
        "terminal": TOKEN,
        "tries": Tries(time, 5, 60.0),
        "asks": Tries(time, 600, 10.0),
        "secrets_at_once": asyncio.Semaphore(2),
    }

    def note(action: str, *, actor: str = "", details: dict[str, object] | None = None) -> str:
        notes.append((action, actor or str((details or {}).get("name", ""))))
        return ""

    def health() -> dict[str, object]:
        alarms = list(map(str, at.picture().alarms))
        return {"status": "alarm", "alarms": alarms} if alarms else {"status": "ok"}

    service = Service(
        {site.site.name: at}, Doorkeeping(**{**doors, **more}), LoopClock(), health, note, "trueflank 0.1.0"
    )
    return Offered(service, at, time, notes)
