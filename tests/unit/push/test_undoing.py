"""A committed push taken back: the old table live again, or nothing written, or the newer table back; never another."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from drivers.clock import run_virtual
from drivers.errors import DeadlineExceeded
from drivers.types.tables import LiveTable
from gateway.domain.outcomes import PushRecord
from gateway.errors import RollbackFailed, VerifyError
from gateway.push import journal, outcome_error
from gateway.push.history import CommittedPush, committed_pushes, newest_not_undone
from gateway.push.rollback import compare_with_push, preflight_rollback, roll_back_push
from gateway.push.transaction import push_table
from tests.steps import lines
from tests.unit.push.double import (
    MACHINE,
    NEVER,
    NEW,
    OLD,
    Bench,
    Killed,
    Machine,
    Reaper,
    bench,
    change_of,
    changing,
    deadline,
    only_old_or_new_enabled,
    table,
)
from tests.unit.push.test_cross import WAVE, change_for, held, stage, stored

OLD_ON, NEW_ON = LiveTable(OLD, enabled=True), LiveTable(NEW, enabled=True)
LATER = table(0.0, 6.0, 13.0, 14.5, 8.0, 3.0, -3.0, -5.0, 0.0)


def pushed(root: Path, old: LiveTable = OLD_ON, *, by_hand: bool = False) -> Bench:
    at = bench(root, old, by_hand=by_hand)
    assert run_virtual(lambda: push_table(change_of(at.machine), at.context)).outcome == "committed"
    assert at.machine.own == NEW_ON
    return again(root, at.machine, by_hand=by_hand)


def again(root: Path, machine: Machine, reaper: Reaper | None = None, *, by_hand: bool = False) -> Bench:
    at = bench(root, reaper=reaper, machine=machine, by_hand=by_hand)
    at.controller.calls.clear()
    return at


def last(at: Bench) -> CommittedPush:
    done = newest_not_undone(committed_pushes(at.context.journals, MACHINE.serial, "X1"))
    assert done is not None
    return done


def take_back(at: Bench, **context: object) -> PushRecord:
    done = last(at)
    return run_virtual(lambda: roll_back_push(done, replace(at.context, **context)))


@pytest.mark.parametrize("by_hand", [False, True])
@pytest.mark.parametrize("old", [OLD_ON, LiveTable(OLD, enabled=False), LiveTable(NEVER, enabled=False)])
def test_the_table_from_before_is_live_again(tmp_path: Path, old: LiveTable, by_hand: bool) -> None:
    at = pushed(tmp_path, old, by_hand=by_hand)
    record = take_back(at, proof=None)
    assert record.outcome == "committed"
    assert outcome_error(record) is None
    assert at.machine.own.enabled == old.enabled
    assert at.machine.own.table.deviations == old.table.deviations
    assert only_old_or_new_enabled(at.machine, OLD, NEW)
    assert newest_not_undone(committed_pushes(at.context.journals, MACHINE.serial, "X1")) is None
    history = committed_pushes(at.context.journals, MACHINE.serial, "X1")
    assert history[-1].new.enabled == old.enabled
    assert at.machine.marker.state == "committed"


def test_pushes_are_taken_back_one_after_the_other(tmp_path: Path) -> None:
    at = pushed(tmp_path)
    assert run_virtual(lambda: push_table(change_of(at.machine, LATER), at.context)).outcome == "committed"
    assert take_back(at).outcome == "committed"
    assert at.machine.own == NEW_ON
    assert take_back(at).outcome == "committed"
    assert at.machine.own == OLD_ON


def test_a_foreign_edit_is_left_alone_and_told_three_ways(tmp_path: Path) -> None:
    at = pushed(tmp_path)
    foreign = replace(NEW, deviations=(*NEW.deviations[:3], 6.0, *NEW.deviations[4:]))
    at.machine.become(LiveTable(foreign, enabled=True))
    writes = list(at.machine.writes)
    record = take_back(at)
    assert record.outcome == "refused"
    error = outcome_error(record)
    assert error is not None
    assert "E-PUSH-UNDO-FOREIGN" in str(error)
    assert "at 1 of 9 points; at 1 of them it has the previous value. First at 150" in str(error)
    assert at.machine.own.table == foreign
    assert at.machine.writes == writes
    assert "stage" not in at.controller.calls


def test_switched_off_by_somebody_is_a_foreign_edit(tmp_path: Path) -> None:
    at = pushed(tmp_path)
    at.machine.become(LiveTable(NEW, enabled=False))
    assert take_back(at).outcome == "refused"
    assert at.machine.own == LiveTable(NEW, enabled=False)


def test_already_back_is_said_and_nothing_written(tmp_path: Path) -> None:
    at = pushed(tmp_path)
    at.machine.become(OLD_ON)
    writes = list(at.machine.writes)
    assert take_back(at).outcome == "already-applied"
    assert at.machine.writes == writes


@pytest.mark.parametrize(
    ("state", "code"),
    [
        ({"mode": "JOG"}, "E-INT-MODE"),
        ({"alarms": (4075,)}, "E-INT-ALARM"),
        ({"referenced": False}, "E-INT-REFERENCE"),
        ({"standing": False}, "E-INT-MOVING"),
        ({"access_level": 7}, "E-INT-ACCESS"),
        ({"identity": replace(MACHINE, serial="SN-2")}, "E-INT-MACHINE"),
    ],
)
def test_the_interlocks_are_those_of_every_push(tmp_path: Path, state: dict[str, object], code: str) -> None:
    at = pushed(tmp_path)
    changing(**state)(at.machine)
    record = take_back(at)
    assert record.outcome == "refused"
    assert any(code in step for step in lines(record))
    assert "stage" not in at.controller.calls


@pytest.mark.parametrize(
    ("changed", "code"), [({"typed_name": ""}, "E-INT-NAME"), ({"audit_broken": "cut"}, "E-INT-AUDIT-BROKEN")]
)
def test_consent_and_a_whole_audit_are_needed(tmp_path: Path, changed: dict[str, object], code: str) -> None:
    at = pushed(tmp_path)
    record = take_back(at, **changed)
    assert record.outcome == "refused"
    assert any(code in step for step in lines(record))
    assert "stage" not in at.controller.calls


def test_an_unfinished_push_is_recovered_first(tmp_path: Path) -> None:
    at = pushed(tmp_path)
    folder = journal.machine_folder(at.context.journals, MACHINE.serial)
    left = journal.Journal.create(folder, 900_000)
    left.append("LEASED", axis="X1", purpose="table")
    left.close()
    record = take_back(at)
    assert any("E-INT-UNFINISHED" in step for step in lines(record))
    assert at.machine.own == NEW_ON


def test_asking_writes_nothing(tmp_path: Path) -> None:
    at = pushed(tmp_path)
    done = last(at)
    assert run_virtual(lambda: preflight_rollback(done, at.context)).refusals == ()
    assert set(at.controller.calls) <= {"identify", "state", "marker", "table_limits"}


@pytest.mark.parametrize("call", ["stage", "read_back", "activate", "confirm", "restarted"])
def test_a_failure_leads_back_to_the_newer_table(tmp_path: Path, call: str) -> None:
    at = pushed(tmp_path)
    at.controller.faults[call, 1, "before"] = deadline
    record = take_back(at)
    assert record.outcome in ("rolled-back", "held")
    assert only_old_or_new_enabled(at.machine, OLD, NEW)
    error = outcome_error(record)
    assert isinstance(error, VerifyError if record.outcome == "rolled-back" else RollbackFailed)
    if record.outcome == "rolled-back":
        assert at.machine.own == NEW_ON


def test_a_wire_that_fails_before_anything_is_written_ends_it(tmp_path: Path) -> None:
    at = pushed(tmp_path)
    at.controller.faults["saved_tables", 1, "before"] = deadline
    with pytest.raises(DeadlineExceeded):
        take_back(at)
    assert at.machine.own == NEW_ON
    assert newest_not_undone(committed_pushes(at.context.journals, MACHINE.serial, "X1")) is not None


def _killed(root: Path, step: int) -> bool:
    """One rollback killed at a step; whether it was killed."""
    root.mkdir()
    at = pushed(root)
    here, done = again(root, at.machine, Reaper(step)), last(at)
    try:
        assert run_virtual(lambda: roll_back_push(done, here.context)).outcome == "committed"
    except Killed:
        assert only_old_or_new_enabled(at.machine, OLD, NEW)
        return True
    return False


def test_killed_anywhere_old_or_new_is_live_or_nothing(tmp_path: Path) -> None:
    step = 0
    while _killed(tmp_path / str(step), step):
        step += 1
    assert step > 30


@pytest.mark.parametrize(
    ("live", "kind"),
    [
        (NEW_ON, "as-approved"),
        (LiveTable(NEW, enabled=False), "switched-off"),
        (OLD_ON, "before"),
        (LiveTable(LATER, enabled=True), "differs"),
    ],
)
def test_the_live_table_is_compared(tmp_path: Path, live: LiveTable, kind: str) -> None:
    at = pushed(tmp_path)
    at.machine.become(live)
    assert compare_with_push(at.machine.own, last(at), allowed=1e-6).kind == kind


LATER_WAVE = replace(WAVE, deviations=(0.0, 4.0, 8.0, 9.5, 4.0, 0.0, -5.0, -2.0, 0.0))


@pytest.mark.parametrize("by_hand", [False, True])
@pytest.mark.parametrize("sign", [1, -1])
def test_cross_tables_are_taken_back_in_the_proved_sign(tmp_path: Path, sign: int, by_hand: bool) -> None:
    at = stage(tmp_path, sign, by_hand=by_hand)
    for wanted in (WAVE, LATER_WAVE):
        change = change_for(at.machine, wanted, sign)
        assert run_virtual(lambda change=change: push_table(change, at.context)).outcome == "committed"
    done = newest_not_undone(committed_pushes(at.context.journals, MACHINE.serial, "X1-cec2", at.context.meant))
    assert done is not None
    assert run_virtual(lambda: roll_back_push(done, at.context)).outcome == "committed"
    assert held(at.machine, 2) == LiveTable(stored(WAVE, sign), enabled=True)
    first = newest_not_undone(committed_pushes(at.context.journals, MACHINE.serial, "X1-cec2", at.context.meant))
    assert first is not None
    record = run_virtual(lambda: roll_back_push(first, at.context))
    assert record.outcome == "committed", record.steps
    assert not any(one.enabled and one.table.index == 2 for one in at.machine.live().cross)
    assert newest_not_undone(committed_pushes(at.context.journals, MACHINE.serial, "X1-cec2", at.context.meant)) is None
    assert max(map(abs, at.machine.jumps)) <= 1.0
