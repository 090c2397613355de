"""Machines of the kinds of the families, with numbers that no family draws, several things hard in each.

What a family draws one at a time comes together here: screws and worm of set pitches, a short sag, an outlier in a
set-up and repetition of its own, a fast drift, far reflectors, a noisy instrument, memories of 100, 40, 40 and 100.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from simulators.cellfile import CellFile
from simulators.truth import generator
from tests.closing.machines import machine, part

FIRST = 5000
SENSORS = {"umd", "bridge", "straightness", "angle"}
Raw = dict[str, Any]


def other(seed: int, gear: str = "11-lobe disc") -> CellFile:
    """The machine of a seed (1, 2, ...): three of the eight things below, another three with each seed."""
    rng = generator(FIRST + seed, "other")
    raw = machine(FIRST + seed).model_dump()
    raw |= {"name": f"other-{seed}", "part": part(raw["part"], gear).model_dump()}
    raw["site"] = raw["site"] | {"name": f"other-{seed}"}
    for number in rng.choice(len(HARD), 3, replace=False):
        HARD[int(number)](raw, rng)
    return CellFile.model_validate(raw)


def _add(raw: Raw, name: str, term: Raw) -> None:
    raw["truth"]["motions"][name] = [*raw["truth"]["motions"][name], term]


def screws(raw: Raw, rng: np.random.Generator) -> None:
    """8 mm on one linear axis and 10 mm on the other, once and twice a turn."""
    for name, pitch in zip(("EXX", "EZZ"), rng.permutation((8.0, 10.0)), strict=True):
        sizes, phase = [float(rng.uniform(0.3, 0.9)), float(rng.uniform(0.1, 0.4))], float(rng.uniform(0.0, 360.0))
        _add(raw, name, {"kind": "screw", "pitch": float(pitch), "amplitudes": sizes, "phase_deg": phase})


def worm(raw: Raw, rng: np.random.Generator) -> None:
    """36, 72 or 90 teeth, once and twice a tooth."""
    sizes, phase = [float(rng.uniform(0.4, 1.2)), float(rng.uniform(0.1, 0.5))], float(rng.uniform(0.0, 360.0))
    _add(raw, "ECC", {"kind": "worm", "teeth": int(rng.choice((36, 72, 90))), "amplitudes": sizes, "phase_deg": phase})


def sag(raw: Raw, rng: np.random.Generator) -> None:
    """8 um deep in 30 mm of one guide, anywhere on it."""
    name, low, high = [("EYX", -380.0, -40.0), ("EZX", -380.0, -40.0), ("EXZ", 30.0, 270.0)][int(rng.integers(3))]
    _add(raw, name, {"kind": "wear", "at": float(rng.uniform(low, high)), "length": 30.0, "depth": 8.0})


def outlier(raw: Raw, rng: np.random.Generator) -> None:
    """Single readings far out of line, anywhere in any set-up: 3 to 12 um, arcsec."""
    off = {"count": int(rng.integers(1, 4)), "size": float(rng.uniform(3.0, 12.0)), "every": 0}
    raw["instruments"] = [
        one | {"noise": one["noise"] | {"outliers": one["noise"]["outliers"] | off}} if one["kind"] in SENSORS else one
        for one in raw["instruments"]
    ]


def drift(raw: Raw, rng: np.random.Generator) -> None:
    """2 um an hour of each linear axis, 1 arcsec of the table, either way."""
    sizes = {"linear": 2.0, "rotary": 1.0}
    for axis in raw["axes"]:
        if axis["measure"]:
            axis["drift_per_h"] = float(rng.choice((-1.0, 1.0))) * sizes[axis["kind"]]


def reflectors(raw: Raw, rng: np.random.Generator) -> None:
    """80 to 200 mm off the line in two directions, beside tilts of 3 to 6 arcsec."""
    for name in ("EBX", "ECX", "EAZ", "EBZ"):
        _add(raw, name, {"kind": "seed", "size": float(rng.uniform(3.0, 6.0)), "waves": 1.5})
    for one in raw["setups"]:
        if one["component"] in ("EXX", "EZZ"):
            a, b = (float(rng.choice((-1.0, 1.0)) * rng.uniform(80.0, 200.0)) for _ in range(2))
            one["offset_mm"] = [0.0, a, b] if one["component"] == "EXX" else [a, b, 0.0]


def instrument(raw: Raw, rng: np.random.Generator) -> None:
    """One instrument three times as noisy from stop to stop, the machine as quiet as ever."""
    loud = str(rng.choice([one["name"] for one in raw["instruments"] if one["kind"] in SENSORS]))
    raw["instruments"] = [
        one | {"noise": one["noise"] | {"stop": 3.0 * one["noise"]["stop"]}} if one["name"] == loud else one
        for one in raw["instruments"]
    ]


def memories(raw: Raw, rng: np.random.Generator) -> None:
    """100, 40, 40 and 100 points of cross tables, in this order and in others; steps that need as many."""
    raw["machine"] = raw["machine"] | {"cec_points": [int(one) for one in rng.permutation((100, 40, 40, 100))]}
    for axis in raw["axes"]:
        if axis["measure"]:
            axis["table"] = axis["table"] | {"step": 10.0}


HARD = (screws, worm, sag, outlier, drift, reflectors, instrument, memories)
