"""Faults 22-45 of an interferometer and a rotary calibrator as a capture meets them: what is promised, by number."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.clock import Clock, LoopClock, run_virtual
from drivers.errors import BeamObstructed, DeviceRefused, UnsupportedDevice
from drivers.message import Message
from drivers.types.sensing import Ambient, SampleBlock
from drivers.units import wrap_deg
from gateway.capture.checks import UnexpectedValue, explain_value
from gateway.capture.corrections import from_live
from gateway.capture.live import RawCapture, capture_axis
from gateway.capture.readings import Readings, Window
from gateway.capture.rig import Rig, prove_sense
from gateway.capture.targets import positions
from gateway.config import AxisSection
from gateway.domain.equipment import SenseProof
from gateway.errors import AmbientOutOfRange, CaptureError, ModelError, Unstable
from gateway.evaluate.optics import rotary_calibration
from gateway.evaluate.optics.corrections import begin, record_step
from gateway.moves import Patience
from tests.unit.capture.double import LittleMachine
from tests.unit.capture.test_live import AXIS
from tests.unit.capture.test_plans import axis_with, error_mm, run, worst_um

PATIENCE = Patience(30.0, 60.0)
WINDOW = Window(0.2, 0.5, 1e-3, 20.0)
AFTER_S = 60.0  # well within the measuring program of `run`
KNOWN = tuple(float(at) for at in positions(AXIS.measure.targets, AXIS.reference)) if AXIS.measure.targets else ()


def captured(raw: RawCapture, already: Any = "nothing", axis: AxisSection = AXIS) -> Any:
    return from_live(axis, raw, SenseProof("laser", "X1", 1, 1.0, (0.0, 10.0, 0.0)), already)


EVENTS = ((AFTER_S, "low_signal"), (AFTER_S + 1.0, "unstable"))


class Saying(LittleMachine):
    """Gives the events of `events` (instrument time -> words) with the block that holds the time."""

    async def blocks(self) -> AsyncIterator[SampleBlock]:
        async for block in super().blocks():
            words = tuple(f"{word} at {at:.6f} s" for at, word in EVENTS if block.time_s[0] <= at <= block.time_s[-1])
            yield replace(block, events=words)


async def measured(machine: LittleMachine, clock: Clock, axis: AxisSection = AXIS) -> RawCapture:
    rig = Rig(axis, machine, machine, clock, PATIENCE)  # type: ignore[arg-type]
    return await capture_axis(rig, await prove_sense(rig))


@pytest.mark.parametrize("number", [22, 24])
def test_fault_22_and_24_what_the_instrument_says_of_its_signal_stays_with_the_capture(number: int) -> None:
    """Low signal and instability that do not break the beam: said in the record, in the instrument's words."""

    async def main() -> RawCapture:
        clock = LoopClock()
        return await measured(Saying(clock, lambda position, _times: position + error_mm(position)), clock)

    raw = run_virtual(main)
    word = {22: "low_signal", 24: "unstable"}[number]
    assert any(word in note for note in map(str, captured(raw).notes))
    assert worst_um(raw) < 0.05


def test_fault_23_samples_marked_bad_by_overspeed_are_a_lost_beam() -> None:
    with pytest.raises(BeamObstructed, match="E-CAP-BEAM"):
        run(axis_with(beam_recoveries=0), bad_at=AFTER_S)


def with_ambient(*seen: Ambient) -> Callable[[], Any]:
    """A machine whose environment readings are these, the last one from then on."""

    async def main() -> RawCapture:
        clock = LoopClock()
        machine = LittleMachine(clock, lambda position, _times: position + error_mm(position))
        left = list(seen)

        async def ambient() -> Ambient:
            return left.pop(0) if len(left) > 1 else left[0]

        machine.ambient = ambient  # type: ignore[method-assign]
        return await measured(machine, clock)

    return main


GOOD = Ambient(20.0, 1013.25, 50.0, (20.0,))


