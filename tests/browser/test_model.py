"""The screen of the error model in Chromium: the record's numbers, and a flank that answers a slider at once."""

from __future__ import annotations

import itertools
import os
from dataclasses import replace
from pathlib import Path

import pytest
from playwright.sync_api import expect

from drivers.languages import LANGUAGES
from gateway.model.error_model import ErrorModel, UnmeasuredError
from gateway.report.tooth.errors import error_rows
from simulators.cell.site import section
from tests.browser.hall import Hall, hall
from tests.browser.person import CHROMIUM, IDLE, LARGE, PICTURES, SMALL, Person, chromium, opened
from tests.browser.records import text
from tests.unit.report import closing

pytestmark = [
    pytest.mark.browser,
    pytest.mark.timeout(1800),
    pytest.mark.skipif(not CHROMIUM.exists(), reason="NOT RUN: no Chromium here (Debian package chromium)"),
]
AT_ONCE_MS = 200.0
TRIES = 12
# From the touch of a slider to the new figure on the screen; the next frame has been drawn by then.
MOVED = """([name, value]) => new Promise((done) => {
  const [slider, figure] = [document.querySelector(`[data-try=${name}]`), document.querySelector('#flank-rms')];
  const begun = performance.now();
  new MutationObserver((_all, watch) => {
    watch.disconnect();
    requestAnimationFrame(() => setTimeout(() => done(performance.now() - begun)));
  }).observe(figure, { childList: true, characterData: true, subtree: true });
  slider.value = value;
  slider.dispatchEvent(new Event('input', { bubbles: true }));
})"""


def ground(site: str) -> str:
    """The cell's site with its gear as the work."""
    return "\n".join((site, section("work", {"gear": "site.gear.toml", "height_mm": 5.0})))


def errors() -> ErrorModel:
    """Most is measured; of two errors only one matters to the tooth."""
    known = closing.errors()
    kept = tuple(one for one in known.motions if one.name != "EYC")
    return replace(known, motions=kept, unknown=(*known.unknown, UnmeasuredError("EYC", 4.0, "um")))


def measured(at: Hall) -> None:
    """A run that holds an error model."""
    run = at.store.create("demo-grinder")
    run.put("errors", errors())
    run.set_state("measured")


def test_the_model_is_the_records_and_the_flank_follows_a_slider(tmp_path: Path) -> None:
    faults: list[str] = []
    with hall(tmp_path, ground, speed=IDLE) as at, chromium() as browser:
        measured(at)
        anna = Person(opened(browser, at), at, "anna")
        anna.first()
        anna.go("model")
        _equal_the_record(anna)
        _answers_at_once(anna)
        for language, size in itertools.product(LANGUAGES, (SMALL, LARGE)):
            other = Person(opened(browser, at, size, language), at, "anna")
            other.sign_in()
            other.page.locator("#machine").wait_for()
            other.go("model")
            expect(other.page.locator("#flank-rms")).not_to_be_empty()
            other.keep(f"model-{language}-{size[0]}")
            faults += [f"model {language} {size[0]}: {one}" for one in (*other.heard(), *other.cut())]
            other.page.context.close()
    assert faults == [], "\n".join(faults)


def _equal_the_record(anna: Person) -> None:
    rows = error_rows(errors())
    anna.page.locator("[data-low]").first.wait_for()
    shown = {str(one.get_attribute("data-low")): one.text_content() for one in anna.page.locator("[data-low]").all()}
    wanted = {one.name: text(one.low) if one.low == one.high else f"{text(one.low)} … {text(one.high)}" for one in rows}
    assert shown == wanted
    told = anna.page.request.get(
        f"{anna.at.url.rstrip('/')}/api/v1/sites/{anna.site}/runs/{anna.at.store.runs()[-1].run_id}/model"
    ).json()
    for rank in told["tooth"]["ranking"]:
        assert anna.page.locator(f"[data-effect={rank['error']}]").text_content() == text(rank["mu_star_um"])
    assert anna.page.locator("[data-next]").all_text_contents() == ["EYC"]


def _answers_at_once(anna: Person) -> None:
    """What page and service work for one move of a slider, whatever else this computer does meanwhile: CPU time."""
    figure = anna.page.locator("#flank-rms")
    expect(figure).not_to_be_empty()
    before = figure.text_content()
    worked = _worked_ms(anna)
    took = [anna.page.evaluate(MOVED, ["EXC", 0.1 * (1 + n)]) for n in range(TRIES)]
    moved = _worked_ms(anna)
    # What both work all the time, for the stream of nine instruments, is no work of the slider.
    anna.page.wait_for_timeout(sum(took))
    each = (moved - worked - (_worked_ms(anna) - moved)) / TRIES
    said = f"one move: {each:.0f} ms of work, {min(took):.0f} to {max(took):.0f} ms by the clock"
    PICTURES.mkdir(parents=True, exist_ok=True)
    (PICTURES / "model.txt").write_text(said + "\n", encoding="utf-8")
    assert each < AT_ONCE_MS, said
    anna.page.locator("#as-measured").click()
    expect(figure).to_have_text(str(before))


def _worked_ms(anna: Person) -> float:
    """CPU time of the page's process and of the service so far; ms."""
    assert anna.at.service is not None
    fields = Path(f"/proc/{anna.at.service.pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    ticks = int(fields[11]) + int(fields[12])
    session = anna.page.context.new_cdp_session(anna.page)
    session.send("Performance.enable")
    metrics = {one["name"]: one["value"] for one in session.send("Performance.getMetrics")["metrics"]}
    session.detach()
    return 1000.0 * (ticks / os.sysconf("SC_CLK_TCK") + metrics["ProcessTime"])
