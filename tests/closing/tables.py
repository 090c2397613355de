"""The judge's own tables: hat functions on a control's grid, zero at their reference, and least squares under limits.

A table's unknowns are the steps between neighbouring points, in um or arcsec: so a limit on the slope is a bound, and
the least sum of squares of what nothing decides is the flattest table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

FloatArray = NDArray[np.float64]
# One table for both layers: |value|, change against what acts (nothing), and slope, um or arcsec per mm or deg.
VALUE = {"X": 200.0, "C": 180.0}
CHANGE = {"X": 120.0, "C": 54.0}
SLOPE = {"X": 1.0, "C": 10.0}
MET = 0.999
FLAT = 1e-2
CLOSED = 1e3


@dataclass(frozen=True, slots=True)
class Grid:
    """Points of a control's table over an axis, in mm or deg; ``modulo``: it repeats after ``high - low``."""

    low: float
    high: float
    step: float
    reference: float = 0.0
    modulo: bool = False

    @property
    def nodes(self) -> FloatArray:
        """Positions of its points, those that are free: the last of a repeating one is its first."""
        count = round((self.high - self.low) / self.step)
        return self.low + self.step * np.arange(count + (not self.modulo), dtype=np.float64)

    def weights(self, at: FloatArray) -> FloatArray:
        """Shares (n, m) of the points at positions (n,): straight lines between, the ends held outside."""
        place = (np.asarray(at, dtype=np.float64) - self.low) / self.step
        count = len(self.nodes)
        place = np.mod(place, count) if self.modulo else np.clip(place, 0.0, count - 1.0)
        first = np.floor(place).astype(int)
        second = (first + 1) % count if self.modulo else np.minimum(first + 1, count - 1)
        rows, shares = np.arange(len(place)), np.zeros((len(place), count))
        np.add.at(shares, (rows, first), 1.0 - (place - first))
        np.add.at(shares, (rows, second), place - first)
        return shares


@dataclass(frozen=True, slots=True)
class Table:
    """Values (m,) at a grid's points, added to the output axis, um or arcsec."""

    out: str
    over: str
    grid: Grid
    values: FloatArray

    @property
    def name(self) -> str:
        """Output first: X(Z)."""
        return f"{self.out}({self.over})"

    def at(self, positions: FloatArray) -> FloatArray:
        """What it adds at positions of its input axis (n,)."""
        return self.grid.weights(positions) @ self.values


@dataclass(frozen=True, slots=True)
class Layout:
    """A table to be found: output axis over input axis on a grid."""

    out: str
    over: str
    grid: Grid

    @property
    def name(self) -> str:
        """Output first: X(Z)."""
        return f"{self.out}({self.over})"

    @property
    def _sums(self) -> FloatArray:
        """Values (m,) from steps (m - 1 or, repeating, m): added up, then zero at the reference."""
        count = len(self.grid.nodes)
        sums = np.tril(np.ones((count, count)), -1)[:, : count if self.grid.modulo else count - 1]
        return np.asarray(sums - self.grid.weights(np.asarray([self.grid.reference])) @ sums)

    def shares(self, at: FloatArray) -> FloatArray:
        """What each step adds at positions of the input axis (n,), (n, steps)."""
        return self.grid.weights(at) @ self._sums

    def steps_of(self, table: Table | None) -> FloatArray:
        """The steps of a table; those of none are zero."""
        if table is None:
            return np.zeros(self._sums.shape[1])
        values = np.append(table.values, table.values[0]) if self.grid.modulo else table.values
        return np.asarray(np.diff(values))

    def table(self, steps: FloatArray) -> Table:
        """The table that these steps make. Raises ValueError beyond the limits of value and change."""
        values = self._sums @ steps
        largest = float(np.max(np.abs(values)))
        if largest > min(VALUE[self.out], CHANGE[self.out]):
            raise ValueError(f"the floor's {self.name} would reach {largest:.1f}, beyond what a table may hold")
        return Table(self.out, self.over, self.grid, values)

    @property
    def most(self) -> float:
        """The largest step the slope allows."""
        return SLOPE[self.out] * self.grid.step


def fitted(
    columns: FloatArray, left: FloatArray, free: int, layouts: Sequence[Layout], now: Sequence[FloatArray]
) -> tuple[list[FloatArray], tuple[str, ...]]:
    """The best addition to `free` values and to the steps of each table, added to what these are ``now``.

    ``columns`` (n, u) say what each unknown does to the points, ``left`` (n,) what they show now. Returns the answer
    in parts (each free value, then each table's steps) and the names of tables whose slope met its limit.
    """
    base = np.concatenate([np.zeros(free), *now])
    # The flattest table of those that do as well; a repeating one comes back to where it began.
    flat = FLAT * np.eye(len(base))[free:]
    closing = CLOSED * _closures(free, layouts)
    rows = np.concatenate((columns, flat, closing))
    right = np.concatenate((columns @ base - left, np.zeros(len(flat) + len(closing))))
    most = np.concatenate(
        [np.full(free, np.inf), *(np.full(len(s), one.most) for one, s in zip(layouts, now, strict=True))]
    )
    # The same problem in as many rows as unknowns.
    triangle = np.asarray(np.linalg.qr(np.column_stack((rows, right)), mode="r"))
    answer = np.asarray(lsq_linear(triangle[:-1, :-1], triangle[:-1, -1], (-most, most), tol=1e-12).x)
    parts = np.split(answer, np.cumsum([*([1] * free), *(len(s) for s in now)])[:-1])
    met = (one.name for one, s in zip(layouts, parts[free:], strict=True) if np.max(np.abs(s)) > MET * one.most)
    return parts, tuple(met)


def _closures(free: int, layouts: Sequence[Layout]) -> FloatArray:
    """A row for each repeating table: its steps add up to nothing."""
    sizes = [len(one.steps_of(None)) for one in layouts]
    rows = np.zeros((sum(one.grid.modulo for one in layouts), free + sum(sizes)))
    first, row = free, 0
    for one, size in zip(layouts, sizes, strict=True):
        if one.grid.modulo:
            rows[row, first : first + size] = 1.0
            row += 1
        first += size
    return rows
