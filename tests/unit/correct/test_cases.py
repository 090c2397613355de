"""The worked cases of tables, ranking and fitting, answered by the functions the product itself calls."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gateway.correct.flank.flank_model import flank_model, with_acting
from gateway.correct.flank.tables import Correction, Product, Table, TableGrid
from gateway.correct.solve.constraints import TableSpec
from gateway.correct.solve.optimise import optimise
from gateway.domain.figures import Component
from gateway.evaluate.geometry.straightness import straightness
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import FlankGrid, flank_figure, trace_values
from gateway.gear.grinding import Grinding
from gateway.model.components import design, value
from gateway.model.fit import solve_weighted
from gateway.model.frames import chain_of
from gateway.sensitivity.screening import elementary_effects, exhaustive, indices
from tests.unit.gear.cases import CASES

KINDS = (
    "tables",
    "apply_tables",
    "interp_table",
    "morris_exhaustive",
    "morris_ee",
    "fit_bspline",
    "split_straightness",
)


def _setting(data: dict[str, Any]) -> tuple[Grinding, FlankGrid]:
    gear = CycloidGear.of(data["gear"])
    return Grinding(chain_of(data["machine"]), gear, data["E"]), FlankGrid(gear, data["ks"], data["thetas"], data["zs"])


def _grid(data: dict[str, Any], out: str = "X") -> TableGrid:
    return TableGrid(data.get("out", out), data.get("in", "Z"), data["grid"], data.get("modulo"))


def _figures(e: np.ndarray) -> dict[str, float]:
    """Without a lever the figure turns nothing; by a lever of one everywhere its rotation is the mean."""
    plain, mean = flank_figure(e, 0.0), flank_figure(e, 1.0).rotation
    span = trace_values(e.ravel(), np.arange(e.size)).F
    return {"max": plain.largest, "rms": plain.rms, "pv": float(span), "mean": mean}


def _correction(data: dict[str, Any]) -> Correction:
    if "mult" in data:
        return Product(*(Table(_grid(one, data["out"]), one["values"]) for one in data["mult"]))
    return Table(_grid(data), data["values"])


def _tables(data: dict[str, Any]) -> dict[str, Any]:
    grinding, grid = _setting(data)
    specs = [TableSpec(_grid(one)) for one in data["tables"]]
    best = optimise(grinding, grid, specs, turning=False)
    answer = {"before": _figures(best.deviation_before), "lsq_rms": best.best.rms, "lsq_max": best.best.largest}
    if data.get("minimax"):
        answer["minimax_max"] = optimise(grinding, grid, specs, turning=False, norm="max").best.largest
    return answer


def _apply_tables(data: dict[str, Any]) -> dict[str, Any]:
    grinding, grid = _setting(data)
    tables = [_correction(one) for one in data["tables"]]
    return _figures(with_acting(flank_model(grinding, grid), grinding, tables).start())


def _interp_table(data: dict[str, Any]) -> dict[str, Any]:
    return {"v": Table(_grid(data), data["values"])(data["at"])}


def _morris_exhaustive(data: dict[str, Any]) -> dict[str, Any]:
    found = exhaustive(data["a"], data["p"])
    return {"mu": found.mu, "mu_star": found.mu_star, "sigma": found.sigma}


def _morris_ee(data: dict[str, Any]) -> dict[str, Any]:
    effects = elementary_effects(data["trajectories"], data["ys"])
    found = indices(effects)
    return {"EE": effects, "mu": found.mu, "mu_star": found.mu_star, "sigma": found.sigma}


def _fit_bspline(data: dict[str, Any]) -> dict[str, Any]:
    q, ends = np.asarray(data["q"]), (data["q"][0], data["q"][-1])
    knots = {"knots": (*[ends[0]] * 4, *data["interior"], *[ends[1]] * 4)}
    found = solve_weighted(design("bspline", knots, q), np.asarray(data["v"]), np.ones(q.size))
    fitted = Component("EXZ", "Z", "mm", "bspline", ends, found.coefficients, found.covariance, knots)
    return {"v": value(fitted, data["at"])}


def _split_straightness(data: dict[str, Any]) -> dict[str, Any]:
    found = straightness(data["q"], data["v"], data["ref"])
    return {"offset": found.intercept, "slope": found.slope, "residual": found.residual}


ANSWERS = {
    "tables": _tables,
    "apply_tables": _apply_tables,
    "interp_table": _interp_table,
    "morris_exhaustive": _morris_exhaustive,
    "morris_ee": _morris_ee,
    "fit_bspline": _fit_bspline,
    "split_straightness": _split_straightness,
}


@pytest.mark.parametrize("case", [one for one in CASES if one["kind"] in KINDS], ids=lambda one: one["id"])
def test_case(case: dict[str, Any]) -> None:
    answer = ANSWERS[case["kind"]](case["input"])
    rel, absolute = case.get("rel", 1e-9), case.get("abs", 1e-12)
    for key, wanted in case["expect"].items():
        pairs = wanted.items() if isinstance(wanted, dict) else [("", wanted)]
        for name, number in pairs:
            got = answer[key][name] if name else answer[key]
            np.testing.assert_allclose(got, number, rtol=rel, atol=absolute, err_msg=f"{key} {name}")


def test_every_kind_of_case_is_answered_somewhere() -> None:
    from tests.unit.gear.cases import KINDS as GEAR_KINDS

    assert {one["kind"] for one in CASES} == set(KINDS) | set(GEAR_KINDS)


def test_a_repeating_table_repeats_and_closes() -> None:
    closed = Table(TableGrid("C", "C", [0.0, 90.0, 180.0, 270.0, 360.0], 360.0), [0.0, 2.0, 1.0, -1.0, 0.0])
    open_ = Table(TableGrid("C", "C", [0.0, 90.0, 180.0, 270.0], 360.0), [0.0, 2.0, 1.0, -1.0])
    at = np.array([-45.0, 0.0, 315.0, 360.0, 405.0, 720.0 + 135.0])
    np.testing.assert_allclose(closed(at), [-0.5, 0.0, -0.5, 0.0, 1.0, 1.5])
    np.testing.assert_allclose(open_(at), closed(at))
    for table in (closed, open_):
        weights = table.grid.weights(at)
        np.testing.assert_allclose(weights @ table.values[: weights.shape[1]], table(at), atol=1e-12)
        np.testing.assert_allclose(weights.sum(axis=1), 1.0)
