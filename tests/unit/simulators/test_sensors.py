"""Straightness, angle, square, ball and bar set-ups: what they show of each error motion, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from simulators.cellfile import CellFile, Sensor, load_cell
from simulators.optics import OpticsBench, SensorReader, SensorReadings
from simulators.truth import Truth
from tests.unit.simulators.motion import Motion, plain_cell

ARCSEC = np.pi / 180.0 / 3600.0
UM_PER_MRAD_MM = 1.0
SWEEP_S = 60.0


def curve(axis: str) -> list[dict[str, object]]:
    """A smooth curve without a constant place: 4 um or arcsec."""
    if axis == "C":
        return [{"kind": "harmonic", "order": 2, "amplitude": 4.0, "phase_deg": 20.0}]
    return [{"kind": "harmonic", "period": 170.0, "amplitude": 4.0, "phase_deg": 20.0}]


def true(axis: str, q: np.ndarray) -> np.ndarray:
    turns = 2.0 * q / 360.0 if axis == "C" else q / 170.0
    return 4.0 * np.cos(2.0 * np.pi * turns + np.deg2rad(20.0))


def cell_for(setup: dict[str, object], kind: str, truth: dict[str, object], **spec: object) -> CellFile:
    sensor = {"kind": kind, "name": "sensor", "zero": 0.0} | spec
    base = plain_cell()
    return CellFile.model_validate(
        plain_cell(instruments=[*base["instruments"], sensor], setups=[{"instrument": "sensor"} | setup], truth=truth)
    )


def swept(cell: CellFile, axis: str, wrong: str | None = None, **places: float) -> tuple[np.ndarray, SensorReadings]:
    """Move one axis over its range in a minute with the first set-up mounted; positions and readings."""
    ends = {"X": (-400.0, 0.0), "Z": (0.0, 300.0), "C": (0.0, 359.0)}[axis]
    knots = {f"{letter}1": [(0.0, value)] for letter, value in places.items()}
    knots[f"{axis}1"] = [(0.0, ends[0]), (SWEEP_S, ends[1])]
    bench = OpticsBench(Truth(cell), Motion(**knots))
    bench.mount(cell.setups[0], wrong)
    spec = next(found for found in cell.instruments if isinstance(found, Sensor))
    readings = SensorReader(spec, bench).read(SWEEP_S)
    return np.interp(readings.time_s, [0.0, SWEEP_S], ends), readings


STRAIGHT = [("EYX", "X"), ("EZX", "X"), ("EXZ", "Z"), ("EYZ", "Z"), ("EXC", "C"), ("EYC", "C"), ("EZC", "C")]
ANGLES = [("EAX", "X", "level"), ("EBX", "X", "angular"), ("ECX", "X", "angular"), ("EAZ", "Z", "angular"),
          ("EBZ", "Z", "angular"), ("ECZ", "Z", "angular"), ("EAC", "C", "bar"), ("EBC", "C", "bar")]  # fmt: skip


@pytest.mark.parametrize(("name", "axis"), STRAIGHT)
def test_straightness_shows_its_component_alone_in_um(name: str, axis: str) -> None:
    setup = {"component": name, "axis": axis, "optics": "ball" if axis == "C" else "straightness"}
    q, got = swept(cell_for(setup, "straightness", {"motions": {name: curve(axis)}}), axis)
    np.testing.assert_allclose(got.value, true(axis, q), atol=1e-3)
    assert got.beam.all()
    assert len(got.value) > 2900


@pytest.mark.parametrize(("name", "axis", "optics"), ANGLES)
def test_angles_show_their_component_alone_in_arcsec(name: str, axis: str, optics: str) -> None:
    setup = {"component": name, "axis": axis, "optics": optics}
    q, got = swept(cell_for(setup, "angle", {"motions": {name: curve(axis)}}), axis)
    np.testing.assert_allclose(got.value, true(axis, q), atol=1e-3)


@pytest.mark.parametrize(("name", "axis", "other"), [("EYX", "X", "EZX"), ("EXZ", "Z", "EYZ"), ("EBX", "X", "ECX")])
def test_the_other_plane_does_not_show(name: str, axis: str, other: str) -> None:
    optics = "angular" if name[1] in "ABC" else "straightness"
    kind = "angle" if optics == "angular" else "straightness"
    setup = {"component": name, "axis": axis, "optics": optics}
    _, got = swept(cell_for(setup, kind, {"motions": {other: curve(axis)}}), axis)
    np.testing.assert_allclose(got.value, 0.0, atol=1e-3)


@pytest.mark.parametrize(("name", "axis", "at"), [("EYX", "X", 0), ("EZX", "X", 1), ("EXZ", "Z", 0), ("EYZ", "Z", 1)])
def test_the_slope_of_straightness_is_the_mountings(name: str, axis: str, at: int) -> None:
    """The reference leans by misalign_mrad across the axis: a slope of that size, and its zero is anybody's."""
    lean = [0.0, 0.0]
    lean[at] = 0.2
    start = -400.0 if axis == "X" else 0.0
    setup = {"component": name, "axis": axis, "optics": "straightness", "misalign_mrad": lean, "datum": start}
    q, got = swept(cell_for(setup, "straightness", {"motions": {name: curve(axis)}}, zero=20.0), axis)
    slope, zero = np.polyfit(q - start, got.value - true(axis, q), 1)
    assert slope == pytest.approx(-0.2, abs=1e-4)
    assert 0.1 < abs(zero) < 20.1


