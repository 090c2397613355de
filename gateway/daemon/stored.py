"""What the page shows of stored runs: the newest ones, the last verdict, one run's report."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.errors import TrueflankError
from drivers.leftover import LeftOver
from gateway.domain import Verdict
from gateway.errors import StoreError
from gateway.push import unfinished
from gateway.push.journal import machine_folder
from gateway.push.lock import is_held
from gateway.store import RunFolder, Store
from gateway.store.folder import RUN_FILE
from gateway.views import PastRun, TableRow, axis_table, past_run
from gateway.workflow.bench import JOURNALS

REPORT_FILE = "report.html"
VERDICT_STAGE = "verdict"
MOST_RUNS = 10


def newest_runs(store: Store) -> tuple[PastRun, ...]:
    """The last runs, newest first; one that cannot be read is shown with its problem."""
    return tuple(_past(store, run_id) for run_id in _newest(store))


def last_result(store: Store) -> tuple[TableRow, ...]:
    """The before/after table of the newest run that has a verdict; empty when none of the last has."""
    tables = (_table(store, run_id) for run_id in _newest(store))
    return next((table for table in tables if table), ())


def left_behind(left: LeftOver, store: Store, serial: str) -> tuple[Mapping[str, object], ...]:
    """What a person must see to before the machine is ready: left in the control, or a push that did not end."""
    found: list[Mapping[str, object]] = [] if left.clear else [left.said.as_record()]
    journals = store.root / JOURNALS
    try:
        open_ones = () if is_held(machine_folder(journals, serial)) else unfinished(journals, serial)
    except StoreError as error:
        return (*found, error.as_record())
    for one in open_ones:
        axis, last = one.latest("axis") or "?", one.said_last
        said = TrueflankError("W-WEB-UNFINISHED", "journal", transaction=one.number, axis=axis, last=last)
        found.append(said.as_record())
    return tuple(found)


def stored_report(store: Store, run_id: str) -> str | None:
    """A run's report page as stored, its hash checked; None when there is none. Raises StoreError."""
    path = store.root / run_id
    if not (path / RUN_FILE).is_file() or not (path / REPORT_FILE).is_file():
        return None
    return RunFolder(path).read_text(REPORT_FILE)


def _newest(store: Store) -> list[str]:
    # Ids begin with the time, so their order is the order of the runs.
    found = [path.parent.name for path in store.root.glob(f"*/{RUN_FILE}")]
    return sorted(found, reverse=True)[:MOST_RUNS]


def _past(store: Store, run_id: str) -> PastRun:
    path = store.root / run_id
    try:
        return past_run(RunFolder(path).summary(), report=(path / REPORT_FILE).is_file())
    except StoreError as error:
        return PastRun(run_id, "", "unreadable", error.what, report=False)


def _table(store: Store, run_id: str) -> tuple[TableRow, ...]:
    try:
        folder = RunFolder(store.root / run_id)
        return axis_table(folder.get(VERDICT_STAGE, Verdict)) if folder.has(VERDICT_STAGE) else ()
    except StoreError:
        return ()
