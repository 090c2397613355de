"""Pushing one table: committed, refused, rolled back or held, and never a wrong table enabled."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.clock import run_virtual
from drivers.errors import DeadlineExceeded, DeviceRefused, TransportError, TrueflankError, catalogue, words
from drivers.message import Message
from drivers.types.tables import LiveTable
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.errors import BusyError, RollbackFailed, StoreError, VerifyError, WriteRefused
from gateway.push import journal, load, outcome_error
from gateway.push.journal import machine_lock
from gateway.push.recovery import recover_table
from gateway.push.transaction import push_table
from tests.sizes import few
from tests.steps import lines
from tests.unit.push.double import (
    MACHINE,
    NEVER,
    NEW,
    OLD,
    Bench,
    Fault,
    Machine,
    bench,
    change_of,
    changing,
    deadline,
    journals_of,
    only_old_or_new_enabled,
    refuse,
    table,
)

OLD_ON = LiveTable(OLD, enabled=True)
NEW_ON = LiveTable(NEW, enabled=True)


def push(at: Bench, change: TableChange | None = None, **context: object) -> PushRecord:
    wanted = change or change_of(at.machine)
    return run_virtual(lambda: push_table(wanted, replace(at.context, **context)))


@pytest.mark.parametrize("old", [OLD_ON, LiveTable(OLD, enabled=False), LiveTable(NEVER, enabled=False)])
def test_committed(tmp_path: Path, old: LiveTable) -> None:
    at = bench(tmp_path, old)
    before = at.machine.live()
    record = push(at)
    assert record.outcome == "committed"
    assert at.machine.own == NEW_ON
    assert at.machine.writes == ["table"]
    assert not Path(record.backup_path).is_absolute()
    (kept,) = tmp_path.rglob(Path(record.backup_path).name)
    assert kept.read_text() == before.native
    assert len(record.effect) == 3
    assert all(abs(expected - found) < 0.05 and abs(expected) > 1 for _place, expected, found in record.effect)
    slopes = {
        np.sign(np.interp(p + 1, NEW.positions, NEW.deviations) - np.interp(p - 1, NEW.positions, NEW.deviations))
        for p, _e, _f in record.effect
    }
    assert {1.0, -1.0} <= slopes
    (found,) = journals_of(tmp_path)
    assert found.kinds == (
        "LEASED",
        "SNAPSHOT",
        "DISABLE",
        "BACKUP",
        "LOADED",
        "ENABLE",
        "ENABLED",
        "ACTIVATED",
        "EFFECT",
        "COMMITTED",
    )
    assert found.path.parent.name == "done"
    assert record.transaction == found.number
    assert 0 < record.transaction < 1_000_000_000
    assert outcome_error(record) is None


def test_again_is_already_applied_with_no_write(tmp_path: Path) -> None:
    at = bench(tmp_path)
    change = change_of(at.machine)
    assert push(at, change).outcome == "committed"
    again = bench(tmp_path, machine=at.machine)
    record = push(again, change)
    assert record.outcome == "already-applied"
    assert at.machine.writes == ["table"]
    assert not any(call in again.controller.calls for call in ("stage", "activate"))
    same = push(bench(tmp_path, machine=at.machine), change_of(at.machine, NEW))
    assert same.outcome == "already-applied"


def test_numbers_are_unique_and_kept(tmp_path: Path) -> None:
    at = bench(tmp_path)
    numbers = []
    for new in (NEW, OLD, NEW):
        at = bench(tmp_path, machine=at.machine)
        numbers.append(push(at, change_of(at.machine, new)).transaction)
    assert len(set(numbers)) == 3
    assert numbers == sorted(numbers)


def test_skipped_asks_nothing(tmp_path: Path) -> None:
    at = bench(tmp_path)
    record = push(at, replace(change_of(at.machine), skipped=Message.stored("inside its uncertainty")))
    assert (record.outcome, record.steps) == ("skipped", (Message.stored("inside its uncertainty"),))
    assert at.controller.calls == {}


def test_a_tables_changed_after_the_capture_is_refused_untouched(tmp_path: Path) -> None:
    at = bench(tmp_path)
    change = change_of(at.machine)
    at.machine.own = LiveTable(table(0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0), enabled=True)
    before = at.machine.live()
    record = push(at, change)
    assert record.outcome == "refused"
    assert at.machine.live() == before
    assert at.machine.writes == []
    error = outcome_error(record)
    assert isinstance(error, WriteRefused)
    assert error.exit_code == 8
    assert any(str(fields.get("reason", "")).startswith("E-INT-LOST-UPDATE") for code, fields in at.told)
    assert "E-INT-LOST-UPDATE" in str(error)


@pytest.mark.parametrize("part", ["cec", "backlash", "switch"])
def test_whatever_else_changed_since_the_capture_is_seen(tmp_path: Path, part: str) -> None:
    at = bench(tmp_path)
    change = change_of(at.machine)
    if part == "cec":
        at.machine.cross = (LiveTable(replace(OLD, kind="cross", input_axis="Z1"), enabled=True),)
    elif part == "backlash":
        at.machine.backlash = 0.003
    else:
        at.machine.own = LiveTable(OLD, enabled=False)
    assert push(at, change).outcome == "refused"
    assert at.machine.writes == []


def test_every_reason_at_once_and_no_program_sent(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.machine.alarms, at.machine.mode, at.machine.referenced, at.machine.reserved = (700001,), "JOG", False, 5
    record = push(at, typed_name="", proof=None)
    codes = {step.split(":")[0] for step in lines(record)}
    assert codes == {
        "E-INT-ALARM",
        "E-INT-MODE",
        "E-INT-REFERENCE",
        "E-INT-POINTS",
        "E-INT-NAME",
        "E-INT-NO-PROOF",
    }
    assert not set(at.controller.calls) - {"identify", "state", "table_limits", "marker"}
    assert journals_of(tmp_path) == ()


def test_busy(tmp_path: Path) -> None:
    at = bench(tmp_path)
    with machine_lock(journal.machine_folder(tmp_path / "journal", "SN-1")), pytest.raises(BusyError) as caught:
        push(at)
    assert "process" in caught.value.fields["holder"]
    assert push(at).outcome == "committed"


ROLLED_BACK: dict[str, tuple[str, Fault]] = {
    "mismatch": ("before read_back", changing(wrong_point=0.5)),
    "program counts mismatches": ("after read_back", refuse),
    "read_back times out": ("after read_back", deadline),
    "stage times out": ("after stage", deadline),
    "stage is refused": ("before stage", refuse),
    "release is ignored": ("before activate", changing(ignore_release=True)),
    "release times out unsent": ("before activate", deadline),
    "release times out sent": ("after activate", deadline),
    "confirm times out": ("after confirm", deadline),
    "restarted times out": ("after restarted", deadline),
    "reset forgets the reference": ("after restarted", changing(referenced=False)),
    "alarm between the halves": ("after read_back", changing(alarms=(4075,))),
    "mode changed between the halves": ("after read_back", changing(mode="JOG")),
    "axis moved between the halves": ("after read_back", changing(position=150.0)),
}


@pytest.mark.parametrize("name", ROLLED_BACK)
def test_rolled_back(tmp_path: Path, name: str) -> None:
    place, fault = ROLLED_BACK[name]
    when, call = place.split()
    at = bench(tmp_path)

    def once(machine: Machine) -> None:
        del at.controller.faults[(call, 1, when)]
        at.controller.faults[("abort_program", 0, "after")] = changing(
            alarms=(), mode="AUTO", wrong_point=0.0, ignore_release=False, referenced=True
        )
        fault(machine)

    at.controller.faults[(call, 1, when)] = once
    record = push(at)
    assert record.outcome == "rolled-back", record.steps
    assert at.machine.own == OLD_ON
    assert at.machine.acting == OLD
    assert only_old_or_new_enabled(at.machine, OLD, NEW)
    assert at.machine.writes.count("table") <= 1
    assert at.machine.writes.count("restore") <= 1
    (found,) = journals_of(tmp_path)
    assert found.is_ended
    assert found.kinds[-1] == "ROLLED_BACK"
    error = outcome_error(record)
    assert isinstance(error, VerifyError)
    assert error.exit_code == 9


def test_no_effect_is_rolled_back(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.machine.ignore_reset = True
    at.controller.faults[("abort_program", 1, "after")] = changing(ignore_reset=False)
    record = push(at)
    assert record.outcome == "rolled-back"
    assert any("E-PUSH-EFFECT" in step for step in lines(record))
    assert at.machine.own == OLD_ON


def test_the_independent_checker_finds_what_a_blind_comparison_lets_through(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    at = bench(tmp_path)
    seen = load.differences
    monkeypatch.setattr(load, "differences", lambda *asked: [])

    def once(machine: Machine) -> None:
        machine.wrong_point = 0.5
        at.controller.faults[("abort_program", 0, "after")] = whole_again

    def whole_again(machine: Machine) -> None:
        machine.wrong_point = 0.0
        monkeypatch.setattr(load, "differences", seen)

    at.controller.faults[("read_back", 1, "before")] = once
    record = push(at)
    assert record.outcome == "rolled-back"
    assert any("E-PUSH-CHECK" in line for line in codes_in(record))
    assert only_old_or_new_enabled(at.machine, OLD, NEW)
    assert at.machine.acting == OLD


def codes_in(record: PushRecord) -> list[str]:
    """Every code that a record's steps name, those of messages in fields too."""
    return [str(step.as_data()) for step in record.steps]


