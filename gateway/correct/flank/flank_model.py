"""The flank as a linear function of table values and set-up values: e = e0 + sum diag(J_out) Phi t (mm, rad).

Phi are the hat functions of a table's nodes at the input axis' position, J_out what one mm or rad of the output axis
does to the flank. Signs: corrections q, added to the commands.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from drivers.types.values import FloatArray
from gateway.correct.flank.tables import Correction, Table, TableGrid, corrections
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear
from gateway.gear.first_order import abg, flank_abg, to_space
from gateway.gear.flank import FlankFigure, FlankGrid, flank_figure
from gateway.gear.grinding import Grinding
from gateway.reducer.goal import FlankTarget
from gateway.tooth import SetupValues

# ---- Flank points by the wheel places that made them: what the first-order flank needs to know of each (mm, rad).
#
# Each point's deviation is F (A, B, G): F = (n_x, n_y, h) of the point, A, B, G of its wheel place (space k, height z).

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


SMALL = 1e-13  # of the largest eigenvalue: what a place's points do not see


@dataclass(frozen=True, slots=True)
class SetupUnknown:
    """One unknown that no table takes: the zero of infeed or index ("X", "C"), or the dressing offset ("")."""

    axis: str
    resolution: float = 0.0

    @property
    def name(self) -> str:
        """X zero, C zero, dressing offset."""
        return f"{self.axis} zero" if self.axis else "dressing offset"


@dataclass(frozen=True)
class UnknownsBlock:
    """Unknowns of one table or set-up value: effect (G, 3) of a unit of output, share (G, m) of each unknown."""

    name: str
    grid: TableGrid | None
    effect: FloatArray
    share: FloatArray

    @property
    def size(self) -> int:
        """Number of unknowns m."""
        return int(self.share.shape[1])

    def terms(self, values: FloatArray) -> FloatArray:
        """A, B, G (G, 3) of values (m,)."""
        return self.effect * (self.share @ values)[:, None]


@dataclass(frozen=True)
class FlankModel:
    """e = e0 + M x over points. ``base`` (G, 3) are the A, B, G of the errors, ``extra`` (N,) what is beside them.

    The unknowns x are those of the blocks one after the other. With ``turning`` one rotation of the whole gear is free
    (the flank figure does not count it). With a ``target`` its rows stand beneath the flank's, which keep its weight.
    """

    places: Places
    base: FloatArray
    extra: FloatArray
    blocks: tuple[UnknownsBlock, ...]
    turning: bool = True
    target: FlankTarget | None = None

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return sum(block.size for block in self.blocks)

    @property
    def height(self) -> int:
        """Number of rows R: three a place, and the target's."""
        return 3 * int(self.places.k.size) + (0 if self.target is None else int(self.target.start.size))

    @cached_property
    def spans(self) -> dict[str, slice]:
        """Where each block's unknowns stand in x."""
        ends = np.cumsum([0, *(block.size for block in self.blocks)])
        return {block.name: slice(int(a), int(b)) for block, a, b in zip(self.blocks, ends, ends[1:], strict=False)}

    def start(self) -> FloatArray:
        """e0 (N,)."""
        return self.places.along_normal(self.base) + self.extra

    @cached_property
    def columns(self) -> scipy.sparse.csc_matrix:
        """M (N, unknowns), sparse."""
        parts = [self._column(block) for block in self.blocks]
        return scipy.sparse.csc_matrix(scipy.sparse.hstack(parts) if parts else (self.places.points, 0))

    def deviation(self, x: FloatArray) -> FloatArray:
        """e (N,) with values x."""
        return np.asarray(self.start() + self.columns @ x)

    @cached_property
    def rows(self) -> FloatArray:
        """A (R, unknowns) with |A x + b|^2 + lost = N times the mean square of the deviation."""
        if not self.blocks:
            return np.zeros((self.height, 0))
        parts = [np.einsum("gij,gj,gm->gim", self._roots, block.effect, block.share) for block in self.blocks]
        rows = self._without_rotation(np.concatenate(parts, axis=-1).reshape(-1, self.size))
        if self.target is None:
            return rows
        along = [
            np.einsum("rgj,gj,gm->rm", self._aims, block.effect, block.share, optimize=True) for block in self.blocks
        ]
        return np.concatenate([self.target.flank * rows, np.concatenate(along, axis=-1)])

    @cached_property
    def right(self) -> FloatArray:
        """b (R,): the errors in the rows' coordinates."""
        found = self.compressed(self.base, self.extra)
        if self.target is not None:
            found[-self.target.start.size :] += self.target.start
        return found

    def compressed(self, terms: FloatArray, extra: FloatArray | None = None) -> FloatArray:
        """Deviations of A, B, G (G, 3) or patterns (G, 3, S), plus (N,) beside them, in the rows' coordinates."""
        b = np.einsum("gij,gj...->gi...", self._roots, terms)
        if extra is not None and np.any(extra):
            moments = np.zeros_like(self.base)
            np.add.at(moments, self.places.of, self.places.form * extra[:, None])
            b = b + np.einsum("gij,gj->gi", self._inverse_roots, moments)
            terms = terms + np.einsum("gij,gj->gi", self.places.inverses, moments)
        plain = self._without_rotation(b.reshape(-1, *b.shape[2:]))
        if self.target is None:
            return plain
        return np.concatenate([self.target.flank * plain, np.einsum("rgj,gj...->r...", self._aims, terms)])

    @cached_property
    def lost(self) -> float:
        """Part of the sum of squares that no A, B, G at the places can change."""
        return max(self._total - float(np.sum(self._plain**2)), 0.0)

    def rms(self, x: FloatArray) -> float:
        """RMS deviation (mm), after removing one rotation if ``turning``; with a target the root of the whole sum."""
        rest = self.rows @ x + self.right
        lost = self.lost if self.target is None else self.target.flank**2 * self.lost
        return float(np.sqrt((rest @ rest + lost) / self.places.points))

    def without(self, names: Sequence[str]) -> FlankModel:
        """The model without some blocks."""
        kept = tuple(block for block in self.blocks if block.name not in names)
        return replace(self, blocks=kept)

    def _column(self, block: UnknownsBlock) -> scipy.sparse.csr_matrix:
        along = self.places.along_normal(block.effect)
        return scipy.sparse.csr_matrix(scipy.sparse.csr_matrix(block.share)[self.places.of].multiply(along[:, None]))

    @cached_property
    def _aims(self) -> FloatArray:
        """The target's rows by place (R, G, 3)."""
        rows = np.zeros((0, 0)) if self.target is None else self.target.rows
        return rows.reshape(-1, self.places.k.size, 3)

    @cached_property
    def _spectrum(self) -> tuple[FloatArray, FloatArray]:
        """Eigenvalues (G, 3) and vectors (G, 3, 3) of sum F'F at each place."""
        grams = np.zeros((self.places.k.size, 3, 3))
        np.add.at(grams, self.places.of, self.places.form[:, :, None] * self.places.form[:, None, :])
        values, vectors = np.linalg.eigh(grams)
        return np.maximum(values, 0.0), vectors

    @cached_property
    def _roots(self) -> FloatArray:
        values, vectors = self._spectrum
        return np.sqrt(values)[:, :, None] * np.swapaxes(vectors, -1, -2)

    @cached_property
    def _inverse_roots(self) -> FloatArray:
        values, vectors = self._spectrum
        seen = values > SMALL * np.max(values, axis=-1, keepdims=True)
        scale = np.divide(1.0, np.sqrt(values), out=np.zeros_like(values), where=seen)
        return scale[:, :, None] * np.swapaxes(vectors, -1, -2)

    def _without_rotation(self, rows: FloatArray) -> FloatArray:
        """Rows less their share of one common rotation."""
        if not self.turning:
            return rows
        lever = self._roots[:, :, 2].reshape(-1)
        share = lever @ rows / (lever @ lever)
        return rows - (lever[:, None] * share if rows.ndim == 2 else lever * share)

    @cached_property
    def _plain(self) -> FloatArray:
        moments = np.zeros_like(self.base)
        np.add.at(moments, self.places.of, self.places.form * self.extra[:, None])
        return np.einsum("gij,gj->gi", self._inverse_roots, moments)

    @cached_property
    def _total(self) -> float:
        return float(self.extra @ self.extra)


