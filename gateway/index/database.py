"""The index in its database: its tables, opened and migrated, brought to what the run folders say, and asked.

A run is read again when the seal of its folder differs from the row's; tables of pushes when a journal has changed.
Folders are the truth: a damaged database is moved aside and made anew.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, fields
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    Connection,
    Engine,
    Float,
    ForeignKeyConstraint,
    Index,
    MetaData,
    String,
    Table,
    Text,
    create_engine,
    delete,
    event,
    func,
    insert,
    or_,
    select,
)
from sqlalchemy.exc import DBAPIError, SQLAlchemyError
from sqlalchemy.pool import NullPool

from drivers.errors import ConfigError
from drivers.local.ownfiles import make_own_parents, refuse_link
from gateway.config import SiteFile
from gateway.errors import InvalidOption, StoreError
from gateway.index.rows import (
    FLANK,
    FLANK_PARAMETERS,
    PARAMETERS,
    IndexedFigure,
    IndexedRun,
    IndexedTable,
    gateway_name,
    journals_seal,
    read_run,
    seal_of,
    tables_of,
)
from gateway.push import JOURNALS, journalled_machines
from gateway.store import Store

# The index in its database: opened, brought to today's tables, written, asked.

INDEX_FILE = "index.db"
STEPS = (
    "gateway.index.migrations.env",
    "gateway.index.migrations.versions.v0001_runs_and_figures",
    "gateway.index.migrations.versions.v0002_active_tables",
    "gateway.index.migrations.versions.v0003_newest_figures",
)
"""Modules that alembic loads by their files."""
MOST_ROWS = 10_000


def index_url(root: Path) -> str:
    """The address of the index that stands beside the runs."""
    return f"sqlite:///{root / INDEX_FILE}"


class RunIndex:
    """The index of one store, or of many stores in one database.

    Holds no connection open between two calls. Every call raises StoreError (E-INDEX) where the database does not
    answer: then the run folders are still whole.
    """

    def __init__(self, root: Path, url: str = "") -> None:
        self.root = root
        self.gateway = gateway_name(root)
        self._own = not url
        self._is_open = False
        self.looked: dict[str, tuple[tuple[int, ...], str]] = {}
        """Each run's mark (`Store.marks`) and seal when it was read last."""
        self.no_tables = ""
        """The seal of the journals when they were read last and had left no table."""
        self.turn = threading.Lock()
        """Who lets it catch up: one thread at a time."""
        self._engine = _engine(url or index_url(root))

    def open(self) -> None:
        """Bring the tables to today's form; a damaged file of our own is moved aside and begun anew."""
        if self._is_open:
            return
        if self._own:
            self._make_place()
        try:
            self._upgrade()
            self._is_open = True
        except (SQLAlchemyError, OSError) as error:
            if not self._own or not isinstance(error, DBAPIError) or not _is_damaged(error):
                raise _index_error(error, self.root) from error
            self._move_aside()
            with _as_store_error(self.root):
                self._upgrade()
            self._is_open = True

    def _upgrade(self) -> None:
        from alembic import command
        from alembic.config import Config

        config = Config()
        config.set_main_option("script_location", str(Path(__file__).parent / "migrations"))
        with self._engine.begin() as connection:
            if connection.dialect.name == "postgresql":
                # Two gateways that begin together: one makes the tables, the other finds them.
                connection.execute(select(func.pg_advisory_xact_lock(0x7472756566)))
            config.attributes["connection"] = connection
            command.upgrade(config, "head")

    def _make_place(self) -> None:
        path = self.root / INDEX_FILE
        with _as_store_error(self.root):
            make_own_parents(path)
            refuse_link(path)
            if not path.exists():
                os.close(os.open(path, os.O_CREAT | os.O_WRONLY, 0o600))

    def _move_aside(self) -> None:
        path, number = self.root / INDEX_FILE, 1
        while (aside := path.with_name(f"{INDEX_FILE}.damaged-{number}")).exists():
            number += 1
        with _as_store_error(self.root):
            os.replace(path, aside)
            for more in ("-wal", "-shm"):
                path.with_name(f"{INDEX_FILE}{more}").unlink(missing_ok=True)
        self._make_place()

    @contextlib.contextmanager
    def _at(self) -> Iterator[Connection]:
        with _as_store_error(self.root), self._engine.begin() as connection:
            yield connection

    def seals(self) -> dict[str, str]:
        """The seal of each run of this store that the index knows."""
        with self._at() as at:
            rows = at.execute(select(RUNS.c.run_id, RUNS.c.seal).where(RUNS.c.gateway == self.gateway))
            return {str(run): str(seal) for run, seal in rows}

    def put(self, runs: Iterable[tuple[IndexedRun, Iterable[IndexedFigure]]]) -> None:
        """Write runs with their figures in place of their previous rows, in one transaction."""
        rows = [(run, list(figures)) for run, figures in runs]
        figures = [_with_run(figure, run) for run, of_run in rows for figure in of_run]
        with self._at() as at:
            self._drop(at, [run.run_id for run, _figures in rows])
            if rows:
                at.execute(insert(RUNS), [_columns(run) for run, _figures in rows])
            if figures:
                at.execute(insert(FIGURES), figures)

    def drop(self, runs: Sequence[str]) -> None:
        """Forget runs whose folders are gone."""
        with self._at() as at:
            self._drop(at, runs)

    def _turn(self, at: Connection) -> None:
        """One program at a time writes a store's rows: the service that follows it, and `runs reindex` beside it."""
        if at.dialect.name == "postgresql":
            at.execute(select(func.pg_advisory_xact_lock(func.hashtext(self.gateway))))

    def _drop(self, at: Connection, runs: Sequence[str]) -> None:
        self._turn(at)
        for table in (FIGURES, RUNS):
            at.execute(delete(table).where(table.c.gateway == self.gateway, table.c.run_id.in_(list(runs))))

    def clear(self) -> None:
        """Forget every run of this store."""
        with self._at() as at:
            self._turn(at)
            for table in (FIGURES, RUNS, TABLES):
                at.execute(delete(table).where(table.c.gateway == self.gateway))

    def tables_seal(self) -> str:
        """The seal of the journals that this store's tables were taken from; "" where there are none."""
        with self._at() as at:
            found = at.execute(select(TABLES.c.seal).where(TABLES.c.gateway == self.gateway).limit(1)).scalar()
            return str(found or "")

    def put_tables(self, tables: Iterable[IndexedTable]) -> None:
        """What pushes of this store left in its machines, all anew."""
        rows = [asdict(one) for one in tables]
        with self._at() as at:
            self._turn(at)
            at.execute(delete(TABLES).where(TABLES.c.gateway == self.gateway))
            if rows:
                at.execute(insert(TABLES), rows)

    def tables(self, *, serial: str = "") -> list[dict[str, Any]]:
        """The tables that should act in each machine by what was pushed, of every gateway, by machine and name.

        ``site`` is that of the machine's newest run. Where a machine was served by more than one gateway each tells
        of its own pushes.
        """
        site = select(RUNS.c.site).where(RUNS.c.gateway == TABLES.c.gateway, RUNS.c.serial == TABLES.c.serial)
        newest = site.order_by(RUNS.c.created_utc.desc()).limit(1).scalar_subquery()
        wanted = select(TABLES, func.coalesce(newest, "").label("site"))
        if serial:
            wanted = wanted.where(TABLES.c.serial == serial)
        ordered = wanted.order_by(TABLES.c.serial, TABLES.c.gateway, TABLES.c.name).limit(MOST_ROWS)
        with self._at() as at:
            return [dict(row._mapping) for row in at.execute(ordered)]  # noqa: SLF001 - the library's public name

    def search(self, text: str = "", *, serial: str = "", most: int = 100) -> list[dict[str, Any]]:
        """Runs of every gateway, newest first, whose id, site, machine or state holds a text."""
        wanted = select(RUNS).order_by(RUNS.c.created_utc.desc(), RUNS.c.run_id.desc()).limit(min(most, MOST_ROWS))
        if serial:
            wanted = wanted.where(RUNS.c.serial == serial)
        if text:
            places = (RUNS.c.run_id, RUNS.c.site, RUNS.c.serial, RUNS.c.state)
            wanted = wanted.where(or_(*(place.icontains(text, autoescape=True) for place in places)))
        with self._at() as at:
            return [dict(row._mapping) for row in at.execute(wanted)]  # noqa: SLF001 - the library's public name

    def trend(
        self, parameter: str, *, serial: str = "", subject: str = "", phase: str = "", before: str = "", most: int = 0
    ) -> list[dict[str, Any]]:
        """The newest ``most`` figures of one parameter (10 000 where 0), oldest first.

        They are of one machine and axis, or of all. ``before`` is the time of the oldest figure of the previous page:
        only older ones follow.
        """
        wanted = select(FIGURES).where(FIGURES.c.parameter == parameter)
        for column, value in ((FIGURES.c.serial, serial), (FIGURES.c.subject, subject), (FIGURES.c.phase, phase)):
            wanted = wanted.where(column == value) if value else wanted
        wanted = wanted.where(FIGURES.c.created_utc < before) if before else wanted
        newest = wanted.order_by(FIGURES.c.created_utc.desc(), FIGURES.c.subject.desc(), FIGURES.c.phase)
        with self._at() as at:
            found = at.execute(newest.limit(min(most or MOST_ROWS, MOST_ROWS)))
            return [dict(row._mapping) for row in found][::-1]  # noqa: SLF001 - the library's public name

    def newest(self, parameter: str, *, subject: str, phases: Sequence[str]) -> list[dict[str, Any]]:
        """The newest figure of each machine and site, by amount, largest first; of two of one run the later phase.

        ``phases`` are those that count, the later one last.
        """
        machine = (FIGURES.c.serial, FIGURES.c.site)
        wanted = (FIGURES.c.parameter == parameter, FIGURES.c.subject == subject, FIGURES.c.phase.in_(phases))
        last = (
            select(*machine, func.max(FIGURES.c.created_utc).label("utc")).where(*wanted).group_by(*machine).subquery()
        )
        same = (FIGURES.c.serial == last.c.serial) & (FIGURES.c.site == last.c.site)
        rows = select(FIGURES).join(last, same & (FIGURES.c.created_utc == last.c.utc)).where(*wanted)
        with self._at() as at:
            found = [dict(row._mapping) for row in at.execute(rows)]  # noqa: SLF001 - the library's public name
        found.sort(key=lambda row: (phases.index(row["phase"]), row["run_id"], row["gateway"]))
        each = {(row["serial"], row["site"]): row for row in found}
        return sorted(each.values(), key=lambda row: (-abs(float(row["value"])), row["serial"], row["site"]))

    def last_measured(self) -> list[dict[str, Any]]:
        """When each machine's axes and flank were measured last."""
        keys = (FIGURES.c.serial, FIGURES.c.site, FIGURES.c.subject)
        wanted = select(*keys, func.max(FIGURES.c.created_utc).label("utc")).group_by(*keys).order_by(*keys)
        with self._at() as at:
            return [dict(row._mapping) for row in at.execute(wanted)]  # noqa: SLF001 - the library's public name


