"""The age of an approval and of a session: no setting of the calendar lengthens or shortens it.

Within one start of a computer its own count tells the age; after a restart, and at another computer, the calendar does,
unless the audit log shows that it was set back since.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from drivers.clock import BOOT_ID, LoopClock, Uptime, read_uptime, run_virtual
from gateway import audit
from gateway.approve import VALID
from gateway.daemon.server import sessions_of
from gateway.errors import WriteRefused
from gateway.users.records import Person
from gateway.users.sessions import LONGEST_S
from gateway.workflow.run import audit_trail
from tests.unit.approve.test_attacks import Shop
from tests.unit.push.double import Bench

pytestmark: list[Any] = []
LIMIT_S = VALID.total_seconds()
HOURS = [timedelta(hours=-3), timedelta(minutes=-9), timedelta(minutes=9), timedelta(days=400)]


class Set(LoopClock):
    """A clock whose calendar and whose count are set by hand."""

    def __init__(self) -> None:
        super().__init__()
        self.ahead = timedelta(0)
        self.count = Uptime("first start", 5000.0)

    def utc(self) -> datetime:
        """The calendar, as it was set; time passes by the count."""
        return super().utc() + self.ahead

    def uptime(self) -> Uptime:
        """The count."""
        return self.count

    def pass_s(self, seconds: float, *, calendar: bool = True) -> None:
        """So long passes; the calendar may be set back by as much meanwhile."""
        self.count = replace(self.count, seconds=self.count.seconds + seconds)
        self.ahead += timedelta(seconds=seconds) if calendar else timedelta(0)

    def restart(self) -> None:
        """The computer is started again."""
        self.count = Uptime("second start", 20.0)


@pytest.fixture
def shop(tmp_path: Path) -> Shop:
    """A proposal that a second person is about to approve."""
    made = Shop(tmp_path)
    clock = Set()
    made.at.clock = clock
    double = made.double
    made.double = Bench(double.machine, double.controller, replace(double.context, clock=clock), double.told)
    made.propose()
    return made


def approve(shop: Shop) -> None:
    shop.approve(uptime=shop.at.clock.uptime())


@pytest.mark.parametrize("jump", HOURS, ids=str)
def test_a_calendar_that_is_set_ends_no_approval(shop: Shop, jump: timedelta) -> None:
    approve(shop)
    shop.at.clock.ahead += jump
    shop.at.clock.pass_s(LIMIT_S - 1.0)
    assert shop.push_taken(2).outcome == "committed"


@pytest.mark.parametrize("jump", HOURS, ids=str)
def test_a_calendar_that_is_set_keeps_no_approval_alive(shop: Shop, jump: timedelta) -> None:
    approve(shop)
    shop.at.clock.pass_s(LIMIT_S)
    shop.at.clock.ahead += jump
    shop.refused("E-INT-APPROVAL-EXPIRED", 2)


def test_a_calendar_that_stands_still_keeps_no_approval_alive(shop: Shop) -> None:
    approve(shop)
    shop.at.clock.pass_s(LIMIT_S, calendar=False)
    shop.refused("E-INT-APPROVAL-EXPIRED", 2)


def test_a_count_that_runs_backwards_is_no_age(shop: Shop) -> None:
    approve(shop)
    shop.at.clock.pass_s(-1.0)
    shop.refused("E-INT-APPROVAL-EXPIRED", 2)


def test_what_was_taken_up_in_time_holds_although_the_push_takes_long(shop: Shop) -> None:
    approve(shop)

    def take() -> Any:
        (change,) = shop.stored.changes
        return audit_trail.consume_approvals(shop.at, shop.stored)[change.name]

    taken = shop.do(take)
    shop.at.clock.pass_s(20.0 * LIMIT_S)

    def asked() -> Any:
        (change,) = shop.stored.changes
        return audit_trail.with_consent(shop.at, change, shop.context(2), taken)

    context = shop.do(asked)
    assert (context.consent_uptime, context.overtaken_approvals) == (Uptime("first start", 5000.0), ())


@pytest.mark.parametrize(("passed_s", "outcome"), [(LIMIT_S - 2.0, "committed"), (LIMIT_S + 1.0, "refused")])
def test_after_a_restart_the_calendar_tells(shop: Shop, passed_s: float, outcome: str) -> None:
    approve(shop)
    shop.at.clock.restart()
    shop.at.clock.ahead += timedelta(seconds=passed_s)
    assert shop.push_taken(2).outcome == outcome


def test_a_calendar_set_back_over_a_restart_is_seen_in_the_log(shop: Shop) -> None:
    """Given at noon; something is logged an hour later; the restarted computer says five past twelve."""
    approve(shop)
    clock = shop.at.clock
    clock.pass_s(3600.0)
    shop.do(lambda: audit.record(shop.store.root, "look", clock=clock))
    clock.restart()
    clock.ahead -= timedelta(minutes=55)
    shop.refused("E-INT-APPROVAL-CLOCK", 2)
    assert shop.push_taken(2).outcome == "refused", "nor is it taken up"


def test_a_time_that_was_logged_before_the_approval_says_nothing_of_it(shop: Shop) -> None:
    """A clock that was wrong once, and is right again, refuses nobody."""
    clock = shop.at.clock
    clock.ahead += timedelta(days=3000)
    shop.do(lambda: audit.record(shop.store.root, "look", clock=clock))
    clock.ahead -= timedelta(days=3000)
    approve(shop)
    clock.restart()
    clock.ahead += timedelta(minutes=2)
    assert shop.push_taken(2).outcome == "committed"


def test_the_same_person_approves_again_once_the_count_says_it_is_over(shop: Shop) -> None:
    approve(shop)
    shop.at.clock.ahead += timedelta(days=400)
    with pytest.raises(WriteRefused) as caught:
        shop.approve(uptime=shop.at.clock.uptime(), given=True)
    assert caught.value.code == "E-APPROVE-TWICE"
    shop.at.clock.pass_s(LIMIT_S)
    shop.approve(uptime=shop.at.clock.uptime(), given=True)
    assert shop.push_taken(2).outcome == "committed"


# ---- sessions --------------------------------------------------------------------------------------

ANNA = Person("anna", frozenset({"operator"}), "password")


@pytest.mark.parametrize("jump", HOURS, ids=str)
def test_a_session_lasts_as_long_as_the_count_says(jump: timedelta) -> None:
    clock = Set()
    wanted: Any = SimpleNamespace(signout_min=15.0)
    sessions = sessions_of(clock, wanted)
    key, session = sessions.begin(ANNA)
    clock.ahead += jump
    clock.pass_s(899.0, calendar=False)
    assert sessions.find(key) is session
    assert sessions.age_s(session) == (899.0, 0.0)
    clock.pass_s(900.0, calendar=False)
    assert sessions.find(key) is None


def test_a_session_ends_while_the_computer_sleeps() -> None:
    clock = Set()
    wanted: Any = SimpleNamespace(signout_min=LONGEST_S)
    sessions = sessions_of(clock, wanted)
    key, _session = sessions.begin(ANNA)
    clock.pass_s(LONGEST_S)
    assert sessions.find(key) is None


# ---- the count itself ------------------------------------------------------------------------------


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel tells it there")
def test_the_count_is_the_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    """/proc/uptime counts by the same clock, in another way."""
    before = float(Path("/proc/uptime").read_text().split()[0])
    found = read_uptime()
    after = float(Path("/proc/uptime").read_text().split()[0])
    assert before - 0.02 <= found.seconds <= after + 0.02
    assert found.boot == BOOT_ID.read_text().strip()


def test_a_clock_with_a_calendar_of_its_own_has_no_count() -> None:
    async def main() -> tuple[Uptime, Uptime]:
        return LoopClock(started_utc=datetime.fromisoformat("2026-01-01T00:00:00+00:00")).uptime(), LoopClock().uptime()

    own, systems = run_virtual(main)
    assert own == Uptime()
    assert systems.since(own) is None
    assert systems.since(Uptime(systems.boot, systems.seconds - 3.0)) == (pytest.approx(3.0) if systems.boot else None)
