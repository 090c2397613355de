"""PushOrder -> NC program text: the two halves of a table push.

First half: back up, move to the agreeing position, disable, write everything, compare everything, write a
read-back file, stop. Second half: enable only if the gateway released this very transaction and nothing
changed meanwhile. Every other way out leaves the compensation disabled. MD38000 and MD18342 are not touched.
"""

from __future__ import annotations

from decimal import Decimal

from drivers.errors import TooManyPoints
from drivers.sinumerik.ncprogram import backup
from drivers.sinumerik.ncprogram.backup import Memory, Saving, Section
from drivers.sinumerik.ncprogram.heads import Head, headed, section
from drivers.sinumerik.ncprogram.measuring import (
    PREPARE,
    Setting,
    check_names,
    file_failed,
    phase_block,
    text_of,
    unless_aborted,
)
from drivers.sinumerik.ncprogram.motion import Motion, number
from drivers.sinumerik.ncprogram.words import Phase, Word, Words, file_path, program_path
from drivers.sinumerik.tablefile import tables
from drivers.sinumerik.tablefile.grammar import value_text
from drivers.types.orders import PushOrder
from drivers.types.tables import CompensationTable

SETTLE_S = 0.2
NOTHING = Decimal("0.0000005")
FINEST = Decimal("0.000000001")  # below this the control's own decimals differ from its binary value
_HELD, _LEFT, _FAILED, _COMPARE = "TF_HELD", "TF_LEFT", "TF_FAILED", "TF_COMPARE"
_WAKES, _ALONE = "TF_WAKES", "TF_ALONE"
_HALF = "UHALF"
_STOPS = "press RESET and grind nothing: the table is off or half written. trueflank recover puts the old one back."


def loaded_message(order: PushOrder, words: Words) -> str:
    """The operator's message at the M0 between the two halves."""
    release = f"{words.name(Word.RELEASE)}={order.transaction}"
    return f"TRUEFLANK LOADED {order.table.name} NC START WHEN {release}"


def activate_message(axis: str) -> str:
    """The operator's message after the table was switched on."""
    return f"TRUEFLANK ACTIVATE NCK RESET AND REFERENCE {axis}"


def pushing(order: PushOrder, setting: Setting) -> str:
    """The one program with both halves: load and prove, M0, then enable if it was released."""
    half = [f'MSG("{loaded_message(order, setting.words)}")', "M0", 'MSG("")', "STOPRE"]
    return _program("PUSH", order, setting, [*_first_half(order, setting), *half, *_second_half(order, setting)])


def loading(order: PushOrder, setting: Setting) -> str:
    """The first half alone, for controls that give no file out while a program waits."""
    return _program("LOAD", order, setting, [*_first_half(order, setting), "M30"])


def enabling(order: PushOrder, setting: Setting) -> str:
    """The second half alone; it checks the words that `loading` left and every point again."""
    return _program("ENAB", order, setting, _second_half(order, setting))


def _program(kind: str, order: PushOrder, setting: Setting, body: list[str]) -> str:
    words = setting.words
    check = _section(order, setting, body)
    ends = [section("ways out, the table off"), f"{_HELD}:", "STOPRE", *_disable(order.table), "STOPRE"]
    ends += [phase_block(words, Phase.ENDED_DISABLED), 'MSG("")', "M30"]
    ends += [f"{_LEFT}:", "STOPRE", phase_block(words, Phase.LEFT), "M30"]
    ends += file_failed(words, _FAILED)
    if order.table.kind == "cross":
        ends += [f"{_WAKES}:", "STOPRE", phase_block(words, Phase.WOULD_WAKE), "M30"]
        ends += [f"{_ALONE}:", "STOPRE", phase_block(words, Phase.ENDED_DISABLED), 'MSG("")', "M30"]
    begin = [f"DEF INT {backup.VARIABLES}, {_HALF}", section("modal states, R words"), *PREPARE]
    return text_of(headed(_head(kind, order, setting), [*begin, *body, *check, *ends]))


def _head(kind: str, order: PushOrder, setting: Setting) -> Head:
    table = order.table
    parts = {
        "PUSH": "load and, after the release, enable",
        "LOAD": "load, table left off",
        "ENAB": "enable what LOAD wrote",
    }
    what = f"{parts[kind]} {table.name}, {len(table.deviations)} points ({order.purpose})"
    names = " and ".join(file_path(name, table.output_axis) for name in ("BACK", "READ"))
    saved = f" Saves old and new table in {names}." if kind != "ENAB" else ""
    also = f"Switching the table off or on moves {table.output_axis} by the table's value.{saved}"
    return Head(
        program_path(kind, table.output_axis),
        what,
        number=order.transaction,
        stops=_STOPS,
        origin=setting.origin,
        also=also,
    )