def _columns(record: IndexedRun | IndexedFigure) -> dict[str, Any]:
    """A flat record by the names of its fields; `asdict` would copy each value deeply."""
    return {field.name: getattr(record, field.name) for field in fields(record)}


def _with_run(figure: IndexedFigure, run: IndexedRun) -> dict[str, Any]:
    return _columns(figure) | {"serial": run.serial, "site": run.site, "created_utc": run.created_utc}


def _engine(url: str) -> Engine:
    engine = create_engine(url, poolclass=NullPool)
    if engine.dialect.name == "sqlite":
        event.listen(engine, "connect", _durable)
    return engine


def _durable(connection: Any, _record: Any) -> None:
    """A write-ahead log, every commit on disk, keys between tables kept."""
    for pragma in ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON", "busy_timeout=5000"):
        connection.execute(f"PRAGMA {pragma}").close()


# In the words of SQLite.
NO_DATABASE = " ".join(("not", "a", "database"))


def _is_damaged(error: DBAPIError) -> bool:
    return any(word in str(error.orig) for word in ("malformed", NO_DATABASE))


def _index_error(error: Exception, root: Path) -> StoreError:
    """Never with the address: a password may stand in it."""
    why = str(getattr(error, "orig", None) or type(error).__name__).splitlines()[0][:200]
    return StoreError("E-INDEX", str(root), why=why)


