"""Accounts over time: names made one, tokens that end, own sessions, second factor, leaked passwords."""

from __future__ import annotations

import base64
import hashlib
import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from drivers.message import render
from gateway.errors import InvalidAccount, NotSignedIn, StoreError
from gateway.users import UserAccounts
from gateway.users.leaked import is_leaked
from gateway.users.second_factor import code_at, factor_uri, new_factor, step_of
from tests.unit.web.client import Client
from tests.unit.web.services import CHEAP, PASSWORD, PIN, Offered, offered
from tests.unit.web.test_daemon import SITE

NOW = datetime(2026, 3, 2, 8, 0, tzinfo=UTC)
LOGIN = "/api/v1/login"
OLDER_TOKEN = "an-older-token-of-a-program"


@pytest.fixture
def accounts(tmp_path: Path) -> UserAccounts:
    return UserAccounts(tmp_path, CHEAP)


@pytest.fixture
def offer(tmp_path: Path) -> Offered:
    made = offered(tmp_path, SITE)
    made.service.doors.accounts.put("root", ("service",), password=PASSWORD)
    return made


def written(root: Path, *users: dict[str, Any]) -> None:
    """Accounts as schema 1 wrote them: one token without an end."""
    (root / "service").mkdir()
    (root / "service" / "users.json").write_text(json.dumps({"schema": 1, "users": users}))


def older(name: str, *roles: str, token: str = "") -> dict[str, Any]:
    digest = hashlib.sha256(token.encode()).hexdigest() if token else ""
    return {"name": name, "roles": roles, "password": CHEAP.hashed(f"{name} {PASSWORD}"), "pin": "", "token": digest}


def test_accounts_of_one_name_in_several_spellings_are_told_apart_and_keep_their_passwords(
    accounts: UserAccounts, tmp_path: Path
) -> None:
    kept = older("OTTO", "approver", "service"), older("Otto", "approver"), older("otto", "operator", "approver")
    written(tmp_path, *kept, older("otto-2", "viewer"))
    told = accounts.migrate(NOW)
    found = {one.name: one.roles for one in accounts.all()}
    assert found == {
        "OTTO": ("approver", "service"),
        "Otto-3": ("viewer",),
        "otto-4": ("operator",),
        "otto-2": ("viewer",),
    }
    assert [(one.fields["was"], one.fields["now"]) for one in told] == [("Otto", "Otto-3"), ("otto", "otto-4")]
    assert "Otto" in render(told[0])
    assert accounts.by_secret("oTTo", password=f"OTTO {PASSWORD}").name == "OTTO"
    assert accounts.by_secret("OTTO-4", password=f"otto {PASSWORD}").name == "otto-4"
    assert accounts.migrate(NOW) == ()


def test_a_token_of_an_older_version_ends_after_ninety_days(accounts: UserAccounts, tmp_path: Path) -> None:
    written(tmp_path, older("root", "service", token=OLDER_TOKEN))
    assert accounts.by_token(OLDER_TOKEN, NOW) is not None
    accounts.migrate(NOW)
    assert accounts.by_token(OLDER_TOKEN, NOW + timedelta(days=89)) is not None
    assert accounts.by_token(OLDER_TOKEN, NOW + timedelta(days=90)) is None


