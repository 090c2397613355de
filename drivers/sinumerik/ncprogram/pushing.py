"""A batch of PushOrders -> NC program text: the two halves of one push of one or several tables.

First half: back up, move to the agreeing positions, disable all, write everything, compare everything, write
read-back files. Twice it waits, standing, for the gateway's word, with nothing for a person to do, and what all of it
moves was said before the start: after the back-up, before anything is switched or written, until the gateway has found
there what it expects; and between the halves. Second half: enable only what the gateway released of this very
transaction, and only if it is still as it was written. Every other way out leaves all of them disabled. MD38000 and
MD18342 are not touched.
"""

from __future__ import annotations

from collections.abc import Sequence

from drivers.sinumerik.ncprogram import backup, looping, switching
from drivers.sinumerik.ncprogram.backup import Memory, Saving, Section
from drivers.sinumerik.ncprogram.guarding import away, guarded, unless_there
from drivers.sinumerik.ncprogram.heads import Head, headed, section
from drivers.sinumerik.ncprogram.loading import array_of, compared, written
from drivers.sinumerik.ncprogram.looping import Array
from drivers.sinumerik.ncprogram.measuring import (
    POLL_S,
    PREPARE,
    Setting,
    check_names,
    file_failed,
    phase_block,
    text_of,
    unless_aborted,
)
from drivers.sinumerik.ncprogram.motion import Motion, number
from drivers.sinumerik.ncprogram.words import FAMILY, Phase, Word, Words, file_path, program_path
from drivers.types.orders import PushBatch, PushOrder

Loads = Sequence[tuple[PushOrder, Setting]]
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


def saved_message(batch: PushBatch, words: Words) -> str:
    """What stands there while the gateway compares what the back-up holds with what it expects."""
    return f"{SAVED} {_named(batch)} WAITS FOR {words.name(Word.RELEASE)}={goes_on(batch)}"


def goes_on(batch: PushBatch) -> int:
    """The word that lets the first half go on after the back-up; never one that releases tables."""
    return -batch[0].transaction


def _named(batch: PushBatch) -> str:
    return " ".join(order.table.name for order in batch) if len(batch) <= _MOST_NAMED else f"{len(batch)} TABLES"


def activate_message(batch: PushBatch) -> str:
    """The operator's message after tables were switched on."""
    axes = dict.fromkeys(order.table.output_axis for order in batch)
    return f"{ACTIVATE} {' '.join(axes)}"


def pushing(loads: Loads) -> str:
    """The one program with both halves: load and prove, wait for the release, then enable what was released."""
    first = _first_half(loads, saved=_until_compared(loads))
    return _program("PUSH", loads, [*first, *_until_released(loads), *_second_half(loads)])


def _until_compared(loads: Loads) -> list[str]:
    """Stand after the back-up; an abort, or nobody's word, ends the program with everything as it was."""
    words, orders = loads[0][1].words, _orders(loads)
    out = [section("until the gateway has found in the back-up what it expects"), phase_block(words, Phase.SAVED)]
    late = [f"IF {_WAITED}>{_MOST_WAITED}", f"{words.name(Word.ABORT)}=1", "ENDIF"]  # else it would read as no right
    out += _until(words, goes_on(orders), saved_message(orders, words), [*late, unless_aborted(words, _LEFT)])
    return [*out, unless_aborted(words, _LEFT), f"{words.name(Word.RELEASE)}=0", "STOPRE"]


def _until_released(loads: Loads) -> list[str]:
    words, orders = loads[0][1].words, _orders(loads)
    ends = [unless_aborted(words, _HELD), f"IF {_WAITED}>{_MOST_WAITED} GOTOF {_HELD}"]
    return _until(words, orders[0].transaction, loaded_message(orders, words), ends)


def _until(words: Words, word: int, message: str, ends: list[str]) -> list[str]:
    return [
        f'MSG("{message}")',
        f"{_WAITED}=0",
        f"WHILE {words.name(Word.RELEASE)}<>{word}",
        f"G4 F{number(POLL_S)}",
        "STOPRE",
        f"{_WAITED}={_WAITED}+1",
        *ends,
        "ENDWHILE",
        'MSG("")',
        "STOPRE",
    ]


def loading(loads: Loads) -> str:
    """The first half alone, for controls that give no file out while a program waits."""
    return _program("LOAD", loads, [*_first_half(loads, saved=[]), "M30"])


def enabling(loads: Loads) -> str:
    """The second half alone; it checks the words that `loading` left and every point again."""
    return _program("ENAB", loads, _second_half(loads))


def _arrays(loads: Loads) -> list[Array | None]:
    """The values of each order as a table of the program's own; None where they are written out one by one."""
    found = [array_of(order, place) if setting.loops else None for place, (order, setting) in enumerate(loads)]
    return found if looping.fits(one for one in found if one is not None) else [None for _ in loads]


def _orders(loads: Loads) -> PushBatch:
    return tuple(order for order, _ in loads)


