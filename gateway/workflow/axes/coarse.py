"""What no table of an axis can hold, in words: its grid is too coarse, or the axis too steep; pure."""

from __future__ import annotations

import numpy as np

from drivers.errors import words
from drivers.limits import Limits
from drivers.types.values import FloatArray
from gateway.config import AxisSection
from gateway.model.components import value
from gateway.table import Grid
from gateway.table.chances import held_by
from gateway.table.proposal import InstrumentU
from gateway.workflow.axes.structure import Structure

FINER = (2, 4, 5, 8, 10)
MUCH_LESS = 0.25


def cannot_hold(axis: AxisSection, shown: Structure) -> str:
    """What the control's grid leaves of the axis' curve, and the grid that would hold it; "" where it leaves little."""
    lattice, step = shown.seen.lattice, axis.table.step
    curve = value(shown.component, lattice)
    rest = _rest(axis, lattice, curve, step)
    unit = shown.capture.unit
    if rest <= InstrumentU.usual(unit).constant / 2.0:
        return ""
    fields = {"step": f"{step:g}", "rest": f"{rest:.2g}", "unit": unit, "per": axis.unit}
    slope, limit = float(np.max(np.abs(np.gradient(curve, lattice)))), Limits.of(axis.unit).slope
    if slope > limit:
        return words("S-COMP-TOO-STEEP", slope=f"{slope:.2g}", limit=f"{limit:g}", **fields)
    for times in FINER:
        left = _rest(axis, lattice, curve, step / times)
        if left <= MUCH_LESS * rest:
            points = round((axis.table.maximum - axis.table.minimum) / step * times) + 1
            finer = {"finer": f"{step / times:g}", "points": points, "left": f"{left:.2g}"}
            return words("S-COMP-COARSE", **fields, **finer)
    return words("S-COMP-COARSE-ANY", **fields)


def _rest(axis: AxisSection, lattice: FloatArray, curve: FloatArray, step: float) -> float:
    held = held_by(Grid(axis.table.minimum, axis.table.maximum, step), lattice, modulo=axis.modulo)
    return float(np.std(curve - held @ curve))