def test_a_token_ends_is_listed_with_its_last_use_and_can_be_ended(offer: Offered) -> None:
    doors, utc = offer.service.doors, offer.service.clock.utc()
    client = Client(offer.app, headers=offer.signed_in("service", name="root"))
    given = client.post("/api/v1/users/root/token", json={"days": 7}).json()
    assert datetime.fromisoformat(given["ends_utc"]) - datetime.fromisoformat(given["made_utc"]) == timedelta(days=7)
    assert client.get("/api/v1/users").json()[0]["tokens"][0]["used_utc"] == ""
    assert Client(offer.app, headers={"Authorization": f"Bearer {given['token']}"}).get("/api/v1/me").status_code == 200
    (told,) = client.get("/api/v1/users").json()[0]["tokens"]
    assert told["used_utc"] >= utc.isoformat(timespec="seconds")
    doors.accounts.keep_uses()
    again = UserAccounts(offer.at.store.root, CHEAP).find("root")
    assert again is not None
    assert again.tokens[0].used_utc == told["used_utc"]
    assert doors.accounts.by_token(given["token"], utc + timedelta(days=8)) is None
    where = f"/api/v1/users/root/tokens/{given['id']}"
    assert client.request("DELETE", where).status_code == 200
    assert client.request("DELETE", where).json()["code"] == "E-USER-NO-TOKEN"
    assert doors.accounts.by_token(given["token"], utc) is None


def test_a_token_is_bounded_in_days_and_number(accounts: UserAccounts) -> None:
    accounts.put("root", ("service",), password=PASSWORD)
    for days in (0, 367):
        with pytest.raises(InvalidAccount) as caught:
            accounts.give_token("root", NOW, days=days)
        assert caught.value.code == "E-USER-TOKEN-DAYS"
    for _number in range(20):
        accounts.give_token("root", NOW, days=1)
    with pytest.raises(InvalidAccount) as caught:
        accounts.give_token("root", NOW)
    assert caught.value.code == "E-USER-TOKENS"
    accounts.give_token("root", NOW + timedelta(days=1))
    known = accounts.find("root")
    assert known is not None
    assert len(known.tokens) == 1, "those that have ended are gone"


def test_a_name_at_an_operating_system_means_one_person(accounts: UserAccounts) -> None:
    accounts.put("anna", ("approver",), password=PASSWORD, system=["HALL3\\aschmidt", "aschmidt"])
    accounts.put("bert", ("operator",), password=PASSWORD)
    for name, system in (("bert", ["ASchmidt"]), ("bert", ["Anna"]), ("aschmidt", [])):
        with pytest.raises(InvalidAccount) as caught:
            accounts.put(name, ("operator",), password=PASSWORD, known=accounts.find(name), system=system)
        assert caught.value.code == "E-USER-SYSTEM"
    assert [accounts.ring.person_named(name) for name in ("ASCHMIDT", "ANNA", "carl")] == ["anna", "anna", "carl"]
    accounts.put("anna", ("approver",), known=accounts.find("anna"))
    assert accounts.ring.person_named("aschmidt") == "anna", "what is left out stays"


def test_own_sessions_are_listed_and_ended(offer: Offered) -> None:
    own = Client(offer.app, headers={**offer.signed_in("operator", name="bert"), "user-agent": "one"})
    other, third = offer.signed_in("operator", name="BERT"), offer.signed_in("operator", name="bert")
    stranger = offer.signed_in("viewer", name="carl")
    offer.time.s = 30.0
    told = own.get("/api/v1/me/sessions").json()
    assert [one["this"] for one in told].count(True) == 1
    assert [(one["begun_s"], one["seen_s"]) for one in told if not one["this"]] == [(30, 30), (30, 30)]
    (mine,) = (one["id"] for one in Client(offer.app, headers=other).get("/api/v1/me/sessions").json() if one["this"])
    assert own.request("DELETE", f"/api/v1/me/sessions/{mine}").json() == {"ended": 1}
    assert Client(offer.app, headers=other).get("/api/v1/me").status_code == 401
    assert own.request("DELETE", "/api/v1/me/sessions/others").json() == {"ended": 1}
    assert Client(offer.app, headers=third).get("/api/v1/me").status_code == 401
    assert Client(offer.app, headers=stranger).get("/api/v1/me").status_code == 200
    foreign = offer.service.doors.sessions.of("carl")[0].id
    assert own.request("DELETE", f"/api/v1/me/sessions/{foreign}").json()["code"] == "E-USER-NO-SESSION"


