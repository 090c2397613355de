"""Whether a table of another program can be one of a machine's errors: what no axis has is refused, what few have told.

Its limits are wider than those of a push: a small mill's screw may well be off by more than we would load anywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from drivers.errors import TableError, words
from drivers.limits import Limits
from drivers.types.tables import CompensationTable

BEYOND = 5.0
"""How many times the largest value of a push no axis has: 1 mm, 900 arcsec."""


def doubts(tables: Sequence[CompensationTable]) -> tuple[str, ...]:
    """What is doubtful, in words: the largest value and the largest change from a point to its neighbour, once a table.

    Raises TableError (E-EXCHANGE-LARGE).
    """
    return tuple(told for table in tables for told in _doubts(table))


def _doubts(table: CompensationTable) -> list[str]:
    limits, at = Limits.of(table.output_unit), table.positions
    curves = np.asarray([table.deviations, table.reverse or table.deviations], dtype=np.float64)  # (2, m)
    sizes, jumps = np.abs(curves).max(axis=0), np.abs(np.diff(curves, axis=1)).max(axis=0)
    worst = int(sizes.argmax())
    told: dict[str, Any] = {"table": table.name, "axis_unit": table.input_unit, "unit": table.deviation_unit}
    seen: dict[str, Any] = {**told, "position": f"{at[worst]:g}", "value": f"{sizes[worst]:g}"}
    if sizes[worst] > BEYOND * limits.value:
        raise TableError("E-EXCHANGE-LARGE", table.name, limit=f"{BEYOND * limits.value:g}", **seen)
    found = []
    if sizes[worst] > limits.value:
        found.append(words("W-EXCHANGE-LARGE", limit=f"{limits.value:g}", **seen))
    if jumps.size and (beyond := jumps - limits.reversal - limits.slope * np.diff(at)).max() > 0.0:
        place = int(beyond.argmax())
        found.append(
            words(
                "W-EXCHANGE-JUMP", low=f"{at[place]:g}", high=f"{at[place + 1]:g}", change=f"{jumps[place]:g}", **told
            )
        )
    return found
