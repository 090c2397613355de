"""What to measure next: the error whose better knowledge would change the proposed correction most; pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gateway.errors import ModelError

RANK = 1e-10


@dataclass(frozen=True, slots=True)
class Next:
    """One error's doubt: what it moves the proposal by on the flank, what no proposal can follow (both RMS, in the
    unit of the columns), and its share of all that the proposal may be wrong by."""

    name: str
    change: float
    beyond: float
    share: float


def measure_next(names: Sequence[str], doubts: ArrayLike, cures: ArrayLike, points: int) -> tuple[Next, ...]:
    """Errors by what their doubt changes in the proposal, the most important first.

    ``doubts`` (R, d): the flank of one standard uncertainty, named by the error it belongs to (several independent
    columns of one error count together); ``cures`` (R, m): the flank of one unit of
    each value that may be set; both in coordinates whose sum of squares is ``points`` times the mean square. A least-
    squares proposal follows the part of a doubt that the cures span: so much it would change if the error were known.
    """
    W, A = np.asarray(doubts, dtype=np.float64), np.asarray(cures, dtype=np.float64)
    if W.ndim != 2 or A.ndim != 2 or W.shape != (A.shape[0], len(names)):
        raise ModelError("E-SENS-SHAPE", "what next", points=W.shape, outputs=A.shape)
    size = np.linalg.norm(A, axis=0)
    used = A[:, size > 0.0] / size[size > 0.0]
    u, s, _ = np.linalg.svd(used, full_matrices=False)
    followed = u[:, s > RANK * np.max(s, initial=0.0)].T @ W
    errors = list(dict.fromkeys(names))
    moved, whole = np.zeros(len(errors)), np.zeros(len(errors))
    for i, name in enumerate(names):
        moved[errors.index(name)] += float(np.sum(followed[:, i] ** 2)) / points
        whole[errors.index(name)] += float(np.sum(W[:, i] ** 2)) / points
    beyond = np.sqrt(np.maximum(whole - moved, 0.0))
    total = float(np.sum(moved))
    share = moved / total if total > 0.0 else moved
    order = np.argsort(-moved, kind="stable")
    return tuple(Next(errors[i], float(np.sqrt(moved[i])), float(beyond[i]), float(share[i])) for i in order)
