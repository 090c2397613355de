"""The programs that would be carried, written without a control: each as if it were the next one that goes there.

What the control said when it was seen last is taken from the folder: its serial number, the number of the last step,
what its next program is still to be told. Numbers that are drawn when a program is composed stand as `DayNumbers`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from drivers.programs import DayNumbers, DwellPlan, Order, Origin, PaperMachine, ProgramText
from drivers.sinumerik.ncprogram.words import HALF, MARKED, MARKER_STATES, Word
from drivers.sinumerik.offline import answering, composing, report
from drivers.sinumerik.offline.folder import StepFolder
from drivers.sinumerik.offline.report import TOLD, ReportAsked
from drivers.sinumerik.offline.settings import OfflineSettings
from drivers.sinumerik.opcua import paper
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.workpiece import GrindPlan

_IN_PROGRESS = next(code for code, name in MARKER_STATES.items() if name == "in-progress")


@dataclass(frozen=True, slots=True)
class _Seen:
    """How the control stood when it was seen last: serial number, last step, and what is still to be told to it."""

    serial: str
    last: float = 0.0
    queued: Mapping[int, float] = field(default_factory=dict)


def on_paper(
    order: Order, settings: Mapping[str, Any], machine: PaperMachine, origin: Origin, where: str
) -> tuple[ProgramText, ...]:
    """As `drivers.sinumerik.opcua.paper.on_paper`, as they are carried; none for a part, which is not ground so.

    Raises ConfigError as the settings do and E-OFF-FOLDER, FileFormatError for a report that is damaged, and what
    writing and judging such a program raise.
    """
    if isinstance(order, GrindPlan):
        return ()
    own = OfflineSettings.read(settings, where)
    if isinstance(order, DwellPlan):
        return paper.on_paper(order, own.road, machine, origin=origin, where=where)
    road = UaSettings.read(own.road, where)
    asked = ReportAsked(own.names, own.cross_tables, road.words, own.r_marker)
    whole = replace(machine, axes=own.names)
    seen = _seen(StepFolder(Path(own.folder), where), asked, _Seen(origin.machine), where)
    count = len(order) if isinstance(order, tuple) else 0
    found = []
    for one in paper.on_paper(order, own.road, whole, origin=origin, where=where):
        given = _given(one.path, asked, machine.numbers, count=count, seen=seen)
        text = composing.composed(
            one.text, machine.numbers.step, asked, serial=seen.serial, last=seen.last, given=given
        )
        answering.judge(one.path, text, asked.axes)
        found.append(replace(one, text=text))
    return tuple(found)


def numbers_of(text: str, settings: Mapping[str, Any], where: str) -> DayNumbers | None:
    """The numbers of a program as it is carried; None where it is none of ours."""
    own = OfflineSettings.read(settings, where)
    words = UaSettings.read(own.road, where).words
    step = re.search(re.escape(report.first_line(TOLD, 0)).removesuffix("0") + r"(\d+)", text)
    plain = paper.numbers_of(text, own.road, where)
    if step is None:
        return None
    high, low = (_word(text, words.number(word)) for word in (Word.HEAD_HIGH, Word.HEAD_LOW))
    order = plain.order if plain is not None else DayNumbers().order
    return DayNumbers(order=order, step=int(step[1]), head=high * HALF + low)


def _word(text: str, number: int) -> int:
    found = re.search(rf"^R{number}=(\d+)$", text, re.MULTILINE)
    return int(found[1]) if found is not None else 0


def _seen(folder: StepFolder, asked: ReportAsked, unseen: _Seen, where: str) -> _Seen:
    newest = folder.newest()
    if newest is None:
        return unseen
    image = answering.image_of(newest, asked, where)
    ended = not any(step.answered for step in folder.steps())
    queued = {int(number): value for number, value in newest.given.items()} if ended else {}
    return _Seen(image.serial.strip(), image.chain, queued)


def _given(path: str, asked: ReportAsked, numbers: DayNumbers, count: int, seen: _Seen) -> dict[int, float]:
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
