"""Approvals: one plan, one machine, ten minutes, one person, one use."""

from __future__ import annotations

import threading
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from drivers.message import Message
from drivers.types.identity import MachineIdentity
from drivers.types.tables import CompensationTable
from gateway.approve import VALID, Approvals, give_consent
from gateway.domain.proposals import Approval, TableChange
from gateway.errors import CorruptRecord, WriteRefused
from gateway.push.context import plan_hash

NOW = datetime(2026, 11, 21, 10, tzinfo=UTC)
MACHINE = MachineIdentity("SN-1", "V4.8", ("X1", "C1"))
OLD = CompensationTable("axis", "X1", "X1", 0.0, 100.0, 50.0, (0.0, 0.0, 0.0))
NEW = replace(OLD, deviations=(0.0, 3.0, 1.0))
CHANGE = TableChange("X1", OLD, NEW, False, "base", np.zeros(0), np.zeros(0), np.zeros(0))


def approve(
    actor: str = "ann", typed: str = "mill", given: tuple[Approval, ...] = (), now: datetime = NOW, **changed: object
) -> Approval:
    change = replace(CHANGE, **changed)
    return give_consent(change, MACHINE, actor=actor, typed_name=typed, site_name="mill", now_utc=now, given=given)


def test_an_approval_names_plan_base_machine_person_and_time() -> None:
    made = approve()
    assert made == Approval(
        "ann", plan_hash(CHANGE, MACHINE), "base", "SN-1", "2026-11-21T10:00:00+00:00", "2026-11-21T10:10:00+00:00"
    )
    assert datetime.fromisoformat(made.expires_utc) - NOW == VALID


@pytest.mark.parametrize("typed", ["", "Mill", "mill ", "other"])
def test_the_machines_name_must_be_typed(typed: str) -> None:
    with pytest.raises(WriteRefused) as caught:
        approve(typed=typed)
    assert caught.value.code == "E-APPROVE-NAME"


def test_nothing_proposed_cannot_be_approved() -> None:
    with pytest.raises(WriteRefused) as caught:
        approve(skipped=Message.stored("within its uncertainty"))
    assert caught.value.code == "E-APPROVE-NOTHING"


def test_one_person_counts_once_while_the_first_approval_holds() -> None:
    first = approve()
    with pytest.raises(WriteRefused) as caught:
        approve(given=(first,), now=NOW + VALID - timedelta(seconds=1))
    assert caught.value.code == "E-APPROVE-TWICE"
    assert approve("bob", given=(first,)).actor == "bob"
    assert approve(given=(first,), now=NOW + VALID) != first
    other = replace(NEW, deviations=(0.0, 3.0, 1.1))
    assert approve(given=(first,), new=other).plan_hash != first.plan_hash


def test_kept_and_found_until_used_once(tmp_path: Path) -> None:
    kept = Approvals(tmp_path)
    assert kept.read_unused() == ()
    ann, bob = approve("ann"), approve("bob", now=NOW + timedelta(seconds=5))
    digests = {kept.keep(bob), kept.keep(ann), kept.keep(ann)}
    assert len(digests) == 2
    assert kept.read_unused(ann.plan_hash) == (ann, bob)
    assert kept.read_unused("another plan") == ()
    kept.use((ann,), "transaction 7 by eve")
    assert Approvals(tmp_path).read_unused() == (bob,)
    with pytest.raises(WriteRefused) as caught:
        kept.use((bob, ann), "transaction 8")
    assert caught.value.code == "E-APPROVE-USED"
    assert kept.read_unused() == ()
    assert "transaction 7 by eve" in {path.read_text() for path in tmp_path.rglob("*.used")}


def test_given_again_after_use_it_stays_used(tmp_path: Path) -> None:
    kept = Approvals(tmp_path)
    kept.keep(approve())
    kept.use((approve(),), "7")
    kept.keep(approve())
    assert kept.read_unused() == ()


def test_an_altered_approval_is_not_believed(tmp_path: Path) -> None:
    kept = Approvals(tmp_path)
    kept.keep(approve())
    path = next(tmp_path.rglob("approval-*.json"))
    path.write_bytes(path.read_bytes().replace(b"ann", b"bob"))
    with pytest.raises(CorruptRecord):
        kept.read_unused()


def test_two_pushes_at_once_cannot_both_use_it(tmp_path: Path) -> None:
    kept, approval = Approvals(tmp_path), approve()
    kept.keep(approval)
    ready, ended = threading.Barrier(8), []

    def push(number: int) -> None:
        ready.wait()
        try:
            kept.use((approval,), str(number))
            ended.append("used")
        except WriteRefused as error:
            ended.append(error.code)

    threads = [threading.Thread(target=push, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(ended) == ["E-APPROVE-USED"] * 7 + ["used"]
