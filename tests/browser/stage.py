"""The page on a stage: its files, records and pictures from an application in this process, its stream from the test.

No cell, no service and no socket: the browser's requests are answered here, and `Stage.tell` is the stream. A screen
costs tenths of a second, so that every width, look and language can be looked at.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal
from urllib.parse import urlsplit

from playwright.sync_api import Browser, Page, Route, ViewportSize

from drivers.clock import LoopClock
from gateway.config import SiteFile
from gateway.daemon.stream import Hub
from gateway.domain.outcomes import Verdict
from gateway.domain.proposals import Proposal
from gateway.store import Store
from gateway.views import StatusView, as_data, device_views
from gateway.views.runs import newest_runs
from tests.browser.person import MODULES
from tests.unit.report.synthetic import MACHINE, axis_material
from tests.unit.web.client import Client
from tests.unit.web.pictures import Seen, status
from tests.unit.web.services import Offered, offered

UNPACKED = ("content-encoding", "content-length")
SOON_MS = 90_000
"""Nothing is far away on a stage."""
ORIGIN = "http://127.0.0.1:8617"
STREAM = """() => {
  window.streams = [];
  window.EventSource = class extends EventTarget {
    constructor() { super(); this.readyState = 1; window.streams.push(this); setTimeout(() => this.onopen?.(), 0); }
    close() { this.readyState = 2; window.streams = window.streams.filter((one) => one !== this); }
  };
  window.EventSource.CLOSED = 2;
  window.tell = (kind, data) => {
    const frame = { data: JSON.stringify(data), lastEventId: '1' };
    for (const one of window.streams) one.dispatchEvent(new MessageEvent(kind, frame));
  };
}"""
Look = Literal["light", "dark"]


@dataclass
class Stage:
    """One page in a browser; ``now`` is the picture that its status and its stream have.

    ``asked`` are method, path and body of what it wanted, ``instead`` answers by the end of a path.
    """

    offer: Offered
    page: Page
    now: StatusView
    errors: list[str] = field(default_factory=list)
    asked: list[tuple[str, str, str]] = field(default_factory=list)
    instead: dict[str, Any] = field(default_factory=dict)

    def tell(self, kind: str, data: Mapping[str, object]) -> None:
        """A frame of the stream."""
        self.page.evaluate(
            "([kind, data]) => window.tell(kind, data)", [kind, json.loads(json.dumps(data, default=str))]
        )

    def change(self, **changes: object) -> None:
        """The picture changes, and the stream says so."""
        self.now = replace(self.now, **changes)  # type: ignore[arg-type]
        self.offer.at.shown = lambda: self.now
        self.tell("state", as_data(self.now))

    def say(self, code: str, **fields: object) -> None:
        """A word of the run at work, as the service's own stream forms it."""
        told: list[tuple[str, Mapping[str, object]]] = []
        Hub(LoopClock(), dict, also=lambda kind, data: told.append((kind, data))).hear(code, fields)
        for kind, data in told:
            self.tell(kind, data)

    def go(self, screen: str) -> None:
        """To a screen of the rail."""
        self.page.locator(f"#go-{screen}").click()
        self.page.locator(f"main.{screen}").wait_for()


def idle(offer: Offered) -> StatusView:
    """A site at rest: every device open, its runs as stored."""
    open_ = [Seen(name, driver, "open") for name, driver in (("controller", "sinumerik-opcua"), ("laser", "umd"))]
    name, runs = offer.at.site.site.name, newest_runs(offer.at.store)
    return status(site=name, devices=device_views(open_, lent=False), run=None, result=(), last_runs=runs)


def kept_run(folder: Path) -> str:
    """A run of one linear axis that was measured, proposed for, pushed and measured again; its id."""
    material = axis_material("X1", "mm")
    run = Store(folder).create("hall-3")
    for phase, capture, evaluation in (
        ("before", material.capture_before, material.before),
        ("after", material.capture_after, material.after),
    ):
        run.put(f"capture-X1-{phase}", capture)
        run.put(f"evaluation-X1-{phase}", evaluation)
    run.put("proposal", Proposal(MACHINE, (material.change,), (), "2026-03-02T10:00:00+00:00"))
    run.put("verdict", Verdict((material.verdict,), "better"))
    run.set_state("better")
    return run.run_id


@contextmanager
def staged(
    browser: Browser,
    folder: Path,
    site: SiteFile,
    *,
    size: tuple[int, int] = (1280, 1024),
    language: str = "en",
    look: Look = "light",
    roles: tuple[Any, ...] = ("operator", "approver", "service"),
    shown: StatusView | None = None,
    scale: float = 1.0,
    instead: Mapping[str, Any] | None = None,
    clocked: bool = False,
    offer: Offered | None = None,
) -> Iterator[Stage]:
    """The page at ``folder``'s runs, signed in. ``scale`` 2 is what a browser's zoom of 200 % leaves of a screen.

    With ``clocked`` the browser's time is the test's; pages with one ``offer`` are of one service.
    """
    offer = offer or offered(folder, site)
    now = shown or idle(offer)
    offer.at.shown = lambda: now
    headers = offer.signed_in(*roles)
    client = Client(offer.app, headers=headers)
    viewport: ViewportSize = {"width": round(size[0] / scale), "height": round(size[1] / scale)}
    context = browser.new_context(viewport=viewport, device_scale_factor=scale, locale=language)
    context.set_default_timeout(SOON_MS)
    kept = f"localStorage.setItem('language', '{language}'); localStorage.setItem('look', '{look}');"
    context.add_init_script(f"({STREAM})(); {MODULES}; {kept}")
    page = context.new_page()
    if clocked:
        page.clock.install(time=datetime(2026, 3, 2, 9, 30, tzinfo=UTC))
    stage = Stage(offer, page, now, instead=dict(instead or {}))
    page.on("pageerror", lambda error: stage.errors.append(str(error)))
    with ThreadPoolExecutor(1) as worker:

        def answer(route: Route) -> None:
            asked = route.request
            where = urlsplit(asked.url)
            path = f"{where.path}?{where.query}" if where.query else where.path
            stage.asked.append((asked.method, where.path, asked.post_data or ""))
            told = next((data for end, data in stage.instead.items() if where.path.endswith(end)), None)
            if told is not None:
                route.fulfill(json=told)
                return
            more: dict[str, Any] = {}
            if asked.method != "GET":
                more = {"content": asked.post_data_buffer, "headers": {"content-type": "application/json"}}
            found = worker.submit(client.request, asked.method, path, **more).result()
            kept = {name: value for name, value in found.headers.items() if name not in UNPACKED}
            route.fulfill(status=found.status_code, headers=kept, body=found.content)

        page.route("**/*", answer)
        try:
            page.goto(ORIGIN)
            page.locator("#machine").wait_for()
            yield stage
        finally:
            context.close()
