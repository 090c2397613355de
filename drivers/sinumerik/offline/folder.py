"""The folder of a control without a wire: what is to be carried, what came back, and every step that was done.

``carry`` is what goes to the control, ``back`` where files from it are put; ``steps/NNN`` keeps each step for good: the
program as it was carried, and the files that answered it, copied before anything is made of them. A step is on the disk
before people are told to carry it. ``done`` keeps the steps of work that has come to its end.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from drivers.errors import ConfigError, FileFormatError, words
from drivers.local.ownfiles import make_own_folder, open_own, read_own
from drivers.local.textfile import decode_text
from drivers.message import Message

CARRY, BACK, STEPS, DONE = "carry", "back", "steps", "done"
SHEET, SEEN_FILE, PROBLEM, LAST = "SHEET.txt", "SEEN.toml", "PROBLEM.txt", "last.json"
WORK = "work.txt"
_BROUGHT = ("_SPF", "_MPF", SEEN_FILE.upper())
_TO_CARRY = (SHEET, SEEN_FILE, PROBLEM)
MOST_BYTES = 4 << 20
_MOST_HEADS = 4


@dataclass(slots=True)
class CarriedStep:
    """One program that is carried: ``path`` in the control, ``sent`` the text as the road wrote it (its hash tells
    whether it is the same again), ``files`` in the control that come back, ``given`` the R parameters that went along.

    ``drawn`` are random numbers that were drawn for it, ``look`` the number of the looking program beside it,
    ``restart`` that the control is restarted before it.
    ``answers`` are the files that came back, by their path in the control; ``typed`` what a person typed.
    """

    number: int
    path: str
    sent: str
    files: tuple[str, ...]
    look: int = 0
    given: dict[str, float] = field(default_factory=dict)
    answers: dict[str, str] = field(default_factory=dict)
    typed: dict[str, Any] = field(default_factory=dict)
    drawn: list[int] = field(default_factory=list)
    restart: bool = False

    @property
    def answered(self) -> bool:
        """Whether its files have come back."""
        return bool(self.answers)


@dataclass(frozen=True, slots=True)
class Brought:
    """What came back: texts by their bare names in the control (TFLIVE_X1_SPF, SEEN.TOML), every file's own name."""

    texts: Mapping[str, str]
    names: tuple[str, ...]


