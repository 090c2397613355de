"""How a worked case's input reaches the product's own functions; results by the case's names."""

from __future__ import annotations

from typing import Any

import numpy as np

from drivers.types.sensing import Ambient
from drivers.types.tables import CompensationTable
from drivers.units import mm_to_um, um_to_mm
from gateway.correct.plan.layers import own_deviation
from gateway.correct.plan.plan import table_of
from gateway.domain.figures import Component, Evaluation
from gateway.evaluate.behaviour.repetitions import robust_means
from gateway.evaluate.geometry import rotary_motion, straightness
from gateway.evaluate.geometry import straightness as squareness
from gateway.evaluate.geometry.straightness import StraightnessRun
from gateway.evaluate.optics import air, displacement, rotary_calibration
from gateway.evaluate.standards import conformity, iso230_2, registry, statistics
from gateway.evaluate.uncertainty import budget
from gateway.gear.cycloid import CycloidGear
from gateway.model import components, fit
from gateway.model import fit as regression
from gateway.model.error_model import yk7350b
from gateway.model.motion import motion_from
from gateway.table import Grid, project
from tests.steps import said

Input = dict[str, Any]
NO_AIR = Ambient(20.0, 1013.25, 50.0, (20.0,))
AS_READ = displacement.LinearSetup(datum_mm=0.0, dead_path_mm=0.0, expansion_ppm_per_k=0.0)
GEAR = CycloidGear(rp=64.0, rrp=3.0, a=1.3, zp=40, zc=39, b=10.0)


def evaluation(given: Input) -> Evaluation:
    positions = given.get("positions_up"), given.get("positions_down")
    edition = "1988" if given.get("k") == 3 else "2014"
    rows = statistics.from_rows(given.get("up"), given.get("down")) if positions == (None, None) else None
    if rows is None:
        deviations, _ = displacement.linear_deviations(
            statistics.from_rows(*positions),
            given["targets"],
            AS_READ,
            start=NO_AIR,
            end=NO_AIR,
            already="air+material",
        )
        return iso230_2.evaluate_iso230_2(given["targets"], um_to_mm(deviations), "um", edition=edition)
    targets = given.get("targets", range(rows.shape[0]))
    return iso230_2.evaluate_iso230_2(np.asarray(list(targets), dtype=float), rows, "um", edition=edition)


def _iso(given: Input) -> Input:
    result = evaluation(given)
    names = ("mean_up", "mean_down", "s_up", "s_down", "B_i", "R_i", "B", "B_mean", "M", "E", "E_up", "E_down")
    found = {name: getattr(result, name) for name in (*names, "R", "R_up", "R_down", "A", "A_up", "A_down")}
    if given.get("up") and given.get("down"):
        found["mean_bi"] = robust_means(result.targets, _rows(given)).mean
        alone = [
            iso230_2.evaluate_iso230_2([at], row[None], "um")
            for at, row in zip(result.targets, _rows(given), strict=True)
        ]
        found |= {f"R_i_{way}": [getattr(one, f"R_{way}") for one in alone] for way in ("up", "down")}
    return found | {"flags": list(said(result))}


def _rows(given: Input) -> np.ndarray:
    return statistics.from_rows(given["up"], given["down"])


def _harmonics(given: Input) -> Input:
    found = rotary_motion.harmonics(given["angle"], given["error"], given["orders"])
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
    along_x, along_y = (np.asarray(given[at], dtype=float) for at in "xy")
    runs = StraightnessRun(along_x, np.asarray(given["eyx"])), StraightnessRun(along_y, np.asarray(given["exy"]))
    found = squareness.from_runs(*runs)
    return {"slope_x": found.slope_x, "slope_y": found.slope_y, "C0Y": found.C0Y}


def _edlen(given: Input) -> Input:
    nm = given["lam_um"] * 1000 if "lam_um" in given else air.WAVELENGTH_NM
    return {"n": air.edlen(given["t"], given["p"], given["rh"], nm)}


def _ciddor(given: Input) -> Input:
    nm = given["lam_um"] * 1000 if "lam_um" in given else air.WAVELENGTH_NM
    return {"n": air.ciddor(given["t"], given["p"], given["rh"], nm, given["co2"])}


def _expansion(given: Input) -> Input:
    return {"L": displacement.at_20_degc(given["L"], given["alpha"] * 1e6, given["T"])}


def _env_factor(given: Input) -> Input:
    names = ("t", "p", "rh", "material_t", "alpha_ppm")
    return {"f": air.env_factor(*(given[name] for name in names))}


def _tolerances(given: Input) -> Input:
    return dict(conformity.flank_tolerances(given["d"], given["mn"], given["b"], given["A"]))


