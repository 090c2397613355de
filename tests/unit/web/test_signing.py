"""Signing in under attack, names however they are spelled, and the last account that keeps the others."""

from __future__ import annotations

import asyncio
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from drivers.clock import LoopClock
from drivers.local.names import person_key
from gateway import audit
from gateway.daemon.server import record_refusals
from gateway.daemon.stream import MOST_LISTENERS, MOST_OF_ONE, Hub
from gateway.errors import BusyError, LastAdministrator
from gateway.users import RefusedSignIns
from gateway.users.refusals import MOST_KEPT
from gateway.web import works
from tests.unit.web.client import Client
from tests.unit.web.services import PASSWORD, PIN, Offered, offered
from tests.unit.web.test_daemon import SITE

LOGIN = "/api/v1/login"
RIGHT, WRONG = {"name": "bert", "pin": PIN}, {"name": "bert", "pin": "000000"}


@pytest.fixture
def offer(tmp_path: Path) -> Offered:
    made = offered(tmp_path, SITE)
    made.service.doors.accounts.put("root", ("service",), password=PASSWORD)
    made.service.doors.accounts.put("bert", ("operator",), password=PASSWORD, pin=PIN)
    return made


def test_a_stranger_locks_nobodys_name_out_elsewhere(offer: Offered) -> None:
    stranger, own = Client(offer.app, address="10.0.0.66"), Client(offer.app, address="10.0.0.7")
    answers = [stranger.post(LOGIN, json=WRONG).status_code for _try in range(40)]
    assert answers == [401] * 5 + [429] * 35
    assert own.post(LOGIN, json=RIGHT).status_code == 200


def test_what_is_refused_unheard_does_not_lengthen_the_wait(offer: Offered) -> None:
    client = Client(offer.app)
    for second in range(60):
        offer.time.s = float(second)
        client.post(LOGIN, json=WRONG)
    offer.time.s = 60.5
    assert client.post(LOGIN, json=RIGHT).status_code == 200


def test_a_browser_that_was_signed_in_has_a_budget_of_its_own(offer: Offered) -> None:
    first = Client(offer.app).post(LOGIN, json=RIGHT)
    kept = next(
        one.split(";")[0] for one in first.headers.get_list("set-cookie") if one.startswith("trueflank-browser")
    )
    for _try in range(10):
        Client(offer.app).post(LOGIN, json=WRONG)  # somebody behind the same address
    assert Client(offer.app).post(LOGIN, json=RIGHT).status_code == 429
    assert Client(offer.app, headers={"cookie": kept}).post(LOGIN, json=RIGHT).status_code == 200
    other = {"name": "root", "password": PASSWORD}
    assert Client(offer.app, headers={"cookie": kept}).post(LOGIN, json=other).status_code == 429


def test_refused_tries_are_summed_beside_the_audit_log_and_told_as_a_metric(offer: Offered) -> None:
    for _try in range(600):
        Client(offer.app, address="10.0.0.66").post(LOGIN, json=WRONG)
    assert offer.notes == []
    headers = offer.signed_in("viewer")
    assert "trueflank_sign_ins_refused_total 600.0" in Client(offer.app, headers=headers).get("/metrics").text
    (one,) = offer.service.doors.refused.take()
    assert (one.name, one.address, one.count) == ("bert", "10.0.0.66", 600)


def test_the_audit_log_gets_one_record_an_hour_in_nobodys_name(tmp_path: Path) -> None:
    refused, now = RefusedSignIns(), datetime(2026, 5, 4, tzinfo=UTC)
    for second in range(300):
        refused.add("bert", "10.0.0.66", now + timedelta(seconds=second))

    async def kept() -> None:
        await record_refusals(refused, tmp_path, LoopClock())
        await record_refusals(refused, tmp_path, LoopClock())

    asyncio.run(kept())
    (entry,) = audit.read_entries(tmp_path)
    assert (entry["action"], entry["actor"]) == ("sign-in-refused", "nobody")
    told = {"name": "bert", "address": "10.0.0.66", "count": 300}
    assert entry["details"] == told | {
        "first": "2026-05-04T00:00:00+00:00",
        "last": "2026-05-04T00:04:59+00:00",
    }


def test_many_names_of_a_stranger_are_one_sum_in_bounded_memory() -> None:
    refused, now = RefusedSignIns(), datetime(2026, 5, 4, tzinfo=UTC)
    for number in range(10_000):
        refused.add(f"name{number}", "10.0.0.66", now)
    found = refused.take()
    assert len(found) == MOST_KEPT + 1
    assert sum(one.count for one in found) == refused.total == 10_000


