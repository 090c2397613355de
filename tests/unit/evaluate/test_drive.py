"""A reducer's figures from its bench's record: waves and loops with known answers, an own reckoning, and refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.types.drives import DriveRecord
from gateway.errors import ModelError
from gateway.evaluate.behaviour.drive import TestedDrive as Drive
from gateway.evaluate.behaviour.drive import causes, evaluate_drive, expanded_uncertainty
from gateway.evaluate.behaviour.order_causes import CODES, CauseKind, OrderCause, in_words

ARCSEC = 1.0 / 3600.0
RV = Drive(pins=40, ratio=121.0, rated_torque_nm=400.0, cranks=3, sun_teeth=16, output_encoder_U_arcsec=1.0)
SMALL = Drive(pins=12, ratio=-11.0, rated_torque_nm=60.0)


def waves(angle_deg: np.ndarray, *parts: tuple[int, float, float]) -> np.ndarray:
    """Sum of amplitude x cos(order x angle - phase), arcsec; phases in deg."""
    return sum(size * np.cos(np.deg2rad(n * angle_deg - phase)) for n, size, phase in parts)


def running(
    drive: Drive, *parts: tuple[int, float, float], steps: float = 24.0, turned: float = 365.0, sense: int = 1
) -> DriveRecord:
    """A pass whose error over the output's angle is known."""
    step = 360.0 / (steps * (drive.pins - 1))
    angle = 7.0 + sense * np.arange(0.0, turned, step)
    return recorded(angle * drive.ratio, angle + waves(angle, *parts) * ARCSEC, np.full(len(angle), 5.0))


def recorded(inputs: np.ndarray, output: np.ndarray, torque: np.ndarray | None) -> DriveRecord:
    count = len(inputs)
    return DriveRecord(
        inputs, output, np.arange(10.0, 10.0 + count), np.arange(float(count)), torque, np.full(count, 22.0)
    )


def twist(torque: np.ndarray, way: np.ndarray, stiffness: float, play: float, width: float) -> np.ndarray:
    """A loop of known shape, arcsec: play between the signs of torque, a slope (Nm per arcmin), a width on the way."""
    return 60.0 * torque / stiffness + 0.5 * play * np.tanh(torque / 0.5) - 0.5 * width * way


