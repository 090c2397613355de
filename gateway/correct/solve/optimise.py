"""Table and set-up values that make the tooth best on the controller's grid, resolution and limits (mm, rad).

The flank is linear in all values, e = e0 + M x. What acted while e0 was measured is taken off, so that the answer
holds total values. In this order:
1. worth: a table that corrects less than the errors' own uncertainty carries onto the flank is left out (`noise`);
2. continuous: least squares under the limits (`leastsquares`); what the flank leaves open is decided by smoothness
   (`smoothness`), and before it by the least change what is a set-up value's (`unknowns`); for the norm "max" a
   linear programme starts from there (`minimax`);
3. whole steps of the resolution, found as part of the problem (`rounding`), values without one refilled at the end;
4. idle tables, which differ from what acts by single steps and gain next to nothing, are left as they act.
RMS and largest deviation are those of the flank figure: one rotation of the gear is free. All in um on the flank
inside, so that tolerances mean something. The flank figure of the rounded values is what is reported, never the
optimum's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from drivers.types.values import FloatArray
from gateway.correct.flank.flank_model import FlankModel, Places, SetupUnknown, flank_model, setup_values, table_terms
from gateway.correct.flank.noise import FitNoise, OmittedCorrection, propagated_rms, significant_tables
from gateway.correct.flank.tables import Table
from gateway.correct.solve.constraints import (
    HELD,
    AxisBound,
    TableSpec,
    nearest,
    nearest_within_limits,
    smoothing_weight,
    stack_limits,
    uneven_rows,
)
from gateway.correct.solve.minimax import smallest_largest
from gateway.correct.solve.rounding import RoundingLimits, lower_largest, nearest_whole
from gateway.errors import ModelError
from gateway.gear.flank import FlankFigure, FlankGrid
from gateway.gear.grinding import Grinding
from gateway.reducer.goal import FlankTarget
from gateway.tooth import SetupValues

TRADE = 1e-3  # of the largest deviation: nearer than this to the optimum, rounding looks no further
IDLE = 1e-5  # mm RMS: a table of single steps that gains less is left out
PEAK = 4.0  # how much more of the largest deviation that may be
STEADY = 0.05  # um RMS, half a step: what all values a step beside the smoothest must gain on the flank
Norm = Literal["rms", "max"]


@dataclass(frozen=True)
class Optimum:
    """The answer: tables and set-up values to use, and what the flank shows before, at best and with them.

    ``best`` is the figure before rounding. ``tables`` hold total corrections (what acted is inside); ``setup`` is
    to be added. ``deviation_before`` and ``deviation`` (N,) mm. ``noise`` is the RMS that the errors'
    uncertainty carries onto the flank. ``unseen`` lists nodes the flank does not depend on.
    """

    tables: tuple[Table, ...]
    continuous: tuple[Table, ...]
    setup: SetupValues
    omitted: tuple[OmittedCorrection, ...]
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


def optimise(
    grinding: Grinding,
    grid: FlankGrid | Places,
    tables: Sequence[TableSpec],
    setup: Sequence[SetupUnknown] = (),
    *,
    norm: Norm = "rms",
    deviation: ArrayLike | None = None,
    noise: FitNoise | None = None,
    bounds: Sequence[AxisBound] = (),
    turning: bool = True,
    indifference_rms: float = 0.0,
    target: FlankTarget | None = None,
) -> Optimum:
    """Best tables and set-up values for a machine's flank, or for measured deviations (one per point, mm).

    ``target`` adds what else is to be small, the figures of a drive: least squares of both, for the norm "rms" alone.
    Flanks whose RMS differ, in squares, by less than ``indifference_rms`` (mm) count as alike: the smoothest tables
    are taken, before and in rounding. With 0 smoothness only decides what the flank leaves open.
    Raises ModelError E-CORRECT-INFEASIBLE if the limits leave no solution.
    """
    if norm not in ("rms", "max") or (target is not None and norm != "rms"):
        raise ModelError("E-CORRECT-NORM", "optimise", norm=norm)
    doubt = noise or FitNoise()
    grids = [spec.grid for spec in tables]
    measured = flank_model(grinding, grid, grids, setup, deviation=deviation, turning=turning, target=target)
    worth, omitted = significant_tables(apply_constraints(measured, tables), doubt)
    kept = {block.name for block in worth.blocks}
    specs = tuple(spec for spec in tables if spec.name in kept)
    values = tuple(value for value in setup if value.name in kept)
    left_alone = [block.name for block in measured.blocks if block.name not in kept]
    model = without_live(measured.without(left_alone), grinding, specs)
    work = work_of(model, specs, setup=values, bounds=bounds, indifference_rms=indifference_rms)
    y = _continuous(work, norm)
    x = _round_values(work, y, norm, STEADY if indifference_rms > 0.0 else 0.0)
    noise_rms = propagated_rms(apply_constraints(model, specs), doubt)
    answer = _answer(grinding, work, work.values(y), x, measured=measured, omitted=omitted, noise=noise_rms)
    return _without_idle(answer, work, x)


def _continuous(work: SolverWork, norm: Norm) -> FloatArray:
    """y without rounding."""
    G = work.G @ work.tied
    y = nearest_within_limits(work.A @ work.tied, work.b, prior=work.prior, G=_row_scaled(G), g=_side_scaled(G, work.g))
    if norm == "rms" or not y.size:
        return y
    M = UM * (work.model.columns @ work.tied)
    lever = work.model.places.form[:, 2] if work.model.turning else None
    scaled = {"G": _row_scaled(G), "g": _side_scaled(G, work.g)}
    start = UM * work.model.start()
    return smallest_largest(scipy.sparse.csc_matrix(M), start, y, **scaled, groups=work.model.places.of, free=lever)


def _row_scaled(G: FloatArray) -> FloatArray:
    size = np.linalg.norm(G, axis=1, keepdims=True)
    return np.divide(G, size, out=np.zeros_like(G), where=size > 0.0)


def _side_scaled(G: FloatArray, g: FloatArray) -> FloatArray:
    size = np.linalg.norm(G, axis=1)
    return np.divide(g, size, out=np.where(g >= 0.0, np.inf, g), where=size > 0.0)


def _round_values(work: SolverWork, y: FloatArray, norm: Norm, steady: float) -> FloatArray:
    """Values on the resolutions, mm and rad; those without a resolution are best for the others once these are set.

    If every value stands a step beside its optimum, that counts as ``steady`` (um RMS) on the flank.
    """
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
    limits = RoundingLimits(G[:, whole] * steps[whole], g - G[:, ~whole] @ x[~whole])
    movable = ~work.fixed[whole]
    ridge = steady * (work.model.places.points / steps.size) ** 0.5
    n = nearest_whole(lattice, x[whole] / steps[whole], limits=limits, movable=movable, ridge=ridge)
    if norm == "max":
        lever = work.model.places.form[:, 2] if work.model.turning else None
        enough = (1.0 + TRADE) * _figure(work.model, work.model.deviation(x)).largest
        e = work.model.deviation(_solve_unrounded(work, n, whole, steps, x))
        per_step = scipy.sparse.csc_matrix(M[:, np.flatnonzero(whole)].multiply(steps[whole]))
        n = lower_largest(per_step, e, n=n, limits=limits, movable=movable, enough=enough, free=lever)
    return _solve_unrounded(work, n, whole, steps, x)


def _solve_unrounded(
    work: SolverWork, n: NDArray[np.int64], whole: NDArray[np.bool_], steps: FloatArray, x: FloatArray
) -> FloatArray:
    """Values of whole steps n, the others by least squares of what is left."""
    full = x.copy()
    full[whole] = n * steps[whole]
    if not np.all(whole):
        A = work.A
        full[~whole] = np.linalg.lstsq(A[:, ~whole], -(work.b + A[:, whole] @ full[whole]), rcond=1e-12)[0]
    return full


def _basis_of(columns: FloatArray) -> FloatArray:
    if not columns.shape[1]:
        return np.zeros((columns.shape[0], 0))
    size = np.linalg.norm(columns, axis=0)
    return np.asarray(np.linalg.qr(columns[:, size > 0.0] / size[size > 0.0])[0])


def _answer(
    grinding: Grinding,
    work: SolverWork,
    best: FloatArray,
    x: FloatArray,
    *,
    measured: FlankModel,
    omitted: tuple[OmittedCorrection, ...],
    noise: float,
) -> Optimum:
    model = work.model
    before, after = measured.start(), model.deviation(x)
    spans = model.spans
    return Optimum(
        tables=tuple(Table.of(spec.grid, x[spans[spec.name]]) for spec in work.specs),
        continuous=tuple(Table.of(spec.grid, best[spans[spec.name]]) for spec in work.specs),
        setup=setup_values(grinding, {one.axis: float(x[spans[one.name]][0]) for one in work.setup}),
        omitted=omitted,
        before=_figure(model, before),
        best=_figure(model, model.deviation(best)),
        after=_figure(model, after),
        deviation_before=before,
        deviation=after,
        noise=noise,
        unseen={spec.name: tuple(spec.grid.free[unseen_nodes(model, spec)].tolist()) for spec in work.specs},
    )


def _without_idle(answer: Optimum, work: SolverWork, x: FloatArray) -> Optimum:
    """Without the tables that differ from what acts by single steps at most and gain next to nothing by it."""
    model = work.model
    idle: list[OmittedCorrection] = []
    for spec in work.specs:
        span, acting = model.spans[spec.name], spec.acting()
        if spec.resolution == 0.0 or np.max(np.abs(x[span] - acting)) > 1.5 * spec.resolution:
            continue
        still = x.copy()
        still[span] = acting
        here, there = _figure(model, model.deviation(x)), _figure(model, model.deviation(still))
        aim = 0.0 if model.target is None else model.rms(still) - model.rms(x)
        if max(there.rms - here.rms, (there.largest - here.largest) / PEAK, aim) <= IDLE:
            x = still
            idle.append(OmittedCorrection(spec.name, max(there.rms - here.rms, 0.0), 0.0, idle=True))
    if not idle:
        return answer
    e, names = model.deviation(x), [one.name for one in idle]
    kept = tuple(table for table in answer.tables if table.grid.name not in names)
    return replace(answer, tables=kept, omitted=(*answer.omitted, *idle), after=_figure(model, e), deviation=e)


def _figure(model: FlankModel, e: FloatArray) -> FlankFigure:
    if model.turning:
        return model.places.figure(e)
    return FlankFigure(float(np.sqrt(np.mean(e**2))), float(np.max(np.abs(e))), 0.0)


# ---- Tables and set-up values as independent unknowns: tied at their references, scaled, limited, held calm.
#
# The model's unknowns are the values of all tables (mm, rad) and set-up values. They become y of about one um on the
# flank each, values = tie (scale y): the tie takes out the value that the reference fixes, the scale is the inverse of
# the RMS that a unit of the table's output makes on the flank. So mm and rad, face and turn weigh alike, and what
# "nearest to the prior" means does not depend on units. A constant can often be taken by a table as well as by a set-up
# value. A set-up value's scale is EASY times larger: it moves first. How much it takes is decided by the least change
# alone, before smoothness is weighed; no table bends less by leaving a constant to it. A are the flank's rows with the
# weighted rows of smoothness beneath, b likewise; the prior is the y that smoothness alone would choose, and stands
# wherever the flank does not decide. Nodes without any effect are named as unseen.

UM = 1000.0  # work in um on the flank: numbers near 1
SETUP_WEIGHT = (
    10.0  # how much less a set-up value counts as a change than a table: a constant both could take is its own
)
UNSEEN = 1e-6  # of what a unit does elsewhere: a node that no flank point depends on


@dataclass(frozen=True)
class SolverWork:
    """The problem in independent unknowns y of about 1 um on the flank each: values = tie (scale y).

    ``A`` and ``b`` (um, on values): the flank, and beneath it weighted rows that make the values smooth; ``prior`` is
    the y that these alone would choose. ``G``, ``g`` limit the values, with room for rounding; ``limits`` without.
    """

    model: FlankModel
    specs: tuple[TableSpec, ...]
    setup: tuple[SetupUnknown, ...]
    tie: FloatArray
    scale: FloatArray
    fixed: NDArray[np.bool_]
    A: FloatArray
    b: FloatArray
    prior: FloatArray
    G: FloatArray
    g: FloatArray
    limits: tuple[FloatArray, FloatArray]

    @property
    def tied(self) -> FloatArray:
        """Values of unit unknowns."""
        return np.asarray(self.tie * self.scale)

    def values(self, y: FloatArray) -> FloatArray:
        """Values of all blocks, mm and rad."""
        return np.asarray(self.tie @ (self.scale * y))


def apply_constraints(model: FlankModel, specs: Sequence[TableSpec]) -> FlankModel:
    """The model in values that are free once each table is zero at its reference."""
    ties = {spec.name: spec.tie()[0] for spec in specs}
    blocks = [replace(one, share=one.share @ ties[one.name]) if one.name in ties else one for one in model.blocks]
    return replace(model, blocks=tuple(blocks))


def without_live(model: FlankModel, grinding: Grinding, specs: Sequence[TableSpec]) -> FlankModel:
    """The model as if nothing of the same names had acted: its values replace what acts."""
    live = [spec.live for spec in specs if spec.live is not None]
    if not live:
        return model
    return replace(model, base=model.base - table_terms(grinding, model.places, live))


def work_of(
    model: FlankModel,
    specs: tuple[TableSpec, ...],
    setup: tuple[SetupUnknown, ...],
    bounds: Sequence[AxisBound],
    indifference_rms: float,
) -> SolverWork:
    """The problem of these tables and set-up values; ``model`` holds their blocks in this order.

    Smoothness may cost ``indifference_rms`` (mm, added in squares); with 0 it only decides what the flank leaves open.
    """
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
    reach = UM * np.array(
        [_column_gain(model, i) / (1.0 if i < len(specs) else SETUP_WEIGHT) for i in range(len(model.blocks))]
    )
    scale = 1.0 / np.repeat(reach, [part.shape[1] for part in ties])
    A, b, prior = _regularised_system(
        model, specs, reach, tie * scale, (UM * indifference_rms) ** 2 * model.places.points
    )
    G, g = stack_limits(specs, len(setup), bounds)
    limits = stack_limits(specs, len(setup), bounds, roundable=False)
    return SolverWork(
        model=model,
        specs=specs,
        setup=setup,
        tie=tie,
        scale=scale,
        fixed=fixed,
        A=A,
        b=b,
        prior=prior,
        G=G,
        g=g,
        limits=limits,
    )


def _column_gain(model: FlankModel, which: int) -> float:
    """mm on the flank per unit of a block's output, RMS; 1 if it has no effect at all."""
    along = model.places.along_normal(model.blocks[which].effect)
    return float(np.sqrt(np.mean(along**2))) or 1.0


