"""The cell's own grinding: the wheel's body along true poses, against closed forms and a brute-force search."""

from __future__ import annotations

import numpy as np
import pytest

from simulators.cellfile import CellFile, Clamping, Gear, Part, Wheel
from simulators.grinding import CycloidDisc, Grinder, WorkPiece, draw_clamping
from simulators.grinding.grinder import refine_times, split_passes
from simulators.grinding.workpiece import Poses, WheelBody, entry_depth
from simulators.optics import OpticsBench
from simulators.truth import Truth
from simulators.truth.kinematics import rotation
from tests.sizes import few
from tests.unit.simulators.motion import plain_cell
from tests.unit.simulators.planned_run import PlannedRun, ground

RV40 = {"rp": 64.0, "rrp": 3.0, "a": 1.3, "zp": 40, "zc": 39, "b": 10.0}
ELEVEN = {"rp": 90.0, "rrp": 7.0, "a": 4.0, "zp": 12, "zc": 11, "b": 15.0}
DISTANCE = 160.0
ARCSEC = np.pi / 180.0 / 3600.0
NM = 1e-6


def cell_of(
    motions: dict[str, float | list[dict[str, object]]] | None = None,
    locations: dict[str, float] | None = None,
    gear: dict[str, float] = RV40,
    part: dict[str, object] | None = None,
    grinding: dict[str, float] | None = None,
    **changes: object,
) -> CellFile:
    terms = {
        name: [{"kind": "constant", "value": value}] if isinstance(value, float) else value
        for name, value in (motions or {}).items()
    }
    distance = {"centre_distance_mm": DISTANCE if gear is RV40 else 190.0}
    whole = {"gear": gear, "grinding": distance | (grinding or {})} | (part or {})
    truth = {"motions": terms, "locations": locations or {}}
    return CellFile.model_validate(plain_cell(truth=truth, part=whole, **changes))


def flank(cell: CellFile, spaces: tuple[int, ...] = (0, 7, 20), **planned: object) -> np.ndarray:
    assert cell.part is not None
    work = ground(Truth(cell), cell.part, **planned)
    assert work.finished
    t, z = places(cell)
    return work.surplus_um(np.asarray(spaces), t, z)


def places(cell: CellFile) -> tuple[np.ndarray, np.ndarray]:
    assert cell.part is not None
    gear = cell.part.gear
    return CycloidDisc(gear).even(12), np.linspace(-0.5, 0.5, 5) * gear.b


def shapes(cell: CellFile) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """n_x, n_y and the lever of a rotation, each (T, 1)."""
    assert cell.part is not None
    point, normal = CycloidDisc(cell.part.gear).profile(places(cell)[0])
    lever = point.real * normal.imag - point.imag * normal.real
    return normal.real[:, None], normal.imag[:, None], lever[:, None]


def strokes(dx: float = 0.0, dy: float = 0.0, turned: float = 0.0, late: float = 0.13) -> Poses:
    """The wheel along Z past a resting work that is off by dx, dy (mm) and turned (rad) the other way."""
    s = np.arange(-15.0, 15.0, 0.5) + late
    turn = rotation(np.asarray([[0.0], [0.0], [turned]]))[0]
    centre = np.stack((np.full_like(s, DISTANCE + dx), np.full_like(s, dy), s), axis=1) @ turn.T
    return Poses(s / 50.0, np.broadcast_to(turn, (len(s), 3, 3)), centre, np.zeros_like(s))


# ------------------------------------------------------------------------------------- the lobes


