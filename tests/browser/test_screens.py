"""Every screen in each language and both sizes, after a measured axis: nothing cut, nothing serious for axe."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import pytest

from drivers.languages import LANGUAGES
from tests.browser.hall import Hall, hall
from tests.browser.person import CHROMIUM, IDLE, LARGE, REFUSED, SCREENS, SMALL, Person, chromium, opened
from tests.browser.records import figures_of, newest
from tests.browser.test_day import looked_at, site

pytestmark = [
    pytest.mark.browser,
    pytest.mark.timeout(3000),
    pytest.mark.skipif(not CHROMIUM.exists(), reason="NOT RUN: no Chromium here (Debian package chromium)"),
]
# A panel that this width does not show stays empty.
FILLED = """() => [...document.querySelectorAll('main .panel:not(.choose)')]
  .filter((one) => one.offsetParent).every((one) => one.childNodes.length)"""
LOOKS = list(itertools.product(LANGUAGES, (SMALL, LARGE)))


def alone(text: str) -> str:
    """One person consents, over a connection that is not protected."""
    cut = site(text).replace("approvals = 2", "approvals = 1")
    return cut.replace('security = "best"', 'security = "None"')


def _risk_is_typed(anna: Person) -> None:
    """What is typed goes along; the answer is this test's, so that nothing is written."""
    anna.sees(".chip.unprotected", re.compile(r"\S"))
    page = anna.page
    page.locator("#write").click()
    page.locator("#typed-risk").fill("unprotected")
    page.locator("#typed-machine").fill(anna.site)
    anna.keep("push-risk")
    page.route("**/commands/push", lambda route: route.fulfill(status=409, json=REFUSED))
    with page.expect_request(lambda one: one.url.endswith("/commands/push")) as sent:
        page.locator("#yes").click()
    assert '"risk":"unprotected"' in (sent.value.post_data or "")
    page.locator("dialog .keys button").first.click()
    page.unroute("**/commands/push")


def _trend_is_the_records(anna: Person, at: Hall) -> None:
    page = anna.page
    page.locator("#trends").click()
    anna.sees("table.due", "YK7350B-0042")
    anna.sees("#trend-newest", figures_of(newest(at, "proposal"), "C1", "before")["E"])
    looked_at(anna, "trends")
    page.locator("#yes").click()


def test_every_screen_in_every_language_and_size(tmp_path: Path) -> None:
    faults: list[str] = []
    with hall(tmp_path, alone, speed=150.0, idle=IDLE, tested=True) as at, chromium() as browser:
        first = Person(opened(browser, at), at, "anna")
        first.first()
        first.go("capture")
        assert first.done(first.give("#measure-axes"))["error"] is None
        first.go("push")
        assert first.done(first.give("#show-plan"))["error"] is None
        _risk_is_typed(first)
        first.go("connect")
        first.done(first.give("#doctor"))
        first.go("report")
        _trend_is_the_records(first, at)
        for language, size in LOOKS:
            anna = Person(opened(browser, at, size, language), at, "anna")
            anna.sign_in()
            anna.page.locator("#machine").wait_for()
            for screen in SCREENS:
                anna.go(screen)
                anna.page.locator("main .panel h2, main .panel tr, main .empty").first.wait_for()
                anna.page.wait_for_function(FILLED)
                anna.keep(f"{screen}-{language}-{size[0]}")
                faults += [f"{screen} {language} {size[0]}: {one}" for one in (*anna.heard(), *anna.cut())]
            anna.page.context.close()
    assert faults == [], "\n".join(faults)
