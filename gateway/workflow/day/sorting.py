"""Files and answers sorted to the set-ups of a day, and the questions still open; a file's own words first. Pure."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from typing import Any, cast

from drivers.errors import ConfigError
from drivers.local.names import shown
from gateway.config import AxisSection, SiteFile
from gateway.domain.values import component_unit
from gateway.evaluate.behaviour.doubts import all_doubts, blocking_doubts
from gateway.evaluate.geometry.angular import COMPONENTS, Kind
from gateway.siteplan import LOCATIONS
from gateway.workflow.day.folder import ALL, UNKNOWN, Answers, DayFile, find_copies
from gateway.workflow.files.headers import KINDS
from gateway.workflow.files.statements import Difference, FileFacts, differences, facts_of

UNITS = ("mrad", "urad", "arcsec", "deg")
WAYS = ("+", "-")
YES_NO = ("yes", "no")
COLUMN_QUESTIONS = {
    "E-IMPORT-WAYS": "P-DAY-WAYS",
    "E-IMPORT-RUNS": "P-DAY-RUNS",
    "E-IMPORT-READINGS": "P-DAY-READINGS",
    "E-IMPORT-CHOOSE": "P-DAY-INSTRUMENT",
    "E-IMPORT-SHEET": "P-DAY-SHEET",
}
BARS = ("A0C", "B0C")
TURN_DEG = 360.0
NO_SETUP = {"dynamic": "W-DAY-DYNAMIC", "gear": "W-DAY-GEAR", "other": "W-DAY-OTHER"}


@dataclass(frozen=True, slots=True)
class OpenQuestion:
    """What only a person knows: ``place`` and ``key`` in the answers' file, ``code`` of the catalogue's words for it.

    ``choices`` are the only answers, where there are any; ``default`` is "" where none can be proposed. Without an
    answer to an ``optional`` one the day goes on with what is supposed instead.
    """

    place: str
    key: str
    code: str
    default: str = ""
    choices: tuple[str, ...] = ()
    fields: Mapping[str, object] = field(default_factory=dict)
    optional: bool = False


@dataclass(frozen=True, slots=True)
class SortedFile:
    """A file and what it is: the keys of its set-up ({} where it is none), who told the error, and why it is left out.

    ``why`` is a code with its fields where the file is no set-up: another axis, a copy, said to be left out.
    """

    file: DayFile
    error: str = ""
    axis: str = ""
    by: str = ""
    setup: Mapping[str, Any] = field(default_factory=dict)
    why: tuple[str, Mapping[str, object]] | None = None


@dataclass(frozen=True, slots=True)
class SortedDay:
    """Every file in its place, and what is still open; set-ups are whole once nothing is."""

    placed: tuple[SortedFile, ...]
    open: tuple[OpenQuestion, ...]

    @property
    def setups(self) -> tuple[SortedFile, ...]:
        """The files that are set-ups."""
        return tuple(one for one in self.placed if one.setup)


def sort_day(files: Sequence[DayFile], site: SiteFile, answers: Answers, today: date | None = None) -> SortedDay:
    """Say of each file what it is, and whether it belongs to this day at this machine; ``today`` judges its date.

    Raises ConfigError (E-DAY-ANSWER, E-DAY-NO-FILE, E-DAY-UNIT-OF, E-DAY-TWICE).
    """
    _known_files(files, answers)
    same = find_copies(files)
    work = _Sorter(tuple(site.axes), answers, files)
    placed = [work.place(one, same.get(one.name, "")) for one in files]
    work.foreign(placed, site, today)
    work.twice(placed)
    work.square(placed)
    return SortedDay(tuple(placed), tuple(work.questions.values()))


def day_facts(placed: Sequence[SortedFile]) -> tuple[FileFacts, ...]:
    """What the files that count state, one entry a file; of a table with several motions once."""
    found = {
        one.file.path: facts_of(one.file.whole, one.file.words)
        for one in reversed(placed)
        if one.file.kind == "results" and one.why is None
    }
    return tuple(reversed(found.values()))


def accepted_words(answers: Answers) -> tuple[str, ...]:
    """The statements that a person accepted for the day, KEY=VALUE."""
    found = answers.said.get(ALL, {}).get("accept", ())
    return tuple(str(one) for one in found) if isinstance(found, list | tuple) else ()


def _known_files(files: Sequence[DayFile], answers: Answers) -> None:
    names = {f"files.{name}" for one in files for name in (one.name, one.whole)}
    for place in answers.said:
        if place.startswith("files.") and place not in names:
            name = shown(place.removeprefix("files."))
            raise ConfigError("E-DAY-NO-FILE", answers.where, name=name)


class _Sorter:
    """The questions of a day as they come up, each once."""

    def __init__(self, axes: tuple[AxisSection, ...], answers: Answers, files: Sequence[DayFile]) -> None:
        self._axes = axes
        self._answers = answers
        self._files = files
        self.questions: dict[tuple[str, str], OpenQuestion] = {}

    def place(self, one: DayFile, copy_of: str) -> SortedFile:
        use = self._answers.of("use", one.name)
        if use is False:
            return SortedFile(one, why=("W-DAY-LEFT-OUT", {}))
        if copy_of:
            return SortedFile(one, why=("W-DAY-COPY", {"other": copy_of}))
        if one.kind == "open":
            self._read_first(one)
            return SortedFile(one)
        if one.kind in ("trouble", "undescribed"):
            self._unreadable(one)
            return SortedFile(one)
        if one.kind != "results":
            return SortedFile(one, why=(NO_SETUP[one.kind], {"name": one.name}))
        return self._results(one)

    def foreign(self, placed: Sequence[SortedFile], site: SiteFile, today: date | None) -> None:
        """Statements that differ from the site's or from other files': a person says whether they belong here."""
        known = set(accepted_words(self._answers))
        open_: dict[str, list[Difference]] = {}
        for one in differences(day_facts(placed), site, today):
            if one.text not in known:
                open_.setdefault(one.text, []).append(one)
        for text, found in open_.items():
            first = found[0]
            files = tuple(one.file for one in found)
            fields: dict[str, object] = {"names": ", ".join(files), "files": files, "key": first.key}
            fields |= {"value": first.value, "source": first.source, "other": first.other}
            self._ask(OpenQuestion("all", f"accept {text}", "P-DAY-FACT", choices=YES_NO, fields=fields))
        mine = {key: one for key, one in self.questions.items() if key[1].startswith("accept ")}
        self.questions = {**mine, **self.questions}  # whether a file belongs here at all is asked first

    def twice(self, placed: Sequence[SortedFile]) -> None:
        """Two files of one thing: a person says which counts. Raises ConfigError (E-DAY-TWICE)."""
        first: dict[tuple[Any, ...], SortedFile] = {}
        for one in placed:
            if not one.error or one.why is not None:
                continue
            park = tuple(sorted(one.setup.get("park", {}).items())) if one.setup else (one.file.name,)
            key = (one.error, one.axis, park if one.error in BARS else ())
            other = first.setdefault(key, one)
            if other is one:
                continue
            names: dict[str, Any] = {"name": one.file.name, "other": other.file.name, "error": one.error}
            if self._answers.of("use", one.file.name) and self._answers.of("use", other.file.name) is not False:
                raise ConfigError("E-DAY-TWICE", self._answers.where, **names)
            self._ask(OpenQuestion(f"files.{one.file.name}", "use", "P-DAY-TWICE", choices=YES_NO, fields=names))

    def square(self, placed: Sequence[SortedFile]) -> None:
        """A square on both axes that was not turned over: its own angle is in the figure, and no file says it."""
        pairs: dict[str, dict[str, str]] = {"B0Z": {}, "B0Z-R": {}}
        for one in placed:
            if one.error in pairs and one.axis and one.why is None:
                pairs[one.error].setdefault(one.axis, one.file.name)
        whole = [names for names in pairs.values() if len(names) == len(LOCATIONS["B0Z"])]
        if len(whole) != 1:
            return
        files = whole[0]
        if all(self._answers.of("own_angle", name, axis) is None for axis, name in files.items()):
            fields = {"name": " and ".join(files.values())}
            self._ask(OpenQuestion("all", "own_angle", "P-DAY-SQUARE", choices=(UNKNOWN,), fields=fields))

    def _ask(self, one: OpenQuestion) -> None:
        self.questions.setdefault((one.place, one.key), one)

    def _read_first(self, one: DayFile) -> None:
        fields = {"name": one.name, **(one.error.fields if one.error is not None else {})}
        if one.asks == "unit":
            self._ask(OpenQuestion("all", "unit", "P-DAY-UNIT", choices=UNITS, fields=fields))
        else:
            code = COLUMN_QUESTIONS.get(one.error.code if one.error is not None else "", "P-DAY-COLUMNS")
            self._ask(OpenQuestion(f"files.{one.name}", "columns", code, fields=fields))

    def _unreadable(self, one: DayFile) -> None:
        why = one.error.what if one.error is not None else ""
        code = "P-DAY-UNDESCRIBED" if one.kind == "undescribed" else "P-DAY-BROKEN"
        head = "\n".join(f"    {line}" for line in one.head)
        fields = {"name": one.name, "why": why, "head": head}
        self._ask(OpenQuestion(f"files.{one.name}", "use", code, choices=("no",), fields=fields))

    def _results(self, one: DayFile) -> SortedFile:
        told = guess_content(one.name, one.driver, one.words, self._axes)
        error, axis, by = self._error(one, told)
        if told.foreign and not axis and not error:
            return SortedFile(one, why=("W-DAY-FOREIGN", {"axis": told.foreign}))
        if error and not axis:
            named = tuple(
                item.name for item in self._axes if item.letter in LOCATIONS.get(error.removesuffix("-R"), "")
            )
            fields: dict[str, object] = {"name": one.name, "error": error}
            self._ask(OpenQuestion(f"files.{one.name}", "axis", "P-DAY-AXIS", choices=named, fields=fields))
        if not error:
            able = choices(self._axis(told.axis), self._unit(one), self._axes)
            fields = {"name": one.name, "axis": told.axis or "?"}
            self._ask(OpenQuestion(f"files.{one.name}", "error", "P-DAY-ERROR", choices=able, fields=fields))
        moved = self._axis(axis)
        if moved is None or not error:
            return SortedFile(one, error, axis, by)
        self._fits(one, error, moved)
        return SortedFile(one, error, axis, by, setup=self._setup(one, error, moved, told))

    def _error(self, one: DayFile, told: FileGuess) -> tuple[str, str, str]:
        """Error, axis and who told them. Raises ConfigError (E-DAY-ANSWER)."""
        said, axis = self._answers.of("error", one.name), self._answers.of("axis", one.name)
        able = choices(None, "", self._axes)
        place = f"files.{one.name}"
        if said is not None and said not in able:
            self._wrong(place, "error", said, ", ".join(able))
        names = tuple(item.name for item in self._axes)
        if axis is not None and axis not in names:
            self._wrong(place, "axis", axis, ", ".join(names))
        error = str(said or told.error)
        moving = [item for item in self._axes if item.letter in LOCATIONS.get(error.removesuffix("-R"), error[2:3])]
        if axis is None and error:
            own = [item.name for item in moving if item.name == told.axis]
            axis = (own or [item.name for item in moving if len(moving) == 1] or [""])[0]
        elif axis is not None and error and axis not in [item.name for item in moving]:
            self._wrong(place, "axis", axis, ", ".join(item.name for item in moving))
        if told.error and said is None and error not in able:
            return "", "", ""
        return error, axis or "", BY_ANSWER if said else told.by

    def _wrong(self, place: str, key: str, value: object, known: str) -> None:
        raise ConfigError(
            "E-DAY-ANSWER", self._answers.where, place=shown(place), key=key, value=shown(str(value)), known=known
        )

    def _axis(self, name: str) -> AxisSection | None:
        return next((item for item in self._axes if item.name == name), None)

    def _unit(self, one: DayFile) -> str:
        """Kind of the file's deviations, um or arcsec."""
        return "um" if one.measured is not None and one.measured.axis_unit == "mm" else "arcsec"

    def _fits(self, one: DayFile, error: str, moved: AxisSection) -> None:
        """Raises ConfigError (E-DAY-UNIT-OF) for lengths where the error is an angle and the other way round."""
        wanted = "um" if error[1] == "0" else component_unit(error, moved.unit)
        if self._unit(one) != wanted:
            raise ConfigError("E-DAY-UNIT-OF", one.name, error=error, found=self._unit(one), wanted=wanted)

    def _setup(self, one: DayFile, error: str, moved: AxisSection, told: FileGuess) -> Mapping[str, Any]:
        """The keys of the set-up; {} while something is open."""
        datum, direction = self._datum(one, moved)
        positioning = error[1] == error[2] and error[1] != "0"
        sense = "+" if positioning else self._way(one, "sense", "all", "P-DAY-SENSE", moved=moved)
        park = self._park(one, error, told)
        settled = self._doubts(one, error, moved)
        degc = self._material(one, moved) if positioning else None
        if datum is None or not direction or not sense or park is None or settled is None:
            return {}
        found: dict[str, Any] = {"axis": moved.name, "component": error, "source": "file", "datum": datum}
        found |= {"unit": str(self._answers.of("unit", one.name) or "")} if one.driver == "rta" else {}
        found |= {"file_axis_sense": -1} if direction == "-" else {}
        found |= {"sense": -1} if sense == "-" else {}
        found |= {"park": park} if park else {}
        found |= {"accept_doubts": settled} if settled else {}
        stated = {f"{key}={value}" for key, value in facts_of(one.whole, one.words).said.items()}
        words = [text for text in accepted_words(self._answers) if text in stated]
        found |= {"accept": words} if words else {}
        found |= {"material_degc": degc} if degc is not None else {}
        own = {"U": "U", "offset": "offset_mm", "own_angle": "own_angle_arcsec"}
        more = {to: self._answers.of(key, one.name, moved.name) for key, to in own.items()}
        return found | {key: value for key, value in more.items() if value not in (None, UNKNOWN)}

    def _datum(self, one: DayFile, moved: AxisSection) -> tuple[float | None, str]:
        """Where the axis stood at the file's zero, and which way the file counts."""
        direction = self._way(one, "direction", f"axes.{moved.name}", "P-DAY-DIRECTION", moved=moved)
        said = self._answers.of("datum", one.name, moved.name)
        if said is None and one.measured is not None:
            first, last = float(one.measured.targets[0]), float(one.measured.targets[-1])
            low, high = moved.travel[0], max(moved.travel[1], moved.travel[0] + TURN_DEG * moved.modulo)
            inside = low - 1e-6 <= first and last <= high + 1e-6
            fields = {"axis": moved.name, "name": one.name, "first": f"{first:g}", "last": f"{last:g}"}
            fields |= {"unit": moved.unit, "low": f"{low:g}", "high": f"{high:g}"}
            zero = "0" if inside else ""
            self._ask(OpenQuestion(f"axes.{moved.name}", "datum", "P-DAY-DATUM", default=zero, fields=fields))
        return (float(said) if said is not None else None), direction

    def _doubts(self, one: DayFile, error: str, moved: AxisSection) -> dict[str, str] | None:
        """Reasons by code of what a person answers for; None while a doubt of the readings is open."""
        accepted = dict(self._answers.of("accept_doubts", one.name, moved.name) or {})
        if one.measured is None:
            return accepted
        found = one.measured.doubts
        if error[1] != "0":
            unit = component_unit(error, moved.unit)
            found = all_doubts(replace(one.measured, axis_unit=moved.unit), unit, modulo=moved.modulo)
        for doubt in blocking_doubts(found):
            if doubt.code not in accepted:
                fields = {"name": one.name, "doubt": doubt.text, "named": doubt.code, "accepted": accepted}
                self._ask(OpenQuestion(f"files.{one.name}", "accept_doubts", "P-DAY-DOUBT", fields=fields))
                return None
        return accepted

    def _material(self, one: DayFile, moved: AxisSection) -> float | None:
        """The material's temperature that a person gave, where the file of a linear axis has none."""
        if moved.kind != "linear" or one.measured is None or one.measured.ambient_start.material_degc:
            return None
        said = self._answers.of("material_degc", one.name, moved.name)
        if said is None:
            fields = {"name": one.name}
            self._ask(
                OpenQuestion("all", "material_degc", "P-DAY-MATERIAL", default=UNKNOWN, fields=fields, optional=True)
            )
        return float(said) if isinstance(said, int | float) else None

    def _way(self, one: DayFile, key: str, place: str, code: str, *, moved: AxisSection) -> str:
        """A sign that somebody said, "" while it is open. Raises ConfigError (E-DAY-ANSWER)."""
        said = self._answers.of(key, one.name, moved.name)
        if said is None:
            self._ask(
                OpenQuestion(place, key, code, default="+", choices=WAYS, fields={"axis": moved.name, "name": one.name})
            )
            return ""
        if said not in WAYS:
            self._wrong(place, key, said, " ".join(WAYS))
        return str(said)

    def _park(self, one: DayFile, error: str, told: FileGuess) -> dict[str, float] | None:
        """Where the table, and others that somebody named, stood for a bar, by axis; None while nobody said."""
        table = next((item.name for item in self._axes if item.kind == "rotary"), "")
        if error not in BARS or not table:
            return {}
        said = self._answers.of("park", one.name)
        if said is not None:
            return {name: float(at) for name, at in said.items()} if isinstance(said, dict) else {table: float(said)}
        if told.park is not None:
            return {table: told.park}
        fields = {"name": one.name, "table": table}
        self._ask(OpenQuestion(f"files.{one.name}", "park", "P-DAY-PARK", choices=("0", "180"), fields=fields))
        return None


