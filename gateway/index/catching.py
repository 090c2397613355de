"""The index made to say what the run folders say: everything anew, or only what has changed since."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from sqlalchemy.exc import SQLAlchemyError

from drivers.errors import ConfigError
from gateway.config import SiteFile
from gateway.errors import InvalidOption
from gateway.index.keeping import RunIndex
from gateway.index.rows import FLANK, FLANK_PARAMETERS, PARAMETERS, journals_seal, read_run, seal_of, tables_of
from gateway.push import JOURNALS, journalled_machines
from gateway.store import Store

BATCH = 200
"""Runs written in one transaction: a commit waits for the disk, and one that is refused loses no more than these."""


def rebuilt(index: RunIndex, store: Store) -> int:
    """Everything anew; returns how many runs there are. Raises StoreError (E-INDEX, E-STORE-DISK)."""
    index.open()
    index.clear()
    return caught_up(index, store)


def caught_up(index: RunIndex, store: Store) -> int:
    """What has changed since the last time; returns how many runs were put in. Raises StoreError.

    A run whose file is as it was when this index looked last is not read again: a store of years is looked through in
    the time that its list takes.
    """
    index.open()
    with index.turn:
        return _caught_up(index, store)


def _caught_up(index: RunIndex, store: Store) -> int:
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
    _tables_caught_up(index, store.root / JOURNALS)
    return changed


def _tables_caught_up(index: RunIndex, journals: Path) -> None:
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


def due_of(index: RunIndex, days: int, now: datetime) -> list[dict[str, Any]]:
    """When each axis and the flank were measured last, until when that holds, and whether it is over."""
    found = index.last_measured()
    for one in found:
        until = datetime.fromisoformat(str(one["utc"])) + timedelta(days=days)
        one |= {"due_utc": until.isoformat(timespec="seconds"), "due": until <= now}
    return found


def known(parameter: str, subject: str = "") -> None:
    """Refuse a figure that no run ever holds, so that a slip is not taken for a figure that nobody measured yet.

    Raises ConfigError (E-INDEX-FIGURE).
    """
    figures = {FLANK: FLANK_PARAMETERS, "": (*PARAMETERS, *FLANK_PARAMETERS)}.get(subject, PARAMETERS)
    if parameter not in figures:
        raise InvalidOption("E-INDEX-FIGURE", subject or "index", parameter=parameter, known=", ".join(figures))


def compared(index: RunIndex, parameter: str, *, subject: str, phase: str = "after") -> list[dict[str, Any]]:
    """The newest figure of each machine and site that has it, the largest first: one error across machines.

    ``phase`` "before" or "after" a correction; a machine that was only measured has none after, and its newest before
    stands in the row, which says so. Raises ConfigError (E-INDEX-FIGURE), StoreError (E-INDEX).
    """
    known(parameter, subject)
    return index.newest(parameter, subject=subject, phases=("before",) if phase == "before" else ("before", phase))
