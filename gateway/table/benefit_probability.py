"""What a table does to every axis that may be: gain, chance of harm, and where more targets tell most; pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gateway.domain.proposals import Chance
from gateway.domain.values import FloatArray
from gateway.model.components import hats, periodic_hats
from gateway.table.merging import Grid

__all__ = ["Chance", "PosteriorCurves", "TableDoubt", "benefit_probability", "held_by"]

NEAR = 0.1  # of the usual gap: no new target so close to another
BESIDE = 1e-9


@dataclass(frozen=True)
class PosteriorCurves:
    """Curves (s, g) that an axis may have at places ``lattice`` (g,), each as likely as the others."""

    lattice: FloatArray
    curves: FloatArray


def benefit_probability(curves: FloatArray, taken: FloatArray) -> Chance:
    """The chance of a table that takes ``taken`` (g,) away from axes that may be ``curves`` (s, g)."""
    after = curves - taken
    gains = np.std(curves, axis=1) - np.std(after, axis=1)
    ranges = np.ptp(curves, axis=1) - np.ptp(after, axis=1)
    return Chance(float(np.mean(gains)), float(np.std(gains)), float(np.mean((gains < 0.0) | (ranges < 0.0))))


def held_by(grid: Grid, lattice: FloatArray, *, modulo: bool) -> FloatArray:
    """What the table's broken line can hold of a curve: the matrix (g, g) that projects a curve on the lattice."""
    nodes = grid.points
    turn = float(nodes[-1] - nodes[0])
    shares = periodic_hats(nodes[:-1], turn, lattice) if modulo else hats(nodes, lattice)
    shares = shares[:, np.any(shares > 0.0, axis=0)]
    size = float(np.trace(shares.T @ shares)) / shares.shape[1]
    return np.asarray(shares @ np.linalg.solve(shares.T @ shares + BESIDE * size * np.eye(shares.shape[1]), shares.T))


@dataclass(frozen=True)
class TableDoubt:
    """How far a table may be off, for every curve that may be: ``curves`` (s, g) less the one it is made from.

    ``held`` (g, g) is what the table can hold, ``weights`` (g,) what each place counts; they add up to 1.
    """

    lattice: FloatArray
    curves: FloatArray
    held: FloatArray
    weights: FloatArray

    @property
    def rms(self) -> float:
        """Expected error of the table over the places that count, in the deviation unit."""
        return float(np.sqrt(np.mean(_less_mean(self.curves @ self.held.T, self.weights) ** 2 @ self.weights)))

    def places(self, measured: FloatArray, count: int, u: float, gap: float) -> FloatArray:
        """The ``count`` places (k,), ascending, whose measuring with ``u`` lets the table change most, one by one.

        Each next one knows what those before will have told. None lies within a tenth of the usual ``gap`` of another
        or of those ``measured``; fewer where there is no room for more.
        """
        own = _less_mean(self.curves, self.weights)
        told = _less_mean(self.curves @ self.held.T, self.weights)
        size = own.shape[0]
        open_places = np.min(np.abs(self.lattice[:, None] - measured[None, :]), axis=1) >= NEAR * gap
        chosen: list[float] = []
        while len(chosen) < count and open_places.any():
            variance = np.mean(own**2, axis=0) + u**2
            change = (own.T @ told / size) ** 2 @ self.weights / variance
            best = int(np.argmax(np.where(open_places, change, -1.0)))
            chosen.append(float(self.lattice[best]))
            share, seen = 1.0 / (size * variance[best]), own[:, best].copy()
            told = told - np.outer(seen, share * (seen @ told))
            own = own - np.outer(seen, share * (seen @ own))
            open_places &= np.abs(self.lattice - self.lattice[best]) >= NEAR * gap
        return np.sort(np.asarray(chosen))


def _less_mean(curves: FloatArray, weights: FloatArray) -> FloatArray:
    """Curves less their mean: the zero of an axis is no table's matter."""
    return np.asarray(curves - (curves @ weights)[:, None])