def _first_half(order: PushOrder, setting: Setting) -> list[str]:
    table, words = order.table, setting.words
    check_names(table.output_axis, table.input_axis, order.letter)
    out = [f"{words.name(word)}=0" for word in (Word.COUNTER, Word.MISMATCHES, Word.RELEASE)]
    out += [f"{words.name(word)}={value}" for word, value in _identity(order, setting).items()]
    out += [phase_block(words, Phase.BACKING_UP), "STOPRE", unless_aborted(words, _LEFT)]
    out += [section("old table into a file"), *backup.blocks(saving("BACK", order, setting.memory), _FAILED)]
    out += _asleep(order, setting)
    out += [section("to where old and new table agree; the table off")]
    out += [_go(order, setting), "STOPRE", *_switched_off(table)]
    out += [*_still_acting(table), phase_block(words, Phase.DISABLED)]
    out += [section("new table"), *_write(order, setting), "STOPRE", phase_block(words, Phase.WRITTEN)]
    out += [f"{_HALF}=1", f"GOTOF {_COMPARE}", f"{_COMPARE}_1:"]
    out += [section("what was written into a file"), *backup.blocks(saving("READ", order, setting.memory), _HELD)]
    out += [f"IF {words.name(Word.MISMATCHES)}<>0 GOTOF {_HELD}", "STOPRE"]
    return [*out, phase_block(words, Phase.WAITING)]


def _second_half(order: PushOrder, setting: Setting) -> list[str]:
    """Enable only if everything is as the first half left it and the gateway released this transaction."""
    table, words = order.table, setting.words
    wanted = {Word.RELEASE: str(order.transaction), Word.ABORT: "0", Word.MISMATCHES: "0"}
    wanted |= {Word.PHASE: str(int(Phase.WAITING))} | _identity(order, setting)
    out = [section("second half: enable only what was released and is as it was written")]
    out += [f"IF {words.name(word)}<>{value} GOTOF {_HELD}" for word, value in wanted.items()]
    out += [f"IF {switch}<>0 GOTOF {_HELD}" for switch in switches(table)]
    out += [_go(order, setting), "STOPRE", f"{_HALF}=2", f"GOTOF {_COMPARE}", f"{_COMPARE}_2:"]
    out += [f"IF {words.name(Word.MISMATCHES)}<>0 GOTOF {_HELD}"]
    if not order.enable:
        return [*out, *_others_again(order)]
    out += [f"{switch}=1" for switch in switches(table)]
    out += ["NEWCONF", "STOPRE"]
    out += [f"IF {switch}<>1 GOTOF {_HELD}" for switch in switches(table)]
    out += [phase_block(words, Phase.ENABLED), f'MSG("{activate_message(table.output_axis)}")']
    return [*out, "M0", 'MSG("")', "M30"]


def _section(order: PushOrder, setting: Setting, body: list[str]) -> list[str]:
    """The comparison of every parameter and point, entered by a jump from either half and left back to it."""
    halves = [half for half in (1, 2) if f"{_COMPARE}_{half}:" in body]
    back = [f"IF {_HALF}=={half} GOTOB {_COMPARE}_{half}" for half in halves]
    return [
        section("every parameter and point compared"),
        f"{_COMPARE}:",
        "STOPRE",
        *_compare(order, setting),
        *back,
        f"GOTOF {_HELD}",
    ]


def _identity(order: PushOrder, setting: Setting) -> dict[Word, str]:
    table = order.table
    kind = 1000 if table.kind == "axis" else 2000
    return {
        Word.TRANSACTION: str(order.transaction),
        Word.TABLE: str(kind + table.index),
        Word.AXIS: str(setting.axis_number),
        Word.POINTS: str(len(table.deviations)),
    }


def switches(table: CompensationTable) -> tuple[str, ...]:
    """The variables that put a table to work, in the order of switching on."""
    if table.kind == "axis":
        return (f"$MA_ENC_COMP_ENABLE[{table.index},{table.output_axis}]",)
    return (f"$MA_CEC_ENABLE[{table.output_axis}]", f"$SN_CEC_TABLE_ENABLE[{table.index}]")


