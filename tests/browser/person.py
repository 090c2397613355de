"""A person at the page: signs in, presses keys, waits for what the screen says, keeps pictures, hears axe."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Locator, Page, expect, sync_playwright

from tests.browser.hall import Hall

CHROMIUM = Path(os.environ.get("CHROMIUM", "/usr/bin/chromium"))
# As root there is no sandbox to be had; everything that asks a network of its own accord is off.
FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
SMALL, LARGE = (1280, 1024), (1920, 1080)
IDLE = 2.0  # speed of a cell where nothing is at work
PATIENCE_MS = 180_000
POLL_MS = 300
SECRET = "a long sentence"
PIN = "246802"
PICTURES = Path(os.environ.get("TRUEFLANK_PICTURES", ".browser"))
expect.set_options(timeout=PATIENCE_MS)
# Where this build's modules are: a module that is loaded by another path is another one.
MODULES = "window.modulePath = (name) => new URL(name, document.querySelector('script[type=module]').src).href"
REFUSED = {"code": "E-WEB-BUSY", "what": "busy", "do": "", "fields": {"run": "r", "who": "nobody"}}
SCREENS = ("connect", "capture", "evaluate", "model", "correct", "push", "report")


@contextmanager
def chromium() -> Iterator[Browser]:
    """Debian's browser, ended with everything it opened."""
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=str(CHROMIUM), args=list(FLAGS))
        try:
            yield browser
        except BaseException:
            _kept(browser)
            raise
        finally:
            browser.close()


