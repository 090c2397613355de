"""Smallest largest deviation of the flank under linear limits, by linear programming with growing rows (HiGHS).

Minimise s with -s <= e0 + M x + f c <= s at every point and G x <= g. The deviation's whole share along f (a common
rotation, which the figure does not count) leaves through c: one equality that ties c to x. Only few points are ever
the worst. The programme starts with the extremes of the least-squares solution, of each wheel place the highest and
the lowest; its optimum s is a lower bound of the true one. All points that exceed it are looked at, the worst of each
place are added as rows, and it is solved again. Once no point exceeds s, lower bound and value meet: the optimum over
all points, at a fraction of the rows. Best solutions are rarely single. A second programme, over the same growing
rows and with s at most a share SLACK above its optimum, takes the x nearest to the start in the sum of absolute
changes, so that values that the worst points do not need stay where least squares put them. Numbers are in nm: the
solver's own tolerance (1e-7) is then far below them.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import scipy
from numpy.typing import NDArray

from drivers.types.values import FloatArray
from gateway.errors import ModelError

ROUNDS = 60
WORST = 3000  # rows taken up in one round
FINE = 1e3  # nm per um: what the solver calls equal is far below what counts
SURE = 1e-5  # nm: the solver's own tolerance and some more
CLOSE = 1e-9  # of the largest deviation: how near the optimum is known
SLACK = 1e-8  # of the optimum, given away to find the calmest of the best solutions


def smallest_largest(
    M: scipy.sparse.csc_matrix,
    e0: FloatArray,
    start: FloatArray,
    G: FloatArray,
    g: FloatArray,
    groups: NDArray[np.intp],
    free: FloatArray | None = None,
) -> FloatArray:
    """x that makes max |e0 + M x + f c| least with G x <= g; of the best ones one near ``start`` (1-norm).

    ``groups`` (N,) says which points lie together: of each only the worst is looked at in one round. ``free`` f (N,) is
    a rotation the flank figure does not count: c takes the deviation's whole share along f out. e0 and x in um on the
    flank. Raises ModelError E-CORRECT-INFEASIBLE.
    """
    e0, start, g = FINE * e0, FINE * start, FINE * g
    tall = scipy.sparse.csr_matrix(
        M if free is None else scipy.sparse.hstack([M, scipy.sparse.csc_matrix(free[:, None])])
    )
    x0 = start if free is None else np.append(start, -float(free @ (e0 + M @ start)) / float(free @ free))
    if float(np.max(np.abs(e0 + tall @ x0), initial=0.0)) <= CLOSE * float(np.max(np.abs(e0), initial=0.0)):
        return start / FINE
    limits = scipy.sparse.csr_matrix(np.pad(G[np.isfinite(g)], ((0, 0), (0, tall.shape[1] - M.shape[1]))))
    problem = _Problem(tall, e0, limits, g[np.isfinite(g)], free, groups)
    rows = problem.worst(x0, np.zeros(e0.size, dtype=np.bool_))
    for _ in range(ROUNDS):
        x, bound = problem.solve(rows)
        if float(np.max(np.abs(e0 + tall @ x))) <= bound * (1.0 + CLOSE) + SURE:
            break
        rows = problem.worst(x, rows, bound)
    return _smoothest_optimum(problem, rows, x0, bound)[: M.shape[1]] / FINE


class _Problem:
    """The programme min s with |e0 + M x| <= s on chosen rows and the limits."""

    def __init__(
        self,
        M: scipy.sparse.csr_matrix,
        e0: FloatArray,
        limits: scipy.sparse.csr_matrix,
        g: FloatArray,
        free: FloatArray | None,
        groups: NDArray[np.intp],
    ) -> None:
        self.groups = groups
        self.M, self.e0, self.limits, self.g = M, e0, limits, g
        self.turn: tuple[FloatArray, float] | None = None
        if free is not None:
            square = float(free @ free)
            self.turn = np.asarray(free @ M) / square, -float(free @ e0) / square

    def worst(self, x: FloatArray, known: NDArray[np.bool_], above: float = 0.0) -> NDArray[np.bool_]:
        """The rows known with at most `WORST` further ones: of each group the worst to either side."""
        e = self.e0 + self.M @ x
        size = np.where(known, -1.0, np.abs(e))
        order = np.argsort(-size, kind="stable")
        order = order[size[order] > above]
        _, first = np.unique(2 * self.groups[order] + (e[order] > 0.0), return_index=True)
        rows = known.copy()
        rows[order[np.sort(first)[:WORST]]] = True
        return rows

    def solve(self, rows: NDArray[np.bool_]) -> tuple[FloatArray, float]:
        """Optimum (x, s) over those rows."""
        n = self.M.shape[1]
        cost = np.append(np.zeros(n), 1.0)
        found = self._run(cost, rows, np.full((int(rows.sum()), 1), -1.0), 0.0, [(None, None)] * n + [(0.0, None)])
        return found[:n], float(found[n])

    def near(self, rows: NDArray[np.bool_], x0: FloatArray, bound: float) -> FloatArray:
        """Of all x within the bound the one nearest to x0 in the sum of absolute differences."""
        n = self.M.shape[1]
        count = int(rows.sum())
        box = scipy.sparse.csr_matrix(np.block([[np.eye(n), -np.eye(n)], [-np.eye(n), -np.eye(n)]]))
        cost = np.append(np.zeros(n), np.ones(n))
        sides = np.append(x0, -x0)
        found = self._run(cost, rows, np.zeros((count, n)), bound, [(None, None)] * n + [(0.0, None)] * n, (box, sides))
        return found[:n]

    def _run(
        self,
        cost: FloatArray,
        rows: NDArray[np.bool_],
        tail: FloatArray,
        bound: float,
        bounds: list[tuple[float | None, float | None]],
        more: tuple[scipy.sparse.csr_matrix, FloatArray] | None = None,
    ) -> FloatArray:
        M, e0, end = self.M[rows], self.e0[rows], scipy.sparse.csr_matrix(tail)
        wide = scipy.sparse.csr_matrix((self.limits.shape[0], tail.shape[1]))
        blocks = [
            scipy.sparse.hstack([M, end]),
            scipy.sparse.hstack([-M, end]),
            scipy.sparse.hstack([self.limits, wide]),
        ]
        sides = [bound - e0, bound + e0, self.g]
        if more is not None:
            blocks.append(more[0])
            sides.append(more[1])
        even = np.zeros((0, cost.size)) if self.turn is None else np.pad(self.turn[0], (0, tail.shape[1]))[None, :]
        share = np.zeros(0) if self.turn is None else np.array([self.turn[1]])
        answer = scipy.optimize.linprog(
            cost,
            A_ub=cast(Any, scipy.sparse.vstack(blocks).tocsc()),
            b_ub=np.concatenate(sides),
            A_eq=cast(Any, scipy.sparse.csr_matrix(even)),
            b_eq=share,
            bounds=bounds,
            method="highs",
        )
        if answer.x is None or not answer.success:
            raise ModelError("E-CORRECT-INFEASIBLE", "optimise", limits=int(self.g.size))
        return np.asarray(answer.x)


def _smoothest_optimum(problem: _Problem, rows: NDArray[np.bool_], x0: FloatArray, bound: float) -> FloatArray:
    """The calmest of the best solutions, over all points."""
    wide = bound * (1.0 + SLACK) + SURE
    for _ in range(ROUNDS):
        x = problem.near(rows, x0, wide)
        if float(np.max(np.abs(problem.e0 + problem.M @ x))) <= wide * (1.0 + CLOSE) + SURE:
            break
        rows = problem.worst(x, rows, wide)
    return x
