"""Straightness, squareness, parallelism, angular motions, rotary error motions and the location of a rotary axis."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import linprog

from gateway.domain.figures import Component
from gateway.errors import ModelError
from gateway.evaluate.geometry import angular, axis_location, rotary_motion, straightness
from gateway.evaluate.geometry import rotary_motion as harmonics
from gateway.evaluate.geometry import straightness as squareness
from gateway.evaluate.geometry.straightness import StraightnessRun
from gateway.evaluate.standards import iso230_2
from gateway.model.fit import fit_positioning

ARCSEC = np.pi / 180.0 / 3600.0


def narrowest(x: np.ndarray, y: np.ndarray) -> float:
    """The minimum zone as a linear programme: least w with |y - a - b x| <= w / 2."""
    one = np.ones_like(x)
    rows = np.vstack([np.column_stack([-one, -x, -one / 2]), np.column_stack([one, x, -one / 2])])
    free = [(None, None), (None, None), (0, None)]
    return float(linprog([0, 0, 1], A_ub=rows, b_ub=np.concatenate([-y, y]), bounds=free).x[2])


@settings(max_examples=60, deadline=None)
@given(st.integers(2, 15).flatmap(lambda m: arrays(np.float64, m, elements=st.floats(-20, 20, width=16))))
def test_minimum_zone_is_exact_and_never_wider_than_the_others(y: np.ndarray) -> None:
    x = np.cumsum(1.0 + np.arange(y.size) % 3)
    zone, lsq, ends = (straightness.straightness(x, y, r).value for r in ("minimum-zone", "lsq", "end-point"))
    assert zone == pytest.approx(narrowest(x, y), abs=1e-7)
    assert zone <= lsq + 1e-9
    assert zone <= ends + 1e-9
    tilted = straightness.straightness(x, y + 3.0 * x - 7.0, "minimum-zone")
    assert tilted.value == pytest.approx(zone, abs=1e-9)


def test_minimum_zone_of_many_points_and_of_repeated_positions() -> None:
    rng = np.random.default_rng(4)
    x = np.sort(rng.uniform(0, 500, 5000))
    y = np.sin(x / 80.0) + rng.normal(0, 0.1, x.size)
    assert straightness.straightness(x, y).value == pytest.approx(narrowest(x, y), abs=1e-7)
    again = np.repeat(x[:40], 5)
    z = rng.normal(size=200)
    assert straightness.straightness(again, z).value == pytest.approx(narrowest(again, z), abs=1e-8)


def test_straightness_splits_into_datum_squareness_and_motion() -> None:
    q = np.linspace(-200.0, 200.0, 9)
    curve = 5e-8 * q**2
    curve -= curve.mean()
    found = straightness.straightness(q, curve + 0.001 + 2e-5 * q, "lsq")
    assert (found.intercept, found.slope) == pytest.approx((0.001, 2e-5), rel=1e-9)
    np.testing.assert_allclose(found.residual, curve, atol=1e-12)
    ends = straightness.straightness(q, curve + 2e-5 * q, "end-point")
    assert ends.slope == pytest.approx(2e-5)
    assert ends.residual[0] == pytest.approx(0.0, abs=1e-15)


def test_lines_that_cannot_be_laid_are_refused() -> None:
    for x, y in (([0.0], [1.0]), ([1.0, 1.0], [0.0, 1.0]), ([0.0, 1.0], [0.0]), ([0.0, 1.0], [0.0, np.nan])):
        with pytest.raises(ModelError, match="E-EVAL-LINE"):
            straightness.straightness(x, y)


def test_parallelism_has_its_own_uncertainty() -> None:
    rng, x = np.random.default_rng(6), np.linspace(0.0, 400.0, 21)
    hits = 0
    for _ in range(300):
        runs = [(x, slope * x + rng.normal(0.0, 0.5, x.size)) for slope in (0.012, 0.004)]
        found = straightness.parallel(*runs)
        hits += abs(found.slope - 0.008) <= found.U
    assert hits / 300 == pytest.approx(0.945, abs=0.035)
    assert found.over(300.0) == pytest.approx(abs(found.slope) * 300.0)
    assert np.isnan(straightness.parallel((x[:2], [0, 1]), (x[:2], [0, 2])).U)


@pytest.mark.parametrize(("plane", "name"), [("XY", "EC0Y"), ("XZ", "EB0Z"), ("YZ", "EA0Z")])
def test_squareness_of_each_plane_is_a_right_handed_rotation_of_the_second_axis(plane: str, name: str) -> None:
    angle, lengths = 30e-6, (400.0, 300.0)
    axes = [np.eye(3)["XYZ".index(letter)] for letter in plane]
    about = np.eye(3)["ABC".index(name[1])]
    turned = axes[1] + np.cross(angle * about, axes[1])
    p, q = lengths[0] * axes[0], lengths[1] * turned
    above = squareness.from_face_diagonals(float(np.linalg.norm(p + q)), float(np.linalg.norm(p - q)), *lengths)
    found = squareness.of_plane(plane, above)
    assert (found.name, found.value_rad) == (name, pytest.approx(angle, rel=1e-6))
    assert found.value_arcsec == pytest.approx(angle / ARCSEC, rel=1e-6)
    with pytest.raises(ModelError, match="E-EVAL-PLANE"):
        squareness.of_plane("XX", 0.0)


def test_turning_the_square_separates_its_own_angle() -> None:
    x = np.linspace(0.0, 300.0, 7)
    u = np.full(7, 1e-4)
    one = [StraightnessRun(x, (-2e-5 + e) / 2 * x, u, direction_u=4e-7) for e in (3e-5, -3e-5)]
    found = squareness.reversed_square(*(squareness.from_runs(run, run) for run in one))
    assert (found.C0Y, found.own) == pytest.approx((2e-5, 3e-5))
    slope_u = 1e-4 / np.sqrt(np.sum((x - x.mean()) ** 2))
    assert found.u == pytest.approx(np.hypot(slope_u, 4e-7))
    bent = StraightnessRun(x, 1e-3 * np.cos(x / 20.0))
    left = straightness.straightness(x, bent.deviations, "lsq").residual
    assert bent.direction()[1] == pytest.approx(straightness.slope_u(x, left))


def test_angular_motions_by_their_letters() -> None:
    assert [angular.component(*at) for at in (("X", "pitch"), ("X", "yaw"), ("Y", "pitch"), ("Z", "roll"))] == [
        "EBX", "ECX", "EAY", "ECZ",
    ]  # fmt: skip
    x = np.random.default_rng(5).normal(size=(6, 5, 2))
    found = angular.angular_motion("Z", "tilt about X", np.arange(6.0), x, sense=-1)
    turned = iso230_2.evaluate_iso230_2(np.arange(6.0), -x, "arcsec")
    assert found.component == "EAZ"
    assert found.evaluation.E == turned.E
    np.testing.assert_array_equal(found.evaluation.mean_up, turned.mean_up)
    assert found.E_urad == pytest.approx(4.848 * found.evaluation.E, rel=1e-4)
    assert "ISO 230-1" in found.evaluation.standard
    for wrong in (("Z", "pitch"), ("C", "yaw")):
        with pytest.raises(ModelError, match="E-EVAL-ANGULAR"):
            angular.component(*wrong)


ANGLES = np.arange(0.0, 360.0, 5.0)


def turns(amplitude: float, order: int, asynchronous: float = 0.0, n: int = 20) -> np.ndarray:
    steps = np.linspace(-0.5, 0.5, n)[:, None] * asynchronous
    return amplitude * np.cos(order * np.radians(ANGLES)) + steps


def test_radial_motion_loses_eccentricity_and_keeps_lobes() -> None:
    found = rotary_motion.radial_fixed(ANGLES, turns(1.5, 3, 0.4) + turns(20.0, 1) + 7.0)
    assert found.synchronous == pytest.approx(3.0, rel=2e-3)
    assert found.asynchronous == pytest.approx(0.4)
    assert found.total == pytest.approx(3.4, rel=2e-3)
    assert found.fundamental.amplitude == pytest.approx(20.0)
    assert found.removed
    assert "reversal" in found.flags[-1]


def test_axial_motion_keeps_its_fundamental() -> None:
    found = rotary_motion.axial(ANGLES, turns(1.0, 2) + turns(4.0, 1) - 3.0)
    assert found.fundamental.amplitude == pytest.approx(4.0)
    assert found.residual_synchronous == pytest.approx(2.0, rel=2e-3)
    assert found.synchronous == pytest.approx(np.ptp(turns(1.0, 2)[0] + turns(4.0, 1)[0]))
    assert not found.removed


def test_rotating_direction_sees_what_turns_with_the_axis_as_constant() -> None:
    c = np.radians(ANGLES)
    eccentric = (20.0 * np.cos(c + 0.3), 20.0 * np.sin(c + 0.3))
    lobe = 1.5 * np.cos(3 * c)
    x, y = (np.tile(e + lobe * d, (20, 1)) for e, d in zip(eccentric, (np.cos(c), np.sin(c)), strict=True))
    found = rotary_motion.radial_rotating(ANGLES, x, y)
    assert found.synchronous == pytest.approx(3.0, rel=2e-3)
    assert found.asynchronous == pytest.approx(0.0, abs=1e-12)


def test_tilt_is_the_difference_over_the_distance() -> None:
    found = rotary_motion.tilt(ANGLES, turns(1.5, 2), turns(0.5, 2), 100.0)
    assert found.unit == "arcsec"
    assert found.synchronous == pytest.approx(2.0e-3 / 100.0 / ARCSEC)


def test_turns_with_gaps_are_flagged_and_wrong_ones_refused() -> None:
    x = turns(1.0, 2, n=3)
    x[1, 4] = np.nan
    assert rotary_motion.axial(ANGLES, x).flags == ("3 turns, 20 are usual", "readings missing: 1")
    single = rotary_motion.axial(ANGLES, x[:1])
    assert single.asynchronous is None
    assert single.flags == ("1 turn: no asynchronous value",)
    x[:, 4] = np.nan
    for wrong in (x, x[0], np.zeros((2, 5))):
        with pytest.raises(ModelError, match="E-EVAL-TURNS"):
            rotary_motion.axial(ANGLES, wrong)
    with pytest.raises(ModelError, match="0 and 360"):
        rotary_motion.axial([0.0, 90.0, 180.0, 270.0, 360.0], np.zeros((2, 5)))
    for call in (
        lambda: rotary_motion.tilt(ANGLES, turns(1, 2), turns(1, 2), 0.0),
        lambda: rotary_motion.radial_rotating(ANGLES, turns(1, 2), turns(1, 2, n=3)),
    ):
        with pytest.raises(ModelError, match="E-EVAL-TURNS"):
            call()


def ring(axis: str, height: float, lean: dict[str, float], place: dict[str, float], angles: np.ndarray) -> np.ndarray:
    """Where a ball 50 mm off a leaning axis goes, from the rotation itself (rodrigues), not from the room's formula."""
    w = "ABC".index(axis)
    rotation = np.array([lean.get(letter, 0.0) for letter in "ABC"])
    n = np.eye(3)[w] + np.cross(rotation, np.eye(3)[w])
    n /= np.linalg.norm(n)
    foot = np.array([place.get(letter, 0.0) for letter in "XYZ"]) + height * n
    arm = np.cross(n, np.eye(3)[(w + 1) % 3])
    arm *= 50.0 / np.linalg.norm(arm)
    other = np.cross(n, arm)
    return foot + np.outer(np.cos(angles), arm) + np.outer(np.sin(angles), other)


