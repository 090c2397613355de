"""Capturing with the little machine: attribution, sense, settling, and what must be refused."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import numpy as np
import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import DeadlineExceeded, DeviceRefused, TrueflankError, UnsupportedDevice
from drivers.types.machine import MachineState
from gateway.capture.live import RawCapture, capture_axis
from gateway.capture.rig import Rig, prove_sense
from gateway.config import AxisSection
from gateway.domain.equipment import SenseProof
from gateway.errors import Incomplete, Unstable
from gateway.moves import Patience
from tests.unit.capture.double import LittleMachine

AXIS = AxisSection.model_validate(
    {
        "name": "X1",
        "letter": "X",
        "kind": "linear",
        "travel": [-120.0, 120.0],
        "measure": {
            "instrument": "laser",
            "component": "EXX",
            "targets": {"first": -100.0, "last": 100.0, "count": 6, "offset_fraction": 0.2},
            "repetitions": 2,
            "feed": 6000.0,
            "stable": 0.5,
        },
        "table": {"minimum": -100.0, "maximum": 100.0, "step": 20.0},
    }
)
PATIENCE = Patience(30.0, 60.0)


def _error_um(position: np.ndarray) -> np.ndarray:
    return 3.0 * np.sin(position / 17.0) + 0.05 * position


def _laser(sense: int, rng: np.random.Generator) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    def reads(position: np.ndarray, _times: np.ndarray) -> np.ndarray:
        noise = rng.normal(0.0, 2e-5, position.shape)
        return sense * (position + _error_um(position) / 1000.0 + 41.5) + noise

    return reads


def _run(sense: int = 1, **changes: object) -> tuple[RawCapture, SenseProof]:
    async def main() -> tuple[RawCapture, SenseProof]:
        clock = LoopClock()
        clock.now()
        machine = LittleMachine(clock, _laser(sense, np.random.default_rng(3)))
        proof = await prove_sense(Rig(AXIS, machine, machine, clock, PATIENCE))
        for name, value in changes.items():
            setattr(machine, name, value)
        raw = await capture_axis(Rig(AXIS, machine, machine, clock, PATIENCE), proof)
        return raw, proof

    return run_virtual(main)


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("late_s", [0.0, 1.7, 3.0])
def test_every_reading_belongs_to_its_own_target_whatever_sense_and_delay(sense: int, late_s: float) -> None:
    raw, proof = _run(sense, late_s=late_s)
    assert proof.sense == sense
    measured_mm = proof.sense * (raw.values[..., 0] - raw.values[0, 0, 0, 0])
    wanted = raw.targets + _error_um(raw.targets) / 1000.0
    deviation = measured_mm - (wanted - wanted[0])[:, None, None]
    assert np.max(np.abs(deviation)) < 2e-5


def test_targets_are_uneven_but_the_datum_and_the_ends_stay() -> None:
    raw, _proof = _run()
    steps = np.diff(raw.targets)
    assert np.ptp(steps) > 1.0
    assert raw.targets[0] >= -100.0
    assert raw.targets[-1] <= 100.0


def test_a_missed_stop_is_refused() -> None:
    with pytest.raises(DeviceRefused, match="E-WALK-ORDER"):
        _run(skip_stop=3)


def test_optics_that_do_not_follow_are_refused_with_what_was_read() -> None:
    async def main() -> None:
        clock = LoopClock()
        machine = LittleMachine(clock, lambda position, _times: 1e-5 * position)
        await prove_sense(Rig(AXIS, machine, machine, clock, PATIENCE))

    with pytest.raises(UnsupportedDevice, match="jog of 10 mm read"):
        run_virtual(main)


def test_a_wrong_unit_is_refused() -> None:
    async def main() -> None:
        clock = LoopClock()
        machine = LittleMachine(clock, lambda position, _times: position / 25.4 * 10)
        await prove_sense(Rig(AXIS, machine, machine, clock, PATIENCE))

    with pytest.raises(UnsupportedDevice, match="the limit is 1 %"):
        run_virtual(main)


def test_a_reading_that_never_settles_says_which_condition_is_missing() -> None:
    async def main() -> None:
        clock = LoopClock()
        rng = np.random.default_rng(5)
        machine = LittleMachine(clock, lambda position, _times: position + rng.normal(0, 0.01, position.shape))
        await prove_sense(Rig(AXIS, machine, machine, clock, PATIENCE))

    with pytest.raises(Unstable, match="sigma"):
        run_virtual(main)


def test_an_axis_at_rest_shows_what_the_instrument_scatters_slower_than_a_reading() -> None:
    """Air that drifts to and fro within seconds: no window of a second shows it, readings at rest do."""

    async def main() -> RawCapture:
        clock = LoopClock()
        clock.now()
        steady = _laser(1, np.random.default_rng(3))
        slow = np.random.default_rng(5).normal(0.0, 3e-4, 4000)

        def reads(position: np.ndarray, times: np.ndarray) -> np.ndarray:
            return steady(position, times) + slow[(times // 2.0).astype(int)]

        axis = AXIS.model_copy(update={"measure": AXIS.measure.model_copy(update={"standstill": 20})})
        machine = LittleMachine(clock, steady)
        rig = Rig(axis, machine, machine, clock, PATIENCE)
        proof = await prove_sense(rig)
        machine.reads = reads
        return await capture_axis(rig, proof)

    raw = run_virtual(main)
    assert len(raw.standing) == 20
    assert np.std(raw.standing, ddof=1) == pytest.approx(3e-4, rel=0.4)
    assert np.nanmean(raw.window_sigma) < 1e-4


@pytest.mark.parametrize("looks", [True, False])
def test_a_program_that_somebody_ends_is_told_while_the_reading_still_does_not_settle(looks: bool) -> None:
    """Within seconds of the reset, not at the reading's own time-out; a road that does not answer tells nothing."""
    restless_s, told_after_s = 50.0, []

    async def main() -> None:
        clock = LoopClock()
        rng = np.random.default_rng(3)

        def reads(position: np.ndarray, times: np.ndarray) -> np.ndarray:
            return position + rng.normal(0.0, 2e-5 + 0.01 * (times > restless_s))

        machine = LittleMachine(clock, reads)
        rig = Rig(AXIS, machine, machine, clock, PATIENCE)

        async def person() -> None:
            await clock.sleep(60.0 - clock.now())
            await machine.abort_program()

        async def silent() -> MachineState:
            raise DeadlineExceeded("E-LINK-DEADLINE", "controller", timeout_s=1.0)

        proof = await prove_sense(rig)
        if not looks:
            machine.state = silent  # type: ignore[method-assign]
        pressing = asyncio.create_task(person())
        try:
            await capture_axis(rig, proof)
        finally:
            told_after_s.append(clock.now() - 60.0)
            await pressing

    with pytest.raises(Incomplete if looks else TrueflankError, match="E-WALK-ENDED" if looks else "E-"):
        run_virtual(main)
    assert (told_after_s[0] < 10.0) == looks
