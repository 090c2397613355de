"""A short way through the page in Chromium, in `make test`: first sign-in, and a stored run on each screen.

Self-test, mountings and the whole day are `make browser`'s. Where there is no Chromium they are skipped, with a line
that says so.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import expect

from gateway.domain.proposals import Proposal
from gateway.interlocks.table import largest_change
from gateway.tooth import InspectedFlank
from gateway.workflow.run import stages
from simulators.cell.site import section
from tests.browser.hall import Hall, hall
from tests.browser.person import CHROMIUM, IDLE, REFUSED, SCREENS, Person, chromium, opened
from tests.browser.records import figures_of, newest, text
from tests.browser.test_day import looked_at, site
from tests.unit.report import closing, synthetic

pytestmark = pytest.mark.skipif(not CHROMIUM.exists(), reason="NOT RUN: no Chromium here (Debian package chromium)")
# A message of a record or of the service, in a language of the page.
TOLD = """async ([code, fields, language]) => {
  const { message, speak } = await import(modulePath('words.js'));
  await speak(language);
  for (let more = 0; more < 200 && document.documentElement.dataset.words !== 'all'; more += 1)
    await new Promise((over) => setTimeout(over, 50));
  return message({ code, fields });
}"""

PLANNED = "async (one) => { (await import(modulePath('state.js'))).state.plan.setups = [one]; }"


def ground(text: str) -> str:
    """The cell's short site with its gear as the work."""
    return "\n".join((site(text), section("work", {"gear": "site.gear.toml", "height_mm": 150.0})))


def stored(at: Hall) -> None:
    """A run with everything that the screens show."""
    run, axis, tooth = at.store.create("demo-grinder"), synthetic.axis_material("C1", "deg"), closing.tooth()
    assert axis.before is not None
    assert axis.change is not None
    for phase, capture, evaluation in (
        ("before", axis.capture_before, axis.before),
        ("after", axis.capture_after, axis.after),
    ):
        run.put(f"capture-C1-{phase}", capture)
        run.put(f"evaluation-C1-{phase}", evaluation)
    run.put(stages.ERRORS, closing.errors())
    run.put(stages.TOOTH, closing.proposal())
    run.put(stages.PROPOSAL, Proposal(synthetic.MACHINE, (axis.change,), (), "2026-03-02T11:00:00+00:00"))
    for part in ("before", "after"):
        run.put(stages.inspected(part), next(one.flank for one in tooth.parts if one.part == part))
    run.put(stages.TOOTH_VERDICT, tooth.verdict)
    run.set_state("proposed")


def test_a_person_signs_in_and_looks_at_every_screen(tmp_path: Path) -> None:
    with stage(tmp_path) as anna:
        for screen in SCREENS:
            anna.go(screen)
            anna.page.locator("main .panel h2, main .panel tr").first.wait_for()
        _numbers(anna)
        _told(anna)


@pytest.mark.browser
@pytest.mark.timeout(900)
def test_a_person_tests_the_control_sees_every_mounting_and_asks_for_the_whole_loop(tmp_path: Path) -> None:
    with stage(tmp_path) as anna:
        _lamps(anna)
        _mountings(anna)
        assert anna.done(anna.give("#self-test"))["error"] is None
        _kept_though_worse(anna)


@contextmanager
def stage(folder: Path) -> Iterator[Person]:
    """A person who has signed in beside a cell, with a stored run to look at; the page threw nothing in the end."""
    wrong: list[str] = []
    with hall(folder, ground, speed=150.0, idle=IDLE) as at, chromium() as browser:
        stored(at)
        anna = Person(opened(browser, at), at, "anna")
        anna.page.on("pageerror", lambda error: wrong.append(str(error)))
        anna.first()
        yield anna
    assert wrong == []


