"""From an empty folder to a verified table, by the page alone: account, questions, certificate, self-test, push."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.hashes import SHA1, SHA256
from playwright.sync_api import Browser, expect

from drivers.languages import LANGUAGES
from gateway.cli.setup.check import check_site
from gateway.cli.setup.wizard import STORE
from gateway.config import load_site
from gateway.users import first_token_path
from tests.browser.hall import Hall, hall
from tests.browser.person import CHROMIUM, IDLE, LARGE, PIN, SECRET, SMALL, Person, chromium, opened
from tests.browser.test_day import SOMETHING, approves, looked_at, reported

pytestmark = [
    pytest.mark.browser,
    pytest.mark.timeout(1800),
    pytest.mark.skipif(not CHROMIUM.exists(), reason="NOT RUN: no Chromium here (Debian package chromium)"),
]


class EmptyHall(Hall):
    """A hall whose service has no site file yet."""

    @property
    def token(self) -> str:
        """Beside the store that there will be."""
        return first_token_path(self.path.parent / STORE).read_text(encoding="ascii").strip()


def _empty(at: Hall, folder: Path) -> EmptyHall:
    folder.mkdir()
    found = EmptyHall(at.cell, folder / "site.toml", speeds=at.speeds)
    found.serve()
    return found


def test_a_machine_of_carried_files_is_begun_and_what_is_doubtful_is_shown_first(tmp_path: Path) -> None:
    """The usual answer to every question; nobody said where the axes may stand, so nothing could be pushed."""
    folder = tmp_path / "pc"
    folder.mkdir()
    at = EmptyHall(None, folder / "site.toml")
    at.serve()
    try:
        with chromium() as browser:
            anna = Person(opened(browser, at, language="de"), at, "anna")
            form = anna.page.locator("#first")
            for name, text in (("token", at.token), ("name", anna.name), ("password", SECRET)):
                form.locator(f"[name={name}]").fill(text)
            form.locator("button").click()
            anna.page.locator("#road-carried").click()
            anna.page.locator("#next").wait_for()
            asks = ""
            while anna.page.locator("#next").count():
                if asks == "serial":  # who knows the control means to push
                    anna.page.locator("#answer").fill("GR-0042")
                with anna.page.expect_response(lambda one: one.url.endswith("/site-file/question")) as sent:
                    anna.page.locator("#next").click()
                asks = (sent.value.json()["question"] or {}).get("key", "")
                expect(anna.page.locator("#asking")).to_have_count(0)
            anna.page.locator("#make").click()
            anna.page.locator("#go-on").wait_for()
            anna.sees("#doubts", "[moves.safe]")
            looked_at(anna, "beginning-doubts")
            assert len(check_site(at.path).doubts) == anna.page.locator("#doubts li").count()
            anna.page.locator("#go-on").click()
            anna.sees("#now", "Selbsttest")
    finally:
        at.kill()


def _known(path: Path) -> dict[str, Any]:
    """What stands on the control's display and on the instruments' plates: here in the cell's own site file."""
    site = load_site(path)
    settings = site.controller.settings
    certificate = x509.load_der_x509_certificate(Path(settings["server_certificate"]).read_bytes())
    devices = {one.name: f"{one.driver} {one.url}" for one in site.instruments}
    return {
        "url": site.controller.url,
        "user": settings["user"],
        "password": Path(settings["password_file"]).read_text(encoding="utf-8").strip(),
        "sha1": certificate.fingerprint(SHA1()).hex(),  # noqa: S303 - as older dialogs show it
        "sha256": certificate.fingerprint(SHA256()).hex(":").upper(),
        "calibrator": devices["calibrator"],
    }


def _answers(anna: Person, key: str, text: str) -> None:
    """To the question that is open; its key is known by the answer's place."""
    page = anna.page
    with page.expect_response(lambda one: one.url.endswith("/site-file/question")) as sent:
        page.locator("#answer").fill(text)
        page.locator("#next").click()
    told = sent.value.json()
    assert key in [one["key"] for one in told["asked"]], told["question"]
    expect(page.locator("#asking")).to_have_count(0)


def test_an_empty_computer_comes_to_a_verified_table(tmp_path: Path) -> None:
    with hall(tmp_path, str, speed=150.0, idle=IDLE, served=False) as cell, chromium() as browser:
        known, at = _known(cell.path), _empty(cell, tmp_path / "pc")
        try:
            _begun(at, browser, known)
        finally:
            at.kill()


def _begun(at: Hall, browser: Browser, known: dict[str, Any]) -> None:
    anna = Person(opened(browser, at), at, "anna")
    form = anna.page.locator("#first")
    for name, text in (("token", at.token), ("name", "anna"), ("password", "a long sentence")):
        form.locator(f"[name={name}]").fill(text)
    form.locator("button").click()
    _asked(anna, known)
    _every_look(anna, browser)
    anna.page.locator("#make").click()
    anna.page.locator("#machine").wait_for()
    found = check_site(at.path)
    assert (found.faults, found.doubts) == ((), ())
    assert load_site(at.path).site.name == "hall-9"
    _trusts_anew(anna, at, known)
    anna.go("connect")
    expect(anna.page.locator("td.state.open")).to_have_count(2)
    anna.go("capture")
    assert anna.done(anna.give("#self-test"))["error"] is None
    looked_at(anna, "beginning-self-tested")
    _corrects(_patient(anna, at, browser), at)