def test_fault_25_a_sensor_lost_before_the_start_refuses_the_capture() -> None:
    with pytest.raises(AmbientOutOfRange, match=r"E-CAP-STALE .*31 s old"):
        run_virtual(with_ambient(replace(GOOD, age_s=31.0)))
    raw = run_virtual(with_ambient(replace(GOOD, age_s=29.0)))
    assert np.isfinite(captured(raw).deviations).all()


def test_fault_25_a_sensor_that_freezes_in_the_middle_spoils_the_evaluation_not_the_raw_data() -> None:
    raw = run_virtual(with_ambient(GOOD, GOOD, replace(GOOD, age_s=45.0)))
    assert np.isfinite(raw.values).all()
    with pytest.raises(AmbientOutOfRange, match="E-CAP-STALE"):
        captured(raw)
    assert np.isfinite(captured(raw, "air+material").deviations).all()  # the instrument corrected by itself


@pytest.mark.parametrize(
    ("wrong", "sensor"),
    [
        (replace(GOOD, air_degc=-50.0), "air_degc"),
        (replace(GOOD, pressure_hpa=0.0), "pressure_hpa"),
        (replace(GOOD, pressure_hpa=101.325), "pressure_hpa"),
        (replace(GOOD, humidity_pct=140.0), "humidity_pct"),
        (replace(GOOD, humidity_pct=-0.5), "humidity_pct"),
        (replace(GOOD, material_degc=(20.0, -10.0)), "material_degc"),
        (replace(GOOD, material_degc=()), "material_degc"),
        (replace(GOOD, pressure_hpa=None), "pressure_hpa"),
    ],
)
def test_fault_26_an_impossible_environment_is_refused_before_the_first_target(wrong: Ambient, sensor: str) -> None:
    with pytest.raises(AmbientOutOfRange) as caught:
        run_virtual(with_ambient(wrong))
    assert caught.value.fields["sensor"] == sensor


def test_fault_27_the_wavelength_is_compensated_once_by_whoever_says_so() -> None:
    raw = run(AXIS)[0]
    span = float(raw.targets[-1] - raw.targets[0])

    def rise(already: Any) -> float:
        found = captured(raw, already).deviations
        return float(np.mean(found[-1] - found[0]))

    by_us = rise("air") - rise("nothing")  # vacuum lengths are shortened to lengths in air
    assert by_us / span * 1000.0 == pytest.approx(271.3, abs=1.0)  # ppm of Edlen at 20 degC, 1013.25 hPa, 50 %
    assert rise("air+material") == pytest.approx(rise("air"), abs=1e-6)  # material stands at 20 degC
    with pytest.raises(ModelError, match="E-EVAL-TWICE"):
        record_step(begin("air"), "air", Message.stored("once more"))


def test_fault_28_a_clock_that_starts_anew_is_no_time_before_time_and_costs_a_new_datum() -> None:
    """The instrument resets in the middle: its clock and its count start at zero."""

    class Resetting(LittleMachine):
        async def blocks(self) -> AsyncIterator[SampleBlock]:
            zero = None
            async for block in super().blocks():
                if block.time_s[0] < AFTER_S:
                    yield block
                    continue
                zero = block if zero is None else zero
                yield replace(block, time_s=block.time_s - zero.time_s[0], values=block.values - zero.values[0])

    said: list[str] = []

    async def main() -> RawCapture:
        clock = LoopClock()
        machine = Resetting(clock, lambda position, _times: position + error_mm(position))
        rig = Rig(AXIS, machine, machine, clock, PATIENCE, lambda code, **_f: said.append(code))  # type: ignore[arg-type]
        return await capture_axis(rig, await prove_sense(rig))

    raw = run_virtual(main)
    assert worst_um(raw) < 0.08
    assert said.count("P-CAP-BEAM") == 1
    visited = np.sort(raw.time_s, axis=None)
    assert np.all(np.diff(visited) > 0.0)
    assert visited[-1] > AFTER_S + 5.0  # time went on where the instrument's own started at zero


def test_fault_28_without_recovery_it_is_named() -> None:
    async def main() -> None:
        clock = LoopClock()
        machine = LittleMachine(clock, lambda position, _times: position)
        async with Readings(machine, clock, lambda values: values[:, 0]) as readings:  # type: ignore[arg-type]
            await readings.settled(WINDOW)
            block = readings._blocks[-1]
            readings._take(replace(block, time_s=block.time_s - 5.0))
            await readings.settled(WINDOW)

    with pytest.raises(BeamObstructed, match="E-CAP-RESTART"):
        run_virtual(main)


