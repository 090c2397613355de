"""Disc, wheel, contact and flank against closed forms written here, and files against what another program reads."""

from __future__ import annotations

import csv
from pathlib import Path

import ezdxf
import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree

import trueflank as tf

RP, RRP, A, ZP, ZC, E = 64.0, 3.0, 1.3, 40, 39, 160.0
GEAR = tf.Gear.of(rp=RP, rrp=RRP, a=A, zp=ZP, zc=ZC, centre_distance=E)


def literature(phi: np.ndarray, *, drp: float = 0.0, drrp: float = 0.0, delta: float = 0.0) -> np.ndarray:
    """The cycloid of the literature in (1 - i) phi, with its three modifications, mirrored so that it counts like ours.

    x = (r_p' - r' S^-1/2) cos((1 - i) phi - delta) - (a/r_p') (r_p' - z_p r' S^-1/2) cos(i phi + delta), y alike.
    """
    circle, pin, i = RP + drp, RRP + drrp, ZP / ZC
    K = A * ZP / circle
    root = np.sqrt(1.0 + K * K - 2.0 * K * np.cos(phi))
    near, far = circle - pin / root, (A / circle) * (circle - ZP * pin / root)
    first, second = (1.0 - i) * phi - delta, i * phi + delta
    x = near * np.cos(first) - far * np.cos(second)
    y = near * np.sin(first) + far * np.sin(second)
    return np.stack([x, -y], axis=-1)


@pytest.mark.parametrize("change", [{}, {"drp": 0.02}, {"drrp": 0.01}])
def test_the_profile_is_the_cycloid_of_the_literature(change: dict[str, float]) -> None:
    found = GEAR.modified(**change).profile(41)
    np.testing.assert_allclose(found.points, literature(np.deg2rad(found.angle) * ZC, **change), atol=1e-11)
    np.testing.assert_allclose(np.hypot(found.nx, found.ny), 1.0, atol=1e-14)
    fine = GEAR.modified(**change).profile(4001)
    along = np.gradient(fine.points, fine.arc, axis=0)[5:-5]
    np.testing.assert_allclose(np.sum(along * fine.normals[5:-5], axis=1), 0.0, atol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(along, axis=1), 1.0, atol=1e-4)  # arc is arc length
    turning = np.gradient(fine.normals, fine.arc, axis=0)[5:-5]
    np.testing.assert_allclose(np.sum(turning * along, axis=1), fine.curvature[5:-5], atol=2e-3)


def test_each_flank_is_turned_by_the_rotation_modification_and_spaces_by_their_pitch() -> None:
    plain, turned = GEAR.profile(40), GEAR.modified(drot_arcsec=20.0).profile(40)
    side = np.sign(plain.angle) * np.deg2rad(20.0 / 3600.0)
    c, s = np.cos(side), np.sin(side)
    wanted = np.stack([c * plain.x - s * plain.y, s * plain.x + c * plain.y], axis=-1)
    np.testing.assert_allclose(turned.points, wanted, atol=1e-12)
    seventh = GEAR.profile(40, space=7)
    pitch = np.exp(2j * np.pi * 7 / ZC)
    np.testing.assert_allclose(seventh.x + 1j * seventh.y, (plain.x + 1j * plain.y) * pitch, atol=1e-12)


def test_the_undercut_limit_is_the_least_radius_of_the_pin_centres_curve() -> None:
    def radius(t: float) -> float:
        first = np.array([-RP * np.sin(t) + A * ZP * np.sin(ZP * t), RP * np.cos(t) - A * ZP * np.cos(ZP * t)])
        second = np.array([-RP * np.cos(t) + A * ZP**2 * np.cos(ZP * t), -RP * np.sin(t) + A * ZP**2 * np.sin(ZP * t)])
        bend = (first[0] * second[1] - first[1] * second[0]) / np.hypot(*first) ** 3
        return 1.0 / bend if bend > 0.0 else 1e9

    tries = [minimize_scalar(radius, bounds=(low, low + 0.01), method="bounded").fun for low in np.linspace(0, 0.08, 9)]
    assert GEAR.limits.rrp_max == pytest.approx(min(tries), rel=1e-6)
    assert (GEAR.limits.r_root, GEAR.limits.r_tip) == (RP - A - RRP, RP + A - RRP)
    with pytest.raises(tf.TrueflankError, match=r"E-GEAR-UNDERCUT"):
        GEAR.modified(drrp=GEAR.limits.rrp_max)


