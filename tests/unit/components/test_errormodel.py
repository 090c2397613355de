"""From captures of every set-up to the 21 errors: conventions of slope, mean and eccentricity, levers, locations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gateway.errors import ModelError
from gateway.evaluate.geometry.error_model import error_model
from gateway.evaluate.geometry.measurement import Measurement, arms, lever_um
from gateway.model.components import standard_uncertainty, value
from gateway.model.error_model import TWENTY_ONE, ErrorModel, chain_of_errors
from gateway.report.tooth.errors import error_rows
from tests.unit.components.machine import ARCSEC, PLACES, Machine


def whole_plan(machine: Machine) -> list[Measurement]:
    """All 21 with offsets, leaning references, eccentric ball and bar."""
    found = [machine.angle(f"E{way}{axis}") for axis in "XZ" for way in "ABC"]
    found += [machine.angle(f"E{way}C", lean=6.0) for way in "ABC"]
    found += [machine.length(f"E{way}X", (0.0, 8.0, 12.0), slope=0.12 if way != "X" else 0.0) for way in "XYZ"]
    found += [machine.length(f"E{way}Z", (10.0, -6.0, 0.0), slope=-0.1 if way != "Z" else 0.0) for way in "XYZ"]
    found += [machine.length(f"E{way}C", (0.0, 0.0, 25.0), eccentric=10.0) for way in "XYZ"]
    return [*found, *machine.square(0.8, 12.0), *machine.bar("A0C", 6.0), *machine.bar("B0C", 6.0)]


def wanted(machine: Machine, name: str) -> np.ndarray:
    """The truth by the same conventions."""
    at = PLACES[name[2]]
    true = machine.motion(name, at)
    if name[2] != "C":
        if name[1] in "XYZ" and name[1] != name[2]:
            true = true - np.polyval(np.polyfit(at, true, 1), at)
        reference = np.interp(0.0, at, true)
        return true - reference
    q = np.deg2rad(at)
    if name == "ECC":
        return true - true[0]
    pair = {"EXC": "EYC", "EYC": "EXC", "EAC": "EBC", "EBC": "EAC"}.get(name)
    true = true - true.mean()
    if pair is None:
        return true
    first, second = (machine.curves[one] for one in sorted((name, pair)))
    u, v = (first[0] + second[1]) / 2.0, (second[0] - first[1]) / 2.0
    turning = u * np.cos(q) - v * np.sin(q) if name < pair else u * np.sin(q) + v * np.cos(q)
    return true - turning


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_all_21_are_identified_within_max_of_03_and_5_percent(seed: int) -> None:
    machine = Machine(seed)
    model = error_model(whole_plan(machine), {})
    assert not model.unknown
    assert set(model.measured) == set(TWENTY_ONE)
    for one in model.motions:
        at = PLACES[one.name[2]]
        true = wanted(machine, one.name)
        limit = max(0.3, 0.05 * float(np.ptp(true)))
        assert np.max(np.abs(value(one, at) - true)) < limit, one.name


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_locations_are_those_of_the_bed_frame_that_x_and_z_make(seed: int) -> None:
    """The slopes of EZX, EXZ and EYZ go where a square or bar found them, and nowhere else."""
    machine = Machine(seed)
    model = error_model(whole_plan(machine), {})
    found = {one.name: one for one in model.locations}
    slopes = {
        name: np.polyfit(PLACES[name[2]], machine.motion(name, PLACES[name[2]]), 1)[0] * 1e-3 / ARCSEC
        for name in ("EZX", "EXZ", "EYZ")
    }
    squareness = machine.B0Z + slopes["EZX"] + slopes["EXZ"]
    lean = machine.B0Z + slopes["EXZ"] - machine.table_lean("B0C")
    true = {"B0Z": squareness, "A0C": machine.table_lean("A0C") + slopes["EYZ"], "B0C": squareness - lean}
    for name, value_arcsec in true.items():
        assert found[name].value == pytest.approx(value_arcsec, abs=0.3), name
        assert abs(found[name].value - value_arcsec) < 4.0 * found[name].u + 0.02
        assert 0.0 < found[name].u < 0.2
    assert "angle error of the square is +0.8" in str(found["B0Z"].how[0])


def test_uncertainty_covers_what_is_left_and_is_blind_to_slopes() -> None:
    off = []
    for seed in range(20):
        machine = Machine(seed, noise=0.2)
        model = error_model([machine.length("EYX", slope=0.3)], {})
        (one,) = model.motions
        at = PLACES["X"][::4]
        u = standard_uncertainty(one, at)
        off += list(((value(one, at) - np.interp(at, PLACES["X"], wanted(machine, "EYX"))) / np.maximum(u, 0.02))[:-1])
        sloped = error_model([machine.length("EYX", slope=-5.0)], {}).motions[0]
        assert np.max(standard_uncertainty(sloped, at)) < 0.3
    assert 0.6 < float(np.std(off)) < 1.5


def test_an_unmeasured_angle_leaves_its_lever_in_the_uncertainty_and_is_said() -> None:
    machine = Machine(4)
    known = error_model([machine.angle("EAX"), machine.length("EYX", (0.0, 0.0, 12.0))], {})
    blind = error_model([machine.length("EYX", (0.0, 0.0, 12.0))], {"EAX": 4.0})
    assert known.systematic["EYX"] == pytest.approx(0.05)
    share = 12.0 * 4.0 * ARCSEC * 1e3 / np.sqrt(3.0)
    assert blind.systematic["EYX"] == pytest.approx(np.hypot(0.05, share), rel=1e-6)
    assert any("EAX was not measured" in str(line) for line in blind.said)


@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
def test_levers_are_those_of_a_small_rotation(axis: str) -> None:
    arm, rotation = np.array([30.0, -70.0, 110.0]), np.array([2.0, -3.0, 4.0])
    moved = np.cross(np.radians(rotation / 3600.0), arm)["XYZ".index(axis)] * 1000.0
    levers = arms(axis, axis, tuple(arm))
    angles = {f"E{letter}{axis}": np.array([value]) for letter, value in zip("ABC", rotation, strict=True)}
    assert lever_um(levers, angles, 1)[0] == pytest.approx(moved, rel=1e-8)
    assert arms(axis, axis, (0.0, 0.0, 0.0)) == {}


def test_a_ball_tells_the_place_of_c_whatever_it_runs_out() -> None:
    machine = Machine(8)
    at = PLACES["C"]
    wave = 40.0 * np.cos(np.deg2rad(at) + 0.3)
    both = [machine.read("X0C", wave + 12.5, letter="C"), machine.read("Y0C", wave - 3.0, letter="C")]
    found = {one.name: one for one in error_model(both, {}).locations}
    assert (found["X0C"].value, found["Y0C"].value) == pytest.approx((12.5, -3.0), abs=0.05)
    assert found["X0C"].unit == "um"
    assert 0.05 < found["X0C"].u < 0.07


def test_one_direction_alone_loses_all_that_comes_once_a_turn() -> None:
    machine = Machine(5)
    model = error_model([machine.length("EXC", eccentric=10.0)], {})
    at = PLACES["C"]
    values = value(model.motions[0], at)
    assert abs(np.mean(values * np.exp(1j * np.deg2rad(at)))) < 0.05
    assert any("cannot be separated from" in str(line) for line in model.said)


def test_half_a_square_or_bar_is_no_location_and_stays_unknown() -> None:
    machine = Machine(6)
    square, bar = machine.square(0.8, 12.0), machine.bar("B0C", 6.0)
    model = error_model([*square[:2], bar[0]], {"B0Z": 9.0})
    assert not model.locations
    assert {one.name: one.span for one in model.unknown}["B0Z"] == 9.0
    assert sum("is not known" in str(line) for line in model.said) == 2
    given = [Measurement(**{**{k: getattr(m, k) for k in m.__dataclass_fields__}, "own_angle_arcsec": 0.8})
             for m in square[:2]]  # fmt: skip
    only = error_model([*given, *bar], {})
    assert {one.name for one in only.locations} == {"B0Z", "B0C"}
    other = replace(given[1], own_angle_arcsec=1.2)
    with pytest.raises(ModelError, match=r"\+0.8, \+1.2 arcsec"):
        error_model([given[0], other], {})


def test_what_is_not_measured_is_carried_with_its_span() -> None:
    machine = Machine(7)
    model = error_model([machine.angle("EBX")], {"EYX": 2.0}, linear_um=6.0, angular_arcsec=8.0)
    spans = {one.name: (one.span, one.unit) for one in model.unknown}
    assert len(spans) == 20
    assert spans["EYX"] == (2.0, "um")
    assert spans["EXZ"] == (6.0, "um")
    assert spans["A0C"] == (8.0, "arcsec")
    rows = {row.name: row for row in error_rows(model)}
    assert [row.state for row in rows.values()].count("measured") == 1
    assert (rows["EYX"].low, rows["EYX"].high, rows["EYX"].state) == (-2.0, 2.0, "assumed")
    assert rows["EBX"].unit == "arcsec"
    assert rows["EBX"].high - rows["EBX"].low == pytest.approx(np.ptp(machine.motion("EBX", PLACES["X"])), abs=0.2)


def test_the_chain_holds_what_was_measured() -> None:
    machine = Machine(8)
    model = error_model(whole_plan(machine), {})
    chain = chain_of_errors(model, height_mm=150.0)
    exx = chain.axis("X").err["dx"]
    assert callable(exx)
    assert exx(np.array([-400.0]))[0] == pytest.approx(wanted(machine, "EXX")[0] * 1e-3, abs=3e-4)
    assert chain.axis("Z").loc["B0"] == pytest.approx(
        next(o for o in model.locations if o.name == "B0Z").value * ARCSEC
    )
    assert ErrorModel().measured == ()


def test_a_curve_that_waves_as_fast_as_the_targets_follow_is_still_met_at_every_target() -> None:
    machine = Machine(9)
    for phase in np.linspace(0.0, 6.0, 13):
        true = 2.0 * np.sin(np.linspace(0.0, 13.0, 21) + phase) * np.linspace(0.2, 1.0, 21)
        true[7] += 1.5
        (one,) = error_model([machine.read("ECX", true)], {}).motions
        assert np.max(np.abs(value(one, PLACES["X"]) - (true - true[-1]))) < 0.3
