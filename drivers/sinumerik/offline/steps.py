"""Steps of work by carried files: composing the program that goes out, and accepting the files that come back.

A carried program is that of the connected driver, changed in four ways: it first checks that it runs in the right
control and that the previous step was the last one done there; it sets the R parameters that the gateway would write;
where it would wait for the gateway it reports a stop and goes on; and every end writes the report. An end by an alarm
or a reset leaves no report, and the step stays unanswered.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from drivers.errors import FileFormatError
from drivers.local.textfile import parse_toml
from drivers.message import Message
from drivers.programs import DayNumbers, DwellPlan, Order, Origin, PaperMachine, ProgramText
from drivers.sinumerik.ncprogram.backup import END_WORD
from drivers.sinumerik.ncprogram.blocks import format_number as number_text
from drivers.sinumerik.ncprogram.blocks import section_comment
from drivers.sinumerik.ncprogram.checks import check_program
from drivers.sinumerik.ncprogram.measuring import PREPARE, PROVES, program_text
from drivers.sinumerik.ncprogram.pushing import ACTIVATE
from drivers.sinumerik.ncprogram.words import HALF, MARKED, MARKER_STATES, Word
from drivers.sinumerik.offline import report
from drivers.sinumerik.offline.folder import SEEN_FILE, Brought, CarriedStep, StepFolder, control_name, stick_name
from drivers.sinumerik.offline.report import PATHS, SEEN, TOLD, ReportRequest, SeenControl, StepReport
from drivers.sinumerik.offline.settings import OfflineSettings
from drivers.sinumerik.opcua import preview
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.workpiece import GrindPlan

# Composing.

_END, _OTHER, _ORDER = "TF_TOLD", "TF_OTHER", "TF_ORDER"
_FILE = re.compile(r'WRITE\(\w+,"([^"]+)","([^"]*)"', re.ASCII)
_WAIT, _WAIT_END = "UWAITED=0", "ENDWHILE"
_DONE = 'MSG("TRUEFLANK NOTHING WAS DONE: {why}")'


def compose_program(
    text: str, number: int, asked: ReportRequest, serial: str, last: float, given: Mapping[int, float]
) -> str:
    """The text that is carried as step ``number``.

    ``serial`` is the control's (MD18030), ``last`` what its chain word held when it was seen last, ``given`` R
    parameters by number.
    """
    lines = text.splitlines()
    place = next(at for at, line in enumerate(lines) if line and not line.startswith(";"))
    while lines[place].startswith("DEF "):
        place += 1
    body = _answered(lines[place:], asked, pauses=PROVES not in "\n".join(lines[:place]))
    begin = [f"DEF INT {report.ERROR}, {report.LINES}", section_comment("the right control, the right step")]
    begin += [f'IF $MN_HW_SERIAL_NUMBER[0]<>"{serial}" GOTOF {_OTHER}']
    begin += ["STOPRE", f"IF {asked.chain}<>{_number(last)} GOTOF {_ORDER}", *report.begin_blocks(TOLD, number)]
    begin += [section_comment("R parameters as the gateway wrote them")]
    begin += [f"R{place}={_number(value)}" for place, value in sorted(given.items())]
    ends = [section_comment("how the control stands now"), f"{_END}:", "STOPRE", f"{asked.chain}={number}", "STOPRE"]
    ends += [*report.end_blocks(TOLD, number, asked), "M30"]
    ends += _refusing(_OTHER, "ANOTHER MACHINE") + _refusing(_ORDER, "NOT THE NEXT STEP HERE")
    ends += _refusing(report.FAILED, "REPORT NOT WRITTEN", done=True)
    return program_text([*lines[:place], *begin, *body, *ends])


def looking_program(number: int, asked: ReportRequest) -> str:
    """The program that only tells how the control stands; it may run at any time."""
    out = [f"; TFSEE: tells how the control stands, number {number}", "; Moves: nothing. Writes: no table, no datum."]
    out += [f"DEF INT {report.ERROR}, {report.LINES}", *PREPARE, *report.begin_blocks(SEEN, number)]
    out += [*report.end_blocks(SEEN, number, asked), "M30", *_refusing(report.FAILED, "REPORT NOT WRITTEN", done=True)]
    return program_text(out)


def program_digest(text: str) -> str:
    """What a program does, as a hash: its comments may name another run."""
    blocks = [line for line in text.splitlines() if not line.startswith(";")]
    return hashlib.sha256("\n".join(blocks).encode("ascii")).hexdigest()


def first_lines_of(text: str) -> dict[str, str]:
    """The files in the control that a program writes and that come back, in order; each with its first line."""
    begins: dict[str, str] = {}
    for path, line in _FILE.findall(text):
        if "_N_TFROOM" not in path:
            begins.setdefault(path, line)
    return begins


def _answered(lines: list[str], asked: ReportRequest, *, pauses: bool) -> list[str]:
    """The blocks with every end told and every wait for the gateway replaced; ``pauses`` for a person's readings."""
    out: list[str] = []
    waits = False
    for place, line in enumerate(lines):
        if line == _WAIT:
            waits = True
            out += report.stop_blocks(asked) + (_pause(asked) if pauses else [])
        elif waits:
            waits = line != _WAIT_END
        elif line == "M30" or (line == "M0" and lines[place - 1].startswith(f'MSG("{ACTIVATE}')):
            out.append(f"GOTOF {_END}")
        else:
            out.append(line)
    return out


