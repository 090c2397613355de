"""Attacks by somebody who may write the store: each is refused with its reason, and nothing is asked of the machine."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.clock import Clock, run_virtual
from drivers.types.abilities import Marker
from drivers.types.identity import MachineIdentity
from drivers.types.tables import LiveTable
from drivers.types.uptime import Uptime
from gateway import audit
from gateway.approve import Approvals, give_consent
from gateway.audit.chain import AUDIT
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import Approval, Proposal, TableChange, TableFinding
from gateway.push import journal
from gateway.push.context import PushContext
from gateway.push.journal import JOURNALS
from gateway.push.transaction import push_table
from gateway.store import RunFolder, Store, records
from gateway.workflow.run import audit_trail, stages
from tests.steps import lines
from tests.unit.push.double import MACHINE, NEW, Bench, change_of
from tests.unit.push.double import bench as push_bench

pytestmark = pytest.mark.attack("a proposal, approval, audit log, journal or run folder changed", "store")


READS = {"identify", "state", "table_limits", "marker"}


@dataclass
class At:
    """What of a bench is asked for here."""

    store: Store
    folder: RunFolder
    clock: Clock
    machine: MachineIdentity = MACHINE
    open_road: str = ""
    supervisor: Any = None
    site: Any = None
    proofs: Any = None
    say: Any = None


class Shop:
    """A store with one proposal for the machine of the double, as `run` leaves it."""

    def __init__(self, root: Path) -> None:
        self.store = Store(root / "runs")
        folder = self.store.create("mill")
        self.double: Bench = push_bench(root)
        self.at: Any = At(self.store, folder, self.double.context.clock)
        self.proposal = Proposal(MACHINE, (change_of(self.double.machine),), (), "2026-11-21T10:00:00+00:00")

    def do(self, work: Callable[[], Any]) -> Any:
        """Something, while the clock has a loop."""

        async def main() -> Any:
            return work()

        return run_virtual(main)

    def propose(self) -> None:
        """As `run` does."""
        self.at.folder.put(stages.PROPOSAL, self.proposal)
        assert self.do(lambda: audit_trail.record_proposal(self.at, self.proposal)) == ""

    def approve(
        self, *, known: bool = True, run_id: str = "", uptime: Uptime | None = None, given: bool = False, **changed: Any
    ) -> Approval:
        """As `approve` does, by a second person; ``changed`` as an attacker writes it.

        ``given``: approvals of the plan are looked up as `approve` does.
        """

        def act() -> Approval:
            now, run = self.at.clock.utc(), run_id or self.at.folder.run_id
            (change,) = self.stored.changes
            names: dict[str, Any] = {"typed_name": "mill", "site_name": "mill", "now_utc": now, "run_id": run}
            names |= {"given": Approvals(self.at.folder.path).read_unused()} if given else {}
            names |= {"uptime": uptime} if uptime is not None else {}
            made = replace(give_consent(change, MACHINE, actor="second", **names), **changed)
            if known:
                told = {"approval": Approvals.digest(made)}
                audit.record(self.store.root, audit.APPROVED, clock=self.at.clock, serial=MACHINE.serial, details=told)
            Approvals(self.at.folder.path).keep(made)
            return made

        found: Approval = self.do(act)
        return found

    @property
    def stored(self) -> Proposal:
        """The proposal as it stands in the run folder."""
        return self.at.folder.get(stages.PROPOSAL, Proposal)

    @property
    def journals(self) -> Path:
        """Where this machine's journals are."""
        return journal.machine_folder(self.store.root / JOURNALS, MACHINE.serial)

    def context(self, people: int = 1) -> PushContext:
        """What a push works with."""
        journals = self.store.root / JOURNALS
        return replace(self.double.context, folder=self.at.folder, journals=journals, approvals_needed=people)

    def push(self, people: int = 1) -> PushRecord:
        """As `push --apply` does with one table."""

        async def main() -> PushRecord:
            (change,) = self.stored.changes
            context = audit_trail.with_consent(self.at, change, self.context(people))
            return await push_table(change, context)

        return run_virtual(main)

    def push_taken(self, people: int = 2) -> PushRecord:
        """The same with the approvals taken up first."""

        async def main() -> PushRecord:
            (change,) = self.stored.changes
            taken = audit_trail.consume_approvals(self.at, self.stored)
            context = audit_trail.with_consent(self.at, change, self.context(people), taken[change.name])
            return await push_table(change, context)

        return run_virtual(main)

    def refused(self, code: str, people: int = 1) -> str:
        """Push, see that it is refused for this reason and that the machine was only read; the reason."""
        self.double.controller.calls.clear()
        record = self.push(people)
        assert record.outcome == "refused", record.steps
        assert set(self.double.controller.calls) <= READS
        assert not self.double.machine.writes
        reasons = [step for step in lines(record) if step.startswith(code)]
        assert reasons, record.steps
        return reasons[0]


@pytest.fixture
def shop(tmp_path: Path) -> Shop:
    made = Shop(tmp_path)
    made.propose()
    return made


