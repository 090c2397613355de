"""Least squares of the flank under linear limits: the solution nearest to a wish where the flank does not decide.

Minimise |A x + b| with G x <= g. Without limits x = wish + the minimum-norm step that A asks for; singular values
below RANK of the largest are directions the flank does not see, and there the wish stays. Where limits act, a ridge
of RIDGE (x - wish) makes A of full rank. QR of both, R (x - centre) = y, turns the objective into |y|: what is left
is Lawson and Hanson's least-distance problem (Solving Least Squares Problems, ch. 23), the shortest y with C y >= d.
Its dual is a non-negative least-squares problem, min |E u - f| over u >= 0, with E = [C'; d'] and f = (0, .., 0, 1).
Its residual r gives y = -r[:-1] / r[-1]; r = 0 says that no y keeps the limits. The active-set method ends after
finitely many steps and has no step size. Rows of C and d are scaled to one before, so that limits in mm and rad weigh
alike. A solution that keeps the limits already is returned as it is.
"""

from __future__ import annotations

import numpy as np
import scipy

from drivers.types.values import FloatArray
from gateway.errors import ModelError

RANK = 1e-10  # of the largest singular value: what the flank does not see
RIDGE = 1e-5  # of the largest column: weight of the wish where limits act
INSIDE = 1e-9  # of the largest limit: what counts as kept
UNMET = 1e-8


def nearest(A: FloatArray, b: FloatArray, wish: FloatArray) -> FloatArray:
    """x with the least |A x + b|, of all those the one nearest to ``wish`` (minimum norm of the change)."""
    if not A.shape[1]:
        return np.zeros(0)
    step = np.linalg.lstsq(A, -(b + A @ wish), rcond=RANK)[0]
    return np.asarray(wish + step)


def limited(A: FloatArray, b: FloatArray, wish: FloatArray, G: FloatArray, g: FloatArray) -> FloatArray:
    """As `nearest`, with G x <= g (rows, infinite ones are no limit). Raises ModelError E-CORRECT-INFEASIBLE."""
    free = nearest(A, b, wish)
    real = np.isfinite(g)
    G, g = G[real], g[real]
    if not g.size or np.all(G @ free <= g + INSIDE * (1.0 + np.max(np.abs(g)))):
        return free
    ridge = RIDGE * float(np.max(np.linalg.norm(A, axis=0), initial=0.0)) or 1.0
    tall = np.concatenate([A, ridge * np.eye(A.shape[1])])
    right = np.concatenate([-b, ridge * wish])
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
