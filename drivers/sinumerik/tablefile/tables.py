"""The kinds of tables that an 840D holds, whichever road leads to it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from decimal import ROUND_HALF_EVEN, Decimal
from math import isfinite

from drivers.errors import TableError, ValueOutOfRange
from drivers.limits import VALUE_RESOLUTION
from drivers.sinumerik.tablefile.grammar import DECIMALS, FINEST_POSITION, LARGEST, grid_text, value_text
from drivers.sinumerik.tablefile.reader import SCALE
from drivers.types.abilities import TableAbility
from drivers.types.orders import PushOrder, SignProof
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from drivers.types.values import Sense

# The kinds of tables that an 840D holds, whichever road leads to it.

HELD_KINDS = (TableAbility("axis"), TableAbility("cross", directions="tables"))
"""Points of equal step, as many as the machine data reserve; a direction of travel has a cross table of its own."""
REVERSAL = TableAbility("reversal")
"""MD32450: one value for an axis, on the roads that can write it."""


# Tables in the control's form.


def sense_of(proof: SignProof | None) -> Sense:
    """The sense in which cross tables are deviations by a proof; as they stand without one of their kind."""
    return proof.sense if proof is not None else 1


def order_sense(order: PushOrder) -> Sense:
    """The sense of an order's cross tables: an order for an axis table leaves them as they stand."""
    return sense_of(order.proof) if order.table.kind == "cross" else 1


def table_by_proof(table: CompensationTable, sense: Sense, proof: SignProof | None) -> CompensationTable:
    """A table that was read or kept in ``sense`` as a deviation by ``proof``; an axis table as it is."""
    if table.kind != "cross" or sense == sense_of(proof):
        return table
    return replace(table, deviations=_minus(table.deviations), reverse=_minus(table.reverse))


def tables_by_proof(live: LiveSet, proof: SignProof | None) -> LiveSet:
    """The same set with its cross tables as deviations by ``proof``: as stored where that is None."""

    def turned(tables: tuple[LiveTable, ...]) -> tuple[LiveTable, ...]:
        return tuple(replace(one, table=table_by_proof(one.table, live.sense, proof)) for one in tables)

    return replace(live, cross=turned(live.cross), others=turned(live.others), sense=sense_of(proof))


def _minus(values: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(-value + 0.0 for value in values)


def stored_values(table: CompensationTable, proof: SignProof | None = None) -> tuple[Decimal, ...]:
    """The values for the control, mm or deg, exact to ten decimals: EEC +d, CEC d times the proven sign.

    Raises TableError E-TABLE-NO-PROOF for CEC without this machine's proof, ValueOutOfRange
    E-TABLE-FINITE for a value that is no number.
    """
    return _stored(table, written_sign(table, proof))


def written_sign(table: CompensationTable, proof: SignProof | None) -> Sense:
    """What d is multiplied with. Raises TableError (E-TABLE-NO-PROOF, E-TABLE-SIGN)."""
    if proof is not None and (proof.kind, proof.output_axis) != (table.kind, table.output_axis):
        proof = None
    if table.kind == "cross":
        if proof is None:
            raise TableError("E-TABLE-NO-PROOF", table.name, table=table.name, function="CEC")
        return proof.sign
    if proof is not None and proof.sign != 1:
        raise TableError("E-TABLE-SIGN", table.name, table=table.name, slope=proof.slope)
    return 1


def stored_as_read(table: CompensationTable) -> tuple[Decimal, ...]:
    """The values of a table that was read without proof: what stood in the control, sign untouched."""
    return _stored(table, 1)


def _stored(table: CompensationTable, sign: Sense) -> tuple[Decimal, ...]:
    if not table.is_plain:
        raise TableError("E-TABLE-PLAIN", table.name, table=table.name)
    scale, places = SCALE[table.output_unit], Decimal(1).scaleb(-DECIMALS)
    if table.kind == "reversal":  # MD32450 is positive where the encoder leads, which is B < 0
        scale = -scale
    values, largest = [], float(LARGEST * abs(scale))
    for number, deviation in enumerate(table.deviations):
        if not isfinite(deviation) or abs(deviation) > largest:
            raise ValueOutOfRange("E-TABLE-FINITE", table.name, point=number, value=deviation)
        value = (Decimal(repr(float(deviation))) * sign / scale).quantize(places, ROUND_HALF_EVEN)
        values.append(value + 0 if value else Decimal(0))
    return tuple(values)


def quantise(table: CompensationTable, resolution: float = VALUE_RESOLUTION) -> CompensationTable:
    """The table with every value at the nearest multiple of ``resolution`` (mm or deg). Idempotent."""
    unit, scale = Decimal(repr(resolution)), SCALE[table.output_unit] * (-1 if table.kind == "reversal" else 1)
    steps = ((value / unit).to_integral_value(ROUND_HALF_EVEN) * unit for value in stored_as_read(table))
    return replace(table, deviations=tuple(float(value * scale) + 0.0 for value in steps))


def order_values(order: PushOrder) -> tuple[Decimal, ...]:
    """The values an order writes: new tables at the resolution, a restored one exactly as it was read.

    Raises TableError (E-TABLE-NO-PROOF, E-TABLE-SIGN), ValueOutOfRange (E-TABLE-FINITE).
    """
    if order.purpose == "restore":
        return stored_values(order.table, order.proof) if order.proof else stored_as_read(order.table)
    table = quantise(order.table)
    if order.purpose == "table":
        if order.proof is None:
            raise TableError("E-TABLE-NO-PROOF", table.name, table=table.name, function=table.kind)
        return stored_values(table, order.proof)
    return stored_as_read(table)


def point_lines(table: CompensationTable, values: Iterable[Decimal]) -> list[str]:
    """One assignment for each interpolation point; a reversal has none."""
    if table.kind == "reversal":
        return []
    return [f"{point_name(table, number)}={value_text(value)}" for number, value in enumerate(values)]


def point_name(table: CompensationTable, number: int | str) -> str:
    """The control's name of one interpolation point; ``number`` may be a program's own variable."""
    if table.kind == "axis":
        return f"$AA_ENC_COMP[{table.index},{number},{table.output_axis}]"
    return f"$AN_CEC[{table.index},{number}]"


def parameters(table: CompensationTable) -> dict[str, str]:
    """Name and value of everything but the points, as the control takes them."""
    grid = {
        "STEP": _position(table.step),
        "MIN": _position(table.minimum),
        "MAX": _position(table.maximum),
        "IS_MODULO": str(int(table.modulo)),
    }
    if table.kind == "reversal":
        return {}
    if table.kind == "axis":
        tail = f"[{table.index},{table.output_axis}]"
        return {f"$AA_ENC_COMP_{name}{tail}": value for name, value in grid.items()}
    cross = {
        "INPUT_AXIS": f"({table.input_axis})",
        "OUTPUT_AXIS": f"({table.output_axis})",
        **grid,
        "DIRECTION": str(table.direction),
        "MULT_BY_TABLE": str(table.multiply_by),
        "TYPE": str(table.table_type),
    }
    return {f"$AN_CEC_{name}[{table.index}]": value for name, value in cross.items()}


def parameter_lines(table: CompensationTable) -> list[str]:
    """One assignment for each parameter."""
    return [f"{name}={value}" for name, value in parameters(table).items()]


def _position(value: float) -> str:
    if not isfinite(value) or abs(value) > 1e5 or 0.0 < abs(value) < FINEST_POSITION:
        raise ValueOutOfRange("E-TABLE-FINITE", "grid", point="grid", value=value)
    return grid_text(value)
