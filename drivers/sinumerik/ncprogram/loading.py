"""Blocks that write one table of a push, and that compare what the control then holds, value by value."""

from __future__ import annotations

from decimal import Decimal

from drivers.errors import TooManyPoints
from drivers.sinumerik.ncprogram import backup
from drivers.sinumerik.ncprogram.backup import Memory
from drivers.sinumerik.ncprogram.looping import Array
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


def array_of(order: PushOrder, place: int) -> Array | None:
    """The values of one table of a batch as a table of the program's own; None for a reversal, which is one value.

    Raises as `tables.values_of`.
    """
    if order.table.kind == "reversal":
        return None
    return Array(f"UTABLE{place + 1}", "REAL", tuple(value_text(value) for value in tables.values_of(order)))


def written(order: PushOrder, memory: Memory, array: Array | None) -> list[str]:
    """Every parameter, every point and a zero for each point that an older table may have left behind.

    The points from ``array``, one by one where that is None. A reversal has none of them: its one value is written
    where it is switched on.

    Raises TooManyPoints (E-TABLE-POINTS) and as `tables.values_of`.
    """
    table, values = order.table, tables.values_of(order)
    reserved = reserved_points(table, memory)
    if len(values) > reserved:
        raise TooManyPoints(
            "E-TABLE-POINTS", table.output_axis, table=table.name, points=len(values), reserved=reserved
        )
    point = tables.point_name(table, backup.POINT) if table.kind != "reversal" else ""
    out = tables.parameter_lines(table)
    if array is None:
        out += tables.point_lines(table, values)
    else:
        out += [f"FOR {backup.POINT}=0 TO {len(values) - 1}", f"{point}={array.name}[{backup.POINT}]", "ENDFOR"]
    if len(values) < reserved:
        out += [f"FOR {backup.POINT}={len(values)} TO {reserved - 1}", f"{point}=0", "ENDFOR"]
    return out


def compared(order: PushOrder, memory: Memory, count: str, array: Array | None) -> list[str]:
    """Every parameter and point against what was sent; ``count`` is the variable that counts what differs."""
    table, values = order.table, tables.values_of(order)
    if table.kind == "reversal":
        return [f"{count}=0"]
    more = [f"{count}={count}+1", "ENDIF"]
    half_unit = value_text(max(Decimal(5).scaleb(-_places(values) - 1), FINEST))
    out = [f"{count}=0"]
    for name, value in tables.parameters(table).items():
        out += [f"IF {_differs(name, value, half_unit)}", *more]
    point = tables.point_name(table, backup.POINT)
    if array is not None:
        differs = f"IF ABS({point}-{array.name}[{backup.POINT}])>{half_unit}"
        out += [f"FOR {backup.POINT}=0 TO {len(values) - 1}", differs, *more, "ENDFOR"]
    else:
        for place, stored in enumerate(values):
            out += [f"IF {_differs(tables.point_name(table, place), value_text(stored), half_unit)}", *more]
    reserved = reserved_points(table, memory)
    if len(values) < reserved:
        out += [f"FOR {backup.POINT}={len(values)} TO {reserved - 1}", f"IF {point}<>0", *more, "ENDFOR"]
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
