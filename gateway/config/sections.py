"""The sections of a site file: every key with its kind, limits, default and what it means."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from drivers.errors import words
from drivers.local.scrub import has_user, secrets_in
from gateway.axes import AxisRecord
from gateway.siteplan import (
    MOST_POINTS,
    MOST_REPETITIONS,
    AssumedSection,
    Flag,
    GuardSection,
    MaybeName,
    Name,
    Number,
    Section,
    SetupSection,
    Targets,
    Whole,
    WorkSection,
)

# The largest control has 31 axes; the rest is far above any machine and far below what fills a memory.
MOST_AXES, MOST_INSTRUMENTS, MOST_SETUPS = 31, 64, 500


class Site(Section):
    """Whose machine this is and where runs are kept."""

    name: Name = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", description="what --machine must say; no blanks")
    store: Path = Field(default=Path("runs"), description="run folders, relative to the site file")
    trace: Flag = Field(default=False, description="keep what passes on every instrument's wire in the run folder")
    verify_each_day: Flag = Field(
        default=False, description="`serve` compares the live tables with what was pushed once a day, or says it is due"
    )
    verify_hour: Whole = Field(default=6, ge=0, le=23, description="hour (UTC) from which on that comparison is due")
    approvals: Literal[1, 2] | None = Field(
        default=None, description="people who must agree to a push; left out: one, and two when anything warns"
    )


class _Reached(Section):
    """What is reached by an address with settings of its own: neither may hold a secret."""

    url: str = Field(min_length=1, description="address, of a kind that the driver opens")
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

    driver: str = Field(default="sinumerik-opcua", description="road to the control, a driver by its name")
    serial: str = Field(min_length=1, description="serial number this machine must answer with")
    timeout_s: Number = Field(default=5.0, gt=0, le=600.0, description="longest wait for one answer, s")
    access_level: Whole = Field(default=3, ge=0, le=7, description="largest at which the tables' switches are writable")


class InstrumentSection(_Reached):
    """One instrument and its wire."""

    name: Name = Field(description="by which axes and set-ups call it")
    driver: str = Field(description="a driver by its name")
    serial: str = Field(default="", description="serial number it must answer with; empty accepts any")
    timeout_s: Number = Field(default=5.0, gt=0, le=600.0, description="longest wait for one answer, s")


class MeasureSection(Section):
    """How one axis is measured. The datum is the first target, the lowest position.

    ``dead_path_mm`` is the beam from interferometer to reflector with the axis at the datum; ``beam`` +1
    when the axis' plus direction leads the reflector away from the interferometer, -1 when towards it.
    """

    instrument: MaybeName = Field(default="", description="one of the instruments; left out with file")
    component: Name = Field(description="error that is measured: of axis X it is EXX")
    targets: Targets | None = Field(default=None, description="where the axis stops; left out with file")
    repetitions: Whole = Field(
        default=5, ge=1, le=MOST_REPETITIONS, description="times each target is visited from each side"
    )
    cycle: Literal["standard", "pendulum", "pilgrim"] = Field(
        default="standard", description="only standard is ISO 230-2"
    )
    between: Whole = Field(
        default=6, ge=0, le=24, description="check stops between the targets, one for four of these at most"
    )
    retakes: Whole = Field(
        default=2, ge=0, le=5, description="rounds over stops that did not settle, and over readings out of line"
    )
    beam_recoveries: Whole = Field(
        default=2, ge=0, le=20, description="times a lost beam may be restored and the datum set anew"
    )
    overrun: Number = Field(
        default=5.0, gt=0, le=1000.0, description="beyond the last target before the axis turns, mm or deg"
    )
    feed: Number = Field(gt=0, le=1e6, description="between targets, mm/min or deg/min")
    dwell_s: Number = Field(default=1.0, gt=0, le=600.0, description="standstill before each hand-shake, s")
    settle_s: Number = Field(default=1.0, ge=0, le=600.0, description="instrument time after arrival, s")
    average_s: Number = Field(default=1.0, gt=0, le=600.0, description="instrument time averaged, s")
    stable: Number = Field(gt=0, le=1000.0, description="largest allowed sigma in the window, um or arcsec")
    dead_path_mm: Number = Field(
        default=0.0, ge=0, le=1e5, description="beam from interferometer to reflector with the axis at the datum, mm"
    )
    beam: Literal[1, -1] = Field(default=1, description="+1: plus direction leads away from the interferometer")
    expansion_ppm_per_k: Number = Field(default=11.5, ge=-5.0, le=100.0, description="of the scale, to 20 degC, 1e-6/K")
    jog: Number = Field(default=10.0, gt=0, le=1000.0, description="sense proof move in mm; rotary 0.1 deg")
    file: Path | None = Field(default=None, description=".rtl/.rta/.csv in place of a live capture")
    file_datum: Number | None = Field(default=None, description="machine coordinate of the file's zero")
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

    minimum: Number = Field(description="first point, machine coordinate, mm or deg")
    maximum: Number = Field(description="last point, machine coordinate, mm or deg")
    step: Number = Field(gt=0, description="distance of the points, mm or deg; divides the range")

    @model_validator(mode="after")
    def _divides(self) -> TableSection:
        if self.minimum >= self.maximum:
            raise ValueError(words("W-CFG-SWAPPED", low="minimum", high="maximum"))
        intervals = (self.maximum - self.minimum) / self.step
        if not 1 <= intervals < MOST_POINTS or abs(intervals - round(intervals)) > 1e-9:
            raise ValueError(f"step must divide maximum - minimum into {MOST_POINTS - 1} intervals at most")
        return self


class AxisSection(Section):
    """One machine axis: ``name`` as the control has it (X1), ``letter`` its ISO 230-1 and program name (X)."""

    name: Name = Field(description="machine axis name, as the control has it")
    letter: str = Field(pattern=r"^[A-Z]$", description="of ISO 230-1, and in programs")
    kind: Literal["linear", "rotary"] = Field(description="linear counts in mm, rotary in deg")
    travel: tuple[Number, Number] = Field(description="[low, high] of the soft limits, mm or deg")
    reference: Number = Field(default=0.0, description="where the tables of this axis must be zero, mm or deg")
    modulo: Flag = Field(default=False, description="rotary axis that turns endlessly, 0 to 360 deg")
    encoder: Whole = Field(default=0, ge=0, le=1, description="measuring system that acts: 0 the first, 1 the second")
    measure: MeasureSection = Field(description="how it is measured")
    table: TableSection = Field(description="the control's grid")

    @model_validator(mode="after")
    def _ordered(self) -> AxisSection:
        if self.travel[0] >= self.travel[1]:
            raise ValueError(words("W-CFG-TRAVEL"))
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

    start_timeout_s: Number = Field(
        default=600.0, gt=0, le=604800.0, description="longest wait for START at the machine, s"
    )
    stop_timeout_s: Number = Field(
        default=120.0, gt=0, le=604800.0, description="longest wait for the axis at its next stop, s"
    )


class SiteFile(Section):
    """A whole site file."""

    site: Site = Field(description="whose machine this is")
    controller: ControllerSection = Field(description="how to reach the control")
    instruments: tuple[InstrumentSection, ...] = Field(
        default=(), max_length=MOST_INSTRUMENTS, description="what measures"
    )
    axes: tuple[AxisSection, ...] = Field(min_length=1, max_length=MOST_AXES, description="what is measured")
    operator: OperatorTimes = Field(default=OperatorTimes(), description="how long people are waited for")
    setups: tuple[SetupSection, ...] = Field(
        default=(), max_length=MOST_SETUPS, description="errors beyond the positioning of the axes"
    )
    assumed: AssumedSection = Field(default=AssumedSection(), description="errors that nobody measured")
    work: WorkSection | None = Field(default=None, description="the gear that this machine grinds")
    guard: GuardSection = Field(default=GuardSection(), description="the drift guard")
