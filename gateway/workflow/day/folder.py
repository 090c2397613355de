"""The folder of a calibration day: every file read or refused with the reason, and the answers kept beside it."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from drivers.errors import ConfigError, FileFormatError, FileUnreadable, TrueflankError
from drivers.local.names import guess, shown
from drivers.local.textfile import decode_beginning, read_toml
from drivers.message import Message
from drivers.types.gears import GearInspection, GearTraces
from drivers.types.results import MeasuredSet
from gateway.config import toml_value
from gateway.store import Maps, write_whole
from gateway.workflow.files.headers import ASKS, columns_of
from gateway.workflow.files.reading import ReadFile, ReadOptions, driver_of, read_all, read_file

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
        self._paths = list_files(folder)
        self._known: dict[Path, tuple[ReadOptions, tuple[DayFile, ...]]] = {}

    def files(self, answers: Answers) -> tuple[DayFile, ...]:
        """Every file as these answers let it be read. Raises ConfigError (E-CLI-COLUMN) for a wrong column map."""
        return tuple(one for path in self._paths for one in self._file(path, answers))

    def how(self, path: Path, answers: Answers) -> ReadOptions:
        """What was said about a file."""
        name = name_in(self.folder, path)
        columns = answers.of("columns", name)
        unit = answers.of("unit", name) if path.suffix.lower() == ".rta" else answers.said.get(f"files.{name}", {})
        text = str(unit.get("unit", "")) if isinstance(unit, Mapping) else str(unit or "")
        said = columns_of(str(columns).replace(",", " ").split()) if columns else None
        return ReadOptions(unit=text, machine=self.machine, columns=said, mixed=True)

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


def list_files(folder: Path) -> tuple[Path, ...]:
    """The files of a folder and of the folders in it, hidden ones and our own left out, by name.

    Raises ConfigError (E-DAY-FOLDER: it is none; E-DAY-EMPTY; E-DAY-MANY).
    """
    if not folder.is_dir():
        raise ConfigError("E-DAY-FOLDER", shown(folder))
    try:
        found = [one for one in (*folder.glob("*"), *folder.glob("*/*")) if one.is_file()]
    except OSError as error:
        raise FileUnreadable("E-FILE-READ", str(folder), why=error.strerror or str(error)) from error
    kept = sorted(one for one in found if not _is_passed_over(one.relative_to(folder)))
    if not kept:
        raise ConfigError("E-DAY-EMPTY", shown(folder))
    if len(kept) > MOST_FILES:
        raise ConfigError("E-DAY-MANY", shown(folder), found=len(kept), limit=MOST_FILES)
    return tuple(kept)


def _is_passed_over(path: Path) -> bool:
    name = path.name.lower()
    return any(part.startswith((".", "~")) for part in path.parts) or name.endswith(SKIPPED)


def _read(
    name: str, path: Path, how: ReadOptions, *, maps: Maps | None, utc: Callable[[], datetime]
) -> tuple[DayFile, ...]:
    if path.suffix.lower() in UNDESCRIBED:
        return (_refuse_undescribed(name, path),)
    try:
        driver = driver_of(path, ReadOptions())
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


def _content(
    name: str, path: Path, how: ReadOptions, *, maps: Maps | None, utc: Callable[[], datetime]
) -> tuple[DayFile, ...]:
    try:
        reads = read_all(path, how, maps, utc)
    except ConfigError as error:
        points = _points(path, how) if error.code == "E-IMPORT-COLUMNS" else None
        if points is None:
            raise
        return (DayFile(name, path, "gear", "gear-csv", sha256=_digest(path)),)
    digest = _digest(path)
    return tuple(_entry(name, path, one, digest) for one in reads)


def _entry(name: str, path: Path, read: ReadFile, digest: str) -> DayFile:
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


def _points(path: Path, how: ReadOptions) -> object | None:
    """The same table as flank points of a gear, None where it holds none."""
    try:
        return read_file(path, ReadOptions(machine=how.machine, gear=True)).content
    except (ConfigError, FileFormatError):
        return None


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _refuse_undescribed(name: str, path: Path) -> DayFile:
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


def find_copies(files: Sequence[DayFile]) -> Mapping[str, str]:
    """Names of files whose bytes another one before them has, with that one's name."""
    first: dict[tuple[str, str], str] = {}
    found: dict[str, str] = {}
    for one in files:
        key = one.sha256, one.component
        if one.sha256 and first.setdefault(key, one.name) != one.name:
            found[one.name] = first[key]
    return found


# What people said of a calibration day's files, kept in one TOML file beside the folder: said once, never asked again.
#
# Three places: [all] holds for every file, [axes.X1] for the files of an axis, [files."x.rta"] for one file.

Value = str | int | float | bool | list[Any] | dict[str, Any]
ALL = "all"
KEYS: Mapping[str, tuple[type, ...]] = {
    "use": (bool,),
    "error": (str,),
    "axis": (str,),
    "unit": (str,),
    "columns": (str,),
    "datum": (int, float),
    "direction": (str,),
    "sense": (str,),
    "park": (int, float, dict),
    "U": (int, float),
    "offset": (list,),
    "own_angle": (int, float, str),
    "material_degc": (int, float, str),
    "accept_doubts": (dict,),
    "accept": (list,),
    "feed": (int, float),
    "overrun": (int, float),
    "dwell_s": (int, float),
    **dict.fromkeys(("cycle", "tables", "warm_up", "other_axes", "offsets", "sensors", "instrument"), (str,)),
}
FARTHEST = 1e6
"""The largest number an answer can be, mm, deg, um or arcsec: a kilometre."""
HOTTEST, COLDEST = 100.0, -50.0
"""degC that a machine's material can have."""
UNKNOWN = "unknown"
"""Said of a square's own angle where nobody knows it."""
SQUAREST = 80.0
"""The largest own angle, arcsec: more is an angle in degrees, or no square."""
_MOTION = re.compile(r" E[XYZABC][XYZABCUVW]\Z")  # one motion of a table with several: answers for the file count too
_BARE = re.compile(r"[A-Za-z0-9_-]+")


