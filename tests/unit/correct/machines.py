"""Machines, grids and tables for the tests of the corrections."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gateway.correct.flank.flankmodel import SetupUnknown, flank_model, with_acting
from gateway.correct.flank.tables import Correction, TableGrid
from gateway.correct.plan.plan import AxisGrid, Plan
from gateway.correct.solve.limits import TableSpec
from gateway.gear.flank import FlankGrid, flank_grid
from gateway.gear.grinding import Grinding
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
