"""What no table cures: the share of A that reversal and scatter make; pure."""

from __future__ import annotations

import numpy as np

from drivers.errors import words
from gateway.domain import Evaluation
from gateway.evaluate.standards.iso230_2 import coverage
from gateway.evaluate.standards.parameters import of_table

MOST = 0.5


def incurable(evaluation: Evaluation) -> tuple[float, float] | None:
    """(A that would be left with the mean of both directions zero everywhere, its share of A); None without A."""
    if not evaluation.A:
        return None
    mean = np.stack([evaluation.mean_up, evaluation.mean_down], axis=-1)
    s = np.stack([evaluation.s_up, evaluation.s_down], axis=-1)
    centred = mean - mean.mean(axis=-1, keepdims=True)
    left = float(of_table(centred, s, coverage(evaluation.edition))["A"])
    return left, min(left / evaluation.A, 1.0)


def told_incurable(evaluation: Evaluation) -> tuple[str, ...]:
    """Words where reversal and scatter make more than half of A."""
    found = incurable(evaluation)
    if found is None or found[1] <= MOST:
        return ()
    left, share = found
    fields = {"A": f"{evaluation.A:.3g}", "left": f"{left:.3g}", "percent": f"{100.0 * share:.0f}"}
    return (words("W-INCURABLE", **fields, unit=evaluation.unit),)
