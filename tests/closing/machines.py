"""Seeded machines of the class 5 um / 7.2 arcsec (0.002 deg): every error drawn, and everything that hides it.

A machine is a cell file: the demo cell's control, instruments and set-ups, with another truth, gear, climate, noise
and mountings. Its own seed draws the blanks' clamping, the instruments' noise and senses, and the sign of CEC.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from simulators.cellfile import CellFile, Gear, Part, load_cell, with_plan
from simulators.truth import generator

LINEAR_UM = 5.0
ANGULAR_ARCSEC = 7.2
Rng = np.random.Generator
# Targets of a set-up where the demo's plan has fewer.
DENSE = {11: 21, 16: 24}
# Sizes of what must not be seen whole at the tooth or lies below the class, in um or arcsec.
STRAIGHT, TILT, RADIAL, AXIAL, WOBBLE = (1.5, 4.0), (1.0, 3.0), (0.6, 1.5), (0.5, 1.5), (0.3, 0.8)
GEARS: Mapping[str, tuple[Mapping[str, float], float]] = {
    "RV-40E-like": ({"rp": 64.0, "rrp": 3.0, "a": 1.3, "zp": 40, "zc": 39, "b": 10.0}, 160.0),
    "RV-20E-like": ({"rp": 52.0, "rrp": 2.25, "a": 0.9, "zp": 40, "zc": 39, "b": 8.0}, 142.0),
    "RV-320E-like": ({"rp": 114.5, "rrp": 5.0, "a": 2.2, "zp": 40, "zc": 39, "b": 20.0}, 220.0),
    "11-lobe disc": ({"rp": 90.0, "rrp": 10.0, "a": 4.0, "zp": 12, "zc": 11, "b": 15.0}, 190.0),
}
# Of ten machines six grind the demo's disc, two the 11-lobe one, one a smaller and one a wider one.
GROUND = (
    "RV-40E-like", "11-lobe disc", "RV-40E-like", "RV-20E-like", "RV-40E-like",
    "RV-40E-like", "RV-320E-like", "11-lobe disc", "RV-40E-like", "RV-40E-like",
)  # fmt: skip


def gear_of(seed: int) -> str:
    """Which gear a machine grinds."""
    return GROUND[seed % len(GROUND)]


@cache
def machine(seed: int, gear: str = "") -> CellFile:
    """The machine of a seed (1, 2, ...), grinding its own gear or the named one."""
    demo = with_plan(load_cell("demo"))
    raw = demo.model_dump()
    raw |= {"name": f"machine-{seed}", "seed": 1000 + seed}
    raw["machine"] = raw["machine"] | {"serial": f"YK7350B-{seed:04d}"}
    raw["site"] = raw["site"] | {"name": f"machine-{seed}"}
    raw["truth"] = {"motions": motions(seed), "locations": locations(seed)}
    raw["axes"] = [_axis(one, generator(seed, "axis", one["letter"])) for one in raw["axes"]]
    raw["climate"] = _climate(generator(seed, "climate"))
    raw["instruments"] = [_instrument(one, generator(seed, "instrument", one["name"])) for one in raw["instruments"]]
    raw["setups"] = [_setup(one, generator(seed, "set-up", one["component"][:3])) for one in raw["setups"]]
    raw["part"] = part(raw["part"], gear or gear_of(seed)).model_dump()
    return CellFile.model_validate(raw)


def part(like: Mapping[str, Any], name: str) -> Part:
    """A part with the named gear, otherwise as that one."""
    gear, distance = GEARS[name]
    grinding = {**like["grinding"], "centre_distance_mm": distance}
    return Part.model_validate({**like, "name": name, "gear": Gear.model_validate(gear), "grinding": grinding})


def motions(seed: int) -> dict[str, list[dict[str, Any]]]:
    """All 18 error motions as terms of a cell file: smooth low orders and a few higher ones."""
    found: dict[str, list[dict[str, Any]]] = {}
    for axis, travel in (("X", (-420.0, 20.0)), ("Z", (-10.0, 320.0))):
        for to in "XYZABC":
            size = (3.0, LINEAR_UM) if to == axis else TILT if to in "ABC" else STRAIGHT
            found[f"E{to}{axis}"] = _along(travel, size, generator(seed, f"E{to}{axis}"))
    for first, second, size in (("EXC", "EYC", RADIAL), ("EAC", "EBC", WOBBLE)):
        found[first], found[second] = _pair(size, generator(seed, first))
    found["EZC"] = _around((1, 2, 3), AXIAL, generator(seed, "EZC"))
    found["ECC"] = _around((1, 2, 3, 4, 6), (4.0, ANGULAR_ARCSEC), generator(seed, "ECC"))
    return found


def locations(seed: int) -> dict[str, float]:
    """Squareness and place of the table: arcsec and um."""
    rng = generator(seed, "locations")
    leans = {name: float(rng.uniform(-ANGULAR_ARCSEC, ANGULAR_ARCSEC)) for name in ("B0Z", "A0C", "B0C")}
    return leans | {name: float(rng.uniform(-10.0, 10.0)) for name in ("X0C", "Y0C")}


def _along(travel: tuple[float, float], size: tuple[float, float], rng: Rng) -> list[dict[str, Any]]:
    """Two slow waves and a bend over the travel, scaled to a greatest size, and a short wave, a 45th of it."""
    span = travel[1] - travel[0]
    centre = 0.5 * (travel[0] + travel[1])
    bend = {"kind": "polynomial", "coefficients": [0.0, *rng.normal(size=2)], "center": centre, "scale": 0.5 * span}
    slow = [_wave({"period": span / cycles}, 0.5 * rng.normal(), rng) for cycles in rng.uniform(0.4, 2.0, 2)]
    wanted = float(rng.uniform(*size))
    scaled = _scaled([bend, *slow], np.linspace(*travel, 441), wanted)
    return [*scaled, _wave({"period": float(rng.uniform(25.0, 60.0))}, wanted / 45.0, rng)]


def _around(orders: tuple[int, ...], size: tuple[float, float], rng: Rng) -> list[dict[str, Any]]:
    """Waves of these orders and falling size, scaled to a greatest size, and one of order 9 to 11, a 45th."""
    slow = [_wave({"order": order}, rng.normal() / order, rng) for order in orders]
    wanted = float(rng.uniform(*size))
    scaled = _scaled(slow, np.arange(0.0, 360.0, 0.5), wanted)
    return [*scaled, _wave({"order": int(rng.integers(9, 12))}, wanted / 45.0, rng)]


def _pair(size: tuple[float, float], rng: Rng) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """A radial (or tilting) pair: higher orders each its own, order 1 turning against the axis.

    What turns with it is no motion of the axis: it is the eccentricity of what is measured or clamped.
    """
    wave = _wave({"order": 1}, float(rng.uniform(*size)) / 2.0, rng)
    behind = wave | {"phase_deg": wave["phase_deg"] + 90.0}
    return [wave, *_around((2, 3, 4), size, rng)], [behind, *_around((2, 3, 4), size, rng)]


def _wave(where: Mapping[str, Any], amplitude: float, rng: Rng) -> dict[str, Any]:
    phase = float(rng.uniform(0.0, 360.0))
    return {"kind": "harmonic", **where, "amplitude": float(amplitude), "phase_deg": phase}


def _scaled(terms: list[dict[str, Any]], places: np.ndarray, wanted: float) -> list[dict[str, Any]]:
    """The terms times one factor, so that their sum reaches ``wanted`` somewhere on these places."""
    factor = wanted / float(np.max(np.abs(np.sum([_value(term, places) for term in terms], axis=0))))
    return [
        term | {"coefficients": [factor * c for c in term["coefficients"]]}
        if term["kind"] == "polynomial"
        else term | {"amplitude": factor * term["amplitude"]}
        for term in terms
    ]


def _value(term: Mapping[str, Any], places: np.ndarray) -> np.ndarray:
    if term["kind"] == "polynomial":
        along = (places - term["center"]) / term["scale"]
        return np.asarray(np.polynomial.polynomial.polyval(along, term["coefficients"]))
    turns = places / (term["period"] if "period" in term else 360.0 / term["order"])
    return np.asarray(term["amplitude"] * np.cos(2.0 * np.pi * turns + np.deg2rad(term["phase_deg"])))


def _axis(axis: dict[str, Any], rng: Rng) -> dict[str, Any]:
    """Reversal, hysteresis, drift and expansion of one axis; what only dresses stays as it is."""
    if axis["measure"] is None:
        return axis
    rotary = axis["kind"] == "rotary"
    low, high = (-0.8, -0.3) if rotary else (-1.6, -0.6)
    reversal: list[dict[str, Any]] = [{"kind": "constant", "value": float(rng.uniform(low, high))}]
    hysteresis = None
    if not rotary:
        middle, half = np.mean(axis["travel"]), 0.5 * float(np.ptp(axis["travel"]))
        tilt = [0.0, float(rng.uniform(-0.2, 0.2))]
        reversal.append({"kind": "polynomial", "coefficients": tilt, "center": float(middle), "scale": half})
        hysteresis = {"size": float(rng.uniform(-0.4, -0.1)), "distance": float(rng.uniform(0.2, 0.6))}
    changes: dict[str, Any] = {"reversal": reversal, "hysteresis": hysteresis}
    changes["drift_per_h"] = float(rng.uniform(-0.4, 0.4) * (0.5 if rotary else 1.0))
    if not rotary:
        changes["expansion_ppm_per_k"] = float(rng.uniform(11.4, 11.6))
    return axis | changes


def _climate(rng: Rng) -> dict[str, Any]:
    def course(start: tuple[float, float], per_h: float, wave: float, sensor: float) -> dict[str, float]:
        drawn = {"start": rng.uniform(*start), "per_h": rng.uniform(-per_h, per_h), "wave": rng.uniform(0.0, wave)}
        drawn |= {"wave_period_s": rng.uniform(1200.0, 3600.0), "sensor_error": rng.uniform(-sensor, sensor)}
        return {key: float(value) for key, value in drawn.items()}

    return {
        "air_degc": course((20.5, 23.0), 0.3, 0.15, 0.05),
        "pressure_hpa": course((980.0, 1025.0), 0.6, 0.3, 0.2),
        "humidity_pct": course((35.0, 60.0), 1.0, 1.0, 2.0),
        "material_degc": course((20.3, 22.3), 0.2, 0.04, 0.03),
    }


def _instrument(instrument: dict[str, Any], rng: Rng) -> dict[str, Any]:
    """Noise within a third of the demo's, up to three outliers a run, optics' own errors of another phase."""
    if instrument["kind"] == "gear":
        return instrument
    noise = dict(instrument["noise"])
    for key in ("stop", "sample"):
        noise[key] *= float(rng.uniform(0.7, 1.3))
    noise["drift_per_h"] *= float(rng.choice((-1.0, 1.0)))
    size = noise["outliers"]["size"] or 12.0 * noise["stop"]
    noise["outliers"] = noise["outliers"] | {"count": int(rng.integers(1, 4)), "size": size}
    own = [
        term
        | {"phase_deg": float(rng.uniform(0.0, 360.0)), "amplitude": term["amplitude"] * float(rng.uniform(0.4, 0.9))}
        for term in instrument.get("own_error", ())
    ]
    return instrument | {"noise": noise} | ({"own_error": own} if own else {})


def _redrawn(term: dict[str, Any], rng: Rng) -> dict[str, Any]:
    """An instrument's own wave: another phase, and smaller."""
    return term | {"phase_deg": float(rng.uniform(0.0, 360.0)), "amplitude": term["amplitude"] * rng.uniform(0.4, 0.9)}


