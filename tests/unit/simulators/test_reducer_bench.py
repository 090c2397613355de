"""The reducer on its bench: laws and closed forms of mechanics, convergence, friction's loop, record, refusals."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigError
from simulators.cellfile import Gear
from simulators.grinding import CycloidDisc
from simulators.reducer.__main__ import main
from simulators.reducer.bench import Bench, load_bench, packaged_benches
from simulators.reducer.equilibrium import Mechanism
from simulators.reducer.parts import Contact, CrankSet, Disc, FirstStage, Flanks, Reducer, Ring, have_equal_discs, marks
from simulators.truth import Truth
from tests.unit.simulators.planned_run import ground
from tests.unit.simulators.test_grinding import ELEVEN, cell_of

ARCSEC = np.pi / 648000.0
LARGE = Gear(rp=64.0, rrp=3.0, a=1.3, zp=40, zc=39, b=10.0)
SMALL = Gear(rp=45.0, rrp=4.0, a=2.0, zp=12, zc=11, b=12.0)


def flanks(gear: Gear, turned_um: object = 0.0, moved_um: object = 0.0, all_um: float = 0.0) -> Flanks:
    """One slice: spaces turned (um at the largest lever) or moved outwards (um), each (zc,), and all flanks equally."""
    lobes = CycloidDisc(gear)
    t = lobes.even(41, 0.998)
    point, normal = lobes.profile(t)
    lever = np.imag(np.conj(point) * normal) / (gear.a * gear.zc)
    turned, moved = (np.broadcast_to(np.asarray(one, float), gear.zc)[:, None] for one in (turned_um, moved_um))
    return Flanks(t, (turned * lever + moved * normal.real + all_um)[:, :, None])


def reducer(
    gear: Gear,
    *discs: Flanks,
    places: tuple[int, ...] | None = None,
    ring: Ring | None = None,
    cranks: CrankSet | None = None,
    **more: object,
) -> Reducer:
    """Rigid cranks, a perfect ring and one perfect disc unless said otherwise; the input is the crank."""
    built = have_equal_discs(gear, discs or (Flanks.nominal(gear),), places)
    held = cranks or CrankSet.perfect(3, len(built), 0.55 * gear.rp)
    return Reducer(gear=gear, ring=ring or Ring.of(gear), discs=built, cranks=held, **more)  # type: ignore[arg-type]


def turn(gear: Gear, each: int) -> np.ndarray:
    """Crank angles of one whole turn of the output."""
    return -2.0 * np.pi * np.arange(each * gear.zc) / each


def orders(error_rad: np.ndarray) -> np.ndarray:
    """Amplitudes in arcsec of the orders 0, 1, 2 ... of evenly spaced values over a turn."""
    return 2.0 * np.abs(np.fft.rfft(error_rad)) / len(error_rad) / ARCSEC


def test_perfect_parts_transmit_evenly_and_as_stiffly_as_the_closed_form() -> None:
    crank = np.linspace(0.0, 2.0 * np.pi, 7)
    rest = Mechanism(reducer(LARGE, contact=Contact(2e4))).rest(crank, 30.0)
    stiffness = 2e4 * 10.0 * 40 * (1.3 * 39) ** 2 / 4.0
    assert np.ptp(rest.error_rad) / ARCSEC < 0.01
    assert rest.error_rad == pytest.approx(30e3 / stiffness, rel=5e-3)
    loaded = Mechanism(reducer(LARGE, Flanks.nominal(LARGE), Flanks.nominal(LARGE))).rest(crank, 100.0)
    assert loaded.force_n.max() == pytest.approx(4.0 * 50e3 / (40 * 1.3 * 39), rel=2e-3)


def test_forces_of_the_pins_carry_the_torque() -> None:
    """The moment by the pins' forces and levers about the disc's own centre, worked out here from the kinematics."""
    crank = np.asarray([0.3, 2.0, 4.4])
    rest = Mechanism(reducer(SMALL, flanks(SMALL, all_um=-2.0))).rest(crank, 20.0)
    K = SMALL.a * SMALL.zp / SMALL.rp
    phi = 2.0 * np.pi * np.arange(SMALL.zp) / SMALL.zp - crank[:, None]
    lever = SMALL.a * SMALL.zc * np.abs(np.sin(phi)) / np.sqrt(1.0 + K * K - 2.0 * K * np.cos(phi))
    assert np.sum(rest.force_n[:, 0] * lever, axis=1) == pytest.approx(20e3, rel=3e-3)


def test_a_rotation_of_all_spaces_turns_the_output_back_and_does_nothing_else() -> None:
    crank = turn(SMALL, 4)
    plain = Mechanism(reducer(SMALL, flanks(SMALL, all_um=-5.0))).rest(crank, 5.0)
    g = 10e-3 / (SMALL.a * SMALL.zc)
    turned = Mechanism(reducer(SMALL, flanks(SMALL, turned_um=10.0, all_um=-5.0))).rest(crank, 5.0)
    assert turned.error_rad - plain.error_rad == pytest.approx(-g, rel=3e-3)


def test_a_gap_on_all_flanks_is_free_play_as_its_closed_form_has_it() -> None:
    crank = np.linspace(0.0, 2.0 * np.pi, 60)
    built = Mechanism(reducer(LARGE, flanks(LARGE, all_um=-4.0), contact=Contact(2e5)))
    play = built.rest(crank, 0.02).error_rad - built.rest(crank, -0.02).error_rad
    assert play.min() == pytest.approx(2.0 * 4e-3 / (1.3 * 39), rel=3e-3)


def test_a_thick_pin_shows_once_a_turn_of_the_crank_and_nowhere_else() -> None:
    thick = np.zeros(12)
    thick[3] = 1.0
    found = [
        Mechanism(reducer(SMALL, flanks(SMALL), ring=Ring.of(SMALL, one))).rest(turn(SMALL, 12), 30.0).error_rad
        for one in (thick, np.zeros(12))
    ]
    seen = orders(found[0] - found[1])
    other = np.delete(seen, np.arange(0, len(seen), SMALL.zc))
    assert seen[SMALL.zc] > 0.2
    assert other.max() < 1e-6


def test_run_out_of_a_disc_shows_at_the_order_of_the_pins() -> None:
    wave = 3.0 * np.cos(2.0 * np.pi * np.arange(SMALL.zc) / SMALL.zc)
    found = Mechanism(reducer(SMALL, flanks(SMALL, wave))).rest(turn(SMALL, 12), 30.0)
    seen = orders(found.error_rad)
    assert seen[SMALL.zp] > 1.0
    assert np.argmax(seen[1:]) + 1 == SMALL.zp
    assert seen[1] < 0.05 * seen[SMALL.zp]


def test_two_discs_cancel_once_a_turn_errors_only_where_their_marks_are_near_each_other() -> None:
    wave = 3.0 * np.cos(2.0 * np.pi * np.arange(SMALL.zc) / SMALL.zc)
    one = flanks(SMALL, wave, all_um=0.0)
    alone = orders(Mechanism(reducer(SMALL, one)).rest(turn(SMALL, 12), 30.0).error_rad)[SMALL.zp]
    seen = []
    for mark in (0, SMALL.zc // 2 + 1):
        pair = Mechanism(reducer(SMALL, one, one, places=(0, mark))).rest(turn(SMALL, 12), 60.0)
        seen.append(orders(pair.error_rad)[SMALL.zp])
    assert seen[0] < 0.2 * alone  # left: about pi/(2 zc)
    assert seen[1] == pytest.approx(alone, rel=0.05)


def test_torque_and_machine_mirrored_give_the_mirrored_error() -> None:
    rng = np.random.default_rng(5)
    turned, moved = rng.normal(0.0, 2.0, (2, SMALL.zc))
    thick = rng.normal(0.0, 1.0, SMALL.zp)
    cranks = CrankSet.perfect(3, 1, 25.0, 1e5, 3.0)
    there = np.arange(SMALL.zc)
    back = Mechanism(
        reducer(
            SMALL,
            flanks(SMALL, -turned[-there], moved[-there], -3.0),
            ring=Ring.of(SMALL, thick[-np.arange(SMALL.zp)]),
            cranks=cranks,
        )
    )
    built = reducer(SMALL, flanks(SMALL, turned, moved, -3.0), ring=Ring.of(SMALL, thick), cranks=cranks)
    crank = np.linspace(0.1, 6.0, 9)
    one, other = Mechanism(built).rest(crank, 25.0), back.rest(-crank, -25.0)
    assert one.error_rad / ARCSEC == pytest.approx(-other.error_rad / ARCSEC, abs=0.02)


def test_bearings_of_the_cranks_yield_as_springs_at_their_radius() -> None:
    """With a mesh that hardly yields the cranks' springs are left: wind-up T/(3 k Rc^2), and the disc floats aside."""
    held = CrankSet.perfect(3, 1, 25.0, 1e4)
    rest = Mechanism(reducer(SMALL, cranks=held, contact=Contact(2e6))).rest(np.asarray([0.0, 0.4, 1.1]), 20.0)
    aloft = 20e3 / (3.0 * 1e4 * 25.0**2)
    assert (rest.error_rad > aloft).all()
    assert (rest.error_rad < 3.0 * aloft).all()


