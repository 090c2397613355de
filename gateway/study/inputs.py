"""Gear file and error file of a study -> validated trees, and a measured machine's run as an error file."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from drivers.errors import ConfigError
from drivers.local.names import shown
from drivers.local.textfile import read_toml
from drivers.units import arcsec_to_rad
from gateway.domain.figures import Component
from gateway.gear.cycloid import CycloidGear
from gateway.model.components import TURN_DEG, is_periodic, motion_uncertainty, value
from gateway.model.error_model import TWENTY_ONE, ErrorModel
from gateway.siteplan import MOST_POINTS, Name
from gateway.store import RunFolder, decode

Number = float
MOST_APART = 1000.0  # of a disc its smallest length to its pitch circle: less was typed in another unit
SMALLEST_RP_MM, LARGEST_RP_MM = 1.0, 10_000.0
Tree = TypeVar("Tree", bound=BaseModel)


class _Section(BaseModel):
    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, str_max_length=1000, hide_input_in_errors=True
    )


class GearData(_Section):
    """The disc's own data, mm; ``drot_arcsec`` turns each flank."""

    rp: float
    rrp: float
    a: float
    zp: int = Field(le=1000)
    zc: int = Field(le=1000)
    b: float = 10.0
    drp: float = 0.0
    drrp: float = 0.0
    drot_arcsec: float = 0.0

    @model_validator(mode="after")
    def _in_millimetres(self) -> GearData:
        if 0.0 < self.rp < SMALLEST_RP_MM or self.rp > LARGEST_RP_MM:
            raise ValueError(
                f"rp is {self.rp:g}, outside {SMALLEST_RP_MM:g} .. {LARGEST_RP_MM:g} mm: lengths are in mm, not m or um"
            )
        for name in ("rrp", "a", "b"):
            one = getattr(self, name)
            if 0.0 < one < self.rp / MOST_APART or one > self.rp * 10.0:
                raise ValueError(f"{name} is {one:g} where rp is {self.rp:g} mm: lengths are in mm, not m or um")
        return self


class GrindingData(_Section):
    """Centre distance of gear and wheel, mm."""

    centre_distance_mm: float = Field(gt=0)


class FlankData(_Section):
    """Points looked at on each flank, and the normal deviation that is allowed to either side."""

    profile: int = Field(default=11, ge=3, le=501)
    width: int = Field(default=5, ge=2, le=101)
    fraction: float = Field(default=0.95, gt=0.0, le=1.0)
    limit_um: float = Field(default=2.0, gt=0.0)


class ReducerData(_Section):
    """The drive that the discs make, where it differs from the defaults by the gear's size; mm, um, N, Nm.

    ``datum`` of the flank deviations is asked for. ``marks`` and ``crank_phases_deg`` have one value per disc.
    """

    name: Name = "drive"
    datum: Literal["crank-holes", "bore", "best-fit"]
    rated_nm: float | None = Field(default=None, gt=0.0)
    crank_phases_deg: tuple[float, ...] | None = Field(default=None, min_length=1, max_length=3)
    marks: tuple[int, ...] | None = Field(default=None, min_length=1, max_length=3)
    pin_circle_mm: float | None = Field(default=None, gt=0.0)
    pin_radius_mm: float | None = Field(default=None, gt=0.0)
    cranks: int | None = Field(default=None, ge=1, le=12)
    crank_circle_mm: float | None = Field(default=None, gt=0.0)
    crank_stiffness_n_mm: float | None = Field(default=None, gt=0.0)
    crank_clearance_um: float | None = Field(default=None, ge=0.0)
    contact_n_mm2: float | None = Field(default=None, gt=0.0)
    interference_um: float | None = Field(default=None, ge=0.0)


class GearFile(_Section):
    """A whole gear file."""

    name: Name
    note: str = ""
    gear: GearData
    grinding: GrindingData
    flank: FlankData = FlankData()
    reducer: ReducerData | None = None


class ChainSection(_Section):
    """A preset with the frame of its C errors, or a whole chain (mm, rad, without errors)."""

    preset: Literal["yk7350b", ""] = "yk7350b"
    c_frame: Literal["moving", "fixed"] = "moving"
    chain: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _one(self) -> ChainSection:
        if bool(self.preset) == bool(self.chain):
            raise ValueError('give either a preset or, with preset = "", a chain')
        return self