class StepFolder:
    """Reads and writes the folder; ``where`` names the control in errors."""

    def __init__(self, root: Path, where: str) -> None:
        self.root = root
        self._where = where

    @property
    def carry(self) -> Path:
        """What goes to the control."""
        return self.root / CARRY

    @property
    def back(self) -> Path:
        """Where files from the control are put."""
        return self.root / BACK

    @property
    def sheet(self) -> str:
        """What the person is told to do now."""
        return (self.carry / SHEET).read_text(encoding="utf-8")

    def prepare(self) -> None:
        """Make the folders. Raises ConfigError (E-OFF-FOLDER)."""
        try:
            for name in (CARRY, BACK, STEPS, DONE):
                make_own_folder(self.root / name)
        except OSError as error:
            raise self._trouble(error) from error

    def steps(self) -> list[CarriedStep]:
        """The steps of the work under way, oldest first. Raises ConfigError (E-OFF-FOLDER)."""
        found: list[CarriedStep] = []
        try:
            for place in sorted((self.root / STEPS).glob("*/step.json")):
                found.append(_step(json.loads(read_own(place))))
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise self._trouble(error) from error
        return found

    def keep(self, place: int, step: CarriedStep, program: str = "") -> None:
        """A step as it stands now, durable, its ``program`` first where one is given. Raises ConfigError."""
        folder = self.root / STEPS / f"{place:03d}"
        if program:
            self._write(folder / stick_name(step.path), program)
        self._write(folder / "step.json", json.dumps(asdict(step), indent=1))

    def program(self, place: int, step: CarriedStep) -> str:
        """The program of a step as it was carried; "" where an older version kept none. Raises ConfigError."""
        try:
            return read_own(self.root / STEPS / f"{place:03d}" / stick_name(step.path)).decode("ascii")
        except FileNotFoundError:
            return ""
        except (OSError, ValueError) as error:
            raise self._trouble(error) from error

    def work(self) -> str | None:
        """What the steps that wait are for; None where nothing waits. Raises ConfigError (E-OFF-FOLDER)."""
        if not self.steps():
            return None
        try:
            return read_own(self.root / WORK).decode("utf-8")
        except FileNotFoundError:
            return ""
        except (OSError, ValueError) as error:
            raise self._trouble(error) from error

    def call(self, work: str) -> None:
        """What the next steps are for. Raises ConfigError (E-OFF-FOLDER)."""
        self._write(self.root / WORK, work)

    def newest(self) -> CarriedStep | None:
        """The newest step that was answered, of this work or of work that has ended. Raises ConfigError."""
        answered = [step for step in self.steps() if step.answered]
        return answered[-1] if answered else self.last()

    def keep_last(self, step: CarriedStep) -> None:
        """The step that says how the control stood at the end of all work. Raises ConfigError (E-OFF-FOLDER)."""
        self._write(self.root / LAST, json.dumps(asdict(step), indent=1))

    def last(self) -> CarriedStep | None:
        """The last answered step of work that has ended; None where nothing was ever seen."""
        path = self.root / LAST
        try:
            return _step(json.loads(read_own(path))) if path.exists() else None
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise self._trouble(error) from error

    def lay_out(self, files: Mapping[str, str]) -> None:
        """Exactly these files are to be carried; what lay in ``back`` is no answer to them and is set aside.

        Raises ConfigError (E-OFF-FOLDER).
        """
        try:
            self._empty()
            self._set_aside()
        except OSError as error:
            raise self._trouble(error) from error
        for name, text in files.items():
            self._write(self.carry / name, text)

    def complain(self, why: str) -> None:
        """What is wrong with what came back lies beside the sheet; nothing does for "". Raises ConfigError."""
        path = self.carry / PROBLEM
        if why and (not path.exists() or path.read_text(encoding="utf-8") != why):
            self._write(path, why)
        elif not why:
            path.unlink(missing_ok=True)

    def _empty(self) -> None:
        """What we laid out to be carried; what a person put beside it is not ours to throw away."""
        for path in self.carry.iterdir():
            if path.is_file() and (path.suffix == ".MPF" or path.name in _TO_CARRY):
                path.unlink()

    def _set_aside(self) -> None:
        """Files that are still in ``back``: kept, under a folder that is no longer looked into."""
        old = [path for path in self.back.iterdir() if path.is_file()]
        if not old:
            return
        place = self.back / f"before-{len([one for one in self.back.iterdir() if one.is_dir()]) + 1:03d}"
        make_own_folder(place)
        for path in old:
            os.replace(path, place / path.name)

    def brought(self) -> Brought:
        """The files in ``back``; of those that are not of a control the name alone.

        A name may come as TFLIVE_X1.SPF or _N_TFLIVE_X1_SPF, and with the lines that a control puts before a file.
        Raises FileFormatError: E-OFF-FILE for one that is too large or cannot be read, E-OFF-TWICE for two that differ
        and stand for the same.
        """
        texts: dict[str, str] = {}
        names: dict[str, str] = {}
        paths = sorted(path for path in self.back.iterdir() if path.is_file())
        for path in paths:
            name = control_name(path.name)
            if not name.endswith(_BROUGHT):
                continue
            text = self._text(path)
            if texts.setdefault(name, text) != text:
                raise FileFormatError("E-OFF-TWICE", str(self.back), first=names[name], second=path.name)
            names[name] = path.name
        return Brought(texts, tuple(path.name for path in paths))

    def _text(self, path: Path) -> str:
        try:
            if path.stat().st_size > MOST_BYTES:
                raise FileFormatError(
                    "E-OFF-FILE", str(path), why=Message.of("W-FILE-MORE-BYTES", most_bytes=MOST_BYTES)
                )
            return without_head(decode_text(read_own(path), "latin-1", str(path)))
        except OSError as error:
            raise FileFormatError("E-OFF-FILE", str(path), why=error.strerror or str(error)) from error

    def conclude(self, last: CarriedStep | None) -> None:
        """The work has ended: its steps are set aside, nothing is left to carry. Raises ConfigError (E-OFF-FOLDER)."""
        try:
            if last is not None:
                self.keep_last(last)
            held = list((self.root / STEPS).iterdir())
            if held:
                place = self.root / DONE / f"{len(list((self.root / DONE).iterdir())) + 1:04d}"
                make_own_folder(place)
                for path in sorted(held):
                    shutil.move(str(path), str(place / path.name))
            self._empty()
            self._set_aside()
        except OSError as error:
            raise self._trouble(error) from error

    def _write(self, path: Path, text: str) -> None:
        """Whole or not at all: a disk that refuses leaves what was there."""
        fresh = path.with_name(f".{path.name}.new")
        try:
            make_own_folder(path.parent)
            fresh.unlink(missing_ok=True)
            with open_own(fresh, "xb") as file:
                file.write(text.encode("utf-8"))
                file.flush()
                os.fsync(file.fileno())
            os.replace(fresh, path)
        except OSError as error:
            raise self._trouble(error) from error

    def _trouble(self, error: Exception) -> ConfigError:
        return ConfigError("E-OFF-FOLDER", self._where, folder=str(self.root), why=str(error))


def _step(told: dict[str, Any]) -> CarriedStep:
    told["files"] = tuple(told["files"])
    return CarriedStep(**told)


def control_name(name: str) -> str:
    """A file's name on a stick -> as the control calls it, without front: TFLIVE_X1_SPF."""
    stem, dot, ending = name.upper().removeprefix("_N_").rpartition(".")
    return f"{stem}_{ending}" if dot and ending in ("MPF", "SPF") else name.upper().removeprefix("_N_")


def stick_name(path: str) -> str:
    """A file of the control -> its name on a stick: TFLIVE_X1.SPF."""
    stem, _, ending = path.rpartition("/")[2].removeprefix("_N_").rpartition("_")
    return f"{stem}.{ending}"


def without_head(text: str) -> str:
    """A file without what a control's own transfer puts before it: %_N_NAME_SPF, ;$PATH=/_N_SPF_DIR."""
    lines = text.replace("\r\n", "\n").split("\n")
    for _ in range(_MOST_HEADS):
        if lines and (lines[0].startswith(("%", ";$PATH")) or not lines[0].strip()):
            lines.pop(0)
    return "\n".join(lines)


# The sheet for the person who goes to the control: what to carry, what to press, what to bring back.

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
