"""Laws and closed forms of a cycloid drive in loaded contact, and a second program that knows no table or tangent."""

from __future__ import annotations

from dataclasses import replace
from math import pi, sqrt

import numpy as np
import pytest
from scipy.optimize import least_squares

from gateway.gear.cycloid import CycloidGear
from gateway.reducer.contact import Assembly
from gateway.reducer.records import Contact, Cranks, DiscPlace, Pins, Reducer, for_gear, shipped
from gateway.tooth import FlankMap
from tests.sizes import few
from tests.unit.reducer.drives import ARCSEC, crank, flank, forty, order, wave

LEVER = 1.3 * 39
K = 1.3 * 40 / 64.0


@pytest.mark.parametrize("discs", [1, 2])
def test_perfect_parts_give_no_transmission_error_and_the_stiffness_of_the_closed_form(discs: int) -> None:
    pose = Assembly(forty(discs), [None] * discs).solve(crank(24, 5), 1.0 * discs)
    assert np.ptp(pose.psi) * ARCSEC < 1e-3
    assert discs * 1000.0 / pose.psi.mean() == pytest.approx(discs * 2e4 * 10.0 * 40 * LEVER**2 / 4.0, rel=2e-4)
    assert pose.force.max() == pytest.approx(4.0 * 1000.0 / (40 * LEVER), rel=1e-3)


def test_a_constant_gap_gives_its_play_where_the_lever_is_largest() -> None:
    alpha = np.linspace(0.0, 2.0 * pi / 40, 30)
    assembly = Assembly(forty(drrp=0.005), [None])
    play = assembly.solve(alpha, 0.02).psi - assembly.solve(alpha, -0.02).psi
    assert play.min() == pytest.approx(2.0 * 0.005 / LEVER, rel=1e-3)


def test_pins_on_a_wider_circle_give_their_play_by_the_least_normal_part() -> None:
    drive = replace(forty(), pins=Pins(40, 64.005, 3.0))
    alpha = np.linspace(0.0, 2.0 * pi / 40, 30)
    play = Assembly(drive, [None]).solve(alpha, 0.02).psi - Assembly(drive, [None]).solve(alpha, -0.02).psi
    assert play.min() == pytest.approx(2.0 * 0.005 * sqrt(1.0 - K * K) / LEVER, rel=1e-3)


def test_spaces_widened_by_a_rotation_give_twice_that_rotation() -> None:
    assembly = Assembly(forty(drot=1e-4), [None])
    alpha = np.linspace(0.0, 2.0 * pi / 40, 10)
    play = assembly.solve(alpha, 0.05).psi - assembly.solve(alpha, -0.05).psi
    assert play.mean() == pytest.approx(2e-4, rel=3e-3)


def test_a_turn_of_all_spaces_turns_the_output_back_and_does_nothing_else() -> None:
    drive, alpha = forty(), crank(24, 4)
    turned = Assembly(drive, [flank(drive.gear, G=0.05)]).solve(alpha, 20.0)
    plain = Assembly(drive, [None]).solve(alpha, 20.0)
    assert (turned.psi - plain.psi).mean() == pytest.approx(-5e-5, rel=5e-4)
    assert np.ptp(turned.psi) * ARCSEC < 5e-3


def test_teeth_displaced_against_the_crank_holes_show_at_order_zp() -> None:
    drive = forty()
    k = np.arange(39)[:, None, None] * 2.0 * pi / 39
    psi = Assembly(drive, [flank(drive.gear, A=np.cos(k), B=-np.sin(k))]).solve(crank(12), 400.0).psi
    assert order(psi, 40) == pytest.approx(1e-3 / LEVER * 1.09 * ARCSEC, rel=0.03)
    assert max(order(psi, n) for n in range(1, 230) if n != 40) < 0.05 * order(psi, 40)


