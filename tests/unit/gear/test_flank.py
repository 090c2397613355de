"""The actual flank: exact against a slow independent way, first and second order against exact."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.errors import catalogue
from gateway.errors import ModelError
from gateway.gear import envelope
from gateway.gear.cycloid import CycloidGear, DressingError
from gateway.gear.envelope import exact
from gateway.gear.first_order import abg, along_normal, bounded_first_order, first_order, to_space
from gateway.gear.flank import FlankGrid, flank_figure, flank_grid
from gateway.gear.grinding import Grinding, wheel_section
from gateway.gear.wheel_passage import contact_line
from gateway.model import transforms
from gateway.model.chain import Axis, Chain
from gateway.model.error_model import TWENTY_ONE, yk7350b
from gateway.model.motion import Fourier, PiecewiseLinear
from tests.unit.gear.machines import (
    DISC,
    GEARS,
    RV20E,
    RV40E,
    RV320E,
    random_constants,
    random_functions,
    slow_exact,
    spread,
)

UM = 1e-3


def grinding_of(chain: Chain, gear: CycloidGear = RV40E, wheel: float = 100.0, **more: object) -> Grinding:
    return Grinding(chain, gear, gear.rp + wheel, **more)  # type: ignore[arg-type]


def agree(grinding: Grinding, points: list[tuple[float, float, float]], within: float = 2e-10) -> None:
    for k, share, z in points:
        theta = share * grinding.gear.half_pitch
        fast = float(exact(grinding, k, theta, z))
        assert fast == pytest.approx(slow_exact(grinding, k, theta, z), abs=within)


POINTS = [(0.0, -0.9, -4.0), (7.0, 0.15, 0.0), (3.0, 0.6, 5.0)]


@pytest.mark.parametrize("seed", range(3))
def test_exact_agrees_with_the_slow_way_on_constant_errors(seed: int) -> None:
    rng = np.random.default_rng(seed)
    gear = GEARS[seed % len(GEARS)]
    agree(grinding_of(yk7350b(random_constants(rng)), gear), POINTS)


@pytest.mark.parametrize("seed", range(3))
def test_exact_agrees_with_the_slow_way_on_functions(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    agree(grinding_of(random_functions(rng), GEARS[seed]), POINTS)


def test_exact_agrees_when_the_stroke_carries_the_work() -> None:
    wave = Fourier(0.0, (1e-3,), (5e-4,), 30.0)
    work = (
        Axis("Z", "prismatic", (0.0, 0.0, -1.0), {"dx": wave, "eb": 1e-5, "ea": 3e-5}, {"A0": 4e-5}, "fixed"),
        Axis("C", "revolute", (0.0, 0.0, -1.0), {"dy": 2e-3, "ec": 1e-5}),
    )
    chain = Chain(work, (Axis("X", "prismatic", (-1.0, 0.0, 0.0), {"dx": 1e-3, "ec": 2e-5}),))
    grinding = grinding_of(chain)
    assert grinding.senses == (-1.0, 1.0, 1.0)
    agree(grinding, POINTS)
    k, t = np.arange(4.0)[:, None, None], spread(RV40E, 5)[:, None]
    found = bounded_first_order(grinding, k, t, np.array([-3.0, 3.0]))
    assert np.max(np.abs(found.second - exact(grinding, k, t, np.array([-3.0, 3.0])))) < 5e-6


def test_every_way_to_write_the_machine_grinds_the_same_flank() -> None:
    rng = np.random.default_rng(5)
    e = random_constants(rng)
    grid = FlankGrid(RV40E, np.array([0.0, 5.0]), spread(RV40E, 5), np.array([-5.0, 2.0]))
    one = exact(Grinding(yk7350b(e), RV40E, 160.0), grid.k, grid.theta, grid.z)
    other = Grinding(yk7350b(e, x_direction=(-1.0, 0.0, 0.0)), RV40E, 160.0)
    np.testing.assert_allclose(exact(other, grid.k, grid.theta, grid.z), one, atol=1e-12)
    flat = np.broadcast_arrays(grid.k, grid.theta, grid.z)
    again = exact(Grinding(yk7350b(e), RV40E, 160.0), *(part.ravel() for part in flat))
    np.testing.assert_allclose(again.reshape(grid.shape), one, atol=1e-13)


def test_waves_shorter_than_the_wheel_follows_and_kinks_are_found() -> None:
    short = yk7350b({"EXZ": Fourier(0.0, (0.004,), (), 3.0)})
    agree(grinding_of(short), [(0.0, 0.1, 0.2), (0.0, 0.5, 1.4), (2.0, -0.4, -0.7)], within=2e-9)
    kinked = yk7350b({"EXZ": PiecewiseLinear((-25.0, -5.0, 0.0, 5.0, 25.0), (-0.018, 0.006, 0.0, 0.008, -0.04))})
    agree(grinding_of(kinked), [(0.0, 0.1, 0.0), (0.0, 0.5, 5.0), (0.0, 0.3, 0.02), (0.0, 0.3, 4.99)], within=1e-7)


def test_a_short_wave_is_wrong_at_first_order_and_known_to_be() -> None:
    grinding = grinding_of(yk7350b({"EXZ": Fourier(0.0, (), (0.002,), 8.0)}))
    t, z = spread(RV40E, 9)[:, None], np.linspace(-4.0, 4.0, 17)
    found = bounded_first_order(grinding, 0.0, t, z)
    truth = exact(grinding, 0.0, t, z)
    worst = float(np.max(np.abs(found.deviation - truth)))
    assert worst > 0.08 * UM
    assert not found.good_enough(0.05 * UM)
    assert np.all(np.abs(found.deviation - truth) <= found.bound)
    assert found.good_enough(1.0 * UM)


@pytest.mark.parametrize("gear", GEARS, ids=["RV40E", "RV20E", "RV320E", "disc"])
@pytest.mark.parametrize("wheel", [50.0, 150.0])
def test_the_bound_holds_and_second_order_leaves_nanometres(gear: CycloidGear, wheel: float) -> None:
    rng = np.random.default_rng(int(gear.rp + wheel))
    t, z = spread(gear, 7)[:, None], np.array([-0.5, 0.4]) * gear.b
    k = np.array([0.0, 3.0])[:, None, None]
    left = []
    for _ in range(8):
        grinding = grinding_of(
            yk7350b(random_constants(rng), c_frame="fixed" if rng.random() < 0.5 else "moving"), gear, wheel
        )
        found, truth = bounded_first_order(grinding, k, t, z), exact(grinding, k, t, z)
        left.append(float(np.max(np.abs(found.second - truth))))
        assert np.max(np.abs(found.third - truth)) <= 1e-6
        assert np.all(np.abs(found.deviation - truth) <= found.bound)
    assert np.median(left) <= 2e-6
    assert max(left) <= 5e-6


@pytest.mark.parametrize("scale", [0.1, 1.0, 10.0])
def test_truncation_grows_with_the_square_of_the_errors(scale: float) -> None:
    t, z = spread(RV40E, 9)[:, None], np.array([-5.0, 5.0])
    grinding = grinding_of(yk7350b(random_constants(np.random.default_rng(4), scale)))
    found, truth = bounded_first_order(grinding, 0.0, t, z), exact(grinding, 0.0, t, z)
    worst = np.max(np.abs(found.deviation - truth))
    assert worst < 0.25 * UM * scale**2
    assert np.all(np.abs(found.deviation - truth) <= found.bound)


@pytest.mark.parametrize("seed", range(4))
def test_bound_and_second_order_on_functions(seed: int) -> None:
    gear = GEARS[seed]
    grinding = grinding_of(random_functions(np.random.default_rng(seed)), gear)
    k, t, z = np.arange(0.0, gear.zc, 3.0)[:, None, None], spread(gear, 7)[:, None], np.linspace(-0.5, 0.5, 5) * gear.b
    found, truth = bounded_first_order(grinding, k, t, z), exact(grinding, k, t, z)
    assert np.max(np.abs(found.second - truth)) <= 2e-6
    assert np.all(np.abs(found.deviation - truth) <= found.bound)


def test_signs_of_the_house() -> None:
    """What an error does equals what the opposite correction undoes: EXX and ECC like their axis, EXZ unlike X."""
    t, z = spread(RV40E, 9)[:, None], np.array([-5.0, 0.0, 5.0])
    k = np.arange(5.0)[:, None, None]

    def flank(errors: dict[str, float], dx: float = 0.0, dc: float = 0.0) -> np.ndarray:
        chain = yk7350b(errors)
        grinding = grinding_of(chain)
        q = grinding.commands(k, z)
        q = {**q, "X": q["X"] + dx, "C": q["C"] + dc}
        twist = transforms.log(chain.actual(q) @ transforms.inverse(yk7350b().ideal(grinding.commands(k, z))))
        return along_normal(RV40E.section(t), abg(to_space(grinding, k, twist), z))

    arc = np.deg2rad(5.0 / 3600.0)
    for errors, dx, dc in (({"EXX": 0.005}, -0.005, 0.0), ({"EXZ": 0.005}, 0.005, 0.0), ({"ECC": arc}, 0.0, -arc)):
        assert np.max(np.abs(flank(errors))) > 0.9 * UM
        assert np.max(np.abs(flank(errors, dx, dc))) < 1e-3 * UM


def test_errors_that_a_spur_flank_does_not_see() -> None:
    t, z = spread(RV40E, 5)[:, None], np.array([-5.0, 5.0])
    for name in ("EZX", "EZZ", "EZC", "EBZ"):
        grinding = grinding_of(yk7350b({name: 1e-4}))
        assert np.max(np.abs(exact(grinding, 3.0, t, z))) < 1e-11
    tilt = grinding_of(yk7350b({"EAZ": np.deg2rad(0.01)}))
    assert np.max(np.abs(first_order(tilt, 3.0, t, z))) < 1e-15
    assert 1e-7 < np.max(np.abs(exact(tilt, 3.0, t, z))) < 1e-5


def test_dressing_is_exact_and_its_offset_cures_a_constant_tangential_error() -> None:
    t, z = spread(RV40E, 9)[:, None], np.array([-5.0, 5.0])
    cured = grinding_of(yk7350b({"EYZ": 0.005}), dressing=DressingError(offset=-0.005))
    assert np.max(np.abs(exact(cured, 0.0, t, z))) < 1e-12
    wavy = DressingError(0.003, 0.002, lambda theta: 0.002 * np.cos(70.0 * theta))
    grinding = grinding_of(yk7350b(random_constants(np.random.default_rng(9), 0.3)), dressing=wavy)
    agree(grinding, POINTS[:2], within=1e-9)
    found, truth = bounded_first_order(grinding, 0.0, t, z), exact(grinding, 0.0, t, z)
    assert np.max(np.abs(found.second - truth)) < 2e-5
    big = grinding_of(yk7350b(), dressing=DressingError(profile=lambda theta: np.full_like(theta, 0.01)))
    np.testing.assert_allclose(exact(big, 2.0, t, z), 0.01, atol=1e-12)


def test_the_contact_lines_make_the_actual_flank() -> None:
    grinding = grinding_of(random_functions(np.random.default_rng(3)))
    theta = spread(RV40E, 7)
    k, s = 4.0, 2.5
    line = contact_line(grinding, k, s, theta)
    step = 1e-3
    after = contact_line(grinding, k, s + step, theta).points - contact_line(grinding, k, s - step, theta).points
    across = np.einsum("ij,ij->i", line.normals, after) / (2.0 * step)
    np.testing.assert_allclose(across, 0.0, atol=1e-9)
    nominal = RV40E.space(theta, k)
    e = exact(grinding, k, theta, line.points[:, 2])
    ground = np.stack([nominal.x + e * nominal.nx, nominal.y + e * nominal.ny], -1)
    gap = np.einsum("ij,ij->i", line.points[:, :2] - ground, line.normals[:, :2])
    assert np.max(np.abs(gap)) < 1e-6


def test_wheel_section_carries_the_space() -> None:
    section = wheel_section(RV40E, 160.0, spread(RV40E, 11))
    assert np.all(np.diff(section.y) > 0.0)
    assert np.all(section.R > 160.0 - 62.3 - 1e-12)
    assert np.argmax(section.R) == 5


def test_blocks_cover_every_point_once() -> None:
    for shape in ((), (5,), (3, 4, 5), (2, 30, 7), (40, 1, 1)):
        count = np.zeros(shape, dtype=int)
        for block in envelope.blocks(shape, 20):
            count[block] += 1
            assert count[block].size <= 20 or count[block].size == shape[-1]
        assert np.all(count == 1)


def test_flank_figure_removes_one_rotation_only() -> None:
    grid = flank_grid(RV40E)
    h = grid.section.h
    rng = np.random.default_rng(0)
    e = rng.normal(size=grid.shape) * UM
    first = flank_figure(e, h)
    turned = flank_figure(e + 3e-5 * h, h)
    assert turned.rms == pytest.approx(first.rms, rel=1e-12)
    assert turned.rotation - first.rotation == pytest.approx(3e-5)
    holes = np.where(rng.random(grid.shape) < 0.1, np.nan, e)
    assert flank_figure(holes, h).rms == pytest.approx(first.rms, rel=0.02)
    shifted = flank_figure(np.broadcast_to(0.005 * grid.section.nx, grid.shape), h)
    assert shifted.rms == pytest.approx(0.005 * float(np.sqrt(np.mean(grid.section.nx**2))))


def test_what_is_no_grinder_is_refused() -> None:
    crossed = Chain(
        (Axis("X", "prismatic", (1.0, 0.0, 0.0)), Axis("C", "revolute", (0.0, 0.0, 1.0))),
        (Axis("Z", "prismatic", (0.0, 1.0, 0.0)),),
    )
    swapped = {"infeed": "C", "index": "X"}
    for code, make in (
        ("E-GEAR-GRINDER", lambda: Grinding(crossed, RV40E, 160.0)),
        ("E-GEAR-GRINDER", lambda: Grinding(yk7350b(), RV40E, 160.0, **swapped)),  # type: ignore[arg-type]
        ("E-CHAIN-AXIS", lambda: Grinding(yk7350b(), RV40E, 160.0, stroke="W")),
        ("E-GEAR-DISTANCE", lambda: Grinding(yk7350b(), RV40E, 62.0)),
        ("E-GEAR-DISTANCE", lambda: Grinding(yk7350b(), RV40E, float("nan"))),
        ("E-GEAR-DRESSING", lambda: DressingError(offset=float("inf"))),
        ("E-GEAR-GRID", lambda: FlankGrid(RV40E, np.array([]), np.array([0.0]), np.array([0.0]))),
        ("E-GEAR-GRID", lambda: flank_grid(RV40E, fraction=1.2)),
    ):
        with pytest.raises(ModelError) as caught:
            make()
        assert caught.value.code == code
        assert code in catalogue()


def test_points_that_find_no_contact_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(envelope, "STEPS", 2)
    with pytest.raises(ModelError) as caught:
        exact(grinding_of(yk7350b({"EXX": 0.005})), 0.0, spread(RV40E, 4), 0.0)
    assert caught.value.code == "E-GEAR-ENVELOPE"
    assert caught.value.fields["count"] == 4


def test_names_of_the_twenty_one() -> None:
    assert len(TWENTY_ONE) == len(set(TWENTY_ONE)) == 21
    assert (RV20E.zc, RV320E.zc, DISC.zc) == (39, 39, 11)
