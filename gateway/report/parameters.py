"""The five ISO 230-2 figures of an axis, and M over the whole travel, as rows: before, after, U and change."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, isfinite
from typing import Literal

from drivers.units import DeviationUnit
from gateway.domain.figures import Evaluation

Parameter = Literal["E", "R", "B", "A", "M", "M_travel"]
PARAMETERS: tuple[Parameter, ...] = ("E", "R", "B", "A", "M", "M_travel")


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """One line of the table; None where the data do not allow a figure.

    ``before_u`` and ``after_u`` are expanded uncertainties (k = 2) in ``unit``; ``change_pct`` is
    (after - before) / before; ``significant`` says whether the change is larger than the uncertainty of
    the difference, sqrt(before_u^2 + after_u^2), and is None without both.
    """

    axis: str
    parameter: Parameter
    unit: DeviationUnit
    before: float | None
    after: float | None
    before_u: float | None
    after_u: float | None
    change_pct: float | None
    significant: bool | None


def parameter_rows(axis: str, before: Evaluation | None, after: Evaluation | None) -> tuple[ParameterRow, ...]:
    """Rows E, R, B, A, M, M_travel of one axis; no rows when there is neither evaluation."""
    known = before or after
    if known is None:
        return ()
    return tuple(_row(axis, name, known.unit, before, after) for name in PARAMETERS)


def _row(
    axis: str, name: Parameter, unit: DeviationUnit, before: Evaluation | None, after: Evaluation | None
) -> ParameterRow:
    old, new = _value(before, name), _value(after, name)
    old_u, new_u = _uncertainty(before, name), _uncertainty(after, name)
    return ParameterRow(
        axis=axis,
        parameter=name,
        unit=unit,
        before=old,
        after=new,
        before_u=old_u,
        after_u=new_u,
        change_pct=_change(old, new),
        significant=_tells(old, new, old_u, new_u),
    )


def _value(evaluation: Evaluation | None, name: Parameter) -> float | None:
    return None if evaluation is None else _finite(getattr(evaluation, name))


def _uncertainty(evaluation: Evaluation | None, name: Parameter) -> float | None:
    return None if evaluation is None else _finite(evaluation.U.get(name))


def _finite(value: float | None) -> float | None:
    return None if value is None or not isfinite(value) else float(value)


def _change(before: float | None, after: float | None) -> float | None:
    if before is None or after is None or before == 0.0:
        return None
    return _finite(100.0 * (after - before) / before)


def _tells(before: float | None, after: float | None, before_u: float | None, after_u: float | None) -> bool | None:
    if before is None or after is None or before_u is None or after_u is None:
        return None
    return abs(after - before) > hypot(before_u, after_u)