def test_the_own_secret_is_changed_with_the_old_one_and_ends_every_other_session(offer: Offered) -> None:
    accounts = offer.service.doors.accounts
    accounts.put("bert", ("operator",), password=PASSWORD, pin=PIN)
    token, _made = accounts.give_token("bert", offer.service.clock.utc())
    headers, other = offer.signed_in("operator", name="bert"), offer.signed_in("operator", name="bert")
    client, new = Client(offer.app, headers=headers), "another long sentence"
    wrong = {"old": {"name": "bert", "pin": "000000"}, "password": new}
    assert client.request("PUT", "/api/v1/me/secret", json=wrong).json()["code"] == "E-USER-SECRET"
    right = {"old": {"name": "root", "pin": PIN}, "password": new}
    assert client.request("PUT", "/api/v1/me/secret", json=right).json() == {"name": "bert"}
    assert [Client(offer.app, headers=each).get("/api/v1/me").status_code for each in (headers, other)] == [200, 401]
    assert accounts.by_secret("bert", password=new).name == "bert"
    assert accounts.by_token(token, offer.service.clock.utc()) is None
    bearer = Client(offer.app, headers={"Authorization": f"Bearer {accounts.give_token('bert', NOW)[0]}"})
    assert bearer.request("PUT", "/api/v1/me/secret", json=right).status_code == 401, "a program has no secret"


# RFC 6238, appendix B, for SHA-1: the last six of its eight digits, at these seconds.
RFC = {59: "287082", 1111111109: "081804", 1111111111: "050471", 1234567890: "005924", 2000000000: "279037"}
RFC_SECRET = base64.b32encode(b"12345678901234567890").decode()


@pytest.mark.parametrize(("second", "code"), list(RFC.items()))
def test_codes_are_those_of_the_standard(second: int, code: str) -> None:
    moment = datetime.fromtimestamp(second, UTC)
    assert code_at(RFC_SECRET, moment) == code
    step = second // 30
    assert [step_of(RFC_SECRET, code, moment + timedelta(seconds=late)) for late in (-30, 0, 30)] == [step] * 3
    assert [step_of(RFC_SECRET, code, moment + timedelta(seconds=late)) for late in (-90, 90)] == [0, 0]
    assert step_of(RFC_SECRET, code, moment, after=step) == 0


@pytest.mark.parametrize("code", ["", "28708", "2870820", "２８７０８２", "28708x", "-87082"])
def test_what_is_no_code_is_none(code: str) -> None:
    assert step_of(RFC_SECRET, code, datetime.fromtimestamp(59, UTC)) == 0


def test_with_a_second_factor_a_secret_alone_signs_nobody_in_and_no_code_counts_twice(offer: Offered) -> None:
    accounts, utc = offer.service.doors.accounts, offer.service.clock.utc
    accounts.put("carl", ("approver",), pin=PIN, password=PASSWORD)
    client = Client(offer.app, headers=offer.signed_in("approver", name="carl"))
    secret = client.get("/api/v1/me/second-factor").json()["secret"]
    proof = {"name": "carl", "pin": PIN}
    wrong = {"proof": proof, "secret": secret, "code": "000000" if code_at(secret, utc()) != "000000" else "1"}
    assert client.request("PUT", "/api/v1/me/second-factor", json=wrong).json()["code"] == "E-USER-FACTOR"
    right = {"proof": proof, "secret": secret, "code": code_at(secret, utc() - timedelta(seconds=30))}
    assert client.request("PUT", "/api/v1/me/second-factor", json=right).json()["second_factor"] is True
    signing = Client(offer.app)
    missing = signing.post(LOGIN, json=proof)
    assert (missing.status_code, missing.json()["code"]) == (428, "E-USER-CODE")
    again = {**proof, "code": right["code"]}
    assert signing.post(LOGIN, json=again).json()["code"] == "E-USER-CODE", "it was used to begin with"
    fresh = {**proof, "code": code_at(secret, utc() + timedelta(seconds=30))}
    assert signing.post(LOGIN, json=fresh).status_code == 200
    assert signing.post(LOGIN, json=fresh).json()["code"] == "E-USER-CODE"


