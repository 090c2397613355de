"""The second layer on the tables of the first as they will be live: no deviation twice, constants to set-up values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gateway.correct.flank.mounting import WorkMounting
from gateway.correct.flank.noise import FitNoise, Shape, noise_patterns
from gateway.correct.plan.layers import LayeredCorrection, correct
from gateway.correct.plan.plan import AxisGrid, Plan
from gateway.errors import ModelError
from gateway.gear.first_order import ErrorParameter, bounded_first_order
from gateway.gear.flank import flank_figure
from gateway.gear.grinding import Grinding
from gateway.model.motion import Fourier, MotionSum, Polynomial
from tests.unit.correct.machines import PLAN, machine


def test_given_tables_are_the_first_layer_and_nothing_of_them_is_in_the_second() -> None:
    grinding, grid = machine(2)
    own = correct(grinding, grid, PLAN)
    given = correct(grinding, grid, PLAN, own=own.own)
    assert given.own == own.own
    assert {one.name: one.deviations for one in given.cross} == {one.name: one.deviations for one in own.cross}
    with pytest.raises(ModelError) as caught:
        correct(grinding, grid, PLAN, own=own.cross[:1])
    assert caught.value.code == "E-CORRECT-OWN"


def test_a_deviation_that_eec_takes_is_not_in_cec_and_one_it_leaves_is() -> None:
    """The same machine with and without an own deviation of C, the EEC table of C given or left out."""
    plain, grid = machine(4)
    wave = Fourier(0.0, (2e-5,), (1e-5,))  # a few arcsec once a turn
    chain = plain.chain
    with_wave = replace(plain, chain=chain.with_errors({"ECC": MotionSum((chain.axis("C").err.get("ec", 0.0), wave))}))
    without = correct(plain, grid, PLAN)
    taken = correct(with_wave, grid, PLAN, own=correct(with_wave, grid, PLAN).own)
    others = tuple(one for one in taken.own if one.name != "C(C)")
    left = correct(with_wave, grid, PLAN, own=others)
    wanted = table(without)
    # Both layers are rounded to 0.36 arcsec a point; the wave has an amplitude of 4.6 arcsec.
    assert np.max(np.abs(table(taken) - wanted)) < 0.75
    assert np.max(np.abs(table(left) - wanted)) > 4.0
    assert left.checked.rms == pytest.approx(taken.checked.rms, abs=1e-4)
    second = bounded_first_order(left.machine, grid.k, grid.theta, grid.z).second
    assert flank_figure(np.broadcast_to(second, grid.shape), grid.section.h).rms == pytest.approx(left.checked.rms)


def table(found: LayeredCorrection) -> np.ndarray:
    """C(C) of the second layer, arcsec; zeros if there is none."""
    return next((np.asarray(one.deviations) for one in found.cross if one.name == "C(C)"), np.zeros(13))


def test_a_constant_is_the_set_up_value_s_even_where_a_table_could_take_it() -> None:
    """An infeed that is off by a constant nobody knows well: x zero takes it, and no table is judged by that doubt."""
    plain, grid = machine(6)
    off = replace(plain, chain=plain.chain.without_errors().with_errors({"EXX": 0.004, "EXZ": Polynomial((0.0, 6e-4))}))
    doubts = [(ErrorParameter("EXX"), 0.0015), (ErrorParameter("EXZ", Shape(1, -10.0, 10.0, turning=False)), 1e-4)]
    noise: FitNoise = noise_patterns(off, grid, doubts)
    # Zero far below the face, so that the table over Z could hold a constant on it.
    grids = (PLAN.grids[0], AxisGrid("Z", -30.0, 10.0, 5.0, -30.0), PLAN.grids[2])
    plan: Plan = replace(PLAN, grids=grids, noise=noise)
    found = correct(off, grid, plan)
    over_z = next(one for one in found.cross if one.name == "X(Z)")
    face = np.asarray(over_z.deviations)[5:8]
    assert found.setup.x_um == pytest.approx(-4.0, abs=0.1)
    assert face == pytest.approx([3.0, 0.0, -3.0], abs=0.3)
    assert found.checked.rms < 1e-4


def test_a_machine_as_its_work_sits_is_told_beside_the_one_put_right() -> None:
    plain, grid = machine(8)
    found = correct(plain, grid, PLAN)
    assert isinstance(found.unmoved, Grinding)
    as_it_sits = bounded_first_order(found.unmoved, grid.k, grid.theta, grid.z).second
    rms = flank_figure(np.broadcast_to(as_it_sits, grid.shape), grid.section.h).rms
    assert found.moved != WorkMounting()
    assert rms > 2.0 * found.checked.rms
