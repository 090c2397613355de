"""GrindPlan -> NC program text: a disc ground space by space, each axis always from the same side.

Set-up values are not in the text: the program takes them from R parameters, once, and refuses them beyond the limits
of `drivers.workpiece`. While a blank can be clamped or C turns, X is retracted and Z beyond the face. What places the
wheel along its axis moves before the wheel is started, and the dresser's axis never. No table and no machine datum is
written. Words and phases: `drivers.sinumerik.ncprogram.unpack_text`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from drivers.errors import ConfigError, LocalProtocolError
from drivers.programs import NOBODY, Origin
from drivers.sinumerik.ncprogram import backup
from drivers.sinumerik.ncprogram.backup import BackupFile, ReservedPoints
from drivers.sinumerik.ncprogram.blocks import (
    ProgramArray,
    ProgramHead,
    add_head,
    declare_arrays,
    format_number,
    section_comment,
)
from drivers.sinumerik.ncprogram.checks import Guard, away_blocks, guard_blocks
from drivers.sinumerik.ncprogram.measuring import (
    PREPARE,
    check_names,
    file_failed_blocks,
    leave_if_aborted,
    phase_block,
    program_text,
)
from drivers.sinumerik.ncprogram.words import Phase, SetupWord, Word, Words, file_path, program_path
from drivers.workpiece import (
    INDEX_OVERRUN_DEG,
    MOST_C_DEG,
    MOST_DRESSING_MM,
    MOST_X_MM,
    WHEEL_OVERRUN_MM,
    GrindPlan,
    check_plan,
)

_MESSAGE = re.compile(r"[A-Za-z0-9 ()=.,:_/+-]{1,60}")
LOAD, UNLOAD = "TRUEFLANK LOAD BLANK", "TRUEFLANK UNLOAD PART"
_LEFT, _FAILED, _REFUSED, _STALE = "TF_LEFT", "TF_FAILED", "TF_REFUSED", "TF_STALE"
_STOPS = "retract X by hand, stop the wheel, press RESET; the part is scrap. No table was written."
NEVER_GIVEN = 999_999
_STROKE, _DEPTH, _FEED, _ENDS = "USTROKE", "UDEPTH", "UFEED", "UENDS"
_PLACES = {SetupWord.X: "UXSET", SetupWord.C: "UCSET", SetupWord.DRESSING: "UWSET"}
_MOST = {"UXSET": MOST_X_MM, "UCSET": MOST_C_DEG, "UWSET": MOST_DRESSING_MM}


@dataclass(frozen=True, slots=True)
class GrindSetting:
    """What the generator must know of a machine: R words, memory of each compensated axis, whether C is endless.

    ``loops``: the control fills arrays of a program's own by SET; False where its self-test found that it does not.
    """

    words: Words
    memory: Mapping[str, ReservedPoints]
    modulo: bool = True
    origin: Origin = NOBODY
    guards: tuple[Guard, ...] = ()
    loops: bool = True


def preview_program(plan: GrindPlan, words: Words) -> str:
    """The program as it would be sent, but for the blocks that save the live tables: those need the machine.

    Raises as `build_grinding_program`.
    """
    return _text(plan, NEVER_GIVEN, GrindSetting(words, {}), saves=False)


def build_grinding_program(plan: GrindPlan, token: int, setting: GrindSetting) -> str:
    """The program of a plan; ``token`` is echoed so that an older program's words are never taken.

    It runs once, and only while the release word is the token: started again, or after its gateway has gone, it ends
    at once.
    Raises ConfigError as `check_plan` and `set_up_parameters`, LocalProtocolError (E-PROGRAM-NAME, E-PROGRAM-MESSAGE).
    """
    return _text(plan, token, setting, saves=plan.save_tables)


def _text(plan: GrindPlan, token: int, setting: GrindSetting, *, saves: bool) -> str:
    check_plan(plan)
    check_names(*(name for axis in plan.named for name in (axis.name, axis.letter)))
    if not _MESSAGE.fullmatch(plan.part):
        raise LocalProtocolError("E-PROGRAM-MESSAGE", plan.name, text=plan.part)
    words = setting.words
    out = [
        f"DEF INT {backup.VARIABLES}, USPACE{f', {_STROKE}' if setting.loops else ''}",
        f"DEF REAL {', '.join(_places(plan).values())}, UCAT",
        *(declare_arrays(_table(plan)) if setting.loops else ()),
        section_comment("modal states, R words"),
        *PREPARE,
    ]
    out += ["STOPRE", f"IF {words.name(Word.RELEASE)}<>{token} GOTOF {_STALE}"]
    out += [f"{words.name(word)}=0" for word in (Word.COUNTER, Word.ECHO, Word.MISMATCHES, Word.RELEASE)]
    out += [f"{words.name(Word.TRANSACTION)}={token}", phase_block(words, Phase.BACKING_UP), "STOPRE"]
    out += [leave_if_aborted(words, _LEFT), *_taken(plan, words)]
    if saves:
        for axis in plan.compensated:
            memory = setting.memory[axis.name]
            out += [section_comment(f"live tables and switches of {axis.name} into a file")]
            out += backup.backup_blocks(
                BackupFile(section="LIVE", number=token, axis=axis.name, encoder=axis.encoder, memory=memory), _FAILED
            )
    out += [section_comment("wheel clear, blank"), "STOPRE", phase_block(words, Phase.GRINDING)]
    out += [*guard_blocks(words, setting.guards), *_clear(plan)]
    out += [*_person(f"{LOAD} {plan.part}"), leave_if_aborted(words, _LEFT)]
    out += [
        *(
            [section_comment("strokes"), *(block for one in _table(plan) for block in one.filled)]
            if setting.loops
            else []
        ),
        section_comment("space by space"),
        *([plan.wheel_on] if plan.wheel_on else []),
        *_spaces(plan, setting, loops=setting.loops),
        *_stopped(plan),
    ]
    out += [
        section_comment("part out"),
        *_person(f"{UNLOAD} {plan.part}"),
        phase_block(words, Phase.FINISHED),
        "M30",
    ]
    out += [section_comment("ways out"), f"{_LEFT}:", "STOPRE", *_stopped(plan), phase_block(words, Phase.LEFT), "M30"]
    out += [*away_blocks(words, setting.guards), *file_failed_blocks(words, _FAILED)]
    out += [f"{_REFUSED}:", "STOPRE", phase_block(words, Phase.SETUP_REFUSED), "M30"]
    out += [f"{_STALE}:", "M30"]
    return program_text(add_head(_head(plan, setting, saves=saves), out, moves=all_moves(plan, setting)))


def all_moves(plan: GrindPlan, setting: GrindSetting) -> list[str]:
    """All moves, with every stroke written out: what a program says of its moves is read from these blocks."""
    return [*_clear(plan), *_spaces(plan, setting, loops=False)]


def _head(plan: GrindPlan, setting: GrindSetting, *, saves: bool) -> ProgramHead:
    files = ", ".join(file_path("LIVE", axis.name) for axis in plan.compensated)
    also = "The wheel runs. X is retracted before C turns." + (f" Saves what acts in {files}." if saves else "")
    what = f"test part {plan.part}, {plan.spaces} spaces"
    return ProgramHead(program_path("GRIND", plan.index.name), what, stops=_STOPS, origin=setting.origin, also=also)


def set_up_variables(plan: GrindPlan) -> dict[str, float]:
    """What the program's own variables hold with this plan's set-up values; not where C turns."""
    return {"UXSET": plan.x_mm, "UWSET": plan.dressing_mm}


def set_up_parameters(plan: GrindPlan, words: Words) -> dict[int, float]:
    """R parameters by number, with the values that a program of this plan and its dressing program take from them.

    Raises ConfigError (E-GRIND-OFFSET) where the offset's parameter is one of our own words.
    """
    values = {SetupWord.X: plan.x_mm, SetupWord.C: plan.c_deg, SetupWord.DRESSING: plan.dressing_mm}
    out = {words.setup_number(word): values[word] for word in _places(plan)}
    offset = plan.wheel_offset
    if offset is not None and words.setup_number(SetupWord.DRESSING) != offset:
        if offset in out or words.first <= offset < words.first + len(Word):
            key, first, setup = "wheel_place", words.first, words.setup
            raise ConfigError("E-GRIND-OFFSET", plan.name, key=key, number=offset, first=first, setup=setup)
        out[offset] = plan.dressing_mm
    return out


def fixed_axes(plan: GrindPlan) -> tuple[str, ...]:
    """What no block of the program may move: the dresser's axis, by letter and name."""
    return () if plan.dresser is None else (plan.dresser.letter, plan.dresser.name)


