"""An interrupted rollback is finished or undone as the person chooses; what acts is named, the same on every screen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from drivers.clock import run_virtual
from drivers.types.machine import ChannelStatus
from drivers.types.tables import LiveTable
from gateway.domain.outcomes import PushRecord
from gateway.errors import WriteRefused
from gateway.push import journal
from gateway.push.history import all_pushes, table_exchange
from gateway.push.recovery import Choice, inspect_unfinished, recover_table, unfinished_tables
from gateway.push.recovery_findings import PushFinding
from gateway.push.rollback import roll_back_push
from gateway.push.table_status import TableState, held_pushes, switch_state, table_states
from gateway.push.transaction import push_table
from tests.unit.push.double import MACHINE, NEVER, NEW, OLD, Bench, Killed, Reaper, bench, change_of
from tests.unit.push.test_undoing import again, last, pushed

EARLIER = [LiveTable(OLD, enabled=True), LiveTable(NEVER, enabled=False)]


def stopped(root: Path, step: int, earlier: LiveTable) -> Bench | None:
    """A rollback to ``earlier`` killed at a step; None where it ended before."""
    root.mkdir()
    at = pushed(root, earlier)
    here, done = again(root, at.machine, Reaper(step)), last(at)
    try:
        run_virtual(lambda: roll_back_push(done, here.context))
    except Killed:
        if at.machine.channel is not ChannelStatus.RESET:
            at.machine.end()
        return again(root, at.machine)
    return None


def seen(at: Bench) -> PushFinding:
    (found,) = unfinished_tables(at.context.journals, MACHINE.serial)
    return run_virtual(lambda: inspect_unfinished(found, at.context))


def carried_out(at: Bench, choice: Choice) -> PushRecord:
    (found,) = unfinished_tables(at.context.journals, MACHINE.serial)
    return run_virtual(lambda: recover_table(found, at.context, choice))


def state(at: Bench) -> TableState:
    (one,) = table_states(at.context.journals, MACHINE.serial)
    return one


@pytest.mark.parametrize("earlier", EARLIER, ids=["a table acted before", "none acted before"])
@pytest.mark.parametrize("choice", ["finish", "undo"])
def test_wherever_it_was_stopped_the_person_chooses_and_what_acts_is_named(
    tmp_path: Path, choice: Choice, earlier: LiveTable
) -> None:
    codes, step = set(), 1
    while (at := stopped(tmp_path / str(step), step, earlier)) is not None:
        step += 7
        if not unfinished_tables(at.context.journals, MACHINE.serial):
            continue
        finding = seen(at)
        codes.add(finding.code)
        before = state(at)
        assert not before.is_settled
        held = before.held
        assert held is not None
        assert (held.back, held.table) == (True, "X1")
        assert before.acts != "on" or held.standing == "untouched"
        begun = finding.action == "restore" or held.standing != "untouched"
        if begun:
            with pytest.raises(WriteRefused) as caught:
                carried_out(at, "offered")
            assert caught.value.code == "E-RECOVER-CHOOSE"
            assert finding.old in str(caught.value)
            assert finding.new in str(caught.value)
            assert finding.choices == ("finish", "undo")
        record = carried_out(at, choice)
        done = choice == "finish" and begun
        wanted = earlier if done else LiveTable(NEW, enabled=True)
        assert at.machine.own.enabled == wanted.enabled, (step, finding, record)
        assert not wanted.enabled or at.machine.own.table.deviations == wanted.table.deviations, (step, finding, record)
        assert record.outcome == ("committed" if done else "rolled-back"), (step, record)
        told = replace(finding, ended=record.outcome).at_last
        assert told.endswith(finding.new if done else finding.old)
        assert "old table" not in told
        now = state(at)
        assert now.is_settled
        assert now.acts == ("on" if wanted.enabled else "off")
        assert now.name.words == (finding.new if done else finding.old)
        assert not held_pushes(at.context.journals)
    assert step > 20
    assert len(codes) >= 2


def test_a_rollback_that_has_switched_off_is_read_as_off_on_every_screen(tmp_path: Path) -> None:
    """Left off by the second half, stopped while the tables were read: red, off and on stood on one screen."""
    step = 1
    while (at := stopped(tmp_path / str(step), step, LiveTable(NEVER, enabled=False))) is not None:
        step += 1
        found = unfinished_tables(at.context.journals, MACHINE.serial)
        if not found or found[0].said_last != "LEFT_DISABLED":
            continue
        assert switch_state(found[0]) == "off"
        (held,) = held_pushes(at.context.journals)
        assert (held.code, held.needs_attention) == ("R-UNDO-OFF", False)
        assert (state(at).acts, state(at).is_settled) == ("off", False)
        both = table_exchange(found[0], all_pushes(at.context.journals, MACHINE.serial))
        assert (both.back, both.new.enabled, both.new_name.id) == (True, False, "")
        assert both.old_name.words in held.words
        return
    raise AssertionError("no step left the table off")


def test_the_newest_of_journal_and_read_back_tells_how_a_table_stands(tmp_path: Path) -> None:
    at = bench(tmp_path, LiveTable(OLD, enabled=True))
    assert run_virtual(lambda: push_table(change_of(at.machine), at.context)).outcome == "committed"
    (push,) = all_pushes(at.context.journals, MACHINE.serial)
    early, late = "2020-01-01T00:00:00+00:00", "2099-01-01T00:00:00+00:00"
    for kind, acts in (("switched-off", "off"), ("differs", "differs"), ("before", "differs"), ("as-approved", "on")):
        (now,) = table_states(at.context.journals, MACHINE.serial, {"X1": (late, kind)})
        assert now.acts == acts
        assert now.is_settled == (acts != "differs")
        (now,) = table_states(at.context.journals, MACHINE.serial, {"X1": (early, kind)})
        assert (now.acts, now.utc) == ("on", push.utc)
    folder = journal.machine_folder(at.context.journals, MACHINE.serial)
    number = journal.allocate_number(folder, 7)
    order = journal.Journal.create(folder, number)
    order.append("LEASED", purpose="disable", axis="X1", kind_of_table="axis", index=0, utc=late)
    order.append("SWITCH_OFF", utc=late, order=number)
    order.append("OFF", utc=late, order=number)
    order.append("CLOSED", utc=late)
    order.close()
    assert [one.acts for one in table_states(at.context.journals, MACHINE.serial)] == ["off"]