def _kept(browser: Browser) -> None:
    """What every page showed when something went wrong."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    for number, page in enumerate(page for context in browser.contexts for page in context.pages):
        page.screenshot(path=PICTURES / f"failed-{number}.png")


def opened(browser: Browser, at: Hall, size: tuple[int, int] = SMALL, language: str = "en") -> Page:
    """A page of its own: no cookie, no memory of another one; a fault in a script is kept in `page.faults`."""
    context = browser.new_context(viewport={"width": size[0], "height": size[1]}, locale=language)
    context.set_default_timeout(PATIENCE_MS)
    context.add_init_script(MODULES)
    page = context.new_page()
    page.goto(at.url)
    page.locator("#language").wait_for()
    page.locator("#language").select_option(language)
    page.wait_for_function("code => document.documentElement.lang === code", arg=language)
    return page


@dataclass
class Person:
    """Somebody at one page."""

    page: Page
    at: Hall
    name: str

    def first(self) -> None:
        """Makes the first account, with the token that the service wrote."""
        form = self.page.locator("#first")
        form.locator("[name=token]").fill(self.at.token)
        form.locator("[name=name]").fill(self.name)
        form.locator("[name=password]").fill(SECRET)
        form.locator("button").click()
        self.page.locator("#machine").wait_for()

    def sign_in(self, secret: str = SECRET) -> None:
        """By name and password."""
        self.page.locator("#name").fill(self.name)
        self.page.locator("#secret").fill(secret)
        self.page.locator("#sign-in").click()

    def go(self, screen: str) -> None:
        """To a screen of the rail."""
        self.page.locator(f"#go-{screen}").click()
        self.page.locator(f"main.{screen}").wait_for()

    def give(self, key: str, typed: str = "") -> int:
        """Presses a key, says yes (or types the machine's name), and the service takes the command; its number."""
        self.at.hurry(on=True)
        with self.page.expect_response(lambda one: "/commands/" in one.url, timeout=PATIENCE_MS) as answer:
            self.page.locator(key).click()
            if typed:
                self.page.locator("#typed-machine").fill(typed)
            if typed or self.page.locator("#yes").count():
                self.page.locator("#yes").click()
        assert answer.value.status == 202, answer.value.text()
        return int(answer.value.json()["job"])

    def done(self, job: int) -> dict[str, Any]:
        """How the command ended, once the page too says that nothing is at work."""
        where, left = f"{self.at.url.rstrip('/')}/api/v1/sites/{self.site}/jobs/{job}", 10 * PATIENCE_MS
        while (found := dict(self.page.request.get(where).json()))["state"] == "running":
            assert left > 0, found
            left -= POLL_MS
            self.page.wait_for_timeout(POLL_MS)
        expect(self.page.locator("#stop")).to_be_disabled(timeout=PATIENCE_MS)
        self.at.hurry(on=False)
        return found

    def driven(self, job: int, until: str = "") -> None:
        """Presses NC START whenever the page asks for it, until the command has ended or something is on the screen."""
        where, asked = f"{self.at.url.rstrip('/')}/api/v1/sites/{self.site}/jobs/{job}", self.page.locator("#now.ask")
        for _look in range(6 * PATIENCE_MS // POLL_MS):
            text = asked.text_content() if asked.count() else ""
            # What was asked for stands below what was done before it: looked at in this order, nothing is missed.
            if until and self.page.locator(until).count():
                return
            if text and "START" in text:
                self.at.do("nc start")
                self.page.wait_for_function(
                    "before => document.querySelector('#now.ask')?.textContent !== before",
                    arg=text,
                    timeout=3 * PATIENCE_MS,
                )
            elif self.page.request.get(where).json()["state"] != "running":
                assert not until, f"command {job} ended without {until}"
                return
            self.page.wait_for_timeout(POLL_MS)
        raise AssertionError(f"nothing came of command {job}")

    @property
    def site(self) -> str:
        """What the machine is called above."""
        return str(self.page.locator("#machine").text_content())

    @property
    def sentence(self) -> Locator:
        """What to do now."""
        return self.page.locator("#now")

    def sees(self, what: str, text: str | re.Pattern[str]) -> None:
        """Waits until it is there."""
        expect(self.page.locator(what).first).to_contain_text(text, timeout=PATIENCE_MS)

    def keep(self, name: str) -> Path:
        """A picture of the screen, kept by the run."""
        PICTURES.mkdir(parents=True, exist_ok=True)
        path = PICTURES / f"{name}.png"
        self.page.screenshot(path=path)
        return path

    def heard(self) -> list[str]:
        """What axe-core finds serious or critical on the page as it is."""
        if not self.page.evaluate("() => 'axe' in window"):
            self.page.evaluate(resources.files("axe_playwright_python").joinpath("axe.min.js").read_text("utf-8"))
        found = self.page.evaluate("() => axe.run({ resultTypes: ['violations'] })")
        return [
            f"{one['id']}: {one['help']}: {node['html'][:160]}"
            for one in found["violations"]
            if one["impact"] in ("serious", "critical")
            for node in one["nodes"]
        ]

    def cut(self) -> list[str]:
        """Texts that stand out of their box, keys too small for gloves, a page that scrolls as a whole."""
        found: list[str] = self.page.evaluate(LAYOUT)
        return found


# What is wider than its box; keys smaller than 44 px; a page that must be scrolled; a command.
LAYOUT = """() => {
  const low = 44, found = [];
  const seen = (one) => one.offsetParent && !one.closest('.hidden');
  const every = (names) => [...document.querySelectorAll(names)].filter(seen);
  const name = (one) => `${one.tagName} ${one.id} ${one.className} "${(one.textContent ?? '').slice(0, 40)}"`;
  const over = (one) => one.scrollWidth > one.clientWidth + 1;
  const says = (what, one) => found.push(`${what}: ${name(one)} ${one.scrollWidth} > ${one.clientWidth}`);
  for (const one of every('button, select, input:not([type=checkbox]), a.key, summary')) {
    const { height, width } = one.getBoundingClientRect();
    if (height < low - 0.5 || width < low - 0.5) found.push(`small: ${name(one)} ${width} x ${height}`);
  }
  for (const one of every('button, .chip, td, th, .digits, .row.big, h1, h2, .cell, dd, dt'))
    if (over(one) && getComputedStyle(one).display !== 'inline') says('cut', one);
  for (const one of every('.top, .rail, .low, .now, .screen, .panel')) if (over(one)) says('wide', one);
  if (document.documentElement.scrollWidth > innerWidth + 1) found.push('the whole page scrolls sideways');
  if (innerWidth > 900 && document.documentElement.scrollHeight > innerHeight + 1) found.push('the whole page scrolls');
  const um = document.documentElement.lang === 'de' && /[a-zäöü,;:] µm [a-zäöü0-9]/.exec(document.body.innerText);
  if (um) found.push(`a word taken for a unit: ${um[0]}`);
  const commands = ['recover', 'disable', 'rollback', 'push', 'approve', 'doctor', 'tables verify', 'run',
    'measure', 'report'];
  const ordered = new RegExp(`trueflank (${commands.join('|')})(?![a-z-])`).exec(document.body.innerText);
  if (ordered) found.push(`a command and no key of the page: ${ordered[0]}`);
  const top = document.querySelector('.top');
  if (top && innerWidth > 900 && top.clientHeight > 76) found.push(`the bar above has ${top.clientHeight} px`);
  return found;
}"""