def test_the_wheel_is_the_space_turned_about_the_wheels_axis() -> None:
    profile, wheel = GEAR.profile(21), GEAR.wheel(21)
    np.testing.assert_allclose(np.stack([wheel.y, wheel.R]), [profile.y, E - profile.x], atol=1e-12)
    turn = np.linspace(-30.0, 30.0, 7)
    surface = wheel.surface(turn)
    assert surface.points.shape == surface.normals.shape == (7, 21, 3)
    np.testing.assert_allclose(np.hypot(surface.points[..., 0], surface.points[..., 2]), np.tile(wheel.R, (7, 1)))
    step = 1e-5
    around = (wheel.surface(turn + step).points - wheel.surface(turn - step).points) / np.deg2rad(2.0 * step)
    np.testing.assert_allclose(np.sum(around * surface.normals, axis=-1), 0.0, atol=1e-4)
    np.testing.assert_allclose(surface.normals[3], np.stack([profile.nx, profile.ny, 0.0 * profile.nx], axis=-1))


def test_contact_lines_are_where_the_condition_is_zero_and_make_the_flank() -> None:
    machine = tf.Machine({"EXZ": 2.0, "EAZ": 30.0, "EYX": ([-200.0, -100.0], [0.0, 4.0]), "B0Z": 20.0})
    found = tf.contact(machine, GEAR, spaces=[0, 5], heights=[-4.0, 0.0, 4.0], points=31)
    assert found.points.shape == (2, 3, 31, 3)
    np.testing.assert_allclose(
        [found.condition(float(found.turn[k, s, t]))[k, s, t] for k, s, t in np.ndindex(2, 3, 31)], 0.0, atol=1e-12
    )
    still = tf.contact(tf.Machine(), GEAR, heights=[-4.0, 4.0], points=31)
    np.testing.assert_allclose(still.turn, 0.0, atol=1e-12)  # spur and no errors: the line is the profile itself
    profile = GEAR.profile(31)
    np.testing.assert_allclose(still.points[0, 1], np.column_stack([profile.points, np.full(31, 4.0)]), atol=1e-12)
    np.testing.assert_allclose(found.ideal[0], tf.contact(tf.Machine(), GEAR, heights=[-4, 0, 4], points=31).points[0])
    # A point of the contact line lies off the nominal flank by the exact deviation there: both are one surface.
    fine = GEAR.profile(8001)
    flank = tf.flank(machine, GEAR, order="exact")
    lines = tf.contact(machine, GEAR, heights=flank.height, points=401).points[0, 2]
    gap = [
        float(((one[:2] - fine.points[i]) @ fine.normals[i]) * 1000.0)
        for one in lines
        for i in [int(np.argmin(np.hypot(*(fine.points - one[:2]).T)))]
    ]
    at = np.interp(flank.angle, GEAR.profile(401).angle, gap)
    section = GEAR.profile(401)
    lever = np.interp(flank.angle, section.angle, section.x * section.ny - section.y * section.nx)
    turned = at - np.deg2rad(flank.rotation_arcsec / 3600.0) * lever * 1000.0
    np.testing.assert_allclose(turned, flank.deviation[0, :, 2], atol=0.02)


