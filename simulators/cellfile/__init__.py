"""Cell file -> validated tree: everything a simulated cell is made of, and nothing it measures."""

from __future__ import annotations

import tomllib
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from drivers.errors import ConfigError
from simulators.cellfile.terms import Section, Terms


class Hysteresis(Section):
    """Reversal that builds up over a distance of travel: full difference ``size`` after ``distance``."""

    size: float
    distance: float = Field(gt=0)


class Axis(Section):
    """One machine axis. ``measure`` and ``table`` go into the site file as they stand.

    ``reversal`` is B = mean up - mean down in um or arcsec, a curve over the axis; ``drift_per_h`` moves
    the whole axis. ``thermal_origin`` is the position of the scale's fixed point.
    """

    name: str = Field(pattern=r"^[A-Z][A-Z0-9]*$")
    letter: Literal["X", "Y", "Z", "C"]
    kind: Literal["linear", "rotary"]
    travel: tuple[float, float]
    reference: float = 0.0
    modulo: bool = False
    max_velocity: float = Field(default=10000.0, gt=0)
    servo_time_s: float = Field(default=0.05, gt=0)
    eec_points: tuple[int, int] = (0, 0)
    backlash: float = 0.0
    reversal: Terms = ()
    hysteresis: Hysteresis | None = None
    drift_per_h: float = 0.0
    expansion_ppm_per_k: float = 0.0
    thermal_origin: float = 0.0
    measure: dict[str, Any] | None = None
    table: dict[str, Any] | None = None


class Truth(Section):
    """The machine's error motions (EXX, EYX, ... ECC) and location errors (B0Z, A0C, X0C, ...)."""

    motions: dict[Annotated[str, Field(pattern=r"^E[XYZABC][XYZC]$")], Terms] = Field(default_factory=dict)
    locations: dict[Annotated[str, Field(pattern=r"^(?:[ABC]0[XZ]|[XYZABC]0C)$")], float] = Field(default_factory=dict)


class Course(Section):
    """How a quantity of the surroundings runs: start, drift an hour, a slow wave, and its sensor's error."""

    start: float
    per_h: float = 0.0
    wave: float = 0.0
    wave_period_s: float = Field(default=1800.0, gt=0)
    sensor_error: float = 0.0


class Climate(Section):
    """Air and material around the machine."""

    air_degc: Course = Course(start=20.0)
    pressure_hpa: Course = Course(start=1013.25)
    humidity_pct: Course = Course(start=50.0)
    material_degc: Course = Course(start=20.0)


class Outliers(Section):
    """Readings that are off for one whole stop: ``count`` of them in each ``every`` stops."""

    count: int = Field(default=0, ge=0)
    size: float = 0.0
    every: int = Field(default=0, ge=0, description="0: the stops of one run of the axis")


class Noise(Section):
    """Noise of an instrument in um or arcsec: per stop (what averaging cannot remove) and per sample."""

    stop: float = Field(default=0.0, ge=0)
    sample: float = Field(default=0.0, ge=0)
    drift_per_h: float = 0.0
    outliers: Outliers = Outliers()


class Laser(Section):
    """A laser on a uMD counter: quadrature counts of wavelength / 2 / counts_per_cycle."""

    kind: Literal["umd"]
    name: str
    serial: str = "uMD2-0001"
    firmware: float = 1.26
    sample_hz: float = Field(default=1000.0, gt=0)
    counts_per_cycle: int = Field(default=16, gt=0)
    wavelength_nm: float = Field(default=632.990577, gt=0)
    sense: Literal["seed", 1, -1] = "seed"
    noise: Noise = Noise()
    settings: dict[str, Any] = Field(default_factory=dict)


class Calibrator(Section):
    """A self-turning rotary calibrator with its angular interferometer (XR20-W principle).

    ``own_error`` is the device encoder's error in arcsec over its own angle; ``retro_spacing_mm`` the S it
    was made with, ``spacing_error`` the relative error of the S it calculates with.
    """

    kind: Literal["bridge"]
    name: str
    serial: str = "XR-0001"
    model: str = "XR20-W (simulated)"
    sample_hz: float = Field(default=100.0, gt=0)
    sense: Literal["seed", 1, -1] = "seed"
    own_error: Terms = ()
    retro_spacing_mm: float = Field(default=30.0, gt=0)
    spacing_error: float = 0.0
    range_deg: float = Field(default=10.0, gt=0)
    turn_deg_per_s: float = Field(default=25.0, gt=0)
    remainder_deg: float = Field(default=0.05, ge=0)
    noise: Noise = Noise()
    settings: dict[str, Any] = Field(default_factory=dict)


Instrument = Annotated[Laser | Calibrator, Field(discriminator="kind")]


