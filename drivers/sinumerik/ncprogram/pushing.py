"""A batch of PushOrders -> NC program text: the two halves of one push of one or several tables.

::

    first half   back up -> wait for go-on word -> move -> switch all off -> write -> compare -> write read-back files
                 -> wait for release word
    second half  check words, switches and every point again -> switch the released tables on -> check the switches

The program waits twice, standing, for the gateway's word, with nothing for a person to do: after the back-up, until the
gateway has found there what it expects, and between the halves, until it has compared the read-back. All that moves was
announced before the start. The second half enables only what the gateway released of this very transaction, and only if
it is still as it was written. Every other way out leaves all of them disabled. MD38000 and MD18342 are not touched.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal

from drivers.errors import TooManyPoints
from drivers.sinumerik.ncprogram import backup, blocks, switching
from drivers.sinumerik.ncprogram.backup import BackupFile, ReservedPoints, Section
from drivers.sinumerik.ncprogram.blocks import (
    Motion,
    ProgramArray,
    ProgramHead,
    add_head,
    format_number,
    section_comment,
)
from drivers.sinumerik.ncprogram.checks import away_blocks, guard_blocks, skip_if_there
from drivers.sinumerik.ncprogram.measuring import (
    POLL_S,
    PREPARE,
    MachineSetting,
    check_names,
    file_failed_blocks,
    leave_if_aborted,
    phase_block,
    program_text,
)
from drivers.sinumerik.ncprogram.words import FAMILY, Phase, Word, Words, file_path, program_path
from drivers.sinumerik.tablefile import tables
from drivers.sinumerik.tablefile.grammar import value_text
from drivers.types.orders import PushBatch, PushOrder
from drivers.types.tables import CompensationTable

# Blocks that write one table of a push, and that compare what the control then holds, value by value.

FINEST = Decimal("0.000000001")  # below this the control's own decimals differ from its binary value


def reserved_points(table: CompensationTable, memory: ReservedPoints) -> int:
    """Points the control holds for this table."""
    if table.kind != "cross":
        return memory.eec_points if table.kind == "axis" else 1
    return memory.cec_points[table.index] if table.index < len(memory.cec_points) else 0


def order_array(order: PushOrder, place: int) -> ProgramArray | None:
    """The values of one table of a batch as a table of the program's own; None for a reversal, which is one value.

    Raises as `tables.order_values`.
    """
    if order.table.kind == "reversal":
        return None
    return ProgramArray(f"UTABLE{place + 1}", "REAL", tuple(value_text(value) for value in tables.order_values(order)))


def write_blocks(order: PushOrder, memory: ReservedPoints, array: ProgramArray | None) -> list[str]:
    """Every parameter, every point and a zero for each point that an older table may have left behind.

    The points from ``array``, one by one where that is None. A reversal has none of them: its one value is written
    where it is switched on.

    Raises TooManyPoints (E-TABLE-POINTS) and as `tables.order_values`.
    """
    table, values = order.table, tables.order_values(order)
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


def compare_blocks(order: PushOrder, memory: ReservedPoints, count: str, array: ProgramArray | None) -> list[str]:
    """Every parameter and point against what was sent; ``count`` is the variable that counts what differs."""
    table, values = order.table, tables.order_values(order)
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


# The two halves.

Loads = Sequence[tuple[PushOrder, MachineSetting]]
"""Each order with what its own axes need: memory of its output, feed and kind of its input."""

SAVED = "TRUEFLANK SAVED"
LOADED = "TRUEFLANK LOADED"
ACTIVATE = "TRUEFLANK ACTIVATE NCK RESET AND REFERENCE"
_MOST_NAMED = 5
_MOST_WAITED = round(600.0 / POLL_S)  # comparing takes seconds; with its gateway gone a program ends after 10 minutes
_HELD, _LEFT, _FAILED, _COMPARE = "TF_HELD", "TF_LEFT", "TF_FAILED", "TF_COMPARE"
_WAKES, _ALONE = "TF_WAKES", "TF_ALONE"
_HALF, _BAD, _GOOD, _PASSED, _WAITED = "UHALF", "UBAD", "UGOOD", "UPASSED", "UWAITED"
_STOPS = "press RESET and grind nothing: a table is off or half written. trueflank recover puts the old one back."


def loaded_message(batch: PushBatch, words: Words) -> str:
    """What stands on the control between the two halves, while the gateway compares."""
    return f"{LOADED} {_named(batch)} WAITS FOR {words.name(Word.RELEASE)}={batch[0].transaction}"


def back_up_message(batch: PushBatch, words: Words) -> str:
    """What stands there while the gateway compares what the back-up holds with what it expects."""
    return f"{SAVED} {_named(batch)} WAITS FOR {words.name(Word.RELEASE)}={go_on_word(batch)}"


def go_on_word(batch: PushBatch) -> int:
    """The word that lets the first half go on after the back-up; never one that releases tables."""
    return -batch[0].transaction


def _named(batch: PushBatch) -> str:
    return " ".join(order.table.name for order in batch) if len(batch) <= _MOST_NAMED else f"{len(batch)} TABLES"


def activate_message(batch: PushBatch) -> str:
    """The operator's message after tables were switched on."""
    axes = dict.fromkeys(order.table.output_axis for order in batch)
    return f"{ACTIVATE} {' '.join(axes)}"


