"""Who can write the store alone adds no account, approval or proposal: keys, seals, and what is trusted where."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from drivers.errors import TrueflankError
from gateway import audit
from gateway.approve import Approvals, give_consent
from gateway.domain.proposals import Approval
from gateway.errors import CorruptRecord
from gateway.push import plan_hash
from gateway.store.disk import read_whole
from gateway.users import KeyRing, Signer, UserAccounts, first_token_path
from gateway.users.signatures import is_signature, new_key, seal, unseal
from gateway.workflow.run import audit_trail, stages
from tests.unit.approve.test_approve import CHANGE, MACHINE
from tests.unit.approve.test_consents import PROPOSAL, At
from tests.unit.push.double import bench as push_bench
from tests.unit.web.services import CHEAP, PASSWORD, PIN

# RFC 8032, 7.1, tests 1 and 2: private key, public key, message, signature.
RFC = [
    (
        "9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60",
        "d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a",
        "",
        "e5564300c360ac729086e2cc806e828a84877f1eb8e5d974d873e065224901555fb8821590a33bacc61e39701cf9b46bd25bf5f0595bbe24655141438e7a100b",
    ),
    (
        "4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb",
        "3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c",
        "72",
        "92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da085ac1e43e15996e458f3613d0f11d8c387b2eaeb4302aeeb00d291612bb0c00",
    ),
]


@pytest.mark.parametrize(("private", "public", "message", "signature"), RFC)
def test_signatures_are_those_of_the_standard(private: str, public: str, message: str, signature: str) -> None:
    signer, data = Signer.of(bytes.fromhex(private)), bytes.fromhex(message)
    assert (signer.public, signer.signature_of(data)) == (public, signature)
    assert is_signature(public, data, signature)
    assert not is_signature(public, data + b"x", signature)
    for odd in ("", "zz", signature[:-2], "00" * 64):
        assert not is_signature(public, data, odd)
    assert private not in repr(signer)


def test_a_key_opens_by_its_secret_alone_and_every_changed_digit_closes_it() -> None:
    raw = new_key()
    sealed = seal(raw, PASSWORD, CHEAP.cost)
    opened = unseal(sealed, PASSWORD)
    assert opened == Signer.of(raw)
    assert unseal(sealed, PASSWORD + "x") is None
    for at in range(sealed.rindex(".") + 1, len(sealed), 7):
        other = "0" if sealed[at] != "0" else "1"
        assert unseal(f"{sealed[:at]}{other}{sealed[at + 1 :]}", PASSWORD) is None


@pytest.fixture
def at(tmp_path: Path) -> Any:
    made = At.of(tmp_path)
    made.folder.put(stages.PROPOSAL, PROPOSAL)
    return made


@pytest.fixture
def accounts(at: Any) -> UserAccounts:
    made = UserAccounts(at.store.root, CHEAP)
    made.put("root", ("service",), password=PASSWORD)
    return made


def approval(at: Any, actor: str, signer: Signer | None, **changed: Any) -> Approval:
    """One that the audit log knows, as who can write the store makes it."""
    names = {"typed_name": "mill", "site_name": "mill", "run_id": at.folder.run_id}
    made = give_consent(CHANGE, MACHINE, actor=actor, now_utc=at.clock.utc(), **names)
    if signer is not None:
        named = replace(made, key=signer.public)
        made = replace(named, signature=signer.signature_of(Approvals.signed_form(named)))
    made = replace(made, **changed)
    Approvals(at.folder.path).keep(made)
    told = {"approval": Approvals.digest(made)}
    audit.record(at.store.root, audit.APPROVED, clock=at.clock, serial=MACHINE.serial, details=told)
    return made


def unsigned(at: Any) -> tuple[Approval, ...]:
    return audit_trail.with_consent(at, CHANGE, push_bench(at.store.root).context).unsigned_approvals


def test_where_nobody_has_a_key_approvals_at_a_keyboard_count_as_before(at: Any, accounts: UserAccounts) -> None:
    approval(at, "ann", None)
    assert unsigned(at) == ()
    accounts.put("carl", ("approver",), password=PASSWORD)
    assert len(unsigned(at)) == 1, "once somebody signs, all do"


def test_an_approval_counts_with_the_signature_of_its_persons_key_alone(at: Any, accounts: UserAccounts) -> None:
    accounts.put("carl", ("approver",), password=PASSWORD, pin=PIN)
    accounts.put("dora", ("approver",), password=PASSWORD)
    carl, dora = accounts.by_secret("CARL", pin=PIN).signer, accounts.by_secret("dora", password=PASSWORD).signer
    assert carl is not None
    assert carl == accounts.by_secret("carl", password=PASSWORD).signer
    right = approval(at, "carl", carl)
    later = (at.clock.utc() + timedelta(minutes=9)).isoformat()
    wrong = (
        approval(at, "carl", None),
        approval(at, "carl", dora),
        approval(at, "carl", Signer.of(new_key())),
        approval(at, "dora", carl),
        approval(at, "carl", carl, kept_by=("nobody",)),
        approval(at, "carl", carl, expires_utc=later),
    )
    assert set(unsigned(at)) == set(wrong)
    assert right not in unsigned(at)


def test_a_new_password_of_somebody_else_gives_a_new_key_and_the_old_one_counts_no_more(
    at: Any, accounts: UserAccounts
) -> None:
    accounts.put("carl", ("approver",), password=PASSWORD, pin=PIN)
    old = accounts.by_secret("carl", pin=PIN).signer
    given = approval(at, "carl", old)
    accounts.put("carl", ("approver",), pin="222222", known=accounts.find("carl"))
    assert accounts.by_secret("carl", pin="222222").signer is None, "a PIN that somebody else gave unlocks nothing"
    assert accounts.by_secret("carl", password=PASSWORD).signer == old
    assert unsigned(at) == ()
    accounts.change_secret("carl", pin=PIN, signer=old)
    assert accounts.by_secret("carl", pin=PIN).signer == old, "the person's own new PIN does"
    accounts.put("carl", ("approver",), password="another sentence", known=accounts.find("carl"))
    assert unsigned(at) == (given,)
    accounts.put("carl", ("viewer",), known=accounts.find("carl"))
    assert not accounts.ring.signs


def test_an_account_of_an_older_version_gets_its_key_at_the_first_sign_in(at: Any, accounts: UserAccounts) -> None:
    older = {
        "name": "carl",
        "roles": ["approver", "service"],
        "password": CHEAP.hashed(PASSWORD),
        "pin": "",
        "token": "",
    }
    KeyRing(at.store.root).path.unlink()
    path = at.store.root / "service" / "users.json"
    path.write_text(json.dumps({"schema": 1, "users": [older]}))
    accounts.migrate(at.clock.utc())
    assert not accounts.ring.signs
    signer = accounts.by_secret("carl", password=PASSWORD).signer
    assert accounts.ring.signs
    assert signer == accounts.by_secret("carl", password=PASSWORD).signer


@pytest.mark.parametrize("kind", ["planted", "unsigned", "by another gateway", "changed", "gone"])
def test_a_file_of_accounts_that_this_service_did_not_write_is_refused(
    at: Any, accounts: UserAccounts, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = at.store.root / "service" / "users.json"
    known = json.loads(read_whole(path))
    if kind == "gone":
        path.unlink()
        first_token_path(at.store.root).write_text("a-token-of-my-own\n")
    elif kind == "by another gateway":
        with monkeypatch.context() as elsewhere:
            elsewhere.setenv("TRUEFLANK_KEYS", str(tmp_path / "other-keys"))
            path.unlink()
            UserAccounts(at.store.root, CHEAP).put("eve", ("approver", "service"), password=PASSWORD)
    elif kind == "changed":
        known["users"][0]["password"] = CHEAP.hashed("what eve knows")
        path.write_text(json.dumps(known))
    else:
        mine = [{"name": "eve", "roles": ["service"], "password": CHEAP.hashed(PASSWORD), "pin": "", "token": ""}]
        signed = {"key": known["key"], "signature": known["signature"]} if kind == "planted" else {}
        path.write_text(json.dumps({"schema": 1, "users": mine, **signed}))
    for act in (accounts.all, lambda: accounts.by_secret("eve", password=PASSWORD), accounts.first_token):
        with pytest.raises(CorruptRecord) as caught:
            act()
        assert caught.value.code == "E-USER-FOREIGN"


def is_proposed(at: Any) -> bool:
    context = replace(push_bench(at.store.root).context, capture=None)
    return audit_trail.with_consent(at, CHANGE, context).is_proposed


def propose_by_hand(at: Any, **signed: str) -> None:
    """A line in the log as who can write the store adds it."""
    told = {"run": at.folder.run_id, "proposal": at.folder.digest(stages.PROPOSAL), **signed}
    plan = plan_hash(CHANGE, MACHINE)
    audit.record(at.store.root, audit.PROPOSED, clock=at.clock, serial=MACHINE.serial, plan_hash=plan, details=told)


def test_a_proposal_counts_with_the_signature_of_a_gateway_that_is_known_here(
    at: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    propose_by_hand(at)
    assert not is_proposed(at)
    with monkeypatch.context() as elsewhere:
        elsewhere.setenv("TRUEFLANK_KEYS", str(tmp_path / "other-keys"))
        assert audit_trail.record_proposal(at, PROPOSAL) == ""
        assert is_proposed(at), "there it is known"
    assert not is_proposed(at)
    assert audit_trail.record_proposal(at, PROPOSAL) == ""
    assert is_proposed(at)


def test_a_signature_of_another_run_or_proposal_is_none(at: Any) -> None:
    assert audit_trail.record_proposal(at, PROPOSAL) == ""
    (line,) = (one for one in audit.read_entries(at.store.root) if one["action"] == audit.PROPOSED)
    signed = {key: line["details"][key] for key in ("key", "signature")}
    other = At(at.store, at.store.create("mill"))
    other.folder.put(stages.PROPOSAL, PROPOSAL)
    propose_by_hand(other, **signed)
    assert not is_proposed(other)
    at.folder.put(stages.PROPOSAL, replace(PROPOSAL, created_utc="2026-11-22T10:00:00+00:00"))
    propose_by_hand(at, **signed)
    assert not is_proposed(at)


def test_two_accounts_of_a_computer_that_share_the_folder_of_keys_trust_each_other(at: Any) -> None:
    one, two = (KeyRing(at.store.root, user).gateway() for user in ("1001", "1002"))
    assert one != two
    ring = KeyRing(at.store.root)
    assert all(ring.is_gateways(signer.public, b"x", signer.signature_of(b"x")) for signer in (one, two))
    stranger = Signer.of(new_key())
    assert not ring.is_gateways(stranger.public, b"x", stranger.signature_of(b"x"))


def test_the_people_of_a_service_are_known_at_each_of_its_stores(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    UserAccounts(first, CHEAP).put("carl", ("approver",), password=PASSWORD, system=["c"])
    ring = KeyRing(second)
    assert not ring.signs
    ring.follow(first)
    assert (ring.signs, ring.person_named("C"), ring.accounts_root) == (True, "carl", first)


@pytest.mark.parametrize("text", ["{", "[]", '{"people": [1]}', '{"people": [{"name": "x"}]}'])
def test_a_damaged_file_of_keys_is_said(tmp_path: Path, text: str) -> None:
    ring = KeyRing(tmp_path)
    ring.keep(())
    ring.path.write_text(text)
    with pytest.raises(TrueflankError) as caught:
        ring.people()
    assert caught.value.code == "E-USER-KEYS"
