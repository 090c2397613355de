"""The machine as it stands with tables acting: corrections turned into error motions of the axis they are read at.

What a table of axis a over axis b does to the relative pose is put into b's six error motions, so that the exact flank
sees it like any other error. Exact to first order in the correction (a few nm at most); products of two axes have no
such form and are refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from drivers.types.values import FloatArray
from gateway.correct.flank.tables import Correction, Product, Table
from gateway.errors import ModelError
from gateway.gear.grinding import Grinding
from gateway.model.axis import MOTIONS, Motion
from gateway.model.chain import Chain, Influence

SMALL = 1e-13


@dataclass(frozen=True, slots=True)
class Combined:
    """Sum of motions over the same axis; plain data, so that it can be sent to another process."""

    parts: tuple[Motion, ...]

    def __call__(self, q: FloatArray) -> FloatArray:
        """Values at q, same shape."""
        total = np.zeros_like(q)
        for part in self.parts:
            total = total + (part(q) if callable(part) else part)
        return total


@dataclass(frozen=True, slots=True)
class Equivalent:
    """One error motion of axis ``over`` that does what a table of another axis does."""

    chain: Chain
    table: Table
    motion: int
    rest: Mapping[str, float]

    def __call__(self, q: FloatArray) -> FloatArray:
        """Values at q, same shape."""
        at: dict[str, ArrayLike] = {**self.rest, self.table.grid.over: q}
        influences = {influence.axis.name: influence for influence in self.chain.influences(at)}
        return _share(influences, self.table.grid.out, self.table.grid.over, self.motion) * self.table(q)


def with_tables(grinding: Grinding, tables: Sequence[Correction]) -> Grinding:
    """The same grinding with tables acting. Raises ModelError E-CORRECT-APPLY for a product table."""
    errors: dict[str, dict[str, list[Motion]]] = {}
    ideal = grinding.chain.without_errors()
    rest = {name: float(q) for name, q in grinding.commands(0.0, 0.0).items()}
    for table in tables:
        if isinstance(table, Product):
            raise ModelError("E-CORRECT-APPLY", table.name, name=table.name)
        for which in _moved(ideal, table, rest):
            motions = errors.setdefault(table.grid.over, {})
            motions.setdefault(MOTIONS[which], []).append(Equivalent(ideal, table, which, rest))
    return replace(grinding, chain=_added(grinding.chain, errors))


def _moved(chain: Chain, table: Table, rest: Mapping[str, float]) -> tuple[int, ...]:
    """Which of the six error motions of the input axis the table amounts to."""
    at: dict[str, ArrayLike] = {**rest, table.grid.over: table.grid.nodes}
    influences = {influence.axis.name: influence for influence in chain.influences(at)}
    shares = [_share(influences, table.grid.out, table.grid.over, i) for i in range(6)]
    return tuple(i for i in range(6) if float(np.max(np.abs(shares[i]))) > SMALL)


def _share(influences: Mapping[str, Influence], out: str, over: str, motion: int) -> FloatArray:
    """Error motion of ``over`` per unit of correction of ``out``."""
    for name in (out, over):
        if name not in influences:
            raise ModelError("E-CHAIN-AXIS", "tables", name=name, known=", ".join(influences))
    twist = influences[out].command()
    matrix = influences[over].motions
    shape = np.broadcast_shapes(twist.shape[:-1], matrix.shape[:-2])
    solved = np.linalg.solve(np.broadcast_to(matrix, (*shape, 6, 6)), np.broadcast_to(twist, (*shape, 6))[..., None])
    return np.asarray(solved[..., motion, 0])


def _added(chain: Chain, errors: Mapping[str, Mapping[str, list[Motion]]]) -> Chain:
    wanted: dict[str, Motion] = {}
    for name, motions in errors.items():
        axis = chain.axis(name)
        for key, parts in motions.items():
            letter = "XYZABC"[MOTIONS.index(key)]
            wanted[f"E{letter}{name}"] = Combined((axis.err.get(key, 0.0), *parts))
    return chain.with_errors(wanted)