def flank_model(
    grinding: Grinding,
    grid: FlankGrid | Places,
    tables: Sequence[TableGrid] = (),
    setup: Sequence[SetupUnknown] = (),
    *,
    deviation: ArrayLike | None = None,
    turning: bool = True,
    target: FlankTarget | None = None,
) -> FlankModel:
    """The model of a machine's flank: its errors (or measured deviations, one per point) and what may be changed.

    With ``deviation`` (mm, C order of the points) the machine's own error motions count for nothing.
    Raises ModelError E-CORRECT-POINTS if deviations are not finite or not one per point.
    """
    places = grid if isinstance(grid, Places) else places_of_grid(grid)
    base, extra = _errors(grinding, grid, places, deviation)
    q = grinding.commands(places.k, places.z)
    effects = command_effects(grinding, places)
    blocks = [_table_block(one, q, effects) for one in tables]
    blocks += [_setup_block(one, effects, places) for one in setup]
    names = [block.name for block in blocks]
    if len(set(names)) != len(names):
        raise ModelError("E-CORRECT-TWICE", "flank", names=", ".join(names))
    if target is not None and target.rows.shape[1] != 3 * places.k.size:
        raise ModelError("E-CORRECT-POINTS", "flank", points=places.points)
    return FlankModel(places=places, base=base, extra=extra, blocks=tuple(blocks), turning=turning, target=target)


