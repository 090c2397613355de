"""What a cell file can ask of a machine beyond smooth curves: each against its own formula, and as seen outside."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from simulators.cellfile import CellFile, DriftSection, Noise, Sensor, load_cell
from simulators.grinding import CycloidDisc
from simulators.optics import LaserCounter, OpticsBench, RotaryReader, SensorReader, StopNoise
from simulators.truth import AxisMotion, Scatter, Truth
from simulators.truth.climate import drift_value
from tests.unit.simulators.motion import Motion, plain_cell
from tests.unit.simulators.planned_run import ground

ARCSEC = np.pi / 180.0 / 3600.0
COUNT_UM = 0.02
UP, DOWN = np.ones(1), -np.ones(1)
GEAR = {"rp": 90.0, "rrp": 7.0, "a": 4.0, "zp": 12, "zc": 11, "b": 15.0}
PART: dict[str, Any] = {"gear": GEAR, "grinding": {"centre_distance_mm": 190.0}}
STOP_S, MOVE_S = 3.0, 1.0


def cell(axis: str = "X1", own: dict[str, Any] | None = None, **changes: Any) -> CellFile:
    """The plain cell with something more about one axis."""
    data: dict[str, Any] = plain_cell(**changes)
    data["axes"] = [one | (own or {}) if one["name"] == axis else one for one in data["axes"]]
    return CellFile.model_validate(data)


def driven(axis: str, *places: float) -> Motion:
    """From stop to stop."""
    whole = STOP_S + MOVE_S
    knots = [(n * whole + rest, place) for n, place in enumerate(places) for rest in (0.0, STOP_S)]
    return Motion(**{axis: knots})


def counted(spec: CellFile, motion: Motion, component: str = "EXX") -> np.ndarray:
    """What the laser counts at the end of every stop, um of length; the first is the datum."""
    bench = OpticsBench(Truth(spec), motion)
    bench.mount(next(one for one in spec.setups if one.component == component))
    laser = LaserCounter(spec.instruments[0], bench)  # type: ignore[arg-type]
    stops = len(motion.knots[component[2] + "1"]) // 2
    ends = [n * (STOP_S + MOVE_S) + STOP_S - 0.1 for n in range(stops)]
    counts = [float(laser.read(end).counts[-1]) for end in ends]
    return (np.asarray(counts) - counts[0]) * laser.count_mm * 1000.0


def off(spec: CellFile, motion: Motion, component: str = "EXX") -> np.ndarray:
    """The same less what a machine without errors would show."""
    clean = spec.model_copy(update={"truth": type(spec.truth)(), "axes": cell().axes})
    return counted(spec, motion, component) - counted(clean, motion, component)


def curve(name: str, term: dict[str, Any], at: np.ndarray) -> np.ndarray:
    return Truth(cell(truth={"motions": {name: [term]}})).motion(name, at)


SCREW = {"kind": "screw", "pitch": 8.0, "amplitudes": [0.9, 0.3], "phase_deg": 25.0}
WORM = {"kind": "worm", "teeth": 72, "amplitudes": [1.1], "phase_deg": 40.0}
WEAR = {"kind": "wear", "at": -120.0, "length": 30.0, "depth": 8.0}


def test_a_screw_repeats_with_its_pitch_and_begins_at_its_phase() -> None:
    at = np.linspace(-40.0, 40.0, 161)
    shaft = np.deg2rad(360.0 * at / 8.0 + 25.0)
    np.testing.assert_allclose(curve("EXX", SCREW, at), 0.9 * np.cos(shaft) + 0.3 * np.cos(2.0 * shaft), atol=1e-12)
    np.testing.assert_allclose(curve("EXX", SCREW, at + 8.0), curve("EXX", SCREW, at), atol=1e-12)


def test_a_worm_turns_once_for_each_tooth_of_its_wheel() -> None:
    at = np.arange(0.0, 360.0, 0.25)
    orders = np.abs(np.fft.rfft(curve("ECC", WORM, at))) / at.size * 2.0
    assert set(np.flatnonzero(orders > 0.01)) == {72}
    assert orders[72] == pytest.approx(1.1)
    double = curve("ECC", WORM | {"starts": 2}, at)
    np.testing.assert_allclose(double, 1.1 * np.cos(np.deg2rad(36.0 * at + 40.0)), atol=1e-9)
    with pytest.raises(ValidationError, match="closes after a turn"):
        curve("ECC", WORM | {"starts": 5}, at)


def test_wear_is_a_hollow_and_nothing_beside_it() -> None:
    at = np.asarray([-150.0, -135.0, -127.5, -120.0, -112.5, -105.0, -50.0])
    np.testing.assert_allclose(curve("EYX", WEAR, at), [0.0, 0.0, -4.0, -8.0, -4.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("term", [SCREW, WORM, WEAR])
def test_another_seed_draws_them_anew_and_a_worn_guide_never_grows(term: dict[str, Any]) -> None:
    spec = cell(truth={"motions": {"EXX": [term]}})
    at = np.linspace(-500.0, 1500.0, 4001)
    first, second = (Truth(spec, seed).motion("EXX", at) for seed in (2, 3))
    assert np.max(np.abs(first - second)) > 0.2
    assert term["kind"] != "wear" or (np.max(first) == 0.0 and -8.8 <= np.min(first) <= -6.4)


def test_the_laser_sees_the_screw() -> None:
    """Rising to 0, 2, 4 and 6 mm of a pitch of 8: quarters of its turn."""
    spec = cell(truth={"motions": {"EXX": [SCREW | {"amplitudes": [0.9], "phase_deg": 0.0}]}})
    np.testing.assert_allclose(off(spec, driven("X1", 0.0, 2.0, 4.0, 6.0)), [0.0, -0.9, -1.8, -0.9], atol=COUNT_UM)


def test_a_drift_bends_as_its_formula_says() -> None:
    spec = DriftSection(per_h=0.5, per_k=2.0, warm_up=3.0, warm_up_h=1.5, wave=0.2, wave_h=4.0)
    found = drift_value(spec, 3.0 * 3600.0, 21.5)
    expected = 1.5 + 3.0 + 3.0 * (1.0 - np.exp(-2.0)) + 0.2 * np.sin(2.0 * np.pi * 0.75)
    assert found == pytest.approx(expected)
    assert drift_value(DriftSection(warm_up=3.0, warm_up_h=1.5), 30.0 * 3600.0, 20.0) == pytest.approx(3.0, abs=1e-6)


def test_a_drift_moves_the_whole_axis_and_turns_with_its_sign() -> None:
    drift = {"warm_up": 3.0, "warm_up_h": 0.5, "per_k": 1.0}
    spec = cell(own={"drift": drift}, climate={"material_degc": {"start": 22.0}})
    at, t = np.asarray([0.0, 300.0]), 1800.0
    whole = 3.0 * (1.0 - np.exp(-1.0)) + 2.0
    np.testing.assert_allclose(Truth(spec).deviation("X1", at, 1, t), [whole, whole])
    np.testing.assert_allclose(Truth(spec, flip=True).deviation("X1", at, 1, t), [-whole, -whole])
    seen = off(cell(own={"drift": {"warm_up": 3.0, "warm_up_h": 12.0 / 3600.0}}), driven("X1", *[100.0] * 7))
    times = np.asarray([n * (STOP_S + MOVE_S) + STOP_S - 0.1 for n in range(7)])
    course = 3.0 * (1.0 - np.exp(-times / 12.0))
    np.testing.assert_allclose(seen, course - course[0], atol=2.0 * COUNT_UM)


def test_a_location_moves_with_time_and_temperature() -> None:
    truth = {"locations": {"X0C": 10.0, "B0Z": 4.0}, "moving": {"X0C": {"per_h": 2.0, "per_k": 3.0}}}
    spec = cell(truth=truth, climate={"material_degc": {"start": 20.0, "per_h": 0.5}})
    true = Truth(spec)
    assert true.location("X0C") == 10.0
    assert true.location("X0C", 7200.0) == pytest.approx(10.0 + 4.0 + 3.0)
    assert true.location("B0Z", 7200.0) == 4.0
    still = {letter: AxisMotion(np.zeros(1), UP, UP) for letter in "XZC"}
    moved = [true.frames(still, t)["C"].origin[0, 0] for t in (0.0, 7200.0)]
    assert np.diff(moved) == pytest.approx(7e-3)


def test_what_depends_on_the_way_of_travel_is_half_to_either_side() -> None:
    ways = {"EYX": [{"kind": "constant", "value": 0.8}], "EBX": [{"kind": "constant", "value": 2.0}]}
    true = Truth(cell(truth={"reversals": ways, "motions": {"EYX": [{"kind": "constant", "value": 5.0}]}}))
    up, down = (true.frames({"X": AxisMotion(np.zeros(1), way, way)}, 0.0)["X"] for way in (UP, DOWN))
    assert [pose.origin[0, 1] for pose in (up, down)] == pytest.approx([5.4e-3, 4.6e-3])
    assert [-pose.rotation[0, 2, 0] / ARCSEC for pose in (up, down)] == pytest.approx([1.0, -1.0])
    with pytest.raises(ValidationError, match="'reversal' of that axis"):
        cell(truth={"reversals": {"EXX": [{"kind": "constant", "value": 1.0}]}})


def test_a_straightness_instrument_sees_the_way_of_travel() -> None:
    sensor = {"kind": "straightness", "name": "sensor", "zero": 0.0}
    setups = [{"component": "EYX", "axis": "X", "instrument": "sensor", "optics": "straightness"}]
    both: dict[str, Any] = {"instruments": [sensor], "setups": setups}
    spec = cell(truth={"reversals": {"EYX": [{"kind": "constant", "value": 0.8}]}}, **both)
    bench = OpticsBench(Truth(spec), driven("X1", 0.0, 50.0, 20.0))
    bench.mount(spec.setups[0])
    reader = SensorReader(Sensor.model_validate(sensor), bench)
    assert [reader.read(end).value[-1] for end in (6.9, 10.9)] == pytest.approx([0.4, -0.4], abs=1e-3)


def test_an_axis_scatters_from_stop_to_stop_and_not_while_it_stands() -> None:
    axis = Scatter(0.4, 3, "X")
    at = np.repeat(np.arange(400.0), 3)
    offsets = axis.follow(at).reshape(-1, 3)
    assert np.ptp(offsets, axis=1).max() == 0.0
    assert np.std(offsets[:, 0]) == pytest.approx(0.4, rel=0.1)
    piecewise = Scatter(0.4, 3, "X")
    whole = [np.broadcast_to(piecewise.follow(part), part.shape) for part in np.split(at, 100)]
    np.testing.assert_array_equal(np.concatenate(whole), offsets.ravel())
    assert Scatter(0.4, 3, "Z").drawn((2,)) != pytest.approx(Scatter(0.4, 3, "X").drawn((2,)))


def test_laser_and_calibrator_see_the_scatter_of_an_axis() -> None:
    places = [float(place) for place in np.tile([0.0, 40.0], 30)]
    seen = off(cell(own={"scatter": 0.5}), driven("X1", *places))
    assert 0.3 < np.std(seen[1:]) < 0.7
    spec = cell("C1", {"scatter": 2.0})
    bench = OpticsBench(Truth(spec), driven("C1", 0.0, 5.0))
    bench.mount(spec.setups[2])
    reader = RotaryReader(spec.instruments[1], bench)  # type: ignore[arg-type]
    first, second = (reader.read(end) for end in (2.9, 6.9))
    turned = [float(one.laser_deg[-1] - one.device_deg[-1]) for one in (first, second)]
    assert 0.1 < abs(turned[1] - turned[0] - 5.0) * 3600.0 < 8.0


def part_with(wheel: dict[str, Any] | None = None, **more: Any) -> np.ndarray:
    """Surplus (K,) of the spaces, in the middle of the right and of the left flank, um: (K, 2)."""
    spec = cell(part=PART, wheel=wheel or {}, **more)
    assert spec.part is not None
    work = ground(Truth(spec), spec.part)
    t = CycloidDisc(spec.part.gear).even(5, 1.0)[[1, 3]]
    return work.surplus_um(np.arange(11.0), t, np.zeros(1))[:, :, 0]


def test_a_wheel_that_wears_leaves_more_from_space_to_space() -> None:
    """What the radius loses stays along n_x; the shift of the profile along n_y; spaces are ground in their order."""
    spec = cell(part=PART)
    assert spec.part is not None
    lobes = CycloidDisc(spec.part.gear)
    _, normal = lobes.profile(lobes.even(5, 1.0)[[1, 3]])
    worn = part_with({"wear_um": 0.05, "wear_side_um": 0.02})
    expected = np.arange(11.0)[:, None] * (0.05 * normal.real + 0.02 * normal.imag)
    np.testing.assert_allclose(worn - part_with(), expected, atol=2e-3)


def test_the_next_blank_meets_a_dressed_wheel() -> None:
    """And a table that warms up while a part is made shows on it as an index that runs away."""
    run = {"warm_up": 20.0, "warm_up_h": 0.005}
    ran = part_with(axes=[one | ({"drift": run} if one["name"] == "C1" else {}) for one in plain_cell()["axes"]])
    by_space = (ran - part_with()) @ np.asarray([-0.5, 0.5])
    assert np.all(np.diff(np.sign(by_space[-1]) * by_space) > -1e-9)
    assert abs(by_space[-1] - by_space[0]) > 0.3 * abs(by_space[-1]) > 0.5
    file = load_cell("eleven").model_copy(update={"wheel": spec_of_wheel(0.05)})
    assert file.part is not None
    true = Truth(file)
    first, second = (ground(true, file.part, start_s=at).surplus_um(np.arange(11.0), np.full(1, 0.1), np.zeros(1))
                     for at in (0.0, 1.0))  # fmt: skip
    np.testing.assert_allclose(first, second, atol=0.02)


def spec_of_wheel(wear_um: float) -> Any:
    return load_cell("eleven").wheel.model_copy(update={"wear_um": wear_um})


def test_air_that_moves_is_seen_by_an_axis_at_rest() -> None:
    """Another reading every two seconds of the same stop, by the same seed the same; an outlier stays for its stop."""
    still, spacing_s = np.full(400, 50.0), 0.1

    def read(stop_s: float) -> StopNoise:
        return StopNoise(Noise(stop=0.3, stop_s=stop_s), 100, 7, "laser X1")

    moving, again, calm = read(2.0), read(2.0), read(0.0)
    seen = np.concatenate([moving.offsets(still[:150], spacing_s), moving.offsets(still[150:], spacing_s)])
    np.testing.assert_array_equal(seen, again.offsets(still, spacing_s))
    pieces = seen.reshape(20, 20)
    assert np.ptp(pieces, axis=1).max() == 0.0
    assert np.std(pieces[:, 0], ddof=1) == pytest.approx(0.3, rel=0.4)
    assert set(calm.offsets(still, spacing_s)) == {seen[0]}
    left = moving.offsets(np.concatenate([np.linspace(50.0, 60.0, 10), np.full(30, 60.0)]), spacing_s)
    assert left[-1] == moving.offset(1)


def test_a_time_for_a_noise_that_is_not_there_is_refused() -> None:
    with pytest.raises(ValueError, match="give stop too"):
        Noise(stop_s=2.0)
