"""Files of others, read as was said once about their like."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from drivers import registry
from drivers.errors import ConfigError, FileFormatError
from drivers.local.names import shown
from drivers.message import Message
from drivers.recordings import Recording
from drivers.types.gears import GearInspection, GearTraces
from drivers.types.results import MeasuredSet, TableHeading
from gateway.store import Maps, Value
from gateway.workflow.files.headers import ASKS, OWN, TableMotions, instrument_of, motions_of, senses_in

ROLES = ("file", "dynamic-file", "gear-file")
OTHER_ENDINGS = {"xml": "gde", **dict.fromkeys(("txt", "dat", "tsv", "md", "xlsx", "xls"), "csv")}
NEED_UNIT = ("rta", "rtx")
HEAD_BYTES = 4096
WHOLE, READINGS = {"target"}, {"deviation", "measured", "increment", "length"}
ONCE = ("confirmed", "beside", "factor", "axis", "instrument")
"""Words about one file only: they are never remembered for others."""
Content = MeasuredSet | Recording | GearInspection | GearTraces
KEPT = {"unit": "S-READ-KEPT-UNIT", "columns": "S-READ-KEPT-COLUMNS", "senses": "S-READ-KEPT-SENSES"}
"""What is remembered of a file, as people read it."""


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """What is said about a file: "" and None leave it to the file and to what was said before.

    ``machine`` is whose file it is, for remembering its unit; ``columns`` a map of columns (or of GDE names);
    ``gear`` a table of flank points; ``mixed``: angles over mm or lengths over deg are no mistake; ``forget`` what was
    remembered about files like this one; ``motion`` the one that is meant of a table with several (EXX).
    """

    unit: str = ""
    machine: str = ""
    columns: Mapping[str, Value] | None = None
    gear: bool = False
    mixed: bool = False
    forget: bool = False
    motion: str = ""


@dataclass(frozen=True, slots=True)
class ReadFile:
    """A file's content; ``driver`` read it, ``notes`` say what was taken from memory or put into it.

    ``component`` is the error motion of a table that has one in each column, "" of any other file.
    """

    content: Content
    driver: str
    notes: tuple[Message, ...] = ()
    component: str = ""

    @property
    def warnings(self) -> tuple[Message, ...]:
        """What the file itself leaves in doubt."""
        return self.content.warnings


def driver_of(path: Path, how: ReadOptions) -> str:
    """Name of the driver that reads a file, by its ending. Raises ConfigError (E-CLI-FILE)."""
    ending = path.suffix.lower().lstrip(".")
    name = OTHER_ENDINGS.get(ending, ending)
    if name == "csv" and how.gear:
        name = "gear-csv"
    if name not in endings():
        known = ", ".join(f".{one}" for one in sorted((endings() - {"gear-csv"}) | set(OTHER_ENDINGS)))
        raise ConfigError("E-CLI-FILE", str(path), ending=path.suffix or "(none)", known=known)
    return name


def gear_driver(path: Path) -> str:
    """Driver of a gear measuring machine's own file, by its ending or by the mark of a contour scan; "" of others."""
    ending = path.suffix.lower().lstrip(".")
    if ending in ("mka", "mew"):
        return ending
    if ending not in ("dat", "txt"):
        return ""
    is_contour = registry.load("contour-mark", "recogniser")
    return "contour" if is_contour(_head_of(path)) else ""


def _head_of(path: Path) -> str:
    """The first characters of a file, "" where it cannot be read: its reader says why."""
    try:
        with path.open("rb") as file:
            return file.read(HEAD_BYTES).decode("latin-1")
    except OSError:
        return ""


def refuse_tables(path: Path) -> None:
    """Raises FileFormatError for a file that holds no readings: E-FILE-CONTROL (a table of a control, known by its
    text), E-GEARFILE-KIND (curves of a gear measuring machine).
    """
    if gear_driver(path):
        raise FileFormatError("E-GEARFILE-KIND", str(path))
    found = registry.load("other-controls", "recogniser")(_head_of(path))
    if found is not None:
        raise FileFormatError("E-FILE-CONTROL", str(path), control=found.control, format=found.format, to=found.to)


def endings() -> set[str]:
    """Names of all drivers that read files of others."""
    return {name for role in ROLES for name in registry.known(role)}


def result_endings() -> tuple[str, ...]:
    """Endings of files that hold the readings of an axis."""
    drivers = registry.known("file")
    others = (ending for ending, name in OTHER_ENDINGS.items() if name in drivers)
    return tuple(sorted(f".{one}" for one in (*drivers, *others)))


def read_measured(path: Path, how: ReadOptions, maps: Maps | None = None) -> tuple[MeasuredSet, tuple[Message, ...]]:
    """The readings of an axis in a file, and what was taken from memory.

    Raises ConfigError (E-CLI-KIND) for another content, and what `read_file` raises.
    """
    read = read_file(path, how, maps)
    if not isinstance(read.content, MeasuredSet):
        raise ConfigError("E-CLI-KIND", str(path), kind=type(read.content).__name__)
    return read.content, read.notes


