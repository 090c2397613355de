"""Measured points to a record: A, B, G found again within what is stated, heights, glitches, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from drivers.errors import TrueflankError
from drivers.types.gears import GearInspection
from gateway.correct.part.fitted_places import guard_flanks
from gateway.correct.part.inspected import InspectionSource, along_face, check_gear, inspected_flank
from gateway.gear.cycloid import CycloidGear
from gateway.tooth import FlankMap, InspectedFlank
from tests.unit.gear.machines import RV40E

ARCSEC = np.pi / 648000.0
NOISE_UM = 0.2
HEIGHTS = (-4.5, -1.7, 0.3, 4.2)
ABOUT = InspectionSource("part", clamping_um=0.0)


def abg(k: np.ndarray, z: np.ndarray) -> np.ndarray:
    """A, B (mm), G (rad) that change from space to space and along the face in straight lines; last axis 3."""
    turn = 2.0 * np.pi * k / 39.0
    A = 0.004 + 0.0015 * np.cos(3.0 * turn) + 0.0003 * z
    B = -0.002 + 0.001 * np.sin(2.0 * turn) - 0.0002 * z * np.cos(turn)
    G = (6.0 * np.cos(turn) + 4.0 * np.sin(5.0 * turn) + 0.3 * z) * ARCSEC
    return np.stack(np.broadcast_arrays(A, B, G), axis=-1)


def along(gear: CycloidGear, theta: np.ndarray, terms: np.ndarray) -> np.ndarray:
    s = gear.section(theta)
    return np.asarray(terms[..., 0] * s.nx + terms[..., 1] * s.ny + terms[..., 2] * s.h)


@cache
def places(heights: tuple[float, ...] = HEIGHTS, points: int = 9) -> tuple[np.ndarray, ...]:
    """Space, profile angle and height of every point: lines on both flanks."""
    half = RV40E.theta_at((np.arange(points) + 0.5) / points * 0.95 * RV40E.limits().half_lobe_arc)
    grids = np.meshgrid(np.arange(39.0), np.concatenate([-half[::-1], half]), heights, indexing="ij")
    return tuple(grid.ravel() for grid in grids)


def points_of(k: np.ndarray, theta: np.ndarray, z: np.ndarray, e: np.ndarray) -> GearInspection:
    """As a machine gives them: points in the part frame, heights from the lower face."""
    s = RV40E.space(theta, k)
    xyz = np.column_stack([s.x + e * s.nx, s.y + e * s.ny, z + 0.5 * RV40E.b])
    return GearInspection(xyz, k.astype(np.int64), np.sign(theta).astype(np.int64), None, NOISE_UM)


def measured(seed: int, heights: tuple[float, ...] = HEIGHTS, points: int = 9) -> GearInspection:
    k, theta, z = places(heights, points)
    e = along(RV40E, theta, abg(k, z)) + np.random.default_rng(seed).normal(0.0, NOISE_UM / 1000.0, k.size)
    return points_of(k, theta, z, e)


def true_map(flank: FlankMap) -> np.ndarray:
    """um on the judged grid, one rotation removed."""
    k, theta, z = np.arange(39.0)[:, None, None], flank.theta_rad[:, None], flank.z_mm
    e = 1000.0 * along(RV40E, theta, abg(k, z))
    lever = np.broadcast_to(RV40E.section(theta).h, e.shape)
    return np.asarray(e - lever * np.sum(lever * e) / np.sum(lever**2))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_what_made_the_flank_is_found_within_what_is_stated() -> None:
    """Errors over their stated uncertainty have a standard deviation of 1, places and map alike."""
    place_pulls, map_pulls, stated = [], [], []
    for seed in range(6):
        found = inspected_flank(RV40E, measured(seed), ABOUT)
        truth = abg(found.place_k, found.place_z_mm) * np.array([1000.0, 1000.0, 1.0 / ARCSEC])
        error = found.abg - truth
        error[:, 2] -= np.mean(error[:, 2])  # the rotation of the whole gear is nobody's
        place_pulls.append(error / found.abg_u)
        map_pulls.append(rms(found.fitted.deviation_um - true_map(found.fitted)) / found.rms_u_um)
        stated.append(found.fitted.rms_um)
        assert found.fitted.rms_um == pytest.approx(rms(true_map(found.fitted)), abs=found.rms_u_um)
    assert 0.8 < rms(np.array(place_pulls)) < 1.2
    assert 0.8 < rms(np.array(map_pulls)) < 1.2
    assert np.std(stated) > 0.0
    assert found.u_um == pytest.approx(NOISE_UM, rel=0.05)


def test_heights_count_from_the_lower_face() -> None:
    """A is larger at the upper end by 0.3 um a mm; the same points counted from the middle are the same flank."""
    found = inspected_flank(RV40E, measured(1), ABOUT)
    bottom = found.fitted.deviation_um[:, np.argmin(np.abs(found.fitted.theta_rad)), :].mean(axis=0)
    assert np.polyfit(found.fitted.z_mm, bottom, 1)[0] == pytest.approx(0.3, abs=0.03)
    given = measured(1)
    middle = replace(given, points_mm=given.points_mm - [0.0, 0.0, 5.0])
    same = inspected_flank(RV40E, middle, replace(ABOUT, heights="middle"))
    np.testing.assert_allclose(same.fitted.deviation_um, found.fitted.deviation_um, atol=1e-6)
    with pytest.raises(TrueflankError, match="E-INSPECT-HEIGHT"):
        inspected_flank(RV40E, middle, ABOUT)


def test_a_turned_clamping_and_deviations_beside_nominal_points_change_nothing() -> None:
    given = measured(2)
    plain = inspected_flank(RV40E, given, ABOUT)
    by = 40.0 * ARCSEC
    turned = given.points_mm @ np.array(
        [[np.cos(by), np.sin(by), 0.0], [-np.sin(by), np.cos(by), 0.0], [0.0, 0.0, 1.0]]
    )
    again = inspected_flank(RV40E, replace(given, points_mm=turned), ABOUT)
    np.testing.assert_allclose(again.fitted.deviation_um, plain.fitted.deviation_um, atol=1e-3)
    k, theta, _ = places()
    s = RV40E.space(theta, k)
    nominal = np.column_stack([s.x, s.y, given.points_mm[:, 2]])
    e = np.sum((given.points_mm - nominal)[:, :2] * np.column_stack([s.nx, s.ny]), axis=1)
    beside = replace(given, points_mm=nominal, deviation_um=1000.0 * e)
    same = inspected_flank(RV40E, beside, ABOUT)
    np.testing.assert_allclose(same.fitted.deviation_um, plain.fitted.deviation_um, atol=1e-6)
    with pytest.raises(TrueflankError, match="E-INSPECT-NOMINAL"):
        inspected_flank(RV40E, replace(beside, points_mm=nominal * [1.003, 1.003, 1.0]), ABOUT)


def test_an_eccentric_clamping_stays_within_what_it_is_said_to_be() -> None:
    given = measured(3)
    plain = inspected_flank(RV40E, given, replace(ABOUT, clamping_um=0.5))
    far = inspected_flank(RV40E, replace(given, points_mm=given.points_mm + np.array([2.5e-4, 0.0, 0.0])), ABOUT)
    moved = rms(far.fitted.deviation_um - plain.fitted.deviation_um)
    assert 0.1 < moved < plain.rms_u_um
    assert plain.rms_u_um > 2.0 * far.rms_u_um
    assert any("(within 0.5 µm" in line for line in map(str, plain.said))


def test_glitches_and_points_that_tell_nothing_are_left_out_and_counted() -> None:
    given = measured(4)
    k, theta, _ = places()
    xyz = given.points_mm.copy()
    wild = np.array([100, 2000, 2001, 2500])
    s = RV40E.space(theta[wild], k[wild])
    xyz[wild, :2] += 0.025 * np.column_stack([s.nx, s.ny]) * np.array([1.0, -1.0, 1.0, 1.0])[:, None]
    lead = points_of(
        np.full(8, 3.0), np.full(8, 0.03), np.array([-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 3.5]), np.zeros(8)
    )
    both = GearInspection(
        np.concatenate([xyz, lead.points_mm]),
        np.concatenate([given.space, lead.space]),
        np.concatenate([given.flank, lead.flank]),
    )
    found = inspected_flank(RV40E, both, ABOUT)
    plain = inspected_flank(RV40E, given, ABOUT)
    assert found.k.size == plain.k.size - wild.size
    assert "outliers excluded: 4" in map(str, found.said)
    assert any(line.startswith("points excluded") and line.endswith(": 8") for line in map(str, found.said))
    assert any("the probing uncertainty is not stated" in line for line in map(str, found.said))
    assert np.max(np.abs(found.fitted.deviation_um - plain.fitted.deviation_um)) < 0.3
    assert found.u_um == pytest.approx(NOISE_UM, rel=0.05)
    noisy = given.points_mm.copy()
    noisy[::12] += [0.02, 0.0, 0.0]
    with pytest.raises(TrueflankError, match="E-INSPECT-G"):
        inspected_flank(RV40E, replace(given, points_mm=noisy), ABOUT)


def other_gear() -> GearInspection:
    k, theta, z = places()
    s = replace(RV40E, rrp=3.12, a=1.27).space(theta, k)
    given = measured(5)
    return replace(given, points_mm=np.column_stack([s.x, s.y, z + 5.0]))


def without(here: np.ndarray) -> GearInspection:
    given = measured(5)
    return replace(given, points_mm=given.points_mm[here], space=given.space[here], flank=given.flank[here])


K, THETA, Z = places()
WRONG: list[tuple[str, GearInspection, str]] = [
    ("another gear", other_gear(), "E-INSPECT-GEAR"),
    ("two spaces not ground", points_of(K, THETA, Z, np.where(K < 2.0, 0.08, 0.0)), "E-INSPECT-GEAR"),
    ("a space missing", without(K != 7.0), "E-INSPECT-SPACES"),
    ("a flank of it missing", without((K != 7.0) | (THETA > 0.0)), "E-INSPECT-SPACES"),
    ("one height only", without(np.isclose(Z, HEIGHTS[0])), "E-INSPECT-SPACES"),
    ("no points", without(K < 0.0), "E-INSPECT-EMPTY"),
    ("not a number", replace(measured(5), points_mm=measured(5).points_mm * np.nan), "E-GEAR-POINT"),
    ("flanks exchanged", replace(measured(5), flank=-measured(5).flank), "E-INSPECT-SIDES"),
    ("one too many", replace(measured(5), space=measured(5).space + (K > 20.0)), "E-INSPECT-NUMBERS"),
]


@pytest.mark.parametrize(("given", "code"), [case[1:] for case in WRONG], ids=[case[0] for case in WRONG])
def test_what_is_no_inspection_of_this_gear_is_refused(given: GearInspection, code: str) -> None:
    with pytest.raises(TrueflankError) as caught:
        inspected_flank(RV40E, given, ABOUT)
    assert caught.value.code == code


def test_numbers_may_begin_elsewhere_and_another_gear_is_told_by_one_height() -> None:
    given = measured(5)
    found = inspected_flank(RV40E, replace(given, space=np.mod(given.space + 1, 39)), ABOUT)
    assert any("space 0 is space 38" in line for line in map(str, found.said))
    check_gear(RV40E, without(np.isclose(Z, HEIGHTS[0])))
    with pytest.raises(TrueflankError, match="E-INSPECT-GEAR"):
        check_gear(RV40E, other_gear())


def test_values_run_straight_between_heights_and_on_beyond() -> None:
    measured_at, wanted = np.array([3.0, -4.0, 0.5]), np.linspace(-5.0, 5.0, 21)
    weights = along_face(measured_at, wanted)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    np.testing.assert_allclose(weights @ (2.0 - 0.7 * measured_at), 2.0 - 0.7 * wanted, atol=1e-12)
    np.testing.assert_allclose(along_face(measured_at, measured_at), np.eye(3), atol=1e-12)


def test_figures_are_those_of_the_errors_put_in() -> None:
    """A alone, 4 um: the profile's total deviation is 4 um times the range of n_x; a taper of 0.3 um/mm over 8 mm."""
    k, theta, z = places()
    flat = inspected_flank(RV40E, points_of(k, theta, z, 0.004 * RV40E.section(theta).nx), ABOUT)
    span = 4.0 * np.ptp(RV40E.section(np.unique(np.abs(theta))).nx)
    assert flat.figures["F_alpha"] == pytest.approx(span, abs=1e-3)
    assert flat.figures["F_beta"] == pytest.approx(0.0, abs=1e-6)
    assert flat.figures["F_p"] == pytest.approx(0.0, abs=1e-6)
    taper = inspected_flank(RV40E, points_of(k, theta, z, 0.0003 * z * RV40E.section(theta).nx), ABOUT)
    arcs = RV40E.arc(taper.fitted.theta_rad)
    half = taper.fitted.theta_rad[np.argmin(np.abs(arcs - 0.5 * RV40E.limits().half_lobe_arc))]
    assert taper.figures["f_Hbeta"] == pytest.approx(0.3 * 8.0 * float(RV40E.section(half).nx), rel=1e-3)


def moved(flank: InspectedFlank, infeed_um: float) -> InspectedFlank:
    e = flank.deviation_um + infeed_um * RV40E.section(flank.theta_rad).nx
    return replace(flank, deviation_um=e)


def test_gears_alone_guard_the_machine() -> None:
    approved, now = (inspected_flank(RV40E, measured(seed), ABOUT) for seed in (6, 7))
    assert guard_flanks(approved, now, RV40E, 2.0).answer == "still valid"
    deeper = guard_flanks(approved, moved(now, -4.0), RV40E, 2.0)
    assert deeper.answer == "re-measure this axis"
    assert any("infeed (A), all spaces changed by -4.0" in line for line in map(str, deeper.said))
    for other in (measured(7, HEIGHTS, 11), measured(7, (-4.5, 0.3, 4.2)), measured(7, (-4.5, -1.7, 0.9, 4.2))):
        verdict = guard_flanks(approved, inspected_flank(RV40E, other, ABOUT), RV40E, 2.0)
        assert verdict.answer == "cannot tell"
        assert any("same points" in line for line in map(str, verdict.said))
