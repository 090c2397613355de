"""What a standard says of a capture, and the error motion fitted to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.message import Message
from drivers.units import AxisUnit, DeviationUnit
from gateway.domain.values import FloatArray, component_unit


@dataclass(frozen=True, slots=True)
class Evaluation:
    """ISO 230-2 results of one axis; None where the data do not allow a parameter.

    Arrays have shape (m,) with NaN for what does not exist; scalars in the capture's deviation unit. ``M_travel`` is
    the range to be expected over the whole travel, where M is that of the targets.
    """

    standard: str
    unit: DeviationUnit
    targets: FloatArray
    mean_up: FloatArray
    mean_down: FloatArray
    s_up: FloatArray
    s_down: FloatArray
    B_i: FloatArray
    R_i: FloatArray
    B: float | None
    B_mean: float | None
    M: float | None
    E: float | None
    E_up: float | None
    E_down: float | None
    R: float | None
    R_up: float | None
    R_down: float | None
    A: float | None
    A_up: float | None
    A_down: float | None
    U: Mapping[str, float] = field(default_factory=dict)
    flags: tuple[Message, ...] = ()
    edition: str = ""
    certainty: str = ""
    M_travel: float | None = None


@dataclass(frozen=True, slots=True)
class Component:
    """A fitted error motion, e.g. ECC over C: basis, coefficients and their covariance.

    ``basis`` is "polynomial", "fourier", "bspline", "cubic" (through its nodes), "piecewise", or "waved": a smooth one
    with waves of some lengths; ``domain`` the fitted range (lo, hi) in the axis unit. Values come from
    `gateway.model.components.value` and `standard_uncertainty`.
    """

    name: str
    axis: str
    axis_unit: AxisUnit
    basis: str
    domain: tuple[float, float]
    coefficients: FloatArray
    covariance: FloatArray
    parameters: Mapping[str, object] = field(default_factory=dict)
    residual_rms: float = 0.0

    @property
    def unit(self) -> DeviationUnit:
        """Unit of the values."""
        return component_unit(self.name, self.axis_unit)
