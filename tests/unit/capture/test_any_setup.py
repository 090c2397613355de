"""One reading out of line in any set-up, at any repetition and on either way: it is taken again, and nothing ends."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
import pytest

from drivers.clock import LoopClock, run_virtual
from gateway.capture.error_motion import ErrorRig, capture_error, error_capture
from gateway.capture.live import RawCapture
from gateway.capture.revisits import require_complete
from gateway.domain.captures import Capture
from tests.sizes import few
from tests.unit.capture.test_live import PATIENCE
from tests.unit.capture.test_retakes import (
    NOISE_UM,
    OFF_UM,
    TARGETS,
    Disturbed,
    Turning,
    axis,
    judged,
    positioned,
    table_axis,
)


def mounted(bad: Collection[int], component: str, unit: str, used: Any, kind: type[Disturbed]) -> Capture:
    """Any error motion or location of an axis, seen by an instrument that hardly follows it."""
    used = used.model_copy(update={"measure": used.measure.model_copy(update={"component": component, "stable": 0.5})})

    async def main() -> RawCapture:
        clock, rng = LoopClock(), np.random.default_rng(5)

        def reads(position: np.ndarray, times: np.ndarray) -> np.ndarray:
            noise = rng.normal(0.0, 0.01, position.shape) + NOISE_UM * np.sin(7.0 * machine.number)
            return np.sin(np.deg2rad(2.0 * position)) + 1000.0 * machine.shift_mm(times) + noise

        machine = kind(clock, reads, channels=(f"deviation_{unit}",), name="level")
        machine.bad = bad
        rig: Any = ErrorRig(used, machine, machine, clock, PATIENCE, unit=unit, optics=("straightness",), largest=500.0)
        return await capture_error(rig)

    rig: Any = ErrorRig(used, None, None, LoopClock(), PATIENCE, unit=unit)  # type: ignore[arg-type]
    return error_capture(rig, run_virtual(main), 1)


SET_UPS: dict[str, tuple[str, bool]] = {
    "EYX": ("um", False),
    "EAX": ("arcsec", False),
    "B0Z": ("um", False),
    "EXC": ("um", True),
    "EBC": ("arcsec", True),
    "A0C": ("um", True),
}


@pytest.mark.parametrize("repetition", few((1, 0, 2)))
@pytest.mark.parametrize("component", SET_UPS)
def test_one_reading_out_of_line_in_any_set_up_at_any_repetition_ends_nothing(component: str, repetition: int) -> None:
    """On the way up and on the way down, each at another target; the capture is whole, and the reading gone."""
    unit, turns = SET_UPS[component]
    used, kind = (table_axis(TARGETS), Turning) if turns else (axis(3), Disturbed)
    for way in (0, 1):
        number = (2 * repetition + way) * TARGETS + (2 * repetition + way) % TARGETS
        found = mounted((number,), component, unit, used, kind)
        assert found.suspects == ()
        assert any("outlier" in note for note in map(str, found.notes))
        assert np.abs(found.deviations - np.median(found.deviations, axis=1, keepdims=True)).max() < OFF_UM / 4.0
        require_complete(found)


@pytest.mark.parametrize("repetition", range(3))
def test_so_does_a_position_on_either_way(repetition: int) -> None:
    for way in (0, 1):
        judged(positioned(((2 * repetition + way) * TARGETS + repetition + 1,)))
