"""The sheet for the person who goes to the control: what to carry, what to press, what to bring back."""

from __future__ import annotations

from drivers.errors import words
from drivers.sinumerik.offline.folder import SEEN_FILE, SHEET, CarriedStep, stick_name

_LOOK = "TFSEE.MPF"


def carried_files(place: int, step: CarriedStep, text: str, look: str) -> dict[str, str]:
    """Everything that is carried for a step, by its name on the stick: its program, the looking one, form and sheet."""
    files = {stick_name(step.path): text, _LOOK: look, SEEN_FILE: typed_form(step.number)}
    return {**files, SHEET: sheet_text(place, step, restart=step.restart)}


def sheet_text(place: int, step: CarriedStep, *, restart: bool) -> str:
    """The sheet of one step; ``restart``: tables were switched on, and act after a restart."""
    program = stick_name(step.path)
    files = ", ".join(stick_name(path) for path in step.files)
    told = [words("W-OFF-TITLE", place=place, number=step.number, program=program), ""]
    lines = [
        "W-OFF-CARRY",
        "W-OFF-RESTART" if restart else "",
        "W-OFF-RUN",
        "W-OFF-MESSAGE",
        "W-OFF-BRING",
        "W-OFF-TYPE",
    ]
    programs = ", ".join(dict.fromkeys((program, _LOOK)))
    given = {"program": program, "programs": programs, "files": files, "form": SEEN_FILE, "look": _LOOK}
    shown = [words(code, **given) for code in lines if code]
    told += [f"{number}. {line}" for number, line in enumerate(shown, start=1)]
    if program != _LOOK:
        told += ["", words("W-OFF-TROUBLE", **given)]
    return "\n".join([*told, ""])


def typed_form(number: int) -> str:
    """The file that the person fills in at the control."""
    told = words("W-OFF-FORM")
    return "\n".join((f"# {told}", f"step = {number}", 'alarms = "?"', 'access_level = "?"', ""))