@pytest.mark.parametrize("data", [RV40, ELEVEN], ids=["RV-40E", "eleven"])
def test_the_profile_is_the_cycloid_of_the_books(data: dict[str, float]) -> None:
    """Against the (1-i) phi form printed in textbooks, mirrored in y; root and tip; unit normals across it."""
    gear = Gear.model_validate(data)
    t = np.linspace(-np.pi / gear.zc, np.pi / gear.zc, 3001)
    point, normal = CycloidDisc(gear).profile(t)
    i, k = gear.zp / gear.zc, gear.a * gear.zp / gear.rp
    phi = gear.zc * t
    s = (1.0 + k * k - 2.0 * k * np.cos(phi)) ** -0.5
    x = (gear.rp - gear.rrp * s) * np.cos((1 - i) * phi) - gear.a / gear.rp * (gear.rp - gear.zp * gear.rrp * s) * (
        np.cos(i * phi)
    )
    y = (gear.rp - gear.rrp * s) * np.sin((1 - i) * phi) + gear.a / gear.rp * (gear.rp - gear.zp * gear.rrp * s) * (
        np.sin(i * phi)
    )
    np.testing.assert_allclose(point, x - 1j * y, atol=1e-11)
    assert abs(point[1500]) == pytest.approx(gear.rp - gear.a - gear.rrp)
    assert abs(point[0]) == pytest.approx(gear.rp + gear.a - gear.rrp) == pytest.approx(CycloidDisc(gear).tip_mm)
    along = np.gradient(point, t, edge_order=2)
    across = np.abs((along * normal.conjugate()).real / np.abs(along))
    assert np.max(across) < 1e-4  # finite differences
    np.testing.assert_allclose(np.abs(normal), 1.0)


def test_points_are_even_along_the_flank() -> None:
    lobes = CycloidDisc(Gear.model_validate(RV40))
    t = lobes.even(12, 0.9)
    steps = np.diff(lobes.length(t))
    np.testing.assert_allclose(steps, steps[0], rtol=1e-6)
    fine = np.linspace(0.0, lobes.half, 400001)
    whole = float(np.sum(np.abs(np.diff(lobes.profile(fine)[0]))))
    assert lobes.length(t)[-1] == pytest.approx(0.9 * whole, rel=1e-6)


def test_modifications_move_the_flank_the_way_they_say() -> None:
    plain, t = CycloidDisc(Gear.model_validate(RV40)), np.asarray([-0.05, -0.02, 0.02, 0.05])
    base, normal = plain.profile(t)
    thin = CycloidDisc(Gear.model_validate(RV40 | {"drrp": 0.01})).profile(t)[0]
    np.testing.assert_allclose(thin, base - 0.01 * normal, atol=1e-12)
    turned = CycloidDisc(Gear.model_validate(RV40 | {"drot": 1e-4})).profile(t)[0]
    np.testing.assert_allclose(np.angle(turned / base), 1e-4 * np.sign(t), atol=1e-12)


# ------------------------------------------------------------------------------------- rays into the body


@pytest.mark.parametrize("late", [0.0, 0.13, 0.25, 0.37])
def test_the_nominal_wheel_leaves_the_nominal_space_wherever_it_is_sampled(late: float) -> None:
    lobes = CycloidDisc(Gear.model_validate(RV40))
    rays = lobes.rays(0, lobes.even(25), np.linspace(-5.0, 5.0, 9))
    left = entry_depth(WheelBody(lobes, DISTANCE), strokes(late=late), rays)
    assert np.max(np.abs(left)) < 0.2 * NM


@pytest.mark.parametrize(("dx", "dy", "turned"), [(1e-3, 0.0, 0.0), (0.0, 1e-3, 0.0), (0.0, 0.0, ARCSEC)])
def test_small_shifts_and_turns_reach_the_flank_as_their_normal_parts(dx: float, dy: float, turned: float) -> None:
    """1 um along X leaves n_x um, along Y n_y um, 1 arcsec about Z the lever times the angle; all within 5 nm."""
    lobes = CycloidDisc(Gear.model_validate(RV40))
    t = lobes.even(25)
    rays = lobes.rays(0, t, np.linspace(-5.0, 5.0, 9))
    left = entry_depth(WheelBody(lobes, DISTANCE), strokes(dx, dy, turned), rays).reshape(25, 9)
    point, normal = lobes.profile(t)
    lever = point.real * normal.imag - point.imag * normal.real
    wanted = dx * normal.real + dy * normal.imag + turned * lever
    np.testing.assert_allclose(left, np.repeat(wanted[:, None], 9, axis=1), atol=0.5 * NM)


