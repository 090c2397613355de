"""StopPlan -> NC program text: a measuring run; and the words all our programs share.

Words and phases: `drivers.sinumerik.ncprogram.words`. A program of ours never writes MD38000 or MD18342 and leaves
every wait by the abort word or a time limit. Blocks: the reference programs of the Job Planning manual.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import groupby

from drivers.errors import LocalProtocolError
from drivers.sinumerik.ncprogram import backup
from drivers.sinumerik.ncprogram.backup import Memory, Saving
from drivers.sinumerik.ncprogram.motion import Motion, number
from drivers.sinumerik.ncprogram.words import Phase, Word, Words
from drivers.types import Stop, StopPlan

POLL_S = 0.25
PREPARE = "G500 D0 G90 G94 G60 G601"
_NAME = re.compile(r"[A-Z][A-Z0-9_]{0,11}")
_MESSAGE = re.compile(r"[A-Za-z0-9 ()=.,:_/+-]{0,120}")
_LEFT, _FAILED = "TF_LEFT", "TF_FAILED"


@dataclass(frozen=True, slots=True)
class Setting:
    """What the generator must know of a machine: R words, memory, modulo axis, feed between places.

    ``wait_limit_s`` (NC seconds) ends a program whose gateway is gone; ``axis_number`` is 1-based.
    """

    words: Words
    memory: Memory
    modulo: bool
    axis_number: int = 1
    approach_feed: float = 2000.0
    wait_limit_s: float = 14400.0


def measuring(plan: StopPlan, token: int, setting: Setting) -> str:
    """The program of a `StopPlan`; ``token`` is echoed so that an older program's words are never taken.

    Raises LocalProtocolError (E-PROGRAM-NAME, E-PROGRAM-MESSAGE, E-PROGRAM-EMPTY).
    """
    check_names(plan.axis, plan.letter, plan.compensated_axis)
    if not _MESSAGE.fullmatch(plan.setup):
        raise LocalProtocolError("E-PROGRAM-MESSAGE", plan.name, text=plan.setup)
    if not plan.stops:
        raise LocalProtocolError("E-PROGRAM-EMPTY", plan.name)
    words = setting.words
    out = [f"DEF INT {backup.VARIABLES}, K, WAITED", PREPARE]
    out += [f"{words.name(word)}=0" for word in (Word.COUNTER, Word.ECHO, Word.MISMATCHES, Word.RELEASE)]
    out += [f"{words.name(Word.TRANSACTION)}={token}", phase_block(words, Phase.BACKING_UP), "STOPRE"]
    out += [unless_aborted(words, _LEFT)]
    if plan.save_tables:
        saving = Saving("LIVE", token, plan.compensated_axis, plan.encoder, setting.memory)
        out += backup.blocks(saving, _FAILED)
    out += ["STOPRE", phase_block(words, Phase.MEASURING)]
    if plan.setup:
        out += [f'MSG("{plan.setup}")', "M0", 'MSG("")', "STOPRE", unless_aborted(words, _LEFT)]
    out += _stops(plan, setting)
    out += ["STOPRE", phase_block(words, Phase.FINISHED), "M30"]
    out += [f"{_LEFT}:", "STOPRE", phase_block(words, Phase.LEFT), "M30"]
    out += [f"{_FAILED}:", "STOPRE", phase_block(words, Phase.FILE_FAILED), "M30"]
    return text_of(out)


def _stops(plan: StopPlan, setting: Setting) -> list[str]:
    """All stops: one loop over the repetitions when they are alike, written out one by one else."""
    motion = Motion(plan.letter, setting.modulo, plan.feed, plan.overrun)
    rounds = [tuple(group) for _, group in groupby(plan.stops, key=lambda stop: stop.repetition)]
    if not _alike(rounds):
        return _sequence(plan, motion, plan.stops, "", setting)
    first, last = rounds[0][0].repetition, rounds[-1][0].repetition
    return [f"FOR K={first} TO {last}", *_sequence(plan, motion, rounds[0], "K", setting), "ENDFOR"]


def _alike(rounds: list[tuple[Stop, ...]]) -> bool:
    def shape(stops: tuple[Stop, ...]) -> list[tuple[float, int, int, bool | None]]:
        return [(stop.target, stop.approach, stop.label, stop.switch) for stop in stops]

    numbers = [stops[0].repetition for stops in rounds]
    in_order = numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    return len(rounds) > 1 and in_order and all(shape(stops) == shape(rounds[0]) for stops in rounds)


def _sequence(plan: StopPlan, motion: Motion, stops: tuple[Stop, ...], counter: str, setting: Setting) -> list[str]:
    out: list[str] = []
    for stop, leg in zip(stops, motion.legs(stops), strict=True):
        repetition = counter or str(stop.repetition)
        out += leg + _switch(plan, stop) + _handshake(plan, stop, repetition, setting)
    return out


def _switch(plan: StopPlan, stop: Stop) -> list[str]:
    if stop.switch is None:
        return []
    if plan.cross_table is not None:
        return ["STOPRE", f"$SN_CEC_TABLE_ENABLE[{plan.cross_table}]={int(stop.switch)}", "NEWCONF", "STOPRE"]
    enable = f"$MA_ENC_COMP_ENABLE[{plan.encoder},{plan.compensated_axis}]={int(stop.switch)}"
    return ["STOPRE", enable, "NEWCONF", "STOPRE"]


def _handshake(plan: StopPlan, stop: Stop, repetition: str, setting: Setting) -> list[str]:
    """Dwell, show where we are, count last, and wait until the count comes back."""
    words = setting.words
    shown = {
        Word.REPETITION: repetition,
        Word.LABEL: str(stop.label),
        Word.APPROACH: str(stop.approach),
        Word.TARGET: number(stop.target),
        Word.ENCODER_COMPENSATION: f"$VA_ENC{plan.encoder + 1}_COMP_VAL[{plan.compensated_axis}]",
        Word.CROSS_COMPENSATION: f"$VA_CEC_COMP_VAL[{plan.compensated_axis}]",
    }
    counter = words.name(Word.COUNTER)
    return [
        f"G4 F{number(plan.dwell_s)}",
        "STOPRE",
        *(f"{words.name(word)}={value}" for word, value in shown.items()),
        f"{counter}={counter}+1",
        "WAITED=0",
        f"WHILE {words.name(Word.ECHO)}<>{counter}",
        f"G4 F{number(POLL_S)}",
        "STOPRE",
        "WAITED=WAITED+1",
        unless_aborted(words, _LEFT),
        f"IF WAITED>{round(setting.wait_limit_s / POLL_S)} GOTOF {_LEFT}",
        "ENDWHILE",
    ]


def phase_block(words: Words, phase: Phase) -> str:
    """Show how far the program is."""
    return f"{words.name(Word.PHASE)}={int(phase)}"


def unless_aborted(words: Words, label: str) -> str:
    """Leave when the gateway set the abort word."""
    return f"IF {words.name(Word.ABORT)}<>0 GOTOF {label}"


def check_names(*names: str) -> None:
    """Refuse names that could break out of a block. Raises LocalProtocolError (E-PROGRAM-NAME)."""
    for name in names:
        if not _NAME.fullmatch(name):
            raise LocalProtocolError("E-PROGRAM-NAME", name, name=name)


def text_of(lines: list[str]) -> str:
    """Blocks as program text."""
    return "\n".join([*lines, ""])
