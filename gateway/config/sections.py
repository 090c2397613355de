"""The sections of a site file: every key with its kind, limits, default and what it means."""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from drivers.errors import words
from drivers.local.scrub import has_user, secrets_in
from drivers.types.moves import FEED_DEG, FEED_MM, SafePlaces
from gateway.axes import AxisRecord
from gateway.config.paper import sections as paper
from gateway.config.service import ServiceSection
from gateway.siteplan import (
    MOST_POINTS,
    MOST_REPETITIONS,
    Accepted,
    AssumedSection,
    DayTimes,
    Degc,
    Flag,
    GearSection,
    GuardSection,
    MaybeName,
    Name,
    Number,
    OperatorTimes,
    People,
    Section,
    Sense,
    SetupSection,
    Statements,
    Targets,
    Whole,
    WorkSection,
)

# The largest control has 31 axes; the rest is far above any machine and far below what fills a memory.
MOST_AXES, MOST_INSTRUMENTS, MOST_SETUPS = 31, 64, 500


class Site(Section):
    """Whose machine this is and where runs are kept."""

    name: Name = Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", description="machine name that --machine must give; no blanks"
    )
    store: Path = Field(default=Path("runs"), description="folder of the runs, relative to the site file")
    simulated: Flag = Field(
        default=False, description="the machine is simulated: every report and picture is marked SIMULATED"
    )
    trace: Flag = Field(default=False, description="record the traffic of every instrument in the run folder")
    verify_each_day: Flag = Field(
        default=False,
        description="`serve` compares the live tables with the pushed ones once a day, or reports that this is due",
    )
    verify_hour: Whole = Field(default=6, ge=0, le=23, description="hour (UTC) at which that comparison is due")
    approvals: People = Field(
        default=None, description="people who must approve a push; left out: one, or two if there is a warning"
    )