# What a result file says of itself: which axis moved and which error it holds, by its own words and its name; pure.

_ERROR = re.compile(r"(?<![A-Z0-9])(E[XYZABC][XYZABC]|[AB]0[CZ](?:-R)?|[XY]0C)(?![A-Z0-9])")
_PLACE = re.compile(r"(?<![A-Z0-9])(\d{1,3}) ?(?:DEG|GRAD|°|度)")
_WORD = re.compile(r"[A-Z]+[0-9]*")
BY_FILE, BY_NAME, BY_KIND, BY_ANSWER = "its words", "its name", "its kind", "answer"
AXIS_LETTERS = "XYZABCUVW"


@dataclass(frozen=True, slots=True)
class FileGuess:
    """What a file tells: machine axis and error ("" where it does not), the kind in words, and what told it.

    ``foreign`` is an axis named there that the site does not have; ``park`` the angle a bar stood at, deg.
    """

    axis: str = ""
    error: str = ""
    kind: str = ""
    by: str = ""
    foreign: str = ""
    park: float | None = None


def guess_content(name: str, driver: str, header: Mapping[str, str], axes: Sequence[AxisSection]) -> FileGuess:
    """From the words inside a file first, then from its name; ``driver`` says what such files usually hold."""
    own = " ".join(header.get(key, "") for key in ("TITLE", "Title", "Location", "Comment")).upper()
    stem = name.rpartition(".")[0].upper()
    said, foreign = _axis(header.get("Axis", "").upper(), axes)
    if said is None and not foreign:
        said, foreign = _axis(stem, axes)
    park = next((float(found[1]) for found in map(_PLACE.search, (own, stem)) if found), None)
    for text, by in ((own, BY_FILE), (stem, BY_NAME)):
        found = _ERROR.search(text)
        if found is not None:
            axis = _axis_that_moved(found[1], axes) or (said.name if said else "")
            return FileGuess(axis, found[1], "", by, foreign="" if axis else found[1][2:3], park=park)
    if said is None:
        return FileGuess(foreign=foreign, park=park)
    kind, by = _kind(own, stem)
    error = _error(said, kind, f"{own} {stem}", driver)
    return FileGuess(said.name, error, kind, by or (BY_KIND if error else ""), park=park)


