"""What tables, set-up values and wheel give on a part: their order, the flank after each, u, floor and drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gateway.gear.flank import flank_grid
from gateway.gear.process_drift import set_right
from gateway.process.order import DriveOfOrder, form_on, order_corrections
from gateway.process.separation import separate
from gateway.process.wheel import wheel_correction
from gateway.process.wheel_form import ProcessPart
from gateway.reducer.figures import without_limit
from gateway.reducer.records import for_gear
from gateway.reducer.uncertainty import essentials
from gateway.tooth import FlankMap, FlankPrediction
from gateway.workflow.tooth.wheel_in_run import order_lines, unexplained_field
from tests.unit.process.shop import DISC, DISC_DISTANCE, ORDER, Shop

U = 0.2


@pytest.fixture(scope="module")
def ground() -> Shop:
    return Shop({"form": [{"waves": 1.5, "left_um": 3.0, "right_um": 2.5}]})


def prediction(scale: float) -> FlankPrediction:
    """Tables take off three waves over C along x, of that size in um."""
    grid = flank_grid(DISC, profile=11, width=5)
    wave = (
        scale
        * np.cos(3.0 * np.asarray(DISC.space_angle(grid.ks)))[:, None, None]
        * DISC.section(grid.thetas).nx[None, :, None]
    )
    one = FlankMap(grid.thetas, grid.zs, np.broadcast_to(wave, grid.shape).copy())
    none = replace(one, deviation_um=np.zeros(grid.shape))
    return FlankPrediction(one, none, none, 0.1, U, np.full(grid.shape, U), 0.2, 0.1)


def test_the_best_correction_comes_first_and_each_takes_what_is_its_own(ground: Shop) -> None:
    ground.set_up(6.0, 0.0)
    _, part = ground.part()
    found = separate(DISC, [ProcessPart.of(part, order=ORDER)])
    said = prediction(0.8)
    # The tables' wave is on the part as well: its machine has none of its own.
    part = replace(part, fitted=replace(part.fitted, deviation_um=part.fitted.deviation_um + said.before.deviation_um))
    dressed = wheel_correction(DISC, DISC_DISTANCE, found, diamond_mm=0.4, limit_um=20.0)
    order = order_corrections(DISC, part, found, said, correction_um=dressed.correction_um)
    assert [one.name for one in order.steps] == ["as ground", "set-up", "wheel", "tables"]
    sizes = [one.flank_um for one in order.steps]
    # By hand: a shift along x shows as n_x, the form of the wheel as it was given, the wave by its own RMS.
    nx = float(np.sqrt(np.mean(DISC.section(part.fitted.theta_rad).nx ** 2)))
    form = form_on(part.fitted.theta_rad, found.form, np.asarray(found.form.deviation_um))
    assert sizes[0] ** 2 - sizes[1] ** 2 == pytest.approx((6.0 * nx) ** 2, rel=0.2)
    assert sizes[1] ** 2 - sizes[2] ** 2 == pytest.approx(np.mean(form**2), rel=0.1)
    assert np.sqrt(np.mean(form**2)) == pytest.approx(np.sqrt(0.5 * (3.0**2 + 2.5**2) / 2.0), rel=0.25)
    assert sizes[2] ** 2 - sizes[3] ** 2 == pytest.approx(set_right(said.before, DISC).rms_um ** 2, rel=0.25)
    u = [one.u_um for one in order.steps]
    assert u == sorted(u)
    assert u[3] ** 2 - u[2] ** 2 == pytest.approx(U**2)
    assert (order.floor_um, order.undressed_floor_um) == (0.1, pytest.approx(np.hypot(0.1, np.sqrt(np.mean(form**2)))))
    assert [line.code for line in order_lines(order)] == ["S-CORRECTIONS-STEP"] * 4 + ["S-CORRECTIONS-FLOOR"]

    kept = order_corrections(DISC, part, found, said)
    assert [one.name for one in kept.steps] == ["as ground", "set-up", "tables"]
    assert kept.floor_um == kept.undressed_floor_um == order.undressed_floor_um
    assert kept.steps[-1].flank_um > sizes[2]


@pytest.mark.long
def test_the_drive_of_each_step_is_that_of_its_flank(ground: Shop) -> None:
    ground.set_up(6.0, 0.0)
    _, part = ground.part()
    found = separate(DISC, [ProcessPart.of(part, order=ORDER)])
    said = prediction(0.0)
    drive = for_gear(DISC, "crank-holes")
    dressed = wheel_correction(DISC, DISC_DISTANCE, found, diamond_mm=0.4, limit_um=20.0)
    order = order_corrections(
        DISC, part, found, said, correction_um=dressed.correction_um, drive=DriveOfOrder(drive, 3.0)
    )
    last, free = order.steps[-1], without_limit(drive)
    theta = part.fitted.theta_rad
    left = np.asarray(found.form.deviation_um) - dressed.correction_um
    wheel = form_on(theta, found.form, left)[None, :, None]
    flank = set_right(replace(part.fitted, deviation_um=part.fitted.deviation_um + wheel), DISC)
    assert last.transmission_arcsec == pytest.approx(essentials(free, [flank] * len(free.discs)).error_arcsec, rel=0.05)
    assert last.transmission_u_arcsec is not None
    assert last.transmission_u_arcsec >= 3.0


def test_what_two_parts_share_beside_the_prediction_is_told_from_their_scatter(ground: Shop) -> None:
    ground.set_up(0.0, 0.0)
    parts = [ground.part()[1] for _ in range(2)]
    said = prediction(0.0).after
    quiet = unexplained_field(DISC, parts[0], parts[1], said)
    assert not quiet.sure
    bend = 1.5 * (parts[0].fitted.z_mm / np.max(parts[0].fitted.z_mm)) ** 2
    bent = [
        replace(one, fitted=replace(one.fitted, deviation_um=one.fitted.deviation_um + bend[None, None, :]))
        for one in parts
    ]
    loud = unexplained_field(DISC, bent[0], bent[1], said)
    assert loud.sure
    assert loud.over_z_um > 3.0 * loud.over_c_um
    assert loud.u_um == pytest.approx(quiet.u_um)
