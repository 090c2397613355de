"""What goes into files that other programs and controls read: errors at positions, and what such files leave open."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.types.values import FloatArray
from drivers.units import AxisUnit, DeviationUnit


@dataclass(frozen=True, slots=True)
class ReadAs:
    """What a file of tables may not say itself: its axis, the unit of that axis, which form of its format it has.

    ``declared`` are facts by name that a person adds, e.g. the position of the first value.
    """

    axis: str
    unit: AxisUnit
    form: str = ""
    declared: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ErrorCurve:
    """An error motion by its ISO 230-1 name: ``values`` (m,) in um or arcsec at rising ``positions`` (m,), mm or deg.

    Sign: error = actual - nominal, in the positive sense of the axis that the second letter of ``name`` says.
    """

    name: str
    axis_unit: AxisUnit
    positions: FloatArray
    values: FloatArray

    @property
    def unit(self) -> DeviationUnit:
        """Unit of ``values``: EA., EB. and EC. are angles."""
        return "arcsec" if self.name[1] in "ABC" else "um"

    @property
    def argument(self) -> str:
        """The axis over which it stands, by its letter: X of EYX."""
        return self.name[2]


@dataclass(frozen=True, slots=True)
class ErrorField:
    """An error over other axes than its own, or over several: ``values`` (m,) in um or arcsec at ``points`` (m, k).

    ``arguments`` are the k axes by their letters; points are in mm or deg. Sign as of `ErrorCurve`.
    """

    name: str
    arguments: tuple[str, ...]
    points: FloatArray
    values: FloatArray

    @property
    def unit(self) -> DeviationUnit:
        """Unit of ``values``."""
        return "arcsec" if self.name[1] in "ABC" else "um"


@dataclass(frozen=True, slots=True)
class ErrorSet:
    """Error motions, and location errors by their ISO 230-1 names (B0Z, X0C), um or arcsec; ``notes`` for a reader.

    ``fields`` are errors over several axes, which no error motion is: only a format that has them holds them.
    """

    curves: tuple[ErrorCurve, ...]
    locations: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = field(default=(), compare=False)
    fields: tuple[ErrorField, ...] = ()

    @staticmethod
    def location_unit(name: str) -> DeviationUnit:
        """Unit of a location error: A0., B0. and C0. are angles."""
        return "arcsec" if name[0] in "ABC" else "um"
