"""The first-order flank as a linear map of many parameters: Jacobian, block evaluation, RMS by Gram factor (mm, rad).

e1 at (k, theta, z) is a row of F(theta) = (n_x, n_y, h) times the A, B, G of (k, z): three numbers per wheel position
carry the whole profile. So a column of the Jacobian, however many profile points there are, is three per (k, z).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drivers.types.values import FloatArray
from gateway.errors import ModelError
from gateway.gear.first_order import abg, to_space
from gateway.gear.flank import FlankGrid
from gateway.gear.grinding import Grinding
from gateway.model.axis import MOTIONS
from gateway.model.chain import Influence, Positions, position

FEW = 64  # parameters: below, one product with the Jacobian is faster than two with its factors
OFFSET, RADIUS = "dressing.offset", "dressing.radius"


@dataclass(frozen=True, slots=True)
class ErrorParameter:
    """One column: an error ("EXX", "B0Z"), an axis' command ("X") or a dressing value, times a basis function.

    ``basis`` takes the positions of the axes in ``over`` (own axis if empty), mm or rad; none means constant.
    """

    source: str
    basis: Callable[..., FloatArray] | None = None
    over: tuple[str, ...] = ()
    label: str = ""

    @property
    def name(self) -> str:
        """The label, or the source if there is none."""
        return self.label or self.source


@dataclass(frozen=True)
class LinearFlank:
    """e1 = J v over a grid. ``form`` (T, 3) is F; ``terms`` (K, 3, Z, P) the A, B, G of every parameter.

    Points are counted in C order of (K, T, Z).
    """

    grid: FlankGrid
    names: tuple[str, ...]
    form: FloatArray
    terms: FloatArray

    @property
    def points(self) -> int:
        """Number of flank points, K T Z."""
        return int(np.prod(self.grid.shape))

    def jacobian(self, spaces: slice = slice(None), out: FloatArray | None = None) -> FloatArray:
        """Rows of the Jacobian (points of those spaces, P), written into ``out`` if given."""
        terms = self.terms[spaces]
        _, T, Z = self.grid.shape
        P = terms.shape[-1]
        rows = np.empty((terms.shape[0] * T * Z, P)) if out is None else out
        np.matmul(self.form, terms.reshape(-1, 3, Z * P), out=rows.reshape(-1, T, Z * P))
        return rows

    def deviations(self, vectors: FloatArray, out: FloatArray | None = None) -> FloatArray:
        """J v for vectors (P,) or (P, M): (points,) or (points, M), written into ``out`` (C order) if given."""
        wide = vectors.reshape(vectors.shape[0], -1)
        K, T, Z = self.grid.shape
        result = np.empty((self.points, wide.shape[1])) if out is None else out
        by_space = result.reshape(K, T * Z, -1)
        for k in range(K):
            if wide.shape[0] <= FEW:
                np.matmul(self.jacobian(slice(k, k + 1)), wide, out=by_space[k])
            else:
                np.matmul(self.form, (self.terms[k] @ wide).reshape(3, -1), out=by_space[k].reshape(T, -1))
        return result.reshape(self.points, *vectors.shape[1:])

    def normal_form(self, *, without_rotation: bool = False) -> RmsForm:
        """What is needed for the RMS of any vector, optionally after removing one rotation about the gear's axis."""
        root = np.asarray(np.linalg.qr(self.form, mode="r"))
        rows = np.ascontiguousarray(np.einsum("ic,kczp->kzip", root, self.terms))
        if without_rotation:
            lever = root[:, 2]
            share = np.einsum("i,kzip->p", lever, rows) / (rows.shape[0] * rows.shape[1] * float(lever @ lever))
            rows -= lever[:, None] * share
        factor = np.asarray(np.linalg.qr(rows.reshape(-1, rows.shape[-1]), mode="r"))
        return RmsForm(factor / np.sqrt(self.points))

    @cached_property
    def figure_form(self) -> RmsForm:
        """The RMS of the flank figure: one rotation removed."""
        return self.normal_form(without_rotation=True)


@dataclass(frozen=True, slots=True)
class RmsForm:
    """A triangular root of the Gram matrix J'J / N: RMS = |root v|, without the Gram matrix' loss of digits."""

    root: FloatArray

    @property
    def gram(self) -> FloatArray:
        """J'J / N, (P, P)."""
        return np.asarray(self.root.T @ self.root)

    def rms(self, vectors: FloatArray) -> FloatArray:
        """RMS (mm) of J v for vectors (P,) or (P, M): scalar array or (M,)."""
        image = self.root @ vectors
        return np.sqrt(np.einsum("i...,i...->...", image, image))


def linear_flank(grinding: Grinding, grid: FlankGrid, parameters: Sequence[ErrorParameter | str]) -> LinearFlank:
    """The linear map of those parameters on a grid; strings stand for constants.

    Raises ModelError E-CHAIN-ERROR-NAME for an unknown source.
    """
    wanted = [ErrorParameter(p) if isinstance(p, str) else p for p in parameters]
    k, z = grid.ks[:, None], grid.zs
    q = grinding.commands(k, z)
    influences = {influence.axis.name: influence for influence in grinding.chain.influences(q)}
    K, _, Z = grid.shape
    terms = np.empty((K, 3, Z, len(wanted)))
    known: dict[str, FloatArray] = {}
    for column, parameter in enumerate(wanted):
        source = parameter.source
        if source not in known:
            known[source] = np.broadcast_to(_source(grinding, influences, source, k, z), (K, Z, 3))
        weight = np.broadcast_to(_weight(grinding, parameter, q), (K, Z))
        terms[..., column] = np.moveaxis(known[source] * weight[..., None], -1, 1)
    section = grid.gear.section(grid.thetas)
    form = np.stack([section.nx, section.ny, section.h], axis=-1)
    return LinearFlank(grid, tuple(p.name for p in wanted), form, terms)


def _source(
    grinding: Grinding, influences: dict[str, Influence], source: str, k: FloatArray, z: FloatArray
) -> FloatArray:
    """A, B, G per unit of a source, shape broadcastable to (K, Z, 3)."""
    if source in (OFFSET, RADIUS):
        return np.array([0.0, 1.0, 0.0] if source == OFFSET else [-1.0, 0.0, 0.0])
    if source in influences:
        twist = influences[source].command()
    else:
        axis, key, row = grinding.chain.error_column(source)
        influence = influences[axis]
        twist = (influence.motions if key in MOTIONS else influence.location)[..., row]
    return abg(to_space(grinding, k, twist), z)


def _weight(grinding: Grinding, parameter: ErrorParameter, q: Positions) -> FloatArray:
    if parameter.basis is None:
        return np.ones(())
    over = parameter.over or (_own_axis(grinding, parameter.source),)
    value = np.asarray(parameter.basis(*(position(q, name) for name in over)), dtype=np.float64)
    if not np.all(np.isfinite(value)):
        raise ModelError("E-CHAIN-MOTION", f"axis {over[0]}", motion=parameter.name, shape=value.shape, wanted="finite")
    return value


def _own_axis(grinding: Grinding, source: str) -> str:
    if any(axis.name == source for axis in grinding.chain.axes):
        return source
    return grinding.chain.error_place(source)[0]
