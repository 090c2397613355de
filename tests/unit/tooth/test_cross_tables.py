"""Corrections as changes of CEC tables: which number, merged with what acted by its proved sign, and who has none."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drivers.errors import DeviceRefused, ValueOutOfRange
from drivers.sinumerik.tablefile.tables import HELD_KINDS, tables_by_proof
from drivers.types.abilities import Capabilities, TableAbility, TableLimits
from drivers.types.orders import SignProof
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from gateway.correct.flank.tables import Table, TableGrid
from gateway.domain.proposals import TableChange
from gateway.errors import CaptureError
from gateway.model.error_model import yk7350b
from gateway.workflow.axes.cross_tables import acting_cross, assign_numbers, cross_changes
from gateway.workflow.tooth.proposal import _Task
from tests.signed import proof_of

CHAIN = yk7350b()
Z, C = np.linspace(0.0, 40.0, 5), np.deg2rad(np.arange(0.0, 361.0, 45.0))
PEAK = (0.0, 0.001, 0.002, 0.001, 0.0)  # mm added to X: a deviation of -2 um at Z 20


@dataclass
class Control:
    """Memory by table number; a number beyond is refused as the mailbox does."""

    memory: tuple[int, ...]
    asked: list[int] = field(default_factory=list)
    tables: tuple[TableAbility, ...] = HELD_KINDS

    @property
    def capabilities(self) -> Capabilities:
        return Capabilities(False, self.tables, "by-itself", True, "panel")

    def tables_by(self, found: LiveSet, proof: SignProof | None) -> LiveSet:
        return tables_by_proof(found, proof)

    async def table_limits(self, axis: str, kind: str, index: int) -> TableLimits:
        assert (axis, kind) in {("X1", "cross"), ("C1", "cross")}
        self.asked.append(index)
        if index >= len(self.memory):
            raise DeviceRefused("E-MBX-TABLE", axis)
        return TableLimits(self.memory[index], 1e-6, 1.0)


def bench(control: Control, sign: int = 0) -> Any:
    names = (("X1", "X"), ("Z1", "Z"), ("C1", "C"))
    site = SimpleNamespace(axes=[SimpleNamespace(name=name, letter=letter) for name, letter in names])
    proof = proof_of(sign) if sign else None
    proofs = SimpleNamespace(find=lambda _machine, _function, _axis: proof)
    moved = frozenset(name for name, _ in names)
    return SimpleNamespace(
        site=site, moved=moved, supervisor=SimpleNamespace(controller=control), proofs=proofs, machine=None
    )


def held(
    index: int, out: str = "X1", over: str = "Z1", value: float = 1.0, *, enabled: bool = True, direction: Any = 0
) -> LiveTable:
    values = (0.0, value, 0.0, 0.0, 0.0)
    return LiveTable(
        CompensationTable("cross", over, out, 0.0, 40.0, 10.0, values, index=index, direction=direction), enabled
    )


def live(axis: str, cec: tuple[LiveTable, ...] = (), others: tuple[LiveTable, ...] = ()) -> LiveSet:
    own = LiveTable(CompensationTable("axis", axis, axis, 0.0, 0.0, 0.0, (0.0,)), enabled=False)
    return LiveSet(axis, own, cec, 0.0, "", f"digest of {axis}", others)


def x_of_z() -> Table:
    return Table(TableGrid("X", "Z", Z), np.asarray(PEAK))


def x_of_c() -> Table:
    return Table(TableGrid("X", "C", C, 2.0 * np.pi), np.array([0.0, 1, 2, 3, 4, 3, 2, 1, 0]) * 1e-3)


def changes(
    at: Any, tables: tuple[Table, ...], sets: tuple[LiveSet, ...], *, adds: bool = False
) -> tuple[TableChange, ...]:
    return asyncio.run(cross_changes(at, tables, CHAIN, live={one.axis: one for one in sets}, adds=adds))


def test_a_free_number_with_room_is_taken_and_one_of_others_is_not() -> None:
    control = Control((100, 4, 8, 100, 100))
    sets = (live("X1", others=(held(0, "C1", "C1"), held(3, "C1", "Z1", 0.0, enabled=False))), live("C1"))
    small, large = changes(bench(control), (x_of_z(), x_of_c()), sets)
    # 0 belongs to C1, 1 is too small for 5 points; 2 has room for 5 but not for 9; 3 holds nothing and is off.
    assert (small.name, large.name) == ("X1-cec2", "X1-cec3")
    assert small.new.deviations == (0.0, -1.0, -2.0, -1.0, 0.0)
    assert (small.new.input_axis, small.new.output_axis, small.old_enabled) == ("Z1", "X1", False)
    assert (large.new.input_unit, large.new.maximum, large.new.modulo) == ("deg", 360.0, True)
    assert (small.base, small.base_digest) == (sets[0], "digest of X1")
    assert (small.skipped, large.skipped) == (None, None)


def test_the_largest_goes_first_and_each_into_the_smallest_memory_that_holds_it() -> None:
    """In the plan's order X(Z) took a memory that only X(C) needed, and C(C) was dropped."""
    needs = {0: 31, 1: 73, 2: 31, 3: 73}
    rooms = {key: {0: 100, 1: 40, 2: 40, 3: 100} for key in needs}
    assert assign_numbers(needs, rooms) == {1: 0, 3: 3, 0: 1, 2: 2}
    control = Control((100, 8, 8, 100))
    sets = (live("X1"), live("C1"))
    small, large = changes(bench(control), (x_of_z(), x_of_c()), sets)
    assert (small.name, large.name) == ("X1-cec1", "X1-cec0")


