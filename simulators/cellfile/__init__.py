"""The cell file: everything a simulated cell is made of, validated, and nothing that it measures.

`load_cell` reads a packaged cell or a TOML file. With ``like`` a file contains only the differences from a packaged
cell: tables are merged key by key, axes and instruments by their names.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from drivers.errors import ConfigError
from drivers.local.names import shown
from drivers.local.textfile import parse_toml, read_toml
from simulators.cellfile.curves import (
    CellSection,
    DriftSection,
    LoadedAxisTable,
    LoadedCrossTable,
    LoadedTable,
    Name,
    Terms,
)
from simulators.cellfile.equipment import (
    Calibrator,
    Clamping,
    Gear,
    InspectionMachine,
    Instrument,
    Laser,
    Noise,
    Outliers,
    Part,
    Sensor,
    Setup,
    Wheel,
)

LISTS_BY_NAME = ("axes", "instruments")


def apply_changes(base: Mapping[str, Any], tree: Mapping[str, Any]) -> dict[str, Any]:
    """``base`` with what ``tree`` says: tables part by part, axes and instruments by their names, all else replaced."""
    return {**base, **{key: _merge_value(key, base.get(key), value) for key, value in tree.items()}}


def _merge_value(key: str, old: Any, new: Any) -> Any:
    if isinstance(old, dict) and isinstance(new, dict):
        return apply_changes(old, new)
    if key not in LISTS_BY_NAME or not isinstance(old, list) or not isinstance(new, list):
        return new
    by_name = {one.get("name"): one for one in new}
    kept = [apply_changes(one, by_name.pop(one.get("name"), {})) for one in old]
    return [*kept, *by_name.values()]


__all__ = [
    "Calibrator",
    "CellAxis",
    "CellFile",
    "CellMachine",
    "Clamping",
    "ClimateQuantity",
    "ClimateSection",
    "DriftSection",
    "Gear",
    "HysteresisSection",
    "InspectionMachine",
    "Instrument",
    "Laser",
    "LoadedAxisTable",
    "LoadedCrossTable",
    "LoadedTable",
    "Noise",
    "OperatorSection",
    "Outliers",
    "Part",
    "Sensor",
    "Setup",
    "SiteSection",
    "Terms",
    "TruthSection",
    "Wheel",
    "limit_sample_rate",
    "list_cells",
    "load_cell",
    "packaged_cells",
    "with_connections",
    "with_plan",
    "with_site",
]


ReservedPoints = Annotated[int, Field(ge=0, le=5000)]
"""Interpolation points an 840D may reserve."""


class HysteresisSection(CellSection):
    """Reversal that builds up over a distance of travel: full difference ``size`` after ``distance``."""

    size: float
    distance: float = Field(gt=0)


class CellAxis(CellSection):
    """One machine axis. ``measure`` and ``table`` go into the site file as they stand.

    ``reversal`` is B = mean up - mean down in um or arcsec, a curve over the axis; ``drift_per_h`` moves
    the whole axis, and so does ``drift``, which may bend. ``scatter`` is the standard deviation of where the axis
    comes to stand, drawn anew for every stop. ``thermal_origin`` is the position of the scale's fixed point.
    ``encoder`` is the measuring system (0, 1) that acts, ``loaded`` what its table holds; ``number`` of the machine
    axis, 0 for the next one.
    """

    name: Name = Field(pattern=r"^[A-Z][A-Z0-9]*$")
    letter: Literal["X", "Y", "Z", "C"]
    kind: Literal["linear", "rotary"]
    travel: tuple[float, float]
    reference: float = 0.0
    modulo: bool = False
    max_velocity: float = Field(default=10000.0, gt=0)
    servo_time_s: float = Field(default=0.05, gt=0)
    eec_points: tuple[ReservedPoints, ReservedPoints] = (0, 0)
    encoder: Literal[0, 1] = 0
    number: int = Field(default=0, ge=0, le=31)
    loaded: LoadedAxisTable | None = None
    absolute_encoder: bool = False
    backlash: float = 0.0
    reversal: Terms = ()
    hysteresis: HysteresisSection | None = None
    scatter: float = Field(default=0.0, ge=0)
    drift_per_h: float = 0.0
    drift: DriftSection = DriftSection()
    expansion_ppm_per_k: float = 0.0
    thermal_origin: float = 0.0
    measure: dict[str, Any] | None = None
    table: dict[str, Any] | None = None


Motion = Annotated[str, Field(pattern=r"^E[XYZABC][XYZC]$")]
Location = Annotated[str, Field(pattern=r"^(?:[ABC]0[XZ]|[XYZABC]0C)$")]


class TruthSection(CellSection):
    """The machine's error motions (EXX, EYX, ... ECC) and location errors (B0Z, A0C, X0C, ...).

    ``reversals`` are what a motion has more on the way up than on the way down (straightness, tilt, ...; the axis' own
    deviation has ``reversal`` of its axis for that); ``moving`` is how locations move with time and temperature.
    """

    motions: dict[Motion, Terms] = Field(default_factory=dict)
    reversals: dict[Motion, Terms] = Field(default_factory=dict)
    locations: dict[Location, float] = Field(default_factory=dict)
    moving: dict[Location, DriftSection] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _not_its_own(self) -> TruthSection:
        own = [name for name in self.reversals if name[1] == name[2]]
        if own:
            raise ValueError(f"{own[0]}: the way of travel of an axis' own deviation is 'reversal' of that axis")
        return self


class ClimateQuantity(CellSection):
    """How a quantity of the surroundings runs: start, drift an hour, a slow wave, and its sensor's error.

    A drift goes one way for half a day and then back, at most 12 h of it from the start.
    """

    start: float
    per_h: float = 0.0
    wave: float = 0.0
    wave_period_s: float = Field(default=1800.0, gt=0)
    sensor_error: float = 0.0


class ClimateSection(CellSection):
    """Air and material around the machine."""

    air_degc: ClimateQuantity = ClimateQuantity(start=20.0)
    pressure_hpa: ClimateQuantity = ClimateQuantity(start=1013.25)
    humidity_pct: ClimateQuantity = ClimateQuantity(start=50.0)
    material_degc: ClimateQuantity = ClimateQuantity(start=20.0)


class OperatorSection(CellSection):
    """The person at the machine: how quick, how careful. Times in seconds of the cell's clock."""

    auto: bool = True
    start_delay_s: float = Field(default=3.0, ge=0)
    setup_delay_s: float = Field(default=20.0, ge=0)
    step_delay_s: float = Field(default=10.0, ge=0, description="to put a shim under optics, or take it out")
    load_delay_s: float = Field(default=20.0, ge=0, description="to take a part off or clamp a blank")
    release_delay_s: float = Field(default=2.0, ge=0)
    activate_delay_s: float = Field(default=10.0, ge=0)
    confirm_delay_s: float = Field(default=5.0, ge=0, description="from the panel's lamp to its button")
    confirms: bool = True
    gives_release: bool = Field(default=True, description="turns the local release on while a session wants it")
    restarts: bool = Field(default=True, description="restarts the control when a confirmed table acts only then")
    mounts_reversed: tuple[str, ...] = Field(default=(), description="components mounted the wrong way round")
    mounts_wrong: tuple[str, ...] = Field(default=(), description="components mounted with the wrong optics")


