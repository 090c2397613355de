"""A measured machine as an error file: the errors of a stored run, with location errors and their uncertainty.

A study takes an error file (TOML) or what a run knows; both become the same `ErrorFile`, so that command and library
go one way from there. A fitted motion becomes a broken line, 100 points to its shortest wave, known over its range
alone; the unmeasured errors are zero, and their assumed span counts in the uncertainty.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import ConfigError
from gateway.domain.figures import Component
from gateway.model.components import TURN_DEG, is_periodic, motion_uncertainty, value
from gateway.model.known import ErrorModel
from gateway.model.preset import TWENTY_ONE
from gateway.siteplan import MOST_POINTS
from gateway.store import RunFolder, records
from gateway.study.files import ErrorFile, load_errors, validated

FEWEST_POINTS, POINTS_PER_WAVE = 501, 100  # of a broken line that stands for a curve: it misses 0.05 % of a wave
SAMPLES = 181
STAGE, RUN_FILE, SITE_FILE = "errors", "run.json", "site.toml"


def is_run(path: Path) -> bool:
    """Whether a path is a run's folder or the errors that it holds, and no error file in TOML."""
    return path.is_dir() or path.suffix == ".json"


def errors_from(path: Path, height_mm: float | None = None) -> ErrorFile:
    """An error file, or the errors of a run's folder or of its errors.json; um, arcsec, mm, deg.

    ``height_mm`` is where the middle of the work's face stands in the coordinates of Z, for a run alone; None: as
    `[work] height_mm` of the site file in the run has it, 0 where there is none. Raises ConfigError (E-STUDY-...),
    StoreError (E-STORE-STAGE: no errors in this run), CorruptRecord.
    """
    if not is_run(path):
        return load_errors(path)
    model, height = model_of_run(path), _site_height(path) if height_mm is None else height_mm
    return error_file(model, path.parent.name if path.is_file() else path.name, height)


def run_folder(path: Path) -> RunFolder | None:
    """The run that a folder is, or that an errors.json lies in; None for any other file."""
    folder = path if path.is_dir() else path.parent
    inside = path.is_dir() or path.name == f"{STAGE}.json"
    return RunFolder(folder) if inside and (folder / RUN_FILE).is_file() else None


def _site_height(path: Path) -> float:
    """Where the site file that a run keeps puts the middle of the face, mm. Raises ConfigError (E-STUDY-TOML)."""
    folder = run_folder(path)
    kept = None if folder is None else folder.path / SITE_FILE
    if kept is None or not kept.is_file():
        return 0.0
    try:
        work = tomllib.loads(kept.read_text(encoding="utf-8")).get("work", {})
    except ValueError as error:
        raise ConfigError("E-STUDY-TOML", str(kept), why=str(error)) from error
    return float(work.get("height_mm", 0.0))


def model_of_run(path: Path) -> ErrorModel:
    """What a run knows of its machine's errors; the hash is checked where the run is. Raises as `errors_from`."""
    if path.is_dir() and not (path / RUN_FILE).is_file():
        raise ConfigError("E-STUDY-READ", str(path), why=f"no run lies there: {RUN_FILE} is missing")
    if (run := run_folder(path)) is not None:
        return run.get(STAGE, ErrorModel)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError("E-STUDY-READ", str(path), why=str(error)) from error
    return records.decode(data, ErrorModel, str(path))


def error_file(model: ErrorModel, name: str, height_mm: float = 0.0) -> ErrorFile:
    """The errors of a model, those of the 21; C errors are told in the fixed frame, as a run tells them."""
    errors: dict[str, Any] = {one.name: function_of(one) for one in model.motions if one.name in TWENTY_ONE}
    errors |= {one.name: one.value for one in model.locations if one.name in TWENTY_ONE}
    doubts = {one.name: _u(one, model.systematic.get(one.name, 0.0)) for one in model.motions}
    doubts |= {one.name: one.u for one in model.locations} | {one.name: one.u for one in model.unknown}
    machine: dict[str, Any] = {"c_frame": "fixed"}
    if height_mm:
        machine = {"preset": "", "chain": _raised(height_mm)}
    told = {
        "name": name,
        "machine": machine,
        "errors": errors or {"EXX": 0.0},
        "uncertainty": {"linear_um": 0.0, "angular_arcsec": 0.0, "each": doubts},
    }
    return validated(told, ErrorFile, name)


def function_of(component: Component) -> dict[str, Any]:
    """A fitted motion as an error file has it: a broken line in um or arcsec over mm or deg, known over its range."""
    parameters, periodic = dict[str, Any](component.parameters), is_periodic(component)
    low, high = component.domain
    if component.basis == "piecewise":
        at, values = np.asarray(parameters["nodes"]), component.coefficients
    else:
        span = TURN_DEG if periodic else high - low
        waves = max([*parameters.get("orders", ()), *(span / one for one in parameters.get("lengths", ())), 1.0])
        count = min(MOST_POINTS, max(FEWEST_POINTS, int(POINTS_PER_WAVE * waves) + 1))
        at = np.linspace(low, low + TURN_DEG if periodic else high, count)
        values = value(component, at)
    known = {"period": TURN_DEG} if periodic else {"range": (low, high)}
    return {"type": "pl", "q": np.asarray(at).tolist(), "v": np.asarray(values).tolist(), **known}


def _u(component: Component, systematic: float) -> float:
    """Standard uncertainty of a motion, root mean square over its range, with what repetition does not show."""
    at = np.linspace(*component.domain, SAMPLES)
    return float(np.sqrt(np.mean(motion_uncertainty(component, at) ** 2) + systematic**2))


def _raised(height_mm: float) -> dict[str, Any]:
    """The form grinder with the work's middle at a height of the table."""
    x = {"kind": "prismatic", "name": "X", "axis": [1.0, 0.0, 0.0]}
    c = {"kind": "revolute", "name": "C", "axis": [0.0, 0.0, 1.0], "err_frame": "fixed"}
    z = {"kind": "prismatic", "name": "Z", "axis": [0.0, 0.0, 1.0]}
    return {"work": [x, c, {"kind": "fixed", "xyz": [0.0, 0.0, height_mm]}], "tool": [z]}
