"""A program of the wire's road -> the one that is carried: what the wire would say goes along, the answers are told.

Before its first block it checks that it stands in the right control, and that the step before it was the last one done
there; then it sets the R parameters that the gateway wrote. Where it would wait for the wire, it tells a stop and goes
on.
Every end tells how the control stands; whatever ends it otherwise leaves no report.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping

from drivers.sinumerik.ncprogram.heads import section
from drivers.sinumerik.ncprogram.measuring import PREPARE, PROVES, text_of
from drivers.sinumerik.ncprogram.motion import number as number_text
from drivers.sinumerik.ncprogram.pushing import ACTIVATE
from drivers.sinumerik.offline import report
from drivers.sinumerik.offline.report import SEEN, TOLD, ReportAsked

_END, _OTHER, _ORDER = "TF_TOLD", "TF_OTHER", "TF_ORDER"
_FILE = re.compile(r'WRITE\(\w+,"([^"]+)","([^"]*)"', re.ASCII)
_WAIT, _WAIT_END = "UWAITED=0", "ENDWHILE"
_DONE = 'MSG("TRUEFLANK NOTHING WAS DONE: {why}")'


def composed(text: str, number: int, asked: ReportAsked, serial: str, last: float, given: Mapping[int, float]) -> str:
    """The text that is carried as step ``number``.

    ``serial`` is the control's (MD18030), ``last`` what its chain word held when it was seen last, ``given`` R
    parameters by number.
    """
    lines = text.splitlines()
    place = next(at for at, line in enumerate(lines) if line and not line.startswith(";"))
    while lines[place].startswith("DEF "):
        place += 1
    body = _answered(lines[place:], asked, pauses=PROVES not in "\n".join(lines[:place]))
    begin = [f"DEF INT {report.ERROR}, {report.LINES}", section("the right control, the right step")]
    begin += [f'IF $MN_HW_SERIAL_NUMBER[0]<>"{serial}" GOTOF {_OTHER}']
    begin += ["STOPRE", f"IF {asked.chain}<>{_number(last)} GOTOF {_ORDER}", *report.begun(TOLD, number)]
    begin += [section("R parameters as the gateway wrote them")]
    begin += [f"R{place}={_number(value)}" for place, value in sorted(given.items())]
    ends = [section("how the control stands now"), f"{_END}:", "STOPRE", f"{asked.chain}={number}", "STOPRE"]
    ends += [*report.ended(TOLD, number, asked), "M30"]
    ends += _refusing(_OTHER, "ANOTHER MACHINE") + _refusing(_ORDER, "NOT THE NEXT STEP HERE")
    ends += _refusing(report.FAILED, "REPORT NOT WRITTEN", done=True)
    return text_of([*lines[:place], *begin, *body, *ends])


def looking(number: int, asked: ReportAsked) -> str:
    """The program that only tells how the control stands; it may run at any time."""
    out = [f"; TFSEE: tells how the control stands, number {number}", "; Moves: nothing. Writes: no table, no datum."]
    out += [f"DEF INT {report.ERROR}, {report.LINES}", *PREPARE, *report.begun(SEEN, number)]
    out += [*report.ended(SEEN, number, asked), "M30", *_refusing(report.FAILED, "REPORT NOT WRITTEN", done=True)]
    return text_of(out)


def digest(text: str) -> str:
    """What a program does, as a hash: its comments may name another run."""
    blocks = [line for line in text.splitlines() if not line.startswith(";")]
    return hashlib.sha256("\n".join(blocks).encode("ascii")).hexdigest()


def begins_of(text: str) -> dict[str, str]:
    """The files in the control that a program writes and that come back, in order; each with its first line."""
    begins: dict[str, str] = {}
    for path, line in _FILE.findall(text):
        if "_N_TFROOM" not in path:
            begins.setdefault(path, line)
    return begins


def _answered(lines: list[str], asked: ReportAsked, *, pauses: bool) -> list[str]:
    """The blocks with every end told and every wait for the gateway replaced; ``pauses`` for a person's readings."""
    out: list[str] = []
    waits = False
    for place, line in enumerate(lines):
        if line == _WAIT:
            waits = True
            out += report.at_stop(asked) + (_pause(asked) if pauses else [])
        elif waits:
            waits = line != _WAIT_END
        elif line == "M30" or (line == "M0" and lines[place - 1].startswith(f'MSG("{ACTIVATE}')):
            out.append(f"GOTOF {_END}")
        else:
            out.append(line)
    return out


def _pause(asked: ReportAsked) -> list[str]:
    """A person reads the instrument, notes what it shows, and goes on."""
    counter = asked.words.name(report.SHOWN[0])
    return [f'MSG("TRUEFLANK STOP "<<{counter}<<": NOTE THE READING, NC START")', "M0", 'MSG("")', "STOPRE"]


def _refusing(label: str, why: str, *, done: bool = False) -> list[str]:
    message = f'MSG("TRUEFLANK {why}")' if done else _DONE.format(why=why)
    return [f"{label}:", message, "M0", 'MSG("")', "M30"]


def _number(value: float) -> str:
    return str(int(value)) if float(value).is_integer() else number_text(value)
