"""The cylinder error calculation of CEC tables of TYPE 1: two measured errors -> SD41320 and SD41321.

The setting data and what happens to them are in the vendor's lists; the formula is not. Here: the straight
line through the two measured errors, read at the table's first and second point.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Measured:
    """Distances in the base axis (CEC_BAS_0/1) and the errors found there (CEC_COMP_0/1)."""

    base_0: float
    base_1: float
    error_0: float
    error_1: float


def end_values(measured: Measured, minimum: float, step: float) -> tuple[float, float]:
    """What SD41320 and SD41321 become; one distance for both points gives their mean error."""
    span = measured.base_1 - measured.base_0
    if span == 0.0:
        mean = (measured.error_0 + measured.error_1) / 2.0
        return mean, mean
    slope = (measured.error_1 - measured.error_0) / span
    first = measured.error_0 + slope * (minimum - measured.base_0)
    return first, first + slope * step