def _program(kind: str, loads: Loads, body: list[str]) -> str:
    setting, orders = loads[0][1], _orders(loads)
    words = setting.words
    check = _section(loads, body)
    ends = [section("ways out, every table off"), f"{_HELD}:", "STOPRE", *switching.disabled(orders), "STOPRE"]
    ends += [phase_block(words, Phase.ENDED_DISABLED), 'MSG("")', "M30"]
    ends += [f"{_LEFT}:", "STOPRE", phase_block(words, Phase.LEFT), "M30"]
    ends += [*away(words, setting.guards), *file_failed(words, _FAILED)]
    if any(order.table.kind == "cross" for order in orders):
        ends += [f"{_WAKES}:", "STOPRE", phase_block(words, Phase.WOULD_WAKE), "M30"]
        ends += [f"{_ALONE}:", "STOPRE", phase_block(words, Phase.ENDED_DISABLED), 'MSG("")', "M30"]
    arrays = [array for array in _arrays(loads) if array is not None]
    begin = [f"DEF INT {backup.VARIABLES}, {_HALF}, {_BAD}, {_GOOD}, {_PASSED}, {_WAITED}", *looping.declared(arrays)]
    begin += [section("modal states, R words"), *PREPARE]
    if arrays:
        begin += [section("the values of the tables"), *(block for array in arrays for block in array.filled)]
    return text_of(headed(_head(kind, loads), [*begin, *body, *check, *ends]))


def _head(kind: str, loads: Loads) -> Head:
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
    return Head(
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
    out += [phase_block(words, Phase.BACKING_UP), "STOPRE", unless_aborted(words, _LEFT)]
    out += guarded(words, setting.guards)
    out += [section("old tables into files"), *_saved("BACK", loads, _FAILED), *saved]
    out += switching.asleep(orders, setting.memory, _WAKES)
    out += [section("to where old and new tables agree; the tables off")]
    out += [*guarded(words, setting.guards), *_go(loads), "STOPRE", *switching.switched_off(orders, _LEFT, _HELD)]
    out += [*switching.still_acting(orders, _HELD), phase_block(words, Phase.DISABLED)]
    for (order, own), array in zip(loads, _arrays(loads), strict=True):
        out += [section(f"new table {order.table.name}"), *written(order, own.memory, array)]
    out += ["STOPRE", phase_block(words, Phase.WRITTEN)]
    out += [f"{_HALF}=1", f"GOTOF {_COMPARE}", f"{_COMPARE}_1:", f"{words.name(Word.GOOD)}={_GOOD}"]
    out += [section("what was written into files"), *_saved("READ", loads, _HELD)]
    out += [f"IF {words.name(Word.GOOD)}==0 GOTOF {_HELD}", "STOPRE"]
    return [*out, phase_block(words, Phase.WAITING)]


def _saved(name: Section, loads: Loads, failed: str) -> list[str]:
    """One file for each output axis."""
    savings = dict.fromkeys(saving(name, order, setting.memory) for order, setting in loads)
    return [block for one in savings for block in backup.blocks(one, failed)]


def _second_half(loads: Loads) -> list[str]:
    """Enable only if everything is as the first half left it and the gateway released this transaction."""
    setting, orders = loads[0][1], _orders(loads)
    words = setting.words
    wanted = {Word.RELEASE: str(orders[0].transaction), Word.ABORT: "0"}
    wanted |= {Word.PHASE: str(int(Phase.WAITING))} | _identity(loads)
    good, passed = words.name(Word.GOOD), words.name(Word.PASSED)
    out = [section("second half: enable only what was released and is as it was written")]
    out += [f"IF {words.name(word)}<>{value} GOTOF {_HELD}" for word, value in wanted.items()]
    most = (1 << len(orders)) - 1
    out += [f"IF ({passed}<1) OR ({passed}>{most}) GOTOF {_HELD}", f"{_PASSED}={passed}", f"{_GOOD}={good}"]
    out += [f"IF ({_PASSED} B_AND {_GOOD})<>{_PASSED} GOTOF {_HELD}"]
    out += [f"IF {switch}<>0 GOTOF {_HELD}" for switch in switching.all_switches(orders)]
    out += guarded(words, setting.guards)
    out += [*_go(loads), "STOPRE", f"{_HALF}=2", f"GOTOF {_COMPARE}", f"{_COMPARE}_2:"]
    out += [f"IF ({_PASSED} B_AND {_GOOD})<>{_PASSED} GOTOF {_HELD}"]
    at_once = all(order.table.kind == "reversal" for order in orders)  # it acts from NEWCONF on
    if not any(order.enable for order in orders):
        if at_once or orders[0].purpose != "sign-proof":
            return [*out, *switching.others_again(orders, _HELD, _ALONE)]
        out += [*switching.outputs_again(orders, _HELD), "STOPRE", phase_block(words, Phase.ENDED_DISABLED)]
    else:
        out += [*switching.switched_on(orders, _PASSED, _HELD), phase_block(words, Phase.ENABLED)]
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
    out = [section("every parameter and point compared"), f"{_COMPARE}:", "STOPRE", f"{miss}=0", f"{_GOOD}=0"]
    arrays = _arrays(loads)
    for place, (order, setting) in enumerate(loads):
        out += [*compared(order, setting.memory, _BAD, arrays[place]), f"{miss}={miss}+{_BAD}"]
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


def saving(section: Section, order: PushOrder, memory: Memory) -> Saving:
    """What the order's program writes to a file, and what proves that it did."""
    return Saving(
        section=section,
        number=order.transaction,
        axis=order.table.output_axis,
        encoder=order.saved_encoder,
        memory=memory,
    )


def _go(loads: Loads) -> list[str]:
    """Each input axis to its agreeing position, unless it stands there."""
    out: list[str] = []
    for axis, (order, setting) in {order.table.input_axis: (order, setting) for order, setting in loads}.items():
        block = Motion(order.letter, setting.modulo, setting.approach_feed).to(order.agreeing_position)
        out += unless_there(axis, order.agreeing_position, block, modulo=setting.modulo)
    return out
