"""Whether what was brought back answers a step: every file there, whole, of this very run, and what a person typed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from drivers.errors import FileFormatError
from drivers.local.tomlfile import parse_toml
from drivers.sinumerik.ncprogram.backup import END_WORD
from drivers.sinumerik.ncprogram.legal import legal
from drivers.sinumerik.offline import report
from drivers.sinumerik.offline.folder import SEEN_FILE, Brought, CarriedStep, bare, stick_name
from drivers.sinumerik.offline.image import SeenControl
from drivers.sinumerik.offline.report import PATHS, SEEN, TOLD, ReportAsked, ToldReport

_ENABLES = "_N_TFENAB_"


def judge(path: str, text: str, axes: Iterable[str]) -> None:
    """A program as it is carried must be legal too. Raises LocalProtocolError (E-PROGRAM-ILLEGAL)."""
    legal(path, text, axes)


def restarts(steps: Sequence[CarriedStep]) -> bool:
    """Whether the control must be restarted before the newest step: the one before it switched tables on."""
    return len(steps) > 1 and _ENABLES in steps[-2].path and _ENABLES not in steps[-1].path


def taken(
    step: CarriedStep, brought: Brought, asked: ReportAsked, where: str, *, begins: Mapping[str, str]
) -> CarriedStep | None:
    """The step with what answers it; None where nothing was brought at all. ``begins`` are first lines of its files.

    The report of the looking program answers in place of the program's own: then the control tells where it stands.
    Raises FileFormatError: E-OFF-MISSING (a file is not there), E-OFF-OTHER (of another step), E-OFF-SEEN,
    E-OFF-REPORT (not whole, or damaged).
    """
    if not brought.names:
        return None
    if step.look == step.number:
        return _taken(step, brought, asked, where, kind=SEEN, begins=begins)
    try:
        return _taken(step, brought, asked, where, kind=TOLD, begins=begins)
    except FileFormatError:
        seen = brought.texts.get(_bare(PATHS[SEEN]), "")
        if not seen.startswith(report.first_line(SEEN, step.look)):
            raise
    return _taken(step, brought, asked, where, kind=SEEN, begins=begins)


def _taken(
    step: CarriedStep, brought: Brought, asked: ReportAsked, where: str, *, kind: str, begins: Mapping[str, str]
) -> CarriedStep:
    """The step by one of the two reports; by that of the looking program with what else there is and is whole."""
    number, wanted = (step.look, (PATHS[SEEN],)) if kind == SEEN else (step.number, step.files)
    missing = [path for path in wanted if _bare(path) not in brought.texts]
    if missing:
        names = ", ".join(stick_name(path) for path in missing)
        raise FileFormatError("E-OFF-MISSING", where, names=names, there=", ".join(brought.names))
    answers = {path: brought.texts[_bare(path)] for path in wanted}
    typed = _typed(brought, step.number, where)
    whole = replace(step, answers=answers, typed={**typed, "kind": kind, "number": number})
    image_of(whole, asked, where)
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
    return bare(path.rpartition("/")[2])


def image_of(step: CarriedStep, asked: ReportAsked, where: str) -> SeenControl:
    """How the control stood by an answered step. Raises FileFormatError as `report.read`."""
    kind, number = str(step.typed["kind"]), int(step.typed["number"])
    place = f"{where}: {stick_name(PATHS[kind])}"
    found: ToldReport = report.read(step.answers[PATHS[kind]], place, kind=kind, number=number, names=asked.names)
    alarms, level = tuple(step.typed["alarms"]), int(step.typed["access_level"])
    return SeenControl(found, asked, alarms=alarms, access_level=level, program=step.path).checked(where)


def _check_whole(text: str, where: str, begin: str) -> None:
    """Whether a file of tables is the one that begins so, with its end and as many lines as it says.

    ``begin`` "": its first line is not known. What it must hold, line by line, is judged when it is read.
    """
    lines = [line.rstrip() for line in text.rstrip().splitlines()]
    first = lines[0].split() if lines else []
    if len(first) < 3 or first[0] != ";TRUEFLANK":
        raise report.damaged(where, lines, 1, begin or "our program's first line")
    if begin and lines[0] != begin:
        raise report.of_another(where, lines[0], begin)
    if lines[-1] != END_WORD:
        raise report.damaged(where, lines, len(lines), f"{END_WORD} at its end")
    if first[1] != "SELF":
        report.check_ends(lines, where, lines[0], f"{first[1]} {first[2]}")


def _typed(brought: Brought, number: int, where: str) -> dict[str, Any]:
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
        raise FileFormatError("E-OFF-SEEN", where, key="alarms", why="a list of alarm numbers, [] for none")
    if type(level) is not int or not 0 <= level <= 7:
        raise FileFormatError("E-OFF-SEEN", where, key="access_level", why="a number from 0 to 7")
    return {"alarms": alarms, "access_level": level}
