"""What stands in the control before anybody comes: the tables that the machine's builder loaded and switched on."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from simulators.cellfile.terms import CellSection, Terms

Number = Annotated[int, Field(ge=0, le=4999)]


class Loaded(CellSection):
    """A table: its grid in mm or deg, and the curve of its stored values in um or arcsec, in the control's own sign.

    The step need not divide the range: the points are those up to k = floor((maximum - minimum) / step). ``gaps`` are
    points that nobody ever wrote.
    """

    minimum: float
    maximum: float
    step: float = Field(gt=0)
    values: Terms
    gaps: tuple[Number, ...] = ()
    enabled: bool = True

    @model_validator(mode="after")
    def _points(self) -> Loaded:
        if not 1 <= (self.maximum - self.minimum) / self.step < 5000:
            raise ValueError("a table has 2 to 5000 points")
        return self


class LoadedAxis(Loaded):
    """EEC of the measuring system that acts on its axis."""

    modulo: bool = False


class LoadedCross(Loaded):
    """CEC, by the number it stands at; axes by their machine names."""

    input: str
    output: str
    direction: Literal[-1, 0, 1] = 0