def loop(
    drive: Drive, *, stiffness: float = 50.0, play: float = 30.0, width: float = 8.0, step: float = 2.0
) -> DriveRecord:
    up = np.arange(-400.0, 400.0 + step / 2, step)
    torque = np.concatenate((up[len(up) // 2 :], up[-2::-1], up[1:]))
    way = np.concatenate(([1.0], np.sign(np.diff(torque))))
    seen = twist(torque, way, stiffness, play, width)
    return recorded(np.full(len(torque), 33.0), 5.0 + seen * ARCSEC, torque)


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("drive", [RV, SMALL], ids=["rv", "crank"])
def test_waves_come_back_with_size_phase_and_cause(drive: Drive, sense: int) -> None:
    zp = drive.pins
    parts = ((zp, 8.0, 30.0), (zp - 1, 3.0, -100.0), (1, 2.0, 170.0))
    steps = 24.0 if drive is RV else 96.0
    (run,) = evaluate_drive(running(drive, *parts, steps=steps, sense=sense), drive, "x").running
    assert run.sense == sense
    found = {one.order: one for one in run.orders}
    for order, size, phase in parts:
        assert found[order].amplitude_arcsec == pytest.approx(size, abs=1e-6)
        assert found[order].phase_deg == pytest.approx(phase, abs=1e-4)
        assert run.amplitude(order) == pytest.approx(size, abs=1e-6)
    assert found[zp].causes[0] == OrderCause(CauseKind.DISC_OR_CRANKS, (1, 0))
    assert found[zp - 1].causes[0] == OrderCause(CauseKind.RING, (0, 1))
    assert run.rms == pytest.approx(np.sqrt((64.0 + 9.0 + 4.0) / 2.0), rel=1e-9)
    dense = waves(np.linspace(0.0, 360.0, 200_001), *parts)
    assert run.peak_to_peak == pytest.approx(np.ptp(dense), rel=0.01)


def test_readings_between_whole_steps_are_put_on_them() -> None:
    (run,) = evaluate_drive(running(RV, (40, 5.0, 0.0), steps=31.37), RV, "x").running
    assert run.orders[0].order == 40
    assert run.orders[0].amplitude_arcsec == pytest.approx(5.0, rel=1e-3)


def test_turns_are_averaged_and_repeat() -> None:
    one = evaluate_drive(running(RV, (40, 5.0, 0.0), turned=730.0), RV, "x").running[0]
    assert len(one.each) == 2
    assert one.each[0] == pytest.approx(one.each[1], abs=1e-6)
    assert expanded_uncertainty(np.sqrt(2.0), 1.0, one.each) == pytest.approx(np.sqrt(2.0), abs=1e-4)
    # Student, two repeats that differ by 2: 13.97 x sqrt(2) / sqrt(2)
    assert expanded_uncertainty(0.0, 1.0, (4.0, 6.0)) == pytest.approx(13.97, abs=0.01)
    assert expanded_uncertainty(1.0, None, (4.0, 6.0)) is None


def test_the_loop_gives_lost_motion_backlash_and_stiffness_as_its_shape_has_them() -> None:
    found = evaluate_drive(loop(RV), RV, "x").loop
    assert found is not None
    small = 12.0
    assert found.lost_motion == pytest.approx(2.0 * 60.0 * small / 50.0 + 30.0, rel=1e-6)
    assert found.backlash == pytest.approx(8.0, abs=1e-6)
    assert found.stiffness == pytest.approx(50.0, rel=1e-6)
    other = evaluate_drive(loop(RV, play=0.0, width=0.0, stiffness=100.0), RV, "x").loop
    assert other is not None
    assert other.backlash == pytest.approx(0.0, abs=1e-9)
    assert other.lost_motion == pytest.approx(2.0 * 60.0 * small / 100.0)


def test_what_the_input_yields_is_taken_off() -> None:
    still = loop(RV)
    moved = np.sin(np.arange(len(still.input_deg))) * 1e-3
    given = replace(still, input_deg=still.input_deg + moved * RV.ratio, output_deg=still.output_deg + moved)
    one, other = (evaluate_drive(each, RV, "x").loop for each in (still, given))
    assert one is not None
    assert other is not None
    assert other.lost_motion == pytest.approx(one.lost_motion, abs=1e-6)


def test_one_record_may_hold_both_ways_and_a_loop() -> None:
    parts = [running(RV, (40, 6.0, 0.0)), running(RV, (39, 4.0, 0.0), sense=-1), loop(RV)]
    joined = {
        name: np.concatenate([getattr(one, name) for one in parts])
        for name in ("input_deg", "output_deg", "torque_nm", "temperature_degc")
    }
    count = len(joined["input_deg"])
    record = DriveRecord(lines=np.arange(float(count)), time_s=np.arange(float(count)), **joined)
    found = evaluate_drive(record, RV, "x")
    assert [run.sense for run in found.running] == [1, -1]
    assert [run.orders[0].order for run in found.running] == [40, 39]
    assert found.loop is not None
    assert found.running[0].torque_nm == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("order", "words"),
    [(40, "disc, 1"), (80, "disc, 2"), (39, "ring, 1"), (78, "ring, 2"), (1, "output"), (3, "number of cranks"),
     (120, "disc, 3"), (121, "input"), (1920, "teeth of the sun"), (1560, "profile"), (41, "together (2 zp -1 zc)")],
)  # fmt: skip
def test_orders_are_named_by_their_cause(order: int, words: str) -> None:
    assert words in in_words(causes(order, RV, 5000))


@pytest.mark.parametrize("language", ["en", "de", "zh"])
def test_every_kind_of_cause_has_words_in_every_language(language: str) -> None:
    assert set(CODES) == set(CauseKind)
    told = {in_words([OrderCause(kind, (2, -1))], language) for kind in CauseKind}
    told |= {in_words([OrderCause(CauseKind.PROFILE, folded=True)], language)}
    assert len(told) == len(CauseKind) + 1
    assert all("{" not in one and "S-ORDER" not in one for one in told)
    assert language == "en" or not told & {in_words([OrderCause(kind, (2, -1))]) for kind in CauseKind}


def test_an_order_beyond_the_readings_is_named_where_it_folds_to() -> None:
    """1560 periods among 936 readings look like 312."""
    assert "folded: profile" in in_words(causes(312, RV, 936))
    assert causes(307, RV, 5000) == ()


def refused(code: str, record: DriveRecord, drive: Drive = RV) -> None:
    with pytest.raises(ModelError) as caught:
        evaluate_drive(record, drive, "record.csv")
    assert caught.value.code == code


def test_records_that_show_too_little_are_refused() -> None:
    whole = running(RV, (40, 5.0, 0.0))
    refused("E-DRIVE-TURN", running(RV, (40, 5.0, 0.0), turned=350.0))
    refused("E-DRIVE-ALIAS", running(RV, (40, 5.0, 0.0), steps=12.0))
    refused("E-DRIVE-RATIO", whole, replace(RV, ratio=120.0))
    refused("E-DRIVE-RATIO", whole, replace(RV, ratio=-121.0))
    jumped = whole.output_deg.copy()
    jumped[100] += 40.0
    refused("E-DRIVE-JUMP", replace(whole, output_deg=jumped))
    refused("E-DRIVE-TORQUE", replace(loop(RV), torque_nm=None))
    refused("E-DRIVE-RATED", loop(RV), replace(RV, rated_torque_nm=None))
    refused("E-DRIVE-RAMP", replace(loop(RV), torque_nm=np.abs(loop(RV).torque_nm)))
    refused("E-DRIVE-COARSE", loop(RV, step=40.0))
    refused("E-DRIVE-VALUE", whole, replace(RV, pins=2))
    few = recorded(np.repeat([0.0, 9000.0], 4), np.repeat([0.0, 9000.0 / 121.0], 4), None)
    refused("E-DRIVE-EMPTY", few)


def test_what_is_doubtful_is_noted() -> None:
    found = evaluate_drive(running(SMALL, (12, 4.0, 0.0), steps=30.0), SMALL, "x")
    assert {code for code, _ in found.notes} == {"W-DRIVE-FEW-STEPS", "W-DRIVE-ENCODER"}
    slipping = running(RV, (40, 4.0, 0.0))
    slip = slipping.output_deg * (1.0 + 20.0 / 1296000.0)
    warm = np.linspace(20.0, 30.0, len(slip))
    found = evaluate_drive(replace(slipping, output_deg=slip, temperature_degc=warm), RV, "x")
    assert {code for code, _ in found.notes} == {"W-DRIVE-CLOSES", "W-DRIVE-WARMS"}


def test_a_loop_short_of_the_rated_torque_has_no_stiffness() -> None:
    part = loop(RV)
    found = evaluate_drive(replace(part, torque_nm=part.torque_nm * 0.5), RV, "x").loop
    assert found is not None
    assert found.stiffness is None
