"""From approval to push: taken up once and before anything is written, held for as long as the push takes, recorded."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from drivers.errors import DeadlineExceeded
from drivers.message import Message
from drivers.types.identity import MachineIdentity
from gateway import audit
from gateway.approve import Approvals, give_consent
from gateway.audit.chain import AUDIT
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import Proposal
from gateway.errors import CorruptRecord, WriteRefused
from gateway.store import Store
from gateway.users import UserAccounts
from gateway.users.passwords import Hasher
from gateway.workflow.run import audit_trail
from tests.unit.approve.test_approve import CHANGE, MACHINE
from tests.unit.audit.log import Moments
from tests.unit.push.double import bench as push_bench


@dataclass
class At:
    """What of a bench is asked for here."""

    store: Store
    folder: Any
    clock: Moments = field(default_factory=Moments)
    machine: MachineIdentity = MACHINE
    open_road: str = ""

    @classmethod
    def of(cls, root: Path, **given: Any) -> At:
        """A bench with a store of its own."""
        store = Store(root)
        return cls(store, store.create("mill"), **given)


SKIPPED = replace(
    CHANGE, axis="C1", new=replace(CHANGE.new, output_axis="C1"), skipped=Message.stored("within its uncertainty")
)
PROPOSAL = Proposal(MACHINE, (CHANGE, SKIPPED), (), "2026-11-21T10:00:00+00:00")


@pytest.fixture
def at(tmp_path: Path) -> Any:
    return At.of(tmp_path)


def given(at: At, actor: str, ago: timedelta = timedelta(0)) -> None:
    now = at.clock.utc() - ago
    run = at.folder.run_id
    made = give_consent(CHANGE, MACHINE, actor=actor, typed_name="mill", site_name="mill", now_utc=now, run_id=run)
    Approvals(at.folder.path).keep(made)
    told = {"approval": Approvals.digest(made)}
    audit.record(at.store.root, audit.APPROVED, clock=at.clock, serial=MACHINE.serial, details=told)


def test_taken_up_once_and_held_for_the_push(at: Any) -> None:
    given(at, "ann")
    given(at, "eve", ago=timedelta(minutes=11))
    taken = audit_trail.consume_approvals(at, PROPOSAL)
    assert taken["C1"].approvals == ()
    assert [one.actor for one in taken["X1"].approvals] == ["eve", "ann"]
    held = audit_trail.with_consent(at, CHANGE, push_bench(at.store.root).context, taken["X1"])
    assert (held.consent_utc, held.used_approvals, held.run_id) == (taken["X1"].at_utc, (), at.folder.run_id)
    again = audit_trail.consume_approvals(at, PROPOSAL)
    assert {name: one.approvals for name, one in again.items()} == {"X1": (), "C1": ()}
    used = [entry for entry in audit.read_entries(at.store.root) if entry["action"] == audit.USED]
    assert {entry["details"]["approved_by"] for entry in used} == {"ann", "eve"}


def test_two_pushes_cannot_take_up_the_same(at: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    given(at, "ann")
    both = Approvals(at.folder.path).read_unused()
    audit_trail.consume_approvals(at, PROPOSAL)
    monkeypatch.setattr(Approvals, "read_unused", lambda *_: both)
    assert audit_trail.consume_approvals(at, PROPOSAL)["X1"].approvals == (), "the log knows them as used"
    monkeypatch.setattr(audit.LogState, "take", lambda *_: None)
    with pytest.raises(WriteRefused) as caught:
        audit_trail.consume_approvals(at, PROPOSAL)
    assert caught.value.code == "E-APPROVE-USED"


def test_the_context_is_told_who_what_and_whether_the_audit_is_whole(at: Any, tmp_path: Path) -> None:
    given(at, "ann")
    context = push_bench(tmp_path).context
    seen = audit_trail.with_consent(at, CHANGE, context)
    assert (seen.actor, seen.audit_broken) == (audit.os_user(), "")
    assert [one.actor for one in seen.approvals] == ["ann"]
    none = audit_trail.ConsumedApproval((), at.clock.utc())
    assert audit_trail.with_consent(at, CHANGE, context, none).approvals == ()
    audit_trail.record_start(at, CHANGE, seen)
    path = next((tmp_path / AUDIT).glob("*.jsonl"))
    path.write_bytes(path.read_bytes().replace(b"push-start", b"push-stork"))
    assert "record 2" in audit_trail.with_consent(at, CHANGE, context).audit_broken
    with pytest.raises(CorruptRecord):
        audit_trail.record_start(at, CHANGE, seen)


def test_every_end_leaves_its_record(at: Any, tmp_path: Path) -> None:
    given(at, "ann")
    audit_trail.record_start(at, CHANGE, audit_trail.with_consent(at, CHANGE, push_bench(tmp_path).context))
    ends = ("committed", "rolled-back", "held", "refused", "already-applied")
    for number, outcome in enumerate(ends):
        assert audit_trail.record_end(at, CHANGE, PushRecord(number, "X1", outcome, (), "b.mpf")) == ""
    assert audit_trail.record_failure(at, CHANGE, DeadlineExceeded("E-LINK-DEADLINE", "x", timeout_s=1.0)) == ""
    assert audit_trail.record_refusal(at, ("E-INT-MODE: wrong",)) == ""
    at.folder.put("proposal", PROPOSAL)
    assert audit_trail.record_proposal(at, PROPOSAL) == ""
    assert audit_trail.record_recovery(at, "R-PUSH-HALF", PushRecord(9, "X1", "rolled-back", (), "")) == ""
    audit_trail.record_sign_proof(at, CHANGE)
    audit_trail.record_repeated_proof(at, CHANGE, mean=-2.1234, u=0.5, count=3)
    found = list(audit.read_entries(tmp_path))
    assert found.pop(0)["action"] == audit.APPROVED
    assert [entry["action"] for entry in found] == [
        "push-start",
        *(f"push-{outcome}" for outcome in ends),
        *("push-failed", "push-refused", "propose", "recover-rolled-back", "sign-proof-start"),
        "sign-proof-again",
    ]
    assert found[0]["details"]["approved_by"] == "ann"
    assert found[1]["plan_hash"] == found[0]["plan_hash"] != ""
    assert found[1]["new_hash"] == found[0]["new_hash"] != ""
    (plan,) = [entry for entry in found if entry["action"] == "propose"]
    assert (plan["plan_hash"], plan["new_hash"]) == (found[0]["plan_hash"], found[0]["new_hash"])
    assert plan["details"]["proposal"] == at.folder.digest("proposal")
    assert at.folder.anchor.partition(":")[2] == plan["hash"]
    assert {"mean": -2.123, "u": 0.5, "steps": 3}.items() <= found[-1]["details"].items()
    assert audit.is_sound(tmp_path)


def test_a_person_has_one_name_at_the_page_and_at_a_keyboard(at: Any) -> None:
    accounts = UserAccounts(at.store.root, Hasher(1, 8))
    accounts.put("Anna", ("operator",), password="a long sentence", system=["aschmidt"])
    context = push_bench(at.store.root).context
    for acting, known in (("ASchmidt", "Anna"), ("anna", "Anna"), ("bert", "bert")):
        with audit.act_as(acting):
            assert audit_trail.with_consent(at, CHANGE, context).actor == known