def test_a_lost_second_factor_is_taken_away_by_who_then_counts_as_knowing_the_account(accounts: UserAccounts) -> None:
    accounts.put("carl", ("approver",), password=PASSWORD)
    secret = new_factor()
    accounts.set_factor("carl", secret, code_at(secret, NOW), NOW)
    with pytest.raises(NotSignedIn):
        accounts.take_code("carl", "", NOW)
    accounts.put("carl", ("approver",), known=accounts.find("carl"), by=("root", NOW), forget_factor=True)
    accounts.take_code("carl", "", NOW)
    carl = accounts.find("carl")
    assert carl is not None
    assert carl.kept_by(NOW) == ("root",)


def test_an_authenticator_is_told_whose_secret_it_is() -> None:
    told = factor_uri("A" * 32, "Ann B")
    assert told == f"otpauth://totp/trueflank:Ann%20B?secret={'A' * 32}&issuer=trueflank"


LEAKED = ("password12", "0123456789", "a long sentence", "qwertzuiop", "correct horse")
NOT_LEAKED = ("another long sentence", "no such password", "Password12")


def digest(password: str) -> str:
    return hashlib.sha1(password.encode(), usedforsecurity=False).hexdigest().upper()


@pytest.fixture(params=["file", "folder", "windows lines"])
def listed(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A thousand hashes beside those of LEAKED, in one file or in a folder by prefix."""
    others = (digest(f"other {number}") for number in range(1000))
    hashes = sorted((*map(digest, LEAKED), *others))
    place, end = tmp_path / "leaked", "\r\n" if request.param == "windows lines" else "\n"
    if request.param != "folder":
        place.write_bytes("".join(f"{one}:{number + 1}{end}" for number, one in enumerate(hashes)).encode())
        return place
    place.mkdir()
    for prefix in {digest(one)[:5] for one in (*LEAKED, *NOT_LEAKED)}:
        rest = [f"{one[5:]}:3" for one in hashes if one.startswith(prefix)]
        (place / f"{prefix}.txt").write_text("\n".join(rest) + "\n")
    return place


def test_a_leaked_password_is_found_in_a_list_of_either_form(listed: Path) -> None:
    assert [is_leaked(one, listed) for one in LEAKED] == [True] * len(LEAKED)
    assert [is_leaked(one, listed) for one in NOT_LEAKED] == [False] * len(NOT_LEAKED)


def test_every_line_of_a_sorted_list_is_found_by_halving(tmp_path: Path) -> None:
    passwords = [f"some password {number}" for number in range(70)]
    for count in (0, 1, 2, 3, 70):
        place = tmp_path / f"leaked{count}"
        lines = sorted(digest(one) + f":{7 ** (number % 9)}" for number, one in enumerate(passwords[:count]))
        place.write_text("\n".join(lines) + "\n" if lines else "")
        assert [is_leaked(one, place) for one in passwords] == [True] * count + [False] * (70 - count)


def test_nobody_gets_a_leaked_password_and_a_missing_list_is_said(tmp_path: Path) -> None:
    listed = tmp_path / "leaked"
    accounts = UserAccounts(tmp_path, CHEAP, listed)
    with pytest.raises(StoreError) as caught:
        accounts.put("root", ("service",), password="password12")
    assert caught.value.code == "E-USER-LIST"
    listed.write_text(f"{digest('password12')}:9\n")
    with pytest.raises(InvalidAccount) as refused:
        accounts.put("root", ("service",), password="password12")
    assert refused.value.code == "E-USER-LEAKED"
    accounts.put("root", ("service",), password=PASSWORD)