class ErrorFunction(_Section):
    """An error motion over its axis' position: values in um or arcsec, positions in mm or deg.

    A broken line (pl) is known between its points, one around a whole turn everywhere; a formula everywhere, or over
    ``range`` alone.
    """

    type: Literal["poly", "fourier", "pl"]
    c: tuple[float, ...] = Field(default=(), max_length=MOST_POINTS)
    q0: float = 0.0
    scale: float = 1.0
    a0: float = 0.0
    a: tuple[float, ...] = Field(default=(), max_length=MOST_POINTS)
    b: tuple[float, ...] = Field(default=(), max_length=MOST_POINTS)
    period: float | None = None
    q: tuple[float, ...] = Field(default=(), max_length=MOST_POINTS)
    v: tuple[float, ...] = Field(default=(), max_length=MOST_POINTS)
    range: tuple[float, float] | None = Field(default=None, description="lowest and highest position where it is known")

    @model_validator(mode="after")
    def _of_its_type(self) -> ErrorFunction:
        """A key of another type would be passed over, and a series without terms be no error at all."""
        own = {"poly": ("c", "q0", "scale"), "fourier": ("a0", "a", "b", "period"), "pl": ("q", "v", "period")}
        given = [name for name, field in type(self).model_fields.items() if getattr(self, name) != field.default]
        foreign = [name for name in given if name not in (*own[self.type], "type", "range")]
        if foreign:
            raise ValueError(
                f'{", ".join(foreign)} of type "{self.type}" means nothing: it takes {", ".join(own[self.type])}'
            )
        if self.type == "fourier" and not {"a0", "a", "b"} & self.model_fields_set:
            raise ValueError("a Fourier series needs a0, a or b")
        return self


class SeededErrors(_Section):
    """Errors drawn for those not given: largest size of a motion's terms and of location errors."""

    seed: int = Field(ge=0, lt=1 << 63)
    linear_um: float = Field(default=3.0, ge=0.0)
    angular_arcsec: float = Field(default=4.0, ge=0.0)
    location_arcsec: float = Field(default=10.0, ge=0.0)
    travel_mm: float = Field(default=200.0, gt=0.0)


class Doubt(_Section):
    """Standard uncertainty of the errors: a value for all lengths, one for all angles, and any by name."""

    linear_um: float = Field(default=0.5, ge=0.0)
    angular_arcsec: float = Field(default=0.5, ge=0.0)
    each: dict[str, float] = Field(default_factory=dict)


class GridData(_Section):
    """The controller's grid for tables over one axis, in its unit."""

    minimum: float
    maximum: float
    step: float = Field(gt=0)
    reference: float = 0.0
    modulo: bool = False

    @model_validator(mode="after")
    def _divides(self) -> GridData:
        intervals = (self.maximum - self.minimum) / self.step
        if not 1 <= intervals < MOST_POINTS or abs(intervals - round(intervals)) > 1e-9:
            raise ValueError(f"step must divide maximum - minimum into {MOST_POINTS - 1} intervals at most")
        return self


class ErrorFile(_Section):
    """A whole error file: the machine, its errors, how well they are known, and what its control can hold."""

    name: Name
    note: str = ""
    machine: ChainSection = ChainSection()
    errors: dict[str, Number | ErrorFunction | tuple[Number | ErrorFunction, ...]] = Field(
        default_factory=dict, description="by name; several in a list are added up"
    )
    seeded: SeededErrors | None = None
    uncertainty: Doubt | None = None
    tables: dict[str, GridData] = Field(default_factory=dict)
    bounds: dict[str, float] = Field(
        default_factory=dict, description="how far cross tables may spoil an axis, um or arcsec"
    )
    goal: Literal["rms", "max"] = "rms"
    multiplication_proved: bool = Field(default=False, description="how two cross tables multiply was proved there")

    @model_validator(mode="after")
    def _no_bare_numbers(self) -> ErrorFile:
        for name, one in self.errors.items():
            if isinstance(one, tuple) and sum(isinstance(part, float) for part in one) > 1:
                raise ValueError(
                    f"{name} is a list of plain numbers, which would be added up: give one number, or positions and "
                    'values, {type = "pl", q = [...], v = [...]}'
                )
        return self

    @model_validator(mode="after")
    def _check_not_empty(self) -> ErrorFile:
        if not self.errors and self.seeded is None:
            raise ValueError("give errors, or a seed to draw them")
        return self


