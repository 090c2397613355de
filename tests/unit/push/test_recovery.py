"""Killed at every step: old or new is enabled, the verdict is right, and recovery leads home."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.clock import run_virtual
from drivers.errors import DeadlineExceeded, TrueflankError
from drivers.message import Message
from drivers.types.machine import ChannelStatus
from drivers.types.tables import LiveTable
from gateway.domain.outcomes import PushRecord
from gateway.errors import StoreError, WriteRefused
from gateway.push import journal
from gateway.push.recovery import inspect_unfinished, recover_table, unfinished_tables
from gateway.push.recovery_findings import PushFinding, make_finding
from gateway.push.transaction import push_table
from tests.sizes import few
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
    journals_of,
    only_old_or_new_enabled,
    table,
)

OLD_ON = LiveTable(OLD, enabled=True)
ODD = table(0.0, 1.0, 9.0, 1.0, 9.0, 1.0, 9.0, 1.0, 0.0)


@contextmanager
def journal_under(reaper: Reaper, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The reaper also stands before and after every journal entry."""
    real = journal.Journal.append

    def append(self: journal.Journal, kind: str, **facts: object) -> None:
        reaper.tick()
        real(self, kind, **facts)
        reaper.tick()

    with monkeypatch.context() as patch:
        patch.setattr(journal.Journal, "append", append)
        yield


def killed(root: Path, at: int, old: LiveTable, monkeypatch: pytest.MonkeyPatch, fail: bool) -> tuple[Bench, bool]:
    """A push killed at one step (or not, when there are fewer); with ``fail`` it is a push that rolls back."""
    reaper = Reaper(at)
    here = bench(root, old, reaper)
    if fail:
        here.machine.wrong_point = 0.5
        here.controller.faults[("abort_program", 1, "after")] = changing(wrong_point=0.0)
    with journal_under(reaper, monkeypatch):
        try:
            run_virtual(lambda: push_table(change_of(here.machine), here.context))
        except Killed:
            return here, True
    return here, False


def steps_of_a_push(root: Path, old: LiveTable, monkeypatch: pytest.MonkeyPatch, fail: bool) -> int:
    here, _ = killed(root, -1, old, monkeypatch, fail)
    return here.controller.reaper.count


def expected(machine: Machine, old: LiveTable, kinds: tuple[str, ...]) -> str:
    """The verdict, said again from the table in the reference in other words."""
    if machine.own == old:
        return "R-PUSH-UNTOUCHED"
    if machine.own.table == old.table:
        return "R-PUSH-DISABLED"
    if machine.own.table == NEW:
        return "R-PUSH-ENABLED" if machine.own.enabled else "R-PUSH-WRITTEN"
    return "R-PUSH-HALF"


@pytest.mark.parametrize(
    ("old", "operator", "fail"),
    few(
        [
            (OLD_ON, "presses reset", False),
            (LiveTable(NEVER, enabled=False), "presses start", False),
            (OLD_ON, "presses start", True),
            (OLD_ON, "presses start", False),
            (OLD_ON, "presses reset", True),
            (LiveTable(NEVER, enabled=False), "presses reset", False),
            (LiveTable(NEVER, enabled=False), "presses reset", True),
            (LiveTable(NEVER, enabled=False), "presses start", True),
        ],
        2,
    ),
)
def test_killed_at_every_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, old: LiveTable, operator: str, fail: bool
) -> None:
    seen: set[str] = set()
    (tmp_path / "count").mkdir()
    total = steps_of_a_push(tmp_path / "count", old, monkeypatch, fail)
    assert total > 60
    for step in range(total):
        root = tmp_path / str(step)
        root.mkdir()
        here, was_killed = killed(root, step, old, monkeypatch, fail)
        assert was_killed
        here.machine.wrong_point = 0.0
        if operator == "presses start":
            here.machine.start_push()
            here.machine.go_on()
        here.machine.nck_reset()
        assert only_old_or_new_enabled(here.machine, old.table, NEW)
        seen.add(recovered(root, here.machine, old))
    assert "R-PUSH-UNTOUCHED" in seen
    assert "nothing open" in seen
    assert ("R-PUSH-HALF" if fail else "R-PUSH-WRITTEN") in seen
    assert fail or "R-PUSH-ENABLED" in seen


def recovered(root: Path, machine: Machine, old: LiveTable) -> str:
    """Look, check the verdict, carry out the offer, look again; returns the verdict."""
    open_ones = unfinished_tables(root / "journal", MACHINE.serial)
    if not open_ones:
        assert machine.own in (old, LiveTable(NEW, enabled=True))
        return "nothing open"
    (found,) = open_ones
    if not found.entries:
        return "nothing announced"
    before, writes = machine.live(), list(machine.writes)
    again = bench(root, machine=machine)
    finding = run_virtual(lambda: inspect_unfinished(found, again.context))
    assert (machine.live(), machine.writes) == (before, writes)
    assert finding.code == expected(machine, old, found.kinds)
    record = run_virtual(lambda: recover_table(found, again.context))
    assert record.outcome == "rolled-back"
    assert finding.at_last == finding.words
    assert replace(finding, ended=record.outcome).at_last == f"X1: now acts: {finding.old}"
    assert machine.own == old
    assert unfinished_tables(root / "journal", MACHINE.serial) == ()
    return finding.code