@contextlib.contextmanager
def _as_store_error(root: Path) -> Iterator[None]:
    try:
        yield
    except (SQLAlchemyError, OSError) as error:
        raise _index_error(error, root) from error


# The tables of the index as today's program knows them; `migrations` brings older ones here.

METADATA = MetaData()
_RUN = (
    Column("gateway", String(200), primary_key=True),
    Column("run_id", String(120), primary_key=True),
    Column("site", String(120), nullable=False),
    Column("serial", String(200), nullable=False),
    Column("created_utc", String(40), nullable=False),
    Column("state", String(80), nullable=False),
    Column("software", String(40), nullable=False),
    Column("problem", Text, nullable=False),
    Column("seal", String(64), nullable=False),
    Index("run_by_machine", "serial", "created_utc"),
)
_FIGURE = (
    Column("gateway", String(200), primary_key=True),
    Column("run_id", String(120), primary_key=True),
    Column("subject", String(40), primary_key=True),
    Column("phase", String(20), primary_key=True),
    Column("parameter", String(20), primary_key=True),
    Column("value", Float, nullable=False),
    Column("expanded", Float, nullable=True),
    Column("unit", String(20), nullable=False),
    # The run's own, written with each figure: the newest figure of each machine is found without a join.
    Column("serial", String(200), nullable=False, server_default=""),
    Column("site", String(120), nullable=False, server_default=""),
    Column("created_utc", String(40), nullable=False, server_default=""),
    ForeignKeyConstraint(["gateway", "run_id"], ["run.gateway", "run.run_id"], ondelete="CASCADE"),
    Index("figure_by_machine", "parameter", "subject", "phase", "serial", "site", "created_utc"),
    Index("figure_by_time", "serial", "site", "subject", "created_utc"),
)
_TABLE = (
    Column("gateway", String(200), primary_key=True),
    Column("serial", String(200), primary_key=True),
    Column("name", String(80), primary_key=True),
    Column("axis", String(40), nullable=False),
    Column("table_id", String(12), nullable=False),
    Column("transaction", BigInteger, nullable=False),
    Column("utc", String(40), nullable=False),
    Column("enabled", Boolean, nullable=False),
    Column("kind", String(20), nullable=False),
    Column("problem", Text, nullable=False),
    Column("seal", String(64), nullable=False),
)
RUNS = Table("run", METADATA, *_RUN)
FIGURES = Table("figure", METADATA, *_FIGURE)
TABLES = Table("active_table", METADATA, *_TABLE)