def test_without_an_attack_it_is_pushed_and_the_next_one_too(shop: Shop) -> None:
    assert shop.push().outcome == "committed"
    known = audit.read_log_state(shop.store.root, MACHINE.serial)
    assert len(known.begun) == 1
    again = replace(NEW, deviations=(0.0, 4.0, 9.0, 12.5, 9.0, 4.0, -3.0, -6.0, 0.0))
    shop.proposal = replace(shop.proposal, changes=(change_of(shop.double.machine, again),))
    shop.propose()
    assert shop.push().outcome == "committed"
    assert audit.check_log(shop.store.root).sound


def forge(shop: Shop, change: Callable[[TableChange], TableChange]) -> None:
    """Write another proposal over the stored one, all hashes made anew."""
    stored = shop.stored
    data = records.encode(replace(stored, changes=tuple(change(one) for one in stored.changes)))
    facts = json.loads((shop.at.folder.path / "run.json").read_text())
    facts["stages"][stages.PROPOSAL]["sha256"] = records.sha256(data)
    (shop.at.folder.path / facts["stages"][stages.PROPOSAL]["file"]).write_bytes(data)
    del facts["sha256"]
    facts["sha256"] = records.sha256(records.canonical(facts))
    (shop.at.folder.path / "run.json").write_text(json.dumps(facts, indent=1))


def more(change: TableChange) -> TableChange:
    """A little more at every point but the reference and the ends."""
    first, *middle, last = change.new.deviations
    return replace(change, new=replace(change.new, deviations=(first, *(one + 0.5 for one in middle), last)))


@pytest.mark.parametrize(
    "change",
    [
        more,
        lambda one: replace(one, predicted=np.ones(9)),
        lambda one: replace(one, base=None, findings=(TableFinding.older("x"),)),
    ],
    ids=["the table", "what is predicted", "what was found"],
)
def test_a_proposal_with_other_values_was_not_proposed_here(shop: Shop, change: Any) -> None:
    forge(shop, change)
    assert "was not proposed here" in shop.refused("E-INT-NOT-PROPOSED")
    shutil.rmtree(shop.store.root / AUDIT)
    shop.refused("E-INT-NOT-PROPOSED")
    assert "does not hold" in shop.refused("E-INT-AUDIT-BROKEN")


def test_a_log_that_is_gone_is_missed(shop: Shop) -> None:
    kept = shop.at.folder.anchor.partition(":")[2]
    shutil.rmtree(shop.store.root / AUDIT)
    assert kept in shop.refused("E-INT-AUDIT-BROKEN")
    for path in (shop.store.root / AUDIT).glob("audit-*"):
        path.write_bytes(b"")
    shop.refused("E-INT-AUDIT-BROKEN")


def put_back(shop: Shop, copy: Path) -> None:
    shutil.rmtree(shop.store.root / AUDIT)
    shutil.copytree(copy, shop.store.root / AUDIT)


