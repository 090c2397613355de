"""Capturing what hardly moves: attribution by instrument time, mountings proved, beams lost, dead instruments."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from dataclasses import replace

import numpy as np
import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import ConfigError, UnsupportedDevice
from drivers.types.sensing import Optics, SampleBlock
from drivers.types.stops import StopPlan
from gateway.capture.error_motion import (
    ErrorReadings,
    ErrorRig,
    MountingProof,
    capture_error,
    channel_of,
    error_capture,
    prove_mounting,
)
from gateway.capture.live import RawCapture
from gateway.config import AxisSection
from gateway.domain.captures import Capture
from gateway.errors import CaptureError
from gateway.moves import Patience
from tests.unit.capture.double import LittleMachine
from tests.unit.components.site import axis

AXIS = AxisSection.model_validate(
    axis(
        "X1",
        "linear",
        [-100.0, 100.0],
        "EYX",
        instrument="straightness",
        targets={"first": -100.0, "last": 100.0, "count": 6, "offset_fraction": 0.2},
        repetitions=2,
    )
)
Reads = Callable[[np.ndarray, np.ndarray], np.ndarray]


class Little(LittleMachine):
    """A little machine whose instrument may tell its optics, and whose samples come late in blocks."""

    seen_optics = "straightness"
    behind_s = 0.0

    async def optics(self) -> Optics:
        return Optics(self.seen_optics)


def straight_um(position: np.ndarray) -> np.ndarray:
    return 3.0 * np.sin(position / 25.0) + 0.1 * position


def reading(noise: float = 0.05) -> Reads:
    rng = np.random.default_rng(4)
    return lambda position, _times: straight_um(position) + 8.0 + rng.normal(0.0, noise, position.shape)


def rig_of(machine: Little, **changes: object) -> ErrorRig:
    options = {"unit": "um", "optics": ("straightness", "unknown")} | changes
    return ErrorRig(AXIS, machine, machine, machine.clock, Patience(30.0, 60.0), **options)  # type: ignore[arg-type]


def run(
    reads: Reads, change: Callable[[Little], None] | None = None, **options: object
) -> tuple[MountingProof, RawCapture, Capture]:
    async def main() -> tuple[MountingProof, RawCapture, Capture]:
        clock = LoopClock()
        clock.now()
        machine = Little(clock, reads, ("deviation_um",), "straightness")
        rig = rig_of(machine, **options)
        proof = await prove_mounting(rig)
        if change is not None:
            change(machine)
        raw = await capture_error(rig)
        assert machine.setups[0] == "TRUEFLANK SETUP EYX ON X"
        return proof, raw, error_capture(rig, raw, 1 if rig.factor > 0 else -1)

    return run_virtual(main)


@pytest.mark.parametrize("factor", [1.0, -1.0])
def test_every_reading_belongs_to_its_own_stop_with_the_sense_declared(factor: float) -> None:
    proof, raw, capture = run(reading(), factor=factor)
    wanted = factor * (straight_um(raw.targets) - straight_um(raw.targets)[0])
    assert np.max(np.abs(capture.deviations - wanted[:, None, None])) < 0.05
    assert capture.unit == "um"
    assert any("no jog can prove it" in note for note in map(str, capture.notes))
    assert (proof.optics, proof.unit, len(proof.evidence)) == ("straightness", "um", 3)


def test_a_long_wait_before_the_first_stop_does_not_make_every_stop_as_long() -> None:
    """The operator takes half a minute to mount; a reading then takes its window and a block or two, no more."""

    async def main() -> float:
        clock = LoopClock()
        clock.now()
        rig = rig_of(Little(clock, reading(), ("deviation_um",), "straightness"))
        async with ErrorReadings(rig) as readings:
            await clock.sleep(30.0)
            asked = clock.now()
            await readings.settled(rig.window)
            return clock.now() - asked - rig.window.settle_s - rig.window.average_s

    assert 0.0 <= run_virtual(main) < 1.5


def test_samples_that_arrive_late_are_waited_for() -> None:
    """The instrument stamps when it measured; the last 1.5 s are always still on their way."""

    class Behind(Little):
        async def blocks(self):  # type: ignore[no-untyped-def]
            kept = []
            async for block in super().blocks():
                kept.append(block)
                while kept and kept[0].time_s[-1] < self.clock.now() - 1.5:
                    yield kept.pop(0)

    async def main() -> RawCapture:
        clock = LoopClock()
        clock.now()
        machine = Behind(clock, reading(), ("deviation_um",), "straightness", speed=20.0)
        section = AXIS.model_copy(
            update={"measure": AXIS.measure.model_copy(update={"settle_s": 0.0, "average_s": 0.3})}
        )
        rig = ErrorRig(section, machine, machine, clock, Patience(30.0, 60.0), optics=("straightness",))
        return await capture_error(rig)

    raw = run_virtual(main)
    wanted = straight_um(raw.targets) + 8.0
    assert np.max(np.abs(raw.values[..., 0] - wanted[:, None, None])) < 0.1


def test_a_lost_beam_goes_on_from_the_datum() -> None:
    def break_beam(machine: Little) -> None:
        machine.bad_at = machine.clock.now() + 40.0

    _, raw, capture = run(reading(), break_beam)
    wanted = straight_um(raw.targets) - straight_um(raw.targets)[0]
    assert np.max(np.abs(capture.deviations - wanted[:, None, None])) < 0.1
    assert any("the beam was lost" in note for note in map(str, capture.notes))


def test_a_wrong_mounting_is_caught_before_the_first_target() -> None:
    def follows(position: np.ndarray, _times: np.ndarray) -> np.ndarray:
        return 1000.0 * position + np.random.default_rng(1).normal(0.0, 0.05, position.shape)

    with pytest.raises(UnsupportedDevice) as caught:
        run(follows)
    assert caught.value.code == "E-SETUP-JOG"
    with pytest.raises(UnsupportedDevice) as caught:
        run(reading(), optics=("angular", "unknown"))
    assert caught.value.code == "E-SETUP-OPTICS"
    loose = np.random.default_rng(2)

    def creeps(position: np.ndarray, times: np.ndarray) -> np.ndarray:
        return 1.5 * np.floor(times / 4.0) + loose.normal(0.0, 0.05, position.shape)

    with pytest.raises(UnsupportedDevice) as caught:
        run(creeps)
    assert caught.value.code == "E-SETUP-JOG"


def test_no_light_with_what_is_mounted_is_said_so() -> None:
    class Dark(Little):
        async def blocks(self):  # type: ignore[no-untyped-def]
            async for block in super().blocks():
                block.valid[:] = False
                yield block

    async def main() -> None:
        clock = LoopClock()
        clock.now()
        await prove_mounting(rig_of(Dark(clock, reading(), ("deviation_um",), "straightness")))

    with pytest.raises(UnsupportedDevice) as caught:
        run_virtual(main)
    assert caught.value.code == "E-SETUP-LIGHT"


def test_an_instrument_that_shows_one_number_for_ever_is_no_measurement() -> None:
    with pytest.raises(CaptureError) as caught:
        run(lambda position, _times: np.full(position.shape, 1.25))
    assert caught.value.code == "E-SETUP-DEAD"


def test_optics_touched_on_the_way_are_met() -> None:
    """A reading 5 mm from the datum is no straightness, and what leans otherwise now cannot be put together."""
    shifted = {"at": np.inf}

    def reads(position: np.ndarray, times: np.ndarray) -> np.ndarray:
        return reading()(position, times) + np.where(times > shifted["at"], 5000.0, 0.0)

    def touch(machine: Little) -> None:
        shifted["at"] = machine.clock.now() + 30.0

    with pytest.raises(CaptureError) as caught:
        run(reads, touch)
    assert caught.value.code == "E-SETUP-TOUCHED"


CHANNELS: list[tuple[tuple[str, ...], str, str, tuple[int, float] | None]] = [
    (("deviation_um",), "", "um", (0, 1.0)),
    (("x_arcsec", "y_um"), "", "um", (1, 1.0)),
    (("angle_deg",), "", "arcsec", (0, 3600.0)),
    (("h_um", "v_um"), "v_um", "um", (1, 1.0)),
    (("h_um", "v_um"), "", "um", None),
    (("displacement_mm",), "", "um", None),
    (("device_deg", "laser_deg"), "", "arcsec", None),
    (("deviation_um",), "", "arcsec", None),
    (("deviation_um",), "other_um", "um", None),
    ((), "", "um", None),
]


@pytest.mark.parametrize(("channels", "wanted", "unit", "found"), CHANNELS)
def test_the_channel_must_read_the_unit(
    channels: tuple[str, ...], wanted: str, unit: str, found: tuple[int, float] | None
) -> None:
    machine = LittleMachine(LoopClock(), reading(), channels, "sensor")
    if found is not None:
        assert channel_of(machine, wanted, unit) == found  # type: ignore[arg-type]
        return
    with pytest.raises(ConfigError) as caught:
        channel_of(machine, wanted, unit)  # type: ignore[arg-type]
    assert caught.value.code == "E-SETUP-CHANNEL"


class Shimmed(Little):
    """One whose person puts a shim under the optics where MSG says so; ``way`` -1: they face the wrong way."""

    way = 1.0
    moved = 0.0

    async def prepare_stops(self, plan: StopPlan) -> None:
        words = plan.setup.split()
        self.moved = float(words[3]) if words[1:2] == ["STEP"] else 0.0
        await super().prepare_stops(plan)

    async def blocks(self) -> AsyncIterator[SampleBlock]:
        async for block in super().blocks():
            yield replace(block, values=block.values + self.way * self.moved)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_known_step_proves_the_sense_and_refuses_optics_that_face_the_wrong_way(way: float) -> None:
    async def main() -> tuple[MountingProof, Capture, list[str]]:
        clock = LoopClock()
        clock.now()
        machine = Shimmed(clock, reading(), ("deviation_um",), "straightness")
        machine.way = way
        rig = rig_of(machine, step=50.0)
        proof = await prove_mounting(rig)
        return proof, error_capture(rig, await capture_error(rig), 1, proved=proof.sense), machine.setups

    if way < 0.0:
        with pytest.raises(UnsupportedDevice, match="known step") as caught:
            run_virtual(main)
        assert caught.value.code == "E-SETUP-STEP"
        return
    proof, capture, setups = run_virtual(main)
    assert setups[1:3] == ["TRUEFLANK STEP EYX 50 ON X", "TRUEFLANK STEP EYX 0 ON X"]
    assert proof.sense is not None
    assert (proof.sense.sense, proof.sense.scale) == (1, pytest.approx(1.0, abs=0.01))
    assert capture.sense == proof.sense
    assert any("a known step proved it" in note for note in map(str, capture.notes))
