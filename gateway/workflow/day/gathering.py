"""The folder of a calibration day, read: every file with what it holds, or with why it cannot be read."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Literal

from drivers.errors import ConfigError, FileFormatError, FileUnreadable, TrueflankError
from drivers.local.names import shown
from drivers.local.textfile import decode_beginning
from drivers.message import Message
from drivers.types.gears import GearInspection, GearTraces
from drivers.types.results import MeasuredSet
from gateway.store import Maps
from gateway.workflow.day.answers import Answers
from gateway.workflow.files.columnwords import ASKS, columns_of
from gateway.workflow.files.reading import How, Read, driver_of, read_all, read_file

MOST_FILES = 500
HEAD_LINES, HEAD_BYTES, LINE = 5, 4096, 100
# Layouts of a maker that no public document describes: never guessed at.
UNDESCRIBED = (".rts", ".rtd", ".xc", ".capture")
DYNAMIC, GEAR = ("rtx",), ("gde",)
ASKED = {"E-FILE-RTA-UNIT": "unit", **dict.fromkeys(ASKS.values(), "columns")}
SKIPPED = ("answers.toml", ".ds_store", "thumbs.db", "desktop.ini")

Kind = Literal["results", "dynamic", "gear", "undescribed", "other", "trouble", "open"]


@dataclass(frozen=True, slots=True)
class DayFile:
    """One file: ``measured`` where it holds results; ``error`` says why it cannot be read, or what must be said first.

    ``head`` are its first lines where nobody has described its layout; ``sha256`` is "" for what was not read. A table
    with several error motions is one entry for each: ``name`` then ends with its ``component``.
    """

    name: str
    path: Path
    kind: Kind
    driver: str = ""
    measured: MeasuredSet | None = None
    error: TrueflankError | None = None
    sha256: str = ""
    head: tuple[str, ...] = ()
    notes: tuple[Message, ...] = ()
    words: Mapping[str, str] = field(default_factory=dict)
    component: str = ""

    @property
    def whole(self) -> str:
        """The name of the file, without the motion."""
        return self.name.removesuffix(f" {self.component}") if self.component else self.name

    @property
    def asks(self) -> str:
        """Which answer it needs before it can be read, "" for none."""
        return ASKED.get(self.error.code, "") if self.error is not None and self.kind == "open" else ""


class DayFolder:
    """A folder's files; one that was read is not read again while its answers stay the same."""

    def __init__(self, folder: Path, machine: str, maps: Maps | None, utc: Callable[[], datetime]) -> None:
        self.folder = folder
        self.machine = machine
        self.maps = maps
        self._utc = utc
        self._paths = listed(folder)
        self._known: dict[Path, tuple[How, tuple[DayFile, ...]]] = {}

    def files(self, answers: Answers) -> tuple[DayFile, ...]:
        """Every file as these answers let it be read. Raises ConfigError (E-CLI-COLUMN) for a wrong column map."""
        return tuple(one for path in self._paths for one in self._file(path, answers))

    def how(self, path: Path, answers: Answers) -> How:
        """What was said about a file."""
        name = name_in(self.folder, path)
        columns = answers.of("columns", name)
        unit = answers.of("unit", name) if path.suffix.lower() == ".rta" else answers.said.get(f"files.{name}", {})
        text = str(unit.get("unit", "")) if isinstance(unit, Mapping) else str(unit or "")
        said = columns_of(str(columns).replace(",", " ").split()) if columns else None
        return How(unit=text, machine=self.machine, columns=said, mixed=True)

    def _file(self, path: Path, answers: Answers) -> tuple[DayFile, ...]:
        how = self.how(path, answers)
        known = self._known.get(path)
        if known is None or known[0] != how:
            known = how, _read(name_in(self.folder, path), path, how, maps=self.maps, utc=self._utc)
            self._known[path] = known
        return known[1]


def name_in(folder: Path, path: Path) -> str:
    """A file's name in the day: with its sub-folder, if it lies in one."""
    return path.relative_to(folder).as_posix()


