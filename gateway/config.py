"""Site file -> validated tree: the one place where configuration is read, and its JSON schema comes from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError, field_validator, model_validator

from drivers.errors import ConfigError, words
from drivers.local.names import shown
from drivers.local.scrub import has_user, is_secret, secrets_in
from drivers.local.tomlfile import read_toml
from gateway.axes import AxisRecord
from gateway.siteplan import (
    MOST_POINTS,
    MOST_REPETITIONS,
    AssumedSection,
    GuardSection,
    MaybeName,
    Name,
    Section,
    SetupSection,
    Targets,
    WorkingWindow,
    WorkSection,
    belongs,
)

__all__ = [
    "AssumedSection",
    "AxisSection",
    "ControllerSection",
    "GuardSection",
    "InstrumentSection",
    "MeasureSection",
    "OperatorTimes",
    "SetupSection",
    "Site",
    "SiteFile",
    "TableSection",
    "Targets",
    "WorkSection",
    "WorkingWindow",
    "load_site",
    "schema",
]


# The largest control has 31 axes; the rest is far above any machine and far below what fills a memory.
MOST_AXES, MOST_INSTRUMENTS, MOST_SETUPS = 31, 64, 500


class Site(Section):
    """Whose machine this is and where runs are kept."""

    name: Name = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", description="what --machine must say; no blanks")
    store: Path = Field(default=Path("runs"), description="run folders, relative to the site file")
    trace: bool = Field(default=False, description="keep what passes on every instrument's wire in the run folder")
    verify_each_day: bool = Field(
        default=False, description="`serve` compares the live tables with what was pushed once a day, or says it is due"
    )
    verify_hour: int = Field(default=6, ge=0, le=23, description="hour (UTC) from which on that comparison is due")
    approvals: Literal[1, 2] | None = Field(
        default=None, description="people who must agree to a push; left out: one, and two when anything warns"
    )


class _Reached(Section):
    """What is reached by an address with settings of its own: neither may hold a secret."""

    url: str
    settings: dict[str, Any] = Field(
        default_factory=dict, description="driver's own keys; secrets as KEY_file or KEY_env, never in the site file"
    )

    @field_validator("url")
    @classmethod
    def _no_user(cls, url: str) -> str:
        if has_user(url):
            raise ValueError(words("W-SECRET-URL"))
        return url

    @field_validator("settings")
    @classmethod
    def _no_secret(cls, settings: dict[str, Any]) -> dict[str, Any]:
        for key in secrets_in(settings):
            raise ValueError(words("W-SECRET-INLINE", key=key))
        return settings


class ControllerSection(_Reached):
    """How to reach the control."""

    driver: str = "sinumerik-opcua"
    serial: str = Field(min_length=1, description="serial number this machine must answer with")
    timeout_s: float = Field(default=5.0, gt=0)
    access_level: int = Field(default=3, ge=0, le=7, description="largest at which the tables' switches are writable")


class InstrumentSection(_Reached):
    """One instrument and its wire."""

    name: Name
    driver: str
    serial: str = Field(default="", description="serial number it must answer with; empty accepts any")
    timeout_s: float = Field(default=5.0, gt=0)


class MeasureSection(Section):
    """How one axis is measured. The datum is the first target, the lowest position.

    ``dead_path_mm`` is the beam from interferometer to reflector with the axis at the datum; ``beam`` +1
    when the axis' plus direction leads the reflector away from the interferometer, -1 when towards it.
    """

    instrument: MaybeName = ""
    component: Name
    targets: Targets | None = None
    repetitions: int = Field(default=5, ge=1, le=MOST_REPETITIONS)
    cycle: Literal["standard", "pendulum", "pilgrim"] = Field(
        default="standard", description="only standard is ISO 230-2"
    )
    between: int = Field(
        default=6, ge=0, le=24, description="check stops between the targets, one for four of these at most"
    )
    retakes: int = Field(default=1, ge=0, le=5, description="rounds over targets that did not settle")
    beam_recoveries: int = Field(
        default=2, ge=0, le=20, description="times a lost beam may be restored and the datum set anew"
    )
    overrun: float = Field(default=5.0, gt=0)
    feed: float = Field(gt=0)
    dwell_s: float = Field(default=1.0, gt=0)
    settle_s: float = Field(default=1.0, ge=0, description="instrument time after arrival")
    average_s: float = Field(default=1.0, gt=0, description="instrument time averaged")
    stable: float = Field(gt=0, description="largest allowed sigma in the window, um or arcsec")
    dead_path_mm: float = Field(default=0.0, ge=0)
    beam: Literal[1, -1] = Field(default=1, description="+1: plus direction leads away from the interferometer")
    expansion_ppm_per_k: float = Field(default=11.5, description="of the scale, to 20 degC")
    jog: float = Field(default=10.0, description="sense proof move in mm; rotary 0.1 deg")
    file: Path | None = Field(default=None, description=".rtl/.rta/.csv in place of a live capture")
    file_datum: float | None = Field(default=None, description="machine coordinate of the file's zero")
    file_axis_sense: Literal[1, -1] = Field(default=1, description="file direction against the axis")
    file_unit: Literal["", "mrad", "urad", "arcsec"] = Field(default="", description=".rta only, confirmed")

    @model_validator(mode="after")
    def _one_source(self) -> MeasureSection:
        if self.file is None:
            if not self.instrument or self.targets is None:
                raise ValueError("a live capture needs instrument and targets")
        elif self.file_datum is None:
            raise ValueError("a file holds no machine datum: give file_datum, the machine coordinate of its zero")
        return self


class TableSection(Section):
    """The controller's grid for one axis."""

    minimum: float
    maximum: float
    step: float = Field(gt=0)

    @model_validator(mode="after")
    def _divides(self) -> TableSection:
        intervals = (self.maximum - self.minimum) / self.step
        if not 1 <= intervals < MOST_POINTS or abs(intervals - round(intervals)) > 1e-9:
            raise ValueError(f"step must divide maximum - minimum into {MOST_POINTS - 1} intervals at most")
        return self


