"""Pages and what everybody may ask: what each answers, and with which headers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from drivers.errors import DeviceRefused, catalogue
from drivers.message import Message
from gateway.domain.identity import KnownFact
from gateway.domain.outcomes import Verdict
from gateway.report import render
from gateway.store import Store
from gateway.store.machine_books import IdentityBook
from gateway.views import DeviceView, HeldView, PastRun, RunView, StatusView
from tests.unit.report.attacks import STRINGS
from tests.unit.report.synthetic import axis_material, material
from tests.unit.report.test_page import Outline
from tests.unit.web.client import Client
from tests.unit.web.pictures import status
from tests.unit.web.services import TOKEN, offered
from tests.unit.web.test_daemon import SITE

BEARER = {"Authorization": f"Bearer {TOKEN}"}
ROUTES = ("/healthz", "/", "/api/v1/sites/hall-3/status", "/static/status.css", "/static/status.js")


@pytest.fixture
def client(tmp_path: Path) -> Callable[..., Client]:
    """Who is signed in as a terminal of this computer, unless a test says otherwise."""

    def of(picture: Callable[[], StatusView] = status, base: str = "http://127.0.0.1:8617") -> Client:
        offer = offered(tmp_path, SITE)
        offer.at.shown = picture
        return Client(offer.app, base_url=base, headers=BEARER)

    return of


def test_health_is_short(client: Callable[..., Client]) -> None:
    answer = client().get("/healthz")
    assert (answer.status_code, answer.json()) == (200, {"status": "ok"})


def test_an_alarm_stands_on_the_page_in_the_data_and_in_the_health(client: Callable[..., Client]) -> None:
    alarm = "X1: the live table holds <b>other</b> values"
    due = Message.of("W-VERIFY-DUE", hour="06", tables="C1")
    at = client(lambda: status(devices=(), run=None, alarms=(Message.stored(alarm),), due=due))
    assert at.get("/healthz").json() == {"status": "alarm", "alarms": [alarm]}
    data = at.get("/api/v1/sites/hall-3/status").json()
    assert (data["state"], [one["text"] for one in data["alarms"]]) == ("attention", [alarm])
    assert (data["due"]["code"], data["due"]["text"]) == ("W-VERIFY-DUE", str(due))
    text = Outline(at.get("/status").text).text
    assert text.index(alarm) < text.index("not compared since 06:00 UTC: C1") < text.index("Devices")
    assert "Needs attention" in text


def test_page_shows_devices_run_result_and_past_runs(client: Callable[..., Client]) -> None:
    answer = client().get("/status")
    text = Outline(answer.text).text
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    for wanted in (
        "hall-3-grinder", "Run at work", "controller", "sinumerik-opcua", "lost", "E-LINK-DEADLINE", "no answer within",
        "r-3", "12 of 240", "C1: stop 12 of 240", "better", "no disk", "36.41", "−97 %", "2026-03-02 09:30 UTC",
    ):  # fmt: skip
        assert wanted in text
    assert 'href="/api/v1/sites/hall-3-grinder/runs/r-2/report"' in answer.text
    assert "r-1/report" not in answer.text


def test_a_table_that_is_still_on_stands_first_and_loudest(client: Callable[..., Client]) -> None:
    loud = HeldView("R-HELD-ON: X1, transaction 7: a table is still on", loud=True)
    calm = HeldView("R-HELD-OFF: X1, transaction 8: the table reads back as off", loud=False)
    answer = client(lambda: status(run=None, held=(loud, calm))).get("/status")
    text = Outline(answer.text).text
    assert text.index("Held, still on") < text.index(loud.words) < text.index(calm.words) < text.index("Devices")
    assert f"<strong>{loud.words}</strong>" in answer.text
    data = client(lambda: status(run=None, held=(loud, calm))).get("/api/v1/sites/hall-3/status").json()
    assert (data["state"], data["held"][0]) == ("still-on", asdict(loud))
    assert (
        client(lambda: status(run=None, held=(calm,))).get("/api/v1/sites/hall-3/status").json()["state"] == "attention"
    )


@pytest.mark.parametrize(
    ("tables", "held"), [([("X1", "writing")], False), ([("X1", "on")], False), ([("X1", "unknown")], True), ([], True)]
)
def test_a_push_that_is_at_work_is_not_called_held(
    client: Callable[..., Client], tables: list[tuple[str, str]], held: bool
) -> None:
    loud = HeldView("R-HELD-UNKNOWN: X1, transaction 7: nobody knows whether it is on", loud=True)
    run = RunView("r-3", "push", "X1", 0, 0, None, "2026-03-02T09:00:00+00:00", tables=tuple(tables))
    seen = status(run=run, held=(loud,))
    text = Outline(client(lambda: seen).get("/status").text).text
    assert (loud.words in text, seen.state) == (held, "running")
    assert status(run=None, held=(loud,)).state == "still-on"


def test_page_without_devices_runs_or_trouble_is_calm(client: Callable[..., Client]) -> None:
    text = Outline(client(lambda: status(devices=(), run=None, last_runs=(), result=())).get("/status").text).text
    assert "Ready" in text
    assert "No run yet." in text
    assert "The site names no device." in text


def test_page_tells_what_is_wrong_and_what_to_do(client: Callable[..., Client]) -> None:
    failure = DeviceRefused("E-LINK-DEADLINE", "laser", timeout_s=3).as_record()
    text = Outline(client(lambda: status(failure=failure, trouble=failure, run=None)).get("/status").text).text
    assert "The last run failed" in text
    assert "The devices are not those of the site" in text
    assert text.count("no answer within 3 s") == 2


def test_page_needs_nothing_inline_or_foreign(client: Callable[..., Client]) -> None:
    page = client().get("/status").text
    outline = Outline(page)
    assert "style" not in outline.tags
    assert [name for name, _value in outline.attributes if name == "style" or name.startswith("on")] == []
    links = [value or "" for name, value in outline.attributes if name in {"src", "href"}]
    assert all(link.startswith("/") and not link.startswith("//") for link in links)
    assert {client().get(link).status_code for link in links if link.startswith("/static")} == {200}


def test_status_data(client: Callable[..., Client]) -> None:
    data = client().get("/api/v1/sites/hall-3/status").json()
    assert data["site"] == "hall-3-grinder"
    assert data["run"]["progress"] == 0.05


@pytest.mark.parametrize("name", ["status.css", "status.js", "icon.svg"])
def test_static_files_are_local_and_typed(client: Callable[..., Client], name: str) -> None:
    answer = client().get(f"/static/{name}")
    kind = {"css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}[name.rpartition(".")[2]]
    assert answer.headers["content-type"].startswith(kind)
    assert answer.content


@pytest.mark.parametrize("path", ["/static/app.py", "/static/..%2Fapp.py", "/static/%2e%2e/gate.py", "/static/"])
def test_nothing_but_the_listed_static_files_is_served(client: Callable[..., Client], path: str) -> None:
    assert client().get(path).status_code == 404


RUNS = "/api/v1/sites/hall-3/runs"


def test_report_is_served_as_stored_without_scripts(client: Callable[..., Client], tmp_path: Path) -> None:
    document = render(material())
    run = Store(tmp_path).create("hall-3")
    run.write_text("report.html", document)
    answer = client().get(f"{RUNS}/{run.run_id}/report")
    assert (answer.status_code, answer.text) == (200, document)
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "script-src" not in policy
    assert "sandbox" in policy


ODD = ["r-9", "..", "%2e%2e", "..%2f..%2fetc%2fpasswd", ".hidden", "a b", "a%00", "x" * 200, "%0d%0aSet-Cookie"]


@pytest.mark.parametrize("run_id", ODD)
@pytest.mark.parametrize("rest", ["/report", "", "/stages/proposal", "/files/run.json"])
def test_no_run_no_record_and_no_way_out_of_the_store(
    client: Callable[..., Client], tmp_path: Path, run_id: str, rest: str
) -> None:
    (tmp_path / "secret.txt").write_text("secret", encoding="ascii")
    answer = client().get(f"{RUNS}/{run_id}{rest}")
    assert answer.status_code == 404
    assert answer.json()["code"] in {"E-WEB-REPORT", "E-WEB-RUN", "E-WEB-PATH", "E-WEB-SITE"}


@pytest.mark.parametrize("name", ["..%2frun.json", "run.json", "users.json", "%2e%2e", "gone.png"])
def test_of_a_run_only_its_sealed_files_are_served(client: Callable[..., Client], tmp_path: Path, name: str) -> None:
    run = Store(tmp_path).create("hall-3")
    run.write_text("site.toml", "[site]")
    assert client().get(f"{RUNS}/{run.run_id}/files/site.toml").text == "[site]"
    assert client().get(f"{RUNS}/{run.run_id}/files/{name}").status_code == 404


def test_records_are_served_as_they_are_stored(client: Callable[..., Client], tmp_path: Path) -> None:
    run = Store(tmp_path).create("hall-3")
    axis = axis_material("X1", "mm")
    assert axis.verdict is not None
    verdict = Verdict((replace(axis.verdict, words=(Message.stored("b"),)),), "better")
    digest = run.put("verdict", verdict)
    told = client().get(f"{RUNS}/{run.run_id}/stages/verdict").json()
    assert (told["sha256"], told["type"]) == (digest, "Verdict")
    assert told["record"]["outcome"] == "better"
    assert client().get(f"{RUNS}/{run.run_id}/stages/gone").status_code == 404
    facts = client().get(f"{RUNS}/{run.run_id}").json()
    assert (facts["run_id"], list(facts["stages"]), facts["notes"]) == (run.run_id, ["verdict"], [])
    listed = client().get(f"{RUNS}?most=1").json()
    assert ([one["run_id"] for one in listed["runs"]], listed["more"]) == ([run.run_id], False)


@pytest.mark.parametrize("what", ["site-file", "plan", "audit", "tables", "self-tests", "jobs", "status", "identity"])
def test_everything_that_is_read_answers_for_a_new_site(client: Callable[..., Client], what: str) -> None:
    answer = client().get(f"/api/v1/sites/hall-3/{what}")
    assert answer.status_code == 200
    assert answer.json() is not None


def test_what_was_accepted_of_the_machine_is_told_whole(client: Callable[..., Client], tmp_path: Path) -> None:
    serial, utc = SITE.controller.serial, "2026-02-03T08:15:00+00:00"
    book = IdentityBook(tmp_path)
    book.keep(KnownFact(1, serial, "version", "V4.94", utc))
    book.keep(KnownFact(2, serial, "version", "V4.95", utc, was="V4.94", who="anna", reason="updated"))
    told = client().get("/api/v1/sites/hall-3/identity").json()
    assert told["facts"] == {"serial": serial, "version": "V4.95"}
    one = {"fact": "version", "was": "V4.94", "now": "V4.95", "who": "anna", "reason": "updated", "utc": utc}
    assert told["accepted"] == [one]


@pytest.mark.parametrize(
    "path",
    ["/nothing", "/docs", "/redoc", "/openapi.json", "/api", "/runs", "/favicon.ico", "//evil", "/api/v1/sitesx"],
)
def test_what_is_not_there_is_a_clean_404(client: Callable[..., Client], path: str) -> None:
    answer = client().get(f"http://127.0.0.1:8617{path}")
    assert answer.status_code == 404
    body = answer.json()
    assert body["code"] == "E-WEB-PATH"
    assert body["fields"]["path"] in {path, path.replace("//", "/")}
    assert body["what"]
    assert body["do"]


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("POST", "/"),
        ("DELETE", "/api/v1/login"),
        ("PUT", "/api/v1/sites"),
        ("GET", "/api/v1/logout"),
        ("PATCH", "/healthz"),
    ],
)
def test_wrong_method_is_405_and_names_the_right_one(client: Callable[..., Client], method: str, path: str) -> None:
    answer = client().request(method, path, headers=BEARER)
    assert answer.status_code == 405
    assert answer.json()["code"] == "E-WEB-METHOD"
    assert answer.headers["allow"]


@pytest.mark.parametrize("path", [*ROUTES, "/nothing", "/static/no"])
def test_every_answer_carries_the_headers(client: Callable[..., Client], path: str) -> None:
    headers = client().get(path).headers
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["x-frame-options"] == "DENY"
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cache-control"] == ("no-cache" if path == "/" else "no-store")
    policy = headers["content-security-policy"]
    assert "frame-ancestors 'none'" in policy
    assert path.endswith("/report") or policy.startswith("default-src 'self';")
    assert "unsafe-eval" not in policy
    assert "access-control-allow-origin" not in headers


@pytest.mark.parametrize(
    "host", ["127.0.0.1", "127.0.0.1:8617", "localhost", "LOCALHOST:80", "[::1]:8617", "localhost:1"]
)
def test_own_names_may_come_in(client: Callable[..., Client], host: str) -> None:
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
def test_foreign_host_names_stay_out(client: Callable[..., Client], host: str, path: str) -> None:
    answer = client().get(path, headers={"Host": host})
    assert answer.status_code == 400
    assert answer.json()["code"] == "E-WEB-HOST"
    assert answer.headers["x-content-type-options"] == "nosniff"


@pytest.mark.parametrize("attack", STRINGS)
def test_no_name_becomes_markup(client: Callable[..., Client], attack: str) -> None:
    error = {"code": attack, "where": attack, "fields": {attack: attack}, "what": attack, "do": attack}
    view = StatusView(
        attack, attack, attack,
        (DeviceView(attack, attack, attack, attack, error),),
        RunView(attack, attack, attack, 1, 2, attack, attack),
        (PastRun(attack, attack, attack, attack, report=True),),
        error,
    )  # fmt: skip
    outline = Outline(client(lambda: view).get("/status").text)
    tags = {tag: outline.tags.get(tag, 0) for tag in ("script", "img", "svg", "iframe", "link", "meta", "a", "body")}
    assert tags == {"script": 1, "img": 0, "svg": 0, "iframe": 0, "link": 2, "meta": 3, "a": 1, "body": 1}
    assert [name for name, _value in outline.attributes if name.startswith("on")] == []
    links = [value or "" for name, value in outline.attributes if name in {"src", "href"}]
    assert all(link.startswith("/") and not link.startswith("//") for link in links)


def test_every_code_used_here_has_words(client: Callable[..., Client]) -> None:
    texts = catalogue()
    codes = [code for code in texts if code.startswith("E-WEB-")]
    assert {"E-WEB-HOST", "E-WEB-TOKEN", "E-WEB-ORIGIN", "E-WEB-PATH", "E-WEB-BUSY", "E-WEB-LOCKED"} <= set(codes)
    assert all(texts[code]["what"] and texts[code]["do"] for code in codes)