class CellMachine(CellSection):
    """The control: the set-up of the simulated NCK. ``cec_sign`` "seed" draws it."""

    model: str = "YK7350B"
    serial: str = "YK7350B-0042"
    nck_version: str = "V4.94 + SP1"
    access_level: int = Field(default=2, ge=0, le=7)
    cec_sign: Literal["seed", 1, -1] = "seed"
    cec_points: tuple[ReservedPoints, ...] = Field(default=(), max_length=62)
    cross: tuple[LoadedCrossTable, ...] = Field(default=(), max_length=62)
    switches: dict[str, Any] = Field(
        default_factory=dict,
        description='any other field of the NCK double (simulators.nck.switches); an open one may say "seed"',
    )
    opcua: dict[str, Any] = Field(default_factory=dict, description="settings of the OPC UA server")
    modbus: dict[str, Any] = Field(default_factory=dict, description="simulators.modbus.settings.PlcSettings")
    roads: tuple[Literal["opcua", "modbus", "carried"], ...] = Field(
        default=("opcua",), min_length=1, description="ways into the control; the site file has the first"
    )


class SiteSection(CellSection):
    """What the printed site file says beyond axes and instruments."""

    name: Name = "demo-grinder"
    store: str = "runs"
    plan: bool = Field(default=False, description="whether the site file names every set-up and the work")
    controller: dict[str, Any] = Field(default_factory=dict, description="further keys of [controller]")
    controller_settings: dict[str, Any] = Field(default_factory=dict)
    modbus_settings: dict[str, Any] = Field(default_factory=dict)
    operator: dict[str, Any] = Field(default_factory=dict)
    patience_s: float = Field(
        default=0.0, ge=0, le=600, description="timeout_s and stale_s of devices; 0: a gateway's own"
    )
    # Nobody stands beside a simulated wheel, and simulated minutes cost real ones: moves at the speed of measuring.
    moves: dict[str, Any] = Field(default={"feed_mm": 6000.0, "feed_deg": 3600.0}, description="feeds of [moves]")


