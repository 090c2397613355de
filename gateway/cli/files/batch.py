"""Many files: folders as result files, work in processes or on a cluster, and one table of all results."""

from __future__ import annotations

import csv
import hashlib
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

from drivers.errors import ConfigError
from drivers.message import Message
from gateway.cli.output import echo

BATCH = 8  # files that a process gets at a time
AHEAD = 4  # batches for each process that are under way: a hundred thousand files are not all held
PROGRESS_STEPS = 10  # times that a long work says how far it is
KEYS = ("file", "sha256", "settings", "sets")
FORMULA = ("=", "+", "-", "@", "\t")  # what a spreadsheet takes for a formula
Work = Callable[[Path], Any]


def is_collection(path: Path) -> bool:
    """Whether a folder stands for the result files in it: any that is no run."""
    return path.is_dir() and not (path / "run.json").exists()


def files_in(given: Sequence[Path]) -> list[Path]:
    """The files meant: one as it is, a run's folder as it is, any other folder as its result files by name, deep.

    Raises ConfigError (E-CLI-NO-RESULTS) for a folder without any.
    """
    found: list[Path] = []
    for path in given:
        found += _files_below(path) if is_collection(path) else [path]
    return found


def _files_below(folder: Path) -> list[Path]:
    from gateway.workflow.files.reading import result_endings

    known = result_endings()
    own = sorted(one for one in folder.rglob("*") if one.suffix.lower() in known and one.is_file())
    if not own:
        raise ConfigError("E-CLI-NO-RESULTS", str(folder), known=", ".join(known))
    return own


def map_files(work: Work, files: Sequence[Path], *, jobs: int = 1, scheduler: str = "") -> Iterator[Any]:
    """What ``work`` makes of each file, in their order; it and what it returns can be sent to another process.

    Raises ModelError (E-SENS-SCHEDULER where no cluster answers, E-SENS-WORKERS where a worker is lost).
    """
    if jobs == 1 and not scheduler:
        yield from map(work, files)
        return
    from concurrent.futures import BrokenExecutor

    from gateway.errors import ModelError
    from gateway.study.workers import workers

    with workers(scheduler, jobs) as executor:
        if executor is None:
            yield from map(work, files)
            return
        batches = iter([files[at : at + BATCH] for at in range(0, len(files), BATCH)])
        under_way: deque[Any] = deque()
        try:
            for batch in batches:
                under_way.append(executor.submit(_batch, work, batch))
                if len(under_way) >= AHEAD * jobs:
                    yield from under_way.popleft().result()
            while under_way:
                yield from under_way.popleft().result()
        except (BrokenExecutor, OSError) as error:
            raise ModelError("E-SENS-WORKERS", "evaluate", why=f"{type(error).__name__} {error}") from error
        finally:
            for one in under_way:
                one.cancel()


def _batch(work: Work, files: Sequence[Path]) -> list[Any]:
    return [work(path) for path in files]


def report_progress(found: Iterator[Any], count: int) -> Iterator[Any]:
    """The same, with a line at every tenth of a long work."""
    for at, one in enumerate(found, start=1):
        yield one
        if count >= 2 * PROGRESS_STEPS and (at * PROGRESS_STEPS) // count > ((at - 1) * PROGRESS_STEPS) // count:
            echo(Message.of("P-FILES-DONE", done=at, count=count), err=True)


class ResultTable:
    """One table of all answers, a row for each set; begun again it keeps what holds and goes on behind it.

    A row holds as long as its file has the same bytes and the same was asked of it (``settings``).
    """

    def __init__(self, path: Path, columns: Sequence[str], settings: str) -> None:
        """Raises ConfigError (E-CLI-TABLE) for a file that is no such table."""
        self._path = path
        self._columns = (*KEYS, *columns)
        self._settings = hashlib.sha256(settings.encode()).hexdigest()[:16]
        self._kept: dict[str, list[dict[str, str]]] = {}
        self._file: TextIO | None = None
        if path.exists():
            self._read()

    def _read(self) -> None:
        try:
            with self._path.open(encoding="utf-8", newline="") as file:
                rows = csv.DictReader(file)
                if tuple(rows.fieldnames or ()) != self._columns:
                    raise ConfigError("E-CLI-TABLE", str(self._path))
                for row in rows:
                    # A last line that was cut by a stop lacks cells.
                    if None not in row.values() and row["settings"] == self._settings:
                        self._kept.setdefault(row["file"], []).append(row)
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise ConfigError("E-CLI-TABLE", str(self._path)) from error

    def holds(self, path: Path) -> bool:
        """Whether the table has this file's answers as the file is now; one that could not be read is tried again."""
        own = self._kept.get(str(_plain(str(path))), [])
        whole = bool(own) and own[0]["sets"] == str(len(own)) and not any(row["error"] for row in own)
        return whole and own[0]["sha256"] == _digest(path)

    def verdicts(self, held: Sequence[Path]) -> list[str]:
        """The verdicts that stand in the rows of these files: an exit code counts them, too."""
        rows = [row for path in held for row in self._kept[str(_plain(str(path)))]]
        said = [one.rpartition(": ")[2] for row in rows for one in row["verdicts"].split("; ") if one]
        return [*said, *("not decidable" for row in rows if row["in_doubt"])]

    def begin(self, keep: Sequence[Path]) -> None:
        """Write the table anew with the rows of the files to keep. Raises ConfigError (E-CLI-WRITE)."""
        names = {str(_plain(str(path))) for path in keep}
        beside = self._path.with_name(f".{self._path.name}.new")
        try:
            with beside.open("w", encoding="utf-8", newline="") as file:
                rows = csv.DictWriter(file, self._columns)
                rows.writeheader()
                rows.writerows(row for name, own in self._kept.items() if name in names for row in own)
            beside.replace(self._path)
            self._file = self._path.open("a", encoding="utf-8", newline="")
        except OSError as error:
            raise ConfigError("E-CLI-WRITE", str(self._path), why=error.strerror or str(error)) from error

    def add(self, path: Path, answers: Sequence[Mapping[str, object]]) -> None:
        """The answers of one file, on the disk when this returns."""
        if self._file is None:
            return
        keys = {"file": str(path), "sha256": _digest(path), "settings": self._settings, "sets": len(answers)}
        rows = csv.DictWriter(self._file, self._columns)
        rows.writerows({name: _plain(value) for name, value in {**keys, **one}.items()} for one in answers)
        self._file.flush()

    def end(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()


def _plain(value: object) -> object:
    """A cell that no spreadsheet takes for a formula; numbers as they are."""
    return f"'{value}" if isinstance(value, str) and value.startswith(FORMULA) else value


def _digest(path: Path) -> str:
    """The sha256 of a file's bytes; "" where it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""