def _patient(anna: Person, at: Hall, browser: Browser) -> Person:
    """The service anew, with a minute for each answer: here the hall is simulated by the same computer.

    The shop has two people agree to every push.
    """
    anna.page.context.close()
    at.kill()
    text, driver = at.path.read_text(encoding="utf-8"), 'driver = "'
    assert text.count("[site]\n") == 1
    text = text.replace("[site]\n", "[site]\napprovals = 2\n")
    at.path.write_text(text.replace(f"\n{driver}", f"\ntimeout_s = 60.0\n{driver}"), encoding="utf-8")
    at.serve()
    again = Person(opened(browser, at), at, anna.name)
    again.sign_in()
    again.page.locator("#machine").wait_for()
    return again


def _corrects(anna: Person, at: Hall) -> None:
    """As the page says it in turn: measure, let a second person agree, write; then every number is the record's."""
    anna.sees("#now", "Measure the axes")
    _invites(anna, "bob")
    at.week_passes()
    anna.go("capture")
    assert anna.done(anna.give("#measure-axes"))["error"] is None
    anna.sees("#now", "Correct")
    anna.go("model")
    anna.sees("main .empty", "set-ups")
    anna.go("push")
    assert anna.done(anna.give("#show-plan"))["error"] is None
    anna.sees(".answer", "sign is proved first")
    expect(anna.page.locator(".answer")).not_to_contain_text("no safe place")
    looked_at(anna, "beginning-plan")
    approves(anna.page, "bob", PIN)
    anna.sees("#approved", "bob")
    assert anna.done(anna.give("#write", anna.site))["error"] is None
    expect(anna.page.locator(".lamps .done, .lamps .spared")).to_have_count(9)
    looked_at(anna, "beginning-pushed")
    anna.give("#verify")
    anna.sees(".answer", "C1")
    reported(anna, at)


def _invites(anna: Person, name: str) -> None:
    """An account for somebody who approves."""
    anna.go("connect")
    anna.page.locator("main details:has(#add-person) summary").click()
    form = anna.page.locator("#add-person")
    for key, text in (("name", name), ("password", SECRET), ("pin", PIN)):
        form.locator(f"[name={key}]").fill(text)
    form.locator("[name=approver]").check()
    form.locator("button").click()
    anna.page.locator("td b", has_text=name).wait_for()


def _asked(anna: Person, known: dict[str, Any]) -> None:
    anna.page.locator("#road-opcua").click()
    expect(anna.page.locator("#asking")).to_have_count(0)
    anna.page.locator("#answer").fill("hall 9")
    anna.page.locator("#next").click()
    anna.sees(".setup .fault", SOMETHING)
    looked_at(anna, "beginning-wrong-name")
    for key, text in (("name", "hall-9"), ("url", known["url"]), ("user", known["user"])):
        _answers(anna, key, text)
    _answers(anna, "password", known["password"])
    anna.sees(".found", known["sha256"])
    looked_at(anna, "beginning-thumbprint")
    anna.page.locator("#answer").fill("AA:BB")
    anna.page.locator("#next").click()
    anna.sees(".setup .fault", SOMETHING)
    anna.page.locator("#answer").fill(known["sha1"])
    anna.page.locator("#next").click()
    anna.sees(".found", "X1")
    _answers(anna, "axes", "C1")
    _answers(anna, "calibrator", known["calibrator"])
    _answers(anna, "safe", "C1 any, X1 any, Y1 -60 60, Z1 any")
    anna.page.locator("#make").wait_for()


def _every_look(anna: Person, browser: Browser) -> None:
    """The page with every answer given, in each language and both sizes."""
    for size in (SMALL, LARGE):
        anna.page.set_viewport_size({"width": size[0], "height": size[1]})
        for language in LANGUAGES:
            anna.page.locator("#language").select_option(language)
            anna.page.wait_for_function("code => document.documentElement.lang === code", arg=language)
            looked_at(anna, f"beginning-answered-{language}-{size[0]}")
    anna.page.set_viewport_size({"width": SMALL[0], "height": SMALL[1]})
    anna.page.locator("#language").select_option("en")


def _trusts_anew(anna: Person, at: Hall, known: dict[str, Any]) -> None:
    """The pinned certificate is lost: the page shows the control's own beside it and pins it again."""
    Path(load_site(at.path).controller.settings["server_certificate"]).unlink()
    anna.go("connect")
    anna.page.locator("#trust").click()
    anna.sees("#trusted", "▲")
    form = anna.page.locator("#accept")
    form.locator("input").fill("00" * 32)
    form.locator("button").click()
    anna.sees("main .fault", SOMETHING)
    form.locator("input").fill(known["sha256"])
    form.locator("button").click()
    anna.sees("#trusted", "✔")
    looked_at(anna, "beginning-trusted")
