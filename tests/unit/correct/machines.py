"""Machines, grids and tables for the tests of the corrections."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from drivers.types.values import FloatArray
from gateway.correct.flank.flank_model import SetupUnknown, flank_model, with_acting
from gateway.correct.flank.tables import Correction, Table, TableGrid
from gateway.correct.plan.plan import AxisGrid, Plan
from gateway.correct.solve.constraints import TableSpec
from gateway.gear.flank import FlankGrid, flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.chain import LETTERS, MOTIONS, Chain, Influence, Motion
from gateway.model.motion import MotionSum
from gateway.tooth import SetupValues
from tests.unit.gear.machines import DISC, RV40E, random_functions

TURN = 2.0 * np.pi
STEP_MM, STEP_RAD = 1e-4, float(np.deg2rad(1e-4))
PLAN = Plan(
    (AxisGrid("X", -200.0, 0.0, 20.0), AxisGrid("Z", -10.0, 10.0, 5.0), AxisGrid("C", 0.0, 360.0, 30.0, modulo=True))
)


def machine(seed: int, disc: bool = False) -> tuple[Grinding, FlankGrid]:
    """A random machine with one of two gears, and the judged flank."""
    gear, E = (DISC, 190.0) if disc else (RV40E, 160.0)
    chain = random_functions(np.random.default_rng(seed))
    return Grinding(chain, gear, E), flank_grid(gear, profile=6, width=4)


def specs(*, rounded: bool = True, reference: float | None = 0.0) -> list[TableSpec]:
    """X(Z), X(C), C(Z), C(C) on 5 mm and 30 deg."""
    z, c = np.linspace(-10.0, 10.0, 5), np.deg2rad(np.arange(0.0, 361.0, 30.0))
    steps = {"X": STEP_MM if rounded else 0.0, "C": STEP_RAD if rounded else 0.0}
    return [
        TableSpec(TableGrid(out, over, nodes, period), resolution=steps[out], reference=reference)
        for out in ("X", "C")
        for over, nodes, period in (("Z", z, None), ("C", c, TURN))
    ]


def setup(*, rounded: bool = True) -> list[SetupUnknown]:
    """X zero, C zero, dressing offset."""
    return [
        SetupUnknown("X", STEP_MM * rounded),
        SetupUnknown("C", STEP_RAD * rounded),
        SetupUnknown("", STEP_MM * rounded),
    ]


def setup_vector(found: SetupValues) -> list[float]:
    """Set-up values in the order of `setup`, mm and rad."""
    return [found.x_mm, found.c_rad, found.dressing_mm]


def corrected_flank(grinding: Grinding, grid: FlankGrid, tables: Sequence[Correction]) -> np.ndarray:
    """First-order deviations (K, T, Z) of the machine with tables acting."""
    return with_acting(flank_model(grinding, grid), grinding, tables).start().reshape(grid.shape)


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


def as_errors(grinding: Grinding) -> Grinding:
    """The machine as it would be measured: what its tables do, to first order, in the errors of the axes read at."""
    errors: dict[str, list[Motion]] = {}
    ideal = grinding.chain.without_errors()
    rest = {name: float(q) for name, q in grinding.commands(0.0, 0.0).items()}
    for table in grinding.tables:
        assert isinstance(table, Table)
        axis = grinding.chain.axis(table.grid.over)
        for i, key in enumerate(MOTIONS):
            parts = errors.setdefault(f"E{LETTERS[i]}{axis.name}", [axis.err.get(key, 0.0)])
            parts.append(Equivalent(ideal, table, i, rest))
    chain = grinding.chain.with_errors({name: MotionSum(tuple(parts)) for name, parts in errors.items()})
    return replace(grinding, chain=chain, tables=())


def _share(influences: Mapping[str, Influence], out: str, over: str, motion: int) -> FloatArray:
    """Error motion of ``over`` per unit of correction of ``out``."""
    twist = influences[out].command()
    matrix = influences[over].motions
    shape = np.broadcast_shapes(twist.shape[:-1], matrix.shape[:-2])
    solved = np.linalg.solve(np.broadcast_to(matrix, (*shape, 6, 6)), np.broadcast_to(twist, (*shape, 6))[..., None])
    return np.asarray(solved[..., motion, 0])