def _places(plan: GrindPlan) -> dict[SetupWord, str]:
    """The program's variables of the set-up values that it needs."""
    wanted = (word for word in _PLACES if word is not SetupWord.DRESSING or plan.places_wheel)
    return {word: _PLACES[word] for word in wanted}


def _taken(plan: GrindPlan, words: Words) -> list[str]:
    """Set-up values into variables of our own, so that nothing changes them under way; refused beyond their limits.

    So is another offset in the parameter of the dressing program than the one that this part is ground with.
    """
    names = _places(plan)
    taken = [f"{name}=R{words.setup_number(word)}" for word, name in names.items()]
    taken += [f"IF ABS({name})>{format_number(_MOST[name])} GOTOF {_REFUSED}" for name in names.values()]
    offsets = set_up_parameters(plan, words).keys() - {words.setup_number(word) for word in names}
    return [*taken, *(f"IF R{offset}<>UWSET GOTOF {_REFUSED}" for offset in sorted(offsets))]


def _person(message: str) -> list[str]:
    return ["STOPRE", f'MSG("{message}")', "M0", 'MSG("")', "STOPRE"]


def _stopped(plan: GrindPlan) -> list[str]:
    return [plan.wheel_off] if plan.wheel_off else []


def _move(letter: str, place: str, feed: float) -> str:
    return f"SUPA G1 {letter}={place} F={format_number(feed)}"


