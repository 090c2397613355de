"""Verdicts on a value with its uncertainty (ISO 14253-1, guard band), and the limits of ISO 1328-1 flank classes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import floor, hypot, isfinite, sqrt
from typing import Final, Literal

from drivers.message import Message
from gateway.errors import ModelError

Word = Literal["pass", "fail", "not decidable"]
Interval = tuple[float, float]
RULE: Final = Message.of("W-EVAL-RULE")


@dataclass(frozen=True, slots=True)
class Decision:
    """The verdict on one parameter; ``why`` says what kept it undecided, ``rule`` how it was made."""

    parameter: str
    value: float | None
    U: float | None
    limit: float
    verdict: Word
    why: Message | None = None
    rule: Message = RULE


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
            why=Message.of("S-VERDICT-NO-VALUE", parameter=parameter),
        )
    if U is None or not isfinite(U) or U < 0.0:
        return Decision(
            parameter=parameter,
            value=value,
            U=None,
            limit=limit,
            verdict="not decidable",
            why=Message.of("S-VERDICT-NO-U", parameter=parameter),
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
        why=Message.of("S-VERDICT-WITHIN-U"),
    )


def verdict_word(verdict: Word) -> Message:
    """A verdict as a text names it."""
    codes = {"pass": "S-VERDICT-PASS", "fail": "S-VERDICT-FAIL", "not decidable": "S-VERDICT-OPEN"}
    return Message.of(codes[verdict])


def _sizes(interval: Interval) -> Interval:
    """The smallest and largest |x| of an interval."""
    low, high = interval
    ends = abs(low), abs(high)
    return (0.0 if low <= 0.0 <= high else min(ends)), max(ends)


# ---- ISO 1328-1:2013 flank tolerances, before and after the standard's rounding.

STANDARD: Final = "ISO 1328-1:2013"
GRADES: Final = range(1, 12)
LARGEST_MM: Final = 1e5  # the standard ends at 15 m; what is longer is another unit
FIGURES: Final[Mapping[str, str]] = {
    "f_p": "fp",
    "F_p": "Fp",
    "f_Halpha": "fHa",
    "f_falpha": "ffa",
    "F_alpha": "Fa",
    "f_Hbeta": "fHb",
    "f_fbeta": "ffb",
    "F_beta": "Fb",
    "F_r": "",
}
"""Figures of an inspection by the standard's symbols; it has no class for runout."""


def class_limits(diameter_mm: float, module_mm: float, width_mm: float, grade: int) -> Mapping[str, float]:
    """Limits in um of every figure that has a class, as printed."""
    found = flank_tolerances(diameter_mm, module_mm, width_mm, grade)
    return {name: round_as_printed(found[symbol]) for name, symbol in FIGURES.items() if symbol}


def flank_tolerances(diameter_mm: float, module_mm: float, width_mm: float, grade: int) -> Mapping[str, float]:
    """Tolerances in um of a gear, before rounding; the q of grade A is sqrt(2)^(A - 5).

    Raises ModelError (E-EVAL-NUMBER) for a size that is none, or a grade that the standard does not know.
    """
    for key, value in (("diameter_mm", diameter_mm), ("module_mm", module_mm), ("width_mm", width_mm)):
        if not 0.0 < value < LARGEST_MM:
            raise ModelError(
                "E-EVAL-NUMBER",
                STANDARD,
                key=key,
                value=value,
                must=Message.of("W-EVAL-ABOVE-0-MM", largest_mm=LARGEST_MM),
            )
    if grade not in GRADES:
        raise ModelError("E-EVAL-NUMBER", STANDARD, key="grade", value=grade, must=Message.of("W-EVAL-GRADE"))
    q, d, m, b = sqrt(2.0) ** (grade - 5), diameter_mm, module_mm, width_mm
    profile_slope, profile_form = (0.4 * m + 0.001 * d + 4.0) * q, (0.55 * m + 5.0) * q
    lead_slope = (0.05 * sqrt(d) + 0.35 * sqrt(b) + 4.0) * q
    lead_form = (0.07 * sqrt(d) + 0.45 * sqrt(b) + 4.0) * q
    return {
        "fp": (0.001 * d + 0.4 * m + 5.0) * q,
        "Fp": (0.002 * d + 0.55 * sqrt(d) + 0.7 * m + 12.0) * q,
        "fHa": profile_slope,
        "ffa": profile_form,
        "Fa": hypot(profile_slope, profile_form),
        "fHb": lead_slope,
        "ffb": lead_form,
        "Fb": hypot(lead_slope, lead_form),
    }


def round_as_printed(tolerance_um: float) -> float:
    """As printed: above 10 um whole, 5 to 10 um halves, below tenths."""
    step = 1.0 if tolerance_um > 10.0 else 0.5 if tolerance_um >= 5.0 else 0.1
    return floor(tolerance_um / step + 0.5) * step
