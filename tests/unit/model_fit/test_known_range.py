"""A curve is used where it is known, and nowhere else: whatever the axis, the range and the way it came in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import trueflank as tf
from gateway.correct.flank.compensability import cures
from gateway.domain.figures import Component
from gateway.errors import ModelError
from gateway.evaluate.geometry.axis_location import from_ball
from gateway.evaluate.geometry.error_model import error_model
from gateway.evaluate.geometry.measurement import Lever, Measurement, said_beyond
from gateway.gear.cycloid import CycloidGear
from gateway.gear.first_order import ErrorParameter
from gateway.gear.flank import flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.components import first_harmonic, mean_of, near_value, value, without_mean
from gateway.model.error_model import yk7350b
from gateway.model.fit import fit_positioning
from gateway.model.motion import motion_of
from gateway.table.merging import curve_for_grid

GEAR = tf.Gear.of(rp=63.5, rrp=2.0, a=1.5, zp=40, zc=39, centre_distance=160.0)


def wave(deg: np.ndarray) -> np.ndarray:
    q = np.deg2rad(deg)
    return 4.2 * np.cos(q) + 2.1 * np.sin(2 * q) + 0.8 * np.cos(3 * q)


def turned(at: np.ndarray, values: np.ndarray, *, modulo: bool = True) -> Component:
    return fit_positioning(
        at, values, 0.01, name="ECC", axis="C", axis_unit="deg", kind="rotary", modulo=modulo
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(12))
def test_a_length_outside_its_range_is_refused_with_name_range_and_position(seed: int) -> None:
    rng = np.random.default_rng(seed)
    low, span = float(rng.uniform(-900, 500)), float(rng.uniform(20, 800))
    at = np.sort(rng.uniform(low, low + span, 12))
    measured = tf.Measured(at, rng.normal(0, 3, 12)[:, None, None] * np.ones((1, 2, 2)), "mm", name="EXX")
    motion = tf.fit(measured)
    inside = rng.uniform(at[0], at[-1], 9)
    assert np.all(np.isfinite(motion(inside)))
    line = motion_of({"type": "pl", "q": at, "v": rng.normal(size=12)}, name="EXX")
    far = float(rng.choice([at[0] - rng.uniform(0.01, 500), at[-1] + rng.uniform(0.01, 500)]))
    for one in (motion, motion.u, line, lambda q: value(motion.component, q)):
        with pytest.raises(ModelError) as told:
            one(np.array([inside[0], far]))  # type: ignore[operator]
        assert told.value.code == "E-MODEL-RANGE"
        assert told.value.fields["name"] == "EXX"
        assert float(told.value.fields["position"]) == pytest.approx(far, rel=1e-5)
        assert float(told.value.fields["low"]) == pytest.approx(at[0], rel=1e-5)
        assert float(told.value.fields["high"]) == pytest.approx(at[-1], rel=1e-5)


@pytest.mark.parametrize("seed", range(20))
def test_a_whole_turn_repeats_wherever_it_is_counted_from(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, step = float(rng.integers(-5, 5) * 90), float(rng.choice([5.0, 10.0, 15.0, 20.0]))
    at = start + np.arange(0.0, 360.0 + (step if rng.integers(2) else 0.0), step)[: int(360 / step) + 1]
    places = rng.uniform(-2000.0, 2000.0, 30)
    for modulo in (True, False):
        np.testing.assert_allclose(value(turned(at, wave(at), modulo=modulo), places), wave(places), atol=0.02)
    line = motion_of({"type": "pl", "q": np.deg2rad(at), "v": wave(at)}, name="ECC", turning=True)
    assert callable(line)
    truth = np.interp(
        np.mod(places - start, 360.0), np.arange(0.0, 361.0, step), wave(start + np.arange(0.0, 361.0, step))
    )
    np.testing.assert_allclose(line(np.deg2rad(places)), truth, atol=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_a_part_of_a_turn_is_reduced_into_its_range_or_refused(seed: int) -> None:
    rng = np.random.default_rng(seed)
    low, span = float(rng.uniform(-400.0, 400.0)), float(rng.uniform(30.0, 170.0))
    at = np.linspace(low, low + span, 15)
    curve = turned(at, wave(at), modulo=False)
    inside = rng.uniform(low, low + span, 20)
    whole = 360.0 * rng.integers(-4, 5, 20)
    np.testing.assert_allclose(value(curve, inside + whole), value(curve, inside), atol=1e-9)
    outside = low + span + float(rng.uniform(0.1, 360.0 - span - 0.1)) + 360.0 * int(rng.integers(-3, 4))
    with pytest.raises(ModelError, match="E-MODEL-RANGE"):
        value(curve, outside)


def test_a_part_of_a_turn_across_zero_is_not_joined_the_long_way_round() -> None:
    at = np.array([340.0, 345.0, 350.0, 355.0, 0.0, 5.0, 10.0, 15.0, 20.0])
    curve = turned(at, wave(at))
    assert curve.domain == (340.0, 380.0)
    np.testing.assert_allclose(
        value(curve, np.array([342.5, -2.5, 2.5, 378.0])), wave(np.array([342.5, -2.5, 2.5, 18.0])), atol=0.05
    )
    with pytest.raises(ModelError, match=r"340 to 380 deg.* 180 deg"):
        value(curve, 180.0)


def csv_of(path: Path, at: np.ndarray, values: np.ndarray) -> Path:
    rows = (f"{a:g},{way},{n},{v:.4f}" for n in (1, 2) for way in "+-" for a, v in zip(at, values, strict=True))
    path.write_text("\n".join(("target_deg,direction,repetition,deviation_arcsec", *rows, "")))
    return path


@pytest.mark.parametrize("ends", [np.arange(0.0, 361.0, 15.0), np.arange(0.0, 360.0, 15.0)])
def test_a_measured_c_axis_reaches_the_tooth_as_its_series_does(tmp_path: Path, ends: np.ndarray) -> None:
    measured = tf.read(csv_of(tmp_path / "C.csv", ends, wave(ends)), name="ECC")
    series = tf.flank(tf.Machine({"ECC": {"type": "fourier", "a": [4.2, 0.0, 0.8], "b": [0.0, 2.1]}}), GEAR)
    assert series.rms > 0.5
    fitted = tf.fit(measured, "ECC")
    for errors in (fitted, (ends, wave(ends)), {"type": "pl", "q": ends.tolist(), "v": wave(ends).tolist()}):
        assert tf.flank(tf.Machine({"ECC": errors}), GEAR).rms == pytest.approx(series.rms, rel=0.03)
    line = motion_of({"type": "pl", "q": np.deg2rad(ends), "v": wave(ends) * 5e-6}, name="ECC", turning=True)
    assert callable(line)
    grinding = Grinding(yk7350b({"ECC": line}), CycloidGear(63.5, 2.0, 1.5, 40, 39), 160.0)
    grid = flank_grid(grinding.gear, profile=5, width=2)
    assert cures(grinding, grid, [ErrorParameter("ECC", line)])[0].by == "C(C)"


def test_the_wheel_outside_the_measured_travel_is_refused_by_every_function() -> None:
    at = np.linspace(0.0, 200.0, 11)
    motion = tf.fit(tf.Measured(at, at[:, None, None] / 40.0 * np.ones((1, 2, 2)), "mm", name="EXX"))
    for errors in (motion, (at, at / 40.0), {"type": "poly", "c": [0.0, 0.01], "range": [0.0, 200.0]}):
        machine = tf.Machine({"EXX": errors})
        for work in (tf.flank, tf.correct, tf.study, tf.rank):
            with pytest.raises(tf.TrueflankError, match=r"EXX is known from 0 to 200 mm"):
                work(machine, GEAR)


def test_means_and_waves_are_those_of_the_axis_own_travel() -> None:
    at = np.linspace(-110.0, 110.0, 23)
    values = 3.0 * (at / 110.0) ** 3 - 1.5 * (at / 110.0) + 0.7
    curve = fit_positioning(at, values, 0.05, name="EAB", axis="B", axis_unit="deg", kind="rotary")
    dense = np.linspace(-110.0, 110.0, 2001)
    mean, u = mean_of(curve)
    assert mean == pytest.approx(float(np.mean(np.interp(dense, at, values))), abs=0.02)
    assert u < 0.1
    assert np.max(np.abs(value(without_mean(curve), at) - (values - 0.7))) < 0.1
    turn = turned(np.arange(0.0, 360.0, 15.0), wave(np.arange(0.0, 360.0, 15.0)))
    assert (first_harmonic(turn).a, first_harmonic(turn).b) == (
        pytest.approx(4.2, abs=0.01),
        pytest.approx(0.0, abs=0.01),
    )
    x = np.deg2rad(at)
    part = fit_positioning(
        at, 20.0 * np.cos(x) - 8.0 * np.sin(x) + 3.0, 0.01, name="EXC", axis="C", axis_unit="deg", kind="rotary"
    )
    assert (first_harmonic(part).a, first_harmonic(part).b) == (
        pytest.approx(20.0, abs=0.3),
        pytest.approx(-8.0, abs=0.3),
    )


def measurement(name: str, at: np.ndarray, values: np.ndarray, reference: float = 0.0) -> Measurement:
    deviations = values[:, None, None] * np.ones((1, 2, 2))
    return Measurement(name, name[2], "deg", at, deviations, reference=reference)


def test_a_swivel_axis_within_4_arcsec_is_reported_within_4_arcsec() -> None:
    at = np.linspace(-110.0, 110.0, 23)
    values = 2.0 * (at / 110.0) ** 3 - 1.0 * (at / 110.0) + 1.0
    for name in ("EBB", "EAB"):
        model = error_model([measurement(name, at, values)], {})
        curve = model.motions[0]
        assert np.max(np.abs(value(curve, at))) <= 4.0
        assert np.max(np.sqrt(np.diag(curve.covariance))) < 1.0
    assert value(error_model([measurement("EBB", at, values)], {}).motions[0], 0.0) == pytest.approx(0.0, abs=1e-9)
    beyond = error_model([measurement("EBB", at, values, reference=-130.0)], {})
    assert value(beyond.motions[0], -110.0) == pytest.approx(0.0, abs=1e-9)
    assert any("-130" in str(line) and "-110" in str(line) for line in beyond.said)


def test_a_ball_read_over_a_part_of_the_turn_gives_no_centre() -> None:
    at = np.linspace(-110.0, 110.0, 23)
    ring = fit_positioning(
        at, 50.0 * np.cos(np.deg2rad(at)), 0.1, name="EX0C", axis="C", axis_unit="deg", kind="rotary"
    )
    with pytest.raises(ModelError, match=r"-110 to 110 deg"):
        from_ball("C", [(0.0, {"X": ring})])


def test_an_angle_that_begins_a_little_later_than_the_length_is_an_estimate_with_a_doubt() -> None:
    at = np.linspace(-399.8, 0.0, 21)
    curve = fit_positioning(at, 0.01 * at, 0.01, name="EBX", axis="X", axis_unit="mm", kind="linear")
    values, u = near_value(curve, np.array([-405.8, -200.0]))
    np.testing.assert_allclose(values, [-3.998, -2.0], atol=0.02)
    assert u[0] >= abs(values[0] - -4.058)  # the true line lies within the stated doubt
    assert u[0] == pytest.approx(0.06, rel=0.1)  # 0.01 arcsec/mm over 6 mm
    assert u[1] < 0.01
    with pytest.raises(ModelError, match=r"EBX is known from -399.8 to 0 mm.* 21 mm"):
        near_value(curve, np.array([-100.0, 21.0]))
    assert said_beyond(curve, np.array([-399.8, -200.0, 0.0])) == ()
    (said,) = said_beyond(curve, np.array([-405.8, 3.0]))
    assert "EBX is known from -399.8 to 0 mm; at -405.8 mm" in str(said)
    lever = Lever({"EBX": 0.5}, {"EBX": curve}, {})
    assert lever.estimated(np.array([-405.8])) == (said,)
    assert lever.estimated(at) == ()


def test_a_table_holds_the_last_value_beyond_what_was_measured() -> None:
    at = np.linspace(100.0, 300.0, 11)
    curve = fit_positioning(at, 0.02 * (at - 100.0), 0.01, name="EXX", axis="X", axis_unit="mm", kind="linear")
    np.testing.assert_allclose(
        curve_for_grid(curve, np.array([50.0, 100.0, 300.0, 380.0])), [0.0, 0.0, 4.0, 4.0], atol=0.02
    )


def test_a_target_read_one_way_only_makes_no_kink() -> None:
    at = np.linspace(0.0, 400.0, 9)
    mean, reversal = 0.01 * at, 6.0
    x = np.stack([mean + reversal / 2, mean - reversal / 2], axis=-1)[:, None, :] * np.ones((1, 3, 1))
    x[4, :, 1] = np.nan
    motion = tf.fit(tf.Measured(at, x, "mm", name="EXX"))
    np.testing.assert_allclose(motion(at), mean, atol=0.02)


@pytest.mark.parametrize("standard", ["2014", "1988", "VDI/DGQ 3441", "ASME B5.54", "NMTBA", "JIS B 6330"])
def test_one_target_gets_a_true_sentence_in_every_standard(standard: str) -> None:
    one = tf.Measured([120.0], np.array([[[1.0, 2.0], [1.2, 2.1]]]), "mm")
    with pytest.raises(tf.TrueflankError, match=r"one target \(120\).*no travel was tested.*measure 5 targets"):
        tf.evaluate(one, standard)