def test_finer_outlines_change_nothing() -> None:
    rng = np.random.default_rng(2)
    disc = flanks(SMALL, rng.normal(0.0, 2.0, SMALL.zc), rng.normal(0.0, 2.0, SMALL.zc), -4.0)
    built = reducer(SMALL, disc, cranks=CrankSet.perfect(8, 1, 26.0, 8e4, 4.0))
    coarse, usual, fine = (Mechanism(built, points).rest(turn(SMALL, 6), 30.0).error_rad for points in (96, 384, 1536))
    assert np.max(np.abs(usual - fine)) / ARCSEC < 0.01
    assert np.max(np.abs(usual - fine)) <= np.max(np.abs(coarse - fine))


def test_the_first_stage_reaches_the_output_divided_by_the_pins() -> None:
    """60 arcsec of the planets against the output: 60/zp arcsec, once a turn of the sun against the output."""
    sun = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    stage = FirstStage(16, 32, once_arcsec=60.0)
    inputs = sun * 81.0 / 80.0
    with_ = Mechanism(reducer(LARGE, stage=stage)).rest(inputs, 5.0).error_rad
    without = Mechanism(reducer(LARGE, stage=replace(stage, once_arcsec=0.0))).rest(inputs, 5.0).error_rad
    # Held by the sun the cranks turn along: psi (zc + 1 + r) = r theta - error.
    assert (with_ - without) / ARCSEC == pytest.approx(-60.0 / 40.5 * np.cos(sun), abs=2e-3)