def _setup(setup: dict[str, Any], rng: Rng) -> dict[str, Any]:
    """Mounted a little differently, and measured more closely; the square is the same piece in all its set-ups."""
    changes: dict[str, Any] = {"misalign_mrad": [float(m * rng.uniform(-1.0, 1.0)) for m in setup["misalign_mrad"]]}
    changes["zero_um"] = float(setup["zero_um"] * rng.uniform(-1.0, 1.0))
    changes["own_angle_arcsec"] = float(setup["own_angle_arcsec"] and rng.uniform(-1.5, 1.5))
    plan = dict(setup["plan"])
    if plan:
        targets = plan["targets"]
        plan |= {"repetitions": 3, "targets": targets | {"count": DENSE.get(targets["count"], targets["count"])}}
    return setup | changes | {"plan": plan}


def written(cell: CellFile, path: Path) -> Path:
    """The machine as a cell file that `python -m simulators.cell` reads."""
    import json

    from simulators.cell.site import section

    data = json.loads(cell.model_dump_json(exclude_none=True))
    lines = [f"{key} = {json.dumps(data.pop(key))}" for key in ("name", "seed")]
    lists = {key: data.pop(key) for key in ("axes", "instruments", "setups")}
    parts = ["\n".join(lines) + "\n", *(section(name, keys) for name, keys in data.items())]
    parts += [section(f"[{name}]", one) for name, many in lists.items() for one in many]
    path.write_text("\n".join(parts), encoding="utf-8")
    return path