def _pause(asked: ReportRequest) -> list[str]:
    """A person reads the instrument, notes what it shows, and goes on."""
    counter = asked.words.name(report.SHOWN[0])
    return [f'MSG("TRUEFLANK STOP "<<{counter}<<": NOTE THE READING, NC START")', "M0", 'MSG("")', "STOPRE"]


def _refusing(label: str, why: str, *, done: bool = False) -> list[str]:
    message = f'MSG("TRUEFLANK {why}")' if done else _DONE.format(why=why)
    return [f"{label}:", message, "M0", 'MSG("")', "M30"]


def _number(value: float) -> str:
    return str(int(value)) if float(value).is_integer() else number_text(value)


# Accepting what was brought back.

_ENABLES = "_N_TFENAB_"


def check_carried_program(path: str, text: str, axes: Iterable[str]) -> None:
    """A program as it is carried must be legal too. Raises LocalProtocolError (E-PROGRAM-ILLEGAL)."""
    check_program(path, text, axes)


def needs_restart(steps: Sequence[CarriedStep]) -> bool:
    """Whether the control must be restarted before the newest step: the one before it switched tables on."""
    return len(steps) > 1 and _ENABLES in steps[-2].path and _ENABLES not in steps[-1].path


def find_answer(
    step: CarriedStep, brought: Brought, asked: ReportRequest, where: str, *, begins: Mapping[str, str]
) -> CarriedStep | None:
    """The step with what answers it; None where nothing was brought at all. ``begins`` are first lines of its files.

    The report of the looking program answers in place of the program's own: then the control tells where it stands.
    Raises FileFormatError: E-OFF-MISSING (a file is not there), E-OFF-OTHER (of another step), E-OFF-SEEN,
    E-OFF-REPORT (not whole, or damaged).
    """
    if not brought.names:
        return None
    if step.look == step.number:
        return _answer_of(step, brought, asked, where, kind=SEEN, begins=begins)
    try:
        return _answer_of(step, brought, asked, where, kind=TOLD, begins=begins)
    except FileFormatError:
        seen = brought.texts.get(_bare(PATHS[SEEN]), "")
        if not seen.startswith(report.first_line(SEEN, step.look)):
            raise
    return _answer_of(step, brought, asked, where, kind=SEEN, begins=begins)