def test_a_brute_force_search_finds_the_same_surface() -> None:
    """A leaning, shifted, waving wheel: every pose by bisection on a fine stroke, no derivatives, no parabola."""
    lobes = CycloidDisc(Gear.model_validate(RV40))
    body = WheelBody(lobes, DISTANCE)
    rays = lobes.rays(0, lobes.even(6), np.asarray([-4.0, 0.7]))

    def waving(s: np.ndarray) -> Poses:
        wave = 0.004 * np.sin(2.0 * np.pi * s / 13.0)
        centre = np.stack((DISTANCE + wave, 0.003 - 0.5 * wave, s), axis=1)
        angles = np.stack((1e-4 + 1e-5 * s, 2e-4 * np.cos(s / 20.0), -1.2e-4 + 0.0 * s))
        return Poses(s / 50.0, rotation(angles), centre, np.full_like(s, 0.002))

    found = entry_depth(body, waving(np.arange(-12.0, 12.0, 0.25) + 0.11), rays)
    fine = waving(np.arange(-7.0, 7.0, 0.002))
    for point, way, e in zip(rays.points, rays.directions, found, strict=True):
        low, high = np.full(len(fine.times), -0.05), np.full(len(fine.times), 0.6)
        for _ in range(40):
            middle = 0.5 * (low + high)
            end = np.einsum("ni,nij->nj", point + middle[:, None] * way - fine.origin, fine.rotation)
            free = np.hypot(end[:, 0], end[:, 2]) > body.radius(end[:, 1] - fine.shift)[0]
            low, high = np.where(free, middle, low), np.where(free, high, middle)
        assert e == pytest.approx(float(np.min(low)), abs=1.0 * NM)


def test_the_wheel_is_filtered_by_its_radius() -> None:
    """A wave of 2 mm and 2 um: its crest is worn down to the least of 2 cos + s^2 / 2R; its valley is kept."""
    cell = cell_of({"EXZ": [{"kind": "harmonic", "period": 2.0, "amplitude": 2.0}]})
    got = flank(cell, (3,))[0, 5:7].mean(axis=0)  # beside the bottom, where n_x is nearly 1
    s = np.linspace(-1.0, 1.0, 20001)
    crest = float(np.min(2.0 * np.cos(np.pi * s) + s**2 / (2.0 * 100.3) * 1e3))
    assert crest < 1.3
    assert got[2] == pytest.approx(crest, abs=0.1)
    assert got.min() == pytest.approx(-2.0, abs=0.1)


# ------------------------------------------------------------------------------------- error motions to the flank


def signed(cell: CellFile, name: str) -> np.ndarray:
    """First-order normal deviation in um for 1 um or 1 arcsec of an error of the stator-frame machine, (T, Z).

    By plain reasoning: how far the error moves wheel against work at the point of contact, along the normal.
    """
    nx, ny, lever = shapes(cell)
    z = places(cell)[1][None, :]
    arcsec_um_per_mm = ARCSEC * 1e3
    x = -DISTANCE
    effects = {
        "EXX": -nx, "EXZ": nx, "EXC": -nx, "EYX": -ny, "EYZ": ny, "EYC": -ny,
        "EAX": z * ny * arcsec_um_per_mm, "EBX": -z * nx * arcsec_um_per_mm, "ECX": -lever * arcsec_um_per_mm,
        "ECZ": (x * ny + lever) * arcsec_um_per_mm,
        "EAC": z * ny * arcsec_um_per_mm, "EBC": -z * nx * arcsec_um_per_mm, "ECC": -lever * arcsec_um_per_mm,
        "EZX": 0.0 * nx, "EZZ": 0.0 * nx, "EZC": 0.0 * nx, "EAZ": 0.0 * nx, "EBZ": 0.0 * nx,
        "B0Z": z * nx * arcsec_um_per_mm, "A0C": z * ny * arcsec_um_per_mm, "B0C": -z * nx * arcsec_um_per_mm,
        "X0C": -nx, "Y0C": -ny,
    }  # fmt: skip
    return effects[name] + 0.0 * z


# Every kind of motion of C, a squareness of each kind; then those of X and Z.
ERRORS = ["B0Z", "A0C", "Y0C", *(f"E{to}{axis}" for axis in "CXZ" for to in "XYZABC"), "B0C"]


