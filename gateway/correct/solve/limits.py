"""What a table may hold, as rows G x <= g of its free values: value, slope, change, the axis' accuracy (mm, rad).

Every limit is linear in the values, so each table brings its rows and all are stacked: |x_i| <= value, the difference
of neighbours over their distance <= slope, |x_i - what acts| <= change, and for an axis that the tooth's table spoils
|what it still deviates + the table| <= its bound at given positions. A limit of infinity makes no row. A table is
zero at its reference: one value is tied to the others by the interpolation there (`TableSpec.tie`), so what is solved
for is free of it. A repeating table has its last point from the first; slopes go around the turn. Rounding may move a
value by a step. Rows for the continuous problem are therefore narrower by what a step of every value in the row can
add; rounded values are held to the full limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from drivers.types.values import FloatArray
from gateway.correct.flank.tables import Table, TableGrid
from gateway.errors import ModelError


@dataclass(frozen=True, slots=True)
class TableSpec:
    """One table the controller offers: grid, resolution and limits, in mm or rad of the output axis.

    ``value``, ``slope`` (per mm or rad of input) and ``change`` (against what acts) bound the corrections;
    ``resolution`` 0 means no rounding. The table is zero at ``reference`` of its input axis, if given. ``live`` is
    what acted while the errors were measured: the result replaces it and contains it.
    """

    grid: TableGrid
    resolution: float = 0.0
    value: float = inf
    slope: float = inf
    change: float = inf
    reference: float | None = None
    live: Table | None = None

    def __post_init__(self) -> None:
        numbers = (self.value, self.slope, self.change)
        if not (0.0 <= self.resolution < inf) or any(not number > 0.0 for number in numbers):
            raise ModelError("E-CORRECT-LIMIT", self.grid.name, resolution=self.resolution, limits=numbers)

    @property
    def name(self) -> str:
        """Output first: X(Z)."""
        return self.grid.name

    def acting(self) -> FloatArray:
        """What acts now at the free nodes, (m,)."""
        return np.zeros(self.grid.free.size) if self.live is None else self.live(self.grid.free)

    def tie(self) -> tuple[FloatArray, int | None]:
        """Values = tie @ independent values, (m, m') with zero at the reference; the node that was given up."""
        m = self.grid.free.size
        if self.reference is None:
            return np.eye(m), None
        weights = self.grid.weights(np.asarray(self.reference))
        given = int(np.argmax(weights))
        rest = np.delete(np.eye(m), given, axis=1)
        rest[given] = -np.delete(weights, given) / weights[given]
        return rest, given

    def rows(self, *, roundable: bool = True) -> tuple[FloatArray, FloatArray]:
        """G (r, m), g (r,) on the free values; if ``roundable``, with room for every rounding to keep the limits."""
        m = self.grid.free.size
        gaps, apart = self._gaps()
        room = self.resolution if roundable else 0.0
        eye = np.eye(m)
        parts = [
            (eye, np.full(m, self.value - room), np.zeros(m)),
            (eye, np.full(m, self.change - room), self.acting()),
        ]
        if gaps.size:
            parts.append((gaps, self.slope - 2.0 * room / apart, np.zeros(gaps.shape[0])))
        G = np.concatenate([sign * part for part, _, _ in parts for sign in (1.0, -1.0)])
        g = np.concatenate([limit + sign * centre for _, limit, centre in parts for sign in (1.0, -1.0)])
        return G, g

    def _gaps(self) -> tuple[FloatArray, FloatArray]:
        """Slopes (r, m) between neighbouring nodes, and their distances (r,)."""
        nodes, m = self.grid.nodes, self.grid.free.size
        if self.grid.period is not None and not self.grid.closed:
            nodes = np.append(nodes, nodes[0] + self.grid.period)
        apart = np.diff(nodes)
        gaps = np.zeros((apart.size, m))
        for i, distance in enumerate(apart):
            gaps[i, (i + 1) % m] += 1.0 / distance
            gaps[i, i] -= 1.0 / distance
        return gaps, apart


@dataclass(frozen=True, slots=True)
class AxisBound:
    """An axis' own accuracy to be kept: |deviation + table of the axis over itself| <= limit at positions (m,).

    Deviations (m,) are what the axis still shows (its own layer applied), mm or rad. Where it already shows more than
    ``limit``, it may not get worse.
    """

    axis: str
    at: FloatArray
    deviation: FloatArray
    limit: float

    def rows(self, spec: TableSpec, *, roundable: bool = True) -> tuple[FloatArray, FloatArray]:
        """G (2m, nodes), g (2m,) on the free values of that table; ``roundable`` as for a table."""
        deviation = np.asarray(self.deviation, dtype=np.float64)
        weights = spec.grid.weights(self.at)
        room = spec.resolution if roundable else 0.0
        allowed = np.maximum(self.limit, np.abs(deviation) + spec.resolution) - room
        return np.concatenate([weights, -weights]), np.concatenate([allowed - deviation, allowed + deviation])


def stacked(
    specs: Sequence[TableSpec], others: int, bounds: Sequence[AxisBound] = (), *, roundable: bool = True
) -> tuple[FloatArray, FloatArray]:
    """All rows of all tables, one after the other, with ``others`` further unknowns that nothing limits."""
    width = sum(spec.grid.free.size for spec in specs) + others
    parts, sides, first = [np.zeros((0, width))], [np.zeros(0)], 0
    for spec in specs:
        own = [bound.rows(spec, roundable=roundable) for bound in bounds if spec.name == f"{bound.axis}({bound.axis})"]
        for G, g in (spec.rows(roundable=roundable), *own):
            wide = np.zeros((g.size, width))
            wide[:, first : first + G.shape[1]] = G
            parts.append(wide)
            sides.append(g)
        first += spec.grid.free.size
    return np.concatenate(parts), np.concatenate(sides)
