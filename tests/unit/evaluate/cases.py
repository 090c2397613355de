"""How a worked case's input reaches the product's own functions; results by the case's names."""

from __future__ import annotations

from typing import Any

import numpy as np

from gateway.domain import Evaluation
from gateway.evaluate.geometry import harmonics, squareness, straightness
from gateway.evaluate.optics import air, length, rotary
from gateway.evaluate.standards import flank_tolerances, iso230_2, other_standards, readings
from gateway.evaluate.uncertainty import budget
from gateway.model import components, fit, regression
from gateway.table import Grid, project

Input = dict[str, Any]


def evaluation(given: Input) -> Evaluation:
    positions = given.get("positions_up"), given.get("positions_down")
    edition = "1988" if given.get("k") == 3 else "2014"
    rows = readings.from_rows(given.get("up"), given.get("down")) if positions == (None, None) else None
    if rows is None:
        measured = readings.from_rows(*positions)
        return iso230_2.evaluate_positions(given["targets"], measured, "um", edition=edition)
    targets = given.get("targets", range(rows.shape[0]))
    return iso230_2.evaluate(np.asarray(list(targets), dtype=float), rows, "um", edition=edition)


def _iso(given: Input) -> Input:
    result = evaluation(given)
    names = ("mean_up", "mean_down", "s_up", "s_down", "B_i", "R_i", "B", "B_mean", "M", "E", "E_up", "E_down")
    found = {name: getattr(result, name) for name in (*names, "R", "R_up", "R_down", "A", "A_up", "A_down")}
    k = 3.0 if given.get("k") == 3 else 2.0
    found["mean_bi"] = (result.mean_up + result.mean_down) / 2
    found["R_i_up"], found["R_i_down"] = 2 * k * result.s_up, 2 * k * result.s_down
    return found | {"flags": list(result.flags)}


def _rows(given: Input) -> np.ndarray:
    return readings.from_rows(given["up"], given["down"])


def _harmonics(given: Input) -> Input:
    found = harmonics.harmonics(given["angle"], given["error"], given["orders"])
    named = {
        str(order): {"amplitude": item.amplitude, "phase_deg": item.phase_deg}
        for order, item in found.harmonics.items()
    }
    return {"mean": found.mean, "harmonics": named, "residual_range": found.residual_range}


def _straightness(reference: str) -> Any:
    def run(given: Input) -> Input:
        found = straightness.straightness(given["x"], given["y"], reference)
        return {name: getattr(found, name) for name in ("slope", "intercept", "value")} | {"residuals": found.residual}

    return run


def _runs(given: Input) -> Input:
    found = squareness.from_runs(given["x"], given["eyx"], given["y"], given["exy"])
    return {"slope_x": found.slope_x, "slope_y": found.slope_y, "C0Y": found.C0Y}


def _edlen(given: Input) -> Input:
    nm = given["lam_um"] * 1000 if "lam_um" in given else air.WAVELENGTH_NM
    return {"n": air.edlen(given["t"], given["p"], given["rh"], nm)}


def _ciddor(given: Input) -> Input:
    nm = given["lam_um"] * 1000 if "lam_um" in given else air.WAVELENGTH_NM
    return {"n": air.ciddor(given["t"], given["p"], given["rh"], nm, given["co2"])}


def _expansion(given: Input) -> Input:
    found = float(length.at_20_degc(given["L"], given["alpha"] * 1e6, given["T"]))
    return {"L": found, "L_linear": given["L"] * (1 - given["alpha"] * (given["T"] - 20))}


def _env_factor(given: Input) -> Input:
    names = ("t", "p", "rh", "material_t", "alpha_ppm")
    return {"f": air.env_factor(*(given[name] for name in names))}


def _tolerances(given: Input) -> Input:
    return dict(flank_tolerances.flank_tolerances(given["d"], given["mn"], given["b"], given["A"]))


def _drift(given: Input) -> Input:
    start, end = (given["t0"], given["z0"]), (given["t1"], given["z1"])
    return {"x": length.drift_removed(given["t"], given["x"], start, end)}


def _poly_fit(given: Input) -> Input:
    found = regression.fit_polynomial(given["x"], given["y"], given["degree"], given["x0"])
    u = np.sqrt(np.diag(found.covariance))
    at = [dict(zip(("y", "u"), found.at(x), strict=True)) for x in given["at"]]
    corr = found.covariance[0, 1] / (u[0] * u[1])
    return {"coef": found.coefficients, "u_coef": u, "s": found.s, "corr01": corr, "at": at}


def _comp_table(given: Input) -> Input:
    points = np.asarray(given["positions"], dtype=float)
    grid = Grid(points[0], points[-1], points[1] - points[0])
    fitted = fit.fit_polygon(given["targets"], given["mean_error"], 0.1, name="EXX", axis="X", axis_unit="mm")
    deviations = project(lambda at: components.value(fitted, at), grid, modulo=False)
    left = components.value(fitted, given["at"]) - np.interp(given["at"], points, deviations)
    return {"table": -deviations, "residual": left}


RUN = {
    "poly_fit": _poly_fit,
    "comp_table": _comp_table,
    "iso230_2": _iso,
    "iso230_2_min_targets": lambda g: dict(
        zip(("targets", "runs"), iso230_2.minimum_targets(g["kind"], g["travel"]), strict=True)
    ),
    "vdi3441": lambda g: other_standards.vdi3441(_rows(g)).values,
    "asme_b554": lambda g: other_standards.asme_b554_1992(_rows(g)).values,
    "nmtba": lambda g: other_standards.nmtba(_rows(g), offset=g["offset"]).values,
    "straightness_lsq": _straightness("lsq"),
    "straightness_minzone": _straightness("minimum-zone"),
    "squareness_runs": _runs,
    "squareness_face": lambda g: {"C0Y": squareness.from_face_diagonals(g["d_pp"], g["d_pm"], g["lx"], g["ly"])},
    "edlen": _edlen,
    "ciddor": _ciddor,
    "svp": lambda g: {"p": air.saturation_pressure_pa(g["t"])},
    "sensitivities": lambda g: dict(zip(("dT", "dP", "dRH"), air.sensitivities(g["t"], g["p"], g["rh"]), strict=True)),
    "env_factor": _env_factor,
    "dead_path": lambda g: {"L": length.dead_path_corrected(g["L"], g["dead"], g["n0"], g["n1"])},
    "expansion": _expansion,
    "cosine": lambda g: {"err": length.cosine_error_mm(g["L"], g["lateral"])},
    "drift": _drift,
    "rotary_combine": lambda g: {"error": rotary.combine(g["command"], g["device"], g["interf"], g["reference"])},
    "harmonics": _harmonics,
    "t_factor": lambda g: {"k": budget.coverage_factor(g["p"], g["nu"])},
    "iso1328": _tolerances,
}