def test_a_thick_pin_pushes_once_a_crank_turn_with_one_disc_and_twice_with_two() -> None:
    thick = [1.0] + [0.0] * 39
    for discs, size, first in ((1, 1.0, 39), (2, 0.5, 78)):
        drive = forty(discs, radius_um=thick)
        alpha = crank(48, 1)
        psi = (
            Assembly(drive, [None] * discs).solve(alpha, 400.0 * discs).psi
            - Assembly(forty(discs), [None] * discs).solve(alpha, 400.0 * discs).psi
        )
        assert -psi.min() * ARCSEC == pytest.approx(size * 1e-3 * 4.0 / (40 * LEVER) * ARCSEC, rel=0.03)
        assert order(psi, first // 39) == max(order(psi, n) for n in range(1, 12))


@pytest.mark.parametrize("m", few([1, 2, 3]))
def test_disc_patterns_appear_at_m_zp_and_ring_patterns_at_m_zc(m: int) -> None:
    disc = forty()
    ring = forty(radius_um=tuple(np.cos(2.0 * pi * m * np.arange(40) / 40)))
    for assembly, number in ((Assembly(disc, [wave(disc.gear, m)]), 40 * m), (Assembly(ring, [None]), 39 * m)):
        psi = assembly.solve(crank(24), 300.0).psi
        sizes = [order(psi, n) for n in range(1, 300)]
        assert 1 + int(np.argmax(sizes)) == number


@pytest.mark.parametrize(("mark", "m", "left"), few([(1, 1, 0.05), (20, 1, 0.9), (1, 2, 0.9), (20, 2, 0.9)], 2))
def test_two_equal_discs_cancel_as_their_marks_say(mark: int, m: int, left: float) -> None:
    """Mark 1: as near aligned as teeth allow; 20: the same part turned by 180 deg."""
    one, two = forty(), forty(2, marks=(0, mark))
    part = wave(one.gear, m)
    alone = order(Assembly(one, [part]).solve(crank(12), 300.0).psi, 40 * m)
    both = order(Assembly(two, [part, part]).solve(crank(12), 600.0).psi, 40 * m)
    assert (both <= left * alone) if left < 0.5 else (both >= left * alone)


@pytest.mark.parametrize("m", few([3, 1]))
def test_odd_ring_patterns_cancel_between_two_discs_whatever_their_marks(m: int) -> None:
    ring = tuple(np.cos(2.0 * pi * m * np.arange(40) / 40))
    alone = order(Assembly(forty(radius_um=ring), [None]).solve(crank(12), 300.0).psi, 39 * m)
    two = forty(2, marks=(3, 17), radius_um=ring)
    assert order(Assembly(two, [None, None]).solve(crank(12), 600.0).psi, 39 * m) < 0.02 * alone


def test_the_mirrored_drive_answers_the_reversed_torque_with_the_mirrored_curve() -> None:
    drive = forty(drrp=0.004)
    rng = np.random.default_rng(5)
    A, B = rng.normal(size=(2, 39, 1, 1)) * 2.0
    part = flank(drive.gear, A=A, B=B)
    mirrored = FlankMap(part.theta_rad, part.z_mm, part.deviation_um[(-np.arange(39)) % 39][:, ::-1])
    alpha = crank(24, 3)
    forward = Assembly(drive, [part]).solve(alpha, 150.0).psi
    backward = Assembly(drive, [mirrored]).solve(-alpha, -150.0).psi
    assert backward == pytest.approx(-forward, abs=1e-9)


def test_a_drive_of_twice_the_size_turns_alike_under_eight_times_the_torque() -> None:
    small = forty(drrp=0.004)
    gear = CycloidGear(rp=128.0, rrp=6.0, a=2.6, zp=40, zc=39, b=20.0, drrp=0.008)
    large = replace(small, gear=gear, pins=Pins(40, 128.0, 6.0))
    alpha = crank(24, 1)
    parts = flank(small.gear, A=1.0, B=0.5), flank(gear, A=2.0, B=1.0)
    few = Assembly(small, [parts[0]]).solve(alpha, 100.0)
    many = Assembly(large, [parts[1]]).solve(alpha, 800.0)
    assert many.psi == pytest.approx(few.psi, rel=1e-6)
    assert many.pressure == pytest.approx(few.pressure, rel=1e-6, abs=1e-3)


PUBLISHED = [
    (85, 1.3, 1.0, 10.04),
    (85, 1.3, 17.6, 177),
    (85, 1.6, 9.68, 79),
    (70, 1.07, 6.8, 83),
    (60, 0.92, 4.0, 57),
    (60, 0.92, 2.0, 28),
]


@pytest.mark.parametrize(("ring", "a", "torque", "force"), PUBLISHED)
def test_the_published_table_of_pin_forces(ring: float, a: float, torque: float, force: float) -> None:
    """18 pins of radius 2.5, 17 lobes, width 6.35, equal stiffness, no gaps: a public program's specification."""
    gear = CycloidGear(rp=ring / 2.0, rrp=2.5, a=a, zp=18, zc=17, b=6.35)
    contact = Contact(stiffness_n_mm2=2e6, moduli_mpa=(200_000.0, 69_000.0), poisson=(0.30, 0.33))
    drive = replace(
        forty(), gear=gear, pins=Pins(18, ring / 2.0, 2.5), contact=contact, discs=(DiscPlace(),), rated_nm=torque
    )
    pose = Assembly(drive, [None]).solve(crank(96, 1), torque)
    assert pose.force.max() == pytest.approx(force, abs=0.5 if force > 20 else 0.005)
    if torque == 1.0:
        assert pose.pressure.max() == pytest.approx(118.56, abs=0.1)


def test_equal_cranks_errors_change_the_play_and_no_transmission_error() -> None:
    drive = shipped("RV-320E-like", "crank-holes")
    assert isinstance(drive.output, Cranks)
    wide = replace(drive.output, eccentricity_um=((3.0,) * 3,) * 2)
    alpha = crank(24, 1)
    plain, longer = (Assembly(replace(drive, output=o), [None] * 2) for o in (drive.output, wide))
    ripple = [np.ptp(a.solve(alpha, 3000.0).psi) * ARCSEC for a in (plain, longer)]
    play = [(a.solve(alpha, 10.0).psi - a.solve(alpha, -10.0).psi).mean() for a in (plain, longer)]
    assert ripple[1] < ripple[0] + 0.2
    assert play[1] < play[0]


def test_palmgren_s_contact_approaches_as_its_formula_says() -> None:
    drive = replace(forty(), contact=Contact(law="line"))
    pose = Assembly(drive, [None]).solve(np.array([0.3]), 300.0)
    j = int(np.argmax(pose.force))
    F, p = pose.force.ravel()[j], pose.approach.ravel()[j]
    assert p == pytest.approx(3.84e-5 * F**0.9 / 10.0**0.8, rel=1e-6)


def _second_program(drive: Reducer, A: np.ndarray, B: np.ndarray, alpha: float, *, torque_nm: float) -> np.ndarray:
    """psi, then x, y, chi of each disc by least squares on equilibrium; gaps by sampling the actual flank densely."""
    gear, out, n = drive.gear, drive.output, 4001
    assert isinstance(out, Cranks)
    t = np.linspace(-pi / gear.zc, pi / gear.zc, n)
    s = gear.section(t)
    pins = drive.pins.circle_mm * np.exp(2j * pi * np.arange(gear.zp) / gear.zp)
    spaces = []
    for k in range(gear.zc):
        e = 1e-3 * (A[k] * s.nx + B[k] * s.ny)
        spaces.append((s.x + 1j * s.y + e * (s.nx + 1j * s.ny)) * np.exp(2j * pi * k / gear.zc))
    whole = np.concatenate(spaces)

    def nearest(q: complex) -> tuple[float, complex]:
        """Distance and direction to the polygon's nearest segment, refined by a parabola."""
        d = np.abs(whole - q)
        i = int(np.argmin(d))
        i = min(max(i, 1), whole.size - 2)
        a, b, c = d[i - 1], d[i], d[i + 1]
        u = 0.5 * (a - c) / (a - 2 * b + c)
        point = (
            whole[i]
            + 0.5 * u * (whole[i + 1] - whole[i - 1])
            + 0.5 * u * u * (whole[i + 1] - 2 * whole[i] + whole[i - 1])
        )
        return abs(q - point), (q - point) / abs(q - point)

    def residual(u: np.ndarray) -> np.ndarray:
        psi = -alpha / gear.zc + u[0] / 50.0
        moment, parts = torque_nm * 1000.0, []
        for d, place in enumerate(drive.discs):
            phase = np.deg2rad(place.crank_phase_deg)
            x, y, chi = u[1 + 3 * d : 4 + 3 * d]
            C = gear.a * np.exp(1j * (alpha + phase)) + x + 1j * y
            chi = -alpha / gear.zc + chi / 50.0
            teeth = chi + np.deg2rad(place.mark_angle_deg(gear.zc))
            force, turning = 0j, 0.0
            for Q in pins:
                q = (Q - C) * np.exp(-1j * teeth)
                distance, N = nearest(q)
                p = max(0.0, drive.pins.radius_mm - distance)
                F = drive.contact.stiffness_n_mm2 * gear.b * p
                N_fixed, r = N * np.exp(1j * teeth), (q - N * distance) * np.exp(1j * teeth)
                force -= F * N_fixed
                turning -= F * (r.conjugate() * N_fixed).imag
            for i in range(out.number):
                spoke = out.circle_mm * np.exp(2j * pi * i / out.number)
                M = spoke * np.exp(1j * psi) + gear.a * np.exp(1j * (alpha + phase))
                H = C + spoke * np.exp(1j * chi)
                far = abs(M - H)
                f = out.stiffness_n_mm * max(0.0, far - 1e-3 * out.clearance_um) * (M - H) / far
                force += f
                turning += ((H - C).conjugate() * f).imag
                moment -= ((spoke * np.exp(1j * psi)).conjugate() * f).imag
            parts += [force.real, force.imag, turning / 50.0]
        return np.array([moment / 50.0, *parts]) * 1e-4

    start = np.array([0.03] + [0.0, 0.0, 0.015] * len(drive.discs))
    found = least_squares(residual, start, x_scale=1e-3, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert np.max(np.abs(found.fun)) < 1e-5
    return np.asarray(found.x)


@pytest.mark.parametrize(("name", "alpha"), few([("", 0.3), ("RV-40E-like", 0.3), ("RV-40E-like", 2.1)]))
def test_a_second_program_without_tables_or_tangents_finds_the_same_pose(name: str, alpha: float) -> None:
    rng = np.random.default_rng(8)
    small = CycloidGear(rp=42.5, rrp=2.5, a=1.3, zp=18, zc=17, b=10.0, drrp=0.005)
    drive = shipped(name, "crank-holes") if name else for_gear(small, "crank-holes")
    drive = replace(drive, input_held="crank")
    A, B = rng.normal(size=(2, drive.gear.zc)) * 2.0
    part = flank(drive.gear, A=A[:, None, None], B=B[:, None, None])
    ours = Assembly(drive, [part, part]).solve(np.array([alpha]), 0.7 * drive.rated_nm)
    theirs = _second_program(drive, A, B, alpha, torque_nm=0.7 * drive.rated_nm)
    assert ours.psi[0] == pytest.approx(theirs[0] / 50.0, rel=2e-3)
    assert ours.place[0, :, :2].ravel() == pytest.approx(theirs[[1, 2, 4, 5]], abs=3e-5)