@pytest.mark.parametrize("name", few(ERRORS, 9))
def test_every_error_reaches_the_flank_with_its_sign_and_size(name: str) -> None:
    size = 4.0
    cell = cell_of({name: size}) if name[0] == "E" else cell_of(locations={name: size})
    got = flank(cell)
    wanted = size * signed(cell, name)
    np.testing.assert_allclose(got, np.broadcast_to(wanted, got.shape), atol=0.005)


def test_a_space_sees_the_errors_of_its_own_index() -> None:
    """ECC = +4 arcsec cos c: the work turned too far at space k's C leaves -lever there, and more elsewhere."""
    cell = cell_of({"ECC": [{"kind": "harmonic", "order": 1, "amplitude": 4.0}]})
    got = flank(cell, (0, 10, 20))
    _, _, lever = shapes(cell)
    for row, space in zip(got, (0, 10, 20), strict=True):
        wanted = -4.0 * np.cos(2.0 * np.pi * space / 39) * ARCSEC * 1e3 * lever
        np.testing.assert_allclose(row, np.broadcast_to(wanted, row.shape), atol=0.005)


def test_height_is_a_lever() -> None:
    """150 mm above the table a tilt of B0C = 5 arcsec is 3.6 um nearer to the wheel, all over the width."""
    low, high = (cell_of(locations={"B0C": 5.0}, grinding={"height_mm": height}) for height in (0.0, 150.0))
    nx, _, _ = shapes(high)
    more = flank(high) - flank(low)
    np.testing.assert_allclose(more, np.broadcast_to(-150.0 * 5.0 * ARCSEC * 1e3 * nx, more.shape), atol=0.01)


def test_set_up_values_move_the_flank() -> None:
    cell = cell_of(
        axes=[
            *plain_cell()["axes"],
            {"name": "Y1", "letter": "Y", "kind": "linear", "travel": [-60.0, 60.0]},
        ]
    )
    nx, ny, lever = shapes(cell)
    for planned, wanted in (
        ({"x_mm": 0.005}, -5.0 * nx),
        ({"dressing_mm": 0.005}, 5.0 * ny),
        ({"c_deg": 0.001}, -3.6 * ARCSEC * 1e3 * lever),
    ):
        for how in ("R200", "Y"):  # dressed by a parameter, or carried by an axis
            wheel = cell.wheel.model_copy(update={"place": how, "dresser": ""})
            got = flank(cell.model_copy(update={"wheel": wheel}), **planned)
            np.testing.assert_allclose(got, np.broadcast_to(wanted, got.shape), atol=0.02)


def test_a_wheel_off_its_seat_and_too_large() -> None:
    nx, ny, _ = shapes(cell_of())
    wheel = {"offset_um": (3.0, -2.0, 0.0), "radius_um": 1.5}
    got = flank(cell_of(wheel=wheel))
    np.testing.assert_allclose(got, np.broadcast_to(3.0 * nx - 2.0 * ny - 1.5 * nx, got.shape), atol=0.005)


def test_the_way_an_axis_came_counts() -> None:
    """X came in + direction: it stands half its reversal further on."""
    axes = [dict(axis) for axis in plain_cell()["axes"]]
    axes[0]["reversal"] = [{"kind": "constant", "value": 2.0}]
    cell = cell_of({}, axes=axes)
    nx, _, _ = shapes(cell)
    got = flank(cell)
    np.testing.assert_allclose(got, np.broadcast_to(-1.0 * nx, got.shape), atol=0.005)


def test_of_two_strokes_the_deeper_one_stays() -> None:
    """Z's own reversal puts a steep ramp of EXZ 1 mm apart on the way up and down: the lower of the two is left."""
    axes = [dict(axis) for axis in plain_cell()["axes"]]
    axes[1]["reversal"] = [{"kind": "constant", "value": 1000.0}]
    ramp = [{"kind": "table", "positions": [-20.0, 20.0], "values": [-20.0, 20.0]}]
    straight, shifted = cell_of({"EXZ": ramp}), cell_of({"EXZ": ramp}, axes=axes)
    nx, _, _ = shapes(straight)
    more = flank(shifted) - flank(straight)
    np.testing.assert_allclose(more, np.broadcast_to(-0.5 * nx, more.shape), atol=0.01)


