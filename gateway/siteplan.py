"""What a site file says of measuring: targets, set-ups, what is assumed, the work, the drift guard, people's times."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, Strict, model_validator

from drivers.errors import words
from drivers.local.names import MOST, PATTERN, allowed, is_name

# A visit of all of them would take days; the largest control holds 5000 points of a table.
MOST_TARGETS, MOST_REPETITIONS, MOST_POINTS = 2000, 50, 5000


def _named(text: str) -> str:
    if not is_name(text):
        raise ValueError(allowed())
    return text


_AS_SCHEMA = {"pattern": PATTERN, "maxLength": MOST}
Name = Annotated[str, AfterValidator(_named), Field(json_schema_extra=dict(_AS_SCHEMA))]
"""A name by the one rule (`drivers.local.names`): it may stand in a file's name."""
MaybeName = Annotated[
    str, AfterValidator(lambda text: _named(text) if text else text), Field(json_schema_extra={"maxLength": MOST})
]


Number = Annotated[float, Strict()]
Whole = Annotated[int, Strict()]
Flag = Annotated[bool, Strict()]
"""A text is no number, and true is no 1: a site file says what it means."""
_UNTRUE = BeforeValidator(lambda value: str(value) if isinstance(value, bool) else value)
Offset = Annotated[float, Strict(), Field(ge=-10000.0, le=10000.0)]
Degc = Annotated[float, Strict(), Field(ge=-50.0, le=100.0)]
LONGEST = 250
Accepted = dict[
    Annotated[str, Field(pattern=r"^[A-Z]+(-[A-Z0-9]+)+$", max_length=MOST)], Annotated[str, Field(min_length=1)]
]
"""Doubts that a person answers for: the reason by the code."""
Statements = Annotated[
    tuple[Annotated[str, Field(pattern=r"^[a-z_]+=.+", max_length=LONGEST)], ...], Field(max_length=50)
]
"""What a file states otherwise than the site, and a person accepts: KEY=VALUE."""
Sense = Annotated[Literal[1, -1], _UNTRUE]
People = Annotated[Literal[1, 2] | None, _UNTRUE]


