"""What the page costs a browser: nothing twice, and little while nothing happens; by processor time, not the wall's."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Browser

from tests.browser import delivered
from tests.browser.person import CHROMIUM
from tests.unit.web.test_daemon import SITE

pytestmark = [
    pytest.mark.browser,
    pytest.mark.timeout(600),
    pytest.mark.skipif(not CHROMIUM.exists(), reason="NOT RUN: no Chromium here (Debian package chromium)"),
]


def test_a_reload_fetches_no_file_again_and_a_screen_at_rest_rests(browser: Browser, tmp_path: Path) -> None:
    with delivered.served(tmp_path, SITE) as at:
        page = delivered.entered(browser, at, "anna").new_page()
        first = delivered.visited(page, lambda: page.goto(f"{at.url}/#capture"))
        again = delivered.visited(page, page.reload)
        assert first.kilobytes < 300.0, "with the catalogue of all messages, which comes behind the first picture"
        assert (again.kilobytes < 20.0, again.requests < 20) == (True, True), again
        assert again.cpu_s < 0.4 * MORE, again
        assert delivered.at_rest_s(page, 5.0) < 2.0 * MORE
        page.context.close()


MORE = 2.0
"""Processor time itself grows on a busy computer: caches are shared."""
