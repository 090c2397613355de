"""The gear inspection machine: points of the true flank as clamped, its noise, and what it may do wrong."""

from __future__ import annotations

import numpy as np
import pytest

from simulators.cellfile import InspectionMachine
from simulators.grinding import CycloidDisc, WorkPiece
from simulators.inspection import GearMachine, TouchedPoints
from simulators.truth import Truth
from tests.unit.simulators.planned_run import ground
from tests.unit.simulators.test_grinding import ARCSEC, cell_of

WAVE = {"ECC": [{"kind": "harmonic", "order": 3, "amplitude": 6.0}], "EXX": 2.0}
SHAPE = (39, 8, 3)


@pytest.fixture(scope="module")
def work() -> WorkPiece:
    cell = cell_of(WAVE)
    return ground(Truth(cell), cell.part)


def machine(seed: int = 1, **options: object) -> GearMachine:
    plain = {"kind": "gear", "name": "gear", "noise_um": 0.0, "clamping": {}}
    return GearMachine(InspectionMachine.model_validate(plain | options), seed)


def on_grid(touches: TouchedPoints) -> np.ndarray:
    return touches.deviation_um.reshape(SHAPE)


def grid(work: WorkPiece) -> tuple[np.ndarray, np.ndarray]:
    return work.lobes.even(8), np.linspace(-5.0, 5.0, 3)


def test_a_perfect_machine_gives_the_true_surplus_and_points_on_the_flank(work: WorkPiece) -> None:
    got = machine().inspect(work, 4, 3)
    t, z = grid(work)
    np.testing.assert_allclose(on_grid(got), work.surplus_um(np.arange(39), t, z), atol=1e-6)
    rays = work.lobes.rays(5, t, z)
    here = got.space == 5
    np.testing.assert_allclose(got.points_mm[here], rays.points + 1e-3 * got.deviation_um[here, None] * rays.directions)
    left = got.points_mm[(got.space == 0) & (got.flank == 1)]
    assert np.all(left[:, 1] > 0.0)
    assert np.all(got.points_mm[(got.space == 0) & (got.flank == -1), 1] < 0.0)
    assert len(got.space) == 39 * 2 * 4 * 3


def test_clamping_shows_as_eccentricity_and_rotation(work: WorkPiece) -> None:
    """As clamped off by (u, v) and turned by g: u n_x + v n_y + g h more than the part has, to first order."""
    plain = on_grid(machine().inspect(work, 4, 3))
    got = on_grid(machine(clamping={"eccentric_um": 4.0, "turned_arcsec": 20.0}).inspect(work, 4, 3)) - plain
    rays = [work.lobes.rays(k, *grid(work)) for k in range(39)]
    n = np.concatenate([ray.directions for ray in rays])
    p = np.concatenate([ray.points for ray in rays])
    design = np.stack((n[:, 0], n[:, 1], p[:, 0] * n[:, 1] - p[:, 1] * n[:, 0]), axis=1)
    found, *_ = np.linalg.lstsq(design, got.ravel(), rcond=None)
    assert 2.0 <= np.hypot(found[0], found[1]) <= 4.0
    assert 1e-3 < abs(found[2]) <= 20.0 * ARCSEC * 1e3
    assert np.max(np.abs(got.ravel() - design @ found)) < 0.1  # curvature of a flank turned under the probe


def test_each_inspection_clamps_anew_and_a_seed_repeats_all(work: WorkPiece) -> None:
    options = {"noise_um": 0.2, "clamping": {"eccentric_um": 2.0}}
    one, other = machine(7, **options), machine(7, **options)
    first = one.inspect(work, 4, 3)
    np.testing.assert_array_equal(first.points_mm, other.inspect(work, 4, 3).points_mm)
    assert np.max(np.abs(one.inspect(work, 4, 3).deviation_um - first.deviation_um)) > 1.0


def test_noise_is_as_large_as_it_says(work: WorkPiece) -> None:
    off = machine(3, noise_um=0.2).inspect(work, 4, 3).deviation_um - machine().inspect(work, 4, 3).deviation_um
    assert np.std(off) == pytest.approx(0.2, rel=0.1)
    assert abs(np.mean(off)) < 0.03


def test_glitches_wrong_spaces_and_a_wrong_part(work: WorkPiece) -> None:
    device = machine(4, glitches=5)
    plain = machine().inspect(work, 4, 3)
    off = device.inspect(work, 4, 3).deviation_um - plain.deviation_um
    assert np.count_nonzero(np.abs(off) > 20.0) == 5
    device.change(glitches=0, wrong_spaces=-1)
    assert set(device.inspect(work, 4, 3).space.tolist()) == set(range(38))
    device.change(wrong_spaces=1)
    assert device.inspect(work, 4, 3).space.max() == 39
    device.change(wrong_spaces=0, wrong_part=True)
    wrong = device.inspect(work, 4, 3)
    assert np.max(np.linalg.norm(wrong.points_mm - plain.points_mm, axis=1)) > 0.05


def test_what_is_ground_is_what_profile_lead_pitch_and_runout_show(work: WorkPiece) -> None:
    """EXX = +2 um: profile n_x; ECC with three waves: pitch F_k = -r ECC_k, no lead, no runout to speak of."""
    got = on_grid(machine().inspect(work, 4, 3))
    t, _ = grid(work)
    point, normal = CycloidDisc(work.spec.gear).profile(t)
    lever = (point.conjugate() * normal).imag
    assert np.max(np.abs(got[:, :, 2] - got[:, :, 0])) < 0.002
    turned = np.mean((got + 2.0 * normal.real[None, :, None]) / lever[None, :, None], axis=(1, 2))
    wanted = -6.0 * ARCSEC * 1e3 * np.cos(3.0 * 2.0 * np.pi * np.arange(39) / 39)
    np.testing.assert_allclose(turned, wanted, atol=0.01 * 6.0 * ARCSEC * 1e3)


@pytest.mark.parametrize("off", [0.0, 5.0])
def test_a_ball_rests_on_both_flanks(work: WorkPiece, off: float) -> None:
    """Nominal rest by brute force; EXX = +2 um of the part lets it sink 2 um; an eccentric seat moves it whole."""
    part = machine(clamping={"eccentric_um": off}).clamp(work)
    plain = machine().clamp(ground(Truth(cell_of()), cell_of().part))
    centre, out = plain.ball(0, 8.0)
    t = np.linspace(0.0, plain.lobes.half, 20001)
    edge = plain.lobes.profile(t)[0]
    gaps = np.abs(edge - (centre[0] + 1j * centre[1]))
    assert gaps.min() == pytest.approx(4.0, abs=1e-6)
    assert abs(out) < 1e-3
    for space in (0, 7, 30):
        turn = 2.0 * np.pi * space / 39
        way = np.asarray((np.cos(turn), np.sin(turn)))
        found, sinks = part.ball(space, 8.0)
        assert sinks == pytest.approx(-2.0 + float(part.seat.origin[0][:2] @ way) * 1e3, abs=0.02)
        assert float(found[:2] @ way) == pytest.approx(centre[0] + 1e-3 * sinks, abs=1e-5)
    assert part.ball(0, 3.0) is None