def test_an_offset_carriage_point_adds_the_lever_of_its_angles() -> None:
    """12 mm above the functional point, 4 arcsec of roll move it -12 * 4 arcsec sideways."""
    setup = {"component": "EYX", "axis": "X", "optics": "straightness", "offset_mm": [0.0, 0.0, 12.0]}
    q, got = swept(cell_for(setup, "straightness", {"motions": {"EAX": curve("X")}}), "X")
    np.testing.assert_allclose(got.value, -12.0 * true("X", q) * ARCSEC * 1e3, atol=1e-4)


def square_slopes(own: float, turned: str, lean: float) -> float:
    """Slopes of both runs against one square in arcsec, added."""
    truth = {"locations": {"B0Z": 6.0}}
    total = 0.0
    for axis, datum in (("X", -400.0), ("Z", 0.0)):
        setup = {
            "component": f"B0Z{turned}", "axis": axis, "optics": "square", "datum": datum,
            "own_angle_arcsec": own, "misalign_mrad": [lean, 0.0],
        }  # fmt: skip
        q, got = swept(cell_for(setup, "straightness", truth, zero=5.0), axis)
        total += float(np.polyfit(q, got.value, 1)[0]) * 1e-3 / ARCSEC
    return total


def test_squareness_is_the_sum_of_both_slopes_and_reversal_takes_the_squares_own_angle_out() -> None:
    straight, turned = square_slopes(0.8, "", 0.06), square_slopes(0.8, "-R", -0.04)
    assert straight == pytest.approx(6.0 + 0.8, abs=1e-3)
    assert (straight + turned) / 2.0 == pytest.approx(6.0, abs=1e-3)


def test_the_square_sees_the_angle_between_the_axes_whichever_of_them_leans() -> None:
    total = 0.0
    for axis in "XZ":
        setup = {"component": "B0Z", "axis": axis, "optics": "square"}
        q, got = swept(cell_for(setup, "straightness", {"locations": {"B0Z": 6.0, "B0X": 2.0}}), axis)
        total += float(np.polyfit(q, got.value, 1)[0]) * 1e-3 / ARCSEC
    assert total == pytest.approx(4.0, abs=1e-3)


@pytest.mark.parametrize(("name", "z_axis", "sign"), [("B0C", "B0Z", -1.0), ("A0C", "A0Z", 1.0)])
def test_a_bar_at_two_table_angles_shows_the_tables_axis_against_z(name: str, z_axis: str, sign: float) -> None:
    """B0C: slope of X against the bar = B0Z - B0C; A0C: slope of Y = A0C - A0Z; the bar's own lean turns with C."""
    truth = {"locations": {name: 5.0, z_axis: 2.0}}
    setup = {"component": name, "axis": "Z", "optics": "bar", "tilt_mrad": 0.05, "eccentric_mm": 0.01}
    slopes = []
    for angle in (0.0, 90.0, 180.0, 270.0):
        q, got = swept(cell_for(setup, "straightness", truth, zero=5.0), "Z", C=angle, X=-160.0)
        slopes.append(float(np.polyfit(q, got.value, 1)[0]) * 1e-3 / ARCSEC)
    assert np.mean(slopes) == pytest.approx(sign * (5.0 - 2.0), abs=0.01)
    assert np.mean(slopes[::2]) == pytest.approx(sign * (5.0 - 2.0), abs=0.01)
    assert np.ptp(slopes) == pytest.approx(2.0 * 0.05e-3 / ARCSEC, rel=0.01)


def test_a_ball_off_the_axis_adds_one_wave_a_turn_and_a_leaning_bar_too() -> None:
    setup = {"component": "EXC", "axis": "C", "optics": "ball", "eccentric_mm": 0.01, "offset_mm": [0.0, 0.0, 25.0]}
    q, got = swept(cell_for(setup, "straightness", {"motions": {"EXC": curve("C"), "EBC": curve("C")}}), "C")
    lever = 25.0 * ARCSEC * 1e3
    wanted = (1.0 + lever) * true("C", q) + 10.0 * np.cos(np.deg2rad(q))
    np.testing.assert_allclose(got.value, wanted, atol=2e-3)
    bar = {"component": "EBC", "axis": "C", "optics": "bar", "tilt_mrad": 0.03}
    q, got = swept(cell_for(bar, "angle", {"motions": {"EBC": curve("C")}}), "C")
    wanted = true("C", q) + 0.03e-3 / ARCSEC * np.cos(np.deg2rad(q))
    np.testing.assert_allclose(got.value, wanted, atol=2e-3)