def _numbers(anna: Person) -> None:
    """Of axis and tooth, before and after, as the records hold them."""
    page, run = anna.page, newest(anna.at, stages.TOOTH)
    anna.go("evaluate")
    shown = figures_of(run, "C1", "before")
    for name in "ERBAM":
        expect(page.locator(f"[data-figure='{name}']")).to_have_text(shown[name])
    page.locator("[data-figure=E]").click()
    expect(page.locator("dialog td.used")).to_have_count(2)
    page.locator("#yes").click()
    anna.go("correct")
    page.locator("#tooth").click()
    predicted = closing.proposal().prediction
    for name, flank in (("before", predicted.before), ("own", predicted.with_own), ("after", predicted.after)):
        expect(page.locator(f"[data-flank={name}]")).to_have_text(text(flank.rms_um))
    looked_at(anna, "journey-correct-tooth")
    anna.go("push")
    change = run.get(stages.PROPOSAL, Proposal).changes[0]
    expect(page.locator("ul.moves li")).to_contain_text(f" {text(largest_change(change))} ")
    anna.go("report")
    page.locator("#tooth").click()
    for part in ("before", "after"):
        flank = run.get(stages.inspected(part), InspectedFlank).fitted
        expect(page.locator(f"[data-flank={part}]")).to_have_text(text(flank.rms_um))
    looked_at(anna, "journey-report-tooth")


def _lamps(anna: Person) -> None:
    """A test table that goes back once its sign is measured is no fault; a table that goes back is."""
    shown = """async (kinds) => {
      const { lamps } = await import(modulePath('lamps.js'));
      const box = lamps('X1', kinds, true);
      const count = (what) => box.querySelectorAll(what).length;
      return [count('.done'), count('.wrong, .next, .fault'), box.lastChild.textContent];
    }"""
    steps = ["SNAPSHOT", "BACKUP", "DISABLE", "LOADED", "ENABLE"]
    proved = anna.page.evaluate(shown, [*steps, "MEASURED", "ROLLING_BACK"])
    assert proved == [5, 0, "Sign measured; the test table goes back"]
    assert anna.page.evaluate(shown, [*steps, "ROLLING_BACK"]) == [5, 2, "Restoring the old table"]


def _mountings(anna: Person) -> None:
    """Each has its drawing, and what moves is marked in it."""
    anna.go("capture")
    anna.page.locator("#mounting").click()
    choose = anna.page.locator("#which-mounting")
    for key in [str(one.get_attribute("value")) for one in choose.locator("option").all()]:
        choose.select_option(key)
        assert anna.page.locator(".mounting .drawing .moving").count() > 0, key
        anna.keep(f"journey-mounting-{key}")
    looked_at(anna, "journey-mounting")
    anna.page.locator("#yes").click()


def _kept_though_worse(anna: Person) -> None:
    """The whole loop asks for the machine's name and whether tables that make the flank worse stay; both go along."""
    page = anna.page
    planned = {"setup": "EXC-C1", "component": "EXC", "axis": "C1", "instrument": "calibrator"}
    page.evaluate(PLANNED, planned)
    anna.go("push")
    anna.go("capture")
    page.route("**/commands/close", lambda route: route.fulfill(status=409, json=REFUSED))
    for ticked in (False, True):
        page.locator("#close-loop").click()
        page.locator("#keep-worse").set_checked(ticked)
        page.locator("#typed-machine").fill("another")
        expect(page.locator("#yes")).to_be_disabled()
        page.locator("#typed-machine").fill(anna.site)
        looked_at(anna, "journey-close-loop")
        with page.expect_request(lambda one: one.url.endswith("/commands/close")) as sent:
            page.locator("#yes").click()
        asked = sent.value.post_data_json
        assert (asked["apply"], asked["machine"], asked["keep_worse"]) == (True, anna.site, ticked)
        page.locator("dialog .keys button").first.click()
    page.unroute("**/commands/close")


def _told(anna: Person) -> None:
    """Sentences that were made in English are told in the person's language."""
    fields = {"table": "C1", "needed": "2", "have": "1", "why": "this site asks for it"}
    told = anna.page.evaluate(TOLD, ["E-INT-APPROVAL-MISSING", fields, "de"])
    assert told.startswith("Tabelle C1 braucht 2 Personen, freigegeben haben 1")