def read(axis: str, angles: np.ndarray, points: np.ndarray) -> dict[str, Component]:
    """The points (k, 3) in mm as fitted readings by direction, um."""
    at, across = np.degrees(angles), [letter for letter in "XYZ" if "ABC"["XYZ".index(letter)] != axis]
    fit = partial(fit_positioning, axis=axis, axis_unit="deg", kind="rotary", modulo=True)
    return {letter: fit(at, 1e3 * points[:, "XYZ".index(letter)], 1.0, name=f"{letter}0{axis}") for letter in across}


@pytest.mark.parametrize("axis", ["A", "B", "C"])
@pytest.mark.parametrize("angles", [np.arange(0.0, 6.2, 0.4), np.array([0.0, 0.5, 1.0, 1.5]) * np.pi])
def test_location_of_a_rotary_axis_by_its_letters(axis: str, angles: np.ndarray) -> None:
    letters = [letter for letter in "ABC" if letter != axis]
    lean = dict(zip(letters, (40e-6, -25e-6), strict=True))
    place = dict(zip([letter for letter in "XYZ" if "ABC"["XYZ".index(letter)] != axis], (0.012, -0.034), strict=True))
    runs = [(h, read(axis, angles, ring(axis, h, lean, place, angles))) for h in (50.0, 150.0, 300.0)]
    found = axis_location.from_ball(axis, runs).values
    for letter, value in lean.items():
        assert found[f"E{letter}0{axis}"] == pytest.approx(value / ARCSEC, rel=1e-4)
    for letter, value in place.items():
        assert found[f"E{letter}0{axis}"] == pytest.approx(1e3 * value, abs=1e-3)