def _retract(plan: GrindPlan) -> str:
    return _move(plan.infeed.letter, format_number(plan.retracted_mm), plan.positioning_feed)


def _clear(plan: GrindPlan) -> list[str]:
    """From anywhere to where a blank can be clamped: X first; then the wheel comes up to its place along its axis.

    The wheel stands then: it is started once the blank is clamped.
    """
    feed = plan.positioning_feed
    out = [] if plan.wheel is None else _stopped(plan)
    out += [_retract(plan), _move(plan.stroke.letter, format_number(plan.ends_mm[0]), feed)]
    if plan.wheel is not None:
        for place in (plan.wheel_mm - WHEEL_OVERRUN_MM, plan.wheel_mm):
            far = f"{'-' if place < 0 else '+'}{format_number(abs(place))}" if place else ""
            out.append(_move(plan.wheel.letter, f"UWSET{far}", feed))
    return out


def _spaces(plan: GrindPlan, setting: GrindSetting, *, loops: bool) -> list[str]:
    words, letter, feed = setting.words, plan.index.letter, plan.index_feed
    back, on = ("+", "-") if plan.index_sense < 0 else ("-", "+")
    begin = [f"UCAT=UCSET{back}{format_number(INDEX_OVERRUN_DEG)}", *_turn(setting)]
    turn = [f"UCAT=UCSET{on}USPACE*360.0/{plan.spaces}", *_turn(setting)]
    way = "ACN" if plan.index_sense < 0 else "ACP"
    counter = words.name(Word.COUNTER)
    return [
        *begin,
        _move(letter, "DC(UCAT)" if setting.modulo else "UCAT", feed),
        f"FOR USPACE=0 TO {plan.spaces - 1}",
        *turn,
        _move(letter, f"{way}(UCAT)" if setting.modulo else "UCAT", feed),
        f"G4 F{format_number(plan.dwell_s)}",
        *_strokes(plan, loops=loops),
        "STOPRE",
        f"{counter}={counter}+1",
        leave_if_aborted(words, _LEFT),
        "ENDFOR",
    ]


def _turn(setting: GrindSetting) -> list[str]:
    """A place of an endless axis is written as 0 to 360."""
    return ["IF UCAT<0", "UCAT=UCAT+360.0", "ENDIF"] if setting.modulo else []


def _table(plan: GrindPlan) -> tuple[ProgramArray, ProgramArray, ProgramArray]:
    """Where X is for each stroke, how fast it comes there, and where Z goes then."""
    low, high = (format_number(end) for end in plan.ends_mm)
    depths = tuple(format_number(plan.centre_distance_mm + short) for short in plan.strokes)
    feeds = tuple(format_number(plan.infeed_feed if place else plan.air_cut_feed) for place in range(len(depths)))
    ends = tuple(low if place % 2 else high for place in range(len(depths)))
    return ProgramArray(_DEPTH, "REAL", depths), ProgramArray(_FEED, "REAL", feeds), ProgramArray(_ENDS, "REAL", ends)


def _strokes(plan: GrindPlan, *, loops: bool) -> list[str]:
    """One space: X comes up to each depth while Z is beyond the face; afterwards X back, and Z where it began.

    Beyond the face the wheel still reaches over it, so the positioning feed ends outside the stock of the blank. In the
    loop a stroke at the depth of the one before has a block of X that moves nothing.
    """
    low, high = (format_number(end) for end in plan.ends_mm)
    out = [_infeed(plan, plan.approach_mm, plan.positioning_feed)]
    home = [_move(plan.stroke.letter, low, plan.positioning_feed)] if len(plan.strokes) % 2 else []
    if loops:
        out += [f"FOR {_STROKE}=0 TO {len(plan.strokes) - 1}"]
        out += [f"SUPA G1 {plan.infeed.letter}=UXSET-{_DEPTH}[{_STROKE}] F={_FEED}[{_STROKE}]"]
        out += [_move(plan.stroke.letter, f"{_ENDS}[{_STROKE}]", plan.stroke_feed), "ENDFOR"]
        return [*out, _retract(plan), *home]
    before: float | None = None
    for count, short in enumerate(plan.strokes):
        if short != before:
            out.append(_infeed(plan, short, plan.air_cut_feed if before is None else plan.infeed_feed))
        out.append(_move(plan.stroke.letter, low if count % 2 else high, plan.stroke_feed))
        before = short
    return [*out, _retract(plan), *home]


def _infeed(plan: GrindPlan, short: float, feed: float) -> str:
    """To so far short of full depth."""
    return _move(plan.infeed.letter, f"UXSET-{format_number(plan.centre_distance_mm + short)}", feed)
