"""Set-ups measured in advance: a table for each, and a site file that names these tables."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Mapping
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import ConfigError
from simulators.cell import Cell
from simulators.cell.capture_pc import SetupCapturePc
from simulators.cell.site import section
from simulators.truth import generator

FloatArray = NDArray[np.float64]
Keys = dict[str, Any]
# How many targets are taken where a site file leaves their number to the standard: five a metre, and no fewer.
LEAST, PER_M = 12, 5.0
DECIMALS = 3


def write_site_of_files(cell: Cell, path: Path, chosen: Collection[str] = ()) -> Path:
    """Measure the set-ups of the cell's site file and write another at ``path`` that takes them from tables.

    ``chosen`` components ("EYX", "B0Z-R", "EXX"); all without. The tables lie in a folder beside ``path``, which may
    be the site file's own; how the axes are measured live stays as it is. Raises ConfigError (E-CELL-SETUP).
    """
    site = tomllib.loads(cell.site_path.read_text(encoding="utf-8"))
    axes = {str(axis["name"]): axis for axis in site["axes"]}
    given = list(site.get("setups", ()))
    setups = [*_positioning_setups(axes, given), *given]
    wanted = set(chosen) or {str(one["component"]) for one in setups}
    _check(wanted, setups, path)
    folder = path.with_suffix(".setups")
    folder.mkdir(parents=True, exist_ok=True)
    filed = [_measure_to_file(cell, one, axes, folder) if one["component"] in wanted else one for one in setups]
    listed = [one for one in filed if one in given or one["component"] in wanted]
    path.write_text(_text({**site, "setups": listed}), encoding="utf-8")
    return path


def write_setup_file(
    cell: Cell,
    component: str,
    axis: str,
    path: Path,
    *,
    targets: Mapping[str, Any] | None = None,
    repetitions: int | None = None,
    park: Mapping[str, float] | None = None,
) -> Path:
    """Measure one set-up of the cell file and save its table.

    ``targets`` as in a site file (first, last, count, offset_fraction, window; or positions) and ``repetitions``: those
    of the set-up's plan or its axis without. ``park``: where other axes stand, by name or letter. Raises ConfigError
    (E-CELL-SETUP, E-CELL-AXIS).
    """
    spec = cell.axis(axis)
    setup = cell.bench.setup_for(component, spec.letter)
    if setup is None:
        known = ", ".join(f"{one.component} on {one.axis}" for one in cell.file.setups)
        raise ConfigError("E-CELL-SETUP", str(path), component=component, axis=axis, known=known)
    usual = {**(spec.measure or {}), **setup.plan}
    stands = {str(cell.axis(name).letter): float(place) for name, place in (park or {}).items()}
    places = _target_positions(
        targets or usual["targets"], spec.reference, f"{component} {spec.letter}", cell.truth.seed
    )
    pc = SetupCapturePc(
        bench=cell.bench, nck=cell.nck, setup=setup, targets=places, start_s=cell.clock.now(), stands=stands
    )
    return pc.save(path, int(repetitions or usual.get("repetitions", 5)))


def _positioning_setups(axes: Mapping[str, Keys], given: Collection[Keys]) -> list[Keys]:
    """The axes' own positioning as set-ups, where none is listed."""
    listed = {(one["component"], one["axis"]) for one in given}
    found = []
    for name, axis in axes.items():
        component = axis["measure"].get("component", "")
        if component == f"E{axis['letter']}{axis['letter']}" and (component, name) not in listed:
            found.append({"axis": name, "component": component})
    return found


def _check(wanted: Collection[str], setups: Collection[Keys], path: Path) -> None:
    known = [str(one["component"]) for one in setups]
    missing = sorted(set(wanted) - set(known))
    if missing:
        raise ConfigError("E-CELL-SETUP", str(path), component=missing[0], axis="any axis", known=", ".join(known))


def _measure_to_file(cell: Cell, one: Keys, axes: Mapping[str, Keys], folder: Path) -> Keys:
    """A set-up of the site file as one from a table; along a bar it tells where X stood too."""
    name, component = str(one["axis"]), str(one["component"])
    axis = axes[name]
    park = dict(one.get("park", {}))
    setup = cell.bench.setup_for(component, str(axis["letter"]))
    if setup is not None and setup.optics == "bar" and setup.axis == "Z":
        park |= {other: _axis_position(cell, other) for other, keys in axes.items() if keys["letter"] == "X"}
    measure = {**axis["measure"], **one}
    kept = "".join(f"-{other}at{place:g}" for other, place in sorted(park.items()))
    table = folder / f"{component}-{name}{kept}.csv"
    asked = {"targets": measure.get("targets"), "repetitions": measure.get("repetitions")}
    write_setup_file(cell, component, name, table, **asked, park=park)
    said: Keys = {**one, "source": "file", "path": f"{folder.name}/{table.name}", "datum": 0.0}
    return said | ({"park": park} if park else {})


def _axis_position(cell: Cell, name: str) -> float:
    return round(float(cell.nck.axis_state(name).set_position), DECIMALS)


def _target_positions(targets: Mapping[str, Any], reference: float, name: str, seed: int) -> FloatArray:
    """Where whoever measured stopped, (m,) rising: evenly, a little off but for the ends' outside and the reference."""
    if targets.get("positions"):
        return np.sort(np.asarray(targets["positions"], dtype=np.float64))
    first, last = sorted((float(targets["first"]), float(targets["last"])))
    count = targets["count"]
    number = count if isinstance(count, int) else max(LEAST, ceil(PER_M * (last - first) / 1000.0))
    even = np.linspace(first, last, number)
    spread = float(targets.get("offset_fraction", 0.0)) * (last - first) / (number - 1)
    off = generator(seed, name, "targets").uniform(-spread, spread, number)
    off[np.isclose(even, reference)] = 0.0
    places = np.clip(even + off, first, last)
    window = targets.get("window")
    if window:
        steps = int((window["last"] - window["first"]) / window["step"] + 1e-9)
        places = np.concatenate((places, window["first"] + window["step"] * np.arange(steps + 1)))
    return np.unique(np.round(places, DECIMALS))


def _text(site: Mapping[str, Any]) -> str:
    """A site file in TOML, nested keys in one line."""
    parts = ["# Written by the simulated cell; its set-ups were measured when it was written."]
    for name, item in site.items():
        parts += [section(f"[{name}]", one) for one in item] if isinstance(item, list) else [section(name, item)]
    return "\n".join(parts)
