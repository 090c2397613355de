"""What the page shows of stored runs: the newest ones, the last verdict, one run's report."""

from __future__ import annotations

from gateway.domain.outcomes import Verdict
from gateway.errors import StoreError
from gateway.push.records.holding import held_pushes
from gateway.push.records.journal import JOURNALS
from gateway.store import RunFolder, Store
from gateway.store.folder import RUN_FILE
from gateway.views import HeldView, PastRun, ResultRow, axis_table, past_run

REPORT_FILE = "report.html"
VERDICT_STAGE = "verdict"
MOST_RUNS = 10


def newest_runs(store: Store) -> tuple[PastRun, ...]:
    """The last runs, newest first; one that cannot be read is shown with its problem."""
    return tuple(_past(store, run_id) for run_id in _newest(store))


def last_result(store: Store) -> tuple[ResultRow, ...]:
    """The before/after table of the newest run that has a verdict; empty when none of the last has."""
    tables = (_table(store, run_id) for run_id in _newest(store))
    return next((table for table in tables if table), ())


def pushes_held(store: Store) -> tuple[HeldView, ...]:
    """Every push that did not end, from the journals alone; one that cannot be read is as loud as any."""
    try:
        return tuple(HeldView(one.words, one.loud) for one in held_pushes(store.root / JOURNALS))
    except StoreError as error:
        return (HeldView(f"{error.code}: {error.what}", loud=True),)


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


def _table(store: Store, run_id: str) -> tuple[ResultRow, ...]:
    try:
        folder = RunFolder(store.root / run_id)
        return axis_table(folder.get(VERDICT_STAGE, Verdict)) if folder.has(VERDICT_STAGE) else ()
    except StoreError:
        return ()