def test_fault_29_a_frozen_reading_stops_the_run_after_two_targets() -> None:
    class Frozen(LittleMachine):
        kept: np.ndarray | None = None

        def at(self, times: np.ndarray) -> np.ndarray:
            return np.interp(np.minimum(times, AFTER_S), self.knots_s, self.knots)

    async def main() -> None:
        clock = LoopClock()
        frozen = Frozen(clock, lambda position, _times: position)
        moving = LittleMachine(clock, lambda position, _times: position)
        frozen.knots_s, frozen.knots = moving.knots_s, moving.knots
        rig = Rig(axis_with(beam_recoveries=0), moving, frozen, clock, PATIENCE)  # type: ignore[arg-type]
        await capture_axis(rig, await prove_sense(rig))

    with pytest.raises(BeamObstructed, match="E-CAP-FROZEN") as caught:
        run_virtual(main)
    assert caught.value.fields["count"] == 2


@pytest.mark.parametrize(
    ("factor", "named"),
    [(1 / 25.4, "mm -> inch"), (25.4, "inch -> mm"), (1000.0, "mm -> um"), (1e-3, "um -> mm")],
)
@pytest.mark.parametrize("zero", [0.0, 41.5])
def test_fault_30_a_unit_switched_in_the_middle_ends_the_capture(factor: float, named: str, zero: float) -> None:
    def switched(value: np.ndarray, times: np.ndarray) -> np.ndarray:
        return np.where(times > AFTER_S, factor * (value + zero), value + zero)

    with pytest.raises(CaptureError, match="E-CAP-UNIT") as caught:
        run(AXIS, switched)
    assert caught.value.fields["change"] == named


@pytest.mark.parametrize("whole", [True, False])
def test_fault_31_a_sign_switched_in_the_middle_ends_the_capture(whole: bool) -> None:
    """The sign of the value, or of the counting from where it stood."""

    def turned(value: np.ndarray, times: np.ndarray) -> np.ndarray:
        zero = 0.0 if whole else error_mm(np.array([-97.0]))[0] - 97.0
        return np.where(times > 30.0, 2.0 * zero - value, value)

    with pytest.raises(CaptureError, match=r"E-CAP-(SIGN|DATUM)"):
        run(AXIS, turned)


def test_fault_31_the_wrong_way_is_called_so() -> None:
    doubt = UnexpectedValue(
        read=-40.0, wanted=40.0, datum=0.0, tolerance=1.0, rotary=False, targets={0.0: 0.0, 40.0: 40.0}
    )
    found = explain_value(doubt, "X1", 40.0)
    assert found is not None
    assert found.code == "E-CAP-SIGN"
    assert "direction is reversed" in str(found)


@given(st.floats(-500, 500), st.floats(-500, 500))
def test_a_reading_that_nothing_explains_is_not_explained(read: float, wanted: float) -> None:
    """Whatever is named holds: the ratio, the mirror or the other target is really there."""
    targets = {float(at): float(at) for at in range(-500, 501, 100)}
    found = explain_value(UnexpectedValue(read, wanted, 0.0, 2.0, False, targets), "X1", wanted)
    if found is None:
        return
    if found.code == "E-CAP-SIGN":
        assert read == pytest.approx(-wanted, rel=0.03, abs=2.0)
    elif found.code == "E-CAP-UNIT":
        ratio = read / wanted
        assert min(abs(ratio / factor - 1.0) for factor in (25.4, 1 / 25.4, 1000.0, 1e-3)) < 0.03
    else:
        assert abs(read - float(str(found.fields["other"]))) <= 2.0