def setup_values(grinding: Grinding, found: Mapping[str, float]) -> SetupValues:
    """The set-up values found by axis, "" the dressing offset (mm, rad). Raises ModelError for any other axis."""
    known = {grinding.infeed: "x_mm", grinding.index: "c_rad", "": "dressing_mm"}
    for name in found:
        if name not in known:
            raise ModelError("E-CHAIN-AXIS", "set-up values", name=name, known=", ".join(filter(None, known)))
    return SetupValues.of(**{known[name]: value for name, value in found.items()})


def setup_tables(grinding: Grinding, setup: SetupValues) -> tuple[Table, ...]:
    """The zeros of infeed and index as tables of one constant, which move the axes as they do."""
    zeros = ((grinding.infeed, setup.x_mm), (grinding.index, setup.c_rad))
    return tuple(Table(TableGrid(name, grinding.stroke, np.zeros(1)), np.array([value])) for name, value in zeros)


def command_effects(grinding: Grinding, places: Places) -> dict[str, FloatArray]:
    """A, B, G (G, 3) of one mm or rad added to each axis' command."""
    q = grinding.commands(places.k, places.z)
    found = {}
    for influence in grinding.chain.influences(q):
        terms = abg(to_space(grinding, places.k, influence.command()), places.z)
        found[influence.axis.name] = np.broadcast_to(terms, (places.k.size, 3))
    return found


def table_terms(grinding: Grinding, places: Places, tables: Sequence[Correction]) -> FloatArray:
    """A, B, G (G, 3) that tables, products among them, add to the flank."""
    effects = command_effects(grinding, places)
    total = np.zeros((places.k.size, 3))
    for out, value in corrections(tables, grinding.commands(places.k, places.z)).items():
        total += _effect(effects, out) * np.broadcast_to(value, places.k.shape)[:, None]
    return total


def with_acting(model: FlankModel, grinding: Grinding, tables: Sequence[Correction]) -> FlankModel:
    """The model of the same flank with tables acting, products among them."""
    return replace(model, base=model.base + table_terms(grinding, model.places, tables))


def _errors(
    grinding: Grinding, grid: FlankGrid | Places, places: Places, deviation: ArrayLike | None
) -> tuple[FloatArray, FloatArray]:
    if deviation is not None:
        e = np.ravel(np.asarray(deviation, dtype=np.float64))
        if e.size != places.points or not np.all(np.isfinite(e)):
            raise ModelError("E-CORRECT-POINTS", "flank", points=e.size)
        return np.zeros((places.k.size, 3)), e
    base = np.broadcast_to(flank_abg(grinding, places.k, places.z), (places.k.size, 3))
    extra = np.zeros(places.points)
    if isinstance(grid, FlankGrid) and not grinding.dressing.perfect:
        wheel = grinding.dressing.first_order(grid.section, grid.theta)
        extra = np.ravel(np.broadcast_to(wheel[None, :, :], grid.shape)).copy()
    return base, extra


def _effect(effects: dict[str, FloatArray], axis: str) -> FloatArray:
    if axis not in effects:
        raise ModelError("E-CHAIN-AXIS", "flank", name=axis, known=", ".join(effects))
    return effects[axis]


def _table_block(grid: TableGrid, q: dict[str, FloatArray], effects: dict[str, FloatArray]) -> UnknownsBlock:
    effect = _effect(effects, grid.out)
    if grid.over not in q:
        raise ModelError("E-CHAIN-AXIS", grid.name, name=grid.over, known=", ".join(q))
    at = np.broadcast_to(q[grid.over], effect.shape[:1])
    return UnknownsBlock(grid.name, grid, effect, grid.weights(at))


def _setup_block(value: SetupUnknown, effects: dict[str, FloatArray], places: Places) -> UnknownsBlock:
    count = places.k.size
    offset = np.broadcast_to(np.array([0.0, 1.0, 0.0]), (count, 3))
    effect = _effect(effects, value.axis) if value.axis else offset
    return UnknownsBlock(value.name, None, effect, np.ones((count, 1)))
