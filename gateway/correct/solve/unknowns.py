"""Tables and set-up values as independent unknowns: tied at their references, scaled, limited, held calm.

The model's unknowns are the values of all tables (mm, rad) and set-up values. They become y of about one um on the
flank each, values = tie (scale y): the tie takes out the value that the reference fixes, the scale is the inverse of
the RMS that a unit of the table's output makes on the flank. So mm and rad, face and turn weigh alike, and what
"nearest to the wish" means does not depend on units. A constant can often be taken by a table as well as by a set-up
value. A set-up value's scale is EASY times larger: it moves first. How much it takes is decided by the least change
alone, before smoothness is weighed; no table bends less by leaving a constant to it. A are the flank's rows with the
weighted rows of smoothness beneath, b likewise; the wish is the y that smoothness alone would choose, and stands
wherever the flank does not decide. Nodes without any effect are named as unseen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.types.values import FloatArray
from gateway.correct.flank.flankmodel import FlankModel, SetupUnknown, table_terms
from gateway.correct.solve.leastsquares import nearest
from gateway.correct.solve.limits import AxisBound, TableSpec, stacked
from gateway.correct.solve.smoothness import HELD, smoothing, uneven_rows
from gateway.gear.grinding import Grinding

UM = 1000.0  # work in um on the flank: numbers near 1
EASY = 10.0  # how much less a set-up value counts as a change than a table: a constant both could take is its own
UNSEEN = 1e-6  # of what a unit does elsewhere: a node that no flank point depends on


@dataclass(frozen=True)
class SolverWork:
    """The problem in independent unknowns y of about 1 um on the flank each: values = tie (scale y).

    ``A`` and ``b`` (um, on values): the flank, and beneath it weighted rows that make the values smooth; ``wish`` is
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
    wish: FloatArray
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


def tied(model: FlankModel, specs: Sequence[TableSpec]) -> FlankModel:
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
    alike: float,
) -> SolverWork:
    """The problem of these tables and set-up values; ``model`` holds their blocks in this order.

    Smoothness may cost ``alike`` (mm RMS, added in squares); with 0 it only decides what the flank leaves open.
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
    reach = UM * np.array([_reach(model, i) / (1.0 if i < len(specs) else EASY) for i in range(len(model.blocks))])
    scale = 1.0 / np.repeat(reach, [part.shape[1] for part in ties])
    A, b, wish = _calm(model, specs, reach, tie * scale, (UM * alike) ** 2 * model.places.points)
    G, g = stacked(specs, len(setup), bounds)
    limits = stacked(specs, len(setup), bounds, roundable=False)
    return SolverWork(
        model=model,
        specs=specs,
        setup=setup,
        tie=tie,
        scale=scale,
        fixed=fixed,
        A=A,
        b=b,
        wish=wish,
        G=G,
        g=g,
        limits=limits,
    )


def _reach(model: FlankModel, which: int) -> float:
    """mm on the flank per unit of a block's output, RMS; 1 if it has no effect at all."""
    along = model.places.along_normal(model.blocks[which].effect)
    return float(np.sqrt(np.mean(along**2))) or 1.0


def _calm(
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
    wish = np.linalg.lstsq(R @ free, t, rcond=None)[0]
    weight = smoothing(rows @ free, right, R=R @ free, t=t, allowed=allowed)
    return np.concatenate([rows, weight * R]), np.concatenate([right, -weight * t]), wish


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
