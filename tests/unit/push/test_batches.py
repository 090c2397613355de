"""Several tables in one transaction: killed, refused, stopped between any two; old or new is enabled throughout."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.clock import run_virtual
from drivers.errors import TrueflankError
from drivers.types.machine import ChannelStatus
from drivers.types.tables import CompensationTable, LiveTable
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.push import journal
from gateway.push.history import committed_pushes
from gateway.push.preflight import common_positions, group_transactions
from gateway.push.recovery import inspect_unfinished, recover_table, unfinished_tables
from gateway.push.table_status import held_pushes
from gateway.push.transaction import push_table, push_tables
from tests.sizes import few, soak
from tests.steps import lines
from tests.unit.push.double import (
    MACHINE,
    NEVER,
    NEW,
    PROOF,
    Bench,
    Killed,
    Machine,
    Reaper,
    bench,
    change_of,
    changing,
    deadline,
    journals_of,
    refuse,
)
from tests.unit.push.test_cross import WAVE, change_for, stage
from tests.unit.push.test_recovery import journal_under

COUNTS = [1, 3, 7]


def new(index: int) -> CompensationTable:
    """A table that is nothing at the reference."""
    return replace(WAVE, deviations=tuple(value * (1.0 + 0.1 * index) for value in WAVE.deviations), index=index)


def old(index: int) -> LiveTable:
    """Every second one was on before."""
    table = replace(WAVE, deviations=tuple(value * 0.3 for value in WAVE.deviations), index=index)
    return LiveTable(table, enabled=index % 2 == 0)


def machine_of(count: int) -> Machine:
    return Machine(LiveTable(NEVER, enabled=False), cross=tuple(old(index) for index in range(2, 2 + count)))


def wishes(at: Bench, count: int) -> list[TableChange]:
    return [change_for(at.machine, new(index)) for index in range(2, 2 + count)]


def push(at: Bench, count: int, *, stays: bool = True) -> tuple[PushRecord, ...]:
    asked = [(change, at.context) for change in wishes(at, count)]
    return run_virtual(lambda: push_tables(asked, lambda _changes: stays))


def recovered(root: Path, machine: Machine) -> list[str]:
    """A new gateway looks at what is left and carries out what is offered."""
    here = stage(root, machine=machine)
    if machine.channel is not ChannelStatus.RESET:  # a person ends the program that waits for nobody
        machine.end()

    async def all_of_it() -> list[str]:
        journal.set_ended_aside(journal.machine_folder(here.context.journals, MACHINE.serial))
        return [
            (await recover_table(found, here.context)).outcome
            for found in unfinished_tables(here.context.journals, MACHINE.serial)
            if (await inspect_unfinished(found, here.context)).action != "none"
        ]

    return run_virtual(all_of_it)


def held_now(machine: Machine, count: int) -> tuple[LiveTable, ...]:
    live = {one.table.index: one for one in machine.live().cross}
    return tuple(live[index] for index in range(2, 2 + count))


def olds(count: int) -> tuple[LiveTable, ...]:
    return tuple(old(index) for index in range(2, 2 + count))


def news(count: int) -> tuple[LiveTable, ...]:
    return tuple(LiveTable(new(index), enabled=True) for index in range(2, 2 + count))


def only_whole(machine: Machine, count: int) -> bool:
    """The invariant, over everything the machine ever held."""
    known = [old(index).table for index in range(2, 2 + count)] + [new(index) for index in range(2, 2 + count)]
    return all(not one.enabled or one.table in known for one in machine.history if one.table.kind == "cross")


@pytest.mark.parametrize("count", COUNTS)
def test_all_go_by_one_start_and_one_restart_and_each_has_its_own_story(tmp_path: Path, count: int) -> None:
    at = stage(tmp_path, machine=machine_of(count))
    records = push(at, count)
    assert [record.outcome for record in records] == ["committed"] * count, records
    assert len({record.transaction for record in records}) == 1
    assert held_now(at.machine, count) == news(count)
    assert (at.controller.calls["stage"], at.controller.calls["restarted"]) == (1, 1)
    assert at.controller.calls["read_back"] == at.controller.calls["confirm"] == 1
    assert at.machine.marker.state == "committed"
    assert all(len(record.effect) == 4 for record in records)
    assert max(map(abs, at.machine.jumps)) <= 1.0
    assert not unfinished_tables(at.context.journals, MACHINE.serial)
    for change in wishes(stage(tmp_path, machine=machine_of(count)), count):
        (done,) = committed_pushes(at.context.journals, MACHINE.serial, change.name)
        assert (done.old.table, done.old.enabled, done.new.table) == (change.old, change.old_enabled, change.new)


def steps_of(root: Path, count: int, monkeypatch: pytest.MonkeyPatch) -> int:
    reaper = Reaper()
    at = stage(root, machine=machine_of(count), reaper=reaper)
    with journal_under(reaper, monkeypatch):
        push(at, count)
    return reaper.count


@pytest.mark.parametrize(("count", "every"), [*few([(3, 17), (1, 1), (3, 1), (7, 7)]), soak((7, 1))])
def test_killed_at_any_step_it_leads_home(
    tmp_path: Path, count: int, every: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "whole").mkdir()
    last = steps_of(tmp_path / "whole", count, monkeypatch)
    for step in range(count, last, every):
        root = tmp_path / str(step)
        root.mkdir()
        reaper = Reaper(step)
        at = stage(root, machine=machine_of(count), reaper=reaper)
        with journal_under(reaper, monkeypatch), pytest.raises(Killed):
            push(at, count)
        assert only_whole(at.machine, count), step
        recovered(root, at.machine)
        assert not unfinished_tables(root / "journal", MACHINE.serial), step
        assert held_now(at.machine, count) in (olds(count), news(count)), step
        assert only_whole(at.machine, count), step
        assert not held_pushes(root / "journal")
        assert all(found.is_ended for found in journals_of(root)), step


CALLS = [
    "stage",
    "marker",
    "read_back",
    "activate",
    "confirm",
    "restarted",
    "prepare_stops",
    "wait_stop",
    "saved_tables",
]


@pytest.mark.parametrize("count", few([3, 7], 1))
@pytest.mark.parametrize("when", ["before", "after"])
@pytest.mark.parametrize("call", CALLS)
def test_whatever_fails_all_are_old_or_all_are_new(tmp_path: Path, call: str, when: str, count: int) -> None:
    for number, fault in ((1, refuse), (2, deadline), (count, refuse)):
        root = tmp_path / f"{number}-{fault.__name__}"
        root.mkdir()
        at = stage(root, machine=machine_of(count))
        at.controller.faults[(call, number, when)] = fault
        try:
            outcomes = {record.outcome for record in push(at, count)}
        except TrueflankError:
            outcomes = set()
        assert len(outcomes) <= 1, outcomes
        assert only_whole(at.machine, count)
        recovered(root, at.machine)
        assert held_now(at.machine, count) in (olds(count), news(count))
        assert held_now(at.machine, count) == (news(count) if outcomes == {"committed"} else olds(count))


@pytest.mark.parametrize("count", few([3, 7], 1))
@pytest.mark.parametrize("stays", [True, False])
def test_one_that_is_stored_wrongly_goes_back_alone_or_with_all(tmp_path: Path, count: int, stays: bool) -> None:
    for wrong in range(2, 2 + count):
        root = tmp_path / str(wrong)
        root.mkdir()
        at = stage(root, machine=machine_of(count))
        at.machine.wrong_point, at.machine.wrong_index = 0.5, wrong
        at.controller.faults[("abort_program", 1, "after")] = changing(wrong_point=0.0)
        records = push(at, count, stays=stays)
        good = "committed" if stays else "rolled-back"
        assert [record.outcome for record in records] == [
            "rolled-back" if index == wrong else good for index in range(2, 2 + count)
        ], [record.steps for record in records]
        wanted = [
            old(index) if index == wrong or not stays else news(count)[index - 2] for index in range(2, 2 + count)
        ]
        assert held_now(at.machine, count) == tuple(wanted)
        assert only_whole(at.machine, count)
        assert at.machine.marker.state == ("committed" if stays else "none")
        assert not unfinished_tables(root / "journal", MACHINE.serial)


@pytest.mark.parametrize("count", few([3, 7], 1))
def test_a_program_stopped_between_any_two_tables_leads_back(tmp_path: Path, count: int) -> None:
    for after in range(count):
        root = tmp_path / str(after)
        root.mkdir()
        at = stage(root, machine=machine_of(count))
        at.machine.stops_after = after
        assert {record.outcome for record in push(at, count)} == {"rolled-back"}
        assert held_now(at.machine, count) == olds(count)
        assert only_whole(at.machine, count)


def test_what_speaks_against_one_keeps_all_out(tmp_path: Path) -> None:
    at = stage(tmp_path, machine=machine_of(3))
    asked: Sequence[TableChange] = wishes(at, 3)
    bad = replace(asked[1], new=replace(asked[1].new, deviations=(0.0, 500.0, *asked[1].new.deviations[2:])))
    every = [(change, at.context) for change in (asked[0], bad, asked[2])]
    records = run_virtual(lambda: push_tables(every))
    assert {record.outcome for record in records} == {"refused"}
    assert all(any(step.startswith("E-") for step in lines(record)) for record in records)
    assert at.machine.writes == []
    assert not journals_of(tmp_path)


def test_what_is_live_already_is_left_alone(tmp_path: Path) -> None:
    machine = machine_of(3)
    machine.cross = (machine.cross[0], LiveTable(new(3), enabled=True), machine.cross[2])
    machine.acting_cec[3] = new(3)
    at = stage(tmp_path, machine=machine)
    assert [record.outcome for record in push(at, 3)] == ["committed", "already-applied", "committed"]
    assert held_now(at.machine, 3) == news(3)
    assert at.machine.writes == ["table", "table"]


def test_one_table_each_where_the_control_takes_no_batch_or_no_place_suits_all(tmp_path: Path) -> None:
    at = stage(tmp_path, machine=machine_of(3))
    every = [(change, at.context) for change in wishes(at, 3)]
    assert [len(group) for group in group_transactions(every)] == [1, 1, 1]
    at.controller.batches = True
    assert [len(group) for group in group_transactions(every)] == [3]
    away = replace(every[1][0], new=replace(new(3), deviations=tuple(value + 5.0 for value in new(3).deviations)))
    assert common_positions([every[0], (away, at.context)])["Z1"] is None
    assert [len(group) for group in group_transactions([every[0], (away, at.context), every[2]])] == [1, 1, 1]


def test_tables_without_a_place_for_all_are_refused_together(tmp_path: Path) -> None:
    at = stage(tmp_path, machine=machine_of(3))
    asked = wishes(at, 3)
    values = (6.0, 6.0, 6.0, 6.0, 6.0, 3.0, 0.0, 0.0, 0.0)
    away = replace(asked[1], new=replace(new(3), deviations=values))
    first = replace(asked[0], new=replace(new(2), deviations=values[::-1]))
    records = run_virtual(lambda: push_tables([(first, at.context), (away, at.context)]))
    assert {record.outcome for record in records} == {"refused"}
    assert all("E-INT-NOWHERE" in step for record in records for step in lines(record)[-1:])
    assert at.machine.writes == []


def test_one_of_one_is_told_as_ever(tmp_path: Path) -> None:
    at = bench(tmp_path)
    record = run_virtual(lambda: push_table(change_of(at.machine), replace(at.context, proof=PROOF)))
    assert record.outcome == "committed"
    assert at.machine.own == LiveTable(NEW, enabled=True)
    (found,) = journals_of(tmp_path)
    assert found.parts == (found,)
    assert all("of" not in entry.facts for entry in found.entries)