def _axis(text: str, axes: Sequence[AxisSection]) -> tuple[AxisSection | None, str]:
    """The axis of the site that a text names first; else a letter that is an axis of no site, or ""."""
    foreign = ""
    for word in _WORD.findall(_ERROR.sub(" ", text.replace("_", " "))):
        for axis in axes:
            if word in (axis.name.upper(), axis.letter):
                return axis, ""
        if not foreign and word[0] in AXIS_LETTERS and (word[1:].isdigit() or len(word) == 1):
            foreign = word
    return None, foreign


def _axis_that_moved(error: str, axes: Sequence[AxisSection]) -> str:
    """The axis that an error motion belongs to, or the only one that moves for a location error."""
    letters = LOCATIONS.get(error.removesuffix("-R"), (error[2:3],))
    found = [axis.name for axis in axes if axis.letter in letters]
    return found[0] if len(letters) == 1 and found else ""


def _kind(own: str, stem: str) -> tuple[str, str]:
    for text, by in ((own, BY_FILE), (stem, BY_NAME)):
        for kind, marks in KINDS.items():
            if any(mark in text for mark in marks):
                return kind, by
    return "", ""


def _error(axis: AxisSection, kind: str, text: str, driver: str) -> str:
    """The error by its letters, "" where the words leave it open."""
    letter = axis.letter
    if axis.kind == "rotary":
        return f"E{letter}{letter}" if driver == "rta" or kind == "position" else ""
    if kind in ("pitch", "yaw", "roll"):
        return COMPONENTS.get((letter, cast(Kind, kind)), "")
    if kind == "straightness":
        across = re.findall(r"(?<![A-Z0-9])([XYZ])\d?(?![A-Z0-9])", text.replace("_", " "))
        other = [one for one in across if one != letter]
        return f"E{other[0]}{letter}" if other else ""
    plain = driver in ("rtl", "pos")
    return f"E{letter}{letter}" if kind == "position" or (plain and not kind) else ""


def choices(axis: AxisSection | None, unit: str, axes: Sequence[AxisSection]) -> tuple[str, ...]:
    """The errors a file may hold, by its axis (None: any of the site's) and the unit of its deviations ("": either)."""
    moved = axes if axis is None else (axis,)
    motions = [f"E{way}{one.letter}" for one in moved for way in "XYZABC" if unit in ("", _unit_of(way, one))]
    letters = {one.letter for one in moved}
    places = [name for name, able in LOCATIONS.items() if letters & set(able)] if unit != "arcsec" else []
    turned = ["B0Z-R"] if "B0Z" in places else []
    return (*motions, *places, *turned)


def _unit_of(way: str, axis: AxisSection) -> str:
    return component_unit(f"E{way}{axis.letter}", axis.unit)
