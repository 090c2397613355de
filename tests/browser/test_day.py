"""A whole day at the page in a real browser, on a shipped cell over real wires; run by `make browser`.

From the first sign-in to the report, with what goes wrong on such a day: wrong optics, a broken beam, a refused
approval, a service that dies in the middle of a push. Numbers on the screen are compared with the record on the disk.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.browser.hall import Hall, hall
from tests.browser.person import CHROMIUM, IDLE, PIN, SECRET, Person, chromium, opened
from tests.browser.records import figures_of, newest, proposal_of
from tests.cell.bench import short

pytestmark = [
    pytest.mark.browser,
    pytest.mark.timeout(3000),
    pytest.mark.skipif(not CHROMIUM.exists(), reason="NOT RUN: no Chromium here (Debian package chromium)"),
]
SOMETHING = re.compile(r"\S")


def site(text: str) -> str:
    """C alone, few targets; two people consent."""
    return short(("C1",), 7, 3)(text).replace("approvals = 1", "approvals = 2")


def looked_at(person: Person, name: str) -> None:
    """A picture is kept; axe finds nothing serious, and nothing is cut or too small for gloves."""
    person.keep(name)
    assert person.heard() == [], name
    assert person.cut() == [], name


def test_a_day_from_the_first_sign_in_to_the_report(tmp_path: Path) -> None:
    with hall(tmp_path, site, speed=150.0, idle=IDLE) as at, chromium() as browser:
        _day(at, browser)


def _day(at: Hall, browser: Browser) -> None:
    page = opened(browser, at)
    wrong: list[str] = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    anna = Person(page, at, "anna")
    looked_at(anna, "day-01-sign-in")
    anna.first()
    _connected(anna, page, at)
    _measured(anna, page, at)
    _evaluated(anna, page, at)
    _corrected(anna, page, at)
    _pushed(anna, page, at)
    _rolled_back(anna, page)
    anna = _held(anna, at, browser)
    reported(anna, at)
    assert wrong == []


def _connected(anna: Person, page: Page, at: Hall) -> None:
    anna.go("connect")
    for name, roles in (("bob", {"approver"}), ("carl", {"operator"})):
        page.locator("main details:has(#add-person) summary").click()
        form = page.locator("#add-person")
        form.locator("[name=name]").fill(name)
        form.locator("[name=password]").fill(SECRET)
        form.locator("[name=pin]").fill(PIN)
        for role in ("viewer", "operator", "approver", "service"):
            form.locator(f"[name={role}]").set_checked(role in roles)
        form.locator("button").click()
        page.locator("td b", has_text=name).wait_for()
    at.week_passes()
    assert anna.done(anna.give("#doctor"))["exit_code"] == 5, "the self-test is missing, and is said"
    anna.sees("ul.checks li.bad .fix", "Self-test")
    looked_at(anna, "day-02-connect")


def _measured(anna: Person, page: Page, at: Hall) -> None:
    anna.go("capture")
    assert anna.done(anna.give("#self-test"))["state"] == "ended"
    at.do({"set": "operator", "options": {"mounts_wrong": ["ECC"]}})
    refused = anna.done(anna.give("#measure-axes"))
    assert refused["state"] == "failed", "wrong optics"
    anna.sees("#now", "optics")
    looked_at(anna, "day-03-wrong-optics")
    at.do({"set": "operator", "options": {"mounts_wrong": []}})
    job = anna.give("#measure-axes")
    page.locator(".dots", has_text="●").nth(3).wait_for()
    at.do("auto off")
    at.do("break calibrator")
    anna.sees("#now.bad", "beam")
    looked_at(anna, "day-04-beam-lost")
    at.do("clear calibrator")
    anna.sees("#now", "NC START")
    at.do("nc start")
    at.do("auto on")
    assert anna.done(job)["error"] is None
    looked_at(anna, "day-05-measured")


def _evaluated(anna: Person, page: Page, at: Hall) -> None:
    anna.go("evaluate")
    wanted = figures_of(newest(at, "proposal"), "C1", "before")
    page.locator("[data-figure=E]").wait_for()
    shown = {one: page.locator(f"[data-figure='{one}']").text_content() for one in wanted}
    assert shown == wanted
    page.locator("#limit-E").fill("1000")
    page.locator("#limit-E").press("Tab")
    anna.sees(".verdict.pass", SOMETHING)
    page.locator("#limit-E").fill("0.1")
    page.locator("#limit-E").press("Tab")
    anna.sees(".verdict.fail", SOMETHING)
    looked_at(anna, "day-06-evaluate")
    page.locator("[data-figure=E]").click()
    anna.sees("dialog .formula", "E =")
    looked_at(anna, "day-07-behind-a-number")
    page.locator("#yes").click()


def _corrected(anna: Person, page: Page, at: Hall) -> None:
    anna.go("correct")
    page.locator("dl.facts").wait_for()
    wanted = proposal_of(newest(at, "proposal"), 0)
    shown = page.locator("dl.facts dd").all_text_contents()
    for text in wanted:
        assert text in " ".join(shown), (text, shown)
    looked_at(anna, "day-08-correct")


def approves(page: Page, name: str, secret: str) -> None:
    """Somebody signs beside the first person."""
    page.locator("#approve").click()
    page.locator("#second-name").fill(name)
    page.locator("#second-secret").fill(secret)
    page.locator("#yes").click()


def _pushed(anna: Person, page: Page, at: Hall) -> None:
    anna.go("push")
    assert anna.done(anna.give("#show-plan"))["state"] == "ended"
    for name, secret in (("bob", "999999"), ("carl", PIN)):
        approves(page, name, secret)
        anna.sees("dialog .fault", SOMETHING)
        looked_at(anna, f"day-09-refused-{name}")
        page.locator("dialog .keys button").first.click()
        expect(page.locator("#approved")).not_to_contain_text(name)
    expect(page.locator("#write")).to_be_disabled()
    looked_at(anna, "day-10-not-approved")
    approves(page, "bob", PIN)
    anna.sees("#approved", "bob")
    anna.sees("#armed .countdown", SOMETHING)
    looked_at(anna, "day-11-approved")
    assert anna.done(anna.give("#write", anna.site))["error"] is None
    # The axis table and its reversal go in one transaction, step by step together: nine lamps, none of them left.
    expect(page.locator(".lamps li")).to_have_count(9)
    expect(page.locator(".lamps .done, .lamps .spared")).to_have_count(9)
    page.reload()
    expect(page.locator(".lamps .done, .lamps .spared")).to_have_count(9)
    looked_at(anna, "day-12-pushed")
    reported(anna, at)


def reported(anna: Person, at: Hall) -> None:
    """The numbers of the report's screen are the records', and the report can be read."""
    page = anna.page
    anna.go("report")
    page.locator("#outcome").wait_for()
    run = newest(at, "verdict")
    for phase in ("before", "after"):
        wanted = {name: text for name, text in figures_of(run, "C1", phase).items() if name in "ERBAM"}
        shown = {name: page.locator(f"[data-figure='{name} {phase}']").text_content() for name in wanted}
        assert shown == wanted
    anna.sees("#outcome.better", "✔")
    looked_at(anna, "day-13-report")
    page.locator("#make-report").click()
    with page.context.expect_page() as opens:
        page.locator("dialog a").click()
    opens.value.get_by_text("C1").first.wait_for()
    opens.value.close()
    page.locator("dialog #yes").click()


def _rolled_back(anna: Person, page: Page) -> None:
    anna.go("push")
    assert anna.done(anna.give("button.back[data-table=C1]", anna.site))["error"] is None
    anna.sees("main.push table", "○")
    looked_at(anna, "day-14-rolled-back")


def _held(anna: Person, at: Hall, browser: Browser) -> Person:
    """The service dies while a push waits; the next one says so, and the page leads back."""
    anna.go("capture")
    assert anna.done(anna.give("#measure-axes"))["error"] is None
    anna.go("push")
    assert anna.done(anna.give("#show-plan"))["state"] == "ended"
    approves(anna.page, "bob", PIN)
    anna.sees("#approved", "bob")
    at.do("auto off")
    anna.driven(anna.give("#write", anna.site), until="body:has(#stop:enabled) .lamps li:nth-child(4).done")
    anna.keep("day-14-waits-at-the-control")
    at.kill()
    anna.sees("#now.attention", "does not answer")
    looked_at(anna, "day-14-no-service")
    anna.page.context.close()
    at.serve()
    anna = Person(opened(browser, at), at, "anna")
    anna.sign_in()
    anna.page.locator("#machine").wait_for()
    anna.go("push")
    anna.sees(".chip.bad, .chip.attention", SOMETHING)
    looked_at(anna, "day-15-held")
    at.do("reset")
    job = anna.give("#recover-apply", anna.site)
    anna.driven(job)
    assert anna.done(job)["error"] is None
    expect(anna.page.locator("#recover-apply")).to_have_count(0)
    expect(anna.page.locator(".lamps .wrong")).to_have_count(0)
    anna.sees(".lamps .good", "old table")
    looked_at(anna, "day-16-recovered")
    return anna