@pytest.mark.parametrize(("name", "along"), [("X0C", 12.0), ("Y0C", -8.0)])
def test_a_balls_mean_place_is_the_tables_axis(name: str, along: float) -> None:
    setup = {"component": name, "axis": "C", "optics": "ball", "eccentric_mm": 0.01, "head": "Z", "zero_um": 0.3}
    truth = {"locations": {"X0C": 12.0, "Y0C": -8.0}}
    _, got = swept(cell_for(setup, "straightness", truth, zero=20.0), "C", X=-160.0, Z=150.0)
    assert np.mean(got.value) == pytest.approx(along + 0.3, abs=0.05)


def test_the_instruments_own_errors_noise_drift_and_zero() -> None:
    setup = {"component": "EYX", "axis": "X", "optics": "straightness"}
    own = [{"kind": "harmonic", "period": 230.0, "amplitude": 0.5}]
    noise = {"sample": 0.2, "drift_per_h": 60.0}
    cell = cell_for(setup, "straightness", {}, own_error=own, noise=noise, zero=20.0)
    q, got = swept(cell, "X")
    rest = got.value - 0.5 * np.cos(2.0 * np.pi * q / 230.0) - got.time_s / 60.0
    assert np.std(rest) == pytest.approx(0.2, rel=0.1)
    assert 0.1 < abs(np.mean(rest)) < 20.0
    np.testing.assert_array_equal(swept(cell, "X")[1].value, got.value)


def test_wrong_optics_or_a_broken_beam_give_no_light() -> None:
    setup = {"component": "EYX", "axis": "X", "optics": "straightness"}
    cell = cell_for(setup, "straightness", {"motions": {"EYX": curve("X")}})
    _, got = swept(cell, "X", wrong="angular")
    assert not got.beam.any()
    bench = OpticsBench(Truth(cell), Motion(X1=[(0.0, 0.0), (10.0, 100.0)]))
    reader = SensorReader(next(s for s in cell.instruments if isinstance(s, Sensor)), bench)
    assert reader.reported_optics(bench.mounted("sensor")) == "unknown"
    assert not reader.read(1.0).beam.any()
    bench.mount(cell.setups[0])
    assert reader.read(2.0).beam.all()
    assert reader.reported_optics(bench.mounted("sensor")) == "straightness"
    bench.broken.add("sensor")
    dark = reader.read(3.0)
    assert not dark.beam.any()
    assert np.ptp(dark.value) == 0.0
    bench.broken.discard("sensor")
    assert not reader.read(4.0).beam.any()  # counts may be missing until the next datum
    reader.restore_beam()
    assert reader.read(5.0).beam.all()


def test_beyond_its_range_there_is_no_light() -> None:
    setup = {"component": "EYX", "axis": "X", "optics": "straightness", "misalign_mrad": [1.0, 0.0], "datum": -400.0}
    q, got = swept(cell_for(setup, "straightness", {}, range=100.0), "X")
    assert got.beam[q < -305.0].all()
    assert not got.beam[q > -295.0].any()


def test_the_demo_cell_has_a_set_up_for_every_error_of_the_machine() -> None:
    cell = load_cell("demo")
    have = {(setup.component, setup.axis) for setup in cell.setups}
    wanted = {(f"E{to}{axis}", axis) for axis in "XZC" for to in "XYZABC"}
    wanted |= {("B0Z", "X"), ("B0Z", "Z"), ("B0Z-R", "X"), ("B0Z-R", "Z"), ("A0C", "Z"), ("B0C", "Z")}
    assert wanted <= have


def test_a_machine_that_stands_is_not_asked_again_but_followed_within_5_nm() -> None:
    """X wanders by a nanometre a second under a ball: asked often or once, an instrument tells the same."""
    base = plain_cell()
    axes = [axis | ({"drift_per_h": 3.6} if axis["letter"] == "X" else {}) for axis in base["axes"]]  # type: ignore[attr-defined]
    sensor = {"kind": "straightness", "name": "sensor", "zero": 0.0}
    setup = {"component": "EXC", "axis": "C", "instrument": "sensor", "optics": "ball"}
    truth = {"motions": {"EXC": curve("C")}}
    cell = CellFile.model_validate(plain_cell(axes=axes, instruments=[sensor], setups=[setup], truth=truth))

    def told(asked: list[float]) -> list[float]:
        bench = OpticsBench(Truth(cell), Motion(C1=[(0.0, 10.0), (20.0, 10.0), (21.0, 70.0), (90.0, 70.0)]))
        bench.mount(cell.setups[0])
        reader = SensorReader(cell.instruments[0], bench)  # type: ignore[arg-type]
        return [float(reader.read(at).value[-1]) for at in asked]

    often = dict(enumerate(told(np.arange(0.5, 80.1, 0.5).tolist())))
    for second in (10.0, 25.0, 80.0):
        (once,) = told([second])
        assert often[round(2.0 * second) - 1] == pytest.approx(once, abs=0.005)
    assert often[159] - often[49] == pytest.approx(0.055, abs=0.005)
