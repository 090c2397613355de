"""Blocks that write one table of a push, and that compare what the control then holds, value by value."""

from __future__ import annotations

from decimal import Decimal

from drivers.errors import TooManyPoints
from drivers.sinumerik.ncprogram import backup
from drivers.sinumerik.ncprogram.backup import Memory
from drivers.sinumerik.tablefile import tables
from drivers.sinumerik.tablefile.grammar import value_text
from drivers.types.orders import PushOrder
from drivers.types.tables import CompensationTable

FINEST = Decimal("0.000000001")  # below this the control's own decimals differ from its binary value


def reserved_points(table: CompensationTable, memory: Memory) -> int:
    """Points the control holds for this table."""
    if table.kind != "cross":
        return memory.eec_points if table.kind == "axis" else 1
    return memory.cec_points[table.index] if table.index < len(memory.cec_points) else 0


def written(order: PushOrder, memory: Memory) -> list[str]:
    """Every parameter, every point and a zero for each point that an older table may have left behind.

    A reversal has none of them: its one value is written where it is switched on.

    Raises TooManyPoints (E-TABLE-POINTS) and as `tables.values_of`.
    """
    table, values = order.table, tables.values_of(order)
    reserved = reserved_points(table, memory)
    if len(values) > reserved:
        raise TooManyPoints(
            "E-TABLE-POINTS", table.output_axis, table=table.name, points=len(values), reserved=reserved
        )
    out = tables.parameter_lines(table) + tables.point_lines(table, values)
    if len(values) < reserved:
        out += [
            f"FOR {backup.POINT}={len(values)} TO {reserved - 1}",
            f"{tables.point_name(table, backup.POINT)}=0",
            "ENDFOR",
        ]
    return out


def compared(order: PushOrder, memory: Memory, count: str) -> list[str]:
    """Every parameter and point against what was sent; ``count`` is the variable that counts what differs."""
    table, values = order.table, tables.values_of(order)
    if table.kind == "reversal":
        return [f"{count}=0"]
    more = [f"{count}={count}+1", "ENDIF"]
    half_unit = value_text(max(Decimal(5).scaleb(-_places(values) - 1), FINEST))
    out = [f"{count}=0"]
    for name, value in tables.parameters(table).items():
        out += [f"IF {_differs(name, value, half_unit)}", *more]
    for place, stored in enumerate(values):
        name = tables.point_name(table, place)
        out += [f"IF {_differs(name, value_text(stored), half_unit)}", *more]
    reserved = reserved_points(table, memory)
    if len(values) < reserved:
        leftover = tables.point_name(table, backup.POINT)
        out += [f"FOR {backup.POINT}={len(values)} TO {reserved - 1}", f"IF {leftover}<>0", *more, "ENDFOR"]
    return out


def _differs(name: str, value: str, half_unit: str) -> str:
    if value.startswith("("):
        return f"{name}<>{value}"
    if "." not in value:
        return f"{name}<>{value}"
    other = f"+{value[1:]}" if value.startswith("-") else f"-{value}"
    return f"ABS({name}{other})>{half_unit}"


def _places(values: tuple[Decimal, ...]) -> int:
    """Decimals of the finest value, six at least: the comparison allows half a unit of the last place."""
    return max(len(value_text(value).partition(".")[2]) for value in values)
