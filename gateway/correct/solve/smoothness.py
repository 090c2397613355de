"""Of all tables that serve the flank alike the smoothest: even between its places, and back to what acts beside them.

The flank sees a table only at the places of its points; between them, and beside the face, least squares leaves the
values to noise. Rows R x = t say what a calm table is: second differences times the square of half the length over
which a table goes back, and each value at what acts, firmly (HELD) far from the flank and loosely (LOOSE) near it.
Where a second difference touches a node that the flank does not see, it is that of the change: what acts keeps its
shape. The problem is Tikhonov's, |A y + b|^2 + w^2 |R y - t|^2. In standard form (Elden, BIT 17, 1977), QR of R and
the singular values s of A R^-1, the price on the flank is the sum of (w^2 / (s^2 + w^2))^2 c^2 over the components c
of what could be corrected: it grows with w. Bisection in log w finds the largest weight whose price stays within what
may be lost. Directions with s below SEEN of the largest cost the flank nothing, and there the smoothest is taken
whatever w is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.types.values import FloatArray
from gateway.correct.solve.limits import TableSpec

SHARE = 0.2  # of a travel: how far beside the flank a correction goes back to what acts
WAVE = 1.0 / np.pi  # of a period: the same around the turn, where only a part of a gear leaves such a gap
STEPS = 6.0  # of the grid, at least
HELD, LOOSE = 1e3, 0.1  # against second differences: how strongly a value is held that shall not change, and any other
LEAST, MOST, HALVINGS = 1e-14, 1.0, 60  # of the largest effect squared: range of the weight, and how finely it is found
SEEN = 1e-7  # of the largest effect: what the flank sees at all


def uneven_rows(spec: TableSpec, unseen: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """R (r, m) and t (r,): a table of free values x is calm where R x = t; in the units of x.

    Second differences count in full where the flank sees (m,) all three nodes, else those of the change: there the
    table keeps the shape of what acts. The last m rows hold every value to what acts, those far from the flank firmly.
    """
    length = _length(spec)
    bends, acting = _bends(spec, 0.5 * length), spec.acting()
    told = ~np.any((bends != 0.0) & unseen, axis=1)
    wanted = np.where(told, 0.0, bends @ acting)
    hold = np.where(_away(spec, unseen) > length, HELD, LOOSE)
    return np.concatenate([bends, np.diag(hold)]), np.concatenate([wanted, hold * acting])


def _length(spec: TableSpec) -> float:
    grid = spec.grid
    share = SHARE * float(np.ptp(grid.free)) if grid.period is None else WAVE * grid.period
    return max(share, STEPS * float(np.mean(np.diff(grid.nodes))) if grid.nodes.size > 1 else 0.0)


def _away(spec: TableSpec, unseen: NDArray[np.bool_]) -> FloatArray:
    """How far each free node (m,) is from the next one that the flank sees."""
    at = spec.grid.free
    apart = np.abs(at[:, None] - at[~unseen][None, :])
    if spec.grid.period is not None:
        apart = np.minimum(apart, spec.grid.period - apart)
    return np.asarray(np.min(apart, axis=1, initial=np.inf))


def _bends(spec: TableSpec, length: float) -> FloatArray:
    """Second differences (r, m) times the square of a length; around the turn, or of the inner nodes."""
    grid, m = spec.grid, spec.grid.free.size
    if m < 3:
        return np.zeros((0, m))
    if grid.period is None:
        at, middles = grid.free, np.arange(1, m - 1)
    else:
        at, middles = np.append(grid.free, grid.free[0] + grid.period), np.arange(m)
    gaps = np.diff(at)
    before, after = gaps[middles - 1], gaps[middles % gaps.size]
    rows, scale = np.zeros((middles.size, m)), 2.0 * length**2 / (before + after)
    index = np.arange(middles.size)
    np.add.at(rows, (index, middles - 1), scale / before)
    np.add.at(rows, (index, middles), -scale * (1.0 / before + 1.0 / after))
    np.add.at(rows, (index, (middles + 1) % m), scale / after)
    return rows


def smoothing(A: FloatArray, b: FloatArray, R: FloatArray, t: FloatArray, allowed: float) -> float:
    """Weight w of the rows R y - t in |A y + b|^2 + w^2 |R y - t|^2 that costs the first at most ``allowed``.

    R has full column rank.
    """
    q, r = np.linalg.qr(R)
    centre = np.linalg.solve(r, q.T @ t)
    u, s, _ = np.linalg.svd(np.linalg.solve(r.T, A.T).T, full_matrices=False)
    top = float(np.max(s, initial=0.0)) ** 2
    squares = np.where(s**2 > SEEN**2 * top, u.T @ (b + A @ centre), 0.0) ** 2
    if top == 0.0:
        return 1.0
    low, high = np.log(LEAST * top), np.log(MOST * top)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        share = np.exp(middle) / (s**2 + np.exp(middle))
        low, high = (middle, high) if float(np.sum(share**2 * squares)) <= allowed else (low, middle)
    return float(np.exp(0.5 * low))
