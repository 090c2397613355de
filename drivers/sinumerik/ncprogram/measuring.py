"""StopPlan -> NC program text: a measuring run, the blocks that all our programs share, external captures.

At each stop the program dwells, writes position and repetition into R parameters, increments the count word last and
waits until the gateway echoes it: no stop is skipped or doubled at any speed. It leaves every wait by the abort word or
a time limit, and never writes MD38000 or MD18342. Words and phases: `drivers.sinumerik.ncprogram.unpack_text`.
Blocks: the reference programs of the Job Planning manual.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

from drivers.errors import LocalProtocolError
from drivers.programs import NOBODY, DwellPlan, Origin
from drivers.sinumerik.ncprogram import backup, blocks
from drivers.sinumerik.ncprogram.backup import BackupFile, ReservedPoints, trial_blocks
from drivers.sinumerik.ncprogram.blocks import Motion, ProgramHead, StopTables, add_head, format_number, section_comment
from drivers.sinumerik.ncprogram.checks import Guard, away_blocks, guard_blocks
from drivers.sinumerik.ncprogram.words import Phase, Word, Words, file_path, program_path
from drivers.types.moves import FEED_MM
from drivers.types.stops import Stop, StopPlan

# The measuring program, and blocks that all programs share.

POLL_S = 0.25
# Every modal state that a program before ours may have left: plane, tool radius, exact stop, absolute, feed per
# minute, offsets, metric (lengths and feeds, as tables and set-up values are in mm), radius programming, tool length,
# transformation.
PREPARE = ("G17 G40 G60 G601 G90 G94 G500 G710 DIAMOF D0", "TRAFOOF")
SWITCHED = "press RESET and leave tables alone: trueflank knows what it switched and puts it back (recover)."
STANDING = "press RESET: tables and switches are as they were. Then ask trueflank what is left in the control."
PROVES = "TFEFFECT"
"""Plans of this name prove what the control itself shows; nobody reads an instrument at their stops."""
_CHOSEN = "Left out in the push: tables that were live before or failed, and the call for optics that stand already. "
_NAME = re.compile(r"[A-Z][A-Z0-9_]{0,11}")
_MESSAGE = re.compile(r"[A-Za-z0-9 ()=.,:_/+-]{0,120}")
_LEFT, _FAILED = "TF_LEFT", "TF_FAILED"
_ROUND, _WAITED = "UROUND", "UWAITED"


@dataclass(frozen=True, slots=True)
class MachineSetting:
    """What the generator must know of a machine: R words, memory, modulo axis, feed of a push's own moves.

    ``wait_limit_s`` (NC seconds) ends a program whose gateway is gone; ``axis_number`` is 1-based. ``guards`` are the
    axes that must stand in their places when the program begins to move. ``loops``: the control fills arrays of a
    program's own by SET; False where its self-test found that it does not.
    """

    words: Words
    memory: ReservedPoints
    modulo: bool
    axis_number: int = 1
    approach_feed: float = FEED_MM
    wait_limit_s: float = 14400.0
    origin: Origin = NOBODY
    guards: tuple[Guard, ...] = ()
    loops: bool = True


Parts = Sequence[tuple[StopPlan, MachineSetting]]
"""Plans that one program visits one after the other, each with what its own axes need."""


def build_measuring_program(plan: StopPlan, token: int, setting: MachineSetting) -> str:
    """The program of one `StopPlan`. As `build_chained_program`."""
    return build_chained_program(((replace(plan, further=False), setting),), token)


def build_chained_program(parts: Parts, token: int) -> str:
    """The program of several plans; ``token`` is echoed so that an older program's words are never taken.

    Stops count on from plan to plan. The next plan begins once the last stop of the one before is echoed: whoever
    follows the program lets it wait there for as long as it takes, and may send further stops of that plan meanwhile.
    Raises LocalProtocolError (E-PROGRAM-NAME, E-PROGRAM-MESSAGE, E-PROGRAM-EMPTY).
    """
    for plan, _ in parts:
        _check(plan)
    words = parts[0][1].words
    tables = _tables(parts)
    arrays = [array for one in tables if one is not None for array in one.arrays]
    plain = any(one is None and len(plan.stops) > 1 for one, (plan, _) in zip(tables, parts, strict=True))
    counters = [blocks.COUNTERS] if arrays else []
    counters += [_ROUND] if plain or not arrays else []
    out = [f"DEF INT {', '.join([backup.VARIABLES, *counters, _WAITED])}", *blocks.declare_arrays(arrays)]
    out += [section_comment("modal states, R words"), *PREPARE]
    out += [f"{words.name(word)}=0" for word in (Word.COUNTER, Word.ECHO, Word.MISMATCHES, Word.RELEASE)]
    out += [f"{words.name(Word.TRANSACTION)}={token}"]
    saving = saving_plans([plan for plan, _ in parts])
    for (plan, setting), saves, table in zip(parts, saving, tables, strict=True):
        out += _part(plan, token, setting, saves=saves, table=table)
    out += ["STOPRE", phase_block(words, Phase.FINISHED), "M30", section_comment("ways out")]
    out += [f"{_LEFT}:", "STOPRE", phase_block(words, Phase.LEFT), "M30"]
    guards = dict.fromkeys(guard for plan, setting in parts if plan.stops for guard in setting.guards)
    out += [*away_blocks(words, guards), *file_failed_blocks(words, _FAILED)]
    return program_text(
        add_head(
            _head(parts),
            out,
            moves=[block for one in parts if one[0].stops for block in (*stop_blocks(*one), *_further(*one))],
        )
    )


def _tables(parts: Parts) -> list[StopTables | None]:
    """The stops of each part as tables; None where they are written out one by one."""
    found = [
        blocks.tabulate_stops(plan.stops, _motion(plan, setting)) if setting.loops and len(plan.stops) > 1 else None
        for plan, setting in parts
    ]
    if blocks.arrays_fit(array for one in found if one is not None for array in one.arrays):
        return found
    return [None for _ in parts]


def _motion(plan: StopPlan, setting: MachineSetting) -> Motion:
    return Motion(plan.letter, setting.modulo, plan.feed, plan.overrun)


def _check(plan: StopPlan) -> None:
    check_names(plan.axis, plan.letter, plan.compensated_axis)
    if not _MESSAGE.fullmatch(plan.setup):
        raise LocalProtocolError("E-PROGRAM-MESSAGE", plan.name, text=plan.setup)
    if not plan.stops and not plan.save_tables:
        raise LocalProtocolError("E-PROGRAM-EMPTY", plan.name)


def saving_plans(plans: Sequence[StopPlan]) -> tuple[bool, ...]:
    """Which of the plans of one program write the live tables anew.

    Not one that goes on where the tables of its axis were saved already: nobody was at the machine in between. One that
    only reads always does.
    """
    out: list[bool] = []
    known: tuple[str, int] | None = None
    for plan in plans:
        its = (plan.compensated_axis, plan.encoder)
        out.append(plan.save_tables and (not plan.stops or bool(plan.setup) or its != known))
        switched = any(stop.switch is not None for stop in plan.stops)
        known = None if switched else its if plan.save_tables else known
    return tuple(out)


def _part(plan: StopPlan, token: int, setting: MachineSetting, *, saves: bool, table: StopTables | None) -> list[str]:
    words = setting.words
    out = [section_comment(plan.name), phase_block(words, Phase.BACKING_UP), "STOPRE"]
    out += [leave_if_aborted(words, _LEFT)]
    if saves:
        saving = BackupFile(
            section="LIVE", number=token, axis=plan.compensated_axis, encoder=plan.encoder, memory=setting.memory
        )
        out += [section_comment("live tables and switches into a file"), *backup.backup_blocks(saving, _FAILED)]
    out += [section_comment("measuring"), "STOPRE", phase_block(words, Phase.MEASURING)]
    if plan.setup:
        out += [f'MSG("{plan.setup}")', "M0", 'MSG("")', "STOPRE", leave_if_aborted(words, _LEFT)]
    if not plan.stops:
        return out
    visited = stop_blocks(plan, setting) if table is None else looped_blocks(plan, setting, table)
    return [*out, *guard_blocks(words, setting.guards), *visited, *_further(plan, setting)]


def _head(parts: Parts) -> ProgramHead:
    plans = [plan for plan, _ in parts]
    first = plans[0]
    switched = any(stop.switch is not None for plan in plans for stop in plan.stops)
    count = sum(len(plan.stops) for plan in plans)
    axes = " and ".join(dict.fromkeys(plan.axis for plan in plans if plan.stops))
    stops = f"{count} stops of {axes}" if count else "the live tables are saved"
    what = f"{first.name}, {stops}" + (f" in {len(plans)} parts" if len(plans) > 1 else "")
    what += ", one table switched" if switched else ""
    also = "Switching a table moves its axis by the table's value. " if switched else ""
    for axis in dict.fromkeys(plan.compensated_axis for plan in plans if plan.save_tables):
        also += f"Saves what acts on {axis} in {file_path('LIVE', axis)}. "
    also += _CHOSEN if any(plan.name.startswith(PROVES) for plan in plans) else ""
    told = SWITCHED if switched else STANDING
    path = program_path("MEAS", first.compensated_axis)
    return ProgramHead(path, what, stops=told, origin=parts[0][1].origin, also=also.rstrip())


def looped_blocks(plan: StopPlan, setting: MachineSetting, table: StopTables) -> list[str]:
    """All stops as one loop over the tables of their targets and passes."""
    shown = {
        Word.REPETITION: table.repetition,
        Word.LABEL: table.label,
        Word.APPROACH: table.side,
        Word.TARGET: table.target,
    }
    switch: list[str] = []
    if table.switch:
        switch = _switched(plan, table.switch)
        if not table.switched_always:
            switch = [f"IF {table.switch}>=0", *switch, "ENDIF"]
    return table.around([*switch, *_waiting(plan, shown, setting)])


def stop_blocks(plan: StopPlan, setting: MachineSetting) -> list[str]:
    """All stops one by one (repetitions that are alike in a loop): the same moves and words as `looped_blocks`.

    What a program says of its moves is read from these blocks, whichever of the two it holds.
    """
    motion = _motion(plan, setting)
    rounds = [tuple(group) for _, group in groupby(plan.stops, key=lambda stop: stop.repetition)]
    if not _alike(rounds):
        return _sequence(plan, motion, plan.stops, "", setting)
    first, last = rounds[0][0].repetition, rounds[-1][0].repetition
    return [f"FOR {_ROUND}={first} TO {last}", *_sequence(plan, motion, rounds[0], _ROUND, setting), "ENDFOR"]


def _alike(rounds: list[tuple[Stop, ...]]) -> bool:
    def shape(stops: tuple[Stop, ...]) -> list[tuple[float, int, int, bool | None]]:
        return [(stop.target, stop.approach, stop.label, stop.switch) for stop in stops]

    numbers = [stops[0].repetition for stops in rounds]
    in_order = numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    return len(rounds) > 1 and in_order and all(shape(stops) == shape(rounds[0]) for stops in rounds)


def _sequence(
    plan: StopPlan, motion: Motion, stops: tuple[Stop, ...], counter: str, setting: MachineSetting
) -> list[str]:
    out: list[str] = []
    for stop, leg in zip(stops, motion.legs(stops), strict=True):
        repetition = counter or str(stop.repetition)
        out += leg + _switch(plan, stop) + _handshake(plan, stop, repetition, setting)
    return out


def _further(plan: StopPlan, setting: MachineSetting) -> list[str]:
    """Stops that a reading asks for: one after the other by the gateway's words, none outside the plan's own moves."""
    if not plan.further:
        return []
    words, motion = setting.words, _motion(plan, setting)
    side, lead, place = (words.name(word) for word in (Word.SIDE, Word.LEAD, Word.NEXT))
    low, high = plan_range(plan, setting)
    outside = [f"({one}<{format_number(low)}) OR ({one}>{format_number(high)})" for one in (lead, place)]
    shown = {Word.APPROACH: side, Word.TARGET: place}
    return [
        section_comment("further stops, where a reading asks for them"),
        "STOPRE",
        f"WHILE {side}<>0",
        f"IF ({side}<>1) AND ({side}<>-1) GOTOF {_LEFT}",
        *(f"IF {test} GOTOF {_LEFT}" for test in outside),
        *guard_blocks(words, setting.guards),
        *motion.led(lead, place, side),
        *_waiting(plan, shown, setting),
        "STOPRE",
        "ENDWHILE",
    ]


def plan_range(plan: StopPlan, setting: MachineSetting) -> tuple[float, float]:
    """The ends between which a plan moves its axis, in the axis unit; a whole turn where it turns endlessly."""
    if setting.modulo:
        return 0.0, 360.0
    places = [stop.target for stop in plan.stops]
    leads = [stop.target - stop.approach * plan.overrun for stop in plan.stops]
    return min(*places, *leads), max(*places, *leads)


def _switch(plan: StopPlan, stop: Stop) -> list[str]:
    return [] if stop.switch is None else _switched(plan, str(int(stop.switch)))


def _switched(plan: StopPlan, state: str) -> list[str]:
    """The plan's table on or off; ``state`` is 1 or 0, or a variable that holds it."""
    if plan.reversal is not None:
        return trial_blocks(plan.reversal, state)
    if plan.cross_table is not None:
        return ["STOPRE", f"$SN_CEC_TABLE_ENABLE[{plan.cross_table}]={state}", "NEWCONF", "STOPRE"]
    enable = f"$MA_ENC_COMP_ENABLE[{plan.encoder},{plan.compensated_axis}]={state}"
    return ["STOPRE", enable, "NEWCONF", "STOPRE"]


