"""The recovery table row by row, the transaction key, and what a crash between journal and marker leaves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import run_virtual
from drivers.errors import DeadlineExceeded
from drivers.types.abilities import Marker
from drivers.types.tables import LiveTable
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import Approval
from gateway.errors import BusyError, WriteRefused
from gateway.push import journal
from gateway.push.context import plan_hash
from gateway.push.journal import machine_lock
from gateway.push.recovery import inspect_unfinished, recover_table, unfinished_tables
from gateway.push.recovery_findings import ControllerReading, make_finding
from gateway.push.transaction import push_table
from tests.steps import lines
from tests.unit.push.double import (
    MACHINE,
    NEW,
    OLD,
    Bench,
    Killed,
    Machine,
    bench,
    change_of,
    changing,
    deadline,
    journals_of,
    table,
)

OLD_ON, NEW_ON = LiveTable(OLD, enabled=True), LiveTable(NEW, enabled=True)
ODD = table(0.0, 1.0, 9.0, 1.0, 9.0, 1.0, 9.0, 1.0, 0.0)
READS = {"identify", "state", "table_limits", "marker", "saved_tables", "prepare_stops", "wait_stop", "release_stop"}


def stopped_at(root: Path, kind: str, change: Callable[[Machine], None], *, by_hand: bool = False) -> Bench:
    """A push killed right after a journal entry; the control then stands as ``change`` makes it."""
    at = bench(root, by_hand=by_hand)
    real = journal.Journal.append

    def append(self: journal.Journal, name: str, **facts: object) -> None:
        real(self, name, **facts)
        if name == kind:
            raise Killed

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(journal.Journal, "append", append)
        with pytest.raises(Killed):
            run_virtual(lambda: push_table(change_of(at.machine), at.context))
    at.machine.nck_reset()
    if kind == "DISABLE" and not by_hand:  # the program went on alone: its back-up is in the control
        at.machine.backup, at.machine.backup_number = at.machine.live(), journals_of(root)[0].number
    change(at.machine)
    return at


@pytest.mark.parametrize("lost", ["none", "of another order", "another set"])
def test_what_two_readings_do_not_agree_on_is_never_put_back_after_a_crash(tmp_path: Path, lost: str) -> None:
    at = stopped_at(tmp_path, "DISABLE", live(LiveTable(ODD, False)))
    assert at.machine.backup is not None
    at.machine.backup_number += lost == "of another order"
    other = replace(at.machine.backup, backlash=0.5, digest="other")
    at.machine.backup = {"none": None, "another set": other}.get(lost, at.machine.backup)
    (found,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
    record = run_virtual(lambda: recover_table(found, bench(tmp_path, machine=at.machine).context))
    assert record.outcome == "held"
    assert any("E-PUSH-UNCONFIRMED" in step for step in lines(record))
    assert at.machine.own == LiveTable(ODD, False)
    assert at.machine.writes == []


def nothing(_machine: Machine) -> None:
    return None


def live(found: LiveTable) -> Callable[[Machine], None]:
    return changing(own=found)


ROWS: list[tuple[str, str, Callable[[Machine], None], str, str]] = [
    ("before disable, as it was", "SNAPSHOT", nothing, "R-PUSH-UNTOUCHED", "close"),
    ("disable announced, off", "DISABLE", live(LiveTable(OLD, False)), "R-PUSH-DISABLED", "restore"),
    ("writing, mixed and off", "DISABLE", live(LiveTable(ODD, False)), "R-PUSH-HALF", "restore"),
    ("read back, new and off", "LOADED", nothing, "R-PUSH-WRITTEN", "restore"),
    ("enable announced, new and off", "ENABLE", nothing, "R-PUSH-WRITTEN", "restore"),
    ("enable announced, new and on", "ENABLE", live(NEW_ON), "R-PUSH-ENABLED", "restore"),
    ("activated, new and on", "ACTIVATED", nothing, "R-PUSH-ENABLED", "restore"),
    ("neither, on", "LOADED", live(LiveTable(ODD, True)), "R-PUSH-STILL-ON", "disable"),
    ("new and on before enable", "LOADED", live(NEW_ON), "R-PUSH-STILL-ON", "disable"),
    ("neither, on, before any write", "SNAPSHOT", live(LiveTable(ODD, True)), "R-PUSH-FOREIGN", "none"),
    ("switched off by somebody else", "SNAPSHOT", live(LiveTable(OLD, False)), "R-PUSH-FOREIGN", "none"),
    ("a foreign marker", "LOADED", changing(marker=Marker(4711, "in-progress")), "R-PUSH-OTHER-MARKER", "none"),
    ("unreachable", "LOADED", changing(operator=False), "R-PUSH-UNKNOWN", "none"),
    ("another machine", "LOADED", changing(identity=replace(MACHINE, serial="SN-9")), "R-PUSH-UNKNOWN", "none"),
]


@pytest.mark.parametrize(("name", "kind", "change", "code", "action"), ROWS, ids=[row[0] for row in ROWS])
def test_row(tmp_path: Path, name: str, kind: str, change: Any, code: str, action: str) -> None:
    at = stopped_at(tmp_path, kind, change)
    (found,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
    again = bench(tmp_path, machine=at.machine)
    before, writes = at.machine.live(), list(at.machine.writes)
    finding = run_virtual(lambda: inspect_unfinished(found, again.context))
    assert (finding.code, finding.action) == (code, action), name
    assert (at.machine.live(), at.machine.writes) == (before, writes)
    assert set(again.controller.calls) <= READS | {"abort_program"}
    if action == "none":
        with pytest.raises(WriteRefused) as caught:
            run_virtual(lambda: recover_table(found, again.context))
        assert caught.value.code == "E-PUSH-NO-OFFER"
        assert (at.machine.live(), at.machine.writes) == (before, writes)
        assert unfinished_tables(tmp_path / "journal", MACHINE.serial)
        return
    record = run_virtual(lambda: recover_table(found, again.context))
    if action == "disable":  # off first, with every value as it was; then the old table goes back
        assert finding.still_on
        assert (record.outcome, at.machine.writes) == ("held", writes)
        assert at.machine.own == replace(before.own, enabled=False)
        (found,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
        assert run_virtual(lambda: inspect_unfinished(found, again.context)).action == "restore"
        record = run_virtual(lambda: recover_table(found, again.context))
    assert record.outcome == "rolled-back"
    assert at.machine.own == OLD_ON
    assert at.machine.marker.state == "none"
    assert unfinished_tables(tmp_path / "journal", MACHINE.serial) == ()


def test_every_row_refuses_the_next_push_until_it_is_settled(tmp_path: Path) -> None:
    at = stopped_at(tmp_path, "LOADED", nothing)
    again = bench(tmp_path, machine=at.machine)
    record = run_virtual(lambda: push_table(change_of(at.machine), again.context))
    assert any(step.startswith("E-INT-UNFINISHED") for step in lines(record))
    assert at.machine.writes == ["table"]


def test_a_foreign_edit_is_told_three_ways(tmp_path: Path) -> None:
    at = stopped_at(tmp_path, "LOADED", live(LiveTable(ODD, True)))
    (found,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
    again = bench(tmp_path, machine=at.machine)
    finding = run_virtual(lambda: inspect_unfinished(found, again.context))
    assert "point 2: old 4.0, new 12.0, live 9.0 µm" in map(str, finding.difference)
    assert "point 2: old 4.0" in finding.words
    assert finding.as_data()["difference"] == list(map(str, finding.difference))
    longer = replace(ODD, deviations=(*ODD.deviations, *range(20)), maximum=1400.0)
    told = list(map(str, make_finding(found, LiveTable(longer, True), 1e-6).difference))
    assert any(line.startswith("maximum: old 400.0, new 400.0, live 1400.0") for line in told)
    assert told[-1].startswith("and ")


def test_the_fourth_try_is_not_offered(tmp_path: Path) -> None:
    stopped_at(tmp_path, "LOADED", nothing)
    (found,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
    tried = replace(found, entries=(*found.entries, *(journal.Entry("RECOVERING", {}) for _ in range(3))))
    finding = make_finding(tried, LiveTable(NEW, False), 1e-6)
    assert (finding.code, finding.action) == ("R-PUSH-TRIES", "none")
    assert "3 attempts" in finding.words


def test_committed_but_not_put_away_is_only_put_away(tmp_path: Path) -> None:
    at = stopped_at(tmp_path, "COMMITTED", nothing)
    folder = journal.machine_folder(tmp_path / "journal", MACHINE.serial)
    (found,) = journal.read_journals(folder)
    assert unfinished_tables(tmp_path / "journal", MACHINE.serial) == ()
    again = bench(tmp_path, machine=at.machine)
    finding = run_virtual(lambda: inspect_unfinished(found, again.context))
    assert (finding.code, finding.action) == ("R-PUSH-DONE", "close")
    assert again.controller.calls == {}
    assert [one.number for one in journal.set_ended_aside(folder)] == [found.number]
    assert journal.read_journals(folder) == ()
    assert at.machine.own == NEW_ON


def test_the_marker_is_committed_before_the_journal_says_so(tmp_path: Path) -> None:
    at = stopped_at(tmp_path, "EFFECT", nothing)
    assert at.machine.marker.state == "in-progress"
    at = stopped_at(tmp_path / "b", "COMMITTED", nothing) if not (tmp_path / "b").mkdir() else at
    assert at.machine.marker.state == "committed"


def test_a_journal_damaged_in_its_first_line_holds(tmp_path: Path) -> None:
    at = stopped_at(tmp_path, "LOADED", nothing)
    (found,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
    data = bytearray(found.path.read_bytes())
    data[20] ^= 1
    found.path.write_bytes(bytes(data))
    (damaged,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
    assert (damaged.entries, str(damaged.broken)) == ((), f"line 1 of {len(found.entries)} is damaged")
    finding = make_finding(damaged, None, 0.0)
    assert (finding.code, finding.action, finding.axis) == ("R-PUSH-DAMAGED", "none", "")
    again = bench(tmp_path, machine=at.machine)
    assert run_virtual(lambda: inspect_unfinished(damaged, again.context)).code == "R-PUSH-DAMAGED"
    with pytest.raises(WriteRefused):
        run_virtual(lambda: recover_table(damaged, again.context))
    assert again.controller.calls == {}


def test_neighbours_switched_off_count_as_disabled(tmp_path: Path) -> None:
    stopped_at(tmp_path, "DISABLE", nothing)
    (found,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
    noted = replace(found, entries=(*found.entries, journal.Entry("SNAPSHOT", {"coupled": True})))
    assert make_finding(noted, ControllerReading(OLD_ON, neighbours_on=False), 1e-6).code == "R-PUSH-DISABLED"
    assert make_finding(noted, ControllerReading(OLD_ON, neighbours_on=True), 1e-6).code == "R-PUSH-UNTOUCHED"


# ---- the key ----------------------------------------------------------------------------------------


def push(at: Bench, new: Any = NEW, **context: Any) -> PushRecord:
    change = change_of(at.machine, new)
    return run_virtual(lambda: push_table(replace(change, base_digest=BASE), replace(at.context, **context)))


BASE = Machine(OLD_ON).live().digest


def test_the_same_key_and_plan_give_the_same_answer_without_a_call(tmp_path: Path) -> None:
    at = bench(tmp_path)
    first = push(at, key="order-1")
    assert first.outcome == "committed"
    again = bench(tmp_path, machine=at.machine)
    second = push(again, key="order-1")
    assert (second.transaction, second.outcome, second.effect) == (first.transaction, "committed", first.effect)
    assert second.backup_path == first.backup_path
    assert again.controller.calls == {}


def test_the_same_key_for_another_plan_is_refused(tmp_path: Path) -> None:
    at = bench(tmp_path)
    push(at, key="order-1")
    again = bench(tmp_path, machine=at.machine)
    record = push(again, OLD, key="order-1")
    assert record.outcome == "refused"
    assert any(step.startswith("E-INT-KEY") for step in lines(record))
    assert at.machine.writes == ["table"]


def test_without_a_key_or_with_a_fresh_one_the_base_decides(tmp_path: Path) -> None:
    at = bench(tmp_path)
    push(at, key="order-1")
    for key in ("", "order-2"):
        again = bench(tmp_path, machine=at.machine)
        assert push(again, key=key).outcome == "already-applied"
    other = bench(tmp_path, machine=at.machine)
    record = push(other, ODD_NEW, key="order-3")
    assert any(step.startswith("E-INT-LOST-UPDATE") for step in lines(record))
    assert at.machine.writes == ["table"]


ODD_NEW = table(0.0, 4.0, 11.0, 14.5, 8.0, 4.0, -3.0, -6.0, 0.0)


def test_a_rolled_back_push_answers_so_again(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.machine.wrong_point = 0.5
    at.controller.faults[("abort_program", 1, "after")] = changing(wrong_point=0.0)
    assert push(at, key="order-1").outcome == "rolled-back"
    again = bench(tmp_path, machine=at.machine)
    assert push(again, key="order-1").outcome == "rolled-back"
    assert again.controller.calls == {}


def test_an_aborted_one_may_be_tried_again_under_its_key(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.controller.faults[("saved_tables", 1, "before")] = deadline
    with pytest.raises(DeadlineExceeded):
        push(at, key="order-1")
    again = bench(tmp_path, machine=at.machine)
    assert push(again, key="order-1").outcome == "committed"


def test_one_push_for_the_whole_gateway(tmp_path: Path) -> None:
    at = bench(tmp_path)
    with machine_lock(journal.machine_folder(tmp_path / "journal", "ANOTHER")), pytest.raises(BusyError):
        push(at)
    assert at.controller.calls == {}


def test_who_pushed_and_who_agreed_stand_in_the_journal(tmp_path: Path) -> None:
    at = bench(tmp_path)
    change = change_of(at.machine)
    plan = plan_hash(change, MACHINE)
    given, until = "2026-11-21T09:59:00+00:00", "2026-11-21T10:09:00+00:00"
    agreed = Approval("second", plan, change.base_digest, "SN-1", given, until)
    context = replace(at.context, actor="first", approvals=(agreed,), approvals_needed=2)
    assert run_virtual(lambda: push_table(change, context)).outcome == "committed"
    leased = journals_of(tmp_path)[0].entries[0].facts
    assert (leased["actor"], leased["approved_by"], leased["plan"]) == ("first", ["second"], plan)