class CellFile(CellSection):
    """A whole cell."""

    name: Name
    seed: int = Field(default=1, ge=0, lt=1 << 63)
    machine: CellMachine = CellMachine()
    axes: tuple[CellAxis, ...] = Field(min_length=1, max_length=31)
    truth: TruthSection = TruthSection()
    climate: ClimateSection = ClimateSection()
    instruments: tuple[Instrument, ...] = Field(default=(), max_length=64)
    setups: tuple[Setup, ...] = Field(default=(), max_length=500)
    part: Part | None = None
    wheel: Wheel = Wheel()
    operator: OperatorSection = OperatorSection()
    site: SiteSection = SiteSection()

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

    def axis(self, name: str) -> CellAxis:
        """An axis by its name (X1) or letter (X). Raises ConfigError (E-CELL-AXIS)."""
        for axis in self.axes:
            if name in (axis.name, axis.letter):
                return axis
        raise ConfigError("E-CELL-AXIS", self.name, axis=name, known=", ".join(a.name for a in self.axes))


def load_cell(source: str | Path) -> CellFile:
    """Read a cell: a packaged name ("demo") or a TOML file. Raises ConfigError (E-CELL-READ, E-CELL-VALUE)."""
    tree = _read_tree(source)
    try:
        return CellFile.model_validate(tree)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "(file)"
        raise ConfigError("E-CELL-VALUE", str(source), key=shown(key), why=first["msg"]) from error


def with_connections(cell: CellFile, road: str, modbus: Mapping[str, Any]) -> CellFile:
    """The cell with another way in ("opcua", "modbus", "both"; "" as it is) and these settings of its PLC."""
    roads = {"": cell.machine.roads, "both": ("opcua", "modbus")}.get(road, (road,))
    settings = {**cell.machine.modbus, **modbus}
    machine = CellMachine.model_validate({**cell.machine.model_dump(), "roads": roads, "modbus": settings})
    return cell.model_copy(update={"machine": machine})


def with_plan(cell: CellFile) -> CellFile:
    """The cell with a site file that names every set-up and the work."""
    return with_site(cell, plan=True)


def with_site(cell: CellFile, **asked: Any) -> CellFile:
    """The cell with these keys of what its site file says."""
    return cell.model_copy(update={"site": cell.site.model_copy(update=asked)})


def limit_sample_rate(cell: CellFile, hz: float) -> CellFile:
    """The cell with instruments that take no more samples than so many a second."""
    slower = tuple(
        one if isinstance(one, InspectionMachine) else one.model_copy(update={"sample_hz": min(one.sample_hz, hz)})
        for one in cell.instruments
    )
    return cell.model_copy(update={"instruments": slower})


def list_cells() -> dict[str, str]:
    """Every cell that comes with us, and the first sentence of its file."""
    folder = resources.files("simulators").joinpath("cells")
    texts = {name: folder.joinpath(f"{name}.toml").read_text(encoding="utf-8") for name in packaged_cells()}
    return {name: _first_sentence(text) for name, text in texts.items()}


def _first_sentence(text: str) -> str:
    lines = takewhile(lambda line: line.startswith("#"), text.splitlines())
    return " ".join(line.lstrip("# ") for line in lines).partition(". ")[0].rstrip(".")


def packaged_cells() -> tuple[str, ...]:
    """Names of the cells that come with us."""
    folder = resources.files("simulators").joinpath("cells")
    return tuple(sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".toml")))


def _read_tree(source: str | Path) -> dict[str, Any]:
    """A cell file as a tree; with ``like`` it says only what differs from another cell that comes with us."""
    try:
        if str(source) in packaged_cells():
            inside = resources.files("simulators").joinpath("cells", f"{source}.toml")
            tree = parse_toml(inside.read_text(encoding="utf-8"))
        else:
            tree = read_toml(Path(source))
    except (OSError, ValueError) as error:
        raise ConfigError("E-CELL-READ", str(source), why=str(error)) from error
    like = tree.pop("like", "")
    return apply_changes(_read_tree(_packaged_base(like, source)), tree) if like else tree


def _packaged_base(like: Any, source: str | Path) -> str:
    if like in packaged_cells() and like != str(source):
        return str(like)
    raise ConfigError("E-CELL-VALUE", str(source), key="like", why=f"is one of {', '.join(packaged_cells())}")
