"""Tables as corrections added to the commands: broken lines on a grid, clamped or modulo, sums and products (mm, rad).

The flank's change is the command's influence times the correction; the cross term of both kinds of tables (the one
moves the place at which the other is read, below 0.05 um at the limits) is dropped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from drivers.types.values import FloatArray
from gateway.errors import ModelError
from gateway.gear.grinding import Grinding
from gateway.model.components import hats, periodic_hats

CLOSED = 1e-9  # of the period: a grid whose ends are one turn apart


@dataclass(frozen=True, slots=True)
class TableGrid:
    """A table of axis ``out`` over axis ``over``: ascending nodes (n,) in mm or rad; ``period`` if it repeats.

    A repeating grid may end one period after its first node; first and last are then one value.
    Raises ModelError E-CORRECT-GRID.
    """

    out: str
    over: str
    nodes: FloatArray
    period: float | None = None

    def __post_init__(self) -> None:
        nodes = np.atleast_1d(np.asarray(self.nodes, dtype=np.float64))
        sound = nodes.ndim == 1 and bool(np.all(np.isfinite(nodes))) and bool(np.all(np.diff(nodes) > 0.0))
        if self.period is not None and sound:
            sound = self.period > 0.0 and float(np.ptp(nodes)) <= self.period * (1.0 + CLOSED)
        if not sound or not nodes.size:
            raise ModelError("E-CORRECT-GRID", f"{self.out}({self.over})", nodes=nodes.size, period=self.period)
        object.__setattr__(self, "nodes", nodes)

    @property
    def name(self) -> str:
        """Output first: X(Z)."""
        return f"{self.out}({self.over})"

    @property
    def closed(self) -> bool:
        """True if the last node is the first one, a period later."""
        if self.period is None or self.nodes.size < 2:
            return False
        return bool(abs(float(np.ptp(self.nodes)) - self.period) <= CLOSED * self.period)

    @property
    def free(self) -> FloatArray:
        """The nodes that hold a value of their own, (m,)."""
        return self.nodes[:-1] if self.closed else self.nodes

    def weights(self, q: ArrayLike) -> FloatArray:
        """Hat functions of the free nodes at positions (...), shape (..., m); they add up to 1."""
        at = np.asarray(q, dtype=np.float64)
        flat = at.ravel()
        nodes = self.free
        found = hats(nodes, flat) if self.period is None else periodic_hats(nodes, self.period, flat)
        return found.reshape(*at.shape, nodes.size)


@dataclass(frozen=True, slots=True)
class Table:
    """Corrections (n,) on a grid, one per node, mm or rad of the output axis."""

    grid: TableGrid
    values: FloatArray

    def __post_init__(self) -> None:
        values = np.asarray(self.values, dtype=np.float64)
        if values.shape != self.grid.nodes.shape or not np.all(np.isfinite(values)):
            raise ModelError(
                "E-CORRECT-VALUES", self.grid.name, nodes=self.grid.nodes.size, values=values.size, finite="finite"
            )
        object.__setattr__(self, "values", values)

    @staticmethod
    def of(grid: TableGrid, free: FloatArray) -> Table:
        """The table of values (m,) at the free nodes."""
        return Table(grid, np.append(free, free[0]) if grid.closed else free)

    @property
    def out(self) -> str:
        """The axis corrected."""
        return self.grid.out

    @property
    def inputs(self) -> tuple[str, ...]:
        """The axis it is read at."""
        return (self.grid.over,)

    def added(self, q: Mapping[str, ArrayLike]) -> FloatArray:
        """Correction at axis positions, of the input's shape. Raises ModelError E-CHAIN-AXIS without the input."""
        if self.grid.over not in q:
            raise ModelError("E-CHAIN-AXIS", self.grid.name, name=self.grid.over, known=", ".join(q))
        return self(q[self.grid.over])

    def __call__(self, q: ArrayLike) -> FloatArray:
        """Correction at positions of the input axis, same shape: linear between nodes, end values held outside."""
        at = np.asarray(q, dtype=np.float64)
        nodes, values = self.grid.nodes, self.values
        if self.grid.period is None:
            return np.asarray(np.interp(at, nodes, values))
        first = float(nodes[0])
        if not self.grid.closed:
            nodes, values = np.append(nodes, first + self.grid.period), np.append(values, values[0])
        return np.asarray(np.interp(first + np.mod(at - first, self.grid.period), nodes, values))


@dataclass(frozen=True, slots=True)
class Product:
    """Two tables of one output axis whose product is added to its command (each in mm or rad, the product too)."""

    first: Table
    second: Table

    def __post_init__(self) -> None:
        if self.first.grid.out != self.second.grid.out:
            raise ModelError("E-CORRECT-PRODUCT", "product", first=self.first.grid.name, second=self.second.grid.name)

    @property
    def out(self) -> str:
        """The axis corrected."""
        return self.first.grid.out

    @property
    def name(self) -> str:
        """Output first: X(Z)*(C)."""
        return f"{self.first.grid.name}*({self.second.grid.over})"

    @property
    def inputs(self) -> tuple[str, ...]:
        """The two axes it is read at."""
        return self.first.grid.over, self.second.grid.over

    def added(self, q: Mapping[str, ArrayLike]) -> FloatArray:
        """The product at axis positions, of the inputs' broadcast shape."""
        return self.first.added(q) * self.second.added(q)


Correction = Table | Product


def corrections(tables: Sequence[Correction], q: Mapping[str, ArrayLike]) -> dict[str, FloatArray]:
    """What the tables add to each output axis at axis positions, arrays of the positions' broadcast shape."""
    total: dict[str, FloatArray] = {}
    for table in tables:
        value = table.added(q)
        total[table.out] = total[table.out] + value if table.out in total else value
    return total


def with_tables(grinding: Grinding, tables: Sequence[Correction]) -> Grinding:
    """The same grinding with these tables acting too. Raises ModelError E-CHAIN-AXIS for an axis it does not have."""
    for table in tables:
        for name in (table.out, *table.inputs):
            grinding.chain.axis(name)
    return replace(grinding, tables=(*grinding.tables, *tables))
