"""LinuxCNC: the screw compensation file of a joint ([JOINT_n] COMP_FILE, COMP_FILE_TYPE), nominal forward reverse.

Described in LinuxCNC's "INI Configuration"; what its loader does, in `usrmotLoadComp` of src/emc/motion/usrmotintf.cc.
The loader stops at the first line that does not begin with three numbers and says nothing. So the rows come first and
comments last, and a file with a comment before its rows is refused here. Units are those of the joint: mm or deg.

Type 0 holds positions: forward = nominal + deviation. Type 1 holds trims: nominal - forward = -deviation.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivers.errors import FileFormatError, TableError
from drivers.exchange.lines import comment, curves_of, number, one_axis, own_table, rising
from drivers.types.exchange import ReadAs
from drivers.types.tables import CompensationTable
from drivers.types.values import FloatArray
from drivers.units import deviation_scale

MOST_ROWS = 256  # EMCMOT_COMP_SIZE; the kernel says so and runs on with what it has
DECIMALS = 9


class LinuxCncScrew:
    """Screw files of LinuxCNC (implements ports.TableExchange); form "trims" (COMP_FILE_TYPE 1) or "positions" (0)."""

    suffix = ".comp"
    forms = ("trims", "positions")

    def text(self, tables: Sequence[CompensationTable], form: str, comments: Sequence[str]) -> str:
        """The file of one joint. Raises TableError (E-EXCHANGE-ONE, E-EXCHANGE-ROWS)."""
        table = one_axis(tables, "linuxcnc")
        at, forward, reverse = curves_of(table)
        if at.size > MOST_ROWS:
            raise TableError("E-EXCHANGE-ROWS", "linuxcnc", rows=at.size, limit=MOST_ROWS)
        scale = deviation_scale(table.output_unit)
        columns = np.stack([at, *(_written(at, one / scale, form) for one in (forward, reverse))], axis=1)
        rows = [" ".join(f"{value:.{DECIMALS}f}" for value in row) for row in columns + 0.0]
        kind = 1 if form == "trims" else 0
        own_comments = [
            f"COMP_FILE_TYPE = {kind}; {table.input_unit}; {table.name}: nominal forward reverse",
            "the loader stops at these lines; keep them below the rows",
            *comments,
        ]
        return "\n".join([*rows, *(f"# {comment(line)}" for line in own_comments)]) + "\n"

    def read(self, text: str, where: str, known: ReadAs) -> tuple[CompensationTable, ...]:
        """What the loader takes of a file, as one table. Raises FileFormatError (E-EXCHANGE-...)."""
        rows, rest = _rows(text, where)
        for line, told in rest:
            if told and not told.startswith("#"):
                raise FileFormatError("E-EXCHANGE-LOST", where, line=line, found=told[:40])
        if not 2 <= len(rows) <= MOST_ROWS:
            raise FileFormatError("E-EXCHANGE-COUNT", where, rows=len(rows), least=2, most=MOST_ROWS)
        at, first, second = np.asarray(rows, dtype=np.float64).T
        rising(at, where)
        scale = deviation_scale(known.unit)
        forward, reverse = (np.round(_deviations(at, one, known.form) * scale, 6) + 0.0 for one in (first, second))
        return (own_table(known, at, forward, reverse),)


def _written(at: FloatArray, deviations: FloatArray, form: str) -> FloatArray:
    """Deviations (m,) in axis units as the file has them."""
    return -deviations if form == "trims" else at + deviations


def _deviations(at: FloatArray, column: FloatArray, form: str) -> FloatArray:
    """A column (m,) of the file as deviations in axis units."""
    return -column if form == "trims" else column - at


def _rows(text: str, where: str) -> tuple[list[tuple[float, float, float]], list[tuple[int, str]]]:
    """Rows up to the first line that is none, and the lines from there on, as the loader sees them."""
    lines = text.splitlines()
    rows: list[tuple[float, float, float]] = []
    for count, line in enumerate(lines):
        words = line.split()
        if len(words) < 3 or words[0].startswith("#"):
            return rows, [(place, one.strip()) for place, one in enumerate(lines[count:], count + 1)]
        first, second, third = (number(word, where, count + 1) for word in words[:3])
        rows.append((first, second, third))
    return rows, []
