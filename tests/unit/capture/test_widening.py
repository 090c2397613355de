"""More targets in a capture that still stands: cost as said, brought to the level of the others, or left out again."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from drivers.clock import LoopClock, run_virtual
from gateway.capture.collection import RawCapture
from gateway.capture.corrections import from_live
from gateway.capture.live import capture_axis
from gateway.capture.revisits import affordable, cost_s
from gateway.capture.rig import Rig, prove_sense
from gateway.domain.captures import Capture
from tests.unit.capture.double import LittleMachine
from tests.unit.capture.test_live import AXIS, PATIENCE, _error_um

PLACES = np.array([-71.0, -33.0, 8.5, 52.0])
DRIFT_UM_PER_S = 0.004


def widened(drift_um_per_s: float = 0.0, stuck_at: float | None = None) -> tuple[Capture, RawCapture, float]:
    """The capture of a little axis with four more targets, and how long these took in seconds."""
    took: list[float] = []

    async def main() -> tuple[RawCapture, Any]:
        clock, rng = LoopClock(), np.random.default_rng(3)

        def reads(position: np.ndarray, times: np.ndarray) -> np.ndarray:
            shake = 0.02 * (stuck_at is not None and bool(took)) * (np.abs(position - (stuck_at or 0.0)) < 0.1)
            noise = rng.normal(0.0, 1.0, position.shape) * (1e-5 + shake)
            return position + (_error_um(position) + drift_um_per_s * times) / 1000.0 + noise

        machine = LittleMachine(clock, reads)
        rig = Rig(AXIS, machine, machine, clock, PATIENCE)  # type: ignore[arg-type]
        proof = await prove_sense(rig)

        def more(raw: RawCapture) -> np.ndarray:
            took.append(clock.now())
            return PLACES if len(took) == 1 else np.empty(0)

        return await capture_axis(rig, proof, np.array([-45.0]), more), proof

    raw, proof = run_virtual(main)
    return from_live(AXIS, raw, proof, "air+material"), raw, took[1] - took[0]


def off(capture: Capture) -> np.ndarray:
    """How far each target's mean lies off the truth, um."""
    left = np.nanmean(capture.deviations, axis=(1, 2)) - _error_um(capture.targets)
    return np.asarray(left - np.mean(left))


def test_new_targets_stand_among_the_others_and_cost_what_was_said() -> None:
    capture, raw, took_s = widened()
    assert capture.deviations.shape == (10, 2, 2)
    assert set(PLACES) <= set(capture.targets)
    assert capture.between is not None
    assert capture.between.targets.tolist() == [-45.0]
    assert [float(raw.targets[i]) for i in raw.added] == PLACES.tolist()
    assert np.max(np.abs(off(capture))) < 0.03
    assert any(note.startswith("targets added") and ": 4" in note for note in map(str, capture.notes))
    said = cost_s(AXIS, PLACES.size, float(np.ptp(capture.targets)))
    assert 0.6 * took_s < said < 1.5 * took_s


def test_a_zero_that_wanders_meanwhile_does_not_part_new_from_old() -> None:
    capture, _raw, took_s = widened(DRIFT_UM_PER_S)
    assert DRIFT_UM_PER_S * took_s > 0.3
    new = np.isin(capture.targets, PLACES)
    assert abs(np.mean(off(capture)[new]) - np.mean(off(capture)[~new])) < 0.15


def test_a_new_target_that_does_not_settle_is_left_out_and_the_capture_stands() -> None:
    capture, raw, _took = widened(stuck_at=8.5)
    assert 8.5 not in capture.targets
    assert np.isfinite(capture.deviations).all()
    assert len(raw.added) == 3
    assert any("could not be read" in note for note in map(str, capture.notes))


@pytest.mark.parametrize("hours", [0.0, 0.01, 0.2, 3.0])
def test_what_is_affordable_costs_no_more(hours: float) -> None:
    count = affordable(AXIS, hours, 200.0)
    assert count == 0 or cost_s(AXIS, count, 200.0) <= hours * 3600.0 < cost_s(AXIS, count + 1, 200.0)
