"""Table and set-up values that make the tooth best on the controller's grid, resolution and limits (mm, rad).

The smallest RMS or the smallest largest normal deviation; whole steps of resolution found as part of the problem; what
corrects less than its uncertainty left alone; what the flank does not decide decided by the least change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csc_matrix

from drivers.types import FloatArray
from gateway.correct.flankmodel import FlankModel, SetupValue, flank_model, table_terms
from gateway.correct.leastsquares import limited
from gateway.correct.limits import AxisBound, TableSpec, stacked
from gateway.correct.minimax import smallest_largest
from gateway.correct.noise import Noise, Omitted, carried, worth_it
from gateway.correct.places import Places
from gateway.correct.rounding import Limits, lower_largest, nearest_whole
from gateway.correct.tables import Table
from gateway.errors import ModelError
from gateway.gear.flank import FlankFigure, FlankGrid
from gateway.gear.grinding import Grinding

UM = 1000.0  # work in um on the flank: numbers near 1
TRADE = 1e-3  # of the largest deviation: nearer than this to the optimum, rounding looks no further
IDLE = 1e-5  # mm RMS: a table of single steps that gains less is left out
PEAK = 4.0  # how much more of the largest deviation that may be
EASY = 10.0  # how much less a set-up value counts as a change than a table: a constant both could take is its own
UNSEEN = 1e-6  # of what a unit does elsewhere: a node that no flank point depends on
Norm = Literal["rms", "max"]


@dataclass(frozen=True)
class Optimum:
    """The answer: tables and set-up values to use, and what the flank shows before, at best and with them.

    ``best`` is the figure before rounding. ``tables`` hold total corrections (what acted is inside); ``setup`` values
    are to be added (mm, rad). ``deviation_before`` and ``deviation`` (N,) mm. ``noise`` is the RMS that the errors'
    uncertainty carries onto the flank. ``unseen`` lists nodes the flank does not depend on.
    """

    tables: tuple[Table, ...]
    continuous: tuple[Table, ...]
    setup: Mapping[str, float]
    omitted: tuple[Omitted, ...]
    before: FlankFigure
    best: FlankFigure
    after: FlankFigure
    deviation_before: FloatArray
    deviation: FloatArray
    noise: float
    unseen: Mapping[str, tuple[float, ...]]

    def table(self, name: str) -> Table:
        """The table of that name, e.g. X(Z)."""
        for table in self.tables:
            if table.grid.name == name:
                return table
        raise ModelError("E-CORRECT-NAME", "optimum", name=name, known=", ".join(t.grid.name for t in self.tables))


@dataclass(frozen=True)
class _Work:
    """The problem in independent unknowns y of about 1 um on the flank each: values = tie (scale y)."""

    model: FlankModel
    specs: tuple[TableSpec, ...]
    setup: tuple[SetupValue, ...]
    tie: FloatArray
    scale: FloatArray
    fixed: NDArray[np.bool_]
    wish: FloatArray
    G: FloatArray
    g: FloatArray
    limits: tuple[FloatArray, FloatArray]

    def values(self, y: FloatArray) -> FloatArray:
        """Values of all blocks, mm and rad."""
        return np.asarray(self.tie @ (self.scale * y))


def optimise(
    grinding: Grinding,
    grid: FlankGrid | Places,
    tables: Sequence[TableSpec],
    setup: Sequence[SetupValue] = (),
    *,
    norm: Norm = "rms",
    deviation: ArrayLike | None = None,
    noise: Noise | None = None,
    bounds: Sequence[AxisBound] = (),
    turning: bool = True,
) -> Optimum:
    """Best tables and set-up values for a machine's flank, or for measured deviations (one per point, mm).

    Raises ModelError E-CORRECT-INFEASIBLE if the limits leave no solution.
    """
    if norm not in ("rms", "max"):
        raise ModelError("E-CORRECT-NORM", "optimise", norm=norm)
    doubt = noise or Noise()
    grids = [spec.grid for spec in tables]
    measured = flank_model(grinding, grid, grids, setup, deviation=deviation, turning=turning)
    worth, omitted = worth_it(_tied(measured, tables), doubt)
    kept = {block.name for block in worth.blocks}
    specs = tuple(spec for spec in tables if spec.name in kept)
    values = tuple(value for value in setup if value.name in kept)
    left_alone = [block.name for block in measured.blocks if block.name not in kept]
    model = _without_live(measured.without(left_alone), grinding, specs)
    work = _work(model, specs, values, bounds)
    y = _continuous(work, norm)
    x = _whole(work, y, norm)
    answer = _answer(work, work.values(y), x, measured, omitted, carried(_tied(model, specs), doubt))
    return _without_idle(answer, work, x)


def _tied(model: FlankModel, specs: Sequence[TableSpec]) -> FlankModel:
    """The model in values that are free once each table is zero at its reference."""
    ties = {spec.name: spec.tie()[0] for spec in specs}
    blocks = [replace(one, share=one.share @ ties[one.name]) if one.name in ties else one for one in model.blocks]
    return replace(model, blocks=tuple(blocks))


def _without_live(model: FlankModel, grinding: Grinding, specs: Sequence[TableSpec]) -> FlankModel:
    live = [spec.live for spec in specs if spec.live is not None]
    if not live:
        return model
    return replace(model, base=model.base - table_terms(grinding, model.places, live))


def _work(
    model: FlankModel, specs: tuple[TableSpec, ...], setup: tuple[SetupValue, ...], bounds: Sequence[AxisBound]
) -> _Work:
    sizes = [block.size for block in model.blocks]
    ties, fixed = [], np.zeros(model.size, dtype=np.bool_)
    for spec in specs:
        tie, given = spec.tie()
        ties.append(tie)
        if given is not None:
            at = model.spans[spec.name].start
            fixed[at + given] = True
            for other in np.flatnonzero(tie[given]):
                fixed[at + other + (other >= given)] = True
    ties += [np.eye(1)] * len(setup)
    tie = _diagonal(ties)
    reach = [_reach(model, i) / (1.0 if i < len(specs) else EASY) for i in range(len(sizes))]
    scale = 1.0 / (UM * np.repeat(reach, [part.shape[1] for part in ties]))
    acting = np.concatenate([*(spec.acting() for spec in specs), np.zeros(len(setup))])
    wish = np.linalg.lstsq(tie, acting, rcond=None)[0] / scale if tie.shape[1] else np.zeros(0)
    G, g = stacked(specs, len(setup), bounds)
    limits = stacked(specs, len(setup), bounds, roundable=False)
    return _Work(model, specs, setup, tie, scale, fixed, wish, G, g, limits)


def _reach(model: FlankModel, which: int) -> float:
    """mm on the flank per unit of a block's output, RMS; 1 if it has no effect at all."""
    along = model.places.along_normal(model.blocks[which].effect)
    return float(np.sqrt(np.mean(along**2))) or 1.0