class Section(BaseModel):
    """A part of a site file: nothing unknown, nothing infinite, nothing changed later."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, str_max_length=1000, hide_input_in_errors=True
    )


class WorkingWindow(Section):
    """A working window measured at table step for the tooth, in addition to the full travel."""

    first: Number = Field(description="machine coordinate, mm or deg")
    last: Number = Field(description="machine coordinate, mm or deg")
    step: Number = Field(gt=0, description="spacing of the targets, mm or deg")

    @model_validator(mode="after")
    def _rises(self) -> WorkingWindow:
        if self.last - self.first < self.step:
            raise ValueError(words("W-CFG-LAST-ABOVE"))
        if (self.last - self.first) / self.step >= MOST_TARGETS:
            raise ValueError(words("W-CFG-STEP-MANY", most=MOST_TARGETS))
        return self


class Targets(Section):
    """Target positions in machine coordinates: evenly spaced with seeded random offsets, or given.

    ``count`` "iso230-2" takes as many as the standard asks for over first .. last, with random offsets.
    """

    first: Number = Field(default=0.0, description="first target, machine coordinate, mm or deg")
    last: Number = Field(default=0.0, description="last target, machine coordinate, mm or deg")
    count: Whole | Literal["iso230-2"] = Field(
        default=0, description='number of targets; "iso230-2": as required by the standard'
    )
    window: WorkingWindow | None = Field(default=None, description="a part of the travel visited more densely")
    offset_fraction: Number = Field(
        default=0.0, ge=0.0, le=0.3, description="random offset as a fraction of the interval"
    )
    seed: Whole = Field(default=1, ge=0, lt=1 << 63, description="seed of the random offsets")
    positions: tuple[Number, ...] = Field(
        default=(), max_length=MOST_TARGETS, description="list of targets, instead of first, last and count"
    )

    @model_validator(mode="after")
    def _one_way(self) -> Targets:
        if bool(self.positions) == bool(self.count):
            raise ValueError(words("W-CFG-TARGETS-EITHER"))
        if isinstance(self.count, int) and (not 0 <= self.count <= MOST_TARGETS or self.count == 1):
            raise ValueError(words("W-CFG-COUNT-FEW", most=MOST_TARGETS, found=self.count))
        if self.count == "iso230-2" and self.first == self.last:
            raise ValueError(words("W-CFG-FIRST-LAST"))
        return self


MOTION = r"E[XYZABC][A-Z]"
LOCATIONS: dict[str, tuple[str, ...]] = {
    "B0Z": ("X", "Z"),
    "A0C": ("Z",),
    "B0C": ("Z",),
    "X0C": ("C",),
    "Y0C": ("C",),
}
"""Location errors that can be measured, and the axes that move meanwhile: a square, a test bar, a ball."""


class SetupSection(Section):
    """How one error is measured; a key that is left out is taken from the measure section of the moving axis.

    ``axis`` moves. A square is one set-up on X and one on Z, and "B0Z-R" the same with the square turned over about
    its Z arm; a test bar is one set-up on Z with C parked at 0 and one at 180. ``sense`` -1 where the reading falls
    when the moved part errs in the plus direction of the component: no jog can prove it, but a known
    ``step`` does. ``offset_mm``: the measured
    point less the point the component is meant for, machine directions (on a rotary axis along it only).
    """

    axis: Name = Field(description="axis of the site that moves, by its name")
    component: str = Field(
        pattern=rf"^(?:{MOTION}|[XYZABC]0[A-Z](?:-R)?)$", description="error that is measured, in letters of ISO 230-1"
    )
    instrument: MaybeName = Field(default="", description="one of the instruments; needed where source is live")
    channel: str = Field(
        default="", max_length=MOST, description="channel of the instrument; empty: its only one in um or arcsec"
    )
    source: Literal["live", "file", "none"] = Field(
        default="live", description="live, file, or none: not measured, only assumed"
    )
    path: Path | None = Field(default=None, description="result file, relative to the site file")
    unit: Literal["", "um", "arcsec", "urad", "mrad", "deg"] = Field(
        default="", description="unit of the file's deviations"
    )
    datum: Number | None = Field(default=None, description="machine position of the file's zero")
    file_axis_sense: Sense = Field(default=1, description="direction of the file relative to the axis")
    targets: Targets | None = Field(default=None, description="left out: as for the axis")
    repetitions: Whole | None = Field(default=None, ge=1, le=MOST_REPETITIONS, description="left out: as for the axis")
    settle_s: Number | None = Field(default=None, ge=0, le=600.0, description="left out: as for the axis, s")
    average_s: Number | None = Field(default=None, gt=0, le=600.0, description="left out: as for the axis, s")
    stable: Number | None = Field(
        default=None,
        gt=0,
        le=1000.0,
        description="largest allowed standard deviation while averaging; left out: as for the axis",
    )
    sense: Sense = Field(default=1, description="-1: the reading decreases for a positive error of the moving part")
    offset_mm: tuple[Offset, Offset, Offset] | None = Field(
        default=None, description="measured point minus functional point, in machine directions, mm"
    )
    largest: Number | None = Field(
        default=None, gt=0, description="largest plausible reading; beyond it the optics were touched"
    )
    jog: Number | None = Field(default=None, description="jog of the plausibility check, mm or deg")
    U: Number | None = Field(default=None, ge=0, le=100.0, description="of the instrument (k = 2), um or arcsec")
    step: Number | None = Field(
        default=None,
        gt=0,
        le=200.0,
        description="known step that proves the sense: a shim or table step in the plus direction, um or arcsec",
    )
    own_angle_arcsec: Number | None = Field(default=None, description="angle of the square minus 90 deg, if known")
    park: dict[Name, Number] = Field(
        default_factory=dict, description="positions of the other axes during the measurement"
    )
    mount: MaybeName = Field(
        default="",
        description="one name for set-ups that one mounting reads at once: the channels of one instrument on one axis "
        "(six degrees of freedom, three probes at a ball)",
    )
    material_degc: Degc | None = Field(
        default=None, description="temperature of the material, where the file does not contain it, degC"
    )
    accept_doubts: Accepted = Field(
        default_factory=dict, description="doubts about the readings that a person answers for: code = reason"
    )
    accept: Statements = Field(
        default=(), description='statements of the file that differ and count all the same: "machine=Mill 7"'
    )
    assumed: Number | None = Field(
        default=None, gt=0, description="assumed half-width of an unmeasured error, um or arcsec"
    )

    @model_validator(mode="after")
    def _whole(self) -> SetupSection:
        if self.source == "live" and not self.instrument:
            raise ValueError(words("W-CFG-SETUP-INSTRUMENT"))
        if self.source == "file" and (self.path is None or self.datum is None):
            raise ValueError(words("W-CFG-SETUP-FILE"))
        if self.source == "none" and self.assumed is None:
            raise ValueError(words("W-CFG-SETUP-ASSUMED"))
        return self

    @property
    def name(self) -> str:
        """The error without the mark of a turned artefact."""
        return self.component.removesuffix("-R")

    @property
    def turned(self) -> bool:
        """Whether the artefact is turned over."""
        return self.component.endswith("-R")


class AssumedSection(Section):
    """Half-widths of errors that are neither measured nor given in a set-up."""

    linear_um: Number = Field(default=5.0, gt=0, description="half-width of displacements, um")
    angular_arcsec: Number = Field(default=5.0, gt=0, description="half-width of rotations, arcsec")


PLACE_DESCRIPTION = (
    'where the control holds {} for the builder\'s cycle, which adds it up: an R parameter ("R210") or the node of one '
    "number of the user; empty: a person types it ({})"
)
ENTRY_DESCRIPTION = "where a person enters {} for the builder's own programs; empty: {}"


class WorkSection(Section):
    """The gear this machine grinds: its file, and the height of the middle of its face above the table's zero.

    With it a test part can be ground: by which axes, how (`drivers.workpiece.GrindPlan`), how well a blank is clamped.
    """

    gear: Path = Field(description="gear file, relative to the site file")
    height_mm: Number = Field(description="middle of the face above the table zero, mm")
    infeed: Name = Field(default="X", description="infeed axis by letter or name; positive direction into the cut")
    stroke: Name = Field(default="Z", description="stroke axis, along the face width")
    index: Name = Field(default="C", description="index axis, which turns the work")
    index_sense: Sense = Field(default=-1, description="-1: space k is at -360 k / number of spaces")
    dresser: MaybeName = Field(
        default="Y1", description="machine axis that carries the form dresser: grinding never moves it; empty: none"
    )
    dresser_letter: str = Field(default="Y", pattern=r"^[A-Z]$", description="letter of the dresser axis in programs")
    wheel_place: MaybeName = Field(
        default="",
        description='what places the wheel along its axis: a machine axis ("V1"), which the program positions before '
        'the wheel starts, or the R parameter ("R200") from which the dressing program takes its offset in mm; empty: '
        "nothing does, and a part is ground without a dressing offset",
    )
    wheel_letter: str = Field(default="V", pattern=r"^[A-Z]$", description="letter of the axis wheel_place in programs")
    wheel_travel: tuple[Number, Number] | None = Field(
        default=None, description="[low, high] of that axis, mm; left out: not checked"
    )
    wheel_mm: Number = Field(default=0.0, description="its position at a dressing offset of 0, mm")
    stock_mm: Number = Field(
        default=0.15,
        ge=0,
        le=10.0,
        description="largest stock of a blank on each flank, mm: the approach at positioning_feed ends outside it",
    )
    overrun_mm: Number = Field(default=8.0, ge=0, le=1000.0, description="overrun of Z beyond the face, mm")
    retract_mm: Number = Field(default=10.0, ge=0, le=1000.0, description="retract of X from the centre distance, mm")
    rough_mm: tuple[Number, ...] = Field(
        default=(0.05, 0.02), max_length=20, description="stock left by each roughing stroke, mm"
    )
    spark_out: Whole = Field(default=1, ge=0, le=20, description="additional strokes at full depth (spark-out)")
    infeed_feed: Number = Field(default=100.0, gt=0, le=1e6, description="of the infeed, mm/min")
    stroke_feed: Number = Field(default=3000.0, gt=0, le=1e6, description="of the strokes, mm/min")
    index_feed: Number = Field(default=1800.0, gt=0, le=1e6, description="of indexing, deg/min")
    positioning_feed: Number = Field(
        default=3000.0, gt=0, le=1e6, description="feed with the wheel clear of the work, mm/min"
    )
    air_cut_feed: Number = Field(
        default=200.0,
        gt=0,
        le=500.0,
        description="feed of the infeed from outside the stock to the first stroke, mm/min",
    )
    dwell_s: Number = Field(default=0.3, ge=0, le=600.0, description="dwell after indexing, s")
    wheel_on: str = Field(default="", description="M, S and H words that start wheel and coolant; empty: by hand")
    wheel_off: str = Field(default="", description="words that stop them")
    clamping_um: Number = Field(default=0.3, ge=0, description="clamping repeatability of a blank, um (k = 2)")
    clamping_arcsec: Number = Field(default=2.0, ge=0, description="centring of its flanks, arcsec (k = 2)")
    inspector: MaybeName = Field(default="", description="gear inspection machine among the instruments; empty: files")
    inspection_clamping_um: Number = Field(
        default=0.5, ge=0, description="clamping repeatability of the inspection machine, um (k = 2)"
    )
    inspection_size_um: Number = Field(default=0.0, ge=0, description="uncertainty of its probe size, um (k = 2)")
    drift_um_per_h: Number = Field(default=0.3, ge=0, description="drift of the infeed zero, um per hour")
    drift_arcsec_per_h: Number = Field(default=0.5, ge=0, description="drift of the index axis zero, arcsec per hour")
    x_entry: str = Field(
        default="", description=ENTRY_DESCRIPTION.format("the x zero", "the work offset of the infeed axis")
    )
    c_entry: str = Field(
        default="", description=ENTRY_DESCRIPTION.format("the C zero", "the work offset of the index axis")
    )
    dressing_entry: str = Field(
        default="",
        description=ENTRY_DESCRIPTION.format(
            "the dressing offset", "the offset of the dresser in the dressing program"
        ),
    )
    dresser_file: str = Field(
        default="",
        max_length=400,
        description="file of the dresser's table, relative to the site file: the closing run then corrects the wheel",
    )
    x_place: str = Field(default="", max_length=120, description=PLACE_DESCRIPTION.format("the x zero", "x_entry"))
    dressing_place: str = Field(
        default="", max_length=120, description=PLACE_DESCRIPTION.format("the dressing offset", "dressing_entry")
    )
    swivel_place: str = Field(
        default="", max_length=120, description=PLACE_DESCRIPTION.format("the swivel of the wheel", "swivel_entry")
    )
    swivel_entry: str = Field(
        default="", description=ENTRY_DESCRIPTION.format("the swivel", "the swivel axis of the wheel")
    )
    place_length_unit: Literal["mm", "um"] = Field(default="mm", description="unit of the lengths held in such places")
    place_angle_unit: Literal["deg", "arcsec"] = Field(default="deg", description="unit of the angles held there")
    part_h: Number = Field(default=0.25, gt=0, description="hours per part, including its inspection")


class GuardSection(Section):
    """The drift guard: limits of change, size of the check, and repeatability of the mounting (k = 2)."""

    limit_um: Number = Field(
        default=2.0, gt=0, description="change of a displacement that requires a new measurement, um"
    )
    limit_arcsec: Number = Field(
        default=3.0, gt=0, description="change of a rotation that requires a new measurement, arcsec"
    )
    targets: Whole = Field(default=8, ge=3, le=MOST_TARGETS, description="number of targets of the check")
    repetitions: Whole = Field(default=3, ge=2, le=MOST_REPETITIONS, description="repetitions per target")
    mounting_um: Number = Field(default=0.2, ge=0, description="repeatability of a mounting, um")
    mounting_arcsec: Number = Field(default=0.2, ge=0, description="repeatability of a mounting, arcsec")


class OperatorTimes(Section):
    """How long the run waits for people, in seconds of the gateway's clock."""

    start_timeout_s: Number = Field(
        default=600.0, gt=0, le=604800.0, description="longest wait for the operator's start, s"
    )
    stop_timeout_s: Number = Field(
        default=120.0, gt=0, le=604800.0, description="longest wait for the axis at its next stop, s"
    )


