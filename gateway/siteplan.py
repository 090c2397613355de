"""What a site file says of measuring: targets, set-ups of every error, what is assumed, the work, the drift guard."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Strict, model_validator

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
Sense = Literal[1, -1]


class Section(BaseModel):
    """A part of a site file: nothing unknown, nothing infinite, nothing changed later."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, str_max_length=1000, hide_input_in_errors=True
    )


class WorkingWindow(Section):
    """A working window visited at table step, for the tooth, beside the full travel."""

    first: Number = Field(description="machine coordinate, mm or deg")
    last: Number = Field(description="machine coordinate, mm or deg")
    step: Number = Field(gt=0, description="distance of the targets, mm or deg")

    @model_validator(mode="after")
    def _rises(self) -> WorkingWindow:
        if self.last - self.first < self.step:
            raise ValueError("last must lie a step or more above first")
        if (self.last - self.first) / self.step >= MOST_TARGETS:
            raise ValueError(f"step gives more than {MOST_TARGETS} targets, the most there may be")
        return self


class Targets(Section):
    """Target positions in machine coordinates: evenly spaced with seeded random offsets, or given.

    ``count`` "iso230-2" takes as many as the standard asks for over first .. last, with random offsets.
    """

    first: Number = Field(default=0.0, description="first target, machine coordinate, mm or deg")
    last: Number = Field(default=0.0, description="last target, machine coordinate, mm or deg")
    count: Whole | Literal["iso230-2"] = Field(
        default=0, description='how many; "iso230-2": as many as the standard asks for'
    )
    window: WorkingWindow | None = Field(default=None, description="a part of the travel visited more densely")
    offset_fraction: Number = Field(default=0.0, ge=0.0, le=0.3, description="of the interval, random")
    seed: Whole = Field(default=1, ge=0, lt=1 << 63, description="of the random offsets")
    positions: tuple[Number, ...] = Field(
        default=(), max_length=MOST_TARGETS, description="targets one by one, in place of first, last and count"
    )

    @model_validator(mode="after")
    def _one_way(self) -> Targets:
        if bool(self.positions) == bool(self.count):
            raise ValueError("give either positions or first, last and count")
        if isinstance(self.count, int) and (not 0 <= self.count <= MOST_TARGETS or self.count == 1):
            raise ValueError(f"count must be 2 or more, {MOST_TARGETS} at most, not {self.count}")
        if self.count == "iso230-2" and self.first == self.last:
            raise ValueError("first and last must differ")
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
    """How one error is measured; what is not said is as in the measure section of the axis that moves.

    ``axis`` moves. A square is one set-up on X and one on Z, and "B0Z-R" the same with the square turned over about
    its Z arm; a test bar is one set-up on Z with C parked at 0 and one at 180. ``sense`` -1 where the reading falls
    when the moved part errs in the plus direction of the component: no jog can prove it. ``offset_mm``: the measured
    point less the point the component is meant for, machine directions (on a rotary axis along it only).
    """

    axis: Name = Field(description="axis of the site that moves, by its name")
    component: str = Field(
        pattern=rf"^(?:{MOTION}|[XYZABC]0[A-Z](?:-R)?)$", description="error that is measured, in letters of ISO 230-1"
    )
    instrument: MaybeName = Field(default="", description="one of the instruments; needed where source is live")
    channel: str = Field(
        default="", max_length=MOST, description="of the instrument; empty: its only one in um or arcsec"
    )
    source: Literal["live", "file", "none"] = Field(default="live", description="none: not measured, only assumed")
    path: Path | None = Field(default=None, description="result file, relative to the site file")
    unit: Literal["", "um", "arcsec", "urad", "mrad"] = Field(default="", description="of the file's deviations")
    datum: Number | None = Field(default=None, description="machine coordinate of the file's zero")
    file_axis_sense: Sense = Field(default=1, description="file direction against the axis")
    targets: Targets | None = Field(default=None, description="left out: as the axis has them")
    repetitions: Whole | None = Field(
        default=None, ge=1, le=MOST_REPETITIONS, description="left out: as the axis has them"
    )
    settle_s: Number | None = Field(default=None, ge=0, le=600.0, description="left out: as the axis has it, s")
    average_s: Number | None = Field(default=None, gt=0, le=600.0, description="left out: as the axis has it, s")
    stable: Number | None = Field(
        default=None, gt=0, le=1000.0, description="largest allowed sigma in the window; left out: as the axis has it"
    )
    sense: Sense = Field(default=1, description="-1: the reading falls when the moved part errs in plus direction")
    offset_mm: tuple[Number, Number, Number] | None = Field(
        default=None, description="measured point less the point the component is meant for, machine directions"
    )
    largest: Number | None = Field(default=None, gt=0, description="reading beyond which optics were touched")
    jog: Number | None = Field(default=None, description="plausibility move, mm or deg")
    U: Number | None = Field(default=None, ge=0, description="of the instrument (k = 2), um or arcsec")
    own_angle_arcsec: Number | None = Field(default=None, description="what a square has more than 90 deg, if known")
    park: dict[Name, Number] = Field(default_factory=dict, description="other axes and where they stand meanwhile")
    assumed: Number | None = Field(default=None, gt=0, description="half width it may have unmeasured, um or arcsec")

    @model_validator(mode="after")
    def _whole(self) -> SetupSection:
        if self.source == "live" and not self.instrument:
            raise ValueError(f"{self.component}: a live set-up needs an instrument")
        if self.source == "file" and (self.path is None or self.datum is None):
            raise ValueError(f"{self.component}: a file needs path and datum, the machine coordinate of its zero")
        if self.source == "none" and self.assumed is None:
            raise ValueError(f"{self.component}: what is not measured needs assumed, the half width it may have")
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
    """Half widths of errors that nobody measured and no set-up says otherwise of."""

    linear_um: Number = Field(default=5.0, gt=0, description="of shifts, um")
    angular_arcsec: Number = Field(default=5.0, gt=0, description="of turns, arcsec")


