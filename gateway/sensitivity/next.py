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

    ``doubts`` (R, d): the flank of one standard uncertainty of each error; ``cures`` (R, m): the flank of one unit of
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
    change = np.linalg.norm(followed, axis=0) / np.sqrt(points)
    beyond = np.sqrt(np.maximum(np.sum(W**2, axis=0) / points - change**2, 0.0))
    total = float(np.sum(change**2))
    share = change**2 / total if total > 0.0 else np.zeros_like(change)
    order = np.argsort(-change, kind="stable")
    return tuple(Next(names[i], float(change[i]), float(beyond[i]), float(share[i])) for i in order)
