"""What the page costs in a browser: its first visit, a reload, a minute at rest, and how soon a reading is painted.

The service is a thread of this process with the true routes and the true stream; browsers reach it by HTTP, so that
their caches work. Processor time is that of all processes of the browser, from /proc: what else this computer does
slows it, and adds little to it.
"""

from __future__ import annotations

import asyncio
import os
import statistics
import threading
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import uvicorn
from playwright.sync_api import Browser, BrowserContext, Page

from drivers.clock import LoopClock
from drivers.message import Message
from drivers.types.sensing import SampleBlock
from gateway.config import SiteFile
from gateway.daemon.stream import Hub, LiveObserver
from gateway.users import UserRole
from gateway.views import RunView, as_data
from gateway.web.doors import COOKIE
from tests.browser.stage import idle
from tests.unit.web.services import FakeSite, Offered, offered

RATE_HZ, BLOCK = 50_000, 500
ROLES: tuple[UserRole, ...] = ("operator", "approver", "service")
RUN = RunView("r-3", "TFMEASX", "X1", 3, 60, Message.stored("X1: stop 3 of 60"), "2026-03-02T09:00:00+00:00")
TICK = os.sysconf("SC_CLK_TCK")


@dataclass
class Streaming(FakeSite):
    """A site with a true stream, and an instrument of 50 kHz that a test switches on."""

    hub: Hub | None = None
    sampling: bool = False

    def stream(self, who: str = "", *, operates: bool = True) -> AsyncIterator[str]:
        assert self.hub is not None
        return self.hub.stream(self.hub.join(who, operates=operates))

    def taken(self) -> tuple[Mapping[str, object], ...]:
        return ()

    async def work(self) -> None:
        """Blocks of samples as they come, each with the moment of its last one."""
        clock = LoopClock()
        self.hub = Hub(clock, lambda: as_data(self.picture()))
        looking = LiveObserver(self.hub.tell, clock)
        began, sent = clock.utc().timestamp(), 0
        while True:
            await clock.sleep(BLOCK / RATE_HZ)
            due = int((clock.utc().timestamp() - began) * RATE_HZ) - sent
            if not self.sampling or due < 1:
                sent += max(due, 0)
                continue
            times = began + (sent + np.arange(due)) / RATE_HZ
            values = 0.001 * np.sin(times)[:, None]
            looking.samples("laser", SampleBlock(("displacement_mm",), times, values, np.ones(due, np.bool_)))
            sent += due


@dataclass
class Served:
    """The service while it is there."""

    offer: Offered
    at: Streaming
    url: str
    loop: asyncio.AbstractEventLoop
    people: list[dict[str, str]] = field(default_factory=list)

    def session(self, name: str) -> dict[str, Any]:
        """The cookie of somebody who has signed in."""
        key = self.offer.signed_in(*ROLES, name=name)["cookie"].partition("=")[2]
        return {"name": COOKIE, "value": key, "url": self.url}

    def change(self, **changes: object) -> None:
        """Another picture, and every page is told."""
        now = replace(self.at.shown(), **changes)  # type: ignore[arg-type]
        self.at.shown = lambda: now
        assert self.at.hub is not None
        self.loop.call_soon_threadsafe(self.at.hub.tell, "state", as_data(now))


@contextmanager
def served(folder: Path, site: SiteFile) -> Iterator[Served]:
    """The service in a thread of its own, until the block ends."""
    offer = offered(folder, site)
    at = Streaming(site, folder / "site.toml", offer.at.store)
    picture = idle(offer)
    at.shown = lambda: picture
    offer.service.sites[site.site.name] = at  # type: ignore[index]
    config = uvicorn.Config(offer.app, host="127.0.0.1", port=0, log_level="error", timeout_graceful_shutdown=1)
    server = uvicorn.Server(config)
    found: dict[str, Any] = {}

    async def run() -> None:
        found["loop"] = asyncio.get_running_loop()
        working = asyncio.create_task(at.work())
        try:
            await server.serve()
        finally:
            working.cancel()

    thread = threading.Thread(target=lambda: asyncio.run(run()), daemon=True)
    thread.start()
    while not server.started:
        thread.join(0.05)
        assert thread.is_alive(), "the service did not begin"
    port = server.servers[0].sockets[0].getsockname()[1]
    try:
        yield Served(offer, at, f"http://127.0.0.1:{port}", found["loop"])
    finally:
        if at.hub is not None:
            found["loop"].call_soon_threadsafe(at.hub.end)
        server.should_exit = True
        thread.join(20.0)


def entered(browser: Browser, at: Served, name: str, script: str = "") -> BrowserContext:
    """A browser of its own in which somebody has signed in."""
    context = browser.new_context(viewport={"width": 1280, "height": 1024})
    context.set_default_timeout(90_000)
    context.add_cookies([at.session(name)])  # type: ignore[list-item]
    if script:
        context.add_init_script(script)
    return context


@dataclass
class Visit:
    """What one visit took: requests that reached the service, bytes that came, and processor time of the page, s."""

    requests: int
    kilobytes: float
    cpu_s: float


