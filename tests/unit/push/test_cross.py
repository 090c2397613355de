"""Pushing CEC tables, over a road with programs and over one without: proof, coupling, restore, recovery."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.clock import run_virtual
from drivers.errors import DeadlineExceeded, TrueflankError, UnsupportedDevice
from drivers.types.abilities import Marker
from drivers.types.orders import SignProof
from drivers.types.stops import Stop
from drivers.types.tables import CompensationTable, LiveTable
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.errors import RollbackFailed, VerifyError, WriteRefused
from gateway.push import journal
from gateway.push.compare import table_in
from gateway.push.controller_access import position_tolerance
from gateway.push.effect import possible_sums
from gateway.push.recovery import inspect_unfinished, recover_table, unfinished_tables
from gateway.push.sign_proof import prove_sign
from gateway.push.transaction import push_table
from tests.signed import signed
from tests.sizes import few
from tests.steps import lines
from tests.unit.push.double import (
    MACHINE,
    NEW,
    NOTHING,
    OLD,
    PROOF,
    Z_AXIS,
    Bench,
    Killed,
    Machine,
    Reaper,
    bench,
    change_of,
    changing,
    deadline,
    journals_of,
    only_old_or_new_enabled,
    refuse,
)

ROADS = pytest.mark.parametrize("by_hand", [False, True], ids=["programs", "by hand"])
SIGNS = pytest.mark.parametrize("sign", [1, -1])
WAVE = CompensationTable(
    "cross", "Z1", "X1", 0.0, 400.0, 50.0, (0.0, 3.0, 7.0, 9.0, 5.0, 1.0, -4.0, -2.0, 0.0), index=2
)
TILT = CompensationTable("cross", "Z1", "X1", 0.0, 400.0, 100.0, (0.0, 2.0, 4.0, 2.0, 0.0), index=5)
FLAT = replace(TILT, deviations=(0.0, 0.4, 0.8, 0.4, 0.0), index=6)


def proof(sign: int) -> SignProof:
    return SignProof(MACHINE, "cross", "X1", -1.0 * sign, 0.02, 1 if sign > 0 else -1, "2026-11-21T09:00:00+00:00")


def stage(root: Path, sign: int = 1, *, by_hand: bool = False, machine: Machine | None = None, **more: Any) -> Bench:
    at = bench(root, machine=machine, by_hand=by_hand, **more)
    at.machine.keeps_grids = by_hand
    return replace(at, context=replace(at.context, input=Z_AXIS, proof=proof(sign)))


def change_for(machine: Machine, new: CompensationTable = WAVE, sign: int = 1) -> TableChange:
    live = machine.live()
    old = table_in(signed(live, sign), new)
    return TableChange("X1", old.table, new, old.enabled, live.digest, NOTHING, NOTHING, NOTHING, base=live)


def push(at: Bench, change: TableChange | None = None, sign: int = 1, **context: Any) -> PushRecord:
    wanted = change or change_for(at.machine, sign=sign)
    return run_virtual(lambda: push_table(wanted, replace(at.context, **context)))


def stored(table: CompensationTable, sign: int) -> CompensationTable:
    return replace(table, deviations=tuple(sign * value + 0.0 for value in table.deviations))


def filled(machine: Machine) -> tuple[LiveTable, ...]:
    """The CEC tables that hold something: zeros left on a grid are as good as never loaded."""
    return tuple(one for one in machine.live().cross if one.enabled or any(one.table.deviations))


def held(machine: Machine, index: int) -> LiveTable:
    return next(one for one in machine.live().cross if one.table.index == index)


@ROADS
@SIGNS
@pytest.mark.parametrize("axis_on", [False, True], ids=["axis was off", "axis was on"])
def test_committed_with_the_proven_sign(tmp_path: Path, by_hand: bool, sign: int, axis_on: bool) -> None:
    at = stage(tmp_path, sign, by_hand=by_hand)
    at.machine.cec_on = axis_on
    record = push(at, sign=sign)
    assert record.outcome == "committed", record.steps
    assert held(at.machine, 2) == LiveTable(stored(WAVE, sign), enabled=True)
    assert at.machine.own == LiveTable(OLD, enabled=True)
    assert len(record.effect) == (3 if by_hand else 4)
    assert max(abs(expected) for _place, expected, _found in record.effect) > 4.0
    assert max(map(abs, at.machine.jumps)) <= 1.0
    assert at.machine.marker == Marker(record.transaction, "committed")
    assert push(stage(tmp_path, sign, by_hand=by_hand, machine=at.machine), sign=sign).outcome == "already-applied"
    assert at.machine.writes == ["table"]


@ROADS
def test_an_eec_table_goes_the_same_way_on_both_roads(tmp_path: Path, by_hand: bool) -> None:
    at = bench(tmp_path, by_hand=by_hand)
    record = run_virtual(lambda: push_table(change_of(at.machine), at.context))
    assert record.outcome == "committed", record.steps
    assert at.machine.own == LiveTable(NEW, enabled=True)
    assert max(map(abs, at.machine.jumps)) <= 1.0
    assert [code for code, _fields in at.told if code == "P-PUSH-JOG"] if by_hand else True
    assert set(at.controller.calls).isdisjoint({"prepare_stops", "wait_stop"} if by_hand else {"switch"})


@ROADS
def test_the_control_may_count_its_sum_either_way(tmp_path: Path, by_hand: bool) -> None:
    at = stage(tmp_path, by_hand=by_hand)
    at.machine.shown_sense = -1.0
    assert push(at).outcome == "committed"


@ROADS
def test_several_tables_of_one_axis_one_after_the_other(tmp_path: Path, by_hand: bool) -> None:
    at = bench(tmp_path, by_hand=by_hand)
    own = change_of(at.machine)
    first, second = (change_for(at.machine, table) for table in (WAVE, TILT))
    context = replace(at.context, proof=PROOF)
    assert run_virtual(lambda: push_table(own, context)).outcome == "committed"
    for change, pushed in ((first, (NEW,)), (second, (NEW, WAVE))):
        here = stage(tmp_path, by_hand=by_hand, machine=at.machine)
        record = push(here, change, pushed=pushed)
        assert record.outcome == "committed", record.steps
    assert [held(at.machine, index).enabled for index in (2, 5)] == [True, True]
    assert max(map(abs, at.machine.jumps)) <= 1.0
    stranger = stage(tmp_path, by_hand=by_hand, machine=at.machine)
    assert push(stranger, replace(second, new=replace(TILT, index=7)), pushed=()).outcome == "refused"


@ROADS
@pytest.mark.parametrize("was_on", [False, True], ids=["table was off", "table was on"])
def test_neighbours_come_back_with_their_switches(tmp_path: Path, by_hand: bool, was_on: bool) -> None:
    at = stage(tmp_path, by_hand=by_hand)
    at.machine.cross = (LiveTable(TILT, True), LiveTable(replace(WAVE, deviations=FLAT_WAVE), was_on))
    at.machine.__post_init__()
    before = at.machine.live()
    at.machine.wrong_point = 0.6
    at.controller.faults[("abort_program", 1, "after")] = changing(wrong_point=0.0)
    record = push(at)
    assert record.outcome == "rolled-back", record.steps
    after = at.machine.live()
    assert sorted(after.cross, key=lambda one: one.table.index) == sorted(before.cross, key=lambda one: one.table.index)
    assert max(map(abs, at.machine.jumps)) <= 1.0
    assert at.machine.marker == Marker(0, "none")


FLAT_WAVE = tuple(value / 10.0 for value in WAVE.deviations)


def test_a_neighbour_that_would_jump_is_named_before_anything_is_written(tmp_path: Path) -> None:
    at = stage(tmp_path)
    c_table = replace(TILT, input_axis="X1", index=1, direction=1)
    at.machine.cross = (LiveTable(c_table, True),)
    at.machine.__post_init__()
    at.machine.position = 200.0
    record = push(at)
    assert record.outcome == "refused"
    assert any(step.startswith("E-INT-OTHERS") and "X1" in step for step in lines(record))
    assert at.machine.writes == []


def test_a_table_number_of_another_output_is_not_taken(tmp_path: Path) -> None:
    at = stage(tmp_path)
    at.machine.others = (LiveTable(replace(WAVE, output_axis="Y1"), False),)
    record = push(at)
    assert any(step.startswith("E-INT-INDEX") for step in lines(record))
    assert at.machine.writes == []


ROLLED_BACK = {
    "mismatch": ("before read_back", changing(wrong_point=0.5)),
    "read_back times out": ("after read_back", deadline),
    "stage is refused": ("before stage", refuse),
    "release is ignored": ("before activate", changing(ignore_release=True)),
    "restarted times out": ("after restarted", deadline),
    "an alarm between the halves": ("after read_back", changing(alarms=(4075,))),
    "the input axis moved between": ("after read_back", changing(z_position=150.0)),
    "the marker is lost": ("before stage", changing(forgets_marker=True)),
    "a neighbour changed": ("before read_back", changing(others=(LiveTable(replace(TILT, output_axis="Y1"), True),))),
    "no effect": ("before restarted", changing(ignore_reset=True)),
}


@ROADS
@pytest.mark.parametrize("name", ROLLED_BACK)
def test_rolled_back(tmp_path: Path, name: str, by_hand: bool) -> None:
    place, fault = ROLLED_BACK[name]
    when, call = place.split()
    at = stage(tmp_path, by_hand=by_hand)

    def once(machine: Machine) -> None:
        del at.controller.faults[(call, 1, when)]
        at.controller.faults[("abort_program", 0, "after")] = changing(
            alarms=(), wrong_point=0.0, ignore_release=False, forgets_marker=False, ignore_reset=False
        )
        fault(machine)

    at.controller.faults[(call, 1, when)] = once
    record = push(at)
    moved_by_hand = by_hand and name == "the input axis moved between"  # the operator is asked to bring it back
    assert record.outcome == ("committed" if moved_by_hand else "rolled-back"), record.steps
    if not moved_by_hand:
        assert all(not one.enabled for one in at.machine.live().cross)
        assert at.machine.marker.state == "none"
    assert only_old_or_new_enabled(at.machine, WAVE, OLD)
    assert at.machine.own == LiveTable(OLD, enabled=True)


@ROADS
def test_nobody_jogs_or_starts(tmp_path: Path, by_hand: bool) -> None:
    at = stage(tmp_path, by_hand=by_hand)
    at.machine.z_position = 150.0
    at.machine.operator = False
    with pytest.raises(DeadlineExceeded):
        push(at)
    assert any(fields.get("position") == 0.0 for code, fields in at.told if code == "P-PUSH-JOG") is by_hand
    assert at.machine.marker.state == "none"
    assert at.machine.writes == []
    assert journals_of(tmp_path)[0].is_ended


def test_held_says_so_in_the_control_and_refuses_the_next(tmp_path: Path) -> None:
    at = stage(tmp_path)
    at.controller.faults[("read_back", 0, "before")] = changing(operator=False)
    record = push(at)
    assert record.outcome == "held-on"
    at.machine.operator = True
    assert at.machine.marker.state == "held"
    elsewhere = tmp_path / "another-pc"
    elsewhere.mkdir()
    other = stage(elsewhere, machine=at.machine)
    refused = push(other)
    assert [step for step in lines(refused) if step.startswith("E-INT-MARKER")]
    assert at.machine.writes == []


@pytest.mark.parametrize("state", ["in-progress", "held", "committed", "none"])
def test_a_foreign_marker_refuses_only_what_has_not_ended(tmp_path: Path, state: Any) -> None:
    at = stage(tmp_path)
    at.machine.marker = Marker(4711, state)
    wanted = "refused" if state in ("in-progress", "held") else "committed"
    assert push(at).outcome == wanted


def test_our_own_marker_of_a_push_that_ended_is_no_obstacle(tmp_path: Path) -> None:
    at = stage(tmp_path)
    record = push(at)
    at.machine.marker = Marker(record.transaction, "in-progress")
    again = stage(tmp_path, machine=at.machine)
    assert push(again, change_for(at.machine, replace(WAVE, deviations=FLAT_WAVE))).outcome == "committed"


def test_a_road_without_a_marker_needs_two_people(tmp_path: Path) -> None:
    at = stage(tmp_path, by_hand=True)
    at.controller.keeps_marker = False
    record = push(at)
    assert record.steps
    assert all(step.startswith("E-INT-APPROVAL-MISSING") for step in lines(record))


# ---- the sign ---------------------------------------------------------------------------------------


def prove(at: Bench, cec_sign: int, gain: float = 1.0, noise: float = 0.02, u: float = 0.05) -> SignProof:
    """A positive stored value moves X1 by -gain x cec_sign."""
    rng = np.random.default_rng(7)

    async def read(_stop: Stop) -> tuple[float, float]:
        return 55.0 - gain * cec_sign * at.machine.crossing + float(rng.normal(0.0, noise)), u

    return run_virtual(
        lambda: prove_sign(at.context, 0.0, 400.0, 50.0, lambda: nullcontext(read), kind="cross", index=WAVE.index)
    )


@ROADS
@SIGNS
@pytest.mark.parametrize("old", [None, replace(WAVE, deviations=FLAT_WAVE)], ids=["empty", "held before"])
def test_the_sign_is_what_is_measured(tmp_path: Path, by_hand: bool, sign: int, old: CompensationTable | None) -> None:
    at = stage(tmp_path, by_hand=by_hand)
    if old is not None:
        at.machine.cross = (LiveTable(old, True),)
        at.machine.__post_init__()
    before = at.machine.live()
    found = prove(at, sign)
    assert (found.kind, found.output_axis, found.sign) == ("cross", "X1", sign)
    assert found.slope == pytest.approx(-sign, abs=0.05)
    assert filled(at.machine) == before.cross
    assert at.machine.writes == ["sign-proof", "restore"]
    assert at.controller.calls.get("switch", 0) == (6 if by_hand else 0)
    assert journals_of(tmp_path)[0].is_ended


@ROADS
@pytest.mark.parametrize(("gain", "u"), [(0.0, 0.05), (0.75, 0.05), (1.3, 0.05), (1.0, 2.0)])
def test_no_sign_in_doubt(tmp_path: Path, by_hand: bool, gain: float, u: float) -> None:
    at = stage(tmp_path, by_hand=by_hand)
    with pytest.raises(VerifyError) as caught:
        prove(at, 1, gain, u=u)
    assert caught.value.code == "E-PUSH-NO-PROOF"
    assert all(not one.enabled for one in at.machine.live().cross)


def test_an_eec_sign_is_proved_by_the_panel_too(tmp_path: Path) -> None:
    at = bench(tmp_path, by_hand=True)

    async def read(_stop: Stop) -> tuple[float, float]:
        return -at.machine.compensation, 0.05

    proved = run_virtual(lambda: prove_sign(at.context, 0.0, 400.0, 50.0, lambda: nullcontext(read)))
    assert (proved.kind, proved.sign) == ("axis", 1)
    assert at.machine.own == LiveTable(OLD, enabled=True)


def test_a_road_that_neither_runs_programs_nor_switches_proves_nothing(tmp_path: Path) -> None:
    at = stage(tmp_path, by_hand=True)
    at.controller.switching = False
    with pytest.raises(UnsupportedDevice) as caught:
        prove(at, 1)
    assert caught.value.code == "E-PUSH-NO-SWITCHING"
    assert at.controller.calls == {}


def test_a_proof_that_cannot_be_put_back_is_held(tmp_path: Path) -> None:
    at = stage(tmp_path)
    at.controller.faults[("read_back", 2, "after")] = deadline
    with pytest.raises(RollbackFailed):
        prove(at, 1)
    assert all(not one.enabled for one in at.machine.live().cross)


# ---- killed -----------------------------------------------------------------------------------------


@ROADS
@pytest.mark.parametrize("sign", few([-1, 1]))
def test_killed_at_every_call_and_recovered(tmp_path: Path, by_hand: bool, sign: int) -> None:
    seen: set[str] = set()
    neighbour = LiveTable(stored(FLAT, sign), True)
    step = 0
    while True:
        root = tmp_path / str(step)
        root.mkdir()
        at = stage(root, sign, by_hand=by_hand, reaper=Reaper(step))
        at.machine.cross = (neighbour,)
        at.machine.__post_init__()
        try:
            assert push(at, sign=sign).outcome == "committed"
            break
        except Killed:
            pass
        at.machine.nck_reset()
        assert only_old_or_new_enabled(at.machine, stored(WAVE, sign), OLD)
        seen |= _recovered(root, at.machine, sign, by_hand, neighbour)
        step += 1
    assert step > 60
    assert {"R-PUSH-UNTOUCHED", "R-PUSH-WRITTEN", "R-PUSH-ENABLED"} <= seen


def _recovered(root: Path, machine: Machine, sign: int, by_hand: bool, neighbour: LiveTable) -> set[str]:
    codes: set[str] = set()
    for found in unfinished_tables(root / "journal", MACHINE.serial):
        if not found.entries:
            continue
        other = stage(root, -sign if found.number % 2 else sign, by_hand=by_hand, machine=machine)
        before = machine.live()
        finding = run_virtual(lambda other=other, found=found: inspect_unfinished(found, other.context))
        assert machine.live() == before
        codes.add(finding.code)
        assert finding.action != "none", finding
        record = run_virtual(lambda other=other, found=found: recover_table(found, other.context))
        assert record.outcome == "rolled-back", record.steps
        assert filled(machine) == (neighbour,)
        assert machine.marker.state == "none"
    assert unfinished_tables(root / "journal", MACHINE.serial) == ()
    return codes


def test_finishing_a_cross_push_proves_it_first(tmp_path: Path) -> None:
    at = stage(tmp_path)
    at.controller.faults[("restarted", 1, "before")] = changing(operator=False)
    assert push(at).outcome == "held-on"
    at.machine.operator = True
    at.machine.nck_reset()
    (found,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
    again = stage(tmp_path, machine=at.machine)
    record = run_virtual(lambda: recover_table(found, again.context, "finish"))
    assert record.outcome == "committed"
    assert at.machine.marker == Marker(found.number, "committed")


def test_a_left_triangle_cannot_be_finished_as_a_table(tmp_path: Path) -> None:
    at = stage(tmp_path)
    at.controller.faults[("restarted", 1, "before")] = changing(operator=False)
    with pytest.raises(RollbackFailed):
        prove(at, 1)
    at.machine.operator = True
    at.machine.nck_reset()
    (found,) = unfinished_tables(tmp_path / "journal", MACHINE.serial)
    again = stage(tmp_path, machine=at.machine)
    with pytest.raises(WriteRefused) as caught:
        run_virtual(lambda: recover_table(found, again.context, "finish"))
    assert caught.value.code == "E-PUSH-NO-OFFER"
    assert run_virtual(lambda: recover_table(found, again.context)).outcome == "rolled-back"


@pytest.mark.parametrize("seed", few(range(60), 25))
def test_seeded_faults_never_enable_a_wrong_table_nor_leave_a_neighbour_behind(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    sign, by_hand, coupled = 1 - 2 * (seed % 2), bool(seed % 4 > 1), bool(seed % 8 > 3)
    at = stage(tmp_path, sign, by_hand=by_hand)
    at.machine.cross = (LiveTable(stored(FLAT, sign), coupled),)
    at.machine.__post_init__()
    before = at.machine.live().cross
    calls = ["identify", "state", "marker", "saved_tables", "stage", "read_back", "activate"]
    calls += ["confirm", "restarted", "abort_program", "finish_push", "wait_stop", "prepare_stops"]
    faults = [
        deadline,
        refuse,
        changing(operator=False),
        changing(operator=True, wrong_point=0.0),
        changing(wrong_point=0.7),
        changing(ignore_release=True),
        changing(ignore_reset=True),
        changing(alarms=(1,)),
        changing(identity=replace(MACHINE, serial="?")),
        changing(z_position=170.0),
        changing(forgets_marker=True),
    ]
    for _ in range(int(rng.integers(1, 5))):
        call, when = str(rng.choice(calls)), str(rng.choice(["before", "after"]))
        at.controller.faults[(call, int(rng.integers(1, 4)), when)] = faults[int(rng.integers(len(faults)))]
    outcome = "raised"
    try:
        outcome = push(at, sign=sign).outcome
    except TrueflankError:
        assert filled(at.machine) == before
    assert only_old_or_new_enabled(at.machine, stored(WAVE, sign), OLD), outcome
    assert at.machine.own == LiveTable(OLD, enabled=True)
    if outcome in ("rolled-back", "refused", "raised"):
        assert filled(at.machine) == before
    elif outcome == "committed":
        assert held(at.machine, 2) == LiveTable(stored(WAVE, sign), enabled=True)
        assert held(at.machine, 6).enabled is coupled
    else:
        assert not journals_of(tmp_path)[0].is_ended


# ---- sums -------------------------------------------------------------------------------------------


def test_sums_of_tables_and_products() -> None:
    two = replace(TILT, multiply_by=WAVE.index + 1)
    places = {"Z1": 100.0}
    assert possible_sums([WAVE, TILT], places) == (9.0,)
    both = 7.0 * 2.0 / 1000.0
    assert possible_sums([WAVE, two], places) == pytest.approx((9.0 + both, both))
    assert possible_sums([WAVE, two, FLAT], places) == pytest.approx((9.4 + both, 0.4 + both))


def test_room_to_jog_shrinks_with_the_slope() -> None:
    assert position_tolerance() == 1.0
    assert position_tolerance(WAVE) == 1.0
    assert position_tolerance(replace(WAVE, deviations=(0.0, 50.0) * 4 + (0.0,))) == pytest.approx(0.25)
    assert journal.MAX_NUMBER < 2**31
    assert issubclass(UnsupportedDevice, TrueflankError)
