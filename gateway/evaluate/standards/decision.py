"""Pass, fail or not decidable: a value with its uncertainty against a limit (ISO 14253-1, guard band)."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Final, Literal

from drivers.errors import words
from gateway.errors import ModelError

Word = Literal["pass", "fail", "not decidable"]
Interval = tuple[float, float]
RULE: Final = words("W-EVAL-RULE")


@dataclass(frozen=True, slots=True)
class Decision:
    """The verdict on one parameter; ``why`` says what kept it undecided, ``rule`` how it was made."""

    parameter: str
    value: float | None
    U: float | None
    limit: float
    verdict: Word
    why: str = ""
    rule: str = RULE


def decide(
    parameter: str, value: float | None, U: float | None, limit: float, trials: Interval | None = None
) -> Decision:
    """Judge a parameter; all in its unit, signed parameters by their size. The rule is `RULE`.

    ``trials`` is a coverage interval where there is one. A value or U that does not exist is never taken as 0:
    not decidable. Raises ModelError (E-EVAL-LIMIT) for a limit that is not positive and finite.
    """
    if not (isfinite(limit) and limit > 0.0):
        raise ModelError("E-EVAL-LIMIT", "limit", parameter=parameter, limit=limit)
    if value is None or not isfinite(value):
        return Decision(
            parameter=parameter,
            value=None,
            U=U,
            limit=limit,
            verdict="not decidable",
            why=f"{parameter} does not exist for these readings",
        )
    if U is None or not isfinite(U) or U < 0.0:
        return Decision(
            parameter=parameter,
            value=value,
            U=None,
            limit=limit,
            verdict="not decidable",
            why=f"U of {parameter} is not known",
        )
    low, high = _sizes((value - U, value + U) if trials is None else trials)
    if max(abs(value) + U, high) <= limit:
        return Decision(parameter=parameter, value=value, U=U, limit=limit, verdict="pass")
    if min(abs(value) - U, low) > limit:
        return Decision(parameter=parameter, value=value, U=U, limit=limit, verdict="fail")
    return Decision(
        parameter=parameter,
        value=value,
        U=U,
        limit=limit,
        verdict="not decidable",
        why="the limit lies within the uncertainty of the value",
    )


def _sizes(interval: Interval) -> Interval:
    """The smallest and largest |x| of an interval."""
    low, high = interval
    ends = abs(low), abs(high)
    return (0.0 if low <= 0.0 <= high else min(ends)), max(ends)
