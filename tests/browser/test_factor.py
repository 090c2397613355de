"""A person's own second factor at the page: set up by keys alone, refused, given up; taken away by the service."""

from __future__ import annotations

import base64
import hashlib
import hmac
import struct
from datetime import datetime
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest
from playwright.sync_api import Browser, Page, expect

from drivers.languages import LANGUAGES
from tests.browser.person import CHROMIUM
from tests.browser.stage import staged
from tests.unit.web.services import offered
from tests.unit.web.test_daemon import SITE

pytestmark = [
    pytest.mark.browser,
    pytest.mark.timeout(600),
    pytest.mark.skipif(not CHROMIUM.exists(), reason="NOT RUN: no Chromium here (Debian package chromium)"),
]
PIN, PASSWORD = "246802", "a long sentence"


def code_of(secret: str, utc: datetime, later: int = 0) -> str:
    """The code of a secret, by RFC 6238 and RFC 4226 5.3, as an authenticator computes it."""
    step = struct.pack(">Q", int(utc.timestamp()) // 30 + later)
    digest = hmac.new(base64.b32decode(secret), step, hashlib.sha1).digest()
    at = digest[-1] & 15
    return f"{(int.from_bytes(digest[at : at + 4], 'big') & 0x7FFFFFFF) % 1_000_000:06d}"


def opened(page: Page) -> str:
    """Opens the form by keys alone and stays in it; the secret that it shows."""
    page.locator("#own-factor summary").focus()
    page.keyboard.press("Enter")
    shown = page.locator("#factor-key").inner_text().replace(" ", "")
    uri = urlsplit(page.locator("#factor-uri").input_value())
    assert (uri.scheme, uri.netloc) == ("otpauth", "totp")
    assert parse_qs(uri.query)["secret"] == [shown]
    assert page.locator("#factor-link").get_attribute("href") == uri.geturl()
    return shown


def typed(page: Page, *texts: str) -> None:
    """From the summary by Tab over key, text and link to the fields; Enter sends."""
    for _ in range(4):
        page.keyboard.press("Tab")
    for number, text in enumerate(texts):
        if number:
            page.keyboard.press("Tab")
        page.keyboard.type(text)
    page.keyboard.press("Enter")


@pytest.mark.parametrize("language", LANGUAGES)
def test_an_approver_sets_up_and_gives_up_a_second_factor_by_keys(
    browser: Browser, tmp_path: Path, language: str
) -> None:
    offer = offered(tmp_path, SITE)
    accounts, utc = offer.service.doors.accounts, offer.service.clock.utc
    accounts.put("anna", ("approver",), pin=PIN, password=PASSWORD)
    with staged(browser, tmp_path, SITE, roles=("approver",), language=language, offer=offer) as stage:
        page = stage.page
        stage.go("connect")
        state = page.locator("#factor-state")
        unused = state.inner_text()
        secret = opened(page)
        typed(page, "000000" if code_of(secret, utc()) != "000000" else "000001", PIN)
        expect(page.locator("#factor [role=alert]")).not_to_be_empty()
        assert accounts.find("anna").factor == ""
        page.locator("#factor [name=code]").fill(code_of(secret, utc()))
        page.locator("#factor [name=secret]").fill(PASSWORD)
        page.keyboard.press("Enter")
        expect(state).not_to_have_text(unused)
        assert accounts.find("anna").factor == secret
        opened(page)
        page.locator("#factor [name=secret]").fill(PIN)
        page.locator("#factor [name=old]").fill(code_of(secret, utc(), 1))
        page.locator("#factor-off").focus()
        page.keyboard.press("Enter")
        expect(state).to_have_text(unused)
        assert accounts.find("anna").factor == ""
        assert stage.errors == []


def test_whoever_lost_it_is_helped_by_the_service(browser: Browser, tmp_path: Path) -> None:
    offer = offered(tmp_path, SITE)
    accounts, utc = offer.service.doors.accounts, offer.service.clock.utc
    accounts.put("carl", ("approver",), pin=PIN, password=PASSWORD)
    secret = base64.b32encode(bytes(range(20))).decode()
    accounts.set_factor("carl", secret, code_of(secret, utc()), utc())
    with staged(browser, tmp_path, SITE, roles=("service",), offer=offer) as stage:
        stage.go("connect")
        stage.page.locator("[data-forget=carl]").click()
        expect(stage.page.locator("dialog p")).to_contain_text("carl")
        stage.page.locator("#yes").click()
        expect(stage.page.locator("[data-forget=carl]")).to_have_count(0)
        assert accounts.find("carl").factor == ""
        assert stage.errors == []
