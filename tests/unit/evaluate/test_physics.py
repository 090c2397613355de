"""Air, length and rotary corrections: real values, signs, refusals, and nothing corrected twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.types.sensing import Ambient
from gateway.errors import AmbientOutOfRange, ModelError, NotIdentifiable
from gateway.evaluate.geometry import rotary_motion, straightness
from gateway.evaluate.optics import air, displacement, rotary_calibration
from gateway.evaluate.optics.corrections import begin

GOOD = Ambient(20.0, 1013.25, 50.0, (20.0,))
TARGETS = np.array([0.0, 100.0, 250.0, 400.0])


def gap_of(at: object, x: object) -> float:
    found = rotary_calibration.closure(at, x)  # type: ignore[arg-type]
    assert found is not None
    return found.gap


@pytest.mark.parametrize(
    ("air_c", "kpa", "humidity", "material", "factor"),
    [
        (20.337280, 99.039005, 46.954897, 20.203292, 0.31641096),
        (20.384956, 99.049346, 46.893887, 20.321342, 0.31641067),
    ],
)
def test_real_env_factors_within_a_tenth_ppm(
    air_c: float, kpa: float, humidity: float, material: float, factor: float
) -> None:
    found = air.env_factor(air_c, kpa * 1000.0, humidity, material, 8.0)
    assert found == pytest.approx(factor, rel=1e-7)


@pytest.mark.parametrize(
    ("t", "rh", "p", "nm", "by_ciddor", "by_edlen"),
    [
        (20, 0, 60000, 633, 1.000160924, 1.000160920),
        (5, 0, 100000, 633, 1.000282756, 1.000282750),
        (-40, 0, 100000, 633, 1.000337580, 1.000337471),
        (40, 75, 120000, 633, 1.000299418, 1.000299406),
        (20, 100, 100000, 633, 1.000267394, 1.000267394),
        (20, 0, 101325, 1700, 1.000268479, 1.000268483),
        (40, 100, 110000, 300, 1.000289000, 1.000288922),
        (-40, 0, 120000, 300, 1.000427233, 1.000427072),
    ],
)
def test_nist_table(t: float, rh: float, p: float, nm: float, by_ciddor: float, by_edlen: float) -> None:
    assert air.ciddor(t, p, rh, nm) == pytest.approx(by_ciddor, abs=1.01e-9)
    assert air.edlen(t, p, rh, nm) == pytest.approx(by_edlen, abs=1.01e-9)


def test_equations_agree_in_the_workshop() -> None:
    for t, p, rh, n in ((20, 1013.25, 50, 271.375), (25, 950, 65, 249.806), (32, 1010, 70, 259.080)):
        assert (air.edlen(t, p * 100, rh) - 1) * 1e6 == pytest.approx(n, abs=2e-3)
        assert air.ciddor(t, p * 100, rh) == pytest.approx(air.edlen(t, p * 100, rh), abs=3e-9)


@pytest.mark.parametrize(
    ("change", "code", "sensor"),
    [
        ({"air_degc": None}, "E-EVAL-SENSOR", "air_degc"),
        ({"pressure_hpa": 99.04}, "E-EVAL-AMBIENT", "pressure_hpa"),
        ({"humidity_pct": -0.5}, "E-EVAL-AMBIENT", "humidity_pct"),
        ({"humidity_pct": 140.0}, "E-EVAL-AMBIENT", "humidity_pct"),
        ({"air_degc": 293.15}, "E-EVAL-AMBIENT", "air_degc"),
        ({"pressure_hpa": float("nan")}, "E-EVAL-AMBIENT", "pressure_hpa"),
    ],
)
def test_ambient_is_checked_and_never_assumed(change: dict[str, float], code: str, sensor: str) -> None:
    with pytest.raises(AmbientOutOfRange) as caught:
        air.index(replace(GOOD, **change))
    assert caught.value.code == code
    assert sensor in caught.value.what


def test_material_is_required_and_checked() -> None:
    with pytest.raises(AmbientOutOfRange, match="material_degc"):
        air.material_degc(replace(GOOD, material_degc=()))
    with pytest.raises(AmbientOutOfRange, match="-10"):
        air.material_degc(replace(GOOD, material_degc=(20.0, -10.0)))
    assert air.material_degc(replace(GOOD, material_degc=(20.0, 21.0))) == 20.5


def setup(**changes: float) -> displacement.LinearSetup:
    usual = displacement.LinearSetup(datum_mm=0.0, dead_path_mm=0.0, expansion_ppm_per_k=11.5)
    return replace(usual, **changes)


def test_optical_path_comes_back_as_deviation() -> None:
    deviation = np.array([0.0, 3.0, -2.0, 5.0])
    n = air.index(GOOD)
    optical = (TARGETS + deviation / 1000.0) * n
    found, record = displacement.linear_deviations(optical, TARGETS, setup(), start=GOOD, end=GOOD)
    np.testing.assert_allclose(found, deviation, atol=1e-9)
    assert "edlen" in str(record.air).lower()
    assert record.details["air.n_start"] == n


def test_expansion_dead_path_and_changing_air_together() -> None:
    start = GOOD
    end = Ambient(22.0, 1000.0, 45.0, (24.0,))
    fraction = np.array([0.0, 0.2, 0.7, 1.0])
    n0, n1 = air.index(start), air.index(end)
    n = n0 + (n1 - n0) * fraction
    material = 20.0 + 4.0 * fraction
    deviation = np.array([0.0, 3.0, -2.0, 5.0])
    true = (TARGETS + deviation / 1000.0) * (1 + 11.5e-6 * (material - 20.0))
    optical = n * (150.0 + true) - n0 * 150.0
    found, record = displacement.linear_deviations(
        optical, TARGETS, setup(dead_path_mm=150.0), start=start, end=end, fraction=fraction
    )
    np.testing.assert_allclose(found, deviation, atol=1e-9)
    assert record.details["dead_path.D_mm"] == 150.0


def test_beam_against_the_axis_turns_the_dead_path_only() -> None:
    end = replace(GOOD, air_degc=22.0)
    n0, n1 = air.index(GOOD), air.index(end)
    away = n1 * (300.0 - TARGETS) - n0 * 300.0
    found, _ = displacement.linear_deviations(
        -away, TARGETS, setup(dead_path_mm=300.0, beam=-1), start=GOOD, end=end, fraction=1.0
    )
    np.testing.assert_allclose(found, 0.0, atol=1e-9)


def test_what_the_instrument_did_is_left_out() -> None:
    none = Ambient()
    found, record = displacement.linear_deviations(
        TARGETS + 0.001, TARGETS, setup(), start=none, end=none, already="air+material"
    )
    np.testing.assert_allclose(found, 1.0, atol=1e-9)
    assert str(record.air) == str(record.expansion) == "by the instrument"
    with pytest.raises(AmbientOutOfRange):
        displacement.linear_deviations(TARGETS, TARGETS, setup(), start=none, end=none, already="air")


def test_nothing_is_corrected_twice() -> None:
    _, record = displacement.linear_deviations(TARGETS, TARGETS, setup(), start=GOOD, end=GOOD)
    with pytest.raises(ModelError, match="E-EVAL-TWICE"):
        displacement.linear_deviations(TARGETS, TARGETS, setup(), start=GOOD, end=GOOD, record=record)
    with pytest.raises(ModelError, match="expansion"):
        displacement.expansion_corrected(TARGETS, TARGETS, 11.5, record, datum_mm=0.0, start=GOOD, end=GOOD)
    with pytest.raises(ModelError, match="E-EVAL-TWICE"):
        displacement.expansion_corrected(
            TARGETS, TARGETS, 11.5, begin("air+material"), datum_mm=0.0, start=GOOD, end=GOOD
        )


def test_expansion_of_a_file_acts_on_target_and_deviation() -> None:
    warm = replace(GOOD, material_degc=(23.5,))
    found, _ = displacement.expansion_corrected(
        [0.0, 0.0], [0.0, 1000.0], 11.7, begin("air"), datum_mm=0.0, start=warm, end=warm
    )
    np.testing.assert_allclose(found, [0.0, -40.948], atol=1e-3)


def test_drift_goes_by_time_not_by_index() -> None:
    times = np.array([0.0, 10.0, 40.0, 100.0])
    found = displacement.drift_removed(times, 0.02 * times + 7.0, (0.0, 7.0), (100.0, 9.0))
    np.testing.assert_allclose(found, 0.0, atol=1e-12)
    with pytest.raises(ModelError, match="E-EVAL-DRIFT-TIME"):
        displacement.drift_removed([0.0], [0.0], (5.0, 0.0), (5.0, 1.0))


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("zero", [0.0, 179.99, -359.999])
def test_rotary_readings_over_turns_and_any_device_zero(sense: int, zero: float) -> None:
    targets = np.array([0.0, 90.0, 180.0, 359.0, 720.0])
    deviation = np.array([0.0, 12.0, -7.0, 3.0, 1.0])
    laser = np.array([0.001, -0.002, 0.0005, 0.0, 0.002])
    device = laser - (targets + deviation / 3600.0 + zero)
    found = rotary_calibration.rotary_deviations(
        device[:, None, None], sense * laser[:, None, None], targets, reference_deg=0.0, sense=sense
    )
    np.testing.assert_allclose(found[:, 0, 0], deviation, atol=1e-8)


def test_rotary_zero_may_be_given_and_a_missing_datum_is_refused() -> None:
    targets = np.array([0.0, 90.0])
    found = rotary_calibration.rotary_deviations(-targets - 5.0, [0.0, 0.0], targets, reference_deg=0.0, zero_deg=5.0)
    np.testing.assert_allclose(found, 0.0, atol=1e-9)
    with pytest.raises(ModelError, match="E-EVAL-DATUM"):
        rotary_calibration.rotary_deviations([np.nan, -90.0], [0.0, 0.0], targets, reference_deg=0.0)


def test_closure_is_reported_for_whole_turns_only() -> None:
    assert gap_of([0.0, 180.0, 360.0], [0.1, 3.0, 0.4]) == pytest.approx(0.3)
    assert rotary_calibration.closure([0.0, 345.0], [0.0, 1.0]) is None


def test_unequal_angles_keep_their_harmonics_and_too_few_are_refused() -> None:
    angle = np.sort(np.random.default_rng(3).uniform(0, 360, 24))
    error = 5 * np.cos(np.radians(3 * angle - 40)) + 2
    found = rotary_motion.harmonics(angle, error, (1, 3))
    assert found.harmonics[3].amplitude == pytest.approx(5.0)
    assert found.harmonics[3].phase_deg == pytest.approx(40.0)
    assert found.harmonics[1].amplitude == pytest.approx(0.0, abs=1e-9)
    with pytest.raises(NotIdentifiable):
        rotary_motion.harmonics(np.arange(0, 360, 45.0), np.zeros(8), (1, 7))


def test_straightness_references() -> None:
    x, y = [0, 100, 200, 300, 400, 500], [0, 3, 4, 3, 0, -5]
    ends = straightness.straightness(x, y, "end-point").value
    zone = straightness.straightness(x, y, "minimum-zone").value
    assert ends == pytest.approx(6.0)
    assert zone <= straightness.straightness(x, y, "lsq").value <= ends
    assert straightness.parallel((x, y), (x, np.asarray(y) + 2)).slope == pytest.approx(0.0, abs=1e-15)


def test_minimum_zone_is_never_wider() -> None:
    rng = np.random.default_rng(8)
    for _ in range(50):
        x, y = np.sort(rng.uniform(0, 500, 12)), rng.normal(size=12)
        zone = straightness.straightness(x, y, "minimum-zone")
        slopes = np.linspace(zone.slope - 0.05, zone.slope + 0.05, 2001)
        assert zone.value <= min(np.ptp(y - s * x) for s in slopes) + 1e-12
        assert zone.value <= straightness.straightness(x, y, "lsq").value + 1e-12