def test_fault_33_a_count_set_anew_between_proof_and_capture_is_refused_at_the_first_target() -> None:
    """Somebody zeroes the instrument or touches the optics after the proof: datum and dead path are not as said."""

    async def main() -> None:
        clock = LoopClock()
        offset = [0.0]
        machine = LittleMachine(clock, lambda position, _times: position + error_mm(position) + offset[0])
        rig = Rig(AXIS, machine, machine, clock, PATIENCE)  # type: ignore[arg-type]
        proof = await prove_sense(rig)
        offset[0] = 7.5
        await capture_axis(rig, proof)

    with pytest.raises(CaptureError, match="E-CAP-DATUM"):
        run_virtual(main)


def test_fault_34_a_beam_at_an_angle_is_said_and_never_corrected() -> None:
    angle = 0.02  # rad: 200 um/m short

    def aslant(value: np.ndarray, _times: np.ndarray) -> np.ndarray:
        return value * np.cos(angle)

    raw, straight = run(AXIS, aslant)[0], run(AXIS)[0]
    crooked, good = captured(raw, "air+material"), captured(straight, "air+material")
    assert any("alignment" in note for note in map(str, crooked.notes))
    assert not any("alignment" in note for note in map(str, good.notes))
    span = float(raw.targets[-1] - raw.targets[0])
    short = float(np.mean((crooked.deviations - good.deviations)[-1]))
    assert short == pytest.approx(-1000.0 * span * angle**2 / 2.0, rel=0.02)  # still in the numbers


def test_fault_35_a_target_that_does_not_settle_waits_and_then_says_what_is_missing() -> None:
    def shaken(value: np.ndarray, times: np.ndarray) -> np.ndarray:
        return value + np.where(times > AFTER_S, 0.01 * np.sin(40.0 * times), 0.0)

    with pytest.raises(Unstable, match="sigma"):
        run(axis_with(retakes=0), shaken)


def test_fault_36_a_missed_target_is_refused_with_its_index() -> None:
    with pytest.raises(DeviceRefused, match="stop 3"):
        run(AXIS, skip_stop=3)


def test_fault_36_an_axis_that_stands_at_another_target_is_seen_by_the_instrument() -> None:
    """The program says stop k, but the axis has gone on by one: outside a tenth of a step nothing is taken."""

    class Ahead(LittleMachine):
        async def move(self, target: float) -> None:
            if target in KNOWN and self.clock.now() > AFTER_S:
                target = KNOWN[min(KNOWN.index(target) + 1, len(KNOWN) - 1)]
            await super().move(target)

    async def main() -> None:
        clock = LoopClock()
        machine = Ahead(clock, lambda position, _times: position + error_mm(position))
        rig = Rig(axis_with(beam_recoveries=0), machine, machine, clock, PATIENCE)  # type: ignore[arg-type]
        await capture_axis(rig, await prove_sense(rig))

    with pytest.raises(BeamObstructed, match="E-CAP-TARGET"):
        run_virtual(main)


def test_fault_38_a_laser_that_looks_at_another_axis_is_refused_by_the_sense_proof() -> None:
    """Two lasers swapped: the named instrument does not see this axis' jog. Its serial is bound by the site file."""

    async def main() -> None:
        clock = LoopClock()
        x, z = (LittleMachine(clock, lambda position, _times: position + 3.0) for _ in range(2))
        rig = Rig(AXIS, x, z, clock, PATIENCE)  # type: ignore[arg-type]
        await prove_sense(rig)

    with pytest.raises(UnsupportedDevice, match="E-CAP-SENSE"):
        run_virtual(main)


@given(st.integers(-10, 10), st.integers(-10, 10), st.floats(-170.0, 170.0))
def test_fault_42_whole_turns_of_laser_or_device_are_no_deviation(laser: int, device: int, at: float) -> None:
    targets = np.array([0.0, at])
    deviation = 2.0 / 3600.0
    readings = np.broadcast_to((targets + deviation * (targets != 0.0))[:, None, None], (2, 1, 2)).copy()
    lasers = readings + 360.0 * laser
    lasers[0] -= 360.0 * laser
    devices = np.zeros_like(readings)
    devices[1] += 360.0 * device
    found = rotary_calibration.rotary_deviations(devices, lasers, targets, reference_deg=0.0, sense=1)
    wanted = 2.0 if at else 0.0
    assert wrap_deg(found[1, 0, 0] / 3600.0) * 3600.0 == pytest.approx(wanted, abs=1e-6)


