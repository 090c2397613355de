"""The sign convention: what a deviation of an error becomes in a table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.types.tables import CompensationTable
from drivers.units import arcsec_to_rad
from gateway.correct.flank.flank_model import flank_model
from gateway.correct.flank.tables import Table, TableGrid
from gateway.correct.plan.layers import correct
from gateway.correct.plan.plan import AxisGrid, Plan, records_of_product, table_of, table_record, table_spec
from gateway.correct.plan.products import best_product
from gateway.correct.solve.constraints import TableSpec
from gateway.correct.solve.optimise import optimise
from gateway.errors import ModelError
from gateway.gear.flank import flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.error_model import yk7350b
from gateway.model.motion import Fourier, PiecewiseLinear
from tests.unit.correct.machines import PLAN, corrected_flank, machine
from tests.unit.gear.machines import RV40E

GRID = flank_grid(RV40E, profile=6, width=5)


def _tables(found_eec: tuple[CompensationTable, ...]) -> dict[str, CompensationTable]:
    return {one.name: one for one in found_eec}


def test_exx_of_plus_5_um_is_x_x_plus_5() -> None:
    bump = PiecewiseLinear((-240.0, -180.0, -160.0, -140.0, 40.0), (0.0, 0.0, 0.005, 0.0, 0.0))
    found = correct(Grinding(yk7350b({"EXX": bump}), RV40E, 160.0), GRID, PLAN)
    table = _tables(found.own)["X(X)"]
    assert table.kind == "axis"
    assert table.at(np.array([-160.0]))[0] == pytest.approx(5.0)
    assert np.count_nonzero(table.deviations) == 1
    # The axis stands 5 um beside the target now, where the bump is 1.25 nm lower.
    assert found.with_own.largest < 1.3e-6


def test_exz_of_plus_5_um_is_x_z_minus_5() -> None:
    bump = PiecewiseLinear((-10.0, 0.0, 10.0), (0.005, 0.0, 0.005))
    plan = replace(PLAN, grids=(PLAN.grids[0], AxisGrid("Z", -20.0, 20.0, 10.0), PLAN.grids[2]))
    found = correct(Grinding(yk7350b({"EXZ": bump}), RV40E, 160.0), GRID, plan)
    table = _tables(found.cross)["X(Z)"]
    assert table.kind == "cross"
    np.testing.assert_allclose(table.at(np.array([-10.0, 0.0, 10.0])), [-5.0, 0.0, -5.0], atol=1e-9)
    assert not found.own
    assert found.after.largest < 1e-6
    assert table.deviation_unit == "um"


def test_ecc_of_plus_5_arcsec_is_c_c_plus_5() -> None:
    five = arcsec_to_rad(5.04)
    wave = PiecewiseLinear(tuple(np.deg2rad([0.0, 90.0, 180.0, 270.0])), (0.0, five, 0.0, five), 2.0 * np.pi)
    found = correct(Grinding(yk7350b({"ECC": wave}), RV40E, 160.0), GRID, PLAN)
    table = _tables(found.own)["C(C)"]
    assert table.deviation_unit == "arcsec"
    assert table.at(np.array([90.0]))[0] == pytest.approx(5.04)
    assert table.at(np.array([450.0]))[0] == pytest.approx(5.04)
    # The tooth needs nothing beyond: one deviation is never in both layers.
    assert not any(one.name == "C(C)" and np.max(np.abs(one.deviations)) > 0.37 for one in found.cross)


def test_constants_on_a_table_without_a_reference_have_the_golden_values() -> None:
    for errors, out, over, wanted in (
        ({"EXX": 0.005}, "X", "X", 5.0),
        ({"EXZ": 0.005}, "X", "Z", -5.0),
        ({"ECC": arcsec_to_rad(5.0)}, "C", "C", 5.0),
    ):
        grinding = Grinding(yk7350b(errors), RV40E, 160.0)
        nodes = np.array([-160.0, -140.0]) if over == "X" else np.array([-10.0, 10.0])
        turn = np.deg2rad([0.0, 180.0, 360.0])
        table = TableGrid(out, over, turn, 2.0 * np.pi) if over == "C" else TableGrid(out, over, nodes)
        found = optimise(grinding, GRID, [TableSpec(table)], turning=False)
        d = table_record(grinding.chain, found.tables[0], "cross").deviations
        used = d[:1] if over == "X" else d
        np.testing.assert_allclose(used, wanted, atol=1e-6)
        assert found.after.largest < 1e-9


def test_5_um_of_eyc_cost_about_17_arcsec_on_c() -> None:
    wave = Fourier(0.0, (0.0, 0.005))
    found = correct(Grinding(yk7350b({"EYC": wave}, c_frame="fixed"), RV40E, 160.0), GRID, PLAN)
    table = _tables(found.cross)["C(C)"]
    assert not found.own
    amplitude = float(np.ptp(table.deviations)) / 2.0
    assert amplitude == pytest.approx(17.0, rel=0.15)
    curve = next(one for one in found.axes if one.axis == "C")
    # C as an axis is spoiled on purpose, and the prediction says by how much.
    assert np.ptp(curve.before) == 0.0
    assert np.ptp(curve.predicted) == pytest.approx(2.0 * amplitude, rel=0.02)
    # Judged on the flank it is far better: only the odd residual and the 30 deg grid's corners stay.
    assert found.after.rms < 0.25 * found.before.rms


def test_records_go_there_and_back() -> None:
    grinding, _ = machine(1)
    for out, over in (("X", "Z"), ("C", "Z"), ("C", "C"), ("X", "C")):
        grid = table_spec(grinding.chain, PLAN, out, over).grid
        free = np.random.default_rng(3).normal(0.0, 1e-4, grid.free.size)
        table = Table.of(grid, free)
        stored = table_record(grinding.chain, table, "cross", index=3, names={"X": "X1", "Z": "Z1", "C": "C1"})
        assert (stored.output_axis, stored.input_axis, stored.index) == (f"{out}1", f"{over}1", 3)
        back = table_of(grinding.chain, stored, {"X": "X1", "Z": "Z1", "C": "C1"})
        assert back is not None
        np.testing.assert_allclose(back.values, table.values, atol=1e-12)
        np.testing.assert_allclose(back.grid.nodes, grid.nodes, atol=1e-12)
        assert back.grid.closed == (over == "C")
    with pytest.raises(ModelError, match="E-CORRECT-UNEVEN"):
        table_record(grinding.chain, Table(TableGrid("X", "Z", [0.0, 1.0, 3.0]), [0.0, 0.0, 0.0]), "cross")


def test_a_product_is_proved_first_and_then_removes_a_tilt_of_the_table() -> None:
    errors = {"EBC": Fourier(0.0, (0.0, 2e-5), (0.0, 1e-5))}
    grinding = Grinding(yk7350b(errors, c_frame="fixed"), RV40E, 160.0)
    plan = Plan((AxisGrid("Z", -10.0, 10.0, 20.0), AxisGrid("C", 0.0, 360.0, 10.0, modulo=True)))
    first, second = (table_spec(grinding.chain, plan, "X", over).grid for over in ("Z", "C"))
    additive = optimise(grinding, GRID, [table_spec(grinding.chain, plan, "X", over) for over in ("Z", "C")])
    assert additive.best.rms > 0.95 * additive.before.rms
    model = flank_model(grinding, GRID)
    with pytest.raises(ModelError, match="E-CORRECT-UNPROVED"):
        best_product(grinding, model, first, second, proved=False)
    found = best_product(grinding, model, first, second, proved=True, step=1e-4)
    assert found is not None
    assert found.after < 0.15 * found.before
    e = corrected_flank(grinding, GRID, [found.product])
    assert float(np.sqrt(np.mean(e**2))) == pytest.approx(found.after, rel=0.2)
    left, right = records_of_product(grinding.chain, found.product, first=5, second=6)
    assert (left.multiply_by, left.index, right.index, right.multiply_by) == (7, 5, 6, 0)
    at = {"Z": 7.0, "C": 123.0}
    d_mm = left.at(np.array([at["Z"]]))[0] / 1e3 * right.at(np.array([at["C"]]))[0] / 1e3
    q = found.product.first(at["Z"]) * found.product.second(np.deg2rad(at["C"]))
    assert d_mm == pytest.approx(-float(q), rel=1e-9)
    flat = flank_model(Grinding(yk7350b(), RV40E, 160.0), GRID)
    assert best_product(grinding, flat, first, second, proved=True) is None
