"""The ways back at the page: a consent taken back, stopped half way and undone; stopped once more and finished."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import expect

from gateway.push.history import all_pushes
from gateway.push.journal import JOURNALS
from simulators.cellfile import load_cell
from tests.browser.hall import Hall, hall
from tests.browser.person import CHROMIUM, IDLE, Person, chromium, opened
from tests.browser.test_day import looked_at
from tests.cell.bench import short

pytestmark = [
    pytest.mark.browser,
    pytest.mark.timeout(1800),
    pytest.mark.skipif(not CHROMIUM.exists(), reason="NOT RUN: no Chromium here (Debian package chromium)"),
]
AXES = ("C1",)
# Another press is asked for than the first one.
SECOND = """first => {
  const text = document.querySelector('#now.ask')?.textContent ?? '';
  return text.includes('START') && text !== first;
}"""


def test_a_whole_consent_goes_back_is_stopped_and_undone_then_stopped_and_finished(tmp_path: Path) -> None:
    wrong: list[str] = []
    with hall(tmp_path, short(AXES, 7, 3), speed=150.0, idle=IDLE, tested=True) as at, chromium() as browser:
        anna = Person(opened(browser, at), at, "anna")
        anna.page.on("pageerror", lambda error: wrong.append(str(error)))
        anna.first()
        anna.go("capture")
        assert anna.done(anna.give("#measure-axes"))["error"] is None
        anna.go("push")
        assert anna.done(anna.give("#show-plan"))["error"] is None
        assert anna.done(anna.give("#write", anna.site))["error"] is None
        _shown_before(anna, at)
        _stopped(anna, at)
        _undone(anna, at)
        anna.sees("#now", "Tables were switched after the last measurement")
        _stopped(anna, at, "-again")
        _finished(anna, at)
        expect(anna.page.locator("#roll-back-all")).to_have_count(0)
        assert _acting(anna) == _before()
        anna.sees("#now", "Tables were switched after the last measurement")
        looked_at(anna, "back-6-finished")
    assert wrong == []


def _before() -> dict[str, bool]:
    """Which tables the cell acted with before anybody pushed."""
    loaded = {axis.name: axis.loaded for axis in load_cell("demo").axes}
    return {name: loaded[name] is not None and loaded[name].enabled for name in AXES}


def _acting(anna: Person) -> dict[str, bool]:
    """What the page says of each axis' own table."""
    rows = anna.page.locator("main.push .back table tbody tr")
    told = {str(row.locator("b").first.text_content()): str(row.text_content()) for row in rows.all()}
    return {axis: "●" in told[axis] for axis in told if axis in AXES}


def _shown_before(anna: Person, at: Hall) -> None:
    """Each table with its names, and the largest move as the journals have it."""
    page = anna.page
    page.locator("#roll-back-all").click()
    told = page.locator("dialog ul.moves li").all_text_contents()
    pushes = {push.table: push for push in all_pushes(at.store.root / JOURNALS, at.serial)}
    assert {one.split(" ")[0] for one in told} == set(pushes)
    for name, push in pushes.items():
        line = next(one for one in told if one.split(" ")[0] == name)
        if push.new.table.kind == "axis" and not push.old.enabled:
            assert f" moves by {round(max(map(abs, push.new.table.deviations)), 2):g} " in line
    looked_at(anna, "back-1-dialog")
    page.locator("dialog .keys button").first.click()


def _stopped(anna: Person, at: Hall, turn: str = "") -> None:
    """Stop is pressed while the rollback waits for NC START with a table off: one story on the whole screen."""
    page = anna.page
    at.do("auto off")
    job = anna.give("#roll-back-all", anna.site)
    anna.sees("#now.ask", "START")
    first = str(page.locator("#now.ask").text_content())
    at.do("nc start")
    page.wait_for_function(SECOND, arg=first)
    anna.keep(f"back-2-waits{turn}")
    expect(page.locator("#stop")).to_contain_text("Stop this command")
    page.locator("#stop").click()
    anna.sees("dialog", "Stop this command")
    page.locator("dialog #yes").click()
    ended = anna.done(job)
    assert ended["state"] == "stopped"
    assert not [line for line in ended["lines"] if "acts: " in line["text"]]
    looked_at(anna, f"back-3-stopped{turn}")


def _undone(anna: Person, at: Hall) -> None:
    """The person undoes the rollback: the pushed tables act, by name."""
    page = anna.page
    for key in ("#write", "#roll-back-all", "button.back[data-table=C1]"):
        expect(page.locator(key)).to_be_disabled()
    expect(page.locator("button.off[data-table=C1]")).to_be_enabled()
    anna.sees("#now", "A table may be on")
    anna.sees(".chip.bad", "Perhaps on")
    page.locator("#recover-undo").click()
    anna.sees("dialog ul.moves li", "acts then")
    looked_at(anna, "back-4-choice")
    page.locator("dialog .keys button").first.click()
    at.do("reset")
    job = anna.give("#recover-undo", anna.site)
    anna.driven(job)
    assert anna.done(job)["error"] is None
    expect(page.locator("#recover-undo")).to_have_count(0)
    looked_at(anna, "back-5-undone")


def _finished(anna: Person, at: Hall) -> None:
    """The person finishes the rollback: the table from before the push acts, by name, and nothing of the push."""
    page = anna.page
    anna.sees("#now", "A table may be on")
    page.locator("#recover-finish").click()
    anna.sees("dialog ul.moves li", "acts then")
    page.locator("dialog .keys button").first.click()
    at.do("reset")
    job = anna.give("#recover-finish", anna.site)
    anna.driven(job)
    assert anna.done(job)["error"] is None
    expect(page.locator("#recover-finish")).to_have_count(0)
    expect(page.locator(".lamps .fault")).to_have_count(0)  # what it found there is no fault of what it put back
