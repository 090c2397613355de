"""Blocks that switch tables off, prove it, and switch them on; and the program that only switches one table off.

Switching off is proved in two steps, because a switch that reads off proves nothing: every switch must read 0, and the
value that acts on the axis must be gone too. Tables of one CEC output axis share the switch of that axis, so it is
restored at the end for tables that are not part of the batch.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from decimal import Decimal

from drivers.sinumerik.ncprogram import backup
from drivers.sinumerik.ncprogram.backup import ReservedPoints
from drivers.sinumerik.ncprogram.blocks import ProgramHead, add_head, format_number, section_comment
from drivers.sinumerik.ncprogram.measuring import (
    PREPARE,
    MachineSetting,
    check_names,
    leave_if_aborted,
    phase_block,
    program_text,
)
from drivers.sinumerik.ncprogram.words import FAMILY, Phase, Word, program_path
from drivers.sinumerik.tablefile.grammar import value_text
from drivers.types.orders import DisableOrder, PushOrder
from drivers.types.tables import CompensationTable

# All tables of a push.

SETTLE_S = 0.2
LARGEST_RESIDUE = Decimal("0.0000005")


def switches(table: CompensationTable) -> tuple[str, ...]:
    """The variables that put a table to work, in the order of switching on; each is 0 while it is off."""
    if table.kind == "reversal":
        return (backup.backlash_datum(table.index, table.output_axis),)
    if table.kind == "axis":
        return (f"$MA_ENC_COMP_ENABLE[{table.index},{table.output_axis}]",)
    return (f"$MA_CEC_ENABLE[{table.output_axis}]", f"$SN_CEC_TABLE_ENABLE[{table.index}]")


def all_switches(orders: Iterable[PushOrder]) -> tuple[str, ...]:
    """The switches of all tables, each once: tables of one output axis share that axis' switch."""
    return tuple(dict.fromkeys(switch for order in orders for switch in switches(order.table)))


def sleeping_conditions(orders: Sequence[PushOrder], memory: ReservedPoints, wakes: str) -> list[str]:
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


def switch_off_blocks(orders: Sequence[PushOrder], left: str, held: str) -> list[str]:
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


def disable_blocks(orders: Sequence[PushOrder]) -> list[str]:
    """All off, whatever they read: the way out."""
    return [*(f"{switch}=0" for switch in reversed(all_switches(orders))), "NEWCONF"]


def acting_conditions(orders: Sequence[PushOrder], held: str) -> list[str]:
    """A switch that reads off proves nothing: the value that acts must be gone too before points are written.

    What is taken up at a reversal no public variable shows.
    """
    acting = dict.fromkeys(_acting(order.table) for order in orders if order.table.kind != "reversal")
    tests = [f"IF ABS({value})>{value_text(LARGEST_RESIDUE)} GOTOF {held}" for value in acting]
    return [f"G4 F{format_number(SETTLE_S)}", "STOPRE", *tests]


def _acting(table: CompensationTable) -> str:
    if table.kind == "cross":
        return f"$VA_CEC_COMP_VAL[{table.output_axis}]"
    return f"$VA_ENC{table.index + 1}_COMP_VAL[{table.output_axis}]"


def released_condition(variable: str, place: int) -> str:
    """Whether the table at ``place`` of the batch was released: its bit in an integer variable."""
    return f"({variable} B_AND {1 << place})<>0"


def switch_on_blocks(orders: Sequence[PushOrder], variable: str, held: str) -> list[str]:
    """Every table that was released and shall act; every switch of theirs is then read."""
    on = [(place, order) for place, order in enumerate(orders) if order.enable]
    out: list[str] = []
    for place, order in on:
        out += [f"IF {released_condition(variable, place)}", *_on(order), "ENDIF"]
    again = [f"{switch}=1" for switch in _coupled(orders)]
    out += [*again, "NEWCONF", "STOPRE"]
    for place, order in on:
        read = [f"IF {wrong} GOTOF {held}" for wrong in _not_on(order)]
        out += [f"IF {released_condition(variable, place)}", *read, "ENDIF"]
    return [*out, *(f"IF {switch}<>1 GOTOF {held}" for switch in _coupled(orders))]


def _on(order: PushOrder) -> list[str]:
    if order.table.kind == "reversal":
        return backup.backlash_assignments(order)
    return [f"{switch}=1" for switch in switches(order.table)]


def _not_on(order: PushOrder) -> list[str]:
    if order.table.kind == "reversal":
        return backup.backlash_mismatches(order)
    return [f"{switch}<>1" for switch in switches(order.table)]