def read_file(
    path: Path, how: ReadOptions, maps: Maps | None = None, utc: Callable[[], datetime] | None = None
) -> ReadFile:
    """Read a file that holds one measurement, or the ``motion`` of several; else as `read_all`.

    Raises ConfigError (E-IMPORT-SEVERAL) for a table with several motions where none is chosen.
    """
    found = read_all(path, how, maps, utc)
    if len(found) > 1:
        raise ConfigError("E-IMPORT-SEVERAL", str(path), motions=", ".join(one.component for one in found))
    return found[0]


def read_all(
    path: Path, how: ReadOptions, maps: Maps | None = None, utc: Callable[[], datetime] | None = None
) -> tuple[ReadFile, ...]:
    """Read everything that a file holds by what is said now or was said before; one entry for each motion of a table.

    With ``utc`` what is said now is remembered. Raises ConfigError (E-FILE-RTA-UNIT, E-FILE-RTX-UNIT: say the unit
    once; E-IMPORT-COLUMNS and others of `ASKS`, E-IMPORT-MOTION-UNIT: say the columns once; E-IMPORT-MOTION: the table
    lacks the chosen one; E-IMPORT-MOTION-TWICE; E-CLI-FILE), FileFormatError (E-FILE-CONTROL and others).
    """
    refuse_tables(path)
    name = driver_of(path, how)
    factory = next(registry.known(role)[name] for role in ROLES if name in registry.known(role)).load()
    asker = _FileReader(path, how, maps, utc)
    if name in NEED_UNIT:
        return (asker.with_unit(name, factory),)
    if name in ("csv", "gear-csv", "gde"):
        return asker.with_columns(name, factory)
    return (ReadFile(factory(**_options(factory, how.unit, how)).read(path), name),)


def _options(factory: Any, unit: str, how: ReadOptions) -> dict[str, Any]:
    """What a driver of a vendor's files takes of what was said."""
    able = inspect.signature(factory).parameters
    said = {"unit": unit} if unit and "unit" in able else {}
    confirmed = (how.columns or {}).get("confirmed") is True
    return said | ({"confirmed": True} if confirmed and "confirmed" in able else {})


BESIDE = "S-READ-COLUMNS"
"""Said of one column of a table; of several motions the table itself says what no motion takes."""


def _of_table(key: str) -> bool:
    """Whether a word says something of a table's motions, and nothing of a column."""
    return key in OWN or bool(senses_in({key: 1}))