# The index made to say what the run folders say: everything anew, or only what has changed since.

BATCH = 200
"""Runs written in one transaction: a commit waits for the disk, and one that is refused loses no more than these."""


def rebuild(index: RunIndex, store: Store) -> int:
    """Everything anew; returns how many runs there are. Raises StoreError (E-INDEX, E-STORE-DISK)."""
    index.open()
    index.clear()
    return catch_up(index, store)


def catch_up(index: RunIndex, store: Store) -> int:
    """What has changed since the last time; returns how many runs were put in. Raises StoreError.

    A run whose file is as it was when this index looked last is not read again: a store of years is looked through in
    the time that its list takes.
    """
    index.open()
    with index.turn:
        return _catch_up(index, store)


def _catch_up(index: RunIndex, store: Store) -> int:
    known, marks = index.seals(), store.marks()
    changed = 0
    ahead = [one for one in marks.items() if one[0] not in known or index.looked.get(one[0]) != (one[1], known[one[0]])]
    for start in range(0, len(ahead), BATCH):
        read = {run_id: (mark, store.summary(run_id)) for run_id, mark in ahead[start : start + BATCH]}
        new = [run for _mark, run in read.values() if seal_of(run) != known.get(run.run_id)]
        index.put([read_run(index.gateway, run) for run in new])
        index.looked.update({run_id: (mark, seal_of(run)) for run_id, (mark, run) in read.items()})
        changed += len(new)
    gone = sorted(set(known) - set(marks))
    if gone:
        index.drop(gone)
    for run_id in set(index.looked) - set(marks):
        del index.looked[run_id]
    _catch_up_tables(index, store.root / JOURNALS)
    return changed


