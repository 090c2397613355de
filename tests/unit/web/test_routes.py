"""Every route: what it answers, to whom, and with which headers."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable

import pytest

from drivers.errors import DeviceRefused, catalogue
from gateway.errors import BusyError
from gateway.report import render
from gateway.views import DeviceView, HeldView, PastRun, RunView, StatusView
from gateway.web import create_app
from tests.unit.report.attacks import STRINGS
from tests.unit.report.synthetic import material
from tests.unit.report.test_page import Outline
from tests.unit.web.client import Client
from tests.unit.web.pictures import status

TOKEN = "t" * 43
BEARER = {"Authorization": f"Bearer {TOKEN}"}
ROUTES = ("/healthz", "/", "/api/status", "/runs/r-2/report", "/static/status.css", "/static/status.js")


async def start() -> str:
    return "r-4"


def client(
    picture: Callable[[], StatusView] = status,
    start_run: Callable[[], Awaitable[str]] | None = start,
    token: str = TOKEN,
    base: str = "http://127.0.0.1:8617",
) -> Client:
    app = create_app(picture, start_run, token, lambda run_id: "<p>report</p>" if run_id == "r-2" else None)
    return Client(app, base_url=base)


def test_health_is_short() -> None:
    answer = client().get("/healthz")
    assert (answer.status_code, answer.json()) == (200, {"status": "ok"})


def test_an_alarm_stands_on_the_page_in_the_data_and_in_the_health() -> None:
    alarm = "X1: the live table holds <b>other</b> values"
    at = client(lambda: status(devices=(), run=None, alarms=(alarm,), due="C1 is due"))
    assert at.get("/healthz").json() == {"status": "alarm", "alarms": [alarm]}
    data = at.get("/api/status").json()
    assert (data["state"], data["alarms"], data["due"]) == ("attention", [alarm], "C1 is due")
    text = Outline(at.get("/").text).text
    assert text.index(alarm) < text.index("C1 is due") < text.index("Devices")
    assert "Needs attention" in text


def test_page_shows_devices_run_result_and_past_runs() -> None:
    answer = client().get("/")
    text = Outline(answer.text).text
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    for wanted in (
        "hall-3-grinder", "Run at work", "controller", "sinumerik-opcua", "lost", "E-LINK-DEADLINE", "no answer within",
        "r-3", "12 of 240", "C1: stop 12 of 240", "better", "no disk", "36.41", "−97 %", "2026-03-02 09:30 UTC",
    ):  # fmt: skip
        assert wanted in text
    assert 'href="/runs/r-2/report"' in answer.text
    assert "r-1/report" not in answer.text


def test_a_table_that_is_still_on_stands_first_and_loudest() -> None:
    loud = HeldView("R-HELD-ON: HELD, STILL ON: X1, transaction 7: look", loud=True)
    calm = HeldView("R-HELD-OFF: X1, transaction 8: held, and read back as off", loud=False)
    answer = client(lambda: status(run=None, held=(loud, calm))).get("/")
    text = Outline(answer.text).text
    assert text.index("Held, still on") < text.index(loud.words) < text.index(calm.words) < text.index("Devices")
    assert f"<strong>{loud.words}</strong>" in answer.text
    data = client(lambda: status(run=None, held=(loud, calm))).get("/api/status").json()
    assert (data["state"], data["held"][0]) == ("still-on", {"words": loud.words, "loud": True})
    assert client(lambda: status(run=None, held=(calm,))).get("/api/status").json()["state"] == "attention"


def test_page_without_devices_runs_or_trouble_is_calm() -> None:
    text = Outline(client(lambda: status(devices=(), run=None, last_runs=(), result=())).get("/").text).text
    assert "Ready" in text
    assert "No run yet." in text
    assert "The site names no device." in text


def test_page_tells_what_is_wrong_and_what_to_do() -> None:
    failure = DeviceRefused("E-LINK-DEADLINE", "laser", timeout_s=3).as_record()
    text = Outline(client(lambda: status(failure=failure, trouble=failure, run=None)).get("/").text).text
    assert "The last run failed" in text
    assert "The devices are not those of the site" in text
    assert text.count("no answer within 3 s") == 2


def test_page_needs_nothing_inline_or_foreign() -> None:
    page = client().get("/").text
    outline = Outline(page)
    assert "style" not in outline.tags
    assert [name for name, _value in outline.attributes if name == "style" or name.startswith("on")] == []
    links = [value or "" for name, value in outline.attributes if name in {"src", "href"}]
    assert all(link.startswith("/") and not link.startswith("//") for link in links)
    assert {link: client().get(link).status_code for link in links} == dict.fromkeys(links, 200)


def test_status_data() -> None:
    data = client().get("/api/status").json()
    assert data["site"] == "hall-3-grinder"
    assert data["run"]["progress"] == 0.05


@pytest.mark.parametrize("name", ["status.css", "status.js", "icon.svg"])
def test_static_files_are_local_and_typed(name: str) -> None:
    answer = client().get(f"/static/{name}")
    kind = {"css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}[name.rpartition(".")[2]]
    assert answer.headers["content-type"].startswith(kind)
    assert answer.content


@pytest.mark.parametrize("path", ["/static/app.py", "/static/..%2Fapp.py", "/static/%2e%2e/gate.py", "/static/"])
def test_nothing_but_the_listed_static_files_is_served(path: str) -> None:
    assert client().get(path).status_code == 404


def test_report_is_served_as_stored_without_scripts() -> None:
    answer = client().get("/runs/r-2/report")
    assert (answer.status_code, answer.text) == (200, "<p>report</p>")
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "script-src" not in policy
    assert "sandbox" in policy


@pytest.mark.parametrize(
    "run_id", ["r-9", "..", "%2e%2e", "..%2f..%2fetc%2fpasswd", ".hidden", "a b", "a%00", "x" * 200, "%0d%0aSet-Cookie"]
)
def test_no_report_no_page_and_no_way_out_of_the_store(run_id: str) -> None:
    asked: list[str] = []

    def report(run_id: str) -> None:
        asked.append(run_id)

    app = create_app(status, None, TOKEN, report)
    answer = Client(app, base_url="http://127.0.0.1").get(f"/runs/{run_id}/report")
    assert answer.status_code == 404
    assert answer.json()["code"] in {"E-WEB-REPORT", "E-WEB-PATH"}
    assert all("/" not in item and not item.startswith(".") for item in asked)


@pytest.mark.parametrize(
    "path", ["/nothing", "/docs", "/redoc", "/openapi.json", "/api", "/runs", "/favicon.ico", "//evil", "/api/runs/1"]
)
def test_what_is_not_there_is_a_clean_404(path: str) -> None:
    answer = client().get(f"http://127.0.0.1:8617{path}")
    assert answer.status_code == 404
    body = answer.json()
    assert body["code"] == "E-WEB-PATH"
    assert body["fields"]["path"] in {path, path.replace("//", "/")}
    assert body["what"]
    assert body["do"]


@pytest.mark.parametrize(
    ("method", "path"),
    [("POST", "/"), ("DELETE", "/api/runs"), ("PUT", "/api/status"), ("GET", "/api/runs"), ("PATCH", "/healthz")],
)
def test_wrong_method_is_405_and_names_the_right_one(method: str, path: str) -> None:
    answer = client().request(method, path, headers=BEARER)
    assert answer.status_code == 405
    assert answer.json()["code"] == "E-WEB-METHOD"
    assert answer.headers["allow"]


@pytest.mark.parametrize("path", [*ROUTES, "/nothing", "/static/no"])
def test_every_answer_carries_the_headers(path: str) -> None:
    headers = client().get(path).headers
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["x-frame-options"] == "DENY"
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cache-control"] == "no-store"
    policy = headers["content-security-policy"]
    assert "frame-ancestors 'none'" in policy
    assert path.endswith("/report") or policy.startswith("default-src 'self';")
    assert "unsafe-eval" not in policy
    assert "access-control-allow-origin" not in headers


@pytest.mark.parametrize(
    "host", ["127.0.0.1", "127.0.0.1:8617", "localhost", "LOCALHOST:80", "[::1]:8617", "localhost:1"]
)
def test_own_names_may_come_in(host: str) -> None:
    assert client().get("/healthz", headers={"Host": host}).status_code == 200


@pytest.mark.parametrize(
    "host",
    [
        "attack.example", "127.0.0.1.attack.example", "localhost.attack.example", "attack.example:8617", "",
        "127.0.0.1@attack.example", "attack.example#localhost", "localhost/x", "10.0.0.1", "192.168.1.2", "127.0.0.2",
        "localhost:999999", "localhost:x", "[::1", "user@localhost", "testserver",
    ],
)  # fmt: skip
@pytest.mark.parametrize("path", ["/healthz", "/", "/nothing"])
def test_foreign_host_names_stay_out(host: str, path: str) -> None:
    answer = client().get(path, headers={"Host": host})
    assert answer.status_code == 400
    assert answer.json()["code"] == "E-WEB-HOST"
    assert answer.headers["x-content-type-options"] == "nosniff"


def test_a_run_starts_for_the_token_alone() -> None:
    answer = client().post("/api/runs", headers=BEARER)
    assert (answer.status_code, answer.json()) == (202, {"run_id": "r-4"})
    own = {**BEARER, "Origin": "http://127.0.0.1:8617", "Sec-Fetch-Site": "same-origin"}
    assert client().post("/api/runs", headers=own).status_code == 202


@pytest.mark.parametrize(
    "header",
    [
        None, "", "Bearer", "Bearer ", f"Bearer {TOKEN}x", f"Bearer {TOKEN[:-1]}", f"Basic {TOKEN}", TOKEN,
        f"Bearer  {TOKEN} x", "Bearer t\u00f6ken",
    ],
)  # fmt: skip
def test_without_the_token_nothing_starts(header: str | None) -> None:
    begun: list[int] = []

    async def begin() -> str:
        begun.append(1)
        return "r"

    headers = {} if header is None else {"Authorization": header.encode("latin-1")}
    answer = client(start_run=begin).post("/api/runs", headers=headers)
    assert answer.status_code == 401
    assert answer.json()["code"] == "E-WEB-TOKEN"
    assert answer.headers["www-authenticate"] == "Bearer"
    assert TOKEN not in answer.text
    assert begun == []


def test_an_empty_token_opens_nothing() -> None:
    assert client(token="").post("/api/runs", headers={"Authorization": "Bearer "}).status_code == 401


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://attack.example"},
        {"Origin": "null"},
        {"Origin": "http://127.0.0.1:9999"},
        {"Origin": "https://127.0.0.1:8617"},
        {"Origin": "http://localhost:8617"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
    ],
)
def test_another_page_cannot_start_a_run_even_with_the_token(headers: dict[str, str]) -> None:
    answer = client().post("/api/runs", headers={**BEARER, **headers})
    assert answer.status_code == 403
    assert answer.json()["code"] == "E-WEB-ORIGIN"


def test_a_gateway_that_only_watches_says_so() -> None:
    answer = client(start_run=None).post("/api/runs", headers=BEARER)
    assert (answer.status_code, answer.json()["code"]) == (409, "E-WEB-WATCHING")


def test_busy_is_409_and_a_device_refusal_503_with_its_record() -> None:
    async def busy() -> str:
        raise BusyError("E-WEB-BUSY", "daemon", run="r-3")

    async def refused() -> str:
        raise DeviceRefused("E-LINK-DEADLINE", "laser", timeout_s=3)

    answer = client(start_run=busy).post("/api/runs", headers=BEARER)
    assert (answer.status_code, answer.json()["fields"]) == (409, {"run": "r-3"})
    answer = client(start_run=refused).post("/api/runs", headers=BEARER)
    assert (answer.status_code, answer.json()["code"]) == (503, "E-LINK-DEADLINE")


@pytest.mark.parametrize(
    "headers", [{"Content-Length": "5000"}, {"Content-Length": "-1"}, {"Content-Length": "9" * 12}]
)
def test_large_or_odd_bodies_are_refused_unread(headers: dict[str, str]) -> None:
    answer = client().post("/api/runs", headers={**BEARER, **headers})
    assert (answer.status_code, answer.json()["code"]) == (413, "E-WEB-SIZE")


async def _unsized() -> AsyncIterator[bytes]:
    yield b"x"


def test_a_body_of_unknown_size_is_refused() -> None:
    answer = client().post("/api/runs", headers=BEARER, content=_unsized())
    assert answer.status_code == 413


@pytest.mark.parametrize("attack", STRINGS)
def test_no_name_becomes_markup(attack: str) -> None:
    error = {"code": attack, "where": attack, "fields": {attack: attack}, "what": attack, "do": attack}
    view = StatusView(
        attack, attack, attack,
        (DeviceView(attack, attack, attack, attack, error),),
        RunView(attack, attack, attack, 1, 2, attack, attack),
        (PastRun(attack, attack, attack, attack, report=True),),
        error,
    )  # fmt: skip
    outline = Outline(client(lambda: view).get("/").text)
    tags = {tag: outline.tags.get(tag, 0) for tag in ("script", "img", "svg", "iframe", "link", "meta", "a", "body")}
    assert tags == {"script": 1, "img": 0, "svg": 0, "iframe": 0, "link": 2, "meta": 3, "a": 1, "body": 1}
    assert [name for name, _value in outline.attributes if name.startswith("on")] == []
    links = [value or "" for name, value in outline.attributes if name in {"src", "href"}]
    assert all(link.startswith("/") and not link.startswith("//") for link in links)


def test_a_real_report_passes_through_unchanged() -> None:
    document = render(material())
    app = create_app(status, None, TOKEN, lambda _run_id: document)
    assert Client(app, base_url="http://localhost").get("/runs/r-2/report").text == document


def test_every_code_used_here_has_words() -> None:
    texts = catalogue()
    codes = [code for code in texts if code.startswith("E-WEB-")]
    assert {"E-WEB-HOST", "E-WEB-TOKEN", "E-WEB-ORIGIN", "E-WEB-PATH", "E-WEB-BUSY", "E-WEB-LOCKED"} <= set(codes)
    assert all(texts[code]["what"] and texts[code]["do"] for code in codes)
