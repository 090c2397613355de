"""What a hand meets: keys that stay while a command tells, the back key, a late record, the end of a session."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Browser, Route, expect

from tests.browser.hall import hall
from tests.browser.person import CHROMIUM, IDLE, MODULES, SCREENS, Person, chromium, opened
from tests.browser.test_journey import ground, stored

pytestmark = [
    pytest.mark.browser,
    pytest.mark.timeout(1800),
    pytest.mark.skipif(not CHROMIUM.exists(), reason="NOT RUN: no Chromium here (Debian package chromium)"),
]
# What happens all the time at a machine: a reading is taken, something is said, a command goes on. Keys that are no
# longer on the page after that, and fields that lost what was being typed: a person was just pressing or typing there.
LOST = """async ([run, taken]) => {
  const { state, changed } = await import(modulePath('state.js'));
  const { deaf, listen } = await import(modulePath('live.js'));
  deaf();
  const [asked, status] = [window.fetch, state.status];
  let open = 0;
  window.fetch = (...given) => { open += 1; return asked(...given).finally(() => { open -= 1; }); };
  const goesOn = async (done) => {
    Object.assign(state, { status: { ...status, run: { ...run, done } }, jobs: [...state.jobs] });
    state.taken = [...state.taken, { ...taken, deviation: done }];
    changed('frame', 'status', 'jobs', 'said', 'taken', 'reading', 'ambient', 'waiting');
    for (let calm = 0; calm < 5; calm = open ? 0 : calm + 1) await new Promise((over) => setTimeout(over, 20));
  };
  await goesOn(1);
  for (const one of document.querySelectorAll('summary')) one.parentElement.open = true;
  const keys = [...document.querySelectorAll('button, select, input, textarea, summary')];
  const fields = keys.filter((one) => ['number', 'text', 'password'].includes(one.type));
  for (const one of fields) one.value = '7';
  await goesOn(2);
  Object.assign(state, { status, taken: [] });
  window.fetch = asked;
  changed('frame', 'status', 'taken');
  listen();
  const lost = [...keys.filter((one) => !one.isConnected), ...fields.filter((one) => one.value !== '7')];
  const shut = [...document.querySelectorAll('details:not([open])')];
  return { seen: keys.length, lost: [...lost, ...shut].map((one) => one.outerHTML.slice(0, 120)) };
}"""
TAKEN = {"axis": "C1", "target": 0.0, "approach": 1, "part": "before", "repetition": 1}
AT_WORK = {"kind": "run", "run_id": "now", "who": "anna", "axis": "C1", "stage": "before", "total": 9, "words": ""}
AT_WORK |= {"steps": [], "moves": [], "ask": None, "started_utc": "2026-03-02T11:00:00+00:00"}


def test_what_a_hand_meets_stays_and_what_it_asked_for_last_is_shown(tmp_path: Path) -> None:
    wrong: list[str] = []
    with hall(tmp_path, ground, speed=IDLE) as at, chromium() as browser:
        stored(at)
        anna = Person(opened(browser, at), at, "anna")
        anna.page.on("pageerror", lambda error: wrong.append(str(error)))
        anna.first()
        _pressed(anna)
        anna.page.go_back()
        anna.page.locator(f"main.{SCREENS[-2]}").wait_for()
        _the_newest_wish_is_shown(anna)
        _by_the_clock(anna, browser)
        _signed_out(anna)
    assert wrong == []


def _pressed(anna: Person) -> None:
    """Whatever a command tells meanwhile, no key is taken from under a finger and no field is emptied."""
    anna.page.locator(".chip.state.ready, .chip.state.attention").wait_for()
    for screen in SCREENS:
        anna.go(screen)
        anna.page.locator("main .panel h2, main .panel tr").first.wait_for()
        if screen == "connect":
            anna.page.locator("#add-person").wait_for(state="attached")  # the accounts are asked for beside the rest
        found = anna.page.evaluate(LOST, [AT_WORK, TAKEN])
        assert found["seen"] > len(SCREENS), screen
        assert found["lost"] == [], screen


def _the_newest_wish_is_shown(anna: Person) -> None:
    """A record that comes late, of what was asked for before, does not take the place of what is asked for now."""
    page = anna.page
    late: list[Route] = []

    def kept_back(route: Route) -> None:
        late.append(route)

    page.route("**/stages/evaluation-C1-after", kept_back)
    anna.go("report")
    page.reload()
    page.locator("#tooth").click()
    page.locator("[data-flank=before]").wait_for()
    with page.expect_response("**/stages/evaluation-C1-after"):
        late[0].continue_()
    page.evaluate("() => new Promise((over) => setTimeout(over, 100))")
    expect(page.locator("[data-flank=before]")).to_be_visible()
    page.unroute("**/stages/evaluation-C1-after")


def _by_the_clock(anna: Person, browser: Browser) -> None:
    """Of the shop, not of Greenwich: a moment of a record stands on the screen as the wall clock beside it has it."""
    page = browser.new_context(timezone_id="Asia/Shanghai").new_page()
    page.add_init_script(MODULES)
    page.goto(anna.at.url)
    told = page.evaluate("async () => (await import(modulePath('figures.js'))).when('2026-03-02T23:30:00+00:00')")
    assert told == "2026-03-03 07:30"


def _signed_out(anna: Person) -> None:
    """Whose session is over is asked to sign in by the next key, and is then where the key was pressed."""
    anna.go("connect")
    anna.page.context.clear_cookies()
    anna.page.locator("#doctor").click()
    anna.page.locator("dialog #yes").click()
    anna.sign_in()
    anna.page.locator("main.connect").wait_for()