def _catch_up_tables(index: RunIndex, journals: Path) -> None:
    seal = journals_seal(journals)
    known = index.tables_seal()
    if known == seal or (not known and index.no_tables == seal):
        return
    rows = [row for serial in journalled_machines(journals) for row in tables_of(index.gateway, journals, serial, seal)]
    index.put_tables(rows)
    index.no_tables = "" if rows else seal


def index_of(site: SiteFile, path: Path, store: Store) -> RunIndex:
    """The index that a site file names. Raises ConfigError (E-INDEX-FILE, E-INDEX-EXTRA: its library is not there)."""
    file = site.service.index_url_file
    if file is None:
        return RunIndex(store.root)
    try:
        url = (path.parent / file).read_text(encoding="utf-8").strip()
        return RunIndex(store.root, url)
    except ImportError as error:
        raise ConfigError("E-INDEX-EXTRA", str(file), library=str(error.name)) from error
    except (OSError, ValueError, SQLAlchemyError) as error:
        # Never with the address itself: a password may stand in it.
        raise ConfigError("E-INDEX-FILE", str(file), why=type(error).__name__) from error


def due_measurements(index: RunIndex, days: int, now: datetime) -> list[dict[str, Any]]:
    """When each axis and the flank were measured last, until when that holds, and whether it is over."""
    found = index.last_measured()
    for one in found:
        until = datetime.fromisoformat(str(one["utc"])) + timedelta(days=days)
        one |= {"due_utc": until.isoformat(timespec="seconds"), "due": until <= now}
    return found


def check_figure_known(parameter: str, subject: str = "") -> None:
    """Refuse a figure that no run ever holds, so that a slip is not taken for a figure that nobody measured yet.

    Raises ConfigError (E-INDEX-FIGURE).
    """
    figures = {FLANK: FLANK_PARAMETERS, "": (*PARAMETERS, *FLANK_PARAMETERS)}.get(subject, PARAMETERS)
    if parameter not in figures:
        raise InvalidOption("E-INDEX-FIGURE", subject or "index", parameter=parameter, known=", ".join(figures))


def compare_machines(index: RunIndex, parameter: str, *, subject: str, phase: str = "after") -> list[dict[str, Any]]:
    """The newest figure of each machine and site that has it, the largest first: one error across machines.

    ``phase`` "before" or "after" a correction; a machine that was only measured has none after, and its newest before
    stands in the row, which says so. Raises ConfigError (E-INDEX-FIGURE), StoreError (E-INDEX).
    """
    check_figure_known(parameter, subject)
    return index.newest(parameter, subject=subject, phases=("before",) if phase == "before" else ("before", phase))
