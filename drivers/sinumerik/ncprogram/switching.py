"""Blocks that switch the tables of a push: off together and proved off, then on one by one, as they were released."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from decimal import Decimal

from drivers.sinumerik.ncprogram import reversing
from drivers.sinumerik.ncprogram.backup import Memory
from drivers.sinumerik.ncprogram.motion import number
from drivers.sinumerik.tablefile.grammar import value_text
from drivers.types.orders import PushOrder
from drivers.types.tables import CompensationTable

SETTLE_S = 0.2
NOTHING = Decimal("0.0000005")


def switches(table: CompensationTable) -> tuple[str, ...]:
    """The variables that put a table to work, in the order of switching on; each is 0 while it is off."""
    if table.kind == "reversal":
        return (reversing.datum(table.index, table.output_axis),)
    if table.kind == "axis":
        return (f"$MA_ENC_COMP_ENABLE[{table.index},{table.output_axis}]",)
    return (f"$MA_CEC_ENABLE[{table.output_axis}]", f"$SN_CEC_TABLE_ENABLE[{table.index}]")


def all_switches(orders: Iterable[PushOrder]) -> tuple[str, ...]:
    """The switches of all tables, each once: tables of one output axis share that axis' switch."""
    return tuple(dict.fromkeys(switch for order in orders for switch in switches(order.table)))


def asleep(orders: Sequence[PushOrder], memory: Memory, wakes: str) -> list[str]:
    """Switching an output axis' CEC on must not put tables to work that the axis' switch kept off before."""
    ours = {order.table.index for order in orders if order.table.kind == "cross"}
    axes = {order.table.output_axis for order in orders if order.table.kind == "cross" and not order.coupled}
    out: list[str] = []
    for axis in sorted(axes):
        for other, points in enumerate(memory.cec_points):
            if points and other not in ours:
                out += [f"IF $AN_CEC_STEP[{other}]<>0", f"IF $AN_CEC_OUTPUT_AXIS[{other}]==({axis})"]
                out += [f"IF $SN_CEC_TABLE_ENABLE[{other}]<>0 GOTOF {wakes}", "ENDIF", "ENDIF"]
    return out


def switched_off(orders: Sequence[PushOrder], left: str, held: str) -> list[str]:
    """All tables off, proved switch by switch; the axes' first: where the first stays on, nothing at all has changed.

    SD41300 comes after them: anybody may write it. Where that one stays on, the axis is off already.
    """
    firsts = tuple(dict.fromkeys(switches(order.table)[0] for order in orders))
    out: list[str] = []
    for place, switch in enumerate(firsts):
        out += [f"{switch}=0", "NEWCONF", "STOPRE", f"IF {switch}<>0 GOTOF {held if place else left}"]
    for switch in all_switches(orders):
        if switch not in firsts:
            out += [f"{switch}=0", "STOPRE", f"IF {switch}<>0 GOTOF {held}"]
    return out


def disabled(orders: Sequence[PushOrder]) -> list[str]:
    """All off, whatever they read: the way out."""
    return [*(f"{switch}=0" for switch in reversed(all_switches(orders))), "NEWCONF"]


def still_acting(orders: Sequence[PushOrder], held: str) -> list[str]:
    """A switch that reads off proves nothing: the value that acts must be gone too before points are written.

    What is taken up at a reversal no public variable shows.
    """
    acting = dict.fromkeys(_acting(order.table) for order in orders if order.table.kind != "reversal")
    tests = [f"IF ABS({value})>{value_text(NOTHING)} GOTOF {held}" for value in acting]
    return [f"G4 F{number(SETTLE_S)}", "STOPRE", *tests]


def _acting(table: CompensationTable) -> str:
    if table.kind == "cross":
        return f"$VA_CEC_COMP_VAL[{table.output_axis}]"
    return f"$VA_ENC{table.index + 1}_COMP_VAL[{table.output_axis}]"


def released(variable: str, place: int) -> str:
    """Whether the table at ``place`` of the batch was released: its bit in an integer variable."""
    return f"({variable} B_AND {1 << place})<>0"


def switched_on(orders: Sequence[PushOrder], variable: str, held: str) -> list[str]:
    """Every table that was released and shall act; every switch of theirs is then read."""
    on = [(place, order) for place, order in enumerate(orders) if order.enable]
    out: list[str] = []
    for place, order in on:
        out += [f"IF {released(variable, place)}", *_on(order), "ENDIF"]
    again = [f"{switch}=1" for switch in _coupled(orders)]
    out += [*again, "NEWCONF", "STOPRE"]
    for place, order in on:
        read = [f"IF {wrong} GOTOF {held}" for wrong in _not_on(order)]
        out += [f"IF {released(variable, place)}", *read, "ENDIF"]
    return [*out, *(f"IF {switch}<>1 GOTOF {held}" for switch in _coupled(orders))]


def _on(order: PushOrder) -> list[str]:
    if order.table.kind == "reversal":
        return reversing.assignments(order)
    return [f"{switch}=1" for switch in switches(order.table)]


def _not_on(order: PushOrder) -> list[str]:
    if order.table.kind == "reversal":
        return reversing.wrong(order)
    return [f"{switch}<>1" for switch in switches(order.table)]


def _coupled(orders: Sequence[PushOrder]) -> tuple[str, ...]:
    """Axis switches that other tables of the same outputs need again, whatever becomes of these."""
    return tuple(dict.fromkeys(switches(order.table)[0] for order in orders if _is_coupled(order)))


def others_again(orders: Sequence[PushOrder], held: str, alone: str) -> list[str]:
    """The end of a batch that leaves all its tables off: other tables of a CEC output get their switch back."""
    again = outputs_again(orders, held)
    return [*again, f"GOTOF {alone}"] if again else [f"GOTOF {held}"]


def outputs_again(orders: Sequence[PushOrder], held: str) -> list[str]:
    """The switches of CEC outputs on, every table of the batch off; nothing where no output needs it."""
    again = _coupled(orders)
    on = [f"{switch}=1" for switch in again]
    return [*on, "NEWCONF", "STOPRE", *(f"IF {switch}<>1 GOTOF {held}" for switch in again)] if again else []


def _is_coupled(order: PushOrder) -> bool:
    """A trial table that is left off is switched at stops by its own switch alone: its output is on for that."""
    tried = order.purpose == "sign-proof" and not order.enable
    return order.table.kind == "cross" and (order.coupled or tried)