def test_signs_of_the_reference() -> None:
    angles = np.arange(0.0, 6.2, 0.4)
    places = ((0.0, 0.0, 0.0), (100.0, 0.002, 0.003))
    runs = [(h, read("C", angles, ring("C", h, {}, {"X": x, "Y": y}, angles))) for h, x, y in places]
    found = axis_location.from_ball("C", runs)
    assert found.values["EA0C"] == pytest.approx(-0.003 / 100.0 / ARCSEC, rel=1e-3)
    assert found.values["EB0C"] == pytest.approx(0.002 / 100.0 / ARCSEC, rel=1e-3)
    assert "two heights" in str(found.flags[0])
    one = axis_location.from_ball("C", runs[1:])
    assert set(one.values) == {"EX0C", "EY0C"}
    assert [*map(str, one.flags)] == ["one height: no orientation"]
    alone = axis_location.from_ball("C", [(0.0, {"Y": runs[1][1]["Y"]})])
    assert alone.values == pytest.approx({"EY0C": 3.0}, abs=1e-3)


def test_uncertainty_of_a_location_covers() -> None:
    rng, angles = np.random.default_rng(7), np.arange(0.0, 6.2, 0.4)
    hits = dict.fromkeys(("EX0C", "EY0C", "EA0C", "EB0C"), 0)
    for _ in range(60):
        noisy = [(h, ring("C", h, {"A": 4e-5}, {"X": 0.01}, angles)) for h in (50.0, 150.0, 300.0)]
        runs = [(h, read("C", angles, points + rng.normal(0, 1e-3, points.shape))) for h, points in noisy]
        found = axis_location.from_ball("C", runs)
        true = {"EX0C": 10.0, "EY0C": 0.0, "EA0C": 4e-5 / ARCSEC, "EB0C": 0.0}
        for name, value in true.items():
            hits[name] += abs(found.values[name] - value) <= found.U[name]
    assert all(count >= 54 for count in hits.values()), hits