class GoalSection(Section):
    """Goal of tables and set-up values: the flank's RMS, or the drive that the discs make.

    Any goal but "rms", and any limit, needs a [reducer] in the gear file. With "weights" 1 um of flank counts ``rms``
    times, and 1 um at the largest lever of a contact ``transmission`` or ``lost_motion`` times.
    """

    kind: Literal["rms", "transmission", "lost-motion", "weights"] = Field(
        default="rms", description="what counts most; of a drive's goal the flank keeps a tenth"
    )
    rms: Number = Field(default=1.0, gt=0, le=1000.0, description='weight of the flank, with kind = "weights"')
    transmission: Number = Field(default=0.0, ge=0, le=1000.0, description="weight of the transmission error, likewise")
    lost_motion: Number = Field(default=0.0, ge=0, le=1000.0, description="weight of the lost motion, likewise")
    transmission_arcsec: Number | None = Field(
        default=None, gt=0, le=36000.0, description="largest transmission error peak to peak, arcsec"
    )
    lost_motion_arcsec: Number | None = Field(default=None, gt=0, le=36000.0, description="largest lost motion, arcsec")


class GearSection(Section):
    """Requirements for the gear that this machine grinds."""

    goal: GoalSection = Field(default=GoalSection(), description="what tables and set-up values make best")


class DayTimes(Section):
    """Durations of manual work and restarts; used for the forecast only.

    Feeds, dwell, settling and averaging stand with the axes, hours of a test part under `[work]`.
    """

    start_s: Number = Field(default=15.0, ge=0, le=3600.0, description="to read the text and start the program, s")
    mounting_min: Number = Field(
        default=15.0, ge=0, le=1440.0, description="to mount and align the optics of one set-up, min"
    )
    restart_s: Number = Field(
        default=240.0, ge=0, le=7200.0, description="a restart of the control, until every axis is referenced again, s"
    )
    clamping_min: Number = Field(default=3.0, ge=0, le=1440.0, description="to clamp a blank or take it off, min")
    inspection_min: Number = Field(
        default=20.0, ge=0, le=1440.0, description="to bring a part to the gear inspection and inspect it, min"
    )
    warm_up_min: Number = Field(
        default=30.0,
        ge=0,
        le=1440.0,
        description="warm-up before the first reading, min",
    )
