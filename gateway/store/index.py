"""The index of runs in SQL: a picture of the run folders that can be thrown away and rebuilt."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from sqlalchemy import (
    Column,
    Connection,
    Engine,
    ForeignKey,
    MetaData,
    String,
    Table,
    Text,
    create_engine,
    delete,
    event,
    insert,
    select,
)
from sqlalchemy.exc import DatabaseError, SQLAlchemyError
from sqlalchemy.pool import NullPool

from drivers.ownfiles import made_folder, opened
from gateway.errors import StoreError
from gateway.store.disk import disk_errors, replace
from gateway.store.folder import RunFolder, RunSummary, Store

_BROKEN = ("not a database", "malformed")
_META = MetaData()
_RUNS = Table(
    "runs",
    _META,
    Column("run_id", String(120), primary_key=True),
    Column("path", Text, nullable=False),
    Column("site", String(120), nullable=False),
    Column("created_utc", String(40), nullable=False),
    Column("state", String(40), nullable=False),
    Column("machine", String(120), nullable=False),
    Column("software", String(40), nullable=False),
    Column("problem", Text, nullable=False),
)
_STAGES = Table(
    "stages",
    _META,
    Column("run_id", String(120), ForeignKey("runs.run_id"), primary_key=True),
    Column("stage", String(120), primary_key=True),
    Column("file", String(160), nullable=False),
    Column("sha256", String(64), nullable=False),
)


class Index:
    """Runs and stages in SQLite beside the folders, or at any SQLAlchemy url (PostgreSQL for a plant)."""

    def __init__(self, store: Store, url: str = "") -> None:
        self._store = store
        self._file = None if url else store.root / "index.sqlite"
        self._url = url or f"sqlite:///{self._file}"
        self._engine = _engine(self._url)

    def rebuild(self) -> int:
        """Make the index anew from the run folders; returns how many runs it holds.

        A broken SQLite file is set aside under another name, never deleted.
        Raises StoreError (E-STORE-INDEX).
        """
        runs = self._store.runs()
        self._prepare()
        with self._begin() as connection:
            connection.execute(delete(_STAGES))
            connection.execute(delete(_RUNS))
            for run in runs:
                _insert(connection, run)
        return len(runs)

    def update(self, folder: RunFolder) -> None:
        """Bring one run up to date. Raises StoreError (E-STORE-INDEX)."""
        self._prepare()
        with self._begin() as connection:
            connection.execute(delete(_STAGES).where(_STAGES.c.run_id == folder.run_id))
            connection.execute(delete(_RUNS).where(_RUNS.c.run_id == folder.run_id))
            _insert(connection, folder.summary())

    def list_runs(self, machine: str = "") -> tuple[RunSummary, ...]:
        """Runs as indexed, oldest first, of one machine's serial number or of all."""
        self._prepare()
        query = select(_RUNS).order_by(_RUNS.c.run_id)
        if machine:
            query = query.where(_RUNS.c.machine == machine)
        stages = select(_STAGES.c.run_id, _STAGES.c.stage)
        with self._begin() as connection:
            rows = connection.execute(query).mappings().all()
            known: dict[str, list[str]] = {}
            for run_id, stage in connection.execute(stages):
                known.setdefault(run_id, []).append(stage)
        return tuple(_summary(dict(row), known.get(row["run_id"], [])) for row in rows)

    def close(self) -> None:
        """Let go of the database."""
        self._engine.dispose()

    def _prepare(self) -> None:
        if self._file is not None:
            with disk_errors(self._file):
                made_folder(self._file.parent)
                # SQLite gives its own files, the log beside it too, the rights of this one.
                opened(self._file, "ab").close()
        try:
            _META.create_all(self._engine)
        except DatabaseError as error:
            self._set_aside(error)
        except SQLAlchemyError as error:
            raise StoreError("E-STORE-INDEX", self._where, why=str(error)) from error

    def _set_aside(self, error: DatabaseError) -> None:
        """Start a new file when the old one is no database; anything else is for a person."""
        if self._file is None or not any(word in str(error) for word in _BROKEN):
            raise StoreError("E-STORE-INDEX", self._where, why=str(error)) from error
        number = 1
        while (aside := self._file.with_name(f"index.broken-{number}.sqlite")).exists():
            number += 1
        with disk_errors(self._file):
            replace(self._file, aside)
        with _sql_errors(self._where):
            _META.create_all(self._engine)

    @property
    def _where(self) -> str:
        return self._engine.url.render_as_string(hide_password=True)

    @contextlib.contextmanager
    def _begin(self) -> Iterator[Connection]:
        with _sql_errors(self._where), self._engine.begin() as connection:
            yield connection


@contextlib.contextmanager
def _sql_errors(where: str) -> Iterator[None]:
    """The one place where SQLAlchemy's exceptions become ours."""
    try:
        yield
    except SQLAlchemyError as error:
        raise StoreError("E-STORE-INDEX", where, why=str(error)) from error


def _engine(url: str) -> Engine:
    with _sql_errors("index"):
        if not url.startswith("sqlite"):
            return create_engine(url)
        # One connection for each piece of work: none stays open, none crosses a thread.
        engine = create_engine(url, poolclass=NullPool)
        event.listen(engine, "connect", _durable)
        return engine


def _durable(connection: Any, _record: Any) -> None:
    """WAL for readers beside the writer; FULL because NORMAL may lose the last commits at power loss."""
    cursor = connection.cursor()
    try:
        cursor.execute("PRAGMA journal_mode=WAL")
        cursor.execute("PRAGMA synchronous=FULL")
        cursor.execute("PRAGMA busy_timeout=5000")
    finally:
        cursor.close()


def _insert(connection: Connection, run: RunSummary) -> None:
    columns = ("run_id", "site", "created_utc", "state", "machine", "software", "problem")
    row = {name: getattr(run, name) for name in columns}
    connection.execute(insert(_RUNS).values(**row, path=str(run.path)))
    for stage, entry in _entries(run).items():
        values = {"run_id": run.run_id, "stage": stage, "file": entry["file"], "sha256": entry["sha256"]}
        connection.execute(insert(_STAGES).values(**values))


def _entries(run: RunSummary) -> dict[str, Any]:
    if run.problem:
        return {}
    stages: dict[str, Any] = RunFolder(run.path).facts["stages"]
    return stages


def _summary(row: dict[str, Any], stages: list[str]) -> RunSummary:
    return RunSummary(**{**row, "path": Path(row["path"])}, stages=tuple(stages))