def _continuous(work: _Work, norm: Norm) -> FloatArray:
    """y without rounding."""
    tied = work.tie * work.scale
    G = work.G @ tied
    y = limited(
        UM * (work.model.rows @ tied), UM * work.model.right, work.wish, _row_scaled(G), _side_scaled(G, work.g)
    )
    if norm == "rms" or not y.size:
        return y
    M = UM * (work.model.columns @ tied)
    lever = work.model.places.form[:, 2] if work.model.turning else None
    limits = _row_scaled(G), _side_scaled(G, work.g)
    return smallest_largest(csc_matrix(M), UM * work.model.start(), y, *limits, work.model.places.of, lever)


def _row_scaled(G: FloatArray) -> FloatArray:
    size = np.linalg.norm(G, axis=1, keepdims=True)
    return np.divide(G, size, out=np.zeros_like(G), where=size > 0.0)


def _side_scaled(G: FloatArray, g: FloatArray) -> FloatArray:
    size = np.linalg.norm(G, axis=1)
    return np.divide(g, size, out=np.where(g >= 0.0, np.inf, g), where=size > 0.0)


def _whole(work: _Work, y: FloatArray, norm: Norm) -> FloatArray:
    """Values on the resolutions, mm and rad; those without a resolution are best for the others once these are set."""
    steps = np.concatenate(
        [
            *(np.full(spec.grid.free.size, spec.resolution) for spec in work.specs),
            np.array([value.resolution for value in work.setup]),
        ]
    )
    x = work.values(y)
    if not np.any(steps > 0.0):
        return x
    whole = steps > 0.0
    A, M = UM * work.model.rows, work.model.columns
    smooth = _basis_of(A[:, ~whole])
    lattice = (A - smooth @ (smooth.T @ A))[:, whole] * steps[whole]
    G, g = work.limits
    limits = Limits(G[:, whole] * steps[whole], g - G[:, ~whole] @ x[~whole])
    movable = ~work.fixed[whole]
    n = nearest_whole(lattice, x[whole] / steps[whole], limits, movable)
    if norm == "max":
        lever = work.model.places.form[:, 2] if work.model.turning else None
        enough = (1.0 + TRADE) * _figure(work.model, work.model.deviation(x)).largest
        e = work.model.deviation(_refilled(work, n, whole, steps, x))
        per_step = csc_matrix(M[:, np.flatnonzero(whole)].multiply(steps[whole]))
        n = lower_largest(per_step, e, n, limits, movable, enough=enough, free=lever)
    return _refilled(work, n, whole, steps, x)