@pytest.mark.parametrize("step", few(sorted(range(0, 60, 3), key=lambda step: step % 4), 8, 4))
def test_killed_again_during_recovery(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: int) -> None:
    here, _ = killed(tmp_path, 40, OLD_ON, monkeypatch, False)
    here.machine.nck_reset()
    (found,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
    reaper = Reaper(step)
    second = bench(tmp_path, reaper=reaper, machine=here.machine)
    with journal_under(reaper, monkeypatch):
        try:
            run_virtual(lambda: recover_table(found, second.context))
        except Killed:
            here.machine.nck_reset()
    assert only_old_or_new_enabled(here.machine, OLD, NEW)
    for found in unfinished_tables(tmp_path / "journal", MACHINE.serial):
        third = bench(tmp_path, machine=here.machine)
        run_virtual(lambda found=found, third=third: recover_table(found, third.context))
    assert here.machine.own == OLD_ON
    assert unfinished_tables(tmp_path / "journal", MACHINE.serial) == ()


def _held(root: Path) -> tuple[Bench, journal.JournalRead]:
    here = bench(root)
    here.controller.faults[("restarted", 1, "before")] = changing(operator=False)
    assert run_virtual(lambda: push_table(change_of(here.machine), here.context)).outcome == "held-on"
    here.machine.operator = True
    (found,) = unfinished_tables(root / "journal", MACHINE.serial)
    return here, found


def test_while_the_program_still_waits_the_finding_says_press_reset(tmp_path: Path) -> None:
    here, found = _held(tmp_path)
    assert here.machine.channel is ChannelStatus.INTERRUPTED
    again = bench(tmp_path, machine=here.machine)
    finding = run_virtual(lambda: inspect_unfinished(found, again.context))
    assert (finding.code, finding.action) == ("R-PUSH-UNKNOWN", "none")
    assert ("P-PUSH-RESET", {"axis": "X1"}) in again.told
    with pytest.raises(WriteRefused) as caught:
        run_virtual(lambda: recover_table(found, again.context))
    assert caught.value.code == "E-PUSH-NO-OFFER"


def test_looks_at_tables_of_one_axis_share_one_program(tmp_path: Path) -> None:
    """Each table of an interrupted batch asked for a press of its own, and all were told by their axis' name."""
    here, found = _held(tmp_path)
    here.machine.nck_reset()
    again, read = bench(tmp_path, machine=here.machine), {}
    first = run_virtual(lambda: inspect_unfinished(found, again.context, read))
    assert first.code == "R-PUSH-ENABLED"
    asked = len(again.told)
    second = run_virtual(lambda: inspect_unfinished(replace(found, of="X1-reversal"), again.context, read))
    assert (second.code, len(again.told), len(read)) == (first.code, asked, 1)
    assert (first.words.split(",")[0], second.words.split(",")[0]) == (
        "R-PUSH-ENABLED: X1",
        "R-PUSH-ENABLED: X1-reversal",
    )


def test_what_is_restored_is_said_with_a_reason_and_no_code(tmp_path: Path) -> None:
    here, found = _held(tmp_path)
    here.machine.nck_reset()
    again = bench(tmp_path, machine=here.machine)
    run_virtual(lambda: recover_table(found, again.context))
    (told,) = [fields for code, fields in again.told if code == "P-PUSH-RESTORE"]
    assert told == {"axis": "X1", "why": Message.of("W-PUSH-UNFINISHED")}
    assert str(told["why"]) == "its push was interrupted"


def test_finish_proves_the_new_table(tmp_path: Path) -> None:
    here, found = _held(tmp_path)
    here.machine.nck_reset()
    again = bench(tmp_path, machine=here.machine)
    record = run_virtual(lambda: recover_table(found, again.context, "finish"))
    assert record.outcome == "committed"
    assert here.machine.own == LiveTable(NEW, enabled=True)
    assert unfinished_tables(tmp_path / "journal", MACHINE.serial) == ()


def test_finish_without_effect_is_held(tmp_path: Path) -> None:
    here, found = _held(tmp_path)
    here.machine.end()
    again = bench(tmp_path, machine=here.machine)
    record = run_virtual(lambda: recover_table(found, again.context, "finish"))
    assert record.outcome == "held-on"
    assert len(unfinished_tables(tmp_path / "journal", MACHINE.serial)) == 1


def test_recovery_is_tried_three_times_at_most(tmp_path: Path) -> None:
    here, found = _held(tmp_path)
    here.machine.nck_reset()
    here.machine.wrong_point = 1.0
    for _ in range(3):
        (found,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
        again = bench(tmp_path, machine=here.machine)
        assert run_virtual(lambda again=again, found=found: recover_table(found, again.context)).outcome == "held"
        here.machine.nck_reset()
    (found,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
    again = bench(tmp_path, machine=here.machine)
    with pytest.raises(WriteRefused) as caught:
        run_virtual(lambda: recover_table(found, again.context))
    assert caught.value.code in ("E-PUSH-TRIES", "E-PUSH-NO-OFFER")
    assert not here.machine.own.enabled


def test_recovery_needs_the_machines_name(tmp_path: Path) -> None:
    here, found = _held(tmp_path)
    here.machine.nck_reset()
    again = bench(tmp_path, machine=here.machine)
    writes = list(here.machine.writes)
    with pytest.raises(WriteRefused) as caught:
        run_virtual(lambda: recover_table(found, replace(again.context, typed_name="")))
    assert caught.value.code == "E-INT-NAME"
    assert here.machine.writes == writes


def test_another_machine_or_a_dead_one_is_unknown(tmp_path: Path) -> None:
    here, found = _held(tmp_path)
    here.machine.nck_reset()
    again = bench(tmp_path, machine=here.machine)
    here.machine.identity = replace(MACHINE, serial="SN-2")
    assert run_virtual(lambda: inspect_unfinished(found, again.context)).code == "R-PUSH-UNKNOWN"
    here.machine.identity, here.machine.operator = MACHINE, False
    assert run_virtual(lambda: inspect_unfinished(found, again.context)).code == "R-PUSH-UNKNOWN"


def _told(root: Path, *kinds: str) -> journal.JournalRead:
    here = bench(root)
    change = change_of(here.machine)
    run_virtual(lambda: push_table(change, here.context))
    (found,) = journals_of(root)
    leased = found.entries[0]
    return replace(found, entries=(leased, *(journal.Entry(kind, {}) for kind in kinds)))


@pytest.mark.parametrize(
    ("kinds", "live", "code", "action"),
    [
        ((), LiveTable(OLD, True), "R-PUSH-UNTOUCHED", "close"),
        ((), LiveTable(OLD, False), "R-PUSH-FOREIGN", "none"),
        (("DISABLE",), LiveTable(OLD, False), "R-PUSH-DISABLED", "restore"),
        (("DISABLE",), LiveTable(OLD, True), "R-PUSH-UNTOUCHED", "close"),
        (("DISABLE",), LiveTable(ODD, False), "R-PUSH-HALF", "restore"),
        ((), LiveTable(ODD, False), "R-PUSH-FOREIGN", "none"),
        ((), LiveTable(ODD, True), "R-PUSH-FOREIGN", "none"),
        (("DISABLE",), LiveTable(ODD, True), "R-PUSH-STILL-ON", "disable"),
        (("DISABLE", "LOADED"), LiveTable(NEW, False), "R-PUSH-WRITTEN", "restore"),
        (("DISABLE", "LOADED"), LiveTable(NEW, True), "R-PUSH-STILL-ON", "disable"),
        (("DISABLE", "LOADED", "ENABLE"), LiveTable(NEW, False), "R-PUSH-WRITTEN", "restore"),
        (("DISABLE", "LOADED", "ENABLE"), LiveTable(NEW, True), "R-PUSH-ENABLED", "restore"),
        (("DISABLE", "LOADED", "ENABLE"), None, "R-PUSH-UNKNOWN", "none"),
    ],
)
def test_verdicts(tmp_path: Path, kinds: tuple[str, ...], live: LiveTable | None, code: str, action: str) -> None:
    finding = make_finding(_told(tmp_path, *kinds), live, 1e-6)
    assert (finding.code, finding.action) == (code, action)
    assert "<" not in finding.words
    assert json.dumps(finding.as_data())


def test_a_damaged_journal_offers_nothing_and_refuses_pushes(tmp_path: Path) -> None:
    here, found = _held(tmp_path)
    here.machine.nck_reset()
    data = bytearray(found.path.read_bytes())
    data[len(data) // 2] ^= 1
    found.path.write_bytes(bytes(data))
    (damaged,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
    assert damaged.broken
    again = bench(tmp_path, machine=here.machine)
    finding: PushFinding = run_virtual(lambda: inspect_unfinished(damaged, again.context))
    assert (finding.code, finding.action) == ("R-PUSH-DAMAGED", "none")
    record: PushRecord = run_virtual(lambda: push_table(change_of(here.machine, OLD), again.context))
    assert any(step.startswith("E-INT-UNFINISHED") for step in lines(record))


def test_a_journal_that_names_no_tables_is_our_error(tmp_path: Path) -> None:
    folder = journal.machine_folder(tmp_path / "journal", MACHINE.serial)
    folder.mkdir(parents=True)
    written = journal.Journal.create(folder, 7)
    written.append("LEASED", axis="X1")
    written.close()
    (found,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
    again = bench(tmp_path)
    with pytest.raises(TrueflankError):
        run_virtual(lambda: recover_table(found, again.context))
    with pytest.raises(StoreError):
        make_finding(found, OLD_ON, 0.0)
    assert issubclass(DeadlineExceeded, TrueflankError)