def test_a_log_from_before_is_behind_the_controls_mark_even_when_the_store_is_as_old(
    shop: Shop, tmp_path: Path
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(shop.store.root, copy)
    before = shop.double.machine.live()
    marked(shop)
    assert shop.push().outcome == "committed"
    shutil.rmtree(shop.store.root)
    shutil.copytree(copy, shop.store.root)
    number = shop.double.machine.marker.transaction
    (shop.store.root / JOURNALS).mkdir(exist_ok=True)
    part = shop.store.root / JOURNALS / journal.PART
    part.write_text(str(number // journal.PART_SIZE))
    shop.double.machine.own = before.own
    shop.double.machine.writes.clear()
    assert str(number) in shop.refused("E-INT-AUDIT-BEHIND")


def marked(shop: Shop) -> None:
    """The control keeps the head that it is given, as four R parameters do."""
    machine, controller = shop.double.machine, shop.double.controller
    prepare, finish = controller.stage, controller.finish_push

    async def prepared(batch: Any) -> None:
        await prepare(batch)
        machine.marker = replace(machine.marker, head=batch[0].head)

    async def finished(batch: Any, state: Any) -> None:
        await finish(batch, state)
        machine.marker = Marker(batch[0].transaction, state, batch[0].head)

    controller.stage, controller.finish_push = prepared, finished  # type: ignore[method-assign]


def test_a_log_cut_behind_the_last_push_is_behind_the_controls_mark(shop: Shop) -> None:
    marked(shop)
    assert shop.push().outcome == "committed"
    path = next((shop.store.root / AUDIT).glob("audit-*"))
    lines = path.read_bytes().splitlines(keepends=True)
    ending = next(n for n, line in enumerate(lines) if b'"action":"push-ending"' in line)
    path.write_bytes(b"".join(lines[:ending]))
    digest = json.loads(lines[ending - 1])["hash"]
    (shop.store.root / AUDIT / "head").write_text(f"{ending}:{digest}\n")
    assert audit.check_log(shop.store.root).sound
    shop.double.machine.writes.clear()
    assert "the marker in the control" in shop.refused("E-INT-AUDIT-BEHIND")


def test_a_control_that_lost_its_memory_warns_and_refuses_nothing(shop: Shop) -> None:
    marked(shop)
    assert shop.push().outcome == "committed"
    shop.double.machine.marker = Marker(0, "none")
    shop.proposal = replace(
        shop.proposal, changes=(change_of(shop.double.machine, replace(NEW, deviations=(0.0,) * 9)),)
    )
    shop.propose()

    async def asked() -> tuple[tuple[str, ...], tuple[str, ...]]:
        from gateway.push.preflight import run_preflight

        (change,) = shop.stored.changes
        found = await run_preflight(change, audit_trail.with_consent(shop.at, change, shop.context()), "table")
        return tuple(one.code for one in found.refusals), tuple(one.code for one in found.warnings)

    refusals, warned = run_virtual(asked)
    assert refusals == ()
    assert "W-INT-MARK-LOST" in warned


def test_an_approval_holds_once_for_its_run_and_for_ten_minutes(shop: Shop) -> None:
    shop.refused("E-INT-APPROVAL-MISSING", people=2)
    shop.approve()
    assert shop.push_taken().outcome == "committed"


@pytest.mark.parametrize(
    ("code", "changed"),
    [
        ("E-INT-APPROVAL-TOO-LONG", {"expires_utc": "2036-11-21T10:00:00+00:00"}),
        (
            "E-INT-APPROVAL-EXPIRED",
            {"given_utc": "2026-11-21T11:00:00+00:00", "expires_utc": "2026-11-21T11:10:00+00:00"},
        ),
        ("E-INT-APPROVAL-OTHER-RUN", {"run_id": "20261121T100000000Z-mill-ffff"}),
        ("E-INT-APPROVAL-UNRECORDED", {"known": False}),
    ],
    ids=["ten years", "the future", "another run's", "written by hand"],
)
def test_an_approval_that_was_written_otherwise_does_not_count(shop: Shop, code: str, changed: dict[str, Any]) -> None:
    shop.approve(**changed)
    shop.refused(code, people=2)


def test_a_used_approval_is_known_from_the_log(shop: Shop) -> None:
    made = shop.approve()
    shop.do(lambda: audit_trail.consume_approvals(shop.at, shop.stored))
    folder = shop.at.folder.path / "approvals"
    for mark in folder.glob("*.used"):
        mark.unlink()
    assert made.actor in shop.refused("E-INT-APPROVAL-USED", people=2)
    assert shop.do(lambda: audit_trail.consume_approvals(shop.at, shop.stored))["X1"].approvals == ()
    for path in folder.glob("*.json"):
        path.unlink()
    Approvals(shop.at.folder.path).keep(made)
    shop.refused("E-INT-APPROVAL-USED", people=2)


def test_an_approval_that_ends_while_the_push_waits_still_holds(shop: Shop) -> None:
    made = shop.approve()

    async def main() -> PushRecord:
        (change,) = shop.stored.changes
        taken = audit_trail.consume_approvals(shop.at, shop.stored)
        await shop.at.clock.sleep(3600.0)
        context = audit_trail.with_consent(shop.at, change, shop.context(2), taken[change.name])
        assert shop.at.clock.utc() > datetime.fromisoformat(made.expires_utc) + timedelta(minutes=10)
        return await push_table(change, context)

    assert run_virtual(main).outcome == "committed"


@pytest.mark.parametrize("left", [0, 40], ids=["emptied", "beheaded"])
def test_an_emptied_journal_is_no_finished_one(shop: Shop, left: int) -> None:
    shop.double.controller.faults[("read_back", 0, "before")] = lambda machine: setattr(machine, "operator", False)
    assert shop.push().outcome == "held-on"
    shop.double.controller.faults.clear()
    shop.double.machine.operator = True
    shop.double.machine.marker = Marker(0, "none")
    shop.double.machine.end()
    (path,) = shop.journals.glob("tx-*.jnl")
    path.write_bytes(path.read_bytes()[:left])
    shop.double.machine.writes.clear()
    assert path.name in shop.refused("E-INT-UNFINISHED")


@pytest.mark.parametrize("whole", [False, True], ids=["the journal", "the folder"])
def test_a_journal_that_is_gone_is_missed(shop: Shop, whole: bool) -> None:
    assert shop.push().outcome == "committed"
    (path,) = shop.journals.rglob("tx-*.jnl")
    number = path.stem.partition("-")[2]
    if whole:
        shutil.rmtree(shop.store.root / JOURNALS)
    else:
        path.unlink()
    shop.double.machine.writes.clear()
    assert number in shop.refused("E-INT-JOURNAL-MISSING")


def test_a_switch_of_the_table_is_part_of_no_plan_but_the_base_is(shop: Shop) -> None:
    forge(shop, lambda one: replace(one, base_digest="0" * 64))
    shop.refused("E-INT-NOT-PROPOSED")
    shop.double.machine.own = LiveTable(shop.double.machine.own.table, enabled=False)
    shop.refused("E-INT-NOT-PROPOSED")
