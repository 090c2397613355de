"""The sections of a site file: every key with its kind, limits, default and what it means.

First the service, then what is printed on paper (letterhead, equipment, tolerances), then site, devices and axes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import date
from ipaddress import ip_address
from math import inf
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from drivers.errors import words
from drivers.local.scrub import has_user, secrets_in
from drivers.types.moves import FEED_DEG, FEED_MM, SafePlaces
from gateway.axes import AxisRecord
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

# The site file's section about the service: names, certificate, sign-out, index, watched folder.

_HOST = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9.-]{0,251}[A-Za-z0-9])?|\[[0-9A-Fa-f:]+\]")


class MqttSection(Section):
    """Messages for other systems by MQTT; the service publishes only and subscribes to nothing."""

    host: str = Field(min_length=1, max_length=253, description="name or address of the server of messages")
    port: Whole = Field(default=1883, ge=1, le=65535, description="its port; 8883 is usual with TLS")
    user: str = Field(default="", max_length=100, description="name to sign in with")
    password_file: Path | None = Field(default=None, description="file with the password, relative to the site file")
    password_env: str = Field(default="", max_length=100, description="environment variable with the password instead")
    ca: Path | None = Field(
        default=None, description="certificate (PEM) that the server's is signed by, relative to the site file: TLS"
    )
    prefix: str = Field(
        default="trueflank",
        pattern=r"^[A-Za-z0-9_.-]{1,60}(/[A-Za-z0-9_.-]{1,60}){0,5}$",
        description="first of topics",
    )
    queue_mb: Whole = Field(
        default=64, ge=1, le=4096, description="MB of messages that wait on the disk while the server is away"
    )

    @field_validator("host")
    @classmethod
    def _plain_host(cls, host: str) -> str:
        if _HOST.fullmatch(host) is None:
            raise ValueError(words("W-CFG-HOSTNAME", host=host))
        return host

    @model_validator(mode="after")
    def _one_password(self) -> MqttSection:
        if self.password_file is not None and self.password_env:
            raise ValueError(words("W-CFG-PAIR-NOT", one="password_file", other="password_env"))
        return self


class ServiceSection(Section):
    """The service (`trueflank serve`): its addresses, the duration of a sign-in, its watched folder."""

    hosts: tuple[str, ...] = Field(
        default=(), max_length=20, description="host names of the pages, in addition to this computer's own"
    )
    certificate: Path | None = Field(
        default=None, description="TLS certificate (PEM), relative to the site file; needed beyond this computer"
    )
    key: Path | None = Field(default=None, description="its private key (PEM), for its owner alone")
    proxies: tuple[str, ...] = Field(
        default=(), max_length=8, description="addresses of reverse proxies that end TLS and say who asks through them"
    )
    signout_min: Number = Field(default=15.0, ge=1, le=720.0, description="minutes without a request that sign out")
    leaked_passwords: Path | None = Field(
        default=None,
        description="list of leaked passwords that nobody may choose: SHA-1 hashes, sorted or in a folder by prefix",
    )
    index_url_file: Path | None = Field(
        default=None, description="file with the address of a database for many gateways; else one with the runs"
    )
    due_days: Whole = Field(default=365, ge=1, le=3650, description="days after which an axis is to be measured again")
    watch: Path | None = Field(
        default=None, description="folder whose new result files become runs, relative to the site file"
    )

    syslog: str = Field(
        default="",
        max_length=300,
        pattern=r"^$|^(udp|tcp)://[A-Za-z0-9.-]{1,253}(:[0-9]{1,5})?$",
        description="server of logs for sign-ins and audit records (RFC 5424): udp://HOST:514 or tcp://HOST:514",
    )
    mqtt: MqttSection | None = Field(default=None, description="server of messages that other systems listen to")

    @field_validator("hosts")
    @classmethod
    def _plain_names(cls, hosts: tuple[str, ...]) -> tuple[str, ...]:
        for host in hosts:
            if _HOST.fullmatch(host) is None:
                raise ValueError(words("W-CFG-HOSTNAME", host=host))
        return hosts

    @field_validator("proxies")
    @classmethod
    def _addresses(cls, proxies: tuple[str, ...]) -> tuple[str, ...]:
        for proxy in proxies:
            try:
                ip_address(proxy)
            except ValueError as error:
                raise ValueError(words("W-CFG-PROXY-ADDRESS", address=proxy)) from error
        return proxies

    @model_validator(mode="after")
    def _both(self) -> ServiceSection:
        if (self.certificate is None) != (self.key is None):
            raise ValueError(words("W-CFG-PAIR", one="certificate", other="key"))
        return self


# What a site file says for the report: letterhead, parties, the machine, the register of equipment, tolerances.

MOST_LINES = 8
Line = Annotated[str, Field(max_length=120)]
Lines = Annotated[tuple[Line, ...], Field(max_length=MOST_LINES)]
Letters = Annotated[tuple[Annotated[str, Field(pattern=r"^[A-CXYZ]$")], ...], Field(max_length=6)]


class ReportSection(Section):
    """The calibration report: who makes it, for whom, in which language."""

    language: Literal["en", "de", "zh"] = Field(default="en", description="language of the report")
    title: Line = Field(default="", description="what it is called; left out: calibration report")
    accreditation: Line = Field(default="", description="accreditation number; no mark is drawn")
    laboratory: Line = Field(default="", description="who makes the report, on the letterhead")
    address: Lines = Field(default=(), description="its address, a line each")
    country: Annotated[str, Field(pattern=r"^([A-Z]{2})?$")] = Field(
        default="", description="its country by ISO 3166: DE, CN; for the digital certificate"
    )
    logo: Path | None = Field(default=None, description="logo (.svg, .png, .jpg), relative to the site file")
    customer: Line = Field(default="", description="for whom it is made")
    customer_address: Lines = Field(default=(), description="the customer's address, a line each")
    order: Line = Field(default="", description="number of the order")
    place: Line = Field(default="", description="location of the machine")
    operator: Line = Field(default="", description="who measured")
    number_prefix: Annotated[str, Field(max_length=20, pattern=r"^[A-Za-z0-9_.-]*$")] = Field(
        default="", description="prefix of the report's number"
    )
    warm_up: Line = Field(default="", description="how the machine was warmed up before measuring")
    refuse_overdue: Flag = Field(
        default=False, description="a run is refused while a calibration in the register is overdue; else a warning"
    )
    signatures: Lines = Field(default=(), description="who signs; left out: calibrated by, checked by")


class MachineSection(Section):
    """The machine as its owner names it; nothing of it is compared with the control."""

    maker: Line = Field(default="", description="maker of the machine")
    type: Line = Field(default="", description="type")
    number: Line = Field(
        default="", description="machine number; left out: only the control's serial number is printed"
    )
    year: Whole | None = Field(default=None, ge=1900, le=2200, description="year of manufacture")
    work_side: Letters = Field(
        default=(), description="letters of the axes from the bed outward to the work, for the drawings of mountings"
    )
    tool_side: Letters = Field(
        default=(), description="letters of the axes from the bed outward to the tool or wheel, for these drawings"
    )


class EquipmentSection(Section):
    """One entry of the register of equipment: who calibrated it, until when, and the uncertainty stated for it."""

    name: Line = Field(min_length=1, description="what it is: laser head, optics, rotary calibrator, sensor ...")
    instrument: MaybeName = Field(default="", description="the instrument of this site that it belongs to, if any")
    maker: Line = Field(default="", description="maker")
    type: Line = Field(default="", description="type")
    serial: Line = Field(default="", description="serial number")
    certificate: Line = Field(default="", description="number of its calibration certificate")
    laboratory: Line = Field(default="", description="who calibrated it")
    calibrated: date | None = Field(default=None, description="day of calibration, YYYY-MM-DD")
    due: date | None = Field(default=None, description="day on which the next one is due, YYYY-MM-DD")
    um_per_m: Number | None = Field(
        default=None, gt=0, le=100.0, description="stated U (k = 2) of a laser system, um/m; used instead of 0.5"
    )
    arcsec: Number | None = Field(
        default=None, gt=0, le=100.0, description="stated U (k = 2) of a rotary calibrator, arcsec; instead of 1"
    )
    kelvin: Number | None = Field(
        default=None, gt=0, le=10.0, description="stated U (k = 2) of a material sensor, K; instead of a range of 0.2"
    )


class CaptureConditionsSection(Section):
    """How readings of files were taken, of one axis or of all: what a file states itself counts before it."""

    axis: MaybeName = Field(default="", description="machine axis; left out: every axis")
    feed: Number | None = Field(default=None, gt=0, le=1e6, description="feed, mm/min or deg/min")
    overrun: Number | None = Field(default=None, gt=0, le=1000.0, description="overrun before reversing, mm or deg")
    dwell_s: Number | None = Field(default=None, gt=0, le=600.0, description="dwell at each target, s")
    cycle: Literal["", "standard", "pendulum", "pilgrim"] = Field(default="", description="measuring cycle")
    tables: Line = Field(default="", description="compensation tables that acted: none, or their names")
    warm_up: Line = Field(default="", description="warm-up before measuring; left out: that of [report]")
    other_axes: Line = Field(default="", description="positions of the axes that did not move")
    offsets: Line = Field(default="", description="offsets from the measuring line to tool and workpiece reference")
    sensors: Line = Field(default="", description="places of the temperature sensors")
    instrument: Line = Field(default="", description="instrument and its optics")


Limits = Annotated[Mapping[Name, Annotated[Number, Field(gt=0, le=1e6)]], Field(max_length=20)]


class ToleranceSection(Section):
    """Limits of one axis by a standard and edition, in um or arcsec; each is decided with its U by ISO 14253-1."""

    axis: Name = Field(description="machine axis")
    standard: Line = Field(
        default="ISO 230-2:2014", description="standard and edition, as `evaluate --standard` has it"
    )
    limits: Limits = Field(description="limit by the standard's own letter: { A = 8.0, M = 5.0 }, um or arcsec")


class GearToleranceSection(Section):
    """Limits of the gear's figures: those of the reducer or an own tolerance, um, or a class of ISO 1328-1:2013.

    That standard is for involute gears: for a cycloid disc its class is an own tolerance that is named so.
    """

    grade: Whole | None = Field(
        default=None,
        ge=2,
        le=11,
        description="class by the formulae of ISO 1328-1:2013, as a named own tolerance: the standard is for involute "
        "gears; that its classes go from 2 to 11 is remembered, not looked up",
    )
    module_mm: Number | None = Field(default=None, gt=0, le=100.0, description="module for that class, mm")
    diameter_mm: Number | None = Field(default=None, gt=0, le=10000.0, description="reference diameter for it, mm")
    width_mm: Number | None = Field(default=None, gt=0, le=2000.0, description="face width for it, mm")
    limits: Limits = Field(default_factory=dict, description="limit by figure, um: { F_alpha = 6.0, F_p = 20.0 }")


# The sections of a site file: every key with its kind, limits, default and what it means.

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


class _ConnectedSection(Section):
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

    version: Line = Field(default="", description="version of the control's software")
    axes: Line = Field(default="", description="names of all machine axes in the control's own order, blanks between")
    type: Line = Field(default="", description="what the node of the setting type_node says")
    marker: Line = Field(
        default="",
        description="this machine's own number, as typed into r_marker or marker_node",
    )

    @property
    def facts(self) -> dict[str, str]:
        """The facts that are stated, of `drivers.types.identity.FACTS`."""
        return {name: value for name, value in self.model_dump().items() if value}


class ControllerSection(_ConnectedSection):
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


class InstrumentSection(_ConnectedSection):
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
    def _check_order(self) -> AxisSection:
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
    machine: MachineSection = Field(default=MachineSection(), description="the machine as its owner names it")
    equipment: tuple[EquipmentSection, ...] = Field(default=(), max_length=100, description="register of equipment")
    tolerances: tuple[ToleranceSection, ...] = Field(default=(), max_length=100, description="limits of the axes")
    gear_tolerance: GearToleranceSection | None = Field(default=None, description="limits of the gear's figures")
    test_conditions: tuple[CaptureConditionsSection, ...] = Field(
        default=(), max_length=100, description="how readings of files were taken"
    )
    report: ReportSection = Field(default=ReportSection(), description="the calibration report")
    service: ServiceSection = Field(default=ServiceSection(), description="the service: pages and people")

    def meant(self, said: str) -> AxisSection | None:
        """The axis that a file or a person means, by its name, else by its letter; None where it is none of these."""
        named = (axis for axis in self.axes if axis.name == said)
        return next(named, next((axis for axis in self.axes if axis.letter == said), None))
