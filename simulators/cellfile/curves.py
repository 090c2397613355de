"""The kinds of curve a cell file can ask for, and the tables that are such curves, validated."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from drivers.local.names import allowed, is_name


def _named(text: str) -> str:
    if not is_name(text):
        raise ValueError(allowed())
    return text


Name = Annotated[str, AfterValidator(_named)]
"""A name by the one rule (`drivers.local.names`): it may stand in a file's name."""


class CellSection(BaseModel):
    """A part of a cell file: nothing unknown, nothing changed later."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, str_max_length=1000, hide_input_in_errors=True
    )


class Constant(CellSection):
    """The same everywhere, in um or arcsec."""

    kind: Literal["constant"]
    value: float


class PolynomialTerm(CellSection):
    """Sum of coefficients[k] * ((q - center) / scale)^k; coefficients in um or arcsec."""

    kind: Literal["polynomial"]
    coefficients: tuple[float, ...] = Field(min_length=1, max_length=100)
    center: float = 0.0
    scale: float = Field(default=100.0, gt=0)


class Harmonic(CellSection):
    """amplitude * cos(order * q + phase) on a turn, or cos(2 pi q / period + phase) on a line."""

    kind: Literal["harmonic"]
    amplitude: float
    phase_deg: float = 0.0
    order: int | None = Field(default=None, ge=1)
    period: float | None = Field(default=None, gt=0)

    @model_validator(mode="after")
    def _one_way(self) -> Harmonic:
        if (self.order is None) == (self.period is None):
            raise ValueError("give either order (rotary) or period (mm or deg)")
        return self


class TableTerm(CellSection):
    """Straight lines between points; the end values hold outside."""

    kind: Literal["table"]
    positions: tuple[float, ...] = Field(min_length=2, max_length=10_000)
    values: tuple[float, ...]

    @model_validator(mode="after")
    def _matching(self) -> TableTerm:
        rising = all(low < high for low, high in zip(self.positions, self.positions[1:], strict=False))
        if len(self.values) != len(self.positions) or not rising:
            raise ValueError("positions must rise and have one value each")
        return self


class Step(CellSection):
    """A jump of this height at a position: nothing below, all of it from there on."""

    kind: Literal["step"]
    at: float
    height: float


class Screw(CellSection):
    """What a ball screw repeats with its pitch (mm): ``amplitudes`` of one, two, ... waves a turn of the screw.

    ``phase_deg`` is the screw's own angle where the axis stands at 0: sum of a_k cos(k (360 q / pitch + phase)).
    """

    kind: Literal["screw"]
    pitch: float = Field(gt=0)
    amplitudes: tuple[float, ...] = Field(min_length=1, max_length=20)
    phase_deg: float = 0.0


class Worm(CellSection):
    """What a worm drive repeats with each turn of its worm: ``teeth`` of the wheel, ``starts`` of the worm.

    The worm turns teeth / starts times a turn of the table; ``amplitudes`` and ``phase_deg`` as of a screw.
    """

    kind: Literal["worm"]
    teeth: int = Field(gt=0)
    starts: int = Field(default=1, gt=0)
    amplitudes: tuple[float, ...] = Field(min_length=1, max_length=20)
    phase_deg: float = 0.0

    @model_validator(mode="after")
    def _closing(self) -> Worm:
        if self.teeth % self.starts:
            raise ValueError("teeth must be a multiple of starts, so that the error closes after a turn of the table")
        return self


class Wear(CellSection):
    """A guide worn at one place: a smooth hollow ``depth`` deep at its middle ``at`` and ``length`` long (mm).

    -depth (1 + cos(2 pi (q - at) / length)) / 2 within it, nothing outside.
    """

    kind: Literal["wear"]
    at: float
    length: float = Field(gt=0)
    depth: float


class SeededCurve(CellSection):
    """A random smooth curve of this greatest size; ``waves`` is how many go into the travel or turn."""

    kind: Literal["seed"]
    size: float = Field(ge=0)
    waves: float = Field(default=3.0, gt=0)


Term = Annotated[
    Constant | PolynomialTerm | Harmonic | TableTerm | Step | Screw | Worm | Wear | SeededCurve,
    Field(discriminator="kind"),
]
Terms = tuple[Term, ...]


class DriftSection(CellSection):
    """How a zero or a location moves, in um or arcsec: by the hour, by temperature, while it warms up, and in waves.

    per_h h + per_k (material - 20 degC) + warm_up (1 - exp(-h / warm_up_h)) + wave sin(2 pi h / wave_h), h the hours
    of the cell's clock; ``per_h`` turns back after half a day, as every steady drift of a cell does.
    """

    per_h: float = 0.0
    per_k: float = 0.0
    warm_up: float = 0.0
    warm_up_h: float = Field(default=1.0, gt=0)
    wave: float = 0.0
    wave_h: float = Field(default=1.0, gt=0)


PointNumber = Annotated[int, Field(ge=0, le=4999)]


class LoadedTable(CellSection):
    """A table: its grid in mm or deg, and the curve of its stored values in um or arcsec, in the control's own sign.

    The step need not divide the range: the points are those up to k = floor((maximum - minimum) / step). ``gaps`` are
    points that nobody ever wrote.
    """

    minimum: float
    maximum: float
    step: float = Field(gt=0)
    values: Terms
    gaps: tuple[PointNumber, ...] = ()
    enabled: bool = True

    @model_validator(mode="after")
    def _points(self) -> LoadedTable:
        if not 1 <= (self.maximum - self.minimum) / self.step < 5000:
            raise ValueError("a table has 2 to 5000 points")
        return self


class LoadedAxisTable(LoadedTable):
    """EEC of the measuring system that acts on its axis."""

    modulo: bool = False


class LoadedCrossTable(LoadedTable):
    """CEC, by the number it stands at; axes by their machine names."""

    input: str
    output: str
    direction: Literal[-1, 0, 1] = 0