def _handshake(plan: StopPlan, stop: Stop, repetition: str, setting: MachineSetting) -> list[str]:
    """Show where we are as the plan has it."""
    shown = {
        Word.REPETITION: repetition,
        Word.LABEL: str(stop.label),
        Word.APPROACH: str(stop.approach),
        Word.TARGET: format_number(stop.target),
    }
    return _waiting(plan, shown, setting)


def _waiting(plan: StopPlan, told: dict[Word, str], setting: MachineSetting) -> list[str]:
    """Dwell, show where we are, count last, and wait until the count comes back."""
    words = setting.words
    shown = told | {
        Word.ENCODER_COMPENSATION: f"$VA_ENC{plan.encoder + 1}_COMP_VAL[{plan.compensated_axis}]",
        Word.CROSS_COMPENSATION: f"$VA_CEC_COMP_VAL[{plan.compensated_axis}]",
    }
    counter = words.name(Word.COUNTER)
    return [
        f"G4 F{format_number(plan.dwell_s)}",
        "STOPRE",
        *(f"{words.name(word)}={value}" for word, value in shown.items()),
        f"{counter}={counter}+1",
        f"{_WAITED}=0",
        f"WHILE {words.name(Word.ECHO)}<>{counter}",
        f"G4 F{format_number(POLL_S)}",
        "STOPRE",
        f"{_WAITED}={_WAITED}+1",
        leave_if_aborted(words, _LEFT),
        f"IF {_WAITED}>{round(setting.wait_limit_s / POLL_S)} GOTOF {_LEFT}",
        "ENDWHILE",
    ]