class Setup(Section):
    """How an instrument is mounted for one component of one axis.

    ``offset_mm`` is where the reflector's centre sits from the functional point of its carrier;
    ``misalign_mrad`` tilts the beam about two axes across it; ``dead_path_mm`` is the beam's length at
    ``datum`` (axis position); ``away`` is -1 when the beam gets shorter with + motion. A calibrator may
    sit ``eccentric_mm`` off the axis and ``tilt_mrad`` out of it.
    """

    component: str = Field(pattern=r"^E[XYZABC][XYZC]$")
    axis: Literal["X", "Y", "Z", "C"]
    instrument: str
    optics: Literal["linear", "angular", "rotary"]
    carrier: Literal["X", "Z", "C"] | None = None
    head: Literal["bed", "X", "Z"] = "bed"
    offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    misalign_mrad: tuple[float, float] = (0.0, 0.0)
    dead_path_mm: float = Field(default=0.0, ge=0)
    datum: float = 0.0
    away: Literal[1, -1] = 1
    retro_spacing_mm: float = Field(default=30.0, gt=0)
    eccentric_mm: float = 0.0
    tilt_mrad: float = 0.0


class Operator(Section):
    """The person at the machine: how quick, how careful. Times in seconds of the cell's clock."""

    auto: bool = True
    start_delay_s: float = Field(default=3.0, ge=0)
    setup_delay_s: float = Field(default=20.0, ge=0)
    release_delay_s: float = Field(default=2.0, ge=0)
    release_patience_s: float = Field(default=600.0, ge=0)
    activate_delay_s: float = Field(default=10.0, ge=0)
    looks_at_r: bool = True
    mounts_wrong: tuple[str, ...] = Field(default=(), description="components mounted with the wrong optics")


class Machine(Section):
    """The control: what goes into the NCK double. ``cec_sign`` "seed" draws it."""

    model: str = "YK7350B"
    serial: str = "YK7350B-0042"
    nck_version: str = "V4.94 + SP1"
    access_level: int = Field(default=2, ge=0, le=7)
    cec_sign: Literal["seed", 1, -1] = "seed"
    cec_points: tuple[int, ...] = ()
    switches: dict[str, Any] = Field(default_factory=dict, description="any other field of the NCK double")
    opcua: dict[str, Any] = Field(default_factory=dict, description="settings of the OPC UA server")


class SitePart(Section):
    """What the printed site file says beyond axes and instruments."""

    name: str = "demo-grinder"
    store: str = "runs"
    controller_settings: dict[str, Any] = Field(default_factory=dict)
    operator: dict[str, Any] = Field(default_factory=dict)


class CellFile(Section):
    """A whole cell."""

    name: str
    seed: int = Field(default=1, ge=0)
    machine: Machine = Machine()
    axes: tuple[Axis, ...] = Field(min_length=1)
    truth: Truth = Truth()
    climate: Climate = Climate()
    instruments: tuple[Instrument, ...] = ()
    setups: tuple[Setup, ...] = ()
    operator: Operator = Operator()
    site: SitePart = SitePart()

    @model_validator(mode="after")
    def _joined(self) -> CellFile:
        names = {instrument.name for instrument in self.instruments}
        letters = {axis.letter for axis in self.axes}
        if len(names) != len(self.instruments) or len(letters) != len(self.axes):
            raise ValueError("two instruments or two axes share a name")
        for setup in self.setups:
            if setup.instrument not in names or setup.axis not in letters:
                raise ValueError(f"setup {setup.component}: unknown instrument or axis")
        return self

    def axis(self, name: str) -> Axis:
        """An axis by its name (X1) or letter (X). Raises ConfigError (E-CELL-AXIS)."""
        for axis in self.axes:
            if name in (axis.name, axis.letter):
                return axis
        raise ConfigError("E-CELL-AXIS", self.name, axis=name, known=", ".join(a.name for a in self.axes))


def load_cell(source: str | Path) -> CellFile:
    """Read a cell: a packaged name ("demo") or a TOML file. Raises ConfigError (E-CELL-READ, E-CELL-VALUE)."""
    text = _text(source)
    try:
        return CellFile.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise ConfigError("E-CELL-READ", str(source), why=str(error)) from error
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "(file)"
        raise ConfigError("E-CELL-VALUE", str(source), key=key, why=first["msg"]) from error


def packaged() -> tuple[str, ...]:
    """Names of the cells that come with us."""
    folder = resources.files("simulators").joinpath("cells")
    return tuple(sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".toml")))


def _text(source: str | Path) -> str:
    try:
        if str(source) in packaged():
            return resources.files("simulators").joinpath("cells", f"{source}.toml").read_text(encoding="utf-8")
        return Path(source).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError("E-CELL-READ", str(source), why=str(error)) from error
