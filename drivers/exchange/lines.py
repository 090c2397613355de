"""Lines of an exchange file: comments off, numbers read strictly, faults by their line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from drivers.errors import FileFormatError, TableError
from drivers.message import digits
from drivers.types.exchange import ErrorSet, ReadAs
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
        raise FileFormatError("E-EXCHANGE-RISING", where, row=at + 1, position=digits(positions[at], 6))


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


def shown_line(text: str) -> str:
    """A piece of a line for a message."""
    return text[:60]


def declared_number(said: Mapping[str, object], key: str, where: str, usual: float | None = None) -> float:
    """A number that a person declared, ``usual`` where it is not said. Raises FileFormatError (E-EXCHANGE-DECLARE)."""
    value = said.get(key, usual)
    if isinstance(value, bool) or not isinstance(value, int | float) or not -LARGEST < value < LARGEST:
        raise FileFormatError("E-EXCHANGE-DECLARE", where, missing=key, example=f"--column {key}=1")
    return float(value)


SENSES = {"error": 1.0, "correction": -1.0}


def directed(values: FloatArray, form: str, where: str, control: str) -> FloatArray:
    """Values (m,) of a file as deviations, or deviations as values: ``form`` says what a positive value is.

    "error": actual - nominal; "correction": its opposite. Raises FileFormatError (E-EXCHANGE-SIGN) while it is not
    said, for no public document does.
    """
    if form not in SENSES:
        raise FileFormatError("E-EXCHANGE-SIGN", where, control=control)
    return values * SENSES[form] + 0.0


def only_motions(errors: ErrorSet, what: str) -> None:
    """Raises TableError (E-EXCHANGE-FIELD) for an error over several axes, which a format cannot hold."""
    if errors.fields:
        one = errors.fields[0]
        raise TableError("E-EXCHANGE-FIELD", what, name=one.name, arguments=", ".join(one.arguments))


def one_with_both_directions(tables: Sequence[CompensationTable]) -> tuple[CompensationTable, ...]:
    """Tables with each pair of an axis over itself, one for + and one for - travel, as that axis' own with two curves.

    Raises TableError (E-EXCHANGE-PAIR) where the two do not lie on the same positions, E-EXCHANGE-DIRECTION where an
    axis has one of them alone, E-EXCHANGE-TWICE for two of one direction.
    """
    found: list[CompensationTable] = []
    ways: dict[str, dict[int, CompensationTable]] = {}
    for table in tables:
        if table.kind != "cross" or table.input_axis != table.output_axis or not table.direction:
            found.append(table)
            continue
        pair = ways.setdefault(table.output_axis, {})
        if table.direction in pair:
            raise TableError("E-EXCHANGE-TWICE", table.name, key=f"{table.name} {table.direction:+d}", line=0)
        pair[table.direction] = table
    for pair in ways.values():
        if len(pair) != 2:
            raise TableError("E-EXCHANGE-DIRECTION", "tables", table=next(iter(pair.values())).name)
        forward, reverse = pair[1], pair[-1]
        if not np.array_equal(forward.positions, reverse.positions) or forward.modulo != reverse.modulo:
            raise TableError("E-EXCHANGE-PAIR", "tables", table=forward.name)
        if forward.multiply_by or reverse.multiply_by:
            raise TableError("E-EXCHANGE-PAIR", "tables", table=forward.name)
        known = ReadAs(forward.output_axis, forward.output_unit)
        curves = (np.asarray(one.deviations, dtype=np.float64) for one in (forward, reverse))
        found.append(own_table(known, forward.positions, *curves, modulo=forward.modulo))
    return tuple(found)


def letter_of(table: CompensationTable, what: str, allowed: str) -> str:
    """The axis' letter for a format that names axes so. Raises TableError (E-EXCHANGE-LETTER) for another name."""
    name = table.output_axis.upper()
    if len(name) != 1 or name not in allowed:
        raise TableError("E-EXCHANGE-LETTER", what, axis=table.output_axis, known=" ".join(allowed))
    return name