def _refilled(
    work: _Work, n: NDArray[np.int64], whole: NDArray[np.bool_], steps: FloatArray, x: FloatArray
) -> FloatArray:
    """Values of whole steps n, the others by least squares of what is left."""
    full = x.copy()
    full[whole] = n * steps[whole]
    if not np.all(whole):
        A = work.model.rows
        full[~whole] = np.linalg.lstsq(A[:, ~whole], -(work.model.right + A[:, whole] @ full[whole]), rcond=1e-12)[0]
    return full


def _basis_of(columns: FloatArray) -> FloatArray:
    if not columns.shape[1]:
        return np.zeros((columns.shape[0], 0))
    size = np.linalg.norm(columns, axis=0)
    return np.asarray(np.linalg.qr(columns[:, size > 0.0] / size[size > 0.0])[0])


def _answer(
    work: _Work, best: FloatArray, x: FloatArray, measured: FlankModel, omitted: tuple[Omitted, ...], noise: float
) -> Optimum:
    model = work.model
    before, after = measured.start(), model.deviation(x)
    spans = model.spans
    return Optimum(
        tables=tuple(Table.of(spec.grid, x[spans[spec.name]]) for spec in work.specs),
        continuous=tuple(Table.of(spec.grid, best[spans[spec.name]]) for spec in work.specs),
        setup={value.name: float(x[spans[value.name]][0]) for value in work.setup},
        omitted=omitted,
        before=_figure(model, before),
        best=_figure(model, model.deviation(best)),
        after=_figure(model, after),
        deviation_before=before,
        deviation=after,
        noise=noise,
        unseen={spec.name: _unseen(model, spec) for spec in work.specs},
    )


def _without_idle(answer: Optimum, work: _Work, x: FloatArray) -> Optimum:
    """Without the tables that differ from what acts by single steps at most and gain next to nothing by it."""
    model = work.model
    idle: list[Omitted] = []
    for spec in work.specs:
        span, acting = model.spans[spec.name], spec.acting()
        if spec.resolution == 0.0 or np.max(np.abs(x[span] - acting)) > 1.5 * spec.resolution:
            continue
        still = x.copy()
        still[span] = acting
        here, there = _figure(model, model.deviation(x)), _figure(model, model.deviation(still))
        if max(there.rms - here.rms, (there.largest - here.largest) / PEAK) <= IDLE:
            x = still
            idle.append(Omitted(spec.name, max(there.rms - here.rms, 0.0), 0.0, idle=True))
    if not idle:
        return answer
    e, names = model.deviation(x), [one.name for one in idle]
    kept = tuple(table for table in answer.tables if table.grid.name not in names)
    return replace(answer, tables=kept, omitted=(*answer.omitted, *idle), after=_figure(model, e), deviation=e)


def _figure(model: FlankModel, e: FloatArray) -> FlankFigure:
    if model.turning:
        return model.places.figure(e)
    return FlankFigure(float(np.sqrt(np.mean(e**2))), float(np.max(np.abs(e))), 0.0)


def _unseen(model: FlankModel, spec: TableSpec) -> tuple[float, ...]:
    """Nodes that no point of the flank depends on: the least change decides there."""
    size = np.linalg.norm(model.rows[:, model.spans[spec.name]], axis=0)
    largest = float(np.max(np.linalg.norm(model.rows, axis=0), initial=0.0))
    return tuple(float(node) for node, one in zip(spec.grid.free, size, strict=True) if one <= UNSEEN * largest)


def _diagonal(parts: Sequence[FloatArray]) -> FloatArray:
    """Block-diagonal matrix."""
    out = np.zeros((sum(p.shape[0] for p in parts), sum(p.shape[1] for p in parts)))
    row = column = 0
    for part in parts:
        out[row : row + part.shape[0], column : column + part.shape[1]] = part
        row, column = row + part.shape[0], column + part.shape[1]
    return out