def test_a_turned_bar_gives_the_lean_without_its_own() -> None:
    h = np.linspace(0.0, 200.0, 9)
    a, b, bar = 30e-6, -20e-6, 90e-6
    first = tuple(StraightnessRun(h, (b + sign * bar) * h + 0.005) for sign in (1, -1))
    second = tuple(StraightnessRun(h, (-a + sign * bar / 2) * h) for sign in (1, -1))
    found = axis_location.from_bar("C", {"X": first, "Y": second})
    assert found.values["EB0C"] == pytest.approx(b / ARCSEC)
    assert found.values["EA0C"] == pytest.approx(a / ARCSEC)
    assert found.U["EA0C"] == pytest.approx(0.0, abs=1e-6)
    assert found.artefact == pytest.approx({"X": bar / ARCSEC, "Y": bar / 2 / ARCSEC})


def test_locations_that_cannot_be_found_are_refused() -> None:
    angles = np.arange(0.0, 6.2, 0.4)
    readings = read("C", angles, ring("C", 0.0, {}, {}, angles))
    run = StraightnessRun(np.arange(3.0), np.zeros(3))
    for call in (
        lambda: axis_location.from_ball("C", []),
        lambda: axis_location.from_ball("X", [(0.0, readings)]),
        lambda: axis_location.from_ball("C", [(0.0, {"Z": readings["X"]})]),
        lambda: axis_location.from_bar("C", {"Z": (run, run)}),
    ):
        with pytest.raises(ModelError, match="E-EVAL-LOCATION"):
            call()
    with pytest.raises(ModelError, match="E-EVAL-LINE"):
        axis_location.from_bar("C", {"X": (run, StraightnessRun(np.zeros(3), np.zeros(3)))})


def test_harmonics_of_wrong_shapes_are_refused() -> None:
    with pytest.raises(ModelError, match="E-EVAL-LINE"):
        harmonics.harmonics([0.0, 90.0], [1.0], (1,))
    with pytest.raises(ModelError, match="E-EVAL-LINE"):
        harmonics.harmonics([0.0, 90.0, 180.0], [1.0, np.nan, 0.0], (1,))
