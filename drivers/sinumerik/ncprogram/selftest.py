"""The self-test: a program without motion that tries every word which the other programs need, and says how it went.

It writes no value that acts: a switch gets the value it has, and of a cross table that was never loaded and is off one
parameter is written, read back and cleared. Before each trial its number stands in the counter word, so that an alarm
names the trial that it broke; what went well is a line of the file TFSELF.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from drivers.sinumerik.ncprogram import backup
from drivers.sinumerik.ncprogram.backup import BackupFile
from drivers.sinumerik.ncprogram.blocks import ProgramHead, add_head, section_comment
from drivers.sinumerik.ncprogram.measuring import (
    PREPARE,
    MachineSetting,
    check_names,
    file_failed_blocks,
    leave_if_aborted,
    phase_block,
    program_text,
)
from drivers.sinumerik.ncprogram.words import Phase, Word, Words, file_path, program_path

PRESS = "TRUEFLANK SELF-TEST PRESS NC START"
LOOPS = "LISTS INTO ARRAYS"
"""The word that programs can do without: they are written out one by one then. It is tried last."""
_LEFT, _FAILED = "TF_LEFT", "TF_FAILED"
_OLD, _LINE, _TABLE = "UOLD", "ULINE", "UTABLE"
_STOPS = "press RESET: nothing that acts was written. R{counter} holds the number of the trial that was not passed."
_FULL_LINE = 180
_FIRST = re.compile(r";TRUEFLANK SELF (\d+) (\w+)", re.ASCII)
_DATE = re.compile(r";AT (\d{4})-(\d{1,2})-(\d{1,2})", re.ASCII)
_TRIED = re.compile(r";(PASSED|NOT PASSED) \d+ (.+)", re.ASCII)


@dataclass(frozen=True, slots=True)
class Trial:
    """One thing tried: its word in the report, the blocks, and the condition that must hold behind them."""

    word: str
    blocks: tuple[str, ...]
    holds: str


def build_self_test_program(axis: str, encoder: int, number: int, setting: MachineSetting) -> str:
    """The program, for one compensated axis. Raises LocalProtocolError (E-PROGRAM-NAME)."""
    check_names(axis)
    words, path = setting.words, file_path("SELF", axis)
    trials = tuple(_trials(axis, encoder, path, setting))
    out = [f"DEF INT {backup.VARIABLES}, {_OLD}", f"DEF STRING[200] {_LINE}[2]"]
    out += [f"DEF REAL {_TABLE}[3]"] if setting.loops else []
    out += [section_comment("modal states, R words"), *PREPARE]
    out += [f"{words.name(word)}=0" for word in (Word.COUNTER, Word.ECHO, Word.MISMATCHES, Word.RELEASE)]
    out += [f"{words.name(Word.TRANSACTION)}={number}", "STOPRE", leave_if_aborted(words, _LEFT)]
    out += [f'DELETE({backup.ERROR},"{path}")', *_report_line(path, f";TRUEFLANK SELF {number} {axis}")]
    day = '";AT "<<$A_YEAR<<"-"<<$A_MONTH<<"-"<<$A_DAY'
    out += [f'WRITE({backup.ERROR},"{path}",{day})', f"IF {backup.ERROR}<>0 GOTOF {_FAILED}"]
    for place, trial in enumerate(trials, start=1):
        out += [section_comment(trial.word), "STOPRE", f"{words.name(Word.COUNTER)}={place}", *trial.blocks]
        out += [f"IF {trial.holds}", *_report_line(path, f";PASSED {place} {trial.word}"), "ELSE"]
        out += [*_report_line(path, f";NOT PASSED {place} {trial.word}"), _counted(words), "ENDIF"]
    out += [
        section_comment("the end"),
        *_report_line(path, f";TRUEFLANK END {len(trials)}"),
        *_report_line(path, backup.END_WORD),
    ]
    out += ["STOPRE", phase_block(words, Phase.FINISHED), "M30", section_comment("ways out")]
    out += [f"{_LEFT}:", "STOPRE", phase_block(words, Phase.LEFT), "M30", *file_failed_blocks(words, _FAILED)]
    stops = _STOPS.format(counter=words.number(Word.COUNTER))
    what = f"self-test of every word our programs need, {len(trials)} trials"
    also = f"Says what passed in {path}."
    return program_text(
        add_head(ProgramHead(program_path("SELF", axis), what, stops=stops, origin=setting.origin, also=also), out)
    )


def trial_words(axis: str, encoder: int, setting: MachineSetting) -> tuple[str, ...]:
    """What is tried, in order."""
    return tuple(trial.word for trial in _trials(axis, encoder, file_path("SELF", axis), setting))


@dataclass(frozen=True, slots=True)
class SelfTestReport:
    """What a self-test's file says: the control's own date, the number of the program that wrote it, words passed and
    not passed, whether it came to its end.
    """

    date: str
    number: int
    passed: tuple[str, ...]
    failed: tuple[str, ...]
    whole: bool


def read_self_test_report(text: str, axis: str) -> SelfTestReport | None:
    """The report of an axis' self-test; None for any other file."""
    lines = [line.rstrip() for line in text.rstrip().splitlines()]
    first = _FIRST.fullmatch(lines[0]) if len(lines) > 1 else None
    if first is None or first[2] != axis:
        return None
    found = [(match[1] == "PASSED", match[2]) for line in lines if (match := _TRIED.fullmatch(line))]
    date = _DATE.fullmatch(lines[1])
    return SelfTestReport(
        "-".join(f"{int(part):02}" for part in date.groups()) if date else "an unknown day",
        int(first[1]),
        passed=tuple(word for passed, word in found if passed),
        failed=tuple(word for passed, word in found if not passed),
        whole=lines[-2:] == [f";TRUEFLANK END {len(found)}", backup.END_WORD] and bool(found),
    )


