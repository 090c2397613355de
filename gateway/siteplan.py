"""What a site file says of measuring: targets, set-ups of every error, what is assumed, the work, the drift guard."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

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


class Section(BaseModel):
    """A part of a site file: nothing unknown, nothing infinite, nothing changed later."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, str_max_length=1000, hide_input_in_errors=True
    )


class WorkingWindow(Section):
    """A working window visited at table step, for the tooth, beside the full travel."""

    first: float
    last: float
    step: float = Field(gt=0)

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

    first: float = 0.0
    last: float = 0.0
    count: int | Literal["iso230-2"] = 0
    window: WorkingWindow | None = None
    offset_fraction: float = Field(default=0.0, ge=0.0, le=0.3, description="of the interval, random")
    seed: int = Field(default=1, ge=0, lt=1 << 63)
    positions: tuple[float, ...] = Field(default=(), max_length=MOST_TARGETS)

    @model_validator(mode="after")
    def _one_way(self) -> Targets:
        if bool(self.positions) == bool(self.count):
            raise ValueError("give either positions or first, last and count")
        if isinstance(self.count, int) and (not 0 <= self.count <= MOST_TARGETS or self.count == 1):
            raise ValueError(f"count must be 2 or more, {MOST_TARGETS} at most, not {self.count}")
        if self.count == "iso230-2" and self.first == self.last:
            raise ValueError("first and last must differ")
        return self


Sense = Literal[1, -1]
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

    axis: Name
    component: str = Field(pattern=rf"^(?:{MOTION}|[XYZABC]0[A-Z](?:-R)?)$")
    instrument: MaybeName = ""
    channel: str = Field(
        default="", max_length=MOST, description="of the instrument; empty: its only one in um or arcsec"
    )
    source: Literal["live", "file", "none"] = Field(default="live", description="none: not measured, only assumed")
    path: Path | None = None
    unit: Literal["", "um", "arcsec", "urad", "mrad"] = Field(default="", description="of the file's deviations")
    datum: float | None = Field(default=None, description="machine coordinate of the file's zero")
    file_axis_sense: Sense = 1
    targets: Targets | None = None
    repetitions: int | None = Field(default=None, ge=1, le=MOST_REPETITIONS)
    settle_s: float | None = Field(default=None, ge=0)
    average_s: float | None = Field(default=None, gt=0)
    stable: float | None = Field(default=None, gt=0)
    sense: Sense = 1
    offset_mm: tuple[float, float, float] | None = None
    largest: float | None = Field(default=None, gt=0, description="reading beyond which optics were touched")
    jog: float | None = Field(default=None, description="plausibility move, mm or deg")
    U: float | None = Field(default=None, ge=0, description="of the instrument (k = 2), um or arcsec")
    own_angle_arcsec: float | None = Field(default=None, description="what a square has more than 90 deg, if known")
    park: dict[Name, float] = Field(default_factory=dict, description="other axes and where they stand meanwhile")
    assumed: float | None = Field(default=None, gt=0, description="half width it may have unmeasured, um or arcsec")

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

    linear_um: float = Field(default=5.0, gt=0)
    angular_arcsec: float = Field(default=5.0, gt=0)


class WorkSection(Section):
    """The gear this machine grinds: its file, and how high the middle of its face stands over the table's zero.

    With it a test part can be ground: by which axes, how (`drivers.workpiece.GrindPlan`), how well a blank is clamped.
    """

    gear: Path
    height_mm: float = 0.0
    infeed: Name = Field(default="X", description="axis of the site by letter or name; rises into the cut")
    stroke: Name = Field(default="Z", description="axis of the site along the face")
    index: Name = Field(default="C", description="axis of the site that turns the work")
    index_sense: Sense = Field(default=-1, description="-1: space k is at -360 k / number of spaces")
    dresser: MaybeName = Field(default="Y1", description="machine axis of the form dresser; empty: none")
    dresser_letter: str = Field(default="Y", pattern=r"^[A-Z]$")
    dresser_travel: tuple[float, float] | None = None
    overrun_mm: float = Field(default=8.0, description="Z beyond the face")
    retract_mm: float = Field(default=10.0, description="X back from the centre distance")
    rough_mm: tuple[float, ...] = Field(
        default=(0.05, 0.02), max_length=20, description="strokes this far short of full depth"
    )
    spark_out: int = Field(default=1, ge=0, le=20, description="strokes at full depth after the first")
    infeed_feed: float = Field(default=100.0, description="mm/min")
    stroke_feed: float = Field(default=3000.0, description="mm/min")
    index_feed: float = Field(default=1800.0, description="deg/min")
    positioning_feed: float = Field(default=3000.0, description="mm/min, wheel clear")
    dwell_s: float = Field(default=0.3, description="after indexing")
    wheel_on: str = Field(default="", description="M, S, H words that start wheel and coolant; empty: by hand")
    wheel_off: str = Field(default="", description="those that stop them")
    clamping_um: float = Field(default=0.3, ge=0, description="how well a blank sits on its datum (k = 2)")
    clamping_arcsec: float = Field(default=2.0, ge=0, description="how well its flanks are centred (k = 2)")
    inspector: MaybeName = Field(default="", description="gear inspection machine among the instruments; empty: files")
    inspection_clamping_um: float = Field(default=0.5, ge=0, description="how well that clamps a part (k = 2)")
    inspection_size_um: float = Field(default=0.0, ge=0, description="how well its probe's size is known (k = 2)")
    drift_um_per_h: float = Field(default=0.3, ge=0, description="how fast the infeed's zero wanders")
    drift_arcsec_per_h: float = Field(default=0.5, ge=0, description="how fast the index axis' zero wanders")
    part_h: float = Field(default=0.25, gt=0, description="hours that a part takes, its inspection included")


class GuardSection(Section):
    """The drift guard: what may have changed, how much it looks, how well a new mounting repeats an old one (k = 2)."""

    limit_um: float = Field(default=2.0, gt=0)
    limit_arcsec: float = Field(default=3.0, gt=0)
    targets: int = Field(default=8, ge=3, le=MOST_TARGETS)
    repetitions: int = Field(default=3, ge=2, le=MOST_REPETITIONS)
    mounting_um: float = Field(default=0.2, ge=0)
    mounting_arcsec: float = Field(default=0.2, ge=0)


def belongs(setup: SetupSection, letter: str, kind: Literal["linear", "rotary"], where: str) -> None:
    """A component is measured along its own axis, a location error along one that can show it; else ValueError."""
    if setup.name[1] == "0":
        if letter not in LOCATIONS.get(setup.name, ()):
            known = ", ".join(f"{name} on {' and '.join(on)}" for name, on in LOCATIONS.items())
            raise ValueError(f"{where}: location errors are measured as {known}")
    elif setup.name[2] != letter:
        raise ValueError(f"{where}: this error motion is one of axis {setup.name[2]}, not {letter}")
    if kind == "rotary" and setup.offset_mm is not None and any(setup.offset_mm[:2]):
        raise ValueError(f"{where}: on a rotary axis offset_mm may only lie along the axis")