class AxisSection(Section):
    """One machine axis: ``name`` as the control has it (X1), ``letter`` its ISO 230-1 and program name (X)."""

    name: Name
    letter: str = Field(pattern=r"^[A-Z]$")
    kind: Literal["linear", "rotary"]
    travel: tuple[float, float]
    reference: float = 0.0
    modulo: bool = False
    encoder: int = Field(default=0, ge=0, le=1, description="measuring system whose table acts; say it with two")
    measure: MeasureSection
    table: TableSection

    @model_validator(mode="after")
    def _ordered(self) -> AxisSection:
        if self.travel[0] >= self.travel[1]:
            raise ValueError("travel must be [low, high]")
        return self

    @property
    def encoder_said(self) -> bool:
        """Whether the site file names the measuring system."""
        return "encoder" in self.model_fields_set

    @property
    def unit(self) -> Literal["mm", "deg"]:
        """Unit of the axis."""
        return "mm" if self.kind == "linear" else "deg"

    @property
    def facts(self) -> AxisRecord:
        """What rooms below need of it, as their one record."""
        return AxisRecord(
            name=self.name,
            letter=self.letter,
            unit=self.unit,
            rotary=self.kind == "rotary",
            modulo=self.modulo,
            travel=self.travel,
            reference=self.reference,
            feed=self.measure.feed,
            overrun=self.measure.overrun,
            dwell_s=self.measure.dwell_s,
            encoder=self.encoder,
            encoder_said=self.encoder_said,
        )


class OperatorTimes(Section):
    """How long the run waits for people, in seconds of the gateway's clock."""

    start_timeout_s: float = Field(default=600.0, gt=0)
    stop_timeout_s: float = Field(default=120.0, gt=0)


class SiteFile(Section):
    """A whole site file."""

    site: Site
    controller: ControllerSection
    instruments: tuple[InstrumentSection, ...] = Field(default=(), max_length=MOST_INSTRUMENTS)
    axes: tuple[AxisSection, ...] = Field(min_length=1, max_length=MOST_AXES)
    operator: OperatorTimes = OperatorTimes()
    setups: tuple[SetupSection, ...] = Field(default=(), max_length=MOST_SETUPS)
    assumed: AssumedSection = AssumedSection()
    work: WorkSection | None = None
    guard: GuardSection = GuardSection()

    @model_validator(mode="after")
    def _names(self) -> SiteFile:
        names = [instrument.name for instrument in self.instruments]
        if len(set(names)) != len(names):
            raise ValueError("two instruments have the same name")
        for axis in self.axes:
            if axis.measure.instrument and axis.measure.instrument not in names:
                raise ValueError(f"axis {axis.name}: no instrument is called {axis.measure.instrument!r}")
        return self

    @model_validator(mode="after")
    def _plan(self) -> SiteFile:
        names = {instrument.name for instrument in self.instruments}
        axes = {axis.name: axis for axis in self.axes}
        for setup in self.setups:
            where = f"set-up {setup.component} on {setup.axis}"
            if setup.axis not in axes:
                raise ValueError(f"{where}: the site has no such axis")
            if setup.instrument and setup.instrument not in names:
                raise ValueError(f"{where}: no instrument is called {setup.instrument!r}")
            if set(setup.park) - set(axes) or setup.axis in setup.park:
                raise ValueError(f"{where}: park names other axes of the site")
            belongs(setup, axes[setup.axis].letter, axes[setup.axis].kind, where)
        keys = [(setup.component, setup.axis, tuple(sorted(setup.park.items()))) for setup in self.setups]
        for twice in {key for key in keys if keys.count(key) > 1}:
            raise ValueError(f"set-up {twice[0]} on {twice[1]} is there twice")
        return self


def load_site(path: Path) -> SiteFile:
    """Read a site file. Raises ConfigError (E-CFG-READ, E-CFG-TOML, E-CFG-VALUE) with file, key and why."""
    try:
        data = read_toml(path)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError("E-CFG-READ", str(path), why=str(error)) from error
    except ValueError as error:
        raise ConfigError("E-CFG-TOML", str(path), why=str(error)) from error
    try:
        return SiteFile.model_validate(data)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "(file)"
        more, value = error.error_count() - 1, _given(first)
        raise ConfigError("E-CFG-VALUE", str(path), key=shown(key), value=value, why=first["msg"], more=more) from error


def _given(problem: Mapping[str, Any]) -> str:
    """The value that was refused, as far as it is one and may be shown."""
    value = problem["input"]
    hidden = has_user(str(value)) or any(is_secret(str(part)) for part in problem["loc"])
    if hidden or not isinstance(value, str | int | float) or problem["type"] == "missing":
        return ""
    return f' = "{shown(value)}"' if isinstance(value, str) else f" = {shown(value)}"


def schema() -> dict[str, Any]:
    """The site file's JSON schema."""
    return SiteFile.model_json_schema()
