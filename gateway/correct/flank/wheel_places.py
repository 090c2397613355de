"""Flank points by the wheel places that made them: what the first-order flank needs to know of each (mm, rad).

Each point's deviation is F (A, B, G): F = (n_x, n_y, h) of the point, A, B, G of its wheel place (space k, height z).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.types.values import FloatArray
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import FlankFigure, FlankGrid, flank_figure

SAME_HEIGHT = 1e-6  # mm: points nearer than this share their wheel place


@dataclass(frozen=True)
class Places:
    """Wheel places ``k``, ``z`` (G,); points with rows ``form`` (N, 3), each at place ``of`` (N,) int."""

    k: FloatArray
    z: FloatArray
    form: FloatArray
    of: NDArray[np.intp]

    @property
    def points(self) -> int:
        """Number of points N."""
        return int(self.of.size)

    def along_normal(self, terms: FloatArray) -> FloatArray:
        """Deviations (N,) of A, B, G (G, 3) of the places."""
        return np.asarray(np.einsum("ni,ni->n", self.form, terms[self.of]))

    @cached_property
    def inverses(self) -> FloatArray:
        """Covariances (G, 3, 3) of A, B, G fitted at each place, per variance of one point; pseudo where not seen."""
        grams = np.zeros((self.k.size, 3, 3))
        np.add.at(grams, self.of, self.form[:, :, None] * self.form[:, None, :])
        return np.asarray(np.linalg.pinv(grams, hermitian=True))

    def figure(self, deviation: FloatArray) -> FlankFigure:
        """The flank figure of deviations (N,): one rotation removed."""
        return flank_figure(deviation, self.form[:, 2])


def places_of_grid(grid: FlankGrid) -> Places:
    """All points of a grid, counted in C order of (K, T, Z)."""
    K, T, Z = grid.shape
    section = grid.gear.section(grid.thetas)
    form = np.stack([section.nx, section.ny, section.h], axis=-1)
    rows = np.broadcast_to(form[None, :, None, :], (K, T, Z, 3)).reshape(-1, 3)
    of = np.broadcast_to(np.arange(K * Z).reshape(K, 1, Z), (K, T, Z)).reshape(-1)
    return Places(np.repeat(grid.ks, Z), np.tile(grid.zs, K), np.ascontiguousarray(rows), of.astype(np.intp))


def places_of_points(gear: CycloidGear, k: ArrayLike, theta: ArrayLike, z: ArrayLike) -> Places:
    """Single points, e.g. measured ones; k, theta and z broadcast together and are counted in C order.

    Raises ModelError E-CORRECT-POINTS if there are none or they are not finite.
    """
    ks, thetas, zs = (np.ravel(part) for part in np.broadcast_arrays(*(np.asarray(v, float) for v in (k, theta, z))))
    if not ks.size or not all(bool(np.all(np.isfinite(part))) for part in (ks, thetas, zs)):
        raise ModelError("E-CORRECT-POINTS", "flank", points=ks.size)
    keys = np.stack([ks, np.round(zs / SAME_HEIGHT)], axis=-1)
    _, first, of = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    section = gear.section(thetas)
    form = np.stack([section.nx, section.ny, section.h], axis=-1)
    return Places(ks[first], zs[first], form, np.ravel(of).astype(np.intp))
