"""A rollback restores everything that one consent changed: all tables, or all newer ones again, and every reason."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args, get_type_hints

import pytest

from drivers.clock import run_virtual
from drivers.message import Message
from drivers.types.tables import LiveTable
from gateway.cli.next_steps import after_recovery
from gateway.domain.outcomes import PushRecord
from gateway.errors import RollbackFailed, VerifyError
from gateway.push import outcome_alarms, outcome_error
from gateway.push.history import all_pushes, consent_set, identify_table, rollback_previews
from gateway.push.recovery import unfinished_tables
from gateway.push.recovery_findings import make_finding, with_rest
from gateway.push.rollback import RollbackRequest, group_rollbacks, preflight_rollbacks, roll_back_pushes
from gateway.push.transaction import push_tables
from gateway.store import Store
from gateway.store.machine_books import ProofBook
from gateway.store.records import read_typed, write_typed
from gateway.views.runs import standing_tables
from gateway.workflow.control.rollback import _rollback_outcome
from tests.steps import lines
from tests.unit.push.double import MACHINE, NEW, OLD, PROOF, Bench, Killed, Reaper, bench, change_of, deadline
from tests.unit.push.test_batches import held_now, machine_of, new, old
from tests.unit.push.test_cross import change_for, stage

CONSENT = datetime(2026, 11, 28, 1, 0, tzinfo=UTC)
COUNT = 3


def pushed(root: Path, reaper: Reaper | None = None) -> Bench:
    """X1 with its own table and three cross tables, by two transactions of one consent."""
    machine = machine_of(COUNT)
    machine.become(LiveTable(OLD, enabled=True))
    at = stage(root, machine=machine)
    at = replace(at, context=replace(at.context, run_id="run-1", consent_utc=CONSENT))
    own = replace(at.context, input=None, proof=PROOF)
    assert run_virtual(lambda: push_tables([(change_of(machine), own)]))[0].outcome == "committed"
    context = replace(at.context, pushed=(NEW,))
    asked = [(change_for(machine, new(index)), context) for index in range(2, 2 + COUNT)]
    assert {one.outcome for one in run_virtual(lambda: push_tables(asked))} == {"committed"}
    return at if reaper is None else replace(stage(root, machine=machine, reaper=reaper))


def undos_of(at: Bench, asked: str = "X1") -> list[RollbackRequest]:
    found = consent_set(all_pushes(at.context.journals, MACHINE.serial, at.context.meant), asked)
    assert found is not None
    own = replace(at.context, input=None, proof=None)
    return [(done, own if done.table == "X1" else at.context) for done in found.tables]


def take_back(at: Bench, asked: str = "X1") -> dict[str, PushRecord]:
    async def all_of_it() -> dict[str, PushRecord]:
        ended: dict[str, PushRecord] = {}
        for group in group_rollbacks(undos_of(at, asked)):
            records = await roll_back_pushes(group)
            ended |= {done.table: record for (done, _), record in zip(group, records, strict=True)}
        return ended

    return run_virtual(all_of_it)


def test_all_four_tables_of_one_consent_go_back_and_nothing_is_left_to_take_back(tmp_path: Path) -> None:
    at = pushed(tmp_path)
    found = consent_set(all_pushes(at.context.journals, MACHINE.serial), "X1")
    assert found is not None
    assert sorted(one.table for one in found.tables) == ["X1", "X1-cec2", "X1-cec3", "X1-cec4"]
    assert len({one.transaction for one in found.tables}) == 2
    assert {one.consent for one in found.tables} == {f"run-1 {CONSENT.isoformat()}"}
    records = take_back(at)
    assert {record.outcome for record in records.values()} == {"committed"}, records
    assert at.machine.own == LiveTable(OLD, enabled=True)
    live = held_now(at.machine, COUNT)
    assert [one.enabled for one in live] == [old(index).enabled for index in range(2, 2 + COUNT)]
    assert [one.table for one in live] == [old(index).table for index in range(2, 2 + COUNT)]
    assert max(map(abs, at.machine.jumps)) <= 1.0
    assert consent_set(all_pushes(at.context.journals, MACHINE.serial), "X1") is None
    assert consent_set(all_pushes(at.context.journals, MACHINE.serial)) is None


def test_one_table_by_its_name_leaves_the_others_and_says_so(tmp_path: Path) -> None:
    at = pushed(tmp_path)
    found = consent_set(all_pushes(at.context.journals, MACHINE.serial), "X1-cec3")
    assert found is not None
    assert found.names == "X1-cec3"
    assert sorted(one.table for one in found.rest) == ["X1", "X1-cec2", "X1-cec4"]
    assert take_back(at, "X1-cec3")["X1-cec3"].outcome == "committed"
    left = consent_set(all_pushes(at.context.journals, MACHINE.serial))
    assert left is not None
    assert sorted(one.table for one in left.tables) == ["X1", "X1-cec2", "X1-cec4"]
    assert {record.outcome for record in take_back(at).values()} == {"committed"}
    assert at.machine.own == LiveTable(OLD, enabled=True)


@pytest.mark.parametrize(("rest", "code"), [("X1", 9), ("Z1", 9), ("", 0)])
def test_a_table_of_the_consent_that_stays_on_is_no_success_whatever_axis_it_moves(
    tmp_path: Path, rest: str, code: int
) -> None:
    at = pushed(tmp_path)
    pushes = all_pushes(at.context.journals, MACHINE.serial, at.context.meant)
    found = consent_set(pushes, "X1-cec3")
    assert found is not None
    moved = replace(found.rest[0], axis=rest, table=f"{rest}-cec9")
    found = replace(found, rest=(moved,) if rest else ())
    seen = rollback_previews(pushes, found)
    run = SimpleNamespace(folder=SimpleNamespace(state="rollback-committed", path=tmp_path))
    ended = _rollback_outcome(run, found, take_back(at, "X1-cec3"), seen)  # type: ignore[arg-type]
    assert ended.exit_code == code
    assert any("stay on" in line and moved.table in line for line in map(str, ended.lines)) == bool(rest)


@pytest.mark.parametrize("call", ["stage", "activate", "restarted"])
def test_a_failure_leads_all_tables_of_the_transaction_to_the_newer_ones(tmp_path: Path, call: str) -> None:
    at = pushed(tmp_path)
    at.controller.calls.clear()
    at.controller.faults[call, 1, "before"] = deadline

    async def first_group() -> tuple[PushRecord, ...]:
        return await roll_back_pushes(group_rollbacks(undos_of(at))[0])

    records = run_virtual(first_group)
    assert len({record.outcome for record in records}) == 1
    outcome = records[0].outcome
    assert outcome in ("rolled-back", "held")
    error = outcome_error(records[0])
    assert isinstance(error, VerifyError if outcome == "rolled-back" else RollbackFailed)
    assert error.code == ("E-ROLLBACK-UNDONE" if outcome == "rolled-back" else "E-ROLLBACK-HELD")
    assert records[0].why in str(error)
    assert records[0].why
    if outcome == "rolled-back":
        assert at.machine.own == LiveTable(NEW, enabled=True)
        assert [one.table for one in held_now(at.machine, COUNT)] == [new(index) for index in range(2, 2 + COUNT)]
        assert all(one.enabled for one in held_now(at.machine, COUNT))


def test_killed_at_any_step_old_or_new_acts(tmp_path: Path) -> None:
    known = [OLD, NEW, *(new(index) for index in range(2, 2 + COUNT)), *(old(n).table for n in range(2, 2 + COUNT))]
    step, killed = 0, 0
    while True:
        root = tmp_path / str(step)
        root.mkdir()
        at = pushed(root)
        here = replace(stage(root, machine=at.machine, reaper=Reaper(step)))
        try:
            take_back(here)
        except Killed:
            killed += 1
        else:
            break
        assert all(not one.enabled or one.table in known for one in at.machine.history), step
        step += 37
    assert killed > 1


def test_asking_shows_a_place_for_all_and_writes_nothing(tmp_path: Path) -> None:
    at = pushed(tmp_path)
    at.controller.calls.clear()

    async def asked() -> list[bool]:
        return [not one.refusals for group in group_rollbacks(undos_of(at)) for one in await preflight_rollbacks(group)]

    assert all(run_virtual(asked))
    assert "stage" not in at.controller.calls


def test_a_table_is_named_by_the_push_that_wrote_it(tmp_path: Path) -> None:
    at = pushed(tmp_path)
    pushes = all_pushes(at.context.journals, MACHINE.serial)
    own = next(one for one in pushes if one.table == "X1")
    assert identify_table(pushes, "X1", LiveTable(NEW, True)).id == identify_table(pushes, "X1", own.new).id
    rounded = replace(NEW, deviations=tuple(value + 0.01 for value in NEW.deviations))
    assert identify_table(pushes, "X1", LiveTable(rounded, True)).id == identify_table(pushes, "X1", own.new).id
    assert identify_table(pushes, "X1", LiveTable(OLD, True), "2026-01-01").utc == "2026-01-01"
    assert identify_table(pushes, "X1", LiveTable(OLD, False)).id == ""


def test_a_journal_of_an_older_version_is_tied_by_its_run(tmp_path: Path) -> None:
    at = bench(tmp_path)
    (record,) = run_virtual(lambda: push_tables([(change_of(at.machine), at.context)]))
    (push,) = all_pushes(at.context.journals, MACHINE.serial)
    assert record.backup_path.startswith(f"{push.consent}/")


ENDS = {
    "refused": ("E-PUSH-REFUSED", "E-PUSH-REFUSED"),
    "rolled-back": ("E-PUSH-ROLLED-BACK", "E-ROLLBACK-UNDONE"),
    "untouched": ("E-PUSH-UNTOUCHED", "E-ROLLBACK-UNTOUCHED"),
    "held": ("E-PUSH-HELD", "E-ROLLBACK-HELD"),
    "held-on": ("E-PUSH-HELD-ON", "E-ROLLBACK-HELD-ON"),
    "committed": ("", ""),
    "already-applied": ("", ""),
    "skipped": ("", ""),
}


@pytest.mark.parametrize("outcome", get_args(get_type_hints(PushRecord)["outcome"]))
@pytest.mark.parametrize("purpose", ["table", "restore"])
def test_the_message_of_every_outcome_has_its_reason(outcome: str, purpose: str) -> None:
    made: dict[str, Any] = {"outcome": outcome, "purpose": purpose, "steps": (Message.stored("2026 table backed up"),)}
    record = PushRecord(7, "X1", backup_path="run/b.mpf", reasons=(Message.stored("E-NC-LEVEL: no right"),), **made)
    error, code = outcome_error(record), ENDS[outcome][purpose == "restore"]
    assert (error.code if error else "") == code
    assert error is None or ("E-NC-LEVEL: no right" in str(error) and "table backed up" not in str(error))
    assert error is None or "<" not in str(error)
    older = outcome_error(replace(record, reasons=()))
    assert older is None or "no reason" in str(older)


def test_a_push_that_fails_says_why_in_record_and_error(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.controller.faults["read_back", 1, "before"] = deadline
    (record,) = run_virtual(lambda: push_tables([(change_of(at.machine), at.context)]))
    assert record.outcome == "rolled-back"
    assert record.reasons
    assert "W-STEP-ROLLING-BACK" in [step.code for step in record.steps]
    assert record.reasons[0].code.startswith("E-")
    error = outcome_error(record)
    assert error is not None
    assert record.why in str(error)
    kept = write_typed(record, PushRecord, "")
    assert read_typed(kept, PushRecord, "", "here") == record
    again = run_virtual(lambda: push_tables([(change_of(at.machine), at.context)]))
    assert again[0].outcome == "committed"
    assert again[0].reasons == ()


class Log:
    """An audit log that takes everything."""

    def __init__(self) -> None:
        self.lost: list[tuple[str, str, str]] = []

    def begin(self, _transaction: int, _change: object) -> str:
        return "1:00"

    def end(self, _transaction: int, _state: str) -> None:
        """Nothing to keep."""

    def marker_lost(self, _transaction: int, table: str, state: str, why: str) -> None:
        self.lost.append((table, state, why))

    def head(self) -> int:
        return 0

    def begun(self, _transaction: int) -> bool:
        return True

    def announced(self) -> frozenset[int]:
        return frozenset()

    def holds(self, _head: int) -> bool:
        return True

    def last_mark(self) -> int:
        return 0


def test_a_marker_that_cannot_be_written_is_an_alarm_with_a_code_and_is_audited(tmp_path: Path) -> None:
    at, log = bench(tmp_path), Log()
    at.controller.faults["finish_push", 1, "before"] = deadline
    context = replace(at.context, log=log)
    (record,) = run_virtual(lambda: push_tables([(change_of(at.machine), context)]))
    assert record.outcome == "committed"
    assert record.marker
    (alarm,) = outcome_alarms([record])
    assert alarm.code == "W-PUSH-MARKER"
    assert str(record.marker) in str(alarm)
    assert [(table, state) for table, state, _ in log.lost] == [("X1", "committed")]
    assert [code for code, _ in at.told if code == "P-PUSH-MARKER"]
    assert not any("could not be written" in step for step in lines(record))


def test_the_page_shows_the_set_and_the_figures_of_the_terminal(tmp_path: Path) -> None:
    """Largest moves by hand: NEW 15.5 to OLD 6.0 at 150 mm, 1.2, 1.3 and 1.4 of 9.0 to 0.3 of it, or to a table off."""
    at, store = pushed(tmp_path), Store(tmp_path)
    pushes = all_pushes(at.context.journals, MACHINE.serial)
    found = consent_set(pushes)
    assert found is not None
    terminal = rollback_previews(pushes, found)
    page = standing_tables(store, MACHINE.serial)["rollback"]
    moves = {one["table"]: one["move"]["fields"] for one in page["back"]}
    assert {name: (one["was"], one["becomes"], one["size"], one["place"]) for name, one in moves.items()} == {
        "X1": (15.5, 6.0, 9.5, "150"),
        "X1-cec2": (10.8, 2.7, 8.1, "150"),
        "X1-cec3": (11.7, 0.0, 11.7, "150"),
        "X1-cec4": (12.6, 2.7, 9.9, "150"),
    }
    for one in page["back"]:
        plan, move = terminal[one["table"]].lines
        assert str(move) == one["move"]["words"]
        assert (plan.fields["newer"], plan.fields["older"]) == tuple(
            Message.of(one[name]["code"], **one[name]["fields"]) for name in ("newer", "older")
        )
    assert page["stays"] == []
    ProofBook(store.root).save(replace(PROOF, kind="cross", sign=-1, date_utc="2026-11-29T09:00:00+00:00"))
    turned = {one["table"]: one["move"]["fields"] for one in standing_tables(store, MACHINE.serial)["rollback"]["back"]}
    assert (turned["X1-cec2"]["was"], turned["X1-cec2"]["becomes"], turned["X1-cec2"]["size"]) == (-10.8, -2.7, 8.1)
    assert turned["X1"] == moves["X1"]


def test_recovery_names_what_else_of_the_consent_acts(tmp_path: Path) -> None:
    """The three cross tables were going back when the gateway died; the axis' own table of the same consent acts."""
    at = pushed(tmp_path)
    here = stage(tmp_path, machine=at.machine, reaper=Reaper(50))
    with pytest.raises(Killed):
        take_back(here)
    left = unfinished_tables(at.context.journals, MACHINE.serial)
    pushes = all_pushes(at.context.journals, MACHINE.serial)
    found = with_rest([make_finding(one, None, 0.0, pushes=pushes) for one in left], left, pushes)
    assert {one.table for one in found} <= {"X1-cec2", "X1-cec3", "X1-cec4"}
    named_once = [*(one.table for one in found), *(name for one in found for name in one.rest)]
    assert sorted(named_once) == ["X1", "X1-cec2", "X1-cec3", "X1-cec4"]
    assert "X1" in found[0].rest
    assert "X1; `trueflank rollback`" in found[0].words
    assert "X1; `trueflank rollback`" in replace(found[0], ended="rolled-back").at_last
    assert after_recovery(found, "S", "M", apply=True) == "rollback S"


def test_a_push_that_failed_alone_has_nothing_beside_it(tmp_path: Path) -> None:
    at = bench(tmp_path, reaper=Reaper(20))
    with pytest.raises(Killed):
        run_virtual(lambda: push_tables([(change_of(at.machine), at.context)]))
    left = unfinished_tables(at.context.journals, MACHINE.serial)
    assert [one.rest for one in with_rest([make_finding(one, None, 0.0) for one in left], left, ())] == [()]