def _answer_of(
    step: CarriedStep, brought: Brought, asked: ReportRequest, where: str, *, kind: str, begins: Mapping[str, str]
) -> CarriedStep:
    """The step by one of the two reports; by that of the looking program with what else there is and is whole."""
    number, wanted = (step.look, (PATHS[SEEN],)) if kind == SEEN else (step.number, step.files)
    missing = [path for path in wanted if _bare(path) not in brought.texts]
    if missing:
        names = ", ".join(stick_name(path) for path in missing)
        raise FileFormatError("E-OFF-MISSING", where, names=names, there=", ".join(brought.names))
    answers = {path: brought.texts[_bare(path)] for path in wanted}
    typed = _read_typed(brought, step.number, where)
    whole = replace(step, answers=answers, typed={**typed, "kind": kind, "number": number})
    seen_control(whole, asked, where)
    for path in step.files:
        if path in PATHS.values():
            continue
        try:
            _check_whole(brought.texts.get(_bare(path), ""), f"{where}: {stick_name(path)}", begins.get(path, ""))
        except FileFormatError:
            if kind == TOLD:
                raise
        else:
            whole.answers[path] = brought.texts[_bare(path)]
    return whole


def _bare(path: str) -> str:
    return control_name(path.rpartition("/")[2])


def seen_control(step: CarriedStep, asked: ReportRequest, where: str) -> SeenControl:
    """How the control stood by an answered step. Raises FileFormatError as `read_report`."""
    kind, number = str(step.typed["kind"]), int(step.typed["number"])
    place = f"{where}: {stick_name(PATHS[kind])}"
    found: StepReport = report.read_report(
        step.answers[PATHS[kind]], place, kind=kind, number=number, names=asked.names
    )
    alarms, level = tuple(step.typed["alarms"]), int(step.typed["access_level"])
    return SeenControl(found, asked, alarms=alarms, access_level=level, program=step.path).checked(where)


def _check_whole(text: str, where: str, begin: str) -> None:
    """Whether a file of tables is the one that begins so, with its end and as many lines as it says.

    ``begin`` "": its first line is not known. What it must hold, line by line, is judged when it is read.
    """
    lines = [line.rstrip() for line in text.rstrip().splitlines()]
    first = lines[0].split() if lines else []
    if len(first) < 3 or first[0] != ";TRUEFLANK":
        raise report.damaged_error(where, lines, 1, begin or "our program's first line")
    if begin and lines[0] != begin:
        raise report.other_run_error(where, lines[0], begin)
    if lines[-1] != END_WORD:
        raise report.damaged_error(where, lines, len(lines), Message.of("W-OFFLINE-END-WORD", end_word=END_WORD))
    if first[1] != "SELF":
        report.check_ends(lines, where, lines[0], f"{first[1]} {first[2]}")


def _read_typed(brought: Brought, number: int, where: str) -> dict[str, Any]:
    """What the person typed of the control's screen. Raises FileFormatError (E-OFF-SEEN)."""
    text = brought.texts.get(SEEN_FILE.upper())
    if text is None:
        raise FileFormatError("E-OFF-MISSING", where, names=SEEN_FILE, there=", ".join(brought.names))
    try:
        tree = parse_toml(text)
    except ValueError as error:
        raise FileFormatError("E-OFF-SEEN", where, key="the file", why=str(error)) from error
    if tree.get("step") != number:
        raise FileFormatError("E-OFF-OTHER", f"{where}: {SEEN_FILE}", found=f"step {tree.get('step')}", wanted=number)
    alarms, level = tree.get("alarms"), tree.get("access_level")
    if not isinstance(alarms, list) or not all(type(one) is int and 0 < one < 1_000_000 for one in alarms):
        raise FileFormatError("E-OFF-SEEN", where, key="alarms", why=Message.of("W-OFFLINE-ALARMS"))
    if type(level) is not int or not 0 <= level <= 7:
        raise FileFormatError("E-OFF-SEEN", where, key="access_level", why=Message.of("W-OFFLINE-0-7"))
    return {"alarms": alarms, "access_level": level}


# Previews: each program as if it were the next one to be carried. Serial number, last step and pending R parameters
# come from the folder; numbers that are drawn when a program is composed appear as `DayNumbers`.

