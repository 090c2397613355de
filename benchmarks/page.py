"""The operator's page in Chromium: a first visit, a reload, a minute at rest, and a reading's way to eight screens.

The service is a thread of the benchmark with the true routes and the true stream, beside an instrument of 50 kHz. Bytes
and requests are what reached the service; processor time is counted, not the wall's: of the page's own thread for a
reload, of every process of the browser for the minute. The latency is wall time, and a busy computer adds to it.
"""

from __future__ import annotations

import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

from benchmarks.report import Report, main
from gateway.web import assets

FIRST_KB, RELOAD_S, REST_S, SOON_MS = 150.0, 0.4, 2.0, 200.0
CHART = ("uPlot.iife.min.js", "uPlot.min.css")


def packed_kb() -> float:
    """What a first visit is sent of page, styles, modules, chart and words, compressed, kB."""
    page = Path(assets.__file__).with_name("page")
    names = [*assets.first_modules(), *(one.name for one in page.glob("*.css"))]
    files = [("page", name) for name in names] + [("vendor", name) for name in CHART] + [("words", "en.json")]
    found = [assets.asset(*one) for one in files]
    return sum(len(one.packed) for one in found if one is not None) / 1000.0


def measure(report: Report) -> None:
    """All figures of this file."""
    report.at_most("page, styles, modules, chart and words, compressed", packed_kb(), FIRST_KB, "kB")
    known = find_spec("playwright") is not None and find_spec("axe_playwright_python") is not None
    if report.smoke or not known:
        report.leave_out("the page in Chromium", "small form" if report.smoke else "no playwright here")
        return
    from tests.browser import delivered  # noqa: PLC0415 - a browser's own library
    from tests.browser.person import CHROMIUM, chromium  # noqa: PLC0415
    from tests.unit.web.test_daemon import SITE  # noqa: PLC0415

    if not CHROMIUM.exists():
        report.leave_out("the page in Chromium", "no Chromium here")
        return
    with tempfile.TemporaryDirectory() as folder, delivered.served(Path(folder), SITE) as at, chromium() as browser:
        page = delivered.entered(browser, at, "anna").new_page()
        first = delivered.visited(page, lambda: page.goto(f"{at.url}/#capture"))
        report.say("first visit: requests", first.requests)
        report.at_most("first visit: bytes on the wire, catalogue of messages included", first.kilobytes, 300.0, "kB")
        again = [delivered.visited(page, page.reload) for _time in range(3)]
        least = min(again, key=lambda one: one.cpu_s)
        report.say("reload: requests that reach the service", least.requests)
        report.say("reload: bytes on the wire", least.kilobytes, "kB")
        report.at_most("reload: processor time of the page", least.cpu_s, RELOAD_S, "s")
        report.at_most("Measure at rest: processor a minute, browser", delivered.at_rest_s(page, 20.0), REST_S, "s")
        at.at.sampling = True
        report.say(
            "Measure at rest, instrument of 50 kHz told ten times a second: processor a minute",
            delivered.at_rest_s(page, 20.0),
            "s",
        )
        at.at.sampling = False
        page.context.close()
        for count in (1, 8):
            found = delivered.latencies(browser, at, count, 15.0)
            for what, name in (("heard", "heard by the page"), ("shown", "painted")):
                p50, p95 = found[what]
                report.say(f"{count} pages: stamp to {name}, p50", p50, "ms")
                if what == "shown":
                    report.at_most(f"{count} pages: stamp to {name}, p95", p95, SOON_MS, "ms")
                else:
                    report.say(f"{count} pages: stamp to {name}, p95", p95, "ms")


if __name__ == "__main__":
    sys.exit(main(measure, __doc__))