def listed(folder: Path) -> tuple[Path, ...]:
    """The files of a folder and of the folders in it, hidden ones and our own left out, by name.

    Raises ConfigError (E-DAY-FOLDER: it is none; E-DAY-EMPTY; E-DAY-MANY).
    """
    if not folder.is_dir():
        raise ConfigError("E-DAY-FOLDER", shown(folder))
    try:
        found = [one for one in (*folder.glob("*"), *folder.glob("*/*")) if one.is_file()]
    except OSError as error:
        raise FileUnreadable("E-FILE-READ", str(folder), why=error.strerror or str(error)) from error
    kept = sorted(one for one in found if not _passed(one.relative_to(folder)))
    if not kept:
        raise ConfigError("E-DAY-EMPTY", shown(folder))
    if len(kept) > MOST_FILES:
        raise ConfigError("E-DAY-MANY", shown(folder), found=len(kept), limit=MOST_FILES)
    return tuple(kept)


def _passed(path: Path) -> bool:
    name = path.name.lower()
    return any(part.startswith((".", "~")) for part in path.parts) or name.endswith(SKIPPED)


def _read(name: str, path: Path, how: How, *, maps: Maps | None, utc: Callable[[], datetime]) -> tuple[DayFile, ...]:
    if path.suffix.lower() in UNDESCRIBED:
        return (_undescribed(name, path),)
    try:
        driver = driver_of(path, How())
    except ConfigError as error:
        return (DayFile(name, path, "other", error=error),)
    if driver in DYNAMIC:
        return (DayFile(name, path, "dynamic", driver),)
    try:
        return _content(name, path, how, maps=maps, utc=utc)
    except (ConfigError, FileFormatError) as error:
        if driver in GEAR:
            return (DayFile(name, path, "gear", driver, error=error),)
        return (DayFile(name, path, "open" if error.code in ASKED else "trouble", driver, error=error),)


def _content(name: str, path: Path, how: How, *, maps: Maps | None, utc: Callable[[], datetime]) -> tuple[DayFile, ...]:
    try:
        reads = read_all(path, how, maps, utc)
    except ConfigError as error:
        points = _points(path, how) if error.code == "E-IMPORT-COLUMNS" else None
        if points is None:
            raise
        return (DayFile(name, path, "gear", "gear-csv", sha256=_digest(path)),)
    digest = _digest(path)
    return tuple(_entry(name, path, one, digest) for one in reads)


def _entry(name: str, path: Path, read: Read, digest: str) -> DayFile:
    content = read.content
    if isinstance(content, MeasuredSet):
        return DayFile(
            f"{name} {read.component}".strip(),
            path,
            "results",
            read.driver,
            measured=content,
            sha256=digest,
            notes=(*content.warnings, *read.notes),
            words=content.header,
            component=read.component,
        )
    kind: Kind = "gear" if isinstance(content, GearInspection | GearTraces) else "dynamic"
    return DayFile(name, path, kind, read.driver, sha256=digest)


def _points(path: Path, how: How) -> object | None:
    """The same table as flank points of a gear, None where it holds none."""
    try:
        return read_file(path, How(machine=how.machine, gear=True)).content
    except (ConfigError, FileFormatError):
        return None


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _undescribed(name: str, path: Path) -> DayFile:
    """A file whose layout is not public: refused, with its first lines for whoever wants to declare a table of it."""
    try:
        with path.open("rb") as file:
            data = file.read(HEAD_BYTES)
    except OSError as error:
        raise FileUnreadable("E-FILE-READ", str(path), why=error.strerror or str(error)) from error
    text = decode_beginning(data, "cp1252")
    head = tuple(shown(line[:LINE]) for line in text.splitlines()[:HEAD_LINES])
    refused = FileFormatError(
        "E-DAY-UNDESCRIBED", name, ending=path.suffix, head="\n".join(f"    {one}" for one in head)
    )
    return DayFile(name, path, "undescribed", error=refused, head=head)


def copies(files: Sequence[DayFile]) -> Mapping[str, str]:
    """Names of files whose bytes another one before them has, with that one's name."""
    first: dict[tuple[str, str], str] = {}
    found: dict[str, str] = {}
    for one in files:
        key = one.sha256, one.component
        if one.sha256 and first.setdefault(key, one.name) != one.name:
            found[one.name] = first[key]
    return found