_IN_PROGRESS = next(code for code, name in MARKER_STATES.items() if name == "in-progress")


@dataclass(frozen=True, slots=True)
class _Seen:
    """How the control stood when it was seen last: serial number, last step, and what is still to be told to it."""

    serial: str
    last: float = 0.0
    queued: Mapping[int, float] = field(default_factory=dict)


def preview_carried_programs(
    order: Order, settings: Mapping[str, Any], machine: PaperMachine, origin: Origin, where: str
) -> tuple[ProgramText, ...]:
    """Programs as they are carried (`drivers.sinumerik.opcua.preview.preview_programs`); none for a part.

    Raises ConfigError as the settings do and E-OFF-FOLDER, FileFormatError for a report that is damaged, and what
    writing and judging such a program raise.
    """
    if isinstance(order, GrindPlan):
        return ()
    own = OfflineSettings.read(settings, where)
    if isinstance(order, DwellPlan):
        return preview.preview_programs(order, own.road, machine, origin=origin, where=where)
    road = UaSettings.read(own.road, where)
    asked = ReportRequest(own.names, own.cross_tables, road.words, own.r_marker)
    whole = replace(machine, axes=own.names)
    seen = _seen(StepFolder(Path(own.folder), where), asked, _Seen(origin.machine), where)
    count = len(order) if isinstance(order, tuple) else 0
    found = []
    for one in preview.preview_programs(order, own.road, whole, origin=origin, where=where):
        given = _given(one.path, asked, machine.numbers, count=count, seen=seen)
        text = compose_program(one.text, machine.numbers.step, asked, serial=seen.serial, last=seen.last, given=given)
        check_carried_program(one.path, text, asked.axes)
        found.append(replace(one, text=text))
    return tuple(found)


def carried_program_numbers(text: str, settings: Mapping[str, Any], where: str) -> DayNumbers | None:
    """The numbers of a program as it is carried; None where it is none of ours."""
    own = OfflineSettings.read(settings, where)
    words = UaSettings.read(own.road, where).words
    step = re.search(re.escape(report.first_line(TOLD, 0)).removesuffix("0") + r"(\d+)", text)
    plain = preview.program_numbers(text, own.road, where)
    if step is None:
        return None
    high, low = (_word(text, words.number(word)) for word in (Word.HEAD_HIGH, Word.HEAD_LOW))
    order = plain.order if plain is not None else DayNumbers().order
    return DayNumbers(order=order, step=int(step[1]), head=high * HALF + low)


def _word(text: str, number: int) -> int:
    found = re.search(rf"^R{number}=(\d+)$", text, re.MULTILINE)
    return int(found[1]) if found is not None else 0


def _seen(folder: StepFolder, asked: ReportRequest, unseen: _Seen, where: str) -> _Seen:
    newest = folder.newest()
    if newest is None:
        return unseen
    image = seen_control(newest, asked, where)
    ended = not any(step.answered for step in folder.steps())
    queued = {int(number): value for number, value in newest.given.items()} if ended else {}
    return _Seen(image.serial.strip(), image.chain, queued)


def _given(path: str, asked: ReportRequest, numbers: DayNumbers, count: int, seen: _Seen) -> dict[int, float]:
    """R parameters that go along, by number: as the gateway writes them before it has such a program selected."""
    words = asked.words
    order = float(numbers.order)
    if "_N_TFENAB_" in path:
        released = {Word.PASSED: float((1 << count) - 1), Word.RELEASE: order}
        return {words.number(word): value for word, value in released.items()}
    cleared = {words.number(word): 0.0 for word in Word if word not in MARKED}
    if "_N_TFLOAD_" not in path:
        return {**seen.queued, **cleared}
    high, low = divmod(numbers.head, HALF)
    marked = {Word.MARKER: order, Word.MARKER_STATE: float(_IN_PROGRESS)}
    marked |= {Word.HEAD_HIGH: float(high), Word.HEAD_LOW: float(low)}
    return cleared | {words.number(word): value for word, value in marked.items()}