@dataclass
class LittleTable(LittleMachine):
    """A rotary axis with a calibrator on it: sense of its laser, what it calls a degree, how far it lags."""

    sense: float = 1.0
    unit: float = 1.0
    lag_s: float = 0.0
    # (from time, device angle then, follows the axis?)
    parts: list[tuple[float, float, bool]] = field(default_factory=lambda: [(0.0, 0.0, True)])

    def device(self, times: np.ndarray) -> np.ndarray:
        """The device counts against the axis while it follows it, and stands still while it is held."""
        found = np.zeros(len(times))
        for since, angle, follows in self.parts:
            inside = times >= since
            start = float(self.at(np.array([since]))[0])
            moved = -(self.at(times[inside]) - start) if follows else 0.0
            found[inside] = angle + moved
        return found

    def _now(self, *, follows: bool, by: float = 0.0) -> None:
        now = self.clock.now()
        self.parts.append((now, float(self.device(np.array([now]))[0]) + by, follows))

    async def hold(self) -> None:
        self._now(follows=False)

    async def track(self) -> None:
        self._now(follows=True)

    async def turn(self, by_deg: float) -> None:
        self._now(follows=False, by=by_deg)


def table(**changes: Any) -> Callable[[], Any]:
    axis = AxisSection.model_validate(
        {
            "name": "C1",
            "letter": "C",
            "kind": "rotary",
            "travel": [0.0, 360.0],
            "modulo": True,
            "measure": {
                "instrument": "calibrator",
                "component": "ECC",
                "targets": {"positions": [0.0, 45.0, 90.0, 135.0]},
                "repetitions": 1,
                "feed": 3600.0,
                "stable": 0.5,
            },
            "table": {"minimum": 0.0, "maximum": 360.0, "step": 45.0},
        }
    )

    async def main() -> tuple[SenseProof, np.ndarray]:
        clock = LoopClock()
        made: list[LittleTable] = []

        def reads(_position: np.ndarray, times: np.ndarray) -> np.ndarray:
            machine = made[0]
            late = times - machine.lag_s
            true = machine.at(late) + 2.0 / 3600.0 * np.sin(np.deg2rad(machine.at(late)))
            laser = machine.sense * (true + machine.device(late)) * machine.unit
            return np.column_stack([machine.device(times), laser])

        machine = LittleTable(clock, reads, ("device_deg", "laser_deg"), name="calibrator", **changes)
        made.append(machine)
        rig = Rig(axis, machine, machine, clock, PATIENCE)  # type: ignore[arg-type]
        proof = await prove_sense(rig)
        raw = await capture_axis(rig, proof)
        return proof, from_live(axis, raw, proof, "air+material").deviations

    return main


WANTED_ARCSEC = 2.0 * np.sin(np.deg2rad([0.0, 45.0, 90.0, 135.0]))


@pytest.mark.parametrize("named", [60.0, 3600.0, 0.017453292519943295])
def test_fault_43_another_unit_of_angle_is_refused_by_the_sense_proof(named: float) -> None:
    with pytest.raises((UnsupportedDevice, Unstable), match=r"E-CAP-(SENSE|UNSTABLE)"):
        run_virtual(table(unit=named))


@pytest.mark.parametrize("lag_s", [0.0, 0.7, 1.5])
def test_fault_44_a_laser_behind_its_device_gives_the_right_target_or_none(lag_s: float) -> None:
    """Both channels of a sample carry one time; where one really lags, no window within the lag is taken."""
    _proof, found = run_virtual(table(lag_s=lag_s))
    np.testing.assert_allclose(found[:, 0, :] - found[0, 0, 0], np.column_stack([WANTED_ARCSEC] * 2), atol=0.05)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_fault_45_a_laser_that_counts_against_the_device_is_proved_and_used_so(sense: float) -> None:
    proof, found = run_virtual(table(sense=sense))
    assert proof.sense == sense
    np.testing.assert_allclose(found[:, 0, :] - found[0, 0, 0], np.column_stack([WANTED_ARCSEC] * 2), atol=0.05)