# ------------------------------------------------------------------------------------------------ the bench itself


def quiet(name: str = "single", **update: object):
    """A packaged bench with perfect encoders."""
    spec = load_bench(name)
    still = {"input_encoder": type(spec.input_encoder)(), "output_encoder": type(spec.output_encoder)()}
    return spec.model_copy(update={**still, **update})


def test_the_loop_is_as_wide_as_friction_over_stiffness() -> None:
    spec = quiet()
    dry = spec.friction.model_copy(update={"dry_nm": 3.0, "dry_share": 0.0})
    perfect = reducer(SMALL, cranks=CrankSet.perfect(3, 1, 25.0))
    record = Bench(spec.model_copy(update={"friction": dry}), reducer=perfect).hysteresis(torque_nm=40.0)
    first = np.flatnonzero(record.torque_nm == 0.0)
    stiffness = 2e4 * 12.0 * 12 * (2.0 * 11) ** 2 / 4.0
    width = np.deg2rad(record.output_deg[first[1]] - record.output_deg[first[2]])
    assert width == pytest.approx(2.0 * 3e3 / stiffness, rel=0.03)
    without = dry.model_copy(update={"dry_nm": 0.0})
    record = Bench(spec.model_copy(update={"friction": without}), reducer=perfect).hysteresis(torque_nm=40.0)
    for torque in np.unique(record.torque_nm[record.torque_nm != 0.0]):
        assert np.ptp(record.output_deg[record.torque_nm == torque]) == 0.0


