"""Who may: every route x every role, sessions, keys, tokens, PINs, limits, and approval by a second person."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.routing import APIRoute

from gateway.store import Store
from gateway.users import ROLES, UserRole
from gateway.web import app as application
from gateway.web import works
from tests.unit.web.client import Client
from tests.unit.web.services import PASSWORD, PIN, TOKEN, Offered, offered
from tests.unit.web.test_daemon import SITE

PAGE = {"/", "/static/{build}/{folder}/{name}"}
OPEN = {*PAGE, "/healthz", "/static/{name}", "/api/v1/login", "/api/v1/first-start"}
FILL = {
    "site": "hall-3",
    "run": "r",
    "stage": "s",
    "name": "n",
    "job": "1",
    "axis": "X1",
    "token": "t",
    "ended": "e",
    "part": "p",
    "kind": "csv",
}
AT = "/api/v1/sites/hall-3"


@pytest.fixture
def offer(tmp_path: Path) -> Offered:
    return offered(tmp_path, SITE)


def _roles_of(route: APIRoute) -> set[frozenset[UserRole]]:
    """What each door of a route asks for."""
    found: set[frozenset[UserRole]] = set()
    ahead = list(route.dependant.dependencies)
    while ahead:
        one = ahead.pop()
        ahead += one.dependencies
        if hasattr(one.call, "roles"):
            found.add(frozenset(one.call.roles))
    return found


def _routes(app: Any) -> Iterator[APIRoute]:
    for route in app.routes:
        if isinstance(route, APIRoute):
            yield route
        elif hasattr(route, "original_router"):
            yield from _routes(route.original_router)


def _every(app: Any) -> list[tuple[str, str, set[frozenset[UserRole]]]]:
    paths = app.openapi()["paths"]
    doors = {(route.path, method): _roles_of(route) for route in _routes(app) for method in route.methods or ()}
    listed = [(path, method.upper()) for path, found in paths.items() for method in found]
    return [(path, method, _door(doors, path, method)) for path, method in listed]


def _door(doors: dict[tuple[str, str], set[frozenset[UserRole]]], path: str, method: str) -> set[frozenset[UserRole]]:
    """Routers name their routes without what stands before them."""
    fitting = [roles for (end, how), roles in doors.items() if how == method and path.endswith(end) and end != "/"]
    return max(fitting, key=len)


def test_every_route_but_the_open_ones_has_a_door_and_every_role_meets_it(offer: Offered) -> None:
    app = offer.app
    every = [one for one in _every(app) if one[0] not in OPEN]
    assert len(every) > 30
    wrong = []
    for path, method, doors in every:
        where = path.format(**FILL)
        assert doors, f"{method} {path} has no door"
        for role in (None, *ROLES):
            headers = {} if role is None else offer.signed_in(role)
            status = Client(app, headers=headers).request(method, where, json={}).status_code
            may = role is not None and all(role in door or "viewer" in door for door in doors)
            fits = status == 401 if role is None else (status not in (401, 403)) if may else status == 403
            wrong += [] if fits else [(method, path, role, status)]
    assert wrong == []


def test_who_is_not_signed_in_sees_the_sign_in_page_and_nothing_else(offer: Offered) -> None:
    client = Client(offer.app)
    page = client.get("/")
    assert page.status_code == 200
    assert "hall-3" not in page.text
    answer = client.get("/status")
    assert answer.status_code == 401
    assert "hall-3" not in answer.text


def test_first_start_then_sign_in_then_out(offer: Offered, tmp_path: Path) -> None:
    client = Client(offer.app)
    token = offer.service.doors.accounts.first_token()
    assert (tmp_path / "service" / "first-start.token").read_text(encoding="ascii").strip() == token
    wrong = client.post("/api/v1/first-start", json={"token": "x", "name": "anna", "password": PASSWORD})
    assert (wrong.status_code, wrong.json()["code"]) == (401, "E-USER-FIRST")
    made = client.post("/api/v1/first-start", json={"token": token, "name": "anna", "password": PASSWORD})
    assert (made.status_code, made.json()["roles"]) == (200, sorted(ROLES))
    cookie = made.headers["set-cookie"]
    assert all(word in cookie for word in ("HttpOnly", "SameSite=strict", "Path=/"))
    assert not (tmp_path / "service" / "first-start.token").exists()
    again = client.post("/api/v1/first-start", json={"token": token, "name": "eve", "password": PASSWORD})
    assert again.status_code == 401
    signed = client.post("/api/v1/login", json={"name": "anna", "password": PASSWORD})
    headers = {"cookie": signed.headers["set-cookie"].split(";")[0], "x-csrf-token": signed.json()["csrf"]}
    assert client.get("/api/v1/me", headers=headers).json()["name"] == "anna"
    assert client.post("/api/v1/logout", headers=headers, json={}).status_code == 200
    assert client.get("/api/v1/me", headers=headers).status_code == 401
    assert [action for action, _who in offer.notes] == ["first-account", "sign-in", "sign-out"]


def test_a_session_ends_by_itself_and_looking_who_i_am_does_not_keep_it(offer: Offered) -> None:
    client, headers = Client(offer.app), offer.signed_in("viewer")
    offer.time.s = 800.0
    assert client.get(f"{AT}/status", headers=headers).status_code == 200
    offer.time.s = 1600.0
    assert client.get("/api/v1/sites", headers=headers).status_code == 200
    offer.time.s = 2501.0
    answer = client.get(f"{AT}/status", headers=headers)
    assert (answer.status_code, answer.json()["code"]) == (401, "E-WEB-LOGIN")


def test_no_session_lasts_longer_than_a_shift(offer: Offered) -> None:
    client, headers = Client(offer.app), offer.signed_in("viewer")
    for hour in range(48):
        offer.time.s = hour * 890.0
        assert client.get("/api/v1/sites", headers=headers).status_code == 200
    offer.time.s = 12 * 3600.0
    assert client.get("/api/v1/sites", headers=headers).status_code == 401


@pytest.mark.parametrize(
    ("headers", "code"),
    [
        ({"x-csrf-token": ""}, "E-WEB-CSRF"),
        ({"x-csrf-token": "guessed"}, "E-WEB-CSRF"),
        ({"x-csrf-token": "\u00e4"}, "E-WEB-CSRF"),
        ({"Origin": "http://attack.example"}, "E-WEB-ORIGIN"),
        ({"Origin": "null"}, "E-WEB-ORIGIN"),
        ({"Origin": "http://127.0.0.1:9999"}, "E-WEB-ORIGIN"),
        ({"Origin": "https://127.0.0.1:8617"}, "E-WEB-ORIGIN"),
        ({"Sec-Fetch-Site": "cross-site"}, "E-WEB-ORIGIN"),
        ({"Sec-Fetch-Site": "same-site"}, "E-WEB-ORIGIN"),
    ],
)
def test_another_page_cannot_use_a_session(offer: Offered, headers: dict[str, str], code: str) -> None:
    sent = {name: value.encode("latin-1") for name, value in {**offer.signed_in("operator"), **headers}.items()}
    answer = Client(offer.app).post(f"{AT}/commands/run", json={}, headers=sent)
    assert (answer.status_code, answer.json()["code"]) == (403, code)
    assert offer.at.given == []


@pytest.mark.parametrize(
    "header", ["", "Bearer", "Bearer ", f"Bearer {TOKEN}x", f"Bearer {TOKEN[:-1]}", f"Basic {TOKEN}", TOKEN]
)
def test_without_a_known_token_nothing_starts(offer: Offered, header: str) -> None:
    answer = Client(offer.app).post(f"{AT}/commands/run", json={}, headers={"Authorization": header})
    assert answer.status_code == 401
    assert answer.headers["www-authenticate"] == "Bearer"
    assert TOKEN not in answer.text
    assert offer.at.given == []


def test_an_empty_terminal_token_opens_nothing(tmp_path: Path) -> None:
    app = offered(tmp_path, SITE, terminal="").app
    assert Client(app, headers={"Authorization": "Bearer "}).get("/api/v1/sites").status_code == 401


def test_accounts_are_kept_without_secrets_and_a_program_gets_a_token_once(offer: Offered, tmp_path: Path) -> None:
    client = Client(offer.app, headers=offer.signed_in("service"))
    body = {"roles": ["viewer"], "password": PASSWORD, "pin": PIN}
    assert client.request("PUT", "/api/v1/users/scada", json=body).json()["pin"] is True
    token = client.post("/api/v1/users/scada/token", json={}).json()["token"]
    listed = client.get("/api/v1/users")
    (told,) = listed.json()
    kept = {"name": "scada", "roles": ["viewer"], "pin": True, "token": True, "second_factor": False, "system": []}
    assert {key: told[key] for key in told if key != "tokens"} == kept
    assert [set(one) for one in told["tokens"]] == [{"id", "made_utc", "ends_utc", "used_utc"}]
    kept = (tmp_path / "service" / "users.json").read_text(encoding="ascii")
    assert all(secret not in kept + listed.text for secret in (PASSWORD, PIN, token))
    bearer = {"Authorization": f"Bearer {token}"}
    assert Client(offer.app, headers=bearer).get(f"{AT}/status").status_code == 200
    assert Client(offer.app, headers=bearer).post(f"{AT}/commands/run", json={}).status_code == 403
    changed = client.request("PUT", "/api/v1/users/scada", json={"roles": ["viewer", "operator"]})
    assert changed.json()["token"] is True
    assert client.request("DELETE", "/api/v1/users/scada").status_code == 200
    assert client.get("/api/v1/users").json() == []


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ({"roles": ["viewer"], "password": "short"}, "E-USER-PASSWORD"),
        ({"roles": ["viewer"]}, "E-USER-PASSWORD"),
        ({"roles": ["viewer"], "password": PASSWORD, "pin": "12ab56"}, "E-USER-PIN"),
        ({"roles": ["viewer"], "password": PASSWORD, "pin": "12345"}, "E-USER-PIN"),
        ({"roles": ["king"], "password": PASSWORD}, "E-WEB-BODY"),
        ({"roles": [], "password": PASSWORD}, "E-WEB-BODY"),
        ({"roles": ["viewer"], "password": PASSWORD, "more": 1}, "E-WEB-BODY"),
        ({"roles": ["viewer"], "password": "p" * 300}, "E-WEB-BODY"),
    ],
)
def test_an_account_that_cannot_be_is_refused_without_its_secrets(
    offer: Offered, body: dict[str, Any], code: str
) -> None:
    answer = Client(offer.app, headers=offer.signed_in("service")).request("PUT", "/api/v1/users/bert", json=body)
    assert (answer.status_code, answer.json()["code"]) == (422, code)
    assert str(body.get("password", "?")) not in answer.text


def test_after_five_wrong_tries_even_the_right_pin_waits(offer: Offered) -> None:
    offer.service.doors.accounts.put("bert", ("operator",), password=PASSWORD, pin=PIN)
    client = Client(offer.app)
    for _try in range(5):
        assert client.post("/api/v1/login", json={"name": "bert", "pin": "000000"}).status_code == 401
    answer = client.post("/api/v1/login", json={"name": "bert", "pin": PIN})
    assert (answer.status_code, answer.json()["code"]) == (429, "E-USER-WAIT")
    offer.time.s = 61.0
    assert client.post("/api/v1/login", json={"name": "bert", "pin": PIN}).status_code == 200
    assert client.post("/api/v1/login", json={"name": "nobody", "password": PASSWORD}).status_code == 401
    assert client.post("/api/v1/login", json={"name": "bert"}).status_code == 401


def test_a_second_person_approves_over_the_firsts_session_and_leaves_it(
    offer: Offered, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    offer.service.doors.accounts.put("carl", ("approver",), password=PASSWORD, pin=PIN)
    offer.service.doors.accounts.put("bert", ("operator",), password=PASSWORD)
    asked: list[dict[str, Any]] = []

    async def approve(_folder: Any, _clock: Any, **more: Any) -> tuple[()]:
        asked.append(more)
        return ()

    monkeypatch.setattr(works, "approved", approve)
    run = Store(tmp_path).create("hall-3").run_id
    client = Client(offer.app, headers=offer.signed_in("operator", name="bert"))
    where = f"{AT}/runs/{run}/approve"
    assert client.post(where, json={"machine": "hall-3"}).json()["code"] == "E-WEB-ROLE"
    by = {"name": "bert", "password": PASSWORD}
    assert client.post(where, json={"machine": "hall-3", "by": by}).json()["code"] == "E-WEB-ROLE"
    assert client.post(where, json={"machine": "hall-3", "by": {"name": "carl", "pin": "999999"}}).status_code == 401
    assert client.post(where, json={"machine": "hall-3", "by": {"name": "carl", "pin": PIN}}).status_code == 201
    carl = offer.service.doors.accounts.find("carl")
    assert carl is not None
    assert carl.key is not None
    (given,) = asked
    assert given.pop("signer").public == carl.key.public
    assert given == {"table": "", "typed_name": "hall-3", "actor": "carl", "kept_by": ()}
    assert client.get("/api/v1/me").json()["name"] == "bert"


def test_commands_are_given_in_the_name_of_who_is_signed_in_and_a_key_gives_one_answer(offer: Offered) -> None:
    client = Client(offer.app, headers=offer.signed_in("operator", name="bert"))
    for command, body in (
        ("run", {}), ("measure", {}), ("close", {}), ("doctor", {}), ("verify-table", {}), ("self-test", {}),
        ("disable", {"axis": "X1"}), ("roll-back", {"table": "X1"}), ("recover", {}),
    ):  # fmt: skip
        assert client.post(f"{AT}/commands/{command}", json=body).status_code == 202
        assert offer.at.given[-1] == (command, "bert")
    key = {"Idempotency-Key": "once"}
    first = client.post(f"{AT}/commands/disable", json={"axis": "X1"}, headers=key)
    again = client.post(f"{AT}/commands/disable", json={"axis": "X1"}, headers=key)
    assert first.json() == again.json()
    other = client.post(f"{AT}/commands/disable", json={"axis": "C1"}, headers=key)
    assert (other.status_code, other.json()["code"]) == (409, "E-WEB-KEY")
    offer.at.busy = True
    assert client.post(f"{AT}/commands/run", json={}).json()["code"] == "E-WEB-BUSY"


def test_notes_and_mountings_are_kept_by_name_and_shown_with_the_run(offer: Offered, tmp_path: Path) -> None:
    run = Store(tmp_path).create("hall-3").run_id
    client = Client(offer.app, headers=offer.signed_in("operator", name="bert"))
    assert client.post(f"{AT}/runs/{run}/notes", json={"text": "coolant was on"}).status_code == 201
    assert client.post(f"{AT}/runs/{run}/mountings", json={"setup": "EXX"}).status_code == 201
    notes = client.get(f"{AT}/runs/{run}").json()["notes"]
    assert [(one["action"], one["actor"]) for one in notes] == [("note", "bert"), ("mounting-confirmed", "bert")]
    assert client.post(f"{AT}/retake", json={"axis": "X1", "target": 10.0, "approach": 1}).status_code == 200
    assert offer.at.asked == [("X1", (10.0, 0, 1))]
    assert client.post(f"{AT}/stop", json={}).json() == {"asked": True}
    assert offer.at.stopped == ["bert at the page"]


@pytest.mark.parametrize(
    "headers", [{"Content-Length": "70000"}, {"Content-Length": "-1"}, {"Content-Length": "9" * 12}]
)
def test_large_or_odd_bodies_are_refused_unread(offer: Offered, headers: dict[str, str]) -> None:
    answer = Client(offer.app).post("/api/v1/login", headers=headers)
    assert (answer.status_code, answer.json()["code"]) == (413, "E-WEB-SIZE")


@pytest.mark.parametrize("content", [b"{", b"[]", b"\xff\xfe", b'{"name": NaN}', b"[" * 5000])
def test_what_is_no_body_is_a_clean_refusal(offer: Offered, content: bytes) -> None:
    answer = Client(offer.app).post("/api/v1/login", content=content, headers={"content-type": "application/json"})
    assert (answer.status_code, answer.json()["code"]) == (422, "E-WEB-BODY")


def test_who_asks_too_often_waits_but_health_answers(offer: Offered) -> None:
    client = Client(offer.app)
    for _ask in range(600):
        offer.service.doors.asks.count("address 127.0.0.1")
    assert client.get("/api/v1/sites").status_code == 429
    assert client.get("/healthz").status_code == 200
    offer.time.s = 11.0
    assert client.get("/api/v1/sites").status_code == 401


def test_names_of_the_site_file_may_come_in_and_https_is_said(tmp_path: Path) -> None:
    app = offered(tmp_path, SITE, hosts=("gateway.hall",), secure=True).app
    headers = {"Host": "gateway.hall:8617", "Authorization": f"Bearer {TOKEN}"}
    client = Client(app, base_url="https://gateway.hall:8617", headers=headers)
    answer = client.get("/healthz")
    assert answer.status_code == 200
    assert "strict-transport-security" in answer.headers
    assert client.post(f"{AT}/stop", json={}, headers={"Origin": "https://gateway.hall:8617"}).status_code == 200
    assert client.post(f"{AT}/stop", json={}, headers={"Origin": "http://gateway.hall:8617"}).status_code == 403
    assert client.get("/healthz", headers={"Host": "other.hall"}).status_code == 400


def test_the_described_routes_are_those_that_are_shipped(offer: Offered) -> None:
    shipped = json.loads((Path(__file__).parents[3] / "docs" / "openapi.json").read_text(encoding="utf-8"))
    assert offer.app.openapi() == shipped, "write it anew: trueflank docs schema --api > docs/openapi.json"
    assert shipped["info"]["version"] == application.API_VERSION