def test_warm_work_is_measured_at_20_degrees() -> None:
    """All of one steel at 24 degC: X's scale and the disc grow alike; the wheel is dressed to nominal size."""
    axes = [dict(axis) for axis in plain_cell()["axes"]]
    axes[0]["expansion_ppm_per_k"] = 11.5
    cell = cell_of({}, axes=axes, climate={"material_degc": {"start": 24.0}}, grinding={"stock_um": 60.0})
    nx, _, _ = shapes(cell)
    point, normal = CycloidDisc(cell.part.gear).profile(places(cell)[0])
    own = (point * normal.conjugate()).real[:, None]
    wanted = 11.5e-6 * 4.0 * (DISTANCE * nx - own) * 1e3
    got = flank(cell)
    np.testing.assert_allclose(got, np.broadcast_to(wanted, got.shape), atol=0.01)


# ------------------------------------------------------------------------------------- the work place


def test_a_blank_keeps_its_stock_until_the_wheel_has_been_there_and_only_loses() -> None:
    cell = cell_of()
    run = PlannedRun(cell, cell.part, x_mm=-0.010)
    grinder = Grinder(OpticsBench(Truth(cell), run), cell.part, Wheel())
    work = grinder.load(0.0)
    t, z = places(cell)
    half_way = run.end_s / 2.0
    grinder.follow(half_way)
    assert not work.finished
    assert work.surplus_um(np.asarray([38]), t, z) == pytest.approx(40.0)
    nx, _, _ = shapes(cell)
    ready = work.surplus_um(np.asarray([2]), t, z)[0]
    np.testing.assert_allclose(ready, np.broadcast_to(10.0 * nx, ready.shape), atol=0.05)
    grinder.follow(run.end_s, whole=True)
    assert work.finished
    assert work.passes == 2 * 39
    assert grinder.latest(run.end_s) is work
    assert grinder.load(run.end_s) is not work
    assert grinder.latest(run.end_s) is work  # beside the machine, until another one is ground
    assert grinder.work is not None
    assert not grinder.work.passes


def test_looking_often_or_once_gives_the_same_part() -> None:
    cell = cell_of({"EXZ": [{"kind": "harmonic", "period": 30.0, "amplitude": 3.0}]})
    t, z = places(cell)

    def made(every_s: float) -> np.ndarray:
        run = PlannedRun(cell, cell.part)
        grinder = Grinder(OpticsBench(Truth(cell), run), cell.part, Wheel())
        work = grinder.load(0.0)
        for now in np.arange(every_s, run.end_s + every_s, every_s):
            grinder.follow(float(now), whole=now >= run.end_s)
        return work.surplus_um(np.asarray([0, 17, 38]), t, z)

    once = made(1000.0)
    np.testing.assert_allclose(made(0.31), once, atol=1e-4)
    np.testing.assert_allclose(made(7.0), once, atol=1e-4)


def test_passes_that_later_ones_have_cut_away_are_forgotten() -> None:
    cell = cell_of()
    work = None
    grinder = None
    for start, infeed in ((0.0, -0.030), (100.0, -0.015), (200.0, 0.0)):
        run = PlannedRun(cell, cell.part, x_mm=infeed, start_s=start)
        if grinder is None:
            grinder = Grinder(OpticsBench(Truth(cell), run), cell.part, Wheel())
            work = grinder.load(start)
        grinder._bench.machine = run
        grinder.follow(run.end_s, whole=True)
    assert isinstance(work, WorkPiece)
    assert work.passes == 2 * 39
    t, z = places(cell)
    assert np.max(np.abs(work.surplus_um(np.arange(39), t, z))) < 1e-3


def test_blanks_are_clamped_anew_each_time_and_alike_for_a_seed() -> None:
    clamping = {"clamping": {"eccentric_um": 3.0, "turned_arcsec": 20.0}}

    def two(seed: int) -> list[np.ndarray]:
        cell = cell_of(part=clamping, seed=seed)
        grinder = Grinder(OpticsBench(Truth(cell), PlannedRun(cell, cell.part)), cell.part, Wheel())
        return [grinder.load(float(count)).seat.origin[0] for count in range(2)]

    first, second = two(5)
    np.testing.assert_array_equal(first, two(5)[0])
    assert np.linalg.norm(first - second) > 1e-5
    assert np.linalg.norm(first - two(6)[0]) > 1e-5
    many = np.asarray([draw_clamping(Clamping(eccentric_um=3.0), 5, str(count)).origin[0][:2] for count in range(400)])
    assert np.std(many) == pytest.approx(1.5e-3, rel=0.1)


