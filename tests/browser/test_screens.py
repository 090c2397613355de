"""Every screen in each language and both sizes, after a measured axis: nothing cut, nothing serious for axe."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from drivers.languages import LANGUAGES
from tests.browser.hall import hall
from tests.browser.person import CHROMIUM, LARGE, SCREENS, SMALL, Person, chromium, opened
from tests.browser.test_day import site

pytestmark = [
    pytest.mark.browser,
    pytest.mark.timeout(1500),
    pytest.mark.skipif(not CHROMIUM.exists(), reason="NOT RUN: no Chromium here (Debian package chromium)"),
]
LOOKS = list(itertools.product(LANGUAGES, (SMALL, LARGE)))


def test_every_screen_in_every_language_and_size(tmp_path: Path) -> None:
    faults: list[str] = []
    with hall(tmp_path, site, speed=150.0, tested=True) as at, chromium() as browser:
        first = Person(opened(browser, at), at, "anna")
        first.first()
        first.go("capture")
        assert first.done(first.give("#measure-axes"))["error"] is None
        first.go("push")
        assert first.done(first.give("#show-plan"))["error"] is None
        first.go("connect")
        first.done(first.give("#doctor"))
        for language, size in LOOKS:
            anna = Person(opened(browser, at, size, language), at, "anna")
            anna.sign_in()
            anna.page.locator("#machine").wait_for()
            for screen in SCREENS:
                anna.go(screen)
                anna.page.locator("main .panel h2, main .panel tr, main .empty").first.wait_for()
                anna.keep(f"{screen}-{language}-{size[0]}")
                faults += [f"{screen} {language} {size[0]}: {one}" for one in (*anna.heard(), *anna.cut())]
            anna.page.context.close()
    assert faults == [], "\n".join(faults)
