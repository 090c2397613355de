"""The truth: terms, reversal, seeds, signs, and the rigid bodies they move."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from drivers.errors import ConfigError
from gateway.interlocks.facts import LEAST_DRIFT_K
from simulators.cellfile import CellFile, InspectionMachine, limit_sample_rate, load_cell, packaged_cells
from simulators.truth import AxisMotion, Climate, Hysteresis, Truth, drift_time_s
from tests.unit.simulators.motion import plain_cell

UP = np.asarray([1.0])


def truth_of(motions: dict[str, list[dict[str, object]]], **changes: object) -> Truth:
    return Truth(CellFile.model_validate(plain_cell(truth={"motions": motions}, **changes)))


@pytest.mark.parametrize(
    ("term", "at", "expected"),
    [
        ({"kind": "constant", "value": 2.5}, 7.0, 2.5),
        ({"kind": "polynomial", "coefficients": [1.0, 2.0, 3.0], "center": 10.0, "scale": 5.0}, 20.0, 17.0),
        ({"kind": "harmonic", "period": 40.0, "amplitude": 3.0}, 20.0, -3.0),
        ({"kind": "harmonic", "period": 40.0, "amplitude": 3.0, "phase_deg": 90.0}, 0.0, 0.0),
        ({"kind": "table", "positions": [0.0, 10.0], "values": [1.0, 3.0]}, 5.0, 2.0),
        ({"kind": "table", "positions": [0.0, 10.0], "values": [1.0, 3.0]}, 50.0, 3.0),
        ({"kind": "step", "at": 3.0, "height": 1.0}, 2.999, 0.0),
        ({"kind": "step", "at": 3.0, "height": 1.0}, 3.0, 1.0),
    ],
)
def test_a_term_has_its_value(term: dict[str, object], at: float, expected: float) -> None:
    truth = truth_of({"EXX": [term]})
    assert truth.deviation("X1", np.asarray([at]), 1)[0] == pytest.approx(expected, abs=1e-12)


def test_terms_add_up_and_orders_count_turns() -> None:
    terms = [{"kind": "harmonic", "order": k, "amplitude": a} for k, a in ((1, 7.0), (36, 0.2))]
    truth = truth_of({"ECC": terms})
    at = np.asarray([0.0, 5.0, 180.0, 365.0])
    expected = 7.0 * np.cos(np.deg2rad(at)) + 0.2 * np.cos(36.0 * np.deg2rad(at))
    np.testing.assert_allclose(truth.deviation("C", at, 1), expected, atol=1e-9)


def test_reversal_is_the_difference_of_the_two_directions_and_may_vary() -> None:
    data = plain_cell()
    data["axes"][0] |= {
        "reversal": [{"kind": "constant", "value": -1.5}, {"kind": "step", "at": 100.0, "height": 1.0}],
        "hysteresis": {"size": 0.4, "distance": 2.0},
        "drift_per_h": 0.6,
    }
    truth = Truth(CellFile.model_validate(data))
    places = np.asarray([0.0, 200.0])
    up, down = (truth.deviation("X1", places, sense, t=1800.0) for sense in (1, -1))
    np.testing.assert_allclose(up - down, [-1.1, -0.1], atol=1e-12)
    np.testing.assert_allclose((up + down) / 2.0, 0.3, atol=1e-12)


def test_hysteresis_builds_up_with_travel_and_keeps_its_state() -> None:
    follower = Hysteresis(2.0)
    np.testing.assert_allclose(follower.follow(np.asarray([0.0, 2.0, 6.0])), [-1.0, 0.0, 1.0])
    np.testing.assert_allclose(follower.follow(np.asarray([6.0, 5.0])), [1.0, 0.5])
    np.testing.assert_allclose(follower.follow(np.asarray([4.0])), [0.0])


@given(st.lists(st.floats(-50.0, 50.0), min_size=1, max_size=30), st.floats(0.1, 10.0))
def test_hysteresis_stays_between_its_ends_however_the_axis_moves(path: list[float], distance: float) -> None:
    whole = Hysteresis(distance).follow(np.asarray(path))
    assert np.all(np.abs(whole) <= 1.0)
    piecewise = Hysteresis(distance)
    np.testing.assert_allclose([piecewise.follow(np.asarray([p]))[0] for p in path], whole, atol=1e-9)


@pytest.mark.parametrize("name", packaged_cells())
def test_a_shipped_machine_stays_in_the_warmth_that_every_push_allows(name: str) -> None:
    """At 300 times a coffee, or a busy PC, is a shift at the machine: its push was refused for 2 K (E-INT-WARMTH)."""
    climate = Climate(load_cell(name).climate)
    felt = [climate.sensed(60.0 * minute).material_degc for minute in range(12 * 60)]
    assert max(felt) - min(felt) < LEAST_DRIFT_K


@pytest.mark.parametrize("name", packaged_cells())
def test_packaged_cells_load_and_are_reproducible(name: str) -> None:
    cell, at = load_cell(name), np.linspace(-300.0, 0.0, 50)
    for seed in (None, 7):
        first, second = Truth(cell, seed), Truth(cell, seed)
        np.testing.assert_array_equal(first.deviation("X1", at, 1), second.deviation("X1", at, 1))


def test_the_demo_cell_is_as_promised() -> None:
    cell = load_cell("demo")
    truth, turn = Truth(cell), np.arange(0.0, 360.0, 0.1)
    up, down = truth.deviation("C1", turn, 1), truth.deviation("C1", turn, -1)
    assert 15.0 <= np.ptp((up + down) / 2.0) <= 25.0
    np.testing.assert_allclose(np.abs(up - down), 0.6)
    orders = np.abs(np.fft.rfft((up + down) / 2.0)) / len(turn) * 2.0
    assert set(np.flatnonzero(orders > 0.05)) == {1, 2, 3, 6, 36}
    assert orders[36] == pytest.approx(0.2)
    for name, places in (("X1", np.arange(-400.0, 0.0, 0.1)), ("Z1", np.arange(0.0, 300.0, 0.1))):
        assert 15.0 <= np.ptp(truth.deviation(name, places, 1)) <= 25.0


def test_another_seed_is_another_machine_of_the_same_kind() -> None:
    cell, at = load_cell("demo"), np.arange(0.0, 360.0, 1.0)
    curves = [Truth(cell, seed).deviation("C1", at, 1) for seed in (1, 2, 3)]
    assert np.max(np.abs(curves[1] - curves[2])) > 2.0
    np.testing.assert_array_equal(curves[0], Truth(cell).deviation("C1", at, 1))
    assert all(14.0 <= np.ptp(curve) <= 28.0 for curve in curves)


def test_flip_reverses_every_error() -> None:
    cell, at = load_cell("demo"), np.linspace(-390.0, 0.0, 40)
    for sense in (1, -1):
        plain, flipped = (Truth(cell, 5, flip=flip).deviation("X1", at, sense, 900.0) for flip in (False, True))
        np.testing.assert_allclose(flipped, -plain, atol=1e-12)
    assert Truth(cell, flip=True).location("B0Z") == -Truth(cell).location("B0Z")


def test_the_zero_cell_has_no_error() -> None:
    truth, at = Truth(load_cell("zero"), seed=9), np.linspace(0.0, 300.0, 31)
    for axis in ("X1", "Z1", "C1"):
        assert not truth.deviation(axis, at, -1, t=3600.0).any()


def test_squareness_tilts_a_slide_and_leaves_its_frame() -> None:
    data = plain_cell(truth={"locations": {"B0Z": 10.0}})
    truth = Truth(CellFile.model_validate(data))
    frame = truth.frames({"Z": AxisMotion(np.asarray([300.0]), UP, UP)}, 0.0)["Z"]
    angle = np.deg2rad(10.0 / 3600.0)
    np.testing.assert_allclose(frame.origin[0], [300.0 * np.sin(angle), 0.0, 300.0 * np.cos(angle)])
    np.testing.assert_allclose(frame.rotation[0], np.eye(3), atol=1e-15)


def test_the_table_rides_on_the_slide_and_turns_in_its_tilted_seat() -> None:
    data = plain_cell(truth={"motions": {"EYX": [{"kind": "constant", "value": 4.0}]}, "locations": {"A0C": 20.0}})
    truth = Truth(CellFile.model_validate(data))
    motions = {"X": AxisMotion(np.asarray([-100.0]), UP, UP), "C": AxisMotion(np.asarray([90.0]), UP, UP)}
    point = truth.frames(motions, 0.0)["C"].point(np.asarray([50.0, 0.0, 0.0]))[0]
    tilt = np.deg2rad(20.0 / 3600.0)
    np.testing.assert_allclose(point, [-100.0, 50.0 * np.cos(tilt) + 0.004, 50.0 * np.sin(tilt)], atol=1e-12)


@pytest.mark.parametrize(
    "change",
    [
        {"axes": []},
        {"truth": {"motions": {"EQX": []}}},
        {"truth": {"motions": {"EXX": [{"kind": "harmonic", "amplitude": 1.0}]}}},
        {"truth": {"motions": {"EXX": [{"kind": "table", "positions": [1.0, 0.0], "values": [0.0, 0.0]}]}}},
        {"setups": [{"component": "EXX", "axis": "X", "instrument": "none", "optics": "linear"}]},
        {"surprise": 1},
    ],
)
def test_a_wrong_cell_file_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        CellFile.model_validate(plain_cell(**change))


def test_a_missing_cell_file_says_where(tmp_path: object) -> None:
    with pytest.raises(ConfigError, match="E-CELL-READ"):
        load_cell(f"{tmp_path}/none.toml")


def test_a_drift_turns_back_after_half_a_day() -> None:
    hours = np.arange(0.0, 24.0 * 30.0, 0.25)
    found = drift_time_s(3600.0 * hours) / 3600.0
    assert np.array_equal(found[hours <= 12.0], hours[hours <= 12.0])
    assert np.max(np.abs(found)) <= 12.0
    assert np.max(np.abs(np.diff(found))) <= 0.25 + 1e-9
    assert [drift_time_s(3600.0 * hour) / 3600.0 for hour in (0.0, 12.0, 24.0, 36.0, 48.0)] == [
        0.0,
        12.0,
        0.0,
        -12.0,
        0.0,
    ]


def test_the_surroundings_of_a_cell_left_running_stay_within_bounds() -> None:
    climate = Climate(load_cell("demo").climate)
    days = [climate.true(86400.0 * day / 8.0) for day in range(8 * 60)]
    assert all(17.0 < weather.air_degc < 28.0 for weather in days)
    assert all(17.0 < weather.material_degc < 26.0 for weather in days)
    assert all(980.0 < weather.pressure_hpa < 1005.0 for weather in days)
    assert all(30.0 < weather.humidity_pct < 65.0 for weather in days)


def test_a_machine_that_stands_is_where_it_is_among_many_places() -> None:
    """One place alone goes a shorter way through the chain."""
    truth = Truth(load_cell("demo"))
    places = {"X": np.array([-120.0, -3.5, -120.0]), "Z": np.array([7.0, 250.0, 7.0]), "C": np.array([33.0, 0.0, 33.0])}
    ways = {letter: AxisMotion(at, np.ones(3), np.ones(3)) for letter, at in places.items()}
    alone = {letter: AxisMotion(at[:1], np.ones(1), np.ones(1)) for letter, at in places.items()}
    many, one = truth.frames(ways, 900.0), truth.frames(alone, 900.0)
    for name in "XZC":
        np.testing.assert_allclose(one[name].origin[0], many[name].origin[2], rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(one[name].rotation[0], many[name].rotation[2], rtol=0.0, atol=1e-15)


def test_instruments_sampled_at_most_so_often_keep_slower_rates() -> None:
    cell = load_cell("demo")
    slower = limit_sample_rate(cell, 60.0)
    pairs = [(one, two) for one, two in zip(cell.instruments, slower.instruments, strict=True)]
    rates = [(one.sample_hz, two.sample_hz) for one, two in pairs if not isinstance(one, InspectionMachine)]
    assert {one for one, _ in rates} == {1000.0, 100.0, 50.0}
    assert all(two == min(one, 60.0) for one, two in rates)
    assert slower.truth == cell.truth