def test_a_record_counts_both_encoders_and_knows_its_reducer() -> None:
    bench = Bench(quiet())
    record = bench.running(steps=8)
    assert np.polyfit(record.input_deg, record.output_deg, 1)[0] == pytest.approx(1.0 / bench.reducer.ratio, rel=1e-5)
    assert record.stated["Ratio"] == "-11"
    assert (np.diff(record.time_s) > 0.0).all()
    assert np.ptp(record.output_deg) > 360.0
    assert np.count_nonzero(np.diff(np.sign(np.diff(record.output_deg)))) == 1
    ahead, back = record.output_deg[: len(record.time_s) // 2], record.output_deg[len(record.time_s) // 2 :]
    assert (back[::-1] - ahead).mean() > 0.0  # friction leans on the other flank: the drive trails its motion


def test_warmer_discs_take_the_play() -> None:
    spec = quiet()
    loose = Bench(spec).reducer.ring.centres
    warm = spec.climate.model_copy(update={"discs_warmer_k": 10.0})
    grown = Bench(spec.model_copy(update={"climate": warm})).reducer.ring.centres
    assert np.abs(grown) - np.abs(loose) == pytest.approx(-10.0 * 11.5e-6 * 45.0, rel=1e-3)


def test_seeds_draw_other_machines_of_the_same_kind_and_the_same_again() -> None:
    for name in packaged_benches():
        spec = load_bench(name)
        one, again, other = spec.reducer(), spec.reducer(spec.seed), spec.reducer(7)
        assert np.array_equal(one.ring.radii, again.ring.radii)
        assert not np.array_equal(one.ring.radii, other.ring.radii)
        assert one.discs[0].flanks.deviation_um.std() > 0.5


def test_a_disc_that_the_simulated_grinder_ground_is_built_in_as_it_is() -> None:
    """EXX by a constant moves every space outwards or inwards: the play is where gap over lever is least."""
    cell = cell_of({"EXX": 5.0}, gear=ELEVEN)
    assert cell.part is not None
    gear = cell.part.gear
    work = ground(Truth(cell), cell.part)
    taken = Flanks.ground(work, profile=41, slices=1)
    inside = abs(taken.deviation_um[:, 20, 0].mean())
    assert inside == pytest.approx(5.0, abs=0.1)
    assert taken.deviation_um[3, 20, 0] < 0.0
    built = Mechanism(reducer(gear, taken, contact=Contact(2e5)))
    crank = np.linspace(0.0, 6.0, 12)
    play = built.rest(crank, 0.05).error_rad - built.rest(crank, -0.05).error_rad
    point, normal = CycloidDisc(gear).profile(np.linspace(0.01, 0.25, 500))
    least = np.min(normal.real / np.abs(np.imag(np.conj(point) * normal)))
    assert play.min() == pytest.approx(2.0 * inside * 1e-3 * least, rel=0.01)


def test_the_command_writes_a_record_from_given_flanks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = np.asarray([-0.2, 0.0, 0.2])
    rows = [f"{k},{at},{z},{-5.0}" for k in range(11) for at in t for z in (0.0,)]
    disc, out = tmp_path / "disc.csv", tmp_path / "record.csv"
    disc.write_text("\n".join(["space,t_rad,z_mm,surplus_um", *rows]))
    given = ["single", "--disc", str(disc), "--test", "hysteresis", "-o", str(out)]
    assert main(given) == 0
    assert json.loads(capsys.readouterr().out)["record"] == str(out)
    lines = out.read_text().splitlines()
    assert "time_s,input_angle_deg,output_angle_deg,torque_Nm,temperature_degC" in lines
    assert main(given) != 0  # a record is never replaced
    disc.write_text("\n".join(["heading", *rows[:-1]]))
    assert main([*given[:-1], str(tmp_path / "other.csv")]) != 0
    assert "E-BENCH-FLANKS" in capsys.readouterr().err


def test_what_cannot_be_built_or_loaded_is_refused() -> None:
    with pytest.raises(ConfigError, match="E-BENCH-DISC"):
        Reducer(SMALL, Ring.of(SMALL), (Disc(Flanks.nominal(SMALL), np.pi, 0.0),), CrankSet.perfect(3, 1, 25.0))
    with pytest.raises(ConfigError, match="E-BENCH-DISC"):
        reducer(SMALL, Flanks(np.asarray([-0.1, 0.1]), np.zeros((10, 2, 1))))
    with pytest.raises(ConfigError, match="E-BENCH-TORQUE"):
        Mechanism(reducer(SMALL)).rest(0.0, 0.0)
    with pytest.raises(ConfigError, match="E-BENCH-TORQUE"):
        Mechanism(reducer(SMALL)).rest(0.0, 1e9)
    with pytest.raises(ConfigError, match="E-BENCH-FILE"):
        load_bench("no-such-bench")


def test_marks_are_the_places_in_which_teeth_meet_pins() -> None:
    """A disc on the other eccentric stands an odd number of half pitches away."""
    found = np.sort(marks(SMALL, np.pi) / (np.pi / SMALL.zc))
    assert found == pytest.approx(2.0 * np.arange(11) + 1.0)
