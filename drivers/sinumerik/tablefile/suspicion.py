"""Is a table written in the unit it is read in? Inches, micrometres written as mm, arcsec written as deg."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from drivers.errors import TableError
from drivers.limits import largest_value
from drivers.sinumerik.tablefile.lint import finding
from drivers.tablefile import TableFinding
from drivers.types.tables import CompensationTable
from drivers.units import ARCSEC_PER_DEG, MM_PER_INCH, UM_PER_MM, deviation_scale

SMALLEST = {"mm": 1e-5, "deg": 1e-6}  # no interferometer sees less: 10 nm, 0.0036 arcsec
_WRITTEN = {"mm": ("um", UM_PER_MM), "deg": ("arcsec", ARCSEC_PER_DEG)}


def of_table(table: CompensationTable, where: str) -> Iterator[TableFinding]:
    """Findings about units; all of them doubts, because a file does not say its unit."""
    yield from _values(table, where)
    if table.input_unit == "mm" and table.step > 0:
        yield from _inch(table, where)


def _values(table: CompensationTable, where: str) -> Iterator[TableFinding]:
    stored = np.abs(np.asarray(table.deviations)) / deviation_scale(table.output_unit)
    largest = float(np.max(stored, initial=0.0))
    unit = table.output_unit
    small, factor = _WRITTEN[unit]
    most = largest_value(unit)
    if most < largest <= most * factor:
        error = TableError(
            "W-TABLE-LARGE-UNIT", where, table=table.name, value=f"{largest:.6g}", unit=unit, small=small
        )
        yield finding("doubtful", error)
    elif 0.0 < largest < SMALLEST[unit]:
        yield finding(
            "doubtful", TableError("W-TABLE-TINY", where, table=table.name, value=f"{largest:.3g}", unit=unit)
        )


def _inch(table: CompensationTable, where: str) -> Iterator[TableFinding]:
    """A grid in whole inches read as mm, or a metric grid divided by 25.4."""
    grid = (table.step, table.minimum, table.maximum)
    fields: dict[str, Any] = {
        "table": table.name,
        "step": f"{table.step:g}",
        "low": table.minimum,
        "high": table.maximum,
    }
    if all(_whole(value / MM_PER_INCH, 1e-9) for value in grid):
        yield finding("doubtful", TableError("W-TABLE-INCH-GRID", where, **fields))
    elif not _whole(table.step * 100.0, 1e-9):  # three decimals, as 10 mm / 25.4 = 0.394 has them
        metric = table.step * MM_PER_INCH
        if metric > 0.5 and _whole(metric, min(0.01, 1e-3 * metric)):
            yield finding("doubtful", TableError("W-TABLE-INCH", where, **fields, metric=round(metric)))


def _whole(value: float, within: float) -> bool:
    return abs(value - round(value)) <= within