def _asleep(order: PushOrder, setting: Setting) -> list[str]:
    """Switching the output axis' CEC on must not put tables to work that the axis' switch kept off before."""
    table = order.table
    if table.kind != "cross" or order.coupled:
        return []
    out: list[str] = []
    for other, points in enumerate(setting.memory.cec_points):
        if points and other != table.index:
            out += [f"IF $AN_CEC_STEP[{other}]<>0", f"IF $AN_CEC_OUTPUT_AXIS[{other}]==({table.output_axis})"]
            out += [f"IF $SN_CEC_TABLE_ENABLE[{other}]<>0 GOTOF {_WAKES}", "ENDIF", "ENDIF"]
    return out


def _others_again(order: PushOrder) -> list[str]:
    """The end of an order that leaves its table off: the other tables of a CEC output get their switch back."""
    if order.table.kind != "cross" or not order.coupled:
        return [f"GOTOF {_HELD}"]
    axis_switch = switches(order.table)[0]
    return [f"{axis_switch}=1", "NEWCONF", "STOPRE", f"IF {axis_switch}<>1 GOTOF {_HELD}", f"GOTOF {_ALONE}"]


def _switched_off(table: CompensationTable) -> list[str]:
    """The table off, proved switch by switch; the axis' first: where it stays on, nothing at all has changed.

    SD41300 comes after it: anybody may write it. Where that one stays on, the axis is off already.
    """
    first, *rest = switches(table)
    out = [f"{first}=0", "NEWCONF", "STOPRE", f"IF {first}<>0 GOTOF {_LEFT}"]
    for switch in rest:
        out += [f"{switch}=0", "STOPRE", f"IF {switch}<>0 GOTOF {_HELD}"]
    return out


def _disable(table: CompensationTable) -> list[str]:
    return [*(f"{switch}=0" for switch in reversed(switches(table))), "NEWCONF"]


def _still_acting(table: CompensationTable) -> list[str]:
    """A switch that reads off proves nothing: the value that acts must be gone too before points are written."""
    acting = f"$VA_ENC{table.index + 1}_COMP_VAL[{table.output_axis}]"
    if table.kind == "cross":
        acting = f"$VA_CEC_COMP_VAL[{table.output_axis}]"
    return [f"G4 F{number(SETTLE_S)}", "STOPRE", f"IF ABS({acting})>{value_text(NOTHING)} GOTOF {_HELD}"]


def saving(section: Section, order: PushOrder, memory: Memory) -> Saving:
    """What the order's program writes to a file, and what proves that it did."""
    return Saving(
        section=section,
        number=order.transaction,
        axis=order.table.output_axis,
        encoder=order.saved_encoder,
        memory=memory,
    )


def _go(order: PushOrder, setting: Setting) -> str:
    return Motion(order.letter, setting.modulo, setting.approach_feed).to(order.agreeing_position)


def reserved_points(table: CompensationTable, memory: Memory) -> int:
    """Points the control holds for this table."""
    if table.kind == "axis":
        return memory.eec_points
    return memory.cec_points[table.index] if table.index < len(memory.cec_points) else 0


def _write(order: PushOrder, setting: Setting) -> list[str]:
    """Every parameter, every point and a zero for each point that an older table may have left behind."""
    table, values = order.table, tables.values_of(order)
    reserved = reserved_points(table, setting.memory)
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


def _compare(order: PushOrder, setting: Setting) -> list[str]:
    table, values = order.table, tables.values_of(order)
    miss = setting.words.name(Word.MISMATCHES)
    count = [f"{miss}={miss}+1", "ENDIF"]
    half_unit = value_text(max(Decimal(5).scaleb(-_places(values) - 1), FINEST))
    out = [f"{miss}=0"]
    for name, value in tables.parameters(table).items():
        out += [f"IF {_differs(name, value, half_unit)}", *count]
    for place, stored in enumerate(values):
        name = tables.point_name(table, place)
        out += [f"IF {_differs(name, value_text(stored), half_unit)}", *count]
    reserved = reserved_points(table, setting.memory)
    if len(values) < reserved:
        leftover = tables.point_name(table, backup.POINT)
        out += [f"FOR {backup.POINT}={len(values)} TO {reserved - 1}", f"IF {leftover}<>0", *count, "ENDFOR"]
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