def test_where_there_is_room_for_some_those_that_gain_most_come_first() -> None:
    needs = {0: 31, 1: 73, 2: 31, 3: 73}
    rooms = {key: {0: 100, 1: 40} for key in needs}
    assert set(assign_numbers(needs, rooms)) == {0, 1}
    assert set(assign_numbers(needs, rooms, [3, 2, 1, 0])) == {3, 2}
    assert set(assign_numbers(needs, rooms, [0, 2, 1, 3])) == {0, 2}
    assert assign_numbers(needs, {key: {} for key in needs}, [0, 1, 2, 3]) == {}


def test_what_the_flank_would_miss_most_comes_first() -> None:
    able = (("X", "Z"), ("X", "C"), ("C", "C"))
    left = {able[1:]: 0.40, (able[0], able[2]): 0.25, able[:2]: 0.37}
    task: Any = SimpleNamespace(_rms=lambda cross: left[cross])
    assert _Task._by_gain(task, able) == (0, 2, 1)


@pytest.mark.parametrize("sign", [1, -1])
def test_what_acts_is_kept_in_its_place_and_merged_by_its_proved_sign(sign: int) -> None:
    """The control holds 3 um; by the proof that is a deviation of +3 or -3 at Z 10."""
    at, sets = bench(Control((100, 100)), sign), (live("X1", (held(1, value=3.0),)),)
    (added,) = changes(at, (x_of_z(),), sets, adds=True)
    (instead,) = changes(at, (x_of_z(),), sets)
    assert added.name == instead.name == "X1-cec1"
    assert added.new.deviations == pytest.approx((0.0, -1.0 + 3.0 * sign, -2.0, -1.0, 0.0))
    assert instead.new.deviations == pytest.approx((0.0, -1.0, -2.0, -1.0, 0.0))
    assert added.old.deviations[1] == 3.0 * sign
    assert added.old_enabled
    assert [one.deviations[1] for one in acting_cross(at, {"X1": sets[0]})] == [3.0 * sign]


def test_what_is_off_is_replaced_and_a_pair_by_direction_is_left_alone() -> None:
    sets = (live("X1", (held(0, direction=1), held(1, value=5.0, enabled=False))),)
    (one,) = changes(bench(Control((100, 100, 100)), 1), (x_of_z(),), sets, adds=True)
    assert one.name == "X1-cec1"
    assert one.new.deviations == (0.0, -1.0, -2.0, -1.0, 0.0)


def test_without_room_or_proof_nothing_is_proposed_and_the_reason_said() -> None:
    control = Control((100, 100, 4))
    sets = (live("X1", others=(held(0, "C1", "C1"), held(1, "C1", "Z1"))), live("C1"))
    full = changes(bench(control), (x_of_z(), x_of_c()), sets)
    assert all("no free cross table" in str(one.skipped) for one in full)
    assert len({one.name for one in full}) == 2
    assert max(control.asked) == 3
    (unproved,) = changes(bench(Control((100,))), (x_of_z(),), (live("X1", (held(0),)),))
    assert "never proved" in str(unproved.skipped)
    assert acting_cross(bench(Control(())), {"X1": live("X1", (held(0),))}) == ()
    with pytest.raises(CaptureError) as caught:
        changes(bench(Control((100,))), (x_of_z(),), (live("C1"),))
    assert caught.value.code == "E-RUN-LIVE"


def test_a_table_beyond_the_limits_of_the_house_is_no_proposal() -> None:
    at, acts = bench(Control((100,)), 1), (live("X1", (held(0, value=120.0),)),)
    steep = Table(TableGrid("X", "Z", Z), np.array([0.0, 0.011, 0.0, 0.0, 0.0]))
    with pytest.raises(ValueOutOfRange) as caught:
        changes(at, (steep,), acts)
    assert caught.value.code in {"E-COMP-SLOPE", "E-COMP-CHANGE"}


def test_a_control_without_cross_tables_gets_none_and_is_not_even_asked_for_room() -> None:
    control = Control((100, 100), tables=(TableAbility("axis", "free", "columns", 256),))
    (change,) = changes(bench(control), (x_of_z(),), (live("X1"),))
    assert "this control has no cross tables" in str(change.skipped)
    assert control.asked == []