def build_push_program(loads: Loads) -> str:
    """The one program with both halves: load and prove, wait for the release, then enable what was released."""
    first = _first_half(loads, saved=_wait_for_comparison(loads))
    return _program("PUSH", loads, [*first, *_wait_for_release(loads), *_second_half(loads)])


def _wait_for_comparison(loads: Loads) -> list[str]:
    """Stand after the back-up; an abort, or nobody's word, ends the program with everything as it was."""
    words, orders = loads[0][1].words, _orders(loads)
    out = [
        section_comment("until the gateway has found in the back-up what it expects"),
        phase_block(words, Phase.SAVED),
    ]
    late = [f"IF {_WAITED}>{_MOST_WAITED}", f"{words.name(Word.ABORT)}=1", "ENDIF"]  # else it would read as no right
    out += _wait_blocks(
        words, go_on_word(orders), back_up_message(orders, words), [*late, leave_if_aborted(words, _LEFT)]
    )
    return [*out, leave_if_aborted(words, _LEFT), f"{words.name(Word.RELEASE)}=0", "STOPRE"]


def _wait_for_release(loads: Loads) -> list[str]:
    words, orders = loads[0][1].words, _orders(loads)
    ends = [leave_if_aborted(words, _HELD), f"IF {_WAITED}>{_MOST_WAITED} GOTOF {_HELD}"]
    return _wait_blocks(words, orders[0].transaction, loaded_message(orders, words), ends)


def _wait_blocks(words: Words, word: int, message: str, ends: list[str]) -> list[str]:
    return [
        f'MSG("{message}")',
        f"{_WAITED}=0",
        f"WHILE {words.name(Word.RELEASE)}<>{word}",
        f"G4 F{format_number(POLL_S)}",
        "STOPRE",
        f"{_WAITED}={_WAITED}+1",
        *ends,
        "ENDWHILE",
        'MSG("")',
        "STOPRE",
    ]


def build_loading_program(loads: Loads) -> str:
    """The first half alone, for controls that give no file out while a program waits."""
    return _program("LOAD", loads, [*_first_half(loads, saved=[]), "M30"])


def build_enabling_program(loads: Loads) -> str:
    """The second half alone; it checks the words that `build_loading_program` left and every point again."""
    return _program("ENAB", loads, _second_half(loads))


def _arrays(loads: Loads) -> list[ProgramArray | None]:
    """The values of each order as a table of the program's own; None where they are written out one by one."""
    found = [order_array(order, place) if setting.loops else None for place, (order, setting) in enumerate(loads)]
    return found if blocks.arrays_fit(one for one in found if one is not None) else [None for _ in loads]


def _orders(loads: Loads) -> PushBatch:
    return tuple(order for order, _ in loads)


