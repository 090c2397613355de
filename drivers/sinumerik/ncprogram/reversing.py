"""The constant reversal of an axis in NC blocks: MD32450, which acts from NEWCONF on and is off where it is 0.

One value, so half of it can never stand in the control: it is written only behind the release. What acts is MD32450 x
MD32452 (parameter set 0, that of an axis which is no spindle); so the program divides by that factor and compares the
product. With bit 1 of MD32454 off, a cross table that moves the standing axis a micrometre back would take up the whole
value there, in the middle of a stroke: a value that is loaded sets that bit, a way back leaves it. Sources: texts of
MD32450, MD32452 and MD32454; activation NEW CONF by the same.
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


def tried(table: CompensationTable, state: str) -> list[str]:
    """A trial value switched on or off at a stop, for the proof of its sign; ``state``: 1, 0 or what holds it."""
    (value,) = (Decimal(0),) if state == "0" else tables.as_stored(table)
    name, share = datum(table.index, table.output_axis), factor(table.output_axis)
    held = "" if state in ("0", "1") else f"{state}*"
    return ["STOPRE", f"{name}={held}{_bracketed(value) if held else value_text(value)}/{share}", "NEWCONF", "STOPRE"]


def _bracketed(value: Decimal) -> str:
    return f"({value_text(value)})" if value < 0 else value_text(value)


def mode(encoder: int, axis: str) -> str:
    """MD32454 of an axis' measuring system: bit 1 keeps the value from answering to movements of other tables."""
    return f"$MA_BACKLASH_MODE[{encoder},{axis}]"


def assignments(order: PushOrder) -> list[str]:
    """The blocks that write the value; it acts from the next NEWCONF on."""
    (value,) = tables.values_of(order)
    encoder, axis = order.table.index, order.table.output_axis
    deaf = [f"{mode(encoder, axis)}={mode(encoder, axis)} B_OR 2"] if order.purpose == "table" else []
    return [*deaf, f"{datum(encoder, axis)}={value_text(value)}/{factor(axis)}"]


def wrong(order: PushOrder) -> list[str]:
    """Conditions that what stands there, with the factor, is another value, or answers to other tables' movements."""
    (value,) = tables.values_of(order)
    encoder, axis = order.table.index, order.table.output_axis
    hears = [f"({mode(encoder, axis)} B_AND 2)==0"] if order.purpose == "table" else []
    return [*hears, f"ABS({datum(encoder, axis)}*{factor(axis)}-({value_text(value)}))>{value_text(_HALF_UNIT)}"]