def _drift(given: Input) -> Input:
    start, end = (given["t0"], given["z0"]), (given["t1"], given["z1"])
    return {"x": displacement.drift_removed(given["t"], given["x"], start, end)}


def _poly_fit(given: Input) -> Input:
    """In millionths, each reading with an uncertainty of one: all scatter is that of the readings."""
    x, y = np.asarray(given["x"]), 1e6 * np.asarray(given["y"])
    terms = {"degree": given["degree"], "centre": given["x0"], "scale": 1.0}
    found = regression.solve_weighted(components.design("polynomial", terms, x), y, np.ones(y.size))
    reach = (min(*x, *given["at"]), max(*x, *given["at"]))
    fitted = Component("EXX", "X", "mm", "polynomial", reach, found.coefficients, found.covariance, terms)
    told = zip(components.value(fitted, given["at"]), components.standard_uncertainty(fitted, given["at"]), strict=True)
    return {
        "coef": found.coefficients / 1e6,
        "covariance": found.covariance / 1e12,
        "chi_square": found.chi_square / 1e12,
        "at": [{"y": y / 1e6, "u": u / 1e6} for y, u in told],
    }


def _comp_table(given: Input) -> Input:
    """A table as it is stored, back as corrections; what is left is the machine with the table acting."""
    points = np.asarray(given["positions"], dtype=float)
    grid = Grid(points[0], points[-1], points[1] - points[0])
    fitted = fit.fit_through(given["targets"], given["mean_error"], 0.1, name="EXX", axis="X", axis_unit="mm")
    deviations = project(lambda at: components.value(fitted, at), grid, modulo=False)
    stored = CompensationTable("axis", "X", "X", grid.minimum, grid.maximum, grid.step, tuple(deviations))
    chain = yk7350b({"EXX": motion_from(fitted)})
    table = table_of(chain, stored)
    assert table is not None
    at = np.asarray(given["at"], dtype=float)
    left = own_deviation(chain, "X", at) + table(at)
    return {"table": mm_to_um(table.values), "residual": mm_to_um(left)}


def stated(case: Input) -> Input:
    """What a case expects, in the quantities that the product states: covariance, chi-square; contrasts left out."""
    expected = {name: value for name, value in case["expected"].items() if name not in CONTRASTS}
    if case["kind"] != "poly_fit":
        return expected
    u, r = np.asarray(expected.pop("u_coef")), expected.pop("corr01")
    free = len(case["input"]["x"]) - u.size
    expected["covariance"] = (np.outer(u, u) * np.array([[1.0, r], [r, 1.0]])).tolist()
    return expected | {"chi_square": free * expected.pop("s") ** 2}


CONTRASTS = {"L_linear": "L"}
"""Expected values that the answer of the other name must not have."""


RUN = {
    "poly_fit": _poly_fit,
    "comp_table": _comp_table,
    "iso230_2": _iso,
    "iso230_2_min_targets": lambda g: dict(
        zip(("targets", "runs"), iso230_2.minimum_targets(g["kind"], g["travel"]), strict=True)
    ),
    "vdi3441": lambda g: registry.vdi3441(_rows(g)).values,
    "asme_b554": lambda g: registry.asme_b554_1992(_rows(g)).values,
    "nmtba": lambda g: registry.nmtba(_rows(g), offset=g["offset"]).values,
    "straightness_lsq": _straightness("lsq"),
    "straightness_minzone": _straightness("minimum-zone"),
    "squareness_runs": _runs,
    "squareness_face": lambda g: {"C0Y": squareness.from_face_diagonals(g["d_pp"], g["d_pm"], g["lx"], g["ly"])},
    "edlen": _edlen,
    "ciddor": _ciddor,
    "svp": lambda g: {"p": air.saturation_pressure_pa(g["t"])},
    "sensitivities": lambda g: dict(zip(("dT", "dP", "dRH"), air.sensitivities(g["t"], g["p"], g["rh"]), strict=True)),
    "env_factor": _env_factor,
    "dead_path": lambda g: {"L": displacement.dead_path_corrected(g["L"], g["dead"], g["n0"], g["n1"])},
    "expansion": _expansion,
    "cosine": lambda g: {"err": displacement.cosine_error_mm(g["L"], g["lateral"])},
    "drift": _drift,
    "rotary_combine": lambda g: {
        "error": rotary_calibration.combine(g["command"], g["device"], g["interf"], g["reference"])
    },
    "harmonics": _harmonics,
    "t_factor": lambda g: {"k": budget.coverage_factor(g["p"], g["nu"])},
    "iso1328": _tolerances,
}