def _report_line(path: str, text: str) -> list[str]:
    return [f'WRITE({backup.ERROR},"{path}","{text}")', f"IF {backup.ERROR}<>0 GOTOF {_FAILED}"]


def _counted(words: Words) -> str:
    miss = words.name(Word.MISMATCHES)
    return f"{miss}={miss}+1"


def _trials(axis: str, encoder: int, path: str, setting: MachineSetting) -> Iterator[Trial]:
    words, memory = setting.words, setting.memory
    point, error = backup.POINT, backup.ERROR
    yield Trial("DEF AND FOR", (f"{_OLD}=0", f"FOR {point}=1 TO 3", f"{_OLD}={_OLD}+1", "ENDFOR"), f"{_OLD}==3")
    yield Trial("ISFILE", (), f'ISFILE("{path}")')
    yield Trial("READ", (f'READ({error},"{path}",1,1,{_LINE})',), f"{error}==0")
    yield Trial("R WORDS", (f"{words.name(Word.TARGET)}=-12.5", "STOPRE"), f"{words.name(Word.TARGET)}==-12.5")
    yield Trial("NEWCONF", ("NEWCONF", "STOPRE"), "TRUE")
    saving = BackupFile(section="LIVE", number=1, axis=axis, encoder=encoder, memory=memory)
    for name in _reading_trials(saving):
        yield Trial(f"VALUE OF {name}", (f'{_LINE}[0]="V"<<{name}',), f'{_LINE}[0]<>"V"')
    for switch in _switches(saving):
        blocks = (f"{_OLD}={switch}", f"{switch}={_OLD}", "STOPRE")
        yield Trial(f"RIGHT TO {switch}", blocks, f"{switch}=={_OLD}")
    for table in backup.reserved_tables(memory)[:1]:
        yield _product(table)
    yield _room(path, saving)
    yield Trial("MSG AND M0", (f'MSG("{PRESS}")', "M0", 'MSG("")', "STOPRE"), "TRUE")
    if setting.loops:
        filled = (f"{_TABLE}[0]=SET(1.5,-2.5)", f"{_TABLE}[2]=SET(4.0)", f"{_OLD}=0", f"FOR {point}=0 TO 2")
        summed = f"IF {_TABLE}[{point}]<>0"
        yield Trial(LOOPS, (*filled, summed, f"{_OLD}={_OLD}+1", "ENDIF", "ENDFOR"), f"({_OLD}==3) AND ({_TABLE}[2]>3)")


def _reading_trials(saving: BackupFile) -> Iterator[str]:
    """One of every kind of variable that our programs read."""
    if saving.memory.eec_points:
        yield backup.axis_points(saving).places[0]
        yield from backup.axis_parameters(saving)
        yield f"$VA_ENC{saving.encoder + 1}_COMP_VAL[{saving.axis}]"
    yield f"$VA_CEC_COMP_VAL[{saving.axis}]"
    for table in backup.reserved_tables(saving.memory)[:1]:
        yield backup.cross_points(table, saving).places[0]
        yield from backup.cross_parameters(table)
        yield from backup.cross_switches(table)
    yield from backup.axis_settings(saving)


def _switches(saving: BackupFile) -> Iterator[str]:
    if saving.memory.eec_points:
        yield f"$MA_ENC_COMP_ENABLE[{saving.encoder},{saving.axis}]"
    if saving.memory.cec_points:
        yield f"$MA_CEC_ENABLE[{saving.axis}]"
    for table in backup.reserved_tables(saving.memory)[:1]:
        yield backup.cross_switches(table)[0]


def _product(table: int) -> Trial:
    """MULT_BY_TABLE of a table that was never loaded and is off: written, read back, cleared; left alone else."""
    name = f"$AN_CEC_MULT_BY_TABLE[{table}]"
    switch = backup.cross_switches(table)[0]
    blocks = [f"{_OLD}=1", f"IF ({backup.cross_step(table)}==0) AND ({switch}==0) AND ({name}==0)"]
    blocks += [f"{name}=1", "STOPRE", f"{_OLD}={name}", f"{name}=0", "STOPRE", "ENDIF"]
    return Trial(f"PRODUCT OF TABLE {table}", tuple(blocks), f"({_OLD}==1) AND ({name}==0)")


def _room(path: str, saving: BackupFile) -> Trial:
    """A file as long as the longest that we write: it fits, and can be deleted."""
    other, error = path.replace("_N_TFSELF", "_N_TFROOM"), backup.ERROR
    lines = backup.required_kilobytes([saving]) * 1024 // (_FULL_LINE + 1)
    write = f'WRITE({error},"{other}","{";" + "0" * (_FULL_LINE - 1)}")'
    blocks = [f'DELETE({error},"{other}")', f"{_OLD}=0", f"FOR {backup.POINT}=1 TO {lines}", write]
    blocks += [f"IF {error}<>0", f"{_OLD}={error}", "ENDIF", "ENDFOR", f'DELETE({error},"{other}")']
    return Trial(f"ROOM FOR A FILE OF {lines * (_FULL_LINE + 1)} BYTES", tuple(blocks), f"({_OLD}==0) AND ({error}==0)")