def test_one_name_has_one_account_however_it_is_spelled(offer: Offered) -> None:
    accounts = offer.service.doors.accounts
    headers = offer.signed_in("service", name="root")
    body = {"roles": ["viewer"], "password": PASSWORD}
    answer = Client(offer.app, headers=headers).request("PUT", "/api/v1/users/BERT", json=body)
    assert (answer.status_code, answer.json()["name"]) == (200, "bert")
    assert [one.name for one in accounts.all()] == ["bert", "root"]
    assert Client(offer.app).post(LOGIN, json={"name": "Bert", "password": PASSWORD}).json()["name"] == "bert"
    assert person_key("Ｒｏｏｔ ") == person_key("root")


def test_a_new_password_ends_the_programs_token(offer: Offered) -> None:
    accounts = offer.service.doors.accounts
    now = datetime(2026, 5, 4, tzinfo=UTC)
    token, _made = accounts.give_token("bert", now)
    accounts.put("bert", ("viewer",), known=accounts.find("bert"))
    assert accounts.by_token(token, now) is not None
    accounts.put("bert", ("viewer",), password=PASSWORD, known=accounts.find("bert"))
    assert accounts.by_token(token, now) is None


def test_the_last_account_that_keeps_the_others_stays_so(offer: Offered) -> None:
    accounts = offer.service.doors.accounts
    headers = offer.signed_in("service", name="root")
    client = Client(offer.app, headers=headers)
    answer = client.request("PUT", "/api/v1/users/root", json={"roles": ["viewer"]})
    assert (answer.status_code, answer.json()["code"]) == (409, "E-USER-LAST")
    assert client.request("DELETE", "/api/v1/users/ROOT").status_code == 409
    with pytest.raises(LastAdministrator):
        accounts.remove("root")


async def test_one_viewer_does_not_take_the_operators_stream() -> None:
    hub = Hub(LoopClock(), dict)
    listeners = [hub.join("anna", operates=False) for _window in range(32)]
    assert hub.listening == MOST_OF_ONE
    assert [one.over for one in listeners].count(True) == 32 - MOST_OF_ONE
    assert "event: replaced" in await listeners[0].next(LoopClock())
    for number in range(MOST_LISTENERS):
        try:
            hub.join(f"viewer{number}", operates=False)
        except BusyError:
            break
    hub.join("otto", operates=True)
    hub.join("olga", operates=True)
    with pytest.raises(BusyError):
        hub.join("one-more", operates=True)


def test_who_gave_an_account_its_secret_is_kept_for_seven_days(offer: Offered) -> None:
    accounts = offer.service.doors.accounts
    begun = datetime(2026, 3, 2, 8, 0, tzinfo=UTC)
    accounts.put("carl", ("approver",), password=PASSWORD, by=("root", begun))
    accounts.put("carl", ("approver", "viewer"), known=accounts.find("carl"), by=("vera", begun))
    carl = accounts.find("carl")
    assert carl is not None
    assert carl.kept_by(begun) == ("root",), "roles alone give nobody the secret"
    assert carl.kept_by(begun + timedelta(days=7, seconds=-1)) == ("root",)
    assert carl.kept_by(begun + timedelta(days=7)) == ()
    later = begun + timedelta(days=6)
    accounts.give_token("carl", later, by="olga")
    accounts.put("carl", ("approver",), pin=PIN, known=accounts.find("carl"), by=("sam", later))
    carl = accounts.find("carl")
    assert carl is not None
    assert carl.kept_by(later) == ("root", "olga", "sam")
    assert carl.kept_by(begun + timedelta(days=8)) == ("olga", "sam")


def test_an_approval_names_who_may_know_the_approvers_secret(offer: Offered, monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[tuple[str, ...]] = []

    async def approve(_folder: object, _clock: object, *, kept_by: tuple[str, ...], **_asked: str) -> tuple[()]:
        given.append(kept_by)
        return ()

    monkeypatch.setattr(works, "approved", approve)
    run = offer.at.store.create("hall-3").run_id
    service = Client(offer.app, headers=offer.signed_in("service", name="root"))
    body = {"roles": ["approver"], "password": PASSWORD, "pin": PIN}
    assert service.request("PUT", "/api/v1/users/carl", json=body).status_code == 200
    operator = Client(offer.app, headers=offer.signed_in("operator", name="bert"))
    asked = {"machine": "hall-3", "by": {"name": "carl", "pin": PIN}}
    assert operator.post(f"/api/v1/sites/hall-3/runs/{run}/approve", json=asked).status_code == 201
    assert given == [("root",)]