def _coupled(orders: Sequence[PushOrder]) -> tuple[str, ...]:
    """Axis switches that other tables of the same outputs need again, whatever becomes of these."""
    return tuple(dict.fromkeys(switches(order.table)[0] for order in orders if _is_coupled(order)))


def restore_other_tables(orders: Sequence[PushOrder], held: str, alone: str) -> list[str]:
    """The end of a batch that leaves all its tables off: other tables of a CEC output get their switch back."""
    again = restore_outputs(orders, held)
    return [*again, f"GOTOF {alone}"] if again else [f"GOTOF {held}"]


def restore_outputs(orders: Sequence[PushOrder], held: str) -> list[str]:
    """The switches of CEC outputs on, every table of the batch off; nothing where no output needs it."""
    again = _coupled(orders)
    on = [f"{switch}=1" for switch in again]
    return [*on, "NEWCONF", "STOPRE", *(f"IF {switch}<>1 GOTOF {held}" for switch in again)] if again else []


def _is_coupled(order: PushOrder) -> bool:
    """A trial table that is left off is switched at stops by its own switch alone: its output is on for that."""
    tried = order.purpose == "sign-proof" and not order.enable
    return order.table.kind == "cross" and (order.coupled or tried)


# DisableOrder -> NC program text: one table is switched off, and nothing else is done.
#
# No point and no parameter is written and no axis is moved by the program. It says that the table is off only when its
# switches read so and nothing acts any more; M30 ends it either way, and nothing waits for an answer.

DISABLE_SETTLE_S = 0.5
_LEFT, _ON = "TF_LEFT", "TF_ON"
_STOPS = "press RESET: the table may be on or off; start the order again or look at its switch on the screen."


def build_disable_program(order: DisableOrder, setting: MachineSetting) -> str:
    """The whole program. Raises LocalProtocolError (E-PROGRAM-NAME)."""
    check_names(order.axis)
    words = setting.words
    out = [
        section_comment("modal states, R words"),
        *PREPARE,
        *(f"{words.name(word)}=0" for word in (Word.COUNTER, Word.MISMATCHES, Word.RELEASE)),
    ]
    out += [f"{words.name(word)}={value}" for word, value in _identity(order, setting).items()]
    out += [
        section_comment("the table off"),
        "STOPRE",
        leave_if_aborted(words, _LEFT),
        *(f"{switch}=0" for switch in order_switches(order)),
    ]
    out += ["NEWCONF", f"G4 F{format_number(DISABLE_SETTLE_S)}", "STOPRE"]
    out += [f"IF {switch}<>0 GOTOF {_ON}" for switch in order_switches(order)]
    if order.kind != "reversal":  # no public variable shows what is taken up
        out += [f"IF ABS({acting_variable(order)})>{value_text(LARGEST_RESIDUE)} GOTOF {_ON}"]
    out += [section_comment("ways out")]
    for label, phase in (("", Phase.SWITCHED_OFF), (_ON, Phase.STILL_ON), (_LEFT, Phase.LEFT)):
        out += [f"{label}:"] if label else []
        out += ["STOPRE", phase_block(words, phase), "M30"]
    what = f"switch the {order.kind} table {order.index} of {order.axis} off, nothing else"
    also = f"Switching the table off moves {order.axis} by the table's value."
    path = program_path("OFF", order.axis)
    return program_text(add_head(ProgramHead(path, what, stops=_STOPS, origin=setting.origin, also=also), out))


def order_switches(order: DisableOrder) -> tuple[str, ...]:
    """The variables that put the table to work, in the order of switching off."""
    if order.kind == "reversal":
        return (backup.backlash_datum(order.index, order.axis),)
    if order.kind == "axis":
        return (f"$MA_ENC_COMP_ENABLE[{order.index},{order.axis}]",)
    return (f"$SN_CEC_TABLE_ENABLE[{order.index}]", f"$MA_CEC_ENABLE[{order.axis}]")


def acting_variable(order: DisableOrder) -> str:
    """The system variable that shows what acts on the axis."""
    return (
        f"$VA_ENC{order.index + 1}_COMP_VAL[{order.axis}]"
        if order.kind == "axis"
        else (f"$VA_CEC_COMP_VAL[{order.axis}]")
    )


def _identity(order: DisableOrder, setting: MachineSetting) -> dict[Word, int]:
    return {
        Word.TRANSACTION: order.transaction,
        Word.TABLE: FAMILY[order.kind] + order.index,
        Word.AXIS: setting.axis_number,
        Word.POINTS: 0,
    }