def visited(page: Page, act: Any) -> Visit:
    """``act`` opens or reloads the page; counted until its first chart or screen stands and the net is quiet."""
    sent: dict[str, float] = {}
    cached: set[str] = set()
    session = page.context.new_cdp_session(page)
    session.send("Network.enable")
    session.send("Performance.enable", {"timeDomain": "threadTicks"})
    session.on("Network.requestWillBeSent", lambda told: _received({**told, "encodedDataLength": 0.0}, sent))
    session.on("Network.requestServedFromCache", lambda told: cached.add(told["requestId"]))
    session.on("Network.responseReceived", lambda told: _from_disk(told, cached))
    session.on("Network.loadingFinished", lambda told: _received(told, sent))
    before = _task_s(session)
    act()
    page.locator("main.capture .chart canvas").wait_for()
    page.wait_for_function("() => document.documentElement.dataset.words === 'all'")
    page.wait_for_timeout(500)
    after = _task_s(session)
    session.detach()
    own = {one: size for one, size in sent.items() if one not in cached}
    # A page that is opened anew counts from zero.
    return Visit(len(own), sum(own.values()) / 1000.0, after - before if after >= before else after)


def _received(told: Mapping[str, Any], sent: dict[str, float]) -> None:
    sent[told["requestId"]] = float(told["encodedDataLength"])


def _from_disk(told: Mapping[str, Any], cached: set[str]) -> None:
    if told["response"].get("fromDiskCache"):
        cached.add(told["requestId"])


def _task_s(session: Any) -> float:
    """Processor time of the page's main thread so far."""
    metrics = {one["name"]: one["value"] for one in session.send("Performance.getMetrics")["metrics"]}
    return float(metrics["TaskDuration"])


def browser_cpu_s() -> float:
    """Processor time so far of every process that this one's children began: the browser, all of it."""
    parents: dict[int, int] = {}
    ticks: dict[int, int] = {}
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            rest = (entry / "stat").read_text("ascii", "replace").rpartition(")")[2].split()
        except OSError:
            continue
        parents[int(entry.name)] = int(rest[1])
        ticks[int(entry.name)] = int(rest[11]) + int(rest[12])
    ours = {os.getpid()}
    while more := {pid for pid, parent in parents.items() if parent in ours} - ours:
        ours |= more
    return sum(ticks[pid] for pid in ours - {os.getpid()}) / TICK


def at_rest_s(page: Page, seconds: float) -> float:
    """Processor time of the browser in a minute of a screen where nothing happens but what the service tells."""
    page.wait_for_timeout(3000)
    before, begun = browser_cpu_s(), page.evaluate("() => performance.now()")
    page.wait_for_timeout(1000.0 * seconds)
    passed = page.evaluate("() => performance.now()") - begun
    return (browser_cpu_s() - before) * 60_000.0 / float(passed)


# The instrument's own moment of each reading, and when its number was painted: a frame after it was set.
WATCH = """() => {
  window.seen = { stamp: {}, heard: {}, shown: {} };
  const listen = EventSource.prototype.addEventListener;
  EventSource.prototype.addEventListener = function (kind, take) {
    if (kind === 'reading') listen.call(this, kind, (event) => {
      const data = JSON.parse(event.data);
      window.seen.stamp[data.sequence] = 1000 * data.end_s;
      window.seen.heard[data.sequence] = Date.now();
    });
    listen.call(this, kind, take);
  };
  new MutationObserver(() => {
    const number = document.querySelector('#sequence')?.textContent.slice(1);
    if (!number || number in window.seen.shown) return;
    requestAnimationFrame(() => requestAnimationFrame(() => { window.seen.shown[number] ??= Date.now(); }));
  }).observe(document, { subtree: true, childList: true, characterData: true });
}"""


def latencies(browser: Browser, at: Served, pages: int, seconds: float) -> dict[str, tuple[float, float]]:
    """p50 and p95 in ms from the stamp of a reading to when a page heard it, and to its number on the screen."""
    contexts = [entered(browser, at, f"person{n // 3}", f"({WATCH})()") for n in range(pages)]
    opened = [context.new_page() for context in contexts]
    for page in opened:
        page.goto(f"{at.url}/#capture")
        page.locator("main.capture").wait_for()
    at.change(run=RUN)
    at.at.sampling = True
    opened[0].wait_for_timeout(2000)
    for page in opened:
        page.evaluate("() => { window.seen = { stamp: {}, heard: {}, shown: {} }; }")
    opened[0].wait_for_timeout(1000.0 * seconds)
    seen = [page.evaluate("() => window.seen") for page in opened]
    at.at.sampling = False
    for context in contexts:
        context.close()
    found = {}
    for what in ("heard", "shown"):
        times = [moment - one["stamp"][n] for one in seen for n, moment in one[what].items() if n in one["stamp"]]
        cuts = statistics.quantiles(times, n=20)
        found[what] = (cuts[9], cuts[18])
    return found
