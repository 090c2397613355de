"""The 21 errors as rows for people: range over the travel, uncertainty, and whether measured or only assumed."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np

from drivers.message import Message, Quantity, digits
from drivers.units import DeviationUnit
from gateway.domain.figures import Component
from gateway.domain.values import COVERAGE
from gateway.model.components import is_periodic, motion_uncertainty, value
from gateway.model.error_model import TWENTY_ONE, ErrorModel

POINTS = 201
NOBODY = (Message.of("W-ERROR-ASSUMED"),)


@dataclass(frozen=True, slots=True)
class ErrorRow:
    """One error: lowest and highest value, largest expanded uncertainty U (k = 2); for unknown ones +/- the span.

    ``how`` says what it rests on.
    """

    name: str
    unit: DeviationUnit
    low: float
    high: float
    U: float
    state: Literal["measured", "assumed"]
    how: tuple[Message, ...] = ()

    def as_data(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(replace(self, how=())), "how": [one.as_data() for one in self.how]}


def error_rows(model: ErrorModel) -> tuple[ErrorRow, ...]:
    """Rows in the usual order, then whatever else was located (X0C, Y0C)."""
    found = {one.name: _motion(one, model.systematic.get(one.name, 0.0)) for one in model.motions}
    for one in model.locations:
        found[one.name] = ErrorRow(
            name=one.name,
            unit=one.unit,
            low=one.value,
            high=one.value,
            U=COVERAGE * one.u,
            state="measured",
            how=one.how,
        )
    for gap in model.unknown:
        found[gap.name] = ErrorRow(
            name=gap.name, unit=gap.unit, low=-gap.span, high=gap.span, U=COVERAGE * gap.u, state="assumed", how=NOBODY
        )
    order = [*TWENTY_ONE, *(name for name in found if name not in TWENTY_ONE)]
    return tuple(found[name] for name in order if name in found)


def _motion(one: Component, systematic: float) -> ErrorRow:
    low, high = (0.0, 360.0) if is_periodic(one) else one.domain
    at = np.linspace(low, high, POINTS)
    values = value(one, at)
    U = COVERAGE * float(np.hypot(np.max(motion_uncertainty(one, at)), systematic))
    least, most = float(values.min()), float(values.max())
    how = _fitted(one, low, high)
    return ErrorRow(one.name, one.unit, low=least, high=most, U=U, state="measured", how=how)


def _fitted(one: Component, low: float, high: float) -> tuple[Message, ...]:
    ends = {"low": Quantity(low), "high": Quantity(high), "axis_unit": one.axis_unit}
    rest = digits(one.residual_rms)
    return (Message.of("W-ERROR-FITTED", basis=one.basis, rest=rest, unit=one.unit, **ends),)