@dataclass(frozen=True, slots=True)
class Answers:
    """Values by place ("all", "axes.X1", "files.x.rta") and key; ``where`` is the file they stand in."""

    where: str
    said: Mapping[str, Mapping[str, Value]] = field(default_factory=dict)

    def of(self, key: str, name: str, axis: str = "") -> Any:
        """The answer for one file: its own, that of its axis, that for all; None where nobody said."""
        for place in (f"files.{name}", f"files.{_MOTION.sub('', name)}", f"axes.{axis}", ALL):
            if key in self.said.get(place, {}):
                return self.said[place][key]
        return None

    def plus(self, place: str, key: str, value: Value) -> Answers:
        """With one answer more."""
        return Answers(self.where, {**self.said, place: {**self.said.get(place, {}), key: value}})

    @property
    def text(self) -> str:
        """As the file has it."""
        lines = ["# What the files of a calibration day cannot say: `trueflank day` asks it once."]
        for place, values in self.said.items():
            lines += ["", section(place), *(f"{key} = {toml_value(value)}" for key, value in values.items())]
        return "\n".join(lines) + "\n"


def section(place: str) -> str:
    """The heading of a place in the file: [all], [axes.X1], [files."x.rta"]."""
    kind, _, name = place.partition(".")
    if not name:
        return f"[{kind}]"
    return f"[{kind}.{name if _BARE.fullmatch(name) else toml_value(name)}]"


def answers_path(folder: Path) -> Path:
    """Where a folder's answers are kept unless somebody says otherwise."""
    whole = folder.resolve()
    return whole.with_name(f"{whole.name}.answers.toml")


def read_answers(path: Path) -> Answers:
    """The answers kept so far; none where there is no file. Raises ConfigError (E-DAY-ANSWERS, E-DAY-KEY)."""
    where = str(path)
    try:
        tree = read_toml(path)
    except FileNotFoundError:
        return Answers(where)
    except (OSError, ValueError) as error:
        raise ConfigError("E-DAY-ANSWERS", where, why=str(error)) from error
    said: dict[str, dict[str, Value]] = {}
    for kind, values in tree.items():
        if not isinstance(values, dict) or kind not in (ALL, "axes", "files"):
            raise ConfigError("E-DAY-ANSWERS", where, why=Message.of("W-DAY-NO-PLACE", kind=shown(kind)))
        for name, own in {"": values}.items() if kind == ALL else values.items():
            place = f"{kind}.{name}" if name else kind
            said[place] = _check_values(own, place, where)
    return Answers(where, said)


def _check_values(own: Any, place: str, where: str) -> dict[str, Value]:
    if not isinstance(own, dict):
        raise ConfigError("E-DAY-ANSWERS", where, why=Message.of("W-DAY-NO-KEYS", place=shown(place)))
    for key, value in own.items():
        wanted = KEYS.get(key)
        if wanted is None:
            known = ", ".join(KEYS) + guess(key, list(KEYS))
            raise ConfigError("E-DAY-KEY", where, place=shown(place), key=shown(key), known=known)
        right = isinstance(value, wanted) and (not isinstance(value, bool) or bool in wanted)
        if not right or not all(is_possible(one) for one in _numbers(value)):
            needs: str | Message = " or ".join(one.__name__ for one in wanted)
            needs = f"{needs}, from -{FARTHEST:g} to {FARTHEST:g}" if right else ""
            raise ConfigError("E-DAY-ANSWER", where, place=shown(place), key=key, value=shown(str(value)), known=needs)
        if key == "accept_doubts" and not all(isinstance(one, str) and one.strip() for one in value.values()):
            needs = Message.of("W-DAY-REASON")
            raise ConfigError("E-DAY-ANSWER", where, place=shown(place), key=key, value=shown(str(value)), known=needs)
        if key == "material_degc" and value != UNKNOWN and (isinstance(value, str) or not COLDEST <= value <= HOTTEST):
            needs = f"degC from {COLDEST:g} to {HOTTEST:g}, {UNKNOWN}"
            raise ConfigError("E-DAY-ANSWER", where, place=shown(place), key=key, value=shown(str(value)), known=needs)
        if key == "own_angle" and value != UNKNOWN and (isinstance(value, str) or abs(value) > SQUAREST):
            needs = Message.of("W-DAY-ARCSEC", squarest=SQUAREST, unknown=UNKNOWN)
            raise ConfigError("E-DAY-ANSWER", where, place=shown(place), key=key, value=shown(str(value)), known=needs)
    return dict(own)


def write_answers(answers: Answers) -> None:
    """Write the answers; what stood there gives way. Raises StoreError (E-STORE-DISK)."""
    write_whole(Path(answers.where), answers.text.encode())


def is_possible(number: float) -> bool:
    """Whether a number can be a place, an offset or an uncertainty: finite, and no more than `FARTHEST`."""
    return math.isfinite(number) and abs(number) <= FARTHEST


def _numbers(value: object) -> list[float]:
    inside = value.values() if isinstance(value, dict) else value if isinstance(value, list) else [value]
    return [one for one in inside if isinstance(one, int | float) and not isinstance(one, bool)]
