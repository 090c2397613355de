"""The tab of the wheel in Chromium: bars and order equal the record, old and new profile, files, three languages."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from drivers.languages import LANGUAGES
from tests.browser.person import CHROMIUM, LAYOUT, PICTURES
from tests.browser.stage import staged
from tests.unit.components.site import site_of
from tests.unit.web.test_wheel_tab import HELD, ORDER, WORK, run_of, separated

pytestmark = [
    pytest.mark.browser,
    pytest.mark.timeout(600),
    pytest.mark.skipif(not CHROMIUM.exists(), reason="NOT RUN: no Chromium here (Debian package chromium)"),
]


def test_the_wheel_is_shown_with_its_causes_its_profile_and_its_points(browser: Browser, tmp_path: Path) -> None:
    run_of(tmp_path)
    site, found = site_of([], work={**WORK, "dresser_file": "dresser.toml"}), separated()
    for language in LANGUAGES:
        with staged(browser, tmp_path, site, language=language) as stage:
            page = stage.page
            stage.go("correct")
            expect(page.locator("#wheel")).to_have_attribute("aria-pressed", "true")
            page.wait_for_function("() => document.querySelector('.chart')?.chart.plot?.status === 1")
            shown = page.locator("tr[data-share]").all()
            assert [one.get_attribute("data-share") for one in shown] == [one.name for one in found.shares]
            number = f"{found.share('clamping').rms_um:.2f}".replace(".", "," if language == "de" else ".")
            expect(page.locator("tr[data-share=clamping] td").first).to_have_text(number)
            expect(page.locator("#corrections tr")).to_have_count(len(ORDER.steps))
            expect(page.locator("#wheel-verdict")).to_contain_text(f"{HELD.after_um:.2f}"[-2:])
            # Old and new profile, each with its band: by hand the new one is smaller everywhere.
            old, new = page.evaluate(
                "() => { const now = document.querySelector('.chart').chart; const lines = now.what.curves"
                ".filter((one) => one.kind !== 'band'); return lines.map((one) => Math.max(...one.y.map(Math.abs))); }"
            )
            assert new < 0.1 * old
            link = page.locator("#points-csv")
            assert link.get_attribute("download") == "wheel-p1.csv"
            text = page.evaluate("async (href) => (await fetch(href)).text()", link.get_attribute("href"))
            assert text.startswith("theta_deg,radius_mm,axial_mm")
            assert page.evaluate(LAYOUT) == []
            PICTURES.mkdir(parents=True, exist_ok=True)
            page.screenshot(path=PICTURES / f"wheel-{language}.png")
            assert stage.errors == []