def phase_block(words: Words, phase: Phase) -> str:
    """Show how far the program is."""
    return f"{words.name(Word.PHASE)}={int(phase)}"


def file_failed_blocks(words: Words, label: str) -> list[str]:
    """The way out when WRITE refuses: its answer is shown, nothing else happens."""
    shown = f"{words.name(Word.MISMATCHES)}={backup.ERROR}"
    return [f"{label}:", "STOPRE", shown, phase_block(words, Phase.FILE_FAILED), "M30"]


def leave_if_aborted(words: Words, label: str) -> str:
    """Leave when the gateway set the abort word."""
    return f"IF {words.name(Word.ABORT)}<>0 GOTOF {label}"


def check_names(*names: str) -> None:
    """Refuse names that could break out of a block. Raises LocalProtocolError (E-PROGRAM-NAME)."""
    for name in names:
        if not _NAME.fullmatch(name):
            raise LocalProtocolError("E-PROGRAM-NAME", name, name=name)


def program_text(lines: list[str]) -> str:
    """Blocks as program text."""
    return "\n".join([*lines, ""])


# DwellPlan -> NC program text for a capture program of somebody else, which triggers when the axis stands still.
#
# The program shakes no hands: it uses no R parameter, writes nothing and waits at each target. At the first target,
# which it reaches from that stop's own side, it waits (M0): there the person zeroes the laser and starts the capture,
# so every reading counts from where the axis really stands. The order of stops is that of a measuring run: each target
# in both directions, with overrun at each end.