def _regularised_system(
    model: FlankModel, specs: Sequence[TableSpec], reach: FloatArray, free: FloatArray, allowed: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The flank's rows with the weighted rows of smoothness beneath, and the unknowns that the latter would choose."""
    rows, right = UM * model.rows, UM * model.right
    if not free.shape[1]:
        return rows, right, np.zeros(0)
    # What a set-up value takes is decided by the least change alone: no table bends less by leaving a constant to it.
    acting = np.concatenate([*(spec.acting() for spec in specs), np.zeros(reach.size - len(specs))])
    first = free @ nearest(rows @ free, right, np.linalg.lstsq(free, acting, rcond=None)[0])
    parts = [uneven_rows(spec, unseen_nodes(model, spec)) for spec in specs]
    parts += [(HELD * np.eye(1), HELD * first[[i]]) for i in range(acting.size - reach.size + len(specs), acting.size)]
    R = _diagonal([one * size for (one, _), size in zip(parts, reach, strict=True)])
    t = np.concatenate([one * size for (_, one), size in zip(parts, reach, strict=True)])
    prior = np.linalg.lstsq(R @ free, t, rcond=None)[0]
    weight = smoothing_weight(rows @ free, right, R=R @ free, t=t, allowed=allowed)
    return np.concatenate([rows, weight * R]), np.concatenate([right, -weight * t]), prior


def unseen_nodes(model: FlankModel, spec: TableSpec) -> NDArray[np.bool_]:
    """Which free nodes (m,) no point of the flank depends on."""
    size = np.linalg.norm(model.rows[:, model.spans[spec.name]], axis=0)
    largest = float(np.max(np.linalg.norm(model.rows, axis=0), initial=0.0))
    return np.asarray(size <= UNSEEN * largest)


def _diagonal(parts: Sequence[FloatArray]) -> FloatArray:
    """Block-diagonal matrix."""
    out = np.zeros((sum(p.shape[0] for p in parts), sum(p.shape[1] for p in parts)))
    row = column = 0
    for part in parts:
        out[row : row + part.shape[0], column : column + part.shape[1]] = part
        row, column = row + part.shape[0], column + part.shape[1]
    return out
