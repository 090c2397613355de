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
from gateway.correct.flank.flankmodel import FlankModel, SetupUnknown, flank_model, setup_values
from gateway.correct.flank.noise import FitNoise, Omitted, carried, worth_it
from gateway.correct.flank.tables import Table
from gateway.correct.flank.wheel_places import Places
from gateway.correct.solve.leastsquares import limited
from gateway.correct.solve.limits import AxisBound, TableSpec
from gateway.correct.solve.minimax import smallest_largest
from gateway.correct.solve.rounding import RoundingLimits, lower_largest, nearest_whole
from gateway.correct.solve.unknowns import UM, SolverWork, tied, unseen_nodes, without_live, work_of
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
    alike: float = 0.0,
    target: FlankTarget | None = None,
) -> Optimum:
    """Best tables and set-up values for a machine's flank, or for measured deviations (one per point, mm).

    ``target`` adds what else is to be small, the figures of a drive: least squares of both, for the norm "rms" alone.
    Flanks whose RMS differ, in squares, by less than ``alike`` (mm) count as alike: the smoothest tables are taken,
    before and in rounding. With 0 smoothness only decides what the flank leaves open.
    Raises ModelError E-CORRECT-INFEASIBLE if the limits leave no solution.
    """
    if norm not in ("rms", "max") or (target is not None and norm != "rms"):
        raise ModelError("E-CORRECT-NORM", "optimise", norm=norm)
    doubt = noise or FitNoise()
    grids = [spec.grid for spec in tables]
    measured = flank_model(grinding, grid, grids, setup, deviation=deviation, turning=turning, target=target)
    worth, omitted = worth_it(tied(measured, tables), doubt)
    kept = {block.name for block in worth.blocks}
    specs = tuple(spec for spec in tables if spec.name in kept)
    values = tuple(value for value in setup if value.name in kept)
    left_alone = [block.name for block in measured.blocks if block.name not in kept]
    model = without_live(measured.without(left_alone), grinding, specs)
    work = work_of(model, specs, setup=values, bounds=bounds, alike=alike)
    y = _continuous(work, norm)
    x = _whole(work, y, norm, STEADY if alike > 0.0 else 0.0)
    noise_rms = carried(tied(model, specs), doubt)
    answer = _answer(grinding, work, work.values(y), x, measured=measured, omitted=omitted, noise=noise_rms)
    return _without_idle(answer, work, x)


def _continuous(work: SolverWork, norm: Norm) -> FloatArray:
    """y without rounding."""
    G = work.G @ work.tied
    y = limited(work.A @ work.tied, work.b, wish=work.wish, G=_row_scaled(G), g=_side_scaled(G, work.g))
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


def _whole(work: SolverWork, y: FloatArray, norm: Norm, steady: float) -> FloatArray:
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
        e = work.model.deviation(_refilled(work, n, whole, steps, x))
        per_step = scipy.sparse.csc_matrix(M[:, np.flatnonzero(whole)].multiply(steps[whole]))
        n = lower_largest(per_step, e, n=n, limits=limits, movable=movable, enough=enough, free=lever)
    return _refilled(work, n, whole, steps, x)


def _refilled(
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
    omitted: tuple[Omitted, ...],
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
    idle: list[Omitted] = []
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