def test_a_control_that_restarts_is_waited_for(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.machine.wrong_point = 0.5
    looks: list[int] = []

    def restarting(_machine: Machine) -> None:
        looks.append(1)
        if len(looks) == 8:
            del at.controller.faults[("state", 0, "before")]
        raise TransportError("E-TEST-DOWN", "double", retryable=True)

    def begin(machine: Machine) -> None:
        machine.wrong_point = 0.0
        at.controller.faults[("state", 0, "before")] = restarting

    at.controller.faults[("abort_program", 1, "after")] = begin
    assert push(at).outcome == "rolled-back"
    assert len(looks) == 8


@pytest.mark.parametrize("old", [OLD_ON, LiveTable(OLD, enabled=False), LiveTable(NEVER, enabled=False)])
def test_the_switch_comes_back_as_it_was(tmp_path: Path, old: LiveTable) -> None:
    at = bench(tmp_path, old)
    at.machine.wrong_point = 0.5
    at.controller.faults[("abort_program", 1, "after")] = changing(wrong_point=0.0)
    assert push(at).outcome == "rolled-back"
    assert at.machine.own == old


def _replaced(machine: Machine) -> None:
    machine.own = LiveTable(table(*[0.0, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0, 0.0]), enabled=True)


@pytest.mark.parametrize("fault", [_replaced, changing(backlash=0.5)])
def test_changed_between_snapshot_and_load_goes_back_to_neither_reading(tmp_path: Path, fault: Fault) -> None:
    at = bench(tmp_path)
    at.controller.faults[("stage", 1, "before")] = fault
    record = push(at)
    assert record.outcome == "held"
    assert any("E-PUSH-LOST-UPDATE" in step for step in lines(record))
    assert any("E-PUSH-UNCONFIRMED" in step for step in lines(record))
    assert at.machine.own == LiveTable(NEW, enabled=False)
    assert "restore" not in at.machine.writes
    (left,) = journals_of(tmp_path)
    context = bench(tmp_path, machine=at.machine).context

    async def main() -> PushRecord:
        return await recover_table(left, context)

    assert run_virtual(main).outcome == "held"
    assert not at.machine.own.enabled


def test_changed_between_two_readings_of_the_driver_nothing_is_sent(tmp_path: Path) -> None:
    at = bench(tmp_path, by_hand=True)
    at.controller.faults[("stage", 1, "before")] = _replaced
    with pytest.raises(VerifyError, match="E-PUSH-LOST-UPDATE"):
        push(at)
    assert at.machine.writes == []
    assert at.machine.own.enabled
    assert at.machine.marker.state == "none"
    (found,) = journals_of(tmp_path)
    assert found.kinds[-1] == "ABORTED"


@pytest.mark.parametrize("lost", ["none", "of another order", "another table"])
def test_a_failed_load_is_taken_back_only_with_a_second_reading(tmp_path: Path, lost: str) -> None:
    at = bench(tmp_path)

    def fail(machine: Machine) -> None:
        assert machine.backup is not None
        machine.backup_number += lost == "of another order"
        other = replace(machine.backup, own=LiveTable(NEW, enabled=True), digest="")
        machine.backup = {"none": None, "another table": other}.get(lost, machine.backup)
        deadline(machine)

    at.controller.faults[("read_back", 1, "after")] = fail
    record = push(at)
    assert record.outcome == "held"
    assert any("E-PUSH-UNCONFIRMED" in step for step in lines(record))
    assert at.machine.own == LiveTable(NEW, enabled=False)
    assert at.machine.writes == ["table"]


HELD: dict[str, tuple[str, Fault]] = {
    "another machine answers": ("after read_back", changing(identity=replace(MACHINE, serial="SN-2"))),
    "another software": ("after read_back", changing(identity=replace(MACHINE, version="V4.9"))),
    "the operator is gone": ("before read_back", changing(operator=False)),
    "the operator leaves between": ("after read_back", changing(operator=False)),
    "the operator leaves before activation": ("before restarted", changing(operator=False)),
    "every write is wrong": ("before read_back", changing(wrong_point=1.0)),
    "an alarm that stays": ("after read_back", changing(alarms=(25000,))),
    "something else changed between": ("before read_back", changing(backlash=0.5)),
    "a foreign table appears enabled": ("before saved_tables 2", _replaced),
}


# Whoever cannot read that it is off says that it is on.
STILL_ON = {
    "another machine answers",
    "another software",
    "the operator is gone",
    "the operator leaves before activation",
}


@pytest.mark.parametrize("name", HELD)
def test_held(tmp_path: Path, name: str) -> None:
    place, fault = HELD[name]
    when, call, number = (*place.split(), "1")[:3]
    at = bench(tmp_path)
    at.controller.faults[(call, int(number), when)] = fault
    if name.startswith("a foreign"):
        at.machine.ignore_reset = True
        at.controller.faults[("prepare_stops", 3, "before")] = _replaced
    record = push(at)
    assert record.outcome == ("held-on" if name in STILL_ON else "held"), record.steps
    (found,) = journals_of(tmp_path)
    assert not found.is_ended
    assert (found.kinds[-1], found.latest("on")) == ("HELD", name in STILL_ON)
    assert at.machine.own.enabled is (name in STILL_ON and not name.startswith("another"))
    loud = [code for code, _fields in at.told if code in ("P-PUSH-HELD", "P-PUSH-HELD-ON")]
    assert loud[-1] == ("P-PUSH-HELD-ON" if name in STILL_ON else "P-PUSH-HELD")
    assert at.machine.writes.count("restore") <= 1
    assert only_old_or_new_enabled(at.machine, OLD, NEW) or name.startswith("a foreign")
    error = outcome_error(record)
    assert isinstance(error, RollbackFailed)
    assert error.exit_code == (12 if name in STILL_ON else 9)
    assert record.backup_path in str(error)
    again = push(bench(tmp_path, machine=at.machine))
    assert any(step.startswith("E-INT-UNFINISHED") for step in lines(again))


@pytest.mark.parametrize("call", ["identify", "state", "table_limits", "prepare_stops", "wait_stop", "saved_tables"])
@pytest.mark.parametrize("when", ["before", "after"])
def test_before_the_first_half_an_error_is_the_callers_and_changes_nothing(
    tmp_path: Path, call: str, when: str
) -> None:
    at = bench(tmp_path)
    before = at.machine.live()
    at.controller.faults[(call, 1, when)] = deadline
    with pytest.raises(DeadlineExceeded):
        push(at)
    assert at.machine.live() == before
    assert at.machine.writes == []
    assert all(found.is_ended for found in journals_of(tmp_path))


def test_nobody_starts_the_reading_program(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.machine.operator = False
    with pytest.raises(DeadlineExceeded):
        push(at)
    assert at.machine.own == OLD_ON


def test_quantised_by_less_than_half_a_place_is_the_same(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.machine.quantum = 0.0008
    assert push(at).outcome == "committed"
    at = bench(tmp_path / "b") if (tmp_path / "b").mkdir() is None else at
    at.machine.quantum = 0.3
    at.controller.faults[("abort_program", 1, "after")] = changing(quantum=0.0)
    assert push(at).outcome == "rolled-back"


def test_a_poisoned_journal_stops_everything(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    at = bench(tmp_path)
    real = journal.Journal.append

    def failing(self: journal.Journal, kind: str, **facts: object) -> None:
        if kind == "ENABLE":
            monkeypatch.setattr("os.fsync", lambda _fd: (_ for _ in ()).throw(OSError(5, "Input/output error")))
        real(self, kind, **facts)

    monkeypatch.setattr(journal.Journal, "append", failing)
    with pytest.raises(StoreError) as caught:
        push(at)
    assert caught.value.code == "E-PUSH-JOURNAL"
    assert "activate" not in at.controller.calls
    assert not at.machine.own.enabled


def test_a_full_disk_refuses_before_anything_is_sent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    at = bench(tmp_path)
    monkeypatch.setattr(journal, "FREE_BYTES", 10**18)
    with pytest.raises(StoreError) as caught:
        push(at)
    assert caught.value.code == "E-PUSH-DISK"
    assert not set(at.controller.calls) - {"identify", "state", "table_limits", "marker"}


def test_cancelled_between_the_halves_leaves_it_disabled_and_unfinished(tmp_path: Path) -> None:
    at = bench(tmp_path)

    def cancel(_machine: Machine) -> None:
        task = asyncio.current_task()
        assert task is not None
        task.cancel()

    at.controller.faults[("read_back", 1, "after")] = cancel
    with pytest.raises(asyncio.CancelledError):
        push(at)
    at.machine.go_on()
    assert not at.machine.own.enabled
    assert [found.is_ended for found in journals_of(tmp_path)] == [False]


@pytest.mark.parametrize("seed", few(range(120), 50))
def test_seeded_faults_never_enable_a_wrong_table(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    at = bench(tmp_path, [OLD_ON, LiveTable(OLD, enabled=False), LiveTable(NEVER, enabled=False)][seed % 3])
    old = at.machine.own
    calls = ["identify", "state", "prepare_stops", "wait_stop", "release_stop", "saved_tables", "stage"]
    calls += ["read_back", "activate", "confirm", "restarted", "abort_program"]
    faults = [
        deadline,
        refuse,
        changing(operator=False),
        changing(wrong_point=0.7),
        changing(ignore_release=True),
        changing(ignore_reset=True),
        changing(alarms=(1,)),
        changing(identity=replace(MACHINE, serial="?")),
        changing(referenced=False),
        changing(position=170.0),
        changing(wrong_point=0.0, operator=True),
    ]
    for _ in range(int(rng.integers(1, 5))):
        call, when = str(rng.choice(calls)), str(rng.choice(["before", "after"]))
        at.controller.faults[(call, int(rng.integers(1, 4)), when)] = faults[int(rng.integers(len(faults)))]
    outcome = "raised"
    try:
        outcome = push(at).outcome
    except TrueflankError:
        assert at.machine.own == old
    assert only_old_or_new_enabled(at.machine, old.table, NEW), outcome
    if outcome == "committed":
        assert at.machine.own == NEW_ON
    if outcome in ("rolled-back", "refused", "raised"):
        assert at.machine.own == old
    if outcome in ("held", "held-on"):
        assert not journals_of(tmp_path)[0].is_ended
    assert outcome != "held" or not at.machine.own.enabled


def test_every_code_said_or_raised_is_in_the_catalogue(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.machine.wrong_point = 1.0
    push(at)
    for code, fields in at.told:
        assert code in catalogue()
        assert "<" not in words(code, **fields)
    assert issubclass(DeviceRefused, TrueflankError)
