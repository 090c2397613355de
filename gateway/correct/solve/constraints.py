"""Limits of tables as rows G x <= g of their free values, their smoothness, and least squares under both (mm, rad).

Every limit is linear in the values, so each table brings its rows and all are stacked: |x_i| <= value, the difference
of neighbours over their distance <= slope, |x_i - what acts| <= change, and for an axis that the tooth's table spoils
|what it still deviates + the table| <= its bound at given positions. A limit of infinity makes no row. A table is
zero at its reference: one value is tied to the others by the interpolation there (`TableSpec.tie`), so what is solved
for is free of it. A repeating table has its last point from the first; slopes go around the turn. Rounding may move a
value by a step. Rows for the continuous problem are therefore narrower by what a step of every value in the row can
add; rounded values are held to the full limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

import numpy as np
import scipy
from numpy.typing import NDArray

from drivers.types.values import FloatArray
from gateway.correct.flank.tables import Table, TableGrid
from gateway.errors import ModelError


@dataclass(frozen=True, slots=True)
class TableSpec:
    """One table the controller offers: grid, resolution and limits, in mm or rad of the output axis.

    ``value``, ``slope`` (per mm or rad of input) and ``change`` (against what acts) bound the corrections;
    ``resolution`` 0 means no rounding. The table is zero at ``reference`` of its input axis, if given. ``live`` is
    what acted while the errors were measured: the result replaces it and contains it.
    """

    grid: TableGrid
    resolution: float = 0.0
    value: float = inf
    slope: float = inf
    change: float = inf
    reference: float | None = None
    live: Table | None = None

    def __post_init__(self) -> None:
        numbers = (self.value, self.slope, self.change)
        if not (0.0 <= self.resolution < inf) or any(not number > 0.0 for number in numbers):
            raise ModelError("E-CORRECT-LIMIT", self.grid.name, resolution=self.resolution, limits=numbers)

    @property
    def name(self) -> str:
        """Output first: X(Z)."""
        return self.grid.name

    def acting(self) -> FloatArray:
        """What acts now at the free nodes, (m,)."""
        return np.zeros(self.grid.free.size) if self.live is None else self.live(self.grid.free)

    def tie(self) -> tuple[FloatArray, int | None]:
        """Values = tie @ independent values, (m, m') with zero at the reference; the node that was given up."""
        m = self.grid.free.size
        if self.reference is None:
            return np.eye(m), None
        weights = self.grid.weights(np.asarray(self.reference))
        given = int(np.argmax(weights))
        rest = np.delete(np.eye(m), given, axis=1)
        rest[given] = -np.delete(weights, given) / weights[given]
        return rest, given

    def rows(self, *, roundable: bool = True) -> tuple[FloatArray, FloatArray]:
        """G (r, m), g (r,) on the free values; if ``roundable``, with room for every rounding to keep the limits."""
        m = self.grid.free.size
        gaps, apart = self._gaps()
        room = self.resolution if roundable else 0.0
        eye = np.eye(m)
        parts = [
            (eye, np.full(m, self.value - room), np.zeros(m)),
            (eye, np.full(m, self.change - room), self.acting()),
        ]
        if gaps.size:
            parts.append((gaps, self.slope - 2.0 * room / apart, np.zeros(gaps.shape[0])))
        G = np.concatenate([sign * part for part, _, _ in parts for sign in (1.0, -1.0)])
        g = np.concatenate([limit + sign * centre for _, limit, centre in parts for sign in (1.0, -1.0)])
        return G, g

    def _gaps(self) -> tuple[FloatArray, FloatArray]:
        """Slopes (r, m) between neighbouring nodes, and their distances (r,)."""
        nodes, m = self.grid.nodes, self.grid.free.size
        if self.grid.period is not None and not self.grid.closed:
            nodes = np.append(nodes, nodes[0] + self.grid.period)
        apart = np.diff(nodes)
        gaps = np.zeros((apart.size, m))
        for i, distance in enumerate(apart):
            gaps[i, (i + 1) % m] += 1.0 / distance
            gaps[i, i] -= 1.0 / distance
        return gaps, apart


@dataclass(frozen=True, slots=True)
class AxisBound:
    """An axis' own accuracy to be kept: |deviation + table of the axis over itself| <= limit at positions (m,).

    Deviations (m,) are what the axis still shows (its own layer applied), mm or rad. Where it already shows more than
    ``limit``, it may not get worse.
    """

    axis: str
    at: FloatArray
    deviation: FloatArray
    limit: float

    def rows(self, spec: TableSpec, *, roundable: bool = True) -> tuple[FloatArray, FloatArray]:
        """G (2m, nodes), g (2m,) on the free values of that table; ``roundable`` as for a table."""
        deviation = np.asarray(self.deviation, dtype=np.float64)
        weights = spec.grid.weights(self.at)
        room = spec.resolution if roundable else 0.0
        allowed = np.maximum(self.limit, np.abs(deviation) + spec.resolution) - room
        return np.concatenate([weights, -weights]), np.concatenate([allowed - deviation, allowed + deviation])


def stack_limits(
    specs: Sequence[TableSpec], others: int, bounds: Sequence[AxisBound] = (), *, roundable: bool = True
) -> tuple[FloatArray, FloatArray]:
    """All rows of all tables, one after the other, with ``others`` further unknowns that nothing limits."""
    width = sum(spec.grid.free.size for spec in specs) + others
    parts, sides, first = [np.zeros((0, width))], [np.zeros(0)], 0
    for spec in specs:
        own = [bound.rows(spec, roundable=roundable) for bound in bounds if spec.name == f"{bound.axis}({bound.axis})"]
        for G, g in (spec.rows(roundable=roundable), *own):
            wide = np.zeros((g.size, width))
            wide[:, first : first + G.shape[1]] = G
            parts.append(wide)
            sides.append(g)
        first += spec.grid.free.size
    return np.concatenate(parts), np.concatenate(sides)


# ---- Of all tables that serve the flank alike the smoothest: even between its places, and back to what acts beside
# them.
#
# The flank sees a table only at the places of its points; between them, and beside the face, least squares leaves the
# values to noise. Rows R x = t say what a calm table is: second differences times the square of half the length over
# which a table goes back, and each value at what acts, firmly (HELD) far from the flank and loosely (LOOSE) near it.
# Where a second difference touches a node that the flank does not see, it is that of the change: what acts keeps its
# shape. The problem is Tikhonov's, |A y + b|^2 + w^2 |R y - t|^2. In standard form (Elden, BIT 17, 1977), QR of R and
# the singular values s of A R^-1, the price on the flank is the sum of (w^2 / (s^2 + w^2))^2 c^2 over the components c
# of what could be corrected: it grows with w. Bisection in log w finds the largest weight whose price stays within what
# may be lost. Directions with s below SEEN of the largest cost the flank nothing, and there the smoothest is taken
# whatever w is.

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
    hold = np.where(_distance_to_seen(spec, unseen) > length, HELD, LOOSE)
    return np.concatenate([bends, np.diag(hold)]), np.concatenate([wanted, hold * acting])


def _length(spec: TableSpec) -> float:
    grid = spec.grid
    share = SHARE * float(np.ptp(grid.free)) if grid.period is None else WAVE * grid.period
    return max(share, STEPS * float(np.mean(np.diff(grid.nodes))) if grid.nodes.size > 1 else 0.0)


def _distance_to_seen(spec: TableSpec, unseen: NDArray[np.bool_]) -> FloatArray:
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


def smoothing_weight(A: FloatArray, b: FloatArray, R: FloatArray, t: FloatArray, allowed: float) -> float:
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


# ---- Least squares of the flank under linear limits: the solution nearest to a prior where the flank does not decide.
#
# Minimise |A x + b| with G x <= g. Without limits x = prior + the minimum-norm step that A asks for; singular values
# below RANK of the largest are directions the flank does not see, and there the prior stays. Where limits act, a ridge
# of RIDGE (x - prior) makes A of full rank. QR of both, R (x - centre) = y, turns the objective into |y|: what is left
# is Lawson and Hanson's least-distance problem (Solving Least Squares Problems, ch. 23), the shortest y with C y >= d.
# Its dual is a non-negative least-squares problem, min |E u - f| over u >= 0, with E = [C'; d'] and f = (0, .., 0, 1).
# Its residual r gives y = -r[:-1] / r[-1]; r = 0 says that no y keeps the limits. The active-set method ends after
# finitely many steps and has no step size. Rows of C and d are scaled to one before, so that limits in mm and rad weigh
# alike. A solution that keeps the limits already is returned as it is.

RANK = 1e-10  # of the largest singular value: what the flank does not see
RIDGE = 1e-5  # of the largest column: weight of the prior where limits act
INSIDE = 1e-9  # of the largest limit: what counts as kept
UNMET = 1e-8


def nearest(A: FloatArray, b: FloatArray, prior: FloatArray) -> FloatArray:
    """x with the least |A x + b|, of all those the one nearest to ``prior`` (minimum norm of the change)."""
    if not A.shape[1]:
        return np.zeros(0)
    step = np.linalg.lstsq(A, -(b + A @ prior), rcond=RANK)[0]
    return np.asarray(prior + step)


def nearest_within_limits(A: FloatArray, b: FloatArray, prior: FloatArray, G: FloatArray, g: FloatArray) -> FloatArray:
    """As `nearest`, with G x <= g (rows, infinite ones are no limit). Raises ModelError E-CORRECT-INFEASIBLE."""
    free = nearest(A, b, prior)
    real = np.isfinite(g)
    G, g = G[real], g[real]
    if not g.size or np.all(G @ free <= g + INSIDE * (1.0 + np.max(np.abs(g)))):
        return free
    ridge = RIDGE * float(np.max(np.linalg.norm(A, axis=0), initial=0.0)) or 1.0
    tall = np.concatenate([A, ridge * np.eye(A.shape[1])])
    right = np.concatenate([-b, ridge * prior])
    q, r = np.linalg.qr(tall)
    centre = np.linalg.solve(r, q.T @ right)
    return centre + np.linalg.solve(r, _least_distance(-np.linalg.solve(r.T, G.T).T, G @ centre - g))


def _least_distance(C: FloatArray, d: FloatArray) -> FloatArray:
    """y of least length with C y >= d."""
    size = np.linalg.norm(C, axis=1)
    never = (size == 0.0) & (d > 0.0)
    C, d = C[size > 0.0] / size[size > 0.0, None], d[size > 0.0] / size[size > 0.0]
    scale = float(np.max(np.abs(d), initial=0.0)) or 1.0
    E = np.concatenate([C.T, (d / scale)[None, :]])
    f = np.zeros(E.shape[0])
    f[-1] = 1.0
    try:
        u, rest = scipy.optimize.nnls(E, f, maxiter=30 * E.shape[1])
    except RuntimeError as error:
        raise ModelError("E-CORRECT-INFEASIBLE", "optimise", limits=C.shape[0]) from error
    r = E @ u - f
    if np.any(never) or rest < UNMET:
        raise ModelError("E-CORRECT-INFEASIBLE", "optimise", limits=C.shape[0])
    return np.asarray(-r[:-1] / r[-1] * scale)
