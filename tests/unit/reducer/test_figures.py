"""The figures of a drive, the names of orders, and what is refused with the reason."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear
from gateway.reducer.contact import Assembly
from gateway.reducer.figures import Transmission, cause, transmission
from gateway.reducer.records import SHIPPED, Contact, Cranks, DiscPlace, FirstStage, Pins, for_gear, place_at, shipped
from gateway.tooth import FlankMap
from tests.sizes import few
from tests.unit.reducer.drives import ARCSEC, COARSE, coarse, flank, forty, wave

SMALL = CycloidGear(rp=36.0, rrp=2.5, a=1.5, zp=12, zc=11, b=10.0, drrp=0.005)


@pytest.fixture(scope="module", params=few(["small", "RV-40E-like"]))
def figures(request: pytest.FixtureRequest) -> Transmission:
    small = for_gear(SMALL, "crank-holes")
    drive = small if request.param == "small" else shipped(request.param, "crank-holes")
    return transmission(drive, [wave(drive.gear, 2)] * 2, steps=24, slices=3)


def test_a_pattern_twice_round_both_discs_is_the_drive_s_largest_order(figures: Transmission) -> None:
    first = figures.orders()[0]
    assert (first.number, first.cause) == (2 * figures.drive.gear.zp, "disc:2")
    assert first.amplitude_arcsec < figures.error_arcsec
    assert figures.rms_arcsec >= first.amplitude_arcsec / np.sqrt(2.0)


def test_play_is_that_of_flanks_and_cranks(figures: Transmission) -> None:
    drive = figures.drive
    play = (2.0 * 5e-3 / drive.lever_mm + 2.0 * 1e-3 / drive.output.circle_mm) * ARCSEC
    assert figures.backlash == pytest.approx(play, rel=0.2)
    assert figures.lost_motion > figures.backlash
    assert figures.interference_um < 0.1


def test_pins_forces_and_pressure_carry_the_torque(figures: Transmission) -> None:
    drive = figures.drive
    share = drive.rated_nm * 1000.0 / len(drive.discs)
    assert 2.0 < figures.touching.mean() < drive.gear.zp / 2.0
    assert figures.force_n.min() > 4.0 * share / (drive.gear.zp * drive.lever_mm)
    assert figures.pressure_mpa.max() < drive.contact.limit_mpa


def test_what_holds_the_input_is_checked() -> None:
    _refused("E-REDUCER-VALUE", replace, forty(), input_held="planet")
    _refused("E-REDUCER-VALUE", replace, forty(), first_stage=FirstStage(0.5))
    drive = shipped("RV-40E-like", None)
    assert drive.followed == pytest.approx(39.0 / (40.0 + 40.0 / 120.0))
    assert replace(drive, first_stage=FirstStage(81.0)).followed == pytest.approx(0.963, abs=5e-4)
    assert replace(drive, input_held="crank").followed == forty().followed == 1.0


def test_every_shipped_drive_turns_about_as_catalogues_say() -> None:
    stiffness = {"RV-20E-like": 49.0, "RV-320E-like": 980.0}
    for name in SHIPPED[:1] + SHIPPED[2:3]:
        drive = shipped(name, "bore")
        found = Assembly(drive, [None, None])
        alpha = np.linspace(0.0, 2.0 * np.pi, 8)
        full = found.solve(alpha, drive.rated_nm)
        half = found.solve(alpha, 0.5 * drive.rated_nm)
        turned = (full.psi - half.psi).mean() * ARCSEC / 60.0
        assert 0.5 * drive.rated_nm / turned == pytest.approx(stiffness[name], rel=0.05)


def test_a_plain_cycloid_drive_with_output_pins_is_solved_too() -> None:
    found = transmission(shipped("cycloid-like", "bore"), [None], steps=24, slices=3)
    assert found.crank_rad.size == 24 * 17
    assert found.lost_motion > found.backlash > 0.0
    assert found.loaded[0].peak_to_peak_arcsec > 0.0


def test_the_first_stage_adds_its_wave_over_zp() -> None:
    drive = replace(for_gear(SMALL, None), first_stage=FirstStage(105.0, 60.0), discs=(DiscPlace(),))
    found = transmission(drive, [None], steps=24, slices=3)
    assert found.loaded[0].amplitudes_arcsec()[104] == pytest.approx(60.0 / (12.0 + 12.0 / 104.0), rel=0.003)
    assert found.orders()[0].cause == "input"


@pytest.mark.parametrize(
    ("order", "name"),
    [
        (40, "disc:1"),
        (80, "disc:2"),
        (39, "ring:1"),
        (117, "ring:3"),
        (1, "output"),
        (2, "mixed:2 zp -2 zc"),
        (79, "mixed:1 zp +1 zc"),
        (1560, "profile"),
        (120, "disc:3"),
    ],
)
def test_orders_are_named_by_their_cause(order: int, name: str) -> None:
    assert cause(forty(), order) == name


def test_what_24_steps_cannot_show_is_called_folded() -> None:
    """zp zc = 1560 appears among 936 samples at 1872 - 1560 = 312, which is no eighth wave of the ring."""
    assert cause(forty(), 312, 936) == "folded"
    assert cause(forty(), 312) == "ring:8"


def test_both_senses_differ_and_each_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    coarse(monkeypatch)
    drive = replace(for_gear(SMALL, "bore"), discs=(DiscPlace(),))
    rng = np.random.default_rng(1)
    found = transmission(drive, [flank(drive.gear, B=rng.normal(size=(11, 1, 1)))], steps=COARSE)
    forward, backward = found.loaded
    assert forward.torque_nm == -backward.torque_nm == drive.rated_nm
    assert found.error_arcsec == max(forward.peak_to_peak_arcsec, backward.peak_to_peak_arcsec)
    assert forward.peak_to_peak_arcsec != pytest.approx(backward.peak_to_peak_arcsec, rel=1e-3)


def _refused(code: str, make: object, *arguments: object, **named: object) -> ModelError:
    with pytest.raises(ModelError) as raised:
        make(*arguments, **named)  # type: ignore[operator]
    assert raised.value.code == code
    return raised.value


def test_lobes_and_undercut_are_refused_with_the_gear() -> None:
    _refused("E-GEAR-LOBES", CycloidGear, rp=64.0, rrp=3.0, a=1.3, zp=40, zc=38)
    _refused("E-GEAR-UNDERCUT", CycloidGear, rp=64.0, rrp=4.7, a=1.3, zp=40, zc=39)


def test_a_drive_without_room_for_its_parts_is_refused() -> None:
    error = _refused("E-REDUCER-CLEARANCE", forty, drrp=-0.002)
    assert str(error.fields["clearance"]) == "-2.00"
    _refused("E-REDUCER-CLEARANCE", forty, drp=0.003)


def test_discs_with_more_surplus_than_assembly_squeezes_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    coarse(monkeypatch)
    drive = replace(for_gear(SMALL, "bore"), discs=(DiscPlace(),))
    error = _refused("E-REDUCER-ASSEMBLY", transmission, drive, [flank(drive.gear, A=30.0)], steps=COARSE)
    assert float(str(error.fields["interference"])) > 3.0


def test_torque_beyond_the_contact_s_limit_is_refused() -> None:
    _refused("E-REDUCER-TORQUE", Assembly(forty(), [None]).solve, np.zeros(1), 20_000.0)
    _refused("E-REDUCER-TORQUE", Assembly(forty(), [None]).solve, np.zeros(1), -900_000.0)
    _refused("E-REDUCER-LOAD", transmission, forty(), [None], torque_nm=1.0)


@pytest.mark.parametrize("torque_nm", [100.0, 412.0, 1000.0])
def test_no_load_distribution_is_softer_than_the_pressure_that_refuses_a_torque(torque_nm: float) -> None:
    assembly = Assembly(forty(), [None])
    assert 0.0 < assembly._least_pressure(torque_nm) < assembly.solve(np.zeros(1), torque_nm).pressure.max()


def test_deviations_without_a_datum_are_refused() -> None:
    drive = replace(forty(), datum=None)
    error = _refused("E-REDUCER-DATUM", Assembly, drive, [wave(drive.gear, 1)])
    assert "crank-holes" in str(error.fields["known"])
    _refused("E-REDUCER-DATUM", replace, drive, datum="table")


@pytest.mark.parametrize(
    ("code", "change"),
    [
        ("E-REDUCER-PINS", {"pins": Pins(39, 64.0, 3.0)}),
        ("E-REDUCER-VALUE", {"pins": Pins(40, 64.0, inf)}),
        ("E-REDUCER-COUNT", {"pins": Pins(40, 64.0, 3.0, (1.0, 2.0))}),
        ("E-REDUCER-DISCS", {"discs": ()}),
        ("E-REDUCER-VALUE", {"output": Cranks(0, 36.0, 1e5)}),
        ("E-REDUCER-VALUE", {"contact": Contact(stiffness_n_mm2=0.0)}),
        ("E-REDUCER-RIGID", {"output": Cranks(2, 36.0, inf, 0.0, eccentricity_um=((1.0, 2.0),))}),
        ("E-REDUCER-VALUE", {"rated_nm": -1.0}),
    ],
)
def test_a_record_that_cannot_be_a_drive_is_refused(code: str, change: dict[str, object]) -> None:
    _refused(code, replace, forty(), **change)


def test_flanks_of_another_gear_are_refused() -> None:
    drive = forty()
    part = wave(drive.gear, 1)
    holed = part.deviation_um.copy()
    holed[3, 2, 0] = np.nan
    for wrong in (
        FlankMap(part.theta_rad, part.z_mm, part.deviation_um[:20]),
        FlankMap(part.theta_rad, part.z_mm, holed),
        FlankMap(part.theta_rad[::-1], part.z_mm, part.deviation_um),
        FlankMap(part.theta_rad, part.z_mm + 20.0, part.deviation_um),
    ):
        _refused("E-REDUCER-FLANK", Assembly, drive, [wrong])
    _refused("E-REDUCER-COUNT", Assembly, drive, [part, part])


def test_a_mark_between_the_teeth_is_refused_with_the_nearest_tooth() -> None:
    assert place_at(180.0, 180.0, 39) == DiscPlace(180.0, 20)
    assert place_at(180.0 / 39, 180.0, 39) == DiscPlace(180.0, 1)
    error = _refused("E-REDUCER-MARK", place_at, 0.0, 180.0, 39)
    assert abs(float(str(error.fields["nearest"]))) == pytest.approx(180.0 / 39, rel=1e-4)


def test_too_few_steps_and_an_unknown_drive_are_refused() -> None:
    _refused("E-REDUCER-STEPS", transmission, forty(), [None], steps=12)
    _refused("E-REDUCER-NAME", shipped, "RV-5000", None)


def test_a_gear_without_modification_gets_a_drive_with_clearance() -> None:
    assert for_gear(CycloidGear(64.0, 3.0, 1.3, 40, 39, 10.0), "bore").mean_clearance_um == pytest.approx(5.0)
    assert for_gear(forty(drrp=0.003).gear, "bore").mean_clearance_um == pytest.approx(3.0)