class _FileReader:
    """One file, what is said about it, and the memory of what was said before."""

    def __init__(self, path: Path, how: ReadOptions, maps: Maps | None, utc: Callable[[], datetime] | None) -> None:
        self._path = path
        self._how = how
        self._maps = maps
        self._utc = utc

    def with_unit(self, name: str, factory: Any) -> ReadFile:
        keys = self._places(name, factory().origin(self._path))
        self._forget("unit", keys)
        said = self._how.unit
        notes: list[Message] = []
        if not said:
            said, notes = self._remembered_unit(keys)
        content = factory(**_options(factory, said, self._how)).read(self._path)
        if self._how.unit:
            notes += self._keep("unit", keys[0], {"unit": said})
        return ReadFile(content, name, tuple(notes))

    def _places(self, name: str, words: Mapping[str, str]) -> list[str]:
        """Where an answer holds, nearest first: the machine typed, the one named in the file, the folder."""
        named = " / ".join(words.get(key, "").strip() for key in ("Machine", "Serial No"))
        found = [f"{name} of machine {self._how.machine}"] if self._how.machine else []
        if named.strip(" /"):
            found.append(f"{name} of machine {named}")
        return [*found, f"{name} in folder {self._path.resolve().parent}"]

    def _remembered_unit(self, keys: list[str]) -> tuple[str, list[Message]]:
        for key in keys:
            found = self._maps.find("unit", key) if self._maps else None
            if found is not None:
                unit = str(found.said.get("unit", ""))
                return unit, [Message.of("S-READ-UNIT-BEFORE", unit=unit, utc=found.utc, key=key)]
        return "", []

    def with_columns(self, name: str, factory: Any) -> tuple[ReadFile, ...]:
        signature = factory().signature(self._path)
        keys = [f"{name} {signature}"] if signature else []
        self._forget("columns", keys)
        said, notes = self._said_columns(name, keys)
        table = TableMotions()
        if name == "csv":
            heading = factory().heading(self._path)
            said, more = self._senses(heading, said)
            notes += more
            table = self._motions(heading, said)
            said = (
                {key: value for key, value in said.items() if not _of_table(key)}
                if said and not table.motions
                else said
            )
        out = tuple(map(shown, table.left_out))
        left = (Message.of("S-READ-NOT-READ", names=out),) if out else ()
        if table.motions:
            found = self._each(name, factory, table)
            kept = self._keep_columns(said, keys)
            return tuple(replace(one, notes=(*notes, *kept, *left)) for one in found)
        try:
            content: Content = factory(columns=said, **self._options(name)).read(self._path)
        except FileFormatError as error:
            if error.code not in ASKS:
                raise
            # What was said is kept: the next answer comes to it, until nothing is open.
            self._keep_columns(said, keys)
            fields: Mapping[str, Any] = error.fields
            raise ConfigError(ASKS[error.code], str(self._path), **fields) from error
        return (ReadFile(content, name, (*notes, *self._keep_columns(said, keys), *left)),)

    def _senses(
        self, heading: TableHeading | None, said: Mapping[str, Value] | None
    ) -> tuple[Mapping[str, Value] | None, list[Message]]:
        """What is said, with the ways in which this instrument's channels count as they were said before."""
        name = instrument_of(heading, said)
        keys = [f"instrument {name}"] if name else []
        self._forget("senses", keys)
        now = senses_in(self._how.columns)
        found = self._maps.find("senses", keys[0]) if keys and self._maps is not None else None
        before = dict(found.said) if found is not None else {}
        if keys and now:
            return {**before, **(said or {})}, self._keep("senses", keys[0], {**before, **now})
        words = ", ".join(f"{key}={value}" for key, value in before.items())
        notes: list[Message] = []
        if found is not None:
            notes = [Message.of("S-READ-SENSES-BEFORE", name=name, utc=found.utc, said=words)]
        return ({**before, **(said or {})} if said or before else said), notes

    def _motions(self, heading: TableHeading | None, said: Mapping[str, Value] | None) -> TableMotions:
        axis = heading.said.get("Axis", "").strip().upper()[:1] if heading is not None else ""
        return motions_of(heading, said, axis, str(self._path))

    def _each(self, name: str, factory: Any, table: TableMotions) -> tuple[ReadFile, ...]:
        """Every motion of a table, or the chosen one. Raises ConfigError (E-IMPORT-MOTION)."""
        wanted = self._how.motion.upper()
        chosen = [one for one in table.motions if wanted in ("", one.component)]
        if not chosen:
            known = ", ".join(one.component for one in table.motions)
            raise ConfigError("E-IMPORT-MOTION", str(self._path), motion=shown(wanted), motions=known)
        found = []
        for one in chosen:
            content = factory(columns=one.columns, mixed=True).read(self._path)
            title = f"{one.component} {one.heading}"
            header = {"Axis": one.component[2], **content.header, "TITLE": title}
            doubts = tuple(doubt for doubt in content.doubts if doubt.code != BESIDE)
            found.append(ReadFile(replace(content, header=header, doubts=doubts), name, component=one.component))
        return tuple(found)

    def _options(self, name: str) -> dict[str, Any]:
        """What is said beside the columns."""
        if name != "csv":
            return {}
        return {"mixed": self._how.mixed} | ({"unit": self._how.unit} if self._how.unit else {})

    def _said_columns(self, name: str, keys: list[str]) -> tuple[Mapping[str, Value] | None, list[Message]]:
        """What is said now, with what was said before of files like this one where it leaves something open."""
        now = self._how.columns
        if now is not None and (name != "csv" or (set(now) >= WHOLE and READINGS & set(now))):
            return now, []
        before, notes = self._remembered_columns(keys)
        if now is not None and before is not None:
            left = READINGS if READINGS & set(now) else set()
            before = {key: value for key, value in before.items() if key not in left}
            return {**before, **now}, notes
        return (now if now is not None else before), notes

    def _keep_columns(self, said: Mapping[str, Value] | None, keys: list[str]) -> list[Message]:
        if self._how.columns is None or said is None:
            return []
        way = {"passes", "direction"} if "beside" in said else set()
        lasting = {key: value for key, value in said.items() if key not in {*ONCE, *way}}
        if not keys:
            return [Message.of("S-READ-NO-HEADING")]
        return self._keep("columns", keys[0], lasting) if lasting else []

    def _remembered_columns(self, keys: list[str]) -> tuple[Mapping[str, Value] | None, list[Message]]:
        for key in keys:
            found = self._maps.find("columns", key) if self._maps else None
            if found is not None:
                words = ", ".join(f"{name}={value}" for name, value in found.said.items())
                return found.said, [Message.of("S-READ-COLUMNS-BEFORE", utc=found.utc, said=words)]
        return None, []

    def _keep(self, kind: str, key: str, said: Mapping[str, Value]) -> list[Message]:
        if self._maps is None or self._utc is None:
            return []
        self._maps.keep(kind, key, said, self._utc().isoformat(timespec="seconds"))
        words = ", ".join(str(value) if name == "unit" else f"{name}={value}" for name, value in said.items())
        return [Message.of(KEPT[kind], said=words)]

    def _forget(self, kind: str, keys: list[str]) -> None:
        if self._how.forget and self._maps is not None:
            for key in keys:
                self._maps.forget(kind, key)
