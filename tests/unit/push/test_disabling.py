"""Held means off, read back; until then it says "still on", and a disable-only order leads there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from drivers.clock import run_virtual
from drivers.errors import TableActs
from drivers.types.orders import DisableOrder
from drivers.types.tables import LiveTable
from gateway.errors import StillOn
from gateway.push import journal, outcome_error
from gateway.push.disable import disable_table, preflight_disable
from gateway.push.recovery import inspect_unfinished, recover_table, unfinished_tables
from gateway.push.table_status import held_pushes
from gateway.push.transaction import push_table
from tests.steps import lines
from tests.unit.push.double import (
    MACHINE,
    OLD,
    Bench,
    Killed,
    Machine,
    Reaper,
    bench,
    change_of,
    changing,
    deadline,
    refuse,
    table,
)
from tests.unit.push.test_recovery import journal_under

ODD = table(0.0, 1.0, 9.0, 1.0, 9.0, 1.0, 9.0, 1.0, 0.0)
ORDER = DisableOrder(0, "axis", "X1")


def swapping(machine: Machine) -> None:
    """The control exchanges two points while it starts, before it takes the table over."""
    values = list(machine.own.table.deviations)
    values[2], values[3] = values[3], values[2]
    machine.own = replace(machine.own, table=replace(machine.own.table, deviations=tuple(values)))


def by_hand(machine: Machine) -> None:
    """Somebody switches compensation on in the middle of a load."""
    machine.own = LiveTable(ODD, enabled=True)


def push(at: Bench) -> str:
    return run_virtual(lambda: push_table(change_of(at.machine), at.context)).outcome


def test_two_points_exchanged_at_the_activating_reset_end_off(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.controller.faults[("restarted", 1, "before")] = swapping
    assert push(at) == "held"
    assert not at.machine.own.enabled
    codes = [code for code, _fields in at.told]
    assert codes.index("P-PUSH-HELD-ON") < codes.index("P-PUSH-DISABLE") < codes.index("P-PUSH-HELD")
    assert codes.index("P-PUSH-DISABLE-MOVES") < codes.index("P-PUSH-DISABLE")


@pytest.mark.parametrize("stays", [False, True])
def test_a_hand_that_switches_on_in_mid_write(tmp_path: Path, stays: bool) -> None:
    at = bench(tmp_path)
    at.controller.faults[("read_back", 1, "after")] = by_hand
    at.machine.stuck_on = stays
    outcome = push(at)
    assert outcome == ("held-on" if stays else "held")
    assert at.machine.own == LiveTable(ODD, enabled=stays)
    (left,) = held_pushes(tmp_path / "journal")
    assert (left.standing, left.needs_attention) == (("still-on", True) if stays else ("off", False))
    (found,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
    finding = run_virtual(lambda: inspect_unfinished(found, bench(tmp_path, machine=at.machine).context))
    assert (finding.action, finding.still_on) == (("disable", True) if stays else ("restore", False))


def test_still_on_has_a_word_and_an_exit_code_of_its_own(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.controller.faults[("read_back", 1, "after")] = by_hand
    at.controller.faults[("prepare_disable", 0, "before")] = refuse
    record = run_virtual(lambda: push_table(change_of(at.machine), at.context))
    error = outcome_error(record)
    assert record.outcome == "held-on"
    assert isinstance(error, StillOn)
    assert (error.code, error.exit_code) == ("E-PUSH-HELD-ON", 12)
    assert [code for code, _fields in at.told if "HELD" in code] == ["P-PUSH-HELD-ON"]


def test_an_order_without_an_answer_is_read_back_and_not_repeated(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.controller.faults[("read_back", 1, "after")] = by_hand
    at.controller.faults[("wait_disabled", 1, "after")] = deadline
    assert push(at) == "held"
    assert at.controller.calls["wait_disabled"] == 1


def test_what_is_whole_is_left_to_a_restore_and_told_as_on(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.controller.faults[("restarted", 1, "before")] = changing(ignore_reset=True)
    at.controller.faults[("stage", 2, "before")] = refuse
    assert push(at) == "held"
    assert not at.machine.own.enabled
    assert "prepare_disable" in at.controller.calls  # what a refused restore left is not known on this road


def test_a_table_that_could_not_be_written_because_it_is_on_is_on_whatever_its_switch_reads(tmp_path: Path) -> None:
    def protected(_machine: Machine) -> None:
        raise TableActs("E-MBX-PROTECTED", "double", command="BEGIN", detail=0)

    at = bench(tmp_path)
    at.controller.faults[("read_back", 0, "before")] = changing(own=LiveTable(OLD, enabled=False))
    at.controller.faults[("read_back", 0, "after")] = protected
    assert push(at) == "held-on"
    assert not at.machine.own.enabled


def test_recovery_switches_off_and_then_restores_however_often_it_was_tried(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.controller.faults[("read_back", 1, "after")] = by_hand
    at.machine.stuck_on = True
    assert push(at) == "held-on"
    for _ in range(4):
        (found,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
        again = bench(tmp_path, machine=at.machine)
        assert run_virtual(lambda found=found, again=again: recover_table(found, again.context)).outcome == "held-on"
    at.machine.stuck_on = False
    for wanted in ("held", "rolled-back"):
        (found,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
        again = bench(tmp_path, machine=at.machine)
        assert run_virtual(lambda found=found, again=again: recover_table(found, again.context)).outcome == wanted
    assert at.machine.own == LiveTable(OLD, enabled=True)


def test_tables_that_cannot_be_read_are_switched_off(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.controller.faults[("read_back", 1, "after")] = by_hand
    at.controller.faults[("prepare_disable", 0, "before")] = refuse
    push(at)
    (found,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
    again = bench(tmp_path, machine=at.machine)
    again.controller.faults[("saved_tables", 0, "before")] = refuse
    finding = run_virtual(lambda: inspect_unfinished(found, again.context))
    assert (finding.code, finding.action) == ("R-PUSH-UNREADABLE", "disable")
    assert run_virtual(lambda: recover_table(found, again.context)).outcome == "held"
    assert not at.machine.own.enabled


# ---- the command's order ----------------------------------------------------------------------------


def test_the_order_of_its_own_ends_its_journal_and_says_when_it_is_off_already(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.machine.position = 100.0
    asked = run_virtual(lambda: preflight_disable(ORDER, at.context))
    assert asked.reading is not None
    assert (asked.reading.enabled, asked.reading.acting, asked.unit, asked.refusals) == (True, 4.0, "um", ())
    record = run_virtual(lambda: disable_table(ORDER, at.context))
    assert (record.outcome, record.before, record.after, record.table) == ("off", 4.0, 0.0, "X1")
    assert at.machine.own == LiveTable(OLD, enabled=False)
    assert at.machine.writes == []
    assert unfinished_tables(tmp_path / "journal", MACHINE.serial) == ()
    assert ("P-PUSH-DISABLE-MOVES", {"axis": "X1", "table": "X1", "acting": 4.0, "unit": "um"}) in at.told
    again = run_virtual(lambda: disable_table(ORDER, at.context))
    assert (again.outcome, again.transaction) == ("already-off", 0)
    assert at.controller.calls["wait_disabled"] == 1


def test_another_machine_or_a_running_program_is_refused_with_every_reason(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.machine.identity = replace(MACHINE, serial="SN-2")
    record = run_virtual(lambda: disable_table(replace(ORDER, axis="Q9"), at.context))
    assert record.outcome == "refused"
    assert [step.split(":")[0] for step in lines(record)] == ["E-INT-MACHINE", "E-INT-AXIS"]
    assert "prepare_disable" not in at.controller.calls


def test_what_stays_on_is_told_and_its_journal_ends(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.machine.stuck_on = True
    record = run_virtual(lambda: disable_table(ORDER, at.context))
    assert record.outcome == "still-on"
    assert record.steps
    assert unfinished_tables(tmp_path / "journal", MACHINE.serial) == ()


def test_it_goes_on_in_the_journal_of_the_push_it_came_from(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.controller.faults[("read_back", 1, "after")] = by_hand
    at.controller.faults[("prepare_disable", 1, "before")] = refuse
    assert push(at) == "held-on"
    (found,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
    record = run_virtual(lambda: disable_table(ORDER, bench(tmp_path, machine=at.machine).context, found))
    assert record.outcome == "off"
    (left,) = held_pushes(tmp_path / "journal")
    assert (left.transaction, left.standing) == (found.number, "off")
    assert record.transaction in journal.order_numbers(unfinished_tables(tmp_path / "journal", MACHINE.serial)[0])


@pytest.mark.parametrize("step", range(16))
def test_killed_at_every_step_of_the_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: int) -> None:
    reaper = Reaper(step)
    at = bench(tmp_path, reaper=reaper)
    with journal_under(reaper, monkeypatch), pytest.raises(Killed):
        run_virtual(lambda: disable_table(ORDER, at.context))
    assert at.machine.own.table == OLD
    assert at.machine.writes == []
    for found in unfinished_tables(tmp_path / "journal", MACHINE.serial):
        again = bench(tmp_path, machine=at.machine)
        finding = run_virtual(lambda again=again, found=found: inspect_unfinished(found, again.context))
        assert finding.code == "R-DISABLE-LEFT"
        run_virtual(lambda again=again, found=found: recover_table(found, again.context))
    assert unfinished_tables(tmp_path / "journal", MACHINE.serial) == ()
    again = bench(tmp_path, machine=at.machine)
    assert run_virtual(lambda: disable_table(ORDER, again.context)).outcome in ("off", "already-off")
    assert at.machine.own == LiveTable(OLD, enabled=False)