def _program(kind: str, loads: Loads, body: list[str]) -> str:
    setting, orders = loads[0][1], _orders(loads)
    words = setting.words
    check = _section(loads, body)
    ends = [
        section_comment("ways out, every table off"),
        f"{_HELD}:",
        "STOPRE",
        *switching.disable_blocks(orders),
        "STOPRE",
    ]
    ends += [phase_block(words, Phase.ENDED_DISABLED), 'MSG("")', "M30"]
    ends += [f"{_LEFT}:", "STOPRE", phase_block(words, Phase.LEFT), "M30"]
    ends += [*away_blocks(words, setting.guards), *file_failed_blocks(words, _FAILED)]
    if any(order.table.kind == "cross" for order in orders):
        ends += [f"{_WAKES}:", "STOPRE", phase_block(words, Phase.WOULD_WAKE), "M30"]
        ends += [f"{_ALONE}:", "STOPRE", phase_block(words, Phase.ENDED_DISABLED), 'MSG("")', "M30"]
    arrays = [array for array in _arrays(loads) if array is not None]
    begin = [
        f"DEF INT {backup.VARIABLES}, {_HALF}, {_BAD}, {_GOOD}, {_PASSED}, {_WAITED}",
        *blocks.declare_arrays(arrays),
    ]
    begin += [section_comment("modal states, R words"), *PREPARE]
    if arrays:
        begin += [section_comment("the values of the tables"), *(block for array in arrays for block in array.filled)]
    return program_text(add_head(_head(kind, loads), [*begin, *body, *check, *ends]))


def _head(kind: str, loads: Loads) -> ProgramHead:
    orders = _orders(loads)
    parts = {
        "PUSH": "load and, after the release, enable",
        "LOAD": "load, left off",
        "ENAB": "enable what LOAD wrote",
    }
    named = ", ".join(f"{order.table.name} ({len(order.table.deviations)} points)" for order in orders)
    what = f"{parts[kind]} {named} ({orders[0].purpose})"
    axes = tuple(dict.fromkeys(order.table.output_axis for order in orders))
    names = " and ".join(file_path(name, axis) for axis in axes for name in ("BACK", "READ"))
    saved = f" Saves old and new tables in {names}." if kind != "ENAB" else ""
    also = f"Switching a table off or on moves its axis ({', '.join(axes)}) by the table's value.{saved}"
    return ProgramHead(
        program_path(kind, axes[0]),
        what,
        stops=_STOPS,
        origin=loads[0][1].origin,
        also=also,
    )


def _first_half(loads: Loads, saved: list[str]) -> list[str]:
    setting, orders = loads[0][1], _orders(loads)
    words = setting.words
    for order in orders:
        check_names(order.table.output_axis, order.table.input_axis, order.letter)
    cleared = (Word.COUNTER, Word.MISMATCHES, Word.RELEASE, Word.GOOD, Word.PASSED)
    out = [f"{words.name(word)}=0" for word in cleared]
    out += [f"{words.name(word)}={value}" for word, value in _identity(loads).items()]
    out += [phase_block(words, Phase.BACKING_UP), "STOPRE", leave_if_aborted(words, _LEFT)]
    out += guard_blocks(words, setting.guards)
    out += [section_comment("old tables into files"), *_backup_blocks("BACK", loads, _FAILED), *saved]
    out += switching.sleeping_conditions(orders, setting.memory, _WAKES)
    out += [section_comment("to where old and new tables agree; the tables off")]
    out += [
        *guard_blocks(words, setting.guards),
        *_approach_blocks(loads),
        "STOPRE",
        *switching.switch_off_blocks(orders, _LEFT, _HELD),
    ]
    out += [*switching.acting_conditions(orders, _HELD), phase_block(words, Phase.DISABLED)]
    for (order, own), array in zip(loads, _arrays(loads), strict=True):
        out += [section_comment(f"new table {order.table.name}"), *write_blocks(order, own.memory, array)]
    out += ["STOPRE", phase_block(words, Phase.WRITTEN)]
    out += [f"{_HALF}=1", f"GOTOF {_COMPARE}", f"{_COMPARE}_1:", f"{words.name(Word.GOOD)}={_GOOD}"]
    out += [section_comment("what was written into files"), *_backup_blocks("READ", loads, _HELD)]
    out += [f"IF {words.name(Word.GOOD)}==0 GOTOF {_HELD}", "STOPRE"]
    return [*out, phase_block(words, Phase.WAITING)]


def _backup_blocks(name: Section, loads: Loads, failed: str) -> list[str]:
    """One file for each output axis."""
    savings = dict.fromkeys(backup_file_of(name, order, setting.memory) for order, setting in loads)
    return [block for one in savings for block in backup.backup_blocks(one, failed)]


