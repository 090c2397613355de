"""Families of machines that go beyond the class: each a seeded machine with one thing about it that is hard.

A family changes the cell file of `tests.closing.machines.machine` by a seed of its own. What is hard is known to the
truth alone, but for what a site file has to say: levers of reflectors, points of tables, the measuring system.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from simulators.cellfile import CellFile, load_cell
from simulators.truth import generator
from tests.closing.machines import gear_of, machine, part

Rng = np.random.Generator
Raw = dict[str, Any]
SENSORS = {"umd", "bridge", "straightness", "angle"}
TILTS = ("EAX", "EBX", "ECX", "EAZ", "EBZ", "ECZ")


def _any(rng: Rng, low: float, high: float, *, signed: bool = False) -> float:
    sign = float(rng.choice((-1.0, 1.0))) if signed else 1.0
    return sign * float(rng.uniform(low, high))


def _add(raw: Raw, name: str, *terms: Mapping[str, Any]) -> None:
    raw["truth"]["motions"][name] = [*raw["truth"]["motions"][name], *terms]


def _axes(raw: Raw, change: Callable[[Raw], Mapping[str, Any]]) -> None:
    """Change every measured axis."""
    raw["axes"] = [one | change(one) if one["measure"] else one for one in raw["axes"]]


def periodic(raw: Raw, rng: Rng) -> None:
    """Ball screws of 8 or 10 mm pitch and a worm of 36, 72 or 90 teeth: structure between the targets."""
    for name in ("EXX", "EZZ"):
        pitch, phase = float(rng.choice((8.0, 10.0))), _any(rng, 0.0, 360.0)
        once = _any(rng, 0.5, 1.2)
        _add(raw, name, {"kind": "screw", "pitch": pitch, "amplitudes": [once, 0.3 * once], "phase_deg": phase})
    teeth, phase = int(rng.choice((36, 72, 90))), _any(rng, 0.0, 360.0)
    _add(raw, "ECC", {"kind": "worm", "teeth": teeth, "amplitudes": [_any(rng, 0.5, 1.5)], "phase_deg": phase})


def worn(raw: Raw, rng: Rng) -> None:
    """Guides worn where they work: a hollow of 4 to 8 um over 30 to 60 mm, and the tilt that goes with it."""
    for name, tilt, travel in (("EYX", "ECX", (-300.0, -100.0)), ("EXZ", "EBZ", (120.0, 180.0))):
        at, length, depth = _any(rng, *travel), _any(rng, 30.0, 60.0), _any(rng, 4.0, 8.0)
        _add(raw, name, {"kind": "wear", "at": at, "length": length, "depth": depth})
        _add(raw, tilt, {"kind": "wear", "at": at, "length": length, "depth": _any(rng, 0.5, 1.5, signed=True)})


def abbe(raw: Raw, rng: Rng) -> None:
    """Reflectors 60 to 150 mm off the line that counts, beside tilts of 4 to 8 arcsec."""
    for name in ("EBX", "ECX", "EAZ", "EBZ"):
        _add(raw, name, {"kind": "seed", "size": _any(rng, 3.0, 5.0), "waves": 2.0})
    off = {
        "EXX": [0.0, _any(rng, 60.0, 150.0, signed=True), _any(rng, 60.0, 150.0)],
        "EZZ": [_any(rng, 60.0, 150.0), _any(rng, 60.0, 150.0, signed=True), 0.0],
    }
    raw["setups"] = [one | {"offset_mm": off.get(one["component"], one["offset_mm"])} for one in raw["setups"]]


def drifting(raw: Raw, rng: Rng) -> None:
    """Zeros that warm up by 2 to 4 um (1 to 3 arcsec) and breathe, locations that follow time and temperature."""

    def change(axis: Raw) -> Raw:
        size = 0.6 if axis["kind"] == "rotary" else 1.0
        bent = {"warm_up": size * _any(rng, 2.0, 4.0, signed=True), "warm_up_h": _any(rng, 0.7, 2.0)}
        waves = {"wave": size * _any(rng, 0.1, 0.4), "wave_h": _any(rng, 0.5, 1.5)}
        return {"drift": bent | waves | {"per_k": size * _any(rng, -0.5, 0.5)}}

    _axes(raw, change)
    raw["truth"]["moving"] = {
        "B0Z": {"per_h": _any(rng, -0.1, 0.1), "per_k": _any(rng, -0.5, 0.5)},
        "X0C": {"warm_up": _any(rng, 1.0, 3.0, signed=True), "warm_up_h": 1.5, "per_k": _any(rng, -0.5, 0.5)},
        "Y0C": {"warm_up": _any(rng, 1.0, 3.0, signed=True), "warm_up_h": 1.5},
    }


def noisy(raw: Raw, rng: Rng) -> None:
    """Axes that scatter by 0.15 to 0.35 um (arcsec), twice the noise, and an outlier in every set-up."""
    _axes(raw, lambda axis: {"scatter": _any(rng, 0.15, 0.35)})

    def louder(one: Raw) -> Raw:
        noise = one["noise"]
        outliers = {"count": 1, "size": 25.0 * noise["stop"] + 2.0, "every": 18}
        return one | {"noise": noise | {key: 2.0 * noise[key] for key in ("stop", "sample")} | {"outliers": outliers}}

    raw["instruments"] = [louder(one) if one["kind"] in SENSORS else one for one in raw["instruments"]]


def tilting(raw: Raw, rng: Rng) -> None:
    """Tilts of 8 to 15 arcsec over the travel, other ones on the way back, and so the straightness."""
    for name in TILTS:
        _add(raw, name, {"kind": "seed", "size": _any(rng, 8.0, 15.0), "waves": 1.5})
    sizes = {name: _any(rng, -0.6, 0.6) for name in (*TILTS, "EYX", "EZX", "EXZ", "EYZ")}
    raw["truth"]["reversals"] = {name: [{"kind": "constant", "value": size}] for name, size in sizes.items()}


def coarse(raw: Raw, rng: Rng) -> None:
    """Memories for few points: 25 of an axis, 100, 40, 40 and 100 or 30 of each cross table, in any order."""
    _axes(raw, lambda axis: {"eec_points": (25, 0), "table": axis["table"] | _coarser(axis)})
    points = [[100, 40, 40, 100], [40, 40, 40, 40], [30, 100, 30, 30]][int(rng.integers(3))]
    raw["machine"] = raw["machine"] | {"cec_points": [int(one) for one in rng.permutation(points)]}


def _coarser(axis: Raw) -> Raw:
    return {"step": 15.0 if axis["letter"] in "ZC" else 20.0}


def second(raw: Raw, rng: Rng) -> None:
    """The second cell's grinder: scales at measuring system 2 with 25 points, the builder's axis tables acting."""
    theirs = {axis.name: axis for axis in load_cell("scales").axes}

    def change(axis: Raw) -> Raw:
        scales = theirs[axis["name"]].model_dump()
        return {key: scales[key] for key in ("encoder", "eec_points", "table", "loaded", "number")}

    _axes(raw, change)
    machine_of = load_cell("scales").machine.model_dump()
    kept = {key: machine_of[key] for key in ("access_level", "cec_points", "opcua", "switches")}
    stays = [one for one in machine_of["cross"] if "Y1" in (one["input"], one["output"])]
    raw["machine"] = raw["machine"] | kept | {"cross": stays}
    raw["site"] = raw["site"] | {"controller": {"access_level": 7}}


def wearing(raw: Raw, rng: Rng) -> None:
    """A wheel that loses 5 to 20 nm from space to space, one side more than the other, on a table that warms up."""
    raw["wheel"] = raw["wheel"] | {"wear_um": _any(rng, 0.005, 0.02), "wear_side_um": _any(rng, -0.01, 0.01)}
    warm = {"warm_up": _any(rng, 1.0, 3.0, signed=True), "warm_up_h": 2.0}
    raw["axes"] = [one | {"drift": one["drift"] | warm} if one["letter"] == "C" else one for one in raw["axes"]]


FAMILIES: Mapping[str, Callable[[Raw, Rng], None]] = {
    "periodic": periodic,
    "worn": worn,
    "abbe": abbe,
    "drifting": drifting,
    "noisy": noisy,
    "tilting": tilting,
    "coarse": coarse,
    "second": second,
    "wearing": wearing,
}


def relative(family: str, seed: int, gear: str = "") -> CellFile:
    """The machine of a family with this seed (1, 2, ...), grinding the gear that its seed has, or the named one."""
    number = 200 + 100 * list(FAMILIES).index(family) + seed
    raw = machine(number).model_dump()
    raw |= {"name": f"{family}-{seed}", "part": part(raw["part"], gear or gear_of(number)).model_dump()}
    raw["site"] = raw["site"] | {"name": f"{family}-{seed}"}
    FAMILIES[family](raw, generator(seed, "family", family))
    return CellFile.model_validate(raw)
