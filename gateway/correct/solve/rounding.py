"""Values on the controller's resolution that keep the flank best: rounding as part of the problem, not after it.

With values x = n step, n whole, the loss |A (n - best)|^2 is a closest-point problem on a lattice; rounding each
value by itself ignores that neighbours pull together and loses several times more than need be. First Babai's nearest
plane: QR of A, then from the last value to the first each is rounded where the values already rounded want it, its
own pull being R's upper part. A small ridge keeps values that the flank hardly sees near their optimum, at most
FURTHEST steps away. Where this breaks a limit, plain rounding is taken: the continuous problem left room for it. Then
steps of one value and of two at once are exchanged, always the move that lowers the loss most and keeps the limits:
with H = A'A and pull = H (n - best) a move costs two entries and is exact. It ends when no move helps. For the
largest deviation moves are tried only among values that touch the worst point, and only until the maximum is within a
share of what the continuous optimum reached: lower would trade the many points for the one.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from drivers.types.values import FloatArray
from gateway.errors import ModelError

RIDGE = 1e-7
FURTHEST = 2.0  # steps that a value may move from its optimum
EXCHANGES = 4000
BETTER = 1e-12
TOUCHING = 0.05  # of the largest effect on the worst point: less moves it by the common rotation only
Whole = NDArray[np.int64]


class RoundingLimits:
    """G x <= g of values in steps, told apart by what a move changes."""

    def __init__(self, G: FloatArray, g: FloatArray) -> None:
        real = np.isfinite(g)
        self.G, self.g = G[real], g[real]

    def kept(self, n: FloatArray) -> bool:
        """True if values n keep every limit."""
        return bool(np.all(self.G @ n <= self.g + 1e-9 * (1.0 + np.abs(self.g))))


def nearest_whole(
    A: FloatArray, best: FloatArray, limits: RoundingLimits, movable: NDArray[np.bool_], ridge: float = 0.0
) -> Whole:
    """Whole n with small |A (n - best)| that keep the limits; those not movable are simply rounded.

    A in units of the flank per step, ``ridge`` in the same: what a value a step beside its optimum counts.
    Raises ModelError E-CORRECT-INFEASIBLE if not even plain rounding keeps the limits (give the continuous problem one
    step less room).
    """
    if not best.size:
        return np.zeros(0, dtype=np.int64)
    ridge = max(ridge, RIDGE * float(np.max(np.linalg.norm(A, axis=0), initial=0.0))) or 1.0
    tall = np.concatenate([A, ridge * np.eye(best.size)])
    n = _plane_by_plane(tall, best)
    n[~movable] = np.rint(best[~movable]).astype(np.int64)
    if not limits.kept(n.astype(np.float64)):
        n = np.rint(best).astype(np.int64)
        if not limits.kept(n.astype(np.float64)):
            raise ModelError("E-CORRECT-INFEASIBLE", "rounding", limits=int(limits.g.size))
    return _exchange_steps(tall.T @ tall, best, n, limits, movable)


def _plane_by_plane(A: FloatArray, best: FloatArray) -> Whole:
    r = np.asarray(np.linalg.qr(A, mode="r"))
    n = np.zeros(best.size)
    for i in range(best.size - 1, -1, -1):
        pull = r[i, i + 1 :] @ (n[i + 1 :] - best[i + 1 :]) / r[i, i]
        n[i] = np.rint(np.clip(best[i] - pull, best[i] - FURTHEST, best[i] + FURTHEST))
    return n.astype(np.int64)


def _exchange_steps(
    H: FloatArray, best: FloatArray, n: Whole, limits: RoundingLimits, movable: NDArray[np.bool_]
) -> Whole:
    """Steps of one value and of two at once, the best first, until none helps."""
    pull = H @ (n - best)
    diagonal = np.diag(H).copy()
    scale = BETTER * float(np.max(diagonal, initial=0.0))
    shut: set[tuple[int, int, int, int]] = set()
    for _ in range(EXCHANGES):
        move = _best_move(H, diagonal, pull, movable, shut, scale)
        if move is None:
            break
        step = np.zeros(n.size, dtype=np.int64)
        step[move[0]] += move[1]
        step[move[2]] += move[3]
        if limits.kept((n + step).astype(np.float64)):
            n = n + step
            pull = pull + H @ step
            shut.clear()
        else:
            shut.add(move)
    return n


def _best_move(
    H: FloatArray,
    diagonal: FloatArray,
    pull: FloatArray,
    movable: NDArray[np.bool_],
    shut: set[tuple[int, int, int, int]],
    scale: float,
) -> tuple[int, int, int, int] | None:
    """(i, +-1, j, +-1 or 0): the move that lowers the square most; None if none does."""
    found: tuple[float, tuple[int, int, int, int]] | None = None
    for si in (1, -1):
        one = 2.0 * si * pull + diagonal
        one[~movable] = np.inf
        for sj in (0, 1, -1):
            if sj == 0:
                change = np.diag(one).copy()
                change[~np.eye(one.size, dtype=bool)] = np.inf
            else:
                other = 2.0 * sj * pull + diagonal
                other[~movable] = np.inf
                change = one[:, None] + other[None, :] + 2.0 * si * sj * H
                np.fill_diagonal(change, np.inf)
            for i, _, j, _ in [move for move in shut if move[1] == si and move[3] == sj]:
                change[i, j] = np.inf
            at = int(np.argmin(change))
            i, j = divmod(at, one.size)
            value = float(change[i, j])
            if value < -scale and (found is None or value < found[0]):
                found = value, (i, si, j, sj)
    return None if found is None else found[1]


def lower_largest(
    M: scipy.sparse.csc_matrix,
    e: FloatArray,
    n: Whole,
    limits: RoundingLimits,
    movable: NDArray[np.bool_],
    *,
    enough: float,
    free: FloatArray | None = None,
) -> Whole:
    """Exchange steps that lower the largest |e|; e (N,) is the deviation with values n, M (N, unknowns) per step.

    Ends when it is at most ``enough``: lower would only trade the many for the one. ``free`` (N,): lever of a rotation
    that is taken out first, of the deviation and of every step.
    """
    columns = _Columns(M, free)
    e = columns.turned(e)
    for _ in range(EXCHANGES):
        move = _lowering_move(columns, e, n, limits, movable) if float(np.max(np.abs(e))) > enough else None
        if move is None:
            break
        n = n.copy()
        for i, s in move:
            n[i] += s
            e = e + s * columns.of(i)
    return n


class _Columns:
    """Columns of M as they show in the figure, each made dense when first needed."""

    def __init__(self, M: scipy.sparse.csc_matrix, free: FloatArray | None) -> None:
        self._M, self._free, self._known = M, free, dict[int, FloatArray]()

    def turned(self, e: FloatArray) -> FloatArray:
        """e less its share of the rotation."""
        if self._free is None:
            return e
        return np.asarray(e - self._free * (float(self._free @ e) / float(self._free @ self._free)))

    def of(self, i: int) -> FloatArray:
        """Column i (N,)."""
        if i not in self._known:
            first, last = self._M.indptr[i : i + 2]
            column = np.zeros(self._M.shape[0])
            column[self._M.indices[first:last]] = self._M.data[first:last]
            self._known[i] = self.turned(column)
        return self._known[i]


def _lowering_move(
    columns: _Columns, e: FloatArray, n: Whole, limits: RoundingLimits, movable: NDArray[np.bool_]
) -> list[tuple[int, int]] | None:
    worst = int(np.argmax(np.abs(e)))
    row = [float(columns.of(i)[worst]) if free else 0.0 for i, free in enumerate(movable)]
    most = TOUCHING * max((abs(one) for one in row), default=0.0)
    touching = [i for i, one in enumerate(row) if abs(one) > most]
    singles = [[(i, -int(np.sign(row[i] * e[worst])))] for i in touching]
    pairs = [[(i, s), (j, t)] for i in touching for j in touching if i < j for s in (1, -1) for t in (1, -1)]
    found: tuple[float, list[tuple[int, int]]] | None = None
    lower = float(np.abs(e[worst])) * (1.0 - 1e-9)
    if not touching:
        return None
    # A move shifts a point by at most this: what lies further below the worst can neither become it nor limit it.
    reach = 2.0 * max(float(np.max(np.abs(columns.of(i)))) for i in touching)
    near = np.flatnonzero(np.abs(e) >= lower - 2.0 * reach)
    close = e[near]
    part = {i: columns.of(i)[near] for i in touching}
    for move in (*singles, *pairs):
        if sum(s * row[i] for i, s in move) * e[worst] >= 0.0:
            continue
        top = float(np.max(np.abs(close + sum(s * part[i] for i, s in move))))
        if top < (lower if found is None else found[0]) and limits.kept(_apply_step(n, move)):
            found = top, move
    return None if found is None else found[1]


def _apply_step(n: Whole, move: list[tuple[int, int]]) -> FloatArray:
    step = n.astype(np.float64)
    for i, s in move:
        step[i] += s
    return step