def test_the_actual_flank_is_the_theoretical_one_moved_along_its_normals() -> None:
    flank = tf.flank(tf.Machine({"EXX": ([-200.0, -100.0], [0.0, 6.0])}), GEAR)
    theory, actual = flank.surface(0.0), flank.surface()
    assert actual.points.shape == (*flank.deviation.shape, 3)
    np.testing.assert_allclose(theory.points[..., 2], np.broadcast_to(flank.height, flank.deviation.shape))
    gap = np.sum((actual.points - theory.points) * theory.normals, axis=-1)
    np.testing.assert_allclose(gap * 1000.0, flank.deviation, atol=1e-9)


def _in_space_0(points: np.ndarray) -> np.ndarray:
    one = points @ [1, 1j]
    one = one * np.exp(-2j * np.pi / ZC * np.round(np.angle(one) * ZC / (2 * np.pi)))
    return np.stack([one.real, one.imag], axis=-1)


def test_another_program_reads_the_disc(tmp_path: Path) -> None:
    drawing = ezdxf.readfile(GEAR.to_dxf(tmp_path / "disc.dxf", tolerance_um=2.0))
    assert drawing.units == ezdxf.units.MM
    (outline,) = drawing.modelspace().query("LWPOLYLINE")
    assert outline.closed
    points = np.array([one[:2] for one in outline.get_points()])
    curve = cKDTree(literature(np.linspace(-np.pi, np.pi, 400001)))
    middles = 0.5 * (points + np.roll(points, -1, axis=0))
    off = [curve.query(_in_space_0(one))[0].max() for one in (points, middles)]
    assert off[0] < 0.0002, "the points are on the curve, 0.1 um apart here"
    assert 0.0005 < off[1] < 0.0021, "the chords leave it by what was allowed"
    circles = {one.dxf.layer: one.dxf.radius for one in drawing.modelspace().query("CIRCLE")}
    assert circles == pytest.approx({"PIN_CIRCLE": 64.0, "TIP": 62.3, "ROOT": 59.7})
    with GEAR.to_csv(tmp_path / "disc.csv", points=11).open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == ZC * 11
    row = rows[7 * 11 + 3]
    one = GEAR.profile(11, space=7)
    assert (int(row["space"]), float(row["x_mm"]), float(row["ny"])) == pytest.approx(
        (7, one.x[3], one.ny[3]), abs=1e-8
    )
    with GEAR.wheel(11).to_csv(tmp_path / "wheel.csv").open(encoding="utf-8") as file:
        assert [float(one["R_mm"]) for one in csv.DictReader(file)] == pytest.approx(GEAR.wheel(11).R, abs=1e-8)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: GEAR.profile(3),
        lambda: GEAR.profile(21, space=39),
        lambda: GEAR.profile(2.5),  # type: ignore[arg-type]
        lambda: GEAR.to_dxf("x.dxf", tolerance_um=0.0),
        lambda: tf.contact(tf.Machine(), GEAR, spaces=[0.5]),
        lambda: tf.contact(tf.Machine(), GEAR, heights=[[0.0]]),
        lambda: tf.contact(GEAR, tf.Machine()),  # type: ignore[arg-type]
        lambda: tf.Machine().matrix("wheel", "work", X="far", Z=0.0, C=0.0),
        lambda: tf.Machine().relative(X=[0.0, 1.0], Z=[0.0, 1.0, 2.0], C=0.0),
        lambda: tf.Machine().relative_error("dq"),
        lambda: tf.Machine().relative(X=0.0, Z=0.0, C=0.0).plot(),
    ],
)
def test_what_cannot_be_is_said(wrong) -> None:
    with pytest.raises(tf.TrueflankError, match=r"E-LIBRARY-KIND"):
        wrong()


def test_relative_errors_over_two_axes_are_drawn_as_a_line_each() -> None:
    at = {"X": -160.0, "Z": np.linspace(-5.0, 5.0, 5)[:, None], "C": np.linspace(0.0, 360.0, 13)}
    figure = tf.Machine().relative(**at).plot()
    turns = [[line for line in panel.lines if len(line.get_xdata()) == 13] for panel in figure.axes]
    assert [len(lines) for lines in turns] == [5] * 6
