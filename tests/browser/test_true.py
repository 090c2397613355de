"""What the page shows while something happens is true: by frames of a stream that the test sends."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, expect

from gateway.views import RunView
from tests.browser.person import CHROMIUM
from tests.browser.stage import Stage, kept_run, staged
from tests.unit.web.test_daemon import SITE

pytestmark = [
    pytest.mark.browser,
    pytest.mark.timeout(300),
    pytest.mark.skipif(not CHROMIUM.exists(), reason="NOT RUN: no Chromium here (Debian package chromium)"),
]
# What was asked for when the run began is there: a frame before it would be replaced by it.
EMPTY = "async () => (await import(modulePath('state.js'))).state.taken.length === 0"
RUN = RunView("r-3", "TFMEASX", "X1", 3, 60, "X1: stop 3 of 60", "2026-03-02T09:00:00+00:00")
TABLE = {
    "table": "X1",
    "axis": "X1",
    "id": "ab12cd34",
    "utc": "2026-03-02T10:30:00+00:00",
    "acts": "on",
    "kind": "axis",
}
TABLES = {"serial": "S", "tables": [], "rollback": {"back": [], "stays": []}, "alarms": {}, "held": [], "settled": True}


def reading(**changes: object) -> dict[str, object]:
    told = {"instrument": "laser", "channels": ["displacement_mm"], "last": [141.2345], "signal": 1.0, "sequence": 7}
    return {**told, **changes}


def taken(target: float, deviation: float, approach: int = 1) -> dict[str, object]:
    told = {"axis": "X1", "target": target, "repetition": 1, "approach": approach, "unit": "um", "part": 1}
    return {**told, "deviation": deviation, "expanded": 0.8, "raw": target + 0.141}


def plotted(stage: Stage) -> list[list[float]]:
    """The columns of the chart: places, then values."""
    found: list[list[float]] = stage.page.evaluate("() => document.querySelector('.live .chart').chart.data")
    return found


def test_the_live_deviation_is_the_corrected_one_with_its_uncertainty(browser: Browser, tmp_path: Path) -> None:
    with staged(browser, tmp_path, SITE, instead={"/taken": []}) as stage:
        with stage.page.expect_response("**/taken"):
            stage.change(run=RUN)
        stage.page.wait_for_function(EMPTY)
        stage.tell("reading", reading())
        for target, deviation in ((0.0, 0.0), (50.0, 14.0), (100.0, 25.0)):
            stage.tell("taken", taken(target, deviation))
        expect(stage.page.locator("#reading")).to_have_text("+25.00")
        expect(stage.page.locator("#reading-u")).to_have_text("± 0.80 provisional (k = 2)")
        expect(stage.page.locator("#raw")).to_have_text("laser · instrument, uncorrected: +141.2345 mm")
        expect(stage.page.locator(".targets thead")).to_contain_text("Mean [µm]")
        stage.page.wait_for_function("() => document.querySelector('.live .chart')?.chart.data?.[0].length === 3")
        assert max(value for column in plotted(stage)[1:] for value in column if value is not None) == 25.8
        stage.page.locator(".live select.fit").select_option("without_ends")
        stage.page.wait_for_function("() => Math.abs(document.querySelector('.live .chart').chart.data.at(-1)[1]) < 2")
        *_, points = plotted(stage)
        assert points == pytest.approx([0.0, 1.5, 0.0]), "by hand: 14 - 25 / 2"
        stage.tell("taken", taken(150.0, 60.0))
        seen = (
            "() => { const { plot } = document.querySelector('.live .chart').chart; return plot.scales.x.max >= 150; }"
        )
        stage.page.wait_for_function("() => document.querySelector('.live .chart').chart.data[0].length === 4")
        assert stage.page.evaluate(seen), "what comes is in view, unless somebody has zoomed"
        stage.page.locator(".live select.fit").select_option("none")
        stage.page.wait_for_function("() => document.querySelector('.live .chart').chart.plot.scales.y.max >= 60")
        assert stage.page.locator("#tolerance").count() == 0, "no band that nobody asked for"
        assert stage.errors == []


def test_a_stream_that_falls_silent_veils_every_screen(browser: Browser, tmp_path: Path) -> None:
    with staged(browser, tmp_path, SITE, clocked=True) as stage:
        stage.change(run=RUN)
        html = stage.page.locator("html")
        for screen in ("connect", "capture", "evaluate", "model", "correct", "push", "report"):
            stage.go(screen)
            stage.tell("beat", {})
            stage.page.clock.run_for(9_000)
            expect(html).not_to_have_class(re.compile("stale"))
            stage.page.clock.run_for(3_000)
            expect(html).to_have_class(re.compile("stale"))
            expect(stage.page.locator("#now")).to_contain_text("No word from the service for")
            stage.tell("beat", {})
            stage.page.clock.run_for(1_000)
            expect(html).not_to_have_class(re.compile("stale"))


def test_no_alarm_is_red_while_optics_are_changed_and_none_after_a_wait(browser: Browser, tmp_path: Path) -> None:
    with staged(browser, tmp_path, SITE, clocked=True) as stage:
        now, beam = stage.page.locator("#now"), stage.page.locator(".beam")
        stage.change(run=RUN)
        stage.tell("reading", reading(signal=0.0))
        stage.page.clock.run_for(1_000)
        expect(now).not_to_have_class(re.compile("bad"))
        expect(beam).to_have_text("○ No light; nothing is read now")
        wait = {"instrument": "laser", "missing": "moving", "done_s": 1.0, "needed_s": 20.0}
        stage.tell("waiting", wait)
        stage.tell("reading", reading(signal=0.0))
        stage.page.clock.run_for(1_000)
        expect(now).to_have_class(re.compile("bad"))
        expect(now).to_contain_text("The beam is lost")
        stage.tell("reading", reading())
        for _second in range(24):
            stage.tell("waiting", wait)
            stage.page.clock.run_for(1_000)
        expect(now).to_contain_text("Working"), "a wait of 20 s is not stuck after 24"
        for _second in range(6):
            stage.tell("waiting", wait)
            stage.page.clock.run_for(1_000)
        expect(now).to_contain_text("No reading comes")
        stage.page.clock.run_for(4_000)
        stage.tell("beat", {})
        expect(now).to_contain_text("Working"), "what is told no more is over"
        stage.tell("waiting", wait)
        stage.tell("taken", taken(0.0, 0.0))
        stage.page.clock.run_for(8_000)
        expect(now).to_contain_text("Working")


def test_what_an_instrument_cannot_see_is_grey_and_says_so(browser: Browser, tmp_path: Path) -> None:
    with staged(browser, tmp_path, SITE) as stage:
        stage.tell("reading", reading())
        expect(stage.page.locator(".beam")).to_have_text("○ Beam cannot be observed")
        expect(stage.page.locator(".beam")).to_have_class(re.compile("unknown"))
        expect(stage.page.locator("meter")).to_be_hidden()


def test_the_remaining_time_is_the_services_and_runs_down(browser: Browser, tmp_path: Path) -> None:
    run = RunView(**{**{one: getattr(RUN, one) for one in RUN.__slots__}, "left_s": 3600, "program_left_s": 600})
    with staged(browser, tmp_path, SITE, clocked=True) as stage:
        stage.change(run=run)
        stage.page.clock.run_for(1_000)
        expect(stage.page.locator(".togo")).to_contain_text("In all: about 59:59")
        stage.page.clock.run_for(59_000)
        expect(stage.page.locator(".togo")).to_contain_text("about 9:00")


def test_the_air_is_there_after_a_reload(browser: Browser, tmp_path: Path) -> None:
    air = {"utc": "2026-03-02T09:29:50+00:00", "air_degc": 21.3, "pressure_hpa": 1002.0, "humidity_pct": 44.0}
    with staged(browser, tmp_path, SITE) as stage:
        stage.change(ambient={**air, "material_degc": [20.6], "age_s": 0.0})
        stage.page.reload()
        expect(stage.page.locator(".air")).to_contain_text("21.30 °C")
        expect(stage.page.locator(".air")).to_contain_text("20.60")


def test_two_pages_say_writing_while_a_push_is_at_work_and_what_is_on_after(browser: Browser, tmp_path: Path) -> None:
    push = RunView("r-3", "", "X1", 0, 0, "", "2026-03-02T09:00:00+00:00", kind="push")
    with staged(browser, tmp_path, SITE) as one, staged(browser, tmp_path, SITE, offer=one.offer) as two:
        for stage in (one, two):
            stage.change(run=push)
            for state in ("begun", "writing", "written", "on"):
                stage.say("P-TABLE-STATE", axis="X1", state=state, said="")
                expect(stage.page.locator("#writing")).to_contain_text("X1")
            stage.instead["/tables"] = {**TABLES, "tables": [TABLE]}
            stage.say("P-TABLE-STATE", axis="X1", state="new", said="")
            expect(stage.page.locator("#writing")).to_have_count(0)
            expect(stage.page.locator(".chip.tables")).to_contain_text("X1 ab12")
            assert stage.now.run is not None, "the command is still at work"


def _job(run: str, **changes: Any) -> dict[str, Any]:
    told = {"job": 1, "kind": "push", "who": "anna", "state": "ended", "run_id": run, "lines": [], "error": None}
    return {**told, "started_utc": "2026-03-02T10:10:00+00:00", "ended_utc": "", "data": {}, "steps": [], **changes}


def test_the_steps_of_a_push_come_one_after_the_other_for_one_person(browser: Browser, tmp_path: Path) -> None:
    run = kept_run(tmp_path)
    alone = SITE.model_copy(update={"site": SITE.site.model_copy(update={"approvals": 1})})
    with staged(browser, tmp_path, alone, instead={"/tables": TABLES, "/jobs": []}) as stage:
        page = stage.page
        stage.go("push")
        expect(page.locator("#show-plan")).to_be_enabled()
        expect(page.locator("#write")).to_be_disabled()
        assert page.locator("#approve").count() == 0, "where one person consents nobody approves"
        stage.instead["/jobs"] = [_job(run, ended_utc="2026-03-02T10:11:00+00:00")]
        stage.tell("ended", {"job": 1})
        expect(page.locator("#write")).to_be_enabled()
        page.locator("#write").click()
        page.locator("#typed-machine").fill("another")
        expect(page.locator("#yes")).to_be_disabled()
        expect(page.locator("#typed-other")).to_contain_text("hall-3")
        assert [one for one in stage.asked if one[0] == "POST"] == [], "a wrong name begins nothing"
        page.locator("#typed-machine").fill("hall-3")
        expect(page.locator("#yes")).to_be_enabled()
        page.keyboard.press("Escape")
        stage.instead["/tables"] = {**TABLES, "tables": [TABLE]}
        stage.tell("ended", {"job": 1})
        expect(page.locator("#acts-now")).to_contain_text("This acts now")
        assert page.locator("#write").count() == 0, "no invitation to push what acts"


def test_two_persons_consent_before_the_write(browser: Browser, tmp_path: Path) -> None:
    run = kept_run(tmp_path)
    both = SITE.model_copy(update={"site": SITE.site.model_copy(update={"approvals": 2})})
    jobs = [_job(run, ended_utc="2026-03-02T10:11:00+00:00")]
    with staged(browser, tmp_path, both, instead={"/tables": TABLES, "/jobs": jobs}) as stage:
        stage.go("push")
        expect(stage.page.locator("#approve")).to_be_enabled()
        expect(stage.page.locator("#write")).to_be_disabled()


def test_an_axis_has_one_verdict_and_the_rest_are_its_reasons(browser: Browser, tmp_path: Path) -> None:
    kept_run(tmp_path)
    with staged(browser, tmp_path, SITE) as stage:
        stage.go("report")
        expect(stage.page.locator("#outcome")).to_have_count(1)
        expect(stage.page.locator("#outcome")).to_contain_text("X1: Better")
        expect(stage.page.locator(".verdict-words li")).to_have_count(1)


def test_a_look_that_asks_for_a_second_person_brings_the_key_where_the_site_leaves_it_to_the_finding(
    browser: Browser, tmp_path: Path
) -> None:
    run = kept_run(tmp_path)
    left = SITE.model_copy(update={"site": SITE.site.model_copy(update={"approvals": None})})
    fields = {"table": "C1", "needed": 2, "have": 1, "why": "the table is steep"}
    missing = {"code": "E-INT-APPROVAL-MISSING", "fields": fields}
    told = {"code": "P-PUSH-REFUSED", "fields": {"axis": "C1", "reason": missing}}
    job = _job(run, ended_utc="2026-03-02T10:11:00+00:00")
    with staged(browser, tmp_path, left, instead={"/tables": TABLES, "/jobs": [job]}) as stage:
        stage.go("push")
        expect(stage.page.locator("#write")).to_be_enabled()
        assert stage.page.locator("#approve").count() == 0
        stage.instead["/jobs"] = [{**job, "lines": [told]}]
        stage.tell("ended", {"job": 1})
        expect(stage.page.locator("#approve")).to_be_enabled()
        expect(stage.page.locator("#write")).to_be_disabled()