ABOUT = "a capture program that triggers by itself"
STOPPED = "press RESET: it has written nothing. Begin the capture anew."
READY = "AT THE FIRST TARGET: ZERO THE LASER, START THE CAPTURE, PRESS NC START"


def build_dwell_program(plan: DwellPlan, modulo: bool, origin: Origin, *, loops: bool = True) -> str:
    """The program: one loop over a table of its targets, or every move written out where ``loops`` is not known.

    Raises LocalProtocolError (E-PROGRAM-NAME, E-PROGRAM-EMPTY, E-PROGRAM-SIZE)."""
    stops = plan.stops
    check_names(stops.axis, stops.letter, stops.axis)
    if not stops.stops:
        raise LocalProtocolError("E-PROGRAM-EMPTY", stops.name)
    motion = Motion(stops.letter, modulo, stops.feed, stops.overrun)
    legs = list(motion.legs(stops.stops))
    ready, dwells = [f'MSG("{READY}")', "M0", 'MSG("")'], f"G4 F{format_number(plan.dwell_s)}"
    table = blocks.tabulate_stops(stops.stops, motion) if loops and len(stops.stops) > 1 else None
    out = [section_comment("modal states"), *PREPARE]
    if table is not None and blocks.arrays_fit(table.arrays):
        first = f"IF ({blocks.PASS}==0) AND ({blocks.STEP}==1)"
        out = [f"DEF INT {blocks.COUNTERS}", *blocks.declare_arrays(table.arrays), *out]
        out += table.around([first, *ready, "ENDIF", dwells])
    else:
        out += [
            section_comment("to the first target, from its own side"),
            *legs[0],
            *ready,
            section_comment("targets"),
            dwells,
        ]
        out += [block for leg in legs[1:] for block in (*leg, dwells)]
    out.append("M30")
    what = f"{len(stops.stops)} stops of {stops.axis} for {ABOUT}, {plan.dwell_s:g} s at each"
    moves = [block for leg in legs for block in leg]
    return program_text(
        add_head(ProgramHead(program_path("DWEL", stops.axis), what, stops=STOPPED, origin=origin), out, moves=moves)
    )