def gear_of(file: GearFile) -> CycloidGear:
    """The disc. Raises ModelError E-GEAR-... naming the limit it breaks."""
    data = file.gear.model_dump(exclude={"drot_arcsec"})
    return CycloidGear(**data, drot=arcsec_to_rad(file.gear.drot_arcsec))


def load_gear(path: Path) -> GearFile:
    """Read a gear file. Raises ConfigError (E-STUDY-READ, E-STUDY-TOML, E-STUDY-VALUE) with file, key and why."""
    return _load(path, GearFile)


def load_errors(path: Path) -> ErrorFile:
    """Read an error file. Raises ConfigError (E-STUDY-READ, E-STUDY-TOML, E-STUDY-VALUE) with file, key and why."""
    return _load(path, ErrorFile)


def _load(path: Path, kind: type[Tree]) -> Tree:
    try:
        data = read_toml(path)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError("E-STUDY-READ", str(path), why=str(error)) from error
    except ValueError as error:
        raise ConfigError("E-STUDY-TOML", str(path), why=str(error)) from error
    return validate_file(data, kind, str(path))


def validate_file(data: Any, kind: type[Tree], where: str) -> Tree:
    """Data of a gear or error file as its tree. Raises ConfigError (E-STUDY-VALUE) with key and why."""
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        # Of the forms that a value may have each says why it is none: our own reason tells the most.
        first = next((one for one in error.errors() if one["type"] == "value_error"), error.errors()[0])
        key = ".".join(str(part) for part in first["loc"]) or "(file)"
        more = error.error_count() - 1
        raise ConfigError("E-STUDY-VALUE", where, key=shown(key), why=first["msg"], more=more) from error


# ---- A measured machine as an error file: the errors of a stored run, with location errors and their uncertainty.
#
# A study takes an error file (TOML) or what a run knows; both become the same `ErrorFile`, so that command and library
# go one way from there. A fitted motion becomes a broken line, 100 points to its shortest wave, known over its range
# alone; the unmeasured errors are zero, and their assumed span counts in the uncertainty.

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
    return decode(data, ErrorModel, str(path))


def error_file(model: ErrorModel, name: str, height_mm: float = 0.0) -> ErrorFile:
    """The errors of a model, those of the 21; C errors are told in the fixed frame, as a run tells them."""
    errors: dict[str, Any] = {one.name: function_of(one) for one in model.motions if one.name in TWENTY_ONE}
    errors |= {one.name: one.value for one in model.locations if one.name in TWENTY_ONE}
    doubts = {one.name: _u(one, model.systematic.get(one.name, 0.0)) for one in model.motions}
    doubts |= {one.name: one.u for one in model.locations} | {one.name: one.u for one in model.unknown}
    machine: dict[str, Any] = {"c_frame": "fixed"}
    if height_mm:
        machine = {"preset": "", "chain": _raised_chain(height_mm)}
    told = {
        "name": name,
        "machine": machine,
        "errors": errors or {"EXX": 0.0},
        "uncertainty": {"linear_um": 0.0, "angular_arcsec": 0.0, "each": doubts},
    }
    return validate_file(told, ErrorFile, name)


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


def _raised_chain(height_mm: float) -> dict[str, Any]:
    """The form grinder with the work's middle at a height of the table."""
    x = {"kind": "prismatic", "name": "X", "axis": [1.0, 0.0, 0.0]}
    c = {"kind": "revolute", "name": "C", "axis": [0.0, 0.0, 1.0], "err_frame": "fixed"}
    z = {"kind": "prismatic", "name": "Z", "axis": [0.0, 0.0, 1.0]}
    return {"work": [x, c, {"kind": "fixed", "xyz": [0.0, 0.0, height_mm]}], "tool": [z]}