class WorkSection(Section):
    """The gear this machine grinds: its file, and how high the middle of its face stands over the table's zero.

    With it a test part can be ground: by which axes, how (`drivers.workpiece.GrindPlan`), how well a blank is clamped.
    """

    gear: Path = Field(description="gear file, relative to the site file")
    height_mm: Number = Field(default=0.0, description="middle of the face over the table's zero, mm")
    infeed: Name = Field(default="X", description="axis of the site by letter or name; rises into the cut")
    stroke: Name = Field(default="Z", description="axis of the site along the face")
    index: Name = Field(default="C", description="axis of the site that turns the work")
    index_sense: Sense = Field(default=-1, description="-1: space k is at -360 k / number of spaces")
    dresser: MaybeName = Field(default="Y1", description="machine axis of the form dresser; empty: none")
    dresser_letter: str = Field(default="Y", pattern=r"^[A-Z]$", description="of the dresser's axis in programs")
    dresser_travel: tuple[Number, Number] | None = Field(
        default=None, description="[low, high] of that axis, mm; left out: not judged"
    )
    overrun_mm: Number = Field(default=8.0, ge=0, le=1000.0, description="Z beyond the face")
    retract_mm: Number = Field(default=10.0, ge=0, le=1000.0, description="X back from the centre distance")
    rough_mm: tuple[Number, ...] = Field(
        default=(0.05, 0.02), max_length=20, description="strokes this far short of full depth"
    )
    spark_out: Whole = Field(default=1, ge=0, le=20, description="strokes at full depth after the first")
    infeed_feed: Number = Field(default=100.0, gt=0, le=1e6, description="of the infeed, mm/min")
    stroke_feed: Number = Field(default=3000.0, gt=0, le=1e6, description="of the strokes, mm/min")
    index_feed: Number = Field(default=1800.0, gt=0, le=1e6, description="of indexing, deg/min")
    positioning_feed: Number = Field(default=3000.0, gt=0, le=1e6, description="mm/min, wheel clear")
    dwell_s: Number = Field(default=0.3, ge=0, le=600.0, description="after indexing")
    wheel_on: str = Field(default="", description="M, S, H words that start wheel and coolant; empty: by hand")
    wheel_off: str = Field(default="", description="those that stop them")
    clamping_um: Number = Field(default=0.3, ge=0, description="how well a blank sits on its datum (k = 2)")
    clamping_arcsec: Number = Field(default=2.0, ge=0, description="how well its flanks are centred (k = 2)")
    inspector: MaybeName = Field(default="", description="gear inspection machine among the instruments; empty: files")
    inspection_clamping_um: Number = Field(default=0.5, ge=0, description="how well that clamps a part (k = 2)")
    inspection_size_um: Number = Field(default=0.0, ge=0, description="how well its probe's size is known (k = 2)")
    drift_um_per_h: Number = Field(default=0.3, ge=0, description="how fast the infeed's zero wanders")
    drift_arcsec_per_h: Number = Field(default=0.5, ge=0, description="how fast the index axis' zero wanders")
    part_h: Number = Field(default=0.25, gt=0, description="hours that a part takes, its inspection included")


class GuardSection(Section):
    """The drift guard: what may have changed, how much it looks, how well a new mounting repeats an old one (k = 2)."""

    limit_um: Number = Field(default=2.0, gt=0, description="change of a shift that asks for measuring again, um")
    limit_arcsec: Number = Field(
        default=3.0, gt=0, description="change of a turn that asks for measuring again, arcsec"
    )
    targets: Whole = Field(default=8, ge=3, le=MOST_TARGETS, description="places it looks at")
    repetitions: Whole = Field(default=3, ge=2, le=MOST_REPETITIONS, description="times it looks at each")
    mounting_um: Number = Field(default=0.2, ge=0, description="how well a mounting repeats, um")
    mounting_arcsec: Number = Field(default=0.2, ge=0, description="how well a mounting repeats, arcsec")