def _second_half(loads: Loads) -> list[str]:
    """Enable only if everything is as the first half left it and the gateway released this transaction."""
    setting, orders = loads[0][1], _orders(loads)
    words = setting.words
    wanted = {Word.RELEASE: str(orders[0].transaction), Word.ABORT: "0"}
    wanted |= {Word.PHASE: str(int(Phase.WAITING))} | _identity(loads)
    good, passed = words.name(Word.GOOD), words.name(Word.PASSED)
    out = [section_comment("second half: enable only what was released and is as it was written")]
    out += [f"IF {words.name(word)}<>{value} GOTOF {_HELD}" for word, value in wanted.items()]
    most = (1 << len(orders)) - 1
    out += [f"IF ({passed}<1) OR ({passed}>{most}) GOTOF {_HELD}", f"{_PASSED}={passed}", f"{_GOOD}={good}"]
    out += [f"IF ({_PASSED} B_AND {_GOOD})<>{_PASSED} GOTOF {_HELD}"]
    out += [f"IF {switch}<>0 GOTOF {_HELD}" for switch in switching.all_switches(orders)]
    out += guard_blocks(words, setting.guards)
    out += [*_approach_blocks(loads), "STOPRE", f"{_HALF}=2", f"GOTOF {_COMPARE}", f"{_COMPARE}_2:"]
    out += [f"IF ({_PASSED} B_AND {_GOOD})<>{_PASSED} GOTOF {_HELD}"]
    at_once = all(order.table.kind == "reversal" for order in orders)  # it acts from NEWCONF on
    if not any(order.enable for order in orders):
        if at_once or orders[0].purpose != "sign-proof":
            return [*out, *switching.restore_other_tables(orders, _HELD, _ALONE)]
        out += [*switching.restore_outputs(orders, _HELD), "STOPRE", phase_block(words, Phase.ENDED_DISABLED)]
    else:
        out += [*switching.switch_on_blocks(orders, _PASSED, _HELD), phase_block(words, Phase.ENABLED)]
        if at_once:
            return [*out, "M30"]
    return [*out, f'MSG("{activate_message(orders)}")', "M0", 'MSG("")', "M30"]


def _section(loads: Loads, body: list[str]) -> list[str]:
    """The comparison of every parameter and point, entered by a jump from either half and left back to it.

    It leaves the number of differences in the mismatch word, and a bit of `_GOOD` for each table that has none.
    """
    halves = [half for half in (1, 2) if f"{_COMPARE}_{half}:" in body]
    back = [f"IF {_HALF}=={half} GOTOB {_COMPARE}_{half}" for half in halves]
    miss = loads[0][1].words.name(Word.MISMATCHES)
    out = [section_comment("every parameter and point compared"), f"{_COMPARE}:", "STOPRE", f"{miss}=0", f"{_GOOD}=0"]
    arrays = _arrays(loads)
    for place, (order, setting) in enumerate(loads):
        out += [*compare_blocks(order, setting.memory, _BAD, arrays[place]), f"{miss}={miss}+{_BAD}"]
        out += [f"IF {_BAD}==0", f"{_GOOD}={_GOOD}+{1 << place}", "ENDIF"]
    return [*out, *back, f"GOTOF {_HELD}"]


def _identity(loads: Loads) -> dict[Word, str]:
    """What the words say of the batch: the first table and axis, the points of all."""
    first, setting = loads[0]
    return {
        Word.TRANSACTION: str(first.transaction),
        Word.TABLE: str(FAMILY[first.table.kind] + first.table.index),
        Word.AXIS: str(setting.axis_number),
        Word.POINTS: str(sum(len(order.table.deviations) for order, _ in loads)),
    }


def backup_file_of(section: Section, order: PushOrder, memory: ReservedPoints) -> BackupFile:
    """What the order's program writes to a file, and what proves that it did."""
    return BackupFile(
        section=section,
        number=order.transaction,
        axis=order.table.output_axis,
        encoder=order.saved_encoder,
        memory=memory,
    )


def _approach_blocks(loads: Loads) -> list[str]:
    """Each input axis to its agreeing position, unless it stands there."""
    out: list[str] = []
    for axis, (order, setting) in {order.table.input_axis: (order, setting) for order, setting in loads}.items():
        block = Motion(order.letter, setting.modulo, setting.approach_feed).to(order.agreeing_position)
        out += skip_if_there(axis, order.agreeing_position, block, modulo=setting.modulo)
    return out
