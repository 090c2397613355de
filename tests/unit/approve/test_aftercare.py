"""After the last read somebody still looks: live tables against what pushes left, and what a difference leads to."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.types.tables import LiveTable
from gateway import audit
from gateway.daemon.site_service import LOOK_EVERY_S, TRY_AGAIN_S, DailyComparison, compare_daily
from gateway.domain.outcomes import PushRecord
from gateway.errors import BusyError
from gateway.push import push_table, run_preflight
from gateway.say import silence
from gateway.workflow.run import audit_trail, live_tables
from gateway.workflow.run.outcome import Outcome, with_alarms
from tests.steps import lines
from tests.unit.approve.test_attacks import Shop
from tests.unit.push.double import MACHINE, NEW, change_of


@pytest.fixture
def shop(tmp_path: Path) -> Shop:
    """A machine whose table was pushed from here."""
    made = Shop(tmp_path)
    at, controller = made.at, made.double.controller
    at.supervisor, at.site = SimpleNamespace(controller=controller), SimpleNamespace(axes=[SimpleNamespace(name="X1")])
    at.proofs, at.say = SimpleNamespace(find=lambda *_: None), silence
    made.propose()
    record = made.push()
    assert record.outcome == "committed"
    assert made.do(lambda: audit_trail.record_end(at, made.stored.changes[0], record)) == ""
    return made


def look(shop: Shop) -> tuple[str, ...]:
    """As a run does with the live tables it has captured; the alarms that stand then."""

    async def main() -> tuple[str, ...]:
        await live_tables.compare_live_tables(shop.at, shop.double.machine.live())
        return live_tables.standing_alarms(shop.at, "X1")

    return run_virtual(main)


def actions(shop: Shop) -> list[str]:
    return [entry["action"] for entry in audit.read_entries(shop.store.root)]


def by_hand(shop: Shop, **changed: Any) -> None:
    """Somebody changes the live table at the control."""
    machine = shop.double.machine
    machine.own = replace(machine.own, **changed)


def test_what_is_as_pushed_is_kept_and_no_alarm(shop: Shop) -> None:
    assert look(shop) == ()
    assert actions(shop)[-1] == audit.AS_PUSHED
    assert shop.do(live_tables.StandingAlarms(shop.store, MACHINE.serial)) == ()


@pytest.mark.parametrize(
    "changed",
    [
        {"enabled": False},
        {"table": replace(NEW, deviations=(0.0,) * 9)},
        {"table": replace(NEW, step=40.0, maximum=320.0)},
    ],
    ids=["switched off", "zeros", "another grid"],
)
def test_a_difference_is_an_alarm_until_it_is_put_right(shop: Shop, changed: dict[str, Any]) -> None:
    right = shop.double.machine.own
    page = live_tables.StandingAlarms(shop.store, MACHINE.serial)
    assert page() == ()
    by_hand(shop, **changed)
    (alarm,) = look(shop)
    assert actions(shop)[-1] == audit.DIFFERS
    assert page() == (alarm,)
    outcome = Outcome("proposed", "", (), ("line",), {})
    told = with_alarms(outcome, (alarm,))
    assert (told.exit_code, told.data["alarms"]) == (9, [str(alarm)])
    assert str(alarm) in str(told.lines[-1])
    assert with_alarms(outcome, ()) is outcome
    shop.double.machine.own = right
    assert look(shop) == ()
    assert page() == ()


def proposed_again(shop: Shop) -> None:
    """Measured again over what is live now."""
    wanted = replace(NEW, deviations=(0.0, 4.0, 9.0, 12.5, 9.0, 4.0, -3.0, -6.0, 0.0))
    shop.proposal = replace(shop.proposal, changes=(change_of(shop.double.machine, wanted),))
    shop.propose()


def test_a_push_to_that_axis_asks_for_a_second_person(shop: Shop) -> None:
    by_hand(shop, enabled=False)
    look(shop)
    proposed_again(shop)

    async def asked() -> Any:
        (change,) = shop.stored.changes
        context = audit_trail.with_consent(shop.at, change, replace(shop.context(), approvals_needed=None))
        return await run_preflight(change, context, "table")

    found = run_virtual(asked)
    assert [one.code for one in found.warnings] == ["W-INT-ALARM"]
    assert (found.people, [one.code for one in found.refusals]) == (2, ["E-INT-APPROVAL-MISSING"])


def test_a_push_compares_what_it_reads_and_a_committed_one_ends_the_alarm(shop: Shop) -> None:
    by_hand(shop, enabled=False)
    proposed_again(shop)

    async def main(people: int | None) -> PushRecord:
        (change,) = shop.stored.changes
        context = audit_trail.with_consent(shop.at, change, replace(shop.context(), approvals_needed=people))
        context = replace(context, on_live=await live_tables.alarms_for_push(shop.at, "X1"))
        record = await push_table(change, context)
        assert audit_trail.record_end(shop.at, change, record) == ""
        return record

    alone = run_virtual(lambda: main(None))
    assert alone.outcome == "refused"
    assert "W-INT-ALARM" in lines(alone)[-1]
    assert shop.double.machine.live().own == LiveTable(NEW, enabled=False)
    assert look(shop) != ()
    assert run_virtual(lambda: main(1)).outcome == "committed"
    assert live_tables.standing_alarms(shop.at, "X1") == ()


def test_it_is_due_once_a_day_from_its_hour_on(shop: Shop) -> None:
    look(shop)
    seen = datetime.fromisoformat(audit.read_log_state(shop.store.root, MACHINE.serial).looked["X1"])
    assert live_tables.overdue_tables(shop.store, MACHINE.serial, seen, seen.hour) == ()
    next_day = (seen + timedelta(days=1)).replace(hour=6, minute=0)
    assert live_tables.overdue_tables(shop.store, MACHINE.serial, next_day - timedelta(minutes=1), 6) == ()
    assert live_tables.overdue_tables(shop.store, MACHINE.serial, next_day, 6) == ("X1",)
    assert live_tables.overdue_tables(shop.store, "another machine", next_day, 6) == ()


@dataclass
class Watcher:
    """What the daemon's desk is asked for."""

    clock: LoopClock
    run: object = None
    begun: int = 0

    async def start(self, job: Any) -> str:
        self.begun += 1
        await job(silence)
        return "r-1"


@pytest.mark.parametrize("alone", [True, False], ids=["no person needed", "an operator needed"])
async def test_the_daemon_compares_by_itself_or_says_that_it_is_due(alone: bool) -> None:
    clock, done = LoopClock(started_utc=datetime(2026, 11, 21, 5, tzinfo=UTC)), []

    async def job(_say: Any) -> object:
        done.append(clock.utc())
        raise BusyError("E-WEB-BUSY", "daemon", run="r-0")

    daily = DailyComparison(6, lambda: ("X1",) if clock.utc().hour >= 6 else (), job, lambda: alone)
    desk: Any = Watcher(clock)
    task = asyncio.create_task(compare_daily(desk, daily, clock))
    await clock.sleep(3600.0 - LOOK_EVERY_S)
    assert (done, daily.due_message) == ([], None)
    await clock.sleep(2 * LOOK_EVERY_S)
    assert len(done) == alone
    assert ("X1" in str(daily.due_message)) is not alone
    await clock.sleep(TRY_AGAIN_S)
    assert desk.begun == 2 * alone, "what failed is tried again after an hour, not before"
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
