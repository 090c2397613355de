"""What one set-up measured of one error, and the means of it that a fit is given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from drivers.units import AxisUnit, DeviationUnit
from gateway.domain.figures import Component
from gateway.domain.values import FloatArray, component_unit
from gateway.errors import ModelError
from gateway.evaluate.behaviour.repetitions import robust_means
from gateway.model.means import fit_means

# An artefact may stand 1 mm off its axis and lean by a quarter of a degree; what is larger is another unit.
LARGEST: Mapping[DeviationUnit, float] = {"um": 1000.0, "arcsec": 1000.0}


@dataclass(frozen=True, slots=True)
class Measurement:
    """One set-up's deviations (m, n, 2) at targets (m,) in um or arcsec, and how it was mounted.

    ``component`` may end in -R (artefact turned over). ``systematic`` is the standard uncertainty that repetition
    does not show. ``turned_deg`` is where the rotary axis was parked, for a bar; ``stands`` where every axis stood when
    the set-up began, by letter.
    """

    component: str
    letter: str
    axis_unit: AxisUnit
    targets: FloatArray
    deviations: FloatArray
    reference: float = 0.0
    modulo: bool = False
    offset_mm: tuple[float, float, float] | None = None
    systematic: float = 0.0
    own_angle_arcsec: float | None = None
    turned_deg: float | None = None
    stands: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The error without the mark of a turned artefact."""
        return self.component.removesuffix("-R")

    @property
    def kind(self) -> Literal["linear", "rotary"]:
        """Of the axis that moved."""
        return "linear" if self.axis_unit == "mm" else "rotary"

    @property
    def is_motion(self) -> bool:
        """An error motion, no location error."""
        return self.name[1] != "0"


@dataclass(frozen=True, slots=True)
class Means:
    """Means (m,) of a measurement with their standard uncertainties."""

    of: Measurement
    mean: FloatArray
    u: FloatArray

    def less(self, what: FloatArray) -> Means:
        """The same with something (m,) taken off."""
        return replace(self, mean=self.mean - what)

    def fitted(self) -> Component:
        """The curve through the means, by the one rule (`fit_means`)."""
        one = self.of
        return fit_means(
            one.targets,
            self.mean,
            self.u,
            name=one.name,
            axis=one.letter,
            axis_unit=one.axis_unit,
            kind=one.kind,
            modulo=one.modulo,
        )


def _largest(one: Measurement) -> float:
    """The largest deviation; from the line that leaning optics show, where only what is left of it is the axis' own."""
    known = np.isfinite(one.deviations)
    values, at = one.deviations[known], np.broadcast_to(one.targets[:, None, None], known.shape)[known]
    across = one.kind == "linear" and component_unit(one.name, "mm") == "um" and one.name[1] != one.name[2]
    if across and np.ptp(at) > 0.0:
        values = values - np.polyval(np.polyfit(at, values, 1), at)
    return float(np.max(np.abs(values), initial=0.0))


def means_of(one: Measurement) -> Means:
    """Means of a measurement's readings, robust against drift of passes and readings out of line.

    Raises ModelError (E-EVAL-SIZE) for deviations that no machine tool has: another unit.
    """
    unit = component_unit(one.name, one.axis_unit)
    largest = _largest(one)
    if largest > LARGEST[unit]:
        fields: dict[str, Any] = {"largest": f"{largest:.3g}", "limit": f"{LARGEST[unit]:g}", "unit": unit}
        raise ModelError("E-EVAL-SIZE", one.letter, component=one.component, **fields)
    found = robust_means(one.targets, one.deviations)
    # One repetition one way tells nothing of its scatter: the instrument's own uncertainty stands for it.
    u = np.where(np.isfinite(found.u) & (found.u > 0.0), found.u, max(one.systematic, 1e-3))
    return Means(one, found.mean, np.asarray(u))
