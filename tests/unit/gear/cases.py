"""How each kind of worked case is answered, by the functions the product itself calls."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gateway.correct.flank.compensability import observability, tangential_cure
from gateway.gear.cycloid import CycloidGear
from gateway.gear.envelope import exact
from gateway.gear.first_order import bounded_first_order, first_order, flank_abg, linear_flank
from gateway.gear.flank import FlankGrid, runout_values
from gateway.gear.grinding import Grinding, grindable, wheel_section
from gateway.gear.wheel_passage import contact_line
from gateway.model.error_model import yk7350b
from gateway.model.frames import chain_of

CASES: tuple[dict[str, Any], ...] = tuple(
    json.loads((Path(__file__).parents[2] / "golden" / "gear_cases.json").read_text(encoding="utf-8"))["cases"]
)
Answer = dict[str, Any]


def _grinding(data: Mapping[str, Any]) -> Grinding:
    return Grinding(chain_of(data["machine"]), CycloidGear.of(data["gear"]), data["E"])


def _grid(data: Mapping[str, Any]) -> FlankGrid:
    return FlankGrid(CycloidGear.of(data["gear"]), data["ks"], data["thetas"], data["zs"])


def chain_T(data: Mapping[str, Any]) -> Answer:
    """Ideal or actual relative pose."""
    chain = chain_of(data["machine"])
    return {"T": chain.actual(data["q"]) if data.get("actual", True) else chain.ideal(data["q"])}


def twist_first(data: Mapping[str, Any]) -> Answer:
    """First-order twist."""
    return {"xi": chain_of(data["machine"]).twist(data["q"], data.get("frame", "work"))}


def twist_exact(data: Mapping[str, Any]) -> Answer:
    """Exact twist."""
    return {"xi": chain_of(data["machine"]).exact_twist(data["q"], data.get("frame", "work"))}


def profile(data: Mapping[str, Any]) -> Answer:
    """Cycloid profile."""
    s = CycloidGear.of(data["gear"]).section(data["thetas"])
    return {"xy": s.xy, "n": s.normal, "kappa": s.curvature}


def gear_summary(data: Mapping[str, Any]) -> Answer:
    """Limits of a gear."""
    found = CycloidGear.of(data["gear"]).limits()
    return {key: getattr(found, key) for key in ("K1", "r_root", "r_tip", "rrp_max", "undercut", "half_lobe_arc")}


def wheel_profile(data: Mapping[str, Any]) -> Answer:
    """Axial section of the wheel."""
    gear = CycloidGear.of(data["gear"])
    section = wheel_section(gear, data["E"], data["thetas"])
    return {"y": section.y, "R": section.R, "grindable": grindable(gear)}


def contact(data: Mapping[str, Any]) -> Answer:
    """Contact line at one stroke position."""
    line = contact_line(_grinding(data), data["k"], data["s"], data["thetas"])
    return {"beta": line.beta, "points": line.points, "normals": line.normals}


def deviation(data: Mapping[str, Any]) -> Answer:
    """First-order and exact flank."""
    grinding, grid = _grinding(data), _grid(data)
    return {
        "e_first": first_order(grinding, grid.k, grid.theta, grid.z),
        "e_exact": exact(grinding, grid.k, grid.theta, grid.z),
    }


def deviation_second(data: Mapping[str, Any]) -> Answer:
    """Second-order flank."""
    grid = _grid(data)
    return {"e_second": bounded_first_order(_grinding(data), grid.k, grid.theta, grid.z).second}


def abg(data: Mapping[str, Any]) -> Answer:
    """A, B, G of the machine."""
    return {"ABG": flank_abg(_grinding(data), np.asarray(data["ks"])[:, None], data["zs"])}


def observed(data: Mapping[str, Any]) -> Answer:
    """What the flank shows of the constants."""
    grid = _grid(data)
    grinding = Grinding(yk7350b(c_frame=data["c_frame"]), grid.gear, data["E"])
    found = observability(linear_flank(grinding, grid, data["names"]))
    return {"rank": found.rank, "null": set(found.null)}


def odd_residual(data: Mapping[str, Any]) -> Answer:
    """What C cannot cure of a tangential error."""
    found = tangential_cure(CycloidGear.of(data["gear"]), data["thetas"])
    return {"dc_per_B": found.dc_per_B, "eta": found.eta, "max": found.largest}


def runout(data: Mapping[str, Any]) -> Answer:
    """Runout of a ball."""
    nx = float(CycloidGear.of(data["gear"]).section(data["theta"]).nx)
    found = runout_values(data["eL"], data["eR"], nx)
    return {"radial": found.radial, "Fr": found.F_r, "ecc": found.eccentricity}


KINDS: dict[str, Callable[[Mapping[str, Any]], Answer]] = {
    "chain_T": chain_T,
    "twist_first": twist_first,
    "twist_exact": twist_exact,
    "profile": profile,
    "gear_summary": gear_summary,
    "wheel_profile": wheel_profile,
    "contact_line": contact,
    "deviation": deviation,
    "deviation_second": deviation_second,
    "abg": abg,
    "observability": observed,
    "odd_residual": odd_residual,
    "runout": runout,
}
