"""What implementers of these evaluations usually get wrong, one test each by number: not here."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.types.sensing import Ambient
from drivers.units import arcsec_to_rad, rad_to_arcsec
from gateway.errors import AmbientOutOfRange, ModelError
from gateway.evaluate.behaviour.doubts import doubts_of
from gateway.evaluate.geometry import measurement, rotary_motion, straightness
from gateway.evaluate.geometry import straightness as squareness
from gateway.evaluate.geometry.straightness import StraightnessRun
from gateway.evaluate.optics import air, displacement, rotary_calibration
from gateway.evaluate.optics.corrections import begin
from gateway.evaluate.standards import iso230_2
from gateway.evaluate.standards.registry import evaluate_by
from gateway.evaluate.uncertainty.budget import file_budget, linear_budget
from gateway.workflow.files.reading import ReadOptions, read_measured
from tests.steps import said

S = np.array([-1.0, -1.0, 0.0, 1.0, 1.0])
AT = np.array([0.0, 90.0, 210.0, 290.0, 400.0])
UP = np.array([0.0, 1.0, 2.0, 3.0, 4.0])[:, None] + S
DOWN = np.array([2.0, 4.0, 4.0, 6.0, 5.0])[:, None] + S * np.array([1.0, 1.0, 2.0, 1.0, 1.0])[:, None]
X = np.stack([UP, DOWN], axis=2)
GOOD = Ambient(20.0, 1013.25, 50.0, (20.0,))


def gap_of(at: object, x: object) -> float:
    found = rotary_calibration.closure(at, x)  # type: ignore[arg-type]
    assert found is not None
    return found.gap


def figures(x: np.ndarray = X, **options: object) -> dict[str, float | None]:
    found = iso230_2.evaluate_iso230_2(AT, x, "um", **options)
    return {name: getattr(found, name) for name in ("B", "B_mean", "E", "E_up", "E_down", "R", "R_up", "R_down", "A")}


def csv(tmp_path: Path, text: str) -> np.ndarray:
    path = tmp_path / "a.csv"
    path.write_text(text, encoding="utf-8")
    return read_measured(path, ReadOptions())[0].deviations


def test_mistake_01_R_and_E_of_both_directions_are_no_maxima_of_one() -> None:
    f = figures()
    assert (f["R"], max(f["R_up"], f["R_down"])) == pytest.approx((8.0, 8.0))
    assert (f["E"], max(f["E_up"], f["E_down"])) == pytest.approx((6.0, 4.0))
    apart = figures(X + np.array([0.0, 3.0]))
    assert apart["R"] == pytest.approx(11.0)


def test_mistake_02_s_is_of_one_direction_over_n_minus_1() -> None:
    found = iso230_2.evaluate_iso230_2(AT, X, "um")
    np.testing.assert_allclose(found.s_up, 1.0)
    np.testing.assert_allclose(found.s_down, [1.0, 1.0, 2.0, 1.0, 1.0])


def test_mistake_03_mean_reversal_keeps_its_sign() -> None:
    found = iso230_2.evaluate_iso230_2(AT, X, "um")
    assert (found.B, found.B_mean) == pytest.approx((3.0, -2.2))
    np.testing.assert_allclose(found.B_i, [-2.0, -3.0, -2.0, -3.0, -1.0])
    mixed = X + np.array([3.0, 0.0]) * np.array([1, -1, 1, -1, 1.0])[:, None, None]
    assert iso230_2.evaluate_iso230_2(AT, mixed, "um").B_mean == pytest.approx(-2.2 + 3.0 / 5.0)


def test_mistake_04_deviation_is_measured_less_target() -> None:
    plain = displacement.LinearSetup(datum_mm=0.0, dead_path_mm=0.0, expansion_ppm_per_k=0.0)
    measured = [[[10.002, 9.999]]]
    found, _ = displacement.linear_deviations(measured, [10.0], plain, start=GOOD, end=GOOD, already="air+material")
    np.testing.assert_allclose(found[0, 0], [2.0, -1.0])


def test_mistake_05_runs_down_belong_to_their_targets_not_to_their_order(tmp_path: Path) -> None:
    head = "target_mm,direction,repetition,deviation_um\n"
    up = "0,+,1,1\n100,+,1,2\n200,+,1,3\n"
    found = csv(tmp_path, head + up + "200,-,1,30\n100,-,1,20\n0,-,1,10\n")
    np.testing.assert_allclose(found[:, 0, 1], [10.0, 20.0, 30.0])


def test_mistake_06_the_edition_decides_2_or_3_s_and_stands_beside_the_figures() -> None:
    assert (figures()["A"], figures(edition="1988")["A"]) == pytest.approx((10.0, 13.0))
    assert figures(edition="1988")["R"] == pytest.approx(12.0)
    for edition in iso230_2.SIGMAS:
        found = iso230_2.evaluate_iso230_2(AT, X, "um", edition=edition)
        assert (found.standard, found.edition) == (f"ISO 230-2:{edition}", edition)
        assert found.certainty


def test_mistake_07_a_missing_reading_is_no_zero_and_never_silent() -> None:
    gappy = X + 100.0
    gappy[2, 3, 0] = np.nan
    found = iso230_2.evaluate_iso230_2(AT, gappy, "um")
    assert found.mean_up[2] == pytest.approx(100.0 + 2.0 - 0.25)
    assert said(found) == ("n = 4 of 5 at i = 3",)
    assert figures(gappy)["A"] == pytest.approx(10.0)


def test_mistake_08_expansion_has_its_sign_acts_on_lengths_and_once() -> None:
    warm = replace(GOOD, material_degc=(23.5,))
    found, record = displacement.expansion_corrected(
        [0.0], [1000.0], 11.7, begin("air"), datum_mm=0.0, start=warm, end=warm
    )
    assert found[0] == pytest.approx(-40.948, abs=1e-3)
    with pytest.raises(ModelError, match="E-EVAL-TWICE"):
        displacement.expansion_corrected(found, [1000.0], 11.7, record, datum_mm=0.0, start=warm, end=warm)


@pytest.mark.parametrize(
    "change",
    [{"humidity_pct": 5000.0}, {"pressure_hpa": 101.325}, {"pressure_hpa": 101325.0}, {"air_degc": 293.15}],
)
def test_mistake_09_units_of_sensors_are_doubted_not_used(change: dict[str, float]) -> None:
    with pytest.raises(AmbientOutOfRange, match="E-EVAL-AMBIENT"):
        air.index(replace(GOOD, **change))


def test_mistake_10_the_wavelength_is_that_in_vacuum() -> None:
    assert pytest.approx(632.990577) == air.WAVELENGTH_NM
    wrong = 632.8 / air.WAVELENGTH_NM - 1.0
    assert wrong == pytest.approx(-301e-6, abs=1e-6)
    assert air.WAVELENGTH_NM / air.index(GOOD) == pytest.approx(632.818846, abs=2e-6)


def test_mistake_11_dead_path_is_that_at_the_datum_with_its_sign() -> None:
    n0, n1 = 1.000271374, 1.000270419
    true = 500.0
    shown = (n1 * (2000.0 + true) - n0 * 2000.0) / n1
    assert (true - shown) * 1000.0 == pytest.approx(1.909, abs=2e-3)
    assert float(displacement.dead_path_corrected(shown, 2000.0, n0, n1)) == pytest.approx(true, abs=1e-10)
    beyond = (n1 * (2000.0 - true) - n0 * 2000.0) / n1
    assert float(displacement.dead_path_corrected(beyond, 2000.0, n0, n1)) == pytest.approx(-true, abs=1e-10)


def test_mistake_12_angles_are_wrapped_before_they_are_subtracted() -> None:
    found = rotary_calibration.rotary_deviations([-359.999, -90.0], [0.0, 0.0], [0.0, 90.0], reference_deg=90.0)
    assert found[0] == pytest.approx(-3.6, abs=1e-6)


def test_mistake_13_0_and_360_are_one_position_in_harmonics() -> None:
    angle = np.arange(0.0, 361.0, 30.0)
    error = 5.0 * np.cos(np.radians(angle - 40.0)) + 2.0 + np.where(angle == 360.0, 1.0, 0.0)
    closed = np.where(angle == 0.0, error + 0.5, error)[:-1]
    both, once = rotary_motion.harmonics(angle, error, (1, 2)), rotary_motion.harmonics(angle[:-1], closed, (1, 2))
    assert both.harmonics[1].amplitude == pytest.approx(once.harmonics[1].amplitude, rel=1e-12)
    assert both.mean == pytest.approx(once.mean, rel=1e-12)
    with pytest.raises(ModelError, match="E-EVAL-ORDERS"):
        rotary_motion.harmonics([0.0, 120.0, 240.0, 360.0, 720.0], np.zeros(5), (1, 2))


def test_mistake_14_unequal_targets_are_fitted_and_equal_ones_said() -> None:
    angle = np.array([0.0, 33.0, 95.0, 141.0, 170.0, 222.0, 260.0, 301.0, 340.0])
    found = rotary_motion.harmonics(angle, 3.0 * np.cos(np.radians(2 * angle - 25.0)), (1, 2))
    assert (found.harmonics[2].amplitude, found.harmonics[1].amplitude) == pytest.approx((3.0, 0.0), abs=1e-9)
    assert [one.code for one in doubts_of(np.arange(0.0, 100.0, 20.0), np.zeros((5, 5, 2)), "mm")] == ["S-EVAL-STEPS"]
    assert doubts_of(AT, np.zeros((len(AT), 5, 2)), "mm") == ()


def test_mistake_15_squareness_has_its_sign_and_leaves_no_slope_in_straightness() -> None:
    x = np.linspace(0.0, 500.0, 6)
    bend = np.array([0.0, 1.0, -1.0, 2.0, -1.0, 0.0]) * 1e-3
    found = squareness.from_runs(StraightnessRun(x, 10e-6 * x), StraightnessRun(x, -5e-6 * x))
    assert rad_to_arcsec(found.C0Y) == pytest.approx(-1.03, abs=2e-3)
    level = straightness.straightness(x, bend + 10e-6 * x, "lsq")
    assert straightness.straightness(x, level.residual, "lsq").slope == pytest.approx(0.0, abs=1e-15)


def test_mistake_16_least_squares_is_not_reported_as_minimum_zone() -> None:
    x, y = [0.0, 100.0, 200.0, 300.0, 400.0], [0.0, 0.0, 0.0, 0.0, 5.0]
    lsq, zone = (straightness.straightness(x, y, reference) for reference in ("lsq", "minimum-zone"))
    assert lsq.value == pytest.approx(4.0)
    assert zone.value == pytest.approx(3.75)
    assert straightness.straightness(x, y).reference == "minimum-zone"


def test_mistake_17_an_arcsecond_is_4_848_microradians() -> None:
    assert arcsec_to_rad(1.0) * 1e6 == pytest.approx(4.848, abs=2e-4)
    assert measurement.arms("X", "X", (0.0, 0.0, 1000.0))["EBX"] == pytest.approx(4.848, abs=2e-4)


def test_mistake_18_drift_is_spread_by_time_not_by_index() -> None:
    times = np.array([0.0, 1.0, 2.0, 100.0])
    found = displacement.drift_removed(times, times / 100.0, (0.0, 0.0), (100.0, 1.0))
    np.testing.assert_allclose(found, 0.0, atol=1e-15)


def test_mistake_19_a_closing_error_is_reported_and_stays() -> None:
    at = np.array([0.0, 90.0, 180.0, 270.0, 360.0])
    error = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    device = -(at + error / 3600.0)
    found = rotary_calibration.rotary_deviations(device, np.zeros(5), at, reference_deg=0.0)
    np.testing.assert_allclose(found - found[0], error, atol=1e-8)
    assert gap_of(at, found) == pytest.approx(4.0)
    said = doubts_of(at, found.reshape(5, 1, 1).repeat(2, axis=2), "deg")[0]
    assert "closing error +4.000 arcsec over 360 deg, not removed" in said.text


def test_mistake_20_uncertainty_holds_temperature_and_expansion() -> None:
    heavy = linear_budget(
        1750.0, expansion_ppm_per_k=12.0, off_20_k=5.0, temperature_range_k=1.0, expansion_range_ppm_per_k=2.0
    )
    assert (heavy.temperature, heavy.expansion) == pytest.approx((12.6, 10.5))
    bare = evaluate_by("2014", AT, X / 10.0, "um", monte_carlo=False).U["A"]
    full = evaluate_by("2014", AT, X / 10.0, "um", budget=file_budget("um", 1750.0, 25.0)[0], monte_carlo=False).U["A"]
    assert full > 10.0 * bare


def test_mistake_21_nothing_is_rounded_before_maxima_are_taken() -> None:
    fine = X * 1e-3 + 0.00049
    scaled = figures(fine)
    for name, value in figures().items():
        assert scaled[name] == pytest.approx(value * 1e-3, rel=1e-9)


def test_mistake_22_decimal_commas_of_a_locale_are_numbers_not_columns(tmp_path: Path) -> None:
    text = "target_mm;direction;repetition;deviation_um\n0,5;+;1;1,25\n100,5;+;1;-2,75\n"
    np.testing.assert_allclose(csv(tmp_path, text)[:, 0, 0], [1.25, -2.75])
