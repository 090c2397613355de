"""Lines of an exchange file: comments off, numbers read strictly, faults by their line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from drivers.errors import FileFormatError, TableError
from drivers.types.exchange import ReadAs
from drivers.types.tables import CompensationTable
from drivers.types.values import FloatArray

LARGEST = 1e9
MOST_LINES = 200_000
PLAIN = str.maketrans({"\u00b5": "u", "\u03bc": "u", "\u00b0": " deg", "\u2212": "-"})


def content(text: str, mark: str, where: str) -> Iterator[tuple[int, str]]:
    """Number and text of each line that holds something besides a comment, which begins with ``mark``.

    Raises FileFormatError (E-EXCHANGE-SIZE).
    """
    lines = text.splitlines()
    if len(lines) > MOST_LINES:
        raise FileFormatError("E-EXCHANGE-SIZE", where, lines=len(lines), limit=MOST_LINES)
    for number, line in enumerate(lines, 1):
        told = line.partition(mark)[0].strip()
        if told:
            yield number, told


def number(token: str, where: str, line: int) -> float:
    """A finite number below 1e9. Raises FileFormatError (E-EXCHANGE-EMPTY, E-EXCHANGE-NUMBER)."""
    if not token.strip():
        raise FileFormatError("E-EXCHANGE-EMPTY", where, line=line)
    try:
        value = float(token)
    except ValueError:
        value = np.nan
    if not -LARGEST < value < LARGEST or "_" in token:
        raise FileFormatError("E-EXCHANGE-NUMBER", where, line=line, token=token[:40])
    return value


def rising(positions: FloatArray, where: str) -> None:
    """Raises FileFormatError (E-EXCHANGE-RISING) at the first position (m,) that does not lie above the one before."""
    wrong = np.flatnonzero(np.diff(positions) <= 0.0)
    if wrong.size:
        at = int(wrong[0]) + 1
        raise FileFormatError("E-EXCHANGE-RISING", where, row=at + 1, position=f"{positions[at]:g}")


def one_axis(tables: Sequence[CompensationTable], what: str) -> CompensationTable:
    """The only table, which must be an axis' own. Raises TableError (E-EXCHANGE-ONE)."""
    if len(tables) != 1 or tables[0].kind != "axis":
        raise TableError("E-EXCHANGE-ONE", what, found=", ".join(table.name for table in tables) or "nothing")
    return tables[0]


def curves_of(table: CompensationTable) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions, deviations of the positive and of the negative direction of travel, each (m,)."""
    forward = np.asarray(table.deviations, dtype=np.float64)
    return table.positions, forward, np.asarray(table.reverse or table.deviations, dtype=np.float64)


def own_table(
    known: ReadAs, positions: FloatArray, forward: FloatArray, reverse: FloatArray, *, modulo: bool = False
) -> CompensationTable:
    """An axis' own table at free positions (m,), mm or deg, with a curve (m,) for each direction, um or arcsec."""
    same = bool(np.array_equal(forward, reverse))
    return CompensationTable(
        kind="axis",
        input_axis=known.axis,
        output_axis=known.axis,
        minimum=float(positions[0]),
        maximum=float(positions[-1]),
        step=0.0,
        deviations=tuple(float(value) for value in forward),
        modulo=modulo,
        input_unit=known.unit,
        output_unit=known.unit,
        places=tuple(float(value) for value in positions),
        reverse=() if same else tuple(float(value) for value in reverse),
    )


def comment(text: str) -> str:
    """Text as one line of plain ASCII, for a file that a control reads."""
    plain = text.translate(PLAIN)
    return "".join(char if " " <= char <= "~" else "?" for char in plain)[:180]
