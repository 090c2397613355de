"""The constant reversal of an axis in NC blocks: MD32450, which acts from NEWCONF on and is off where it is 0.

One value, so half of it can never stand in the control: it is written only behind the release. What acts is MD32450 x
MD32452 (parameter set 0, that of an axis which is no spindle); so the program divides by that factor and compares the
product. Sources: texts of MD32450 and MD32452; activation NEW CONF by the same.
"""

from __future__ import annotations

from decimal import Decimal

from drivers.sinumerik.tablefile import tables
from drivers.sinumerik.tablefile.grammar import value_text
from drivers.types.orders import PushOrder
from drivers.types.tables import CompensationTable

_HALF_UNIT = Decimal("0.0000005")


def datum(encoder: int, axis: str) -> str:
    """MD32450 of an axis' measuring system: on where it is not 0."""
    return f"$MA_BACKLASH[{encoder},{axis}]"


def factor(axis: str) -> str:
    """MD32452 of an axis in parameter set 0."""
    return f"$MA_BACKLASH_FACTOR[0,{axis}]"


def tried(table: CompensationTable, on: bool) -> list[str]:
    """A trial value switched on or off at a stop, for the proof of its sign."""
    (value,) = tables.as_stored(table) if on else (Decimal(0),)
    name, share = datum(table.index, table.output_axis), factor(table.output_axis)
    return ["STOPRE", f"{name}={value_text(value)}/{share}", "NEWCONF", "STOPRE"]


def assignment(order: PushOrder) -> str:
    """The block that writes the value; it acts from the next NEWCONF on."""
    (value,) = tables.values_of(order)
    return f"{datum(order.table.index, order.table.output_axis)}={value_text(value)}/{factor(order.table.output_axis)}"


def other(order: PushOrder) -> str:
    """The condition that what stands there, with the factor, is another value."""
    (value,) = tables.values_of(order)
    acts = f"{datum(order.table.index, order.table.output_axis)}*{factor(order.table.output_axis)}"
    return f"ABS({acts}-({value_text(value)}))>{value_text(_HALF_UNIT)}"