def test_an_eccentric_clamping_shows_as_a_runout_of_the_finished_part() -> None:
    cell = cell_of(part={"clamping": {"eccentric_um": 5.0}})
    work = ground(Truth(cell), cell.part)
    off = work.seat.origin[0][:2] * 1e3
    t, z = places(cell)
    nx, ny, _ = shapes(cell)
    for space in (0, 9, 25):
        turn = 2.0 * np.pi * space / 39
        local = np.asarray([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) @ off
        got = work.surplus_um(np.asarray([space]), t, z)[0]
        wanted = -local[0] * nx - local[1] * ny
        np.testing.assert_allclose(got, np.broadcast_to(wanted, got.shape), atol=0.01)


def test_moments_of_contact_are_a_quarter_of_a_millimetre_apart() -> None:
    times = np.linspace(0.0, 1.0, 26)
    z = -100.0 + 200.0 * times
    near = np.abs(z) < 12.0
    close, inside = refine_times(times, np.zeros_like(z), z, near)
    heights = -100.0 + 200.0 * close
    assert np.max(np.diff(heights[inside])) <= 0.25
    assert np.all(np.isin(times, close))
    assert heights[inside].min() < -11.0
    assert len(close) < 200


def test_a_stroke_turned_round_is_two_passes_and_a_rest_is_none() -> None:
    z = np.asarray([0.0, 1.0, 2.0, 2.0, 2.0, 3.0, 2.5, 1.0, 0.0, 0.0])
    times = 0.01 * np.arange(len(z))
    found = split_passes(times, z, np.zeros(len(z), dtype=int))
    assert [(part.start, part.stop) for part in found] == [(0, 5), (5, 10)]
    gap = times + np.where(np.arange(len(z)) > 3, 5.0, 0.0)
    assert len(split_passes(gap, z, np.zeros(len(z), dtype=int))) == 3
    assert len(split_passes(times, np.zeros(len(z)), np.zeros(len(z), dtype=int))) == 1


def test_a_part_file_is_checked() -> None:
    with pytest.raises(ValueError, match="zc \\+ 1"):
        Gear.model_validate(RV40 | {"zp": 41})
    with pytest.raises(ValueError, match="pin circle"):
        Gear.model_validate(RV40 | {"a": 1.7})
    assert Part.model_validate({"gear": RV40, "grinding": {"centre_distance_mm": 160.0}}).grinding.stock_um == 40.0


def test_a_deep_disc_is_ground_as_well() -> None:
    cell = cell_of({"EXX": 4.0}, gear=ELEVEN)
    nx, _, _ = shapes(cell)
    got = flank(cell, (0, 5))
    np.testing.assert_allclose(got, np.broadcast_to(-4.0 * nx, got.shape), atol=0.005)


@pytest.mark.parametrize("height", [0.0, 120.0])
def test_a_fixture_is_dialled_in_to_the_axis_of_rotation(height: float) -> None:
    """What turns along with the table is where its axis lies, no motion of it; what turns against it stays."""

    def pair(first: str, second: str, size: float, sense: float) -> dict[str, list[dict[str, object]]]:
        wave = {"kind": "harmonic", "order": 1, "amplitude": size}
        return {first: [{**wave, "phase_deg": 20.0}], second: [{**wave, "phase_deg": 20.0 - 90.0 * sense}]}

    middle = {"height_mm": height}
    plain = flank(cell_of({}, grinding=middle))
    along = {**pair("EXC", "EYC", 4.0, 1.0), **pair("EAC", "EBC", 3.0, 1.0)}
    assert np.max(np.abs(flank(cell_of(along, grinding=middle)) - plain)) < 0.005
    against = {**pair("EXC", "EYC", 4.0, -1.0), **pair("EAC", "EBC", 3.0, -1.0)}
    assert np.std(flank(cell_of(against, grinding=middle)) - plain) > 1.0