class _Reached(Section):
    """What is reached by an address with settings of its own: neither may hold a secret."""

    url: str = Field(min_length=1, description="address, of a type that the driver supports")
    settings: dict[str, Any] = Field(
        default_factory=dict,
        description="settings of the driver; secrets as KEY_file or KEY_env, never in the site file",
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


class IdentitySection(Section):
    """Further facts that identify the machine, as read by `init`; a missing fact is stored when it is first read."""

    version: paper.Line = Field(default="", description="version of the control's software")
    axes: paper.Line = Field(
        default="", description="names of all machine axes in the control's own order, blanks between"
    )
    type: paper.Line = Field(default="", description="what the node of the setting type_node says")
    marker: paper.Line = Field(
        default="",
        description="this machine's own number, as typed into r_marker or marker_node",
    )

    @property
    def facts(self) -> dict[str, str]:
        """The facts that are stated, of `drivers.types.identity.FACTS`."""
        return {name: value for name, value in self.model_dump().items() if value}


class ControllerSection(_Reached):
    """How to reach the control."""

    driver: str = Field(
        default="sinumerik-opcua",
        description="name of the driver that connects to the control; none: files only, without url and serial",
    )
    serial: str = Field(
        min_length=1,
        description="serial number of the machine's control; everything of the machine is kept under it",
    )
    identity: IdentitySection = Field(default=IdentitySection(), description="what else the machine is known by")
    timeout_s: Number = Field(default=5.0, gt=0, le=600.0, description="longest wait for one answer, s")
    access_level: Whole = Field(
        default=3, ge=0, le=7, description="highest access level number at which the table switches are writable"
    )


class InstrumentSection(_Reached):
    """One instrument and its connection."""

    name: Name = Field(description="name that axes and set-ups use")
    driver: str = Field(description="name of the driver")
    serial: str = Field(default="", description="serial number of the instrument; empty accepts any")
    timeout_s: Number = Field(default=5.0, gt=0, le=600.0, description="longest wait for one answer, s")


class MeasureSection(Section):
    """How one axis is measured. The datum is the first target, the lowest position.

    ``dead_path_mm`` is the beam from interferometer to reflector with the axis at the datum; ``beam`` +1
    when the axis' plus direction leads the reflector away from the interferometer, -1 when towards it.
    """

    instrument: MaybeName = Field(
        default="", description="one of the instruments; left out with file, and with driver none"
    )
    component: Name = Field(description="measured error motion: EXX for axis X")
    targets: Targets | None = Field(default=None, description="where the axis stops; left out with file")
    repetitions: Whole = Field(
        default=5, ge=1, le=MOST_REPETITIONS, description="measurements per target and direction"
    )
    cycle: Literal["standard", "pendulum", "pilgrim"] = Field(
        default="standard", description="measuring cycle; only standard conforms to ISO 230-2"
    )
    between: Whole = Field(
        default=6, ge=0, le=24, description="check positions between the targets, at most one per four targets"
    )
    extra_hours: Number = Field(
        default=0.5,
        ge=0,
        le=48.0,
        description="time limit for additional targets where check positions show structure, h",
    )
    retakes: Whole = Field(default=2, ge=0, le=5, description="rounds that repeat unsettled readings and outliers")
    beam_recoveries: Whole = Field(
        default=2, ge=0, le=20, description="how often a lost beam may be restored with a new datum"
    )
    overrun: Number = Field(
        default=5.0, gt=0, le=1000.0, description="overrun beyond the last target before the axis reverses, mm or deg"
    )
    feed: Number = Field(gt=0, le=1e6, description="feed between targets, mm/min or deg/min")
    dwell_s: Number = Field(default=1.0, gt=0, le=600.0, description="dwell before each handshake, s")
    settle_s: Number = Field(
        default=1.0, ge=0, le=600.0, description="settling time after arrival, in instrument time, s"
    )
    average_s: Number = Field(default=1.0, gt=0, le=600.0, description="averaging time, in instrument time, s")
    standstill: Whole = Field(
        default=6,
        ge=0,
        le=50,
        description="readings at rest, once a capture: the instrument's own scatter; 0: none",
    )
    stable: Number = Field(
        gt=0, le=1000.0, description="largest allowed standard deviation while averaging, um or arcsec"
    )
    dead_path_mm: Number = Field(
        default=0.0, ge=0, le=1e5, description="beam from interferometer to reflector with the axis at the datum, mm"
    )
    beam: Sense = Field(default=1, description="+1: plus direction leads away from the interferometer")
    expansion_ppm_per_k: Number = Field(
        default=11.5, ge=-5.0, le=100.0, description="expansion coefficient of the scale, for 20 degC, 1e-6/K"
    )
    jog: Number = Field(
        default=10.0,
        gt=0,
        le=1000.0,
        description="length of the jog that proves the direction sense, mm; rotary 0.1 deg",
    )
    file: Path | None = Field(default=None, description="result file (.rtl, .rta, .csv) instead of a live capture")
    file_datum: Number | None = Field(default=None, description="machine position of the file's zero")
    file_axis_sense: Sense = Field(default=1, description="direction of the file relative to the axis")
    file_unit: Literal["", "mrad", "urad", "arcsec", "deg"] = Field(default="", description="unit of an .rta file")
    material_degc: Degc | None = Field(
        default=None, description="temperature of the material, where the file does not contain it, degC"
    )
    accept_doubts: Accepted = Field(
        default_factory=dict, description="doubts about the readings that a person answers for: code = reason"
    )
    accept: Statements = Field(
        default=(), description='statements of the file that differ and count all the same: "machine=Mill 7"'
    )

    @model_validator(mode="after")
    def _one_source(self) -> MeasureSection:
        if self.file is None:
            if self.targets is None:
                raise ValueError(words("W-CFG-LIVE-NEEDS"))
        elif self.file_datum is None:
            raise ValueError(words("W-CFG-FILE-DATUM"))
        return self


class TableSection(Section):
    """The controller's grid for one axis."""

    minimum: Number = Field(description="first point, machine coordinate, mm or deg")
    maximum: Number = Field(description="last point, machine coordinate, mm or deg")
    step: Number = Field(gt=0, description="spacing of the points, mm or deg; divides the range exactly")

    @model_validator(mode="after")
    def _divides(self) -> TableSection:
        if self.minimum >= self.maximum:
            raise ValueError(words("W-CFG-SWAPPED", low="minimum", high="maximum"))
        intervals = (self.maximum - self.minimum) / self.step
        if not 1 <= intervals < MOST_POINTS or abs(intervals - round(intervals)) > 1e-9:
            raise ValueError(words("W-CFG-DIVIDES", most=MOST_POINTS - 1))
        return self


class AxisSection(Section):
    """One machine axis: ``name`` as the control has it (X1), ``letter`` its ISO 230-1 and program name (X)."""

    name: Name = Field(description="machine axis name, as the control has it")
    letter: str = Field(pattern=r"^[A-Z]$", description="axis letter of ISO 230-1, also used in programs")
    kind: Literal["linear", "rotary"] = Field(description="linear (mm) or rotary (deg)")
    travel: tuple[Number, Number] = Field(description="[low, high] of the soft limits, mm or deg")
    reference: Number = Field(default=0.0, description="where the tables of this axis must be zero, mm or deg")
    modulo: Flag = Field(default=False, description="modulo rotary axis, 0 to 360 deg")
    encoder: Whole = Field(
        default=0, ge=0, le=1, description="active measuring system: 0 for measuring system 1, 1 for measuring system 2"
    )
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


class MovesSection(Section):
    """Permitted moves of programs that push, prove or roll back a table, and the safe place of every other axis."""

    safe: dict[Name, tuple[Number, Number] | Literal["any"]] = Field(
        default_factory=dict,
        max_length=MOST_AXES,
        description="[low, high] by machine axis, mm or deg, for every axis of the control; needed for --apply. "
        '"any": its place does not matter (a spindle)',
    )
    feed_mm: Number = Field(default=FEED_MM, gt=0, le=10000.0, description="feed of these moves, mm/min")
    feed_deg: Number = Field(default=FEED_DEG, gt=0, le=36000.0, description="feed of these moves, deg/min")

    @property
    def places(self) -> SafePlaces:
        """As the controller is told."""
        ranges = {name: (-inf, inf) if place == "any" else place for name, place in self.safe.items()}
        return SafePlaces(ranges, self.feed_mm, self.feed_deg)


class SiteFile(Section):
    """A whole site file."""

    site: Site = Field(description="whose machine this is")
    controller: ControllerSection = Field(description="how to reach the control")
    instruments: tuple[InstrumentSection, ...] = Field(
        default=(), max_length=MOST_INSTRUMENTS, description="what measures"
    )
    axes: tuple[AxisSection, ...] = Field(min_length=1, max_length=MOST_AXES, description="what is measured")
    operator: OperatorTimes = Field(default=OperatorTimes(), description="how long people are waited for")
    times: DayTimes = Field(default=DayTimes(), description="what a day's work takes, for the forecast of a day")
    moves: MovesSection = Field(default=MovesSection(), description="where axes may stand while tables are pushed")
    setups: tuple[SetupSection, ...] = Field(
        default=(), max_length=MOST_SETUPS, description="errors beyond the positioning of the axes"
    )
    assumed: AssumedSection = Field(default=AssumedSection(), description="errors that nobody measured")
    work: WorkSection | None = Field(default=None, description="the gear that this machine grinds")
    gear: GearSection = Field(default=GearSection(), description="what is asked of that gear")
    guard: GuardSection = Field(default=GuardSection(), description="the drift guard")
    machine: paper.MachineSection = Field(
        default=paper.MachineSection(), description="the machine as its owner names it"
    )
    equipment: tuple[paper.EquipmentSection, ...] = Field(
        default=(), max_length=100, description="register of equipment"
    )
    tolerances: tuple[paper.ToleranceSection, ...] = Field(default=(), max_length=100, description="limits of the axes")
    gear_tolerance: paper.GearToleranceSection | None = Field(default=None, description="limits of the gear's figures")
    test_conditions: tuple[paper.CaptureConditionsSection, ...] = Field(
        default=(), max_length=100, description="how readings of files were taken"
    )
    report: paper.ReportSection = Field(default=paper.ReportSection(), description="the calibration report")
    service: ServiceSection = Field(default=ServiceSection(), description="the service: pages and people")

    def meant(self, said: str) -> AxisSection | None:
        """The axis that a file or a person means, by its name, else by its letter; None where it is none of these."""
        named = (axis for axis in self.axes if axis.name == said)
        return next(named, next((axis for axis in self.axes if axis.letter == said), None))
