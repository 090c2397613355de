"""Cycles, target rules, taking again and beam recovery: what a capture plan promises."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from drivers.clock import LoopClock, run_virtual
from drivers.errors import BeamObstructed
from gateway.capture.corrections import from_live
from gateway.capture.live import RawCapture, capture_axis
from gateway.capture.rig import Rig, prove_sense
from gateway.capture.targets import Cycle, cycle_visits, positions, with_window
from gateway.config import AxisSection, Targets
from gateway.errors import Unstable
from gateway.evaluate.behaviour.doubts import doubts_of
from gateway.moves import Patience
from tests.unit.capture.double import LittleMachine
from tests.unit.capture.test_live import AXIS

PATIENCE = Patience(30.0, 60.0)


def axis_with(**measure: Any) -> AxisSection:
    return AXIS.model_copy(update={"measure": AXIS.measure.model_copy(update=measure)})


def error_mm(position: np.ndarray) -> np.ndarray:
    return (3.0 * np.sin(position / 17.0) + 0.05 * position) / 1000.0


def run(axis: AxisSection, laser: Any = None, **changes: Any) -> tuple[RawCapture, LittleMachine, list[str]]:
    """A capture with a laser that reads position and error; `laser` may bend (value, times)."""
    said: list[str] = []

    async def main() -> tuple[RawCapture, LittleMachine, list[str]]:
        clock = LoopClock()
        rng = np.random.default_rng(7)

        def reads(position: np.ndarray, times: np.ndarray) -> np.ndarray:
            value = position + error_mm(position) + rng.normal(0.0, 2e-5, position.shape)
            return value if laser is None else laser(value, times)

        machine = LittleMachine(clock, reads)
        proof = await prove_sense(Rig(axis, machine, machine, clock, PATIENCE))
        for name, value in changes.items():
            setattr(machine, name, value)
        rig = Rig(axis, machine, machine, clock, PATIENCE, lambda code, **_fields: said.append(code))
        return await capture_axis(rig, proof), machine, said

    return run_virtual(main)


def worst_um(raw: RawCapture) -> float:
    measured = raw.values[..., 0] - raw.values[0, 0, 0, 0]
    wanted = raw.targets + error_mm(raw.targets)
    return 1000.0 * float(np.max(np.abs(measured - (wanted - wanted[0])[:, None, None])))


@given(st.sampled_from(["standard", "pendulum", "pilgrim"]), st.integers(2, 30), st.integers(1, 6))
def test_every_cycle_visits_everything_once(cycle: Cycle, count: int, repetitions: int) -> None:
    targets = np.arange(float(count))
    found = cycle_visits(cycle, targets, repetitions)
    assert len(found) == 2 * count * repetitions
    assert len({(stop.label, stop.repetition, stop.approach) for stop in found}) == len(found)
    assert all(stop.target == targets[stop.label] for stop in found)


def test_the_cycles_are_what_their_names_say() -> None:
    def shape(cycle: Cycle, count: int) -> list[tuple[int, int, int]]:
        return [(s.label, s.approach, s.repetition) for s in cycle_visits(cycle, np.arange(float(count)), 2)]

    assert shape("standard", 2) == [
        (0, 1, 0),
        (1, 1, 0),
        (1, -1, 0),
        (0, -1, 0),
        (0, 1, 1),
        (1, 1, 1),
        (1, -1, 1),
        (0, -1, 1),
    ]
    assert shape("pendulum", 2) == [
        (0, 1, 0),
        (0, -1, 0),
        (0, 1, 1),
        (0, -1, 1),
        (1, 1, 0),
        (1, -1, 0),
        (1, 1, 1),
        (1, -1, 1),
    ]
    pilgrim = [label for label, _approach, repetition in shape("pilgrim", 6) if repetition == 0]
    assert pilgrim == [0, 1, 2, 3, 3, 2, 1, 0, 4, 5, 5, 4]


@pytest.mark.parametrize("cycle", ["pendulum", "pilgrim"])
def test_other_cycles_measure_the_same_and_are_told_from_the_standard_one(cycle: str) -> None:
    axis = axis_with(cycle=cycle)
    raw, _machine, _said = run(axis)
    assert worst_um(raw) < 0.05
    assert np.isfinite(raw.time_s).all()
    order = np.argsort(raw.time_s, axis=None)
    assert not np.array_equal(order, np.argsort(run(AXIS)[0].time_s, axis=None))


@pytest.mark.parametrize(
    ("length", "rotary", "count"),
    [
        (300.0, False, 5),
        (1000.0, False, 5),
        (1500.0, False, 8),
        (2000.0, False, 10),
        (2100.0, False, 10),
        (4000.0, False, 17),
        (90.0, True, 3),
        (91.0, True, 5),
        (180.0, True, 5),
        (360.0, True, 8),
        (400.0, True, 9),
        (720.0, True, 16),
    ],
)
def test_the_standards_least_number_of_targets(length: float, rotary: bool, count: int) -> None:
    wanted = Targets(first=0.0, last=length, count="iso230-2")
    found = positions(wanted, 0.0, rotary=rotary)
    assert len(found) == count
    assert found[0] >= 0.0
    assert found[-1] <= length
    doubts = doubts_of(found, np.zeros((len(found), 1, 2)), "deg" if rotary else "mm")
    assert not [one for one in doubts if one.code == "S-EVAL-TARGETS"]
    if count > 4:
        assert np.ptp(np.diff(found)) > 0.01 * length / count  # random offsets, so that nothing periodic hides


def test_a_working_window_is_visited_at_table_step_beside_the_full_travel() -> None:
    wanted = Targets.model_validate(
        {"first": -100, "last": 100, "count": 5, "window": {"first": -12.0, "last": 12.0, "step": 2.0}}
    )
    found = positions(wanted, 0.0)
    inside = found[(found >= -12.0) & (found <= 12.0)]
    assert inside == pytest.approx(np.arange(-12.0, 12.1, 2.0))
    assert [p for p in found if abs(p) > 12] == [-100.0, -50.0, 50.0, 100.0]
    assert np.min(np.diff(found)) >= 1.0
    assert with_window(found, np.array([5.0])) is found


@pytest.mark.parametrize(
    "wrong",
    [
        {"count": 1},
        {"count": -3},
        {"first": 5, "last": 5, "count": "iso230-2"},
        {"count": "iso"},
        {},
        {"count": 5, "window": {"first": 1, "last": 1, "step": 1}},
        {"count": 5, "positions": [1, 2]},
    ],
)
def test_targets_that_make_no_sense_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        Targets.model_validate(wrong)


def test_fault_21_a_lost_beam_costs_a_new_datum_and_no_reading() -> None:
    """The count starts anew at the break: every reading must still be of the first datum."""
    broken_at = 60.0

    def restarts(value: np.ndarray, times: np.ndarray) -> np.ndarray:
        return np.where(times > broken_at, value - 77.7, value)

    raw, machine, said = run(AXIS, restarts, bad_at=broken_at)
    assert worst_um(raw) < 0.08
    assert said.count("P-CAP-BEAM") == 1
    assert machine.aborted
    assert machine.setups[-1] == "TRUEFLANK SETUP EXX ON X"  # the operator's act, not ours
    assert "a new datum was set" in str(raw.notes[0])


def test_fault_21_without_recovery_the_capture_ends() -> None:
    with pytest.raises(BeamObstructed, match="E-CAP-BEAM"):
        run(axis_with(beam_recoveries=0), bad_at=60.0)


def test_a_reading_that_did_not_settle_is_taken_again_at_the_end() -> None:
    def shaken(value: np.ndarray, times: np.ndarray) -> np.ndarray:
        return value + np.where((times > 50.0) & (times < 115.0), 0.01 * np.sin(40.0 * times), 0.0)

    raw, _machine, said = run(AXIS, shaken)
    assert worst_um(raw) < 0.05
    assert said.count("P-CAP-UNSETTLED") >= 1
    assert "P-CAP-RETAKE" in said
    assert "measured again" in str(raw.notes[0])


def test_what_never_settles_ends_with_the_condition_that_is_missing() -> None:
    def shaken(value: np.ndarray, times: np.ndarray) -> np.ndarray:
        return value + np.where(times > 50.0, 0.01 * np.sin(40.0 * times), 0.0)

    with pytest.raises(Unstable, match="sigma"):
        run(AXIS, shaken)


def test_the_capture_says_its_cycle() -> None:
    axis = axis_with(cycle="pilgrim")

    async def main() -> str:
        clock = LoopClock()
        machine = LittleMachine(clock, lambda position, _times: position + error_mm(position))
        proof = await prove_sense(Rig(axis, machine, machine, clock, PATIENCE))
        raw = await capture_axis(Rig(axis, machine, machine, clock, PATIENCE), proof)
        return from_live(axis, raw, proof, "nothing").cycle

    assert run_virtual(main) == "pilgrim"
