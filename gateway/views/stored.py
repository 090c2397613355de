"""What people are shown of stored runs: the newest ones, the last verdict, one run's report and files."""

from __future__ import annotations

from drivers.local.names import is_file_name
from gateway.domain.outcomes import ActingCheck, Verdict
from gateway.errors import CorruptRecord, RecordNotFound, StoreError
from gateway.push import JOURNALS, held_pushes
from gateway.store import RunFolder, Store
from gateway.store.disk import read_whole
from gateway.store.folder import RUN_FILE
from gateway.store.layout import place
from gateway.store.records import sha256
from gateway.store.seal import sealed
from gateway.tooth import ToothProposal
from gateway.views import ActingRow, HeldView, PastRun, ResultRow, acting_rows, axis_table, past_run

REPORT_FILE = "report.html"
VERDICT_STAGE, TOOTH_STAGE, ACTING_STAGE = "verdict", "tooth", "acting-"
MOST_RUNS = 10


def newest_runs(store: Store) -> tuple[PastRun, ...]:
    """The last runs, newest first; one that cannot be read is shown with its problem."""
    return tuple(_past(store, run_id) for run_id in store.newest(MOST_RUNS))


def last_result(store: Store) -> tuple[ResultRow, ...]:
    """The before/after table of the newest run that has a verdict; empty when none of the last has."""
    tables = (_table(store, run_id) for run_id in store.newest(MOST_RUNS))
    return next((table for table in tables if table), ())


def last_acting(store: Store) -> tuple[ActingRow, ...]:
    """Each axis with every table acting, of the newest run that has a verdict; empty where it served no tooth."""
    newest = next((one for one in store.newest(MOST_RUNS) if _table(store, one)), "")
    try:
        return _acting(RunFolder(store.root / newest)) if newest else ()
    except StoreError:
        return ()


def _acting(folder: RunFolder) -> tuple[ActingRow, ...]:
    if not folder.has(TOOTH_STAGE) or folder.get(VERDICT_STAGE, Verdict).outcome == "not-pushed":
        return ()
    checks = [folder.get(stage, ActingCheck) for stage in folder.stages if stage.startswith(ACTING_STAGE)]
    return acting_rows(folder.get(TOOTH_STAGE, ToothProposal).axes, {one.axis: one for one in checks})


def pushes_held(store: Store) -> tuple[HeldView, ...]:
    """Every push that did not end, from the journals alone; one that cannot be read is as loud as any."""
    try:
        return tuple(
            HeldView(one.words, one.needs_attention, one.code, one.fields, back=one.back)
            for one in held_pushes(store.root / JOURNALS)
        )
    except StoreError as error:
        return (HeldView(f"{error.code}: {error.what}", loud=True, code=error.code, fields=dict(error.fields)),)


def has_report(store: Store, run_id: str) -> bool:
    """Whether a run has a report page to be shown."""
    return (store.root / run_id / REPORT_FILE).is_file()


def stored_report(store: Store, run_id: str) -> str | None:
    """A run's report page as stored, its hash checked; None when there is none. Raises StoreError."""
    path = store.root / run_id
    if not (path / RUN_FILE).is_file() or not has_report(store, run_id):
        return None
    return RunFolder(path).read_text(REPORT_FILE)


def sealed_file(folder: RunFolder, name: str) -> bytes:
    """A file of a run, pictures among them, its hash checked; stages by the name of their file.

    Raises StoreError (E-STORE-FILE), CorruptRecord (E-STORE-HASH).
    """
    known = sealed(folder.facts)
    at = place(name, folder.facts)
    if at not in known or not is_file_name(name):
        raise RecordNotFound("E-STORE-FILE", str(folder.path), name=name[:80], known=", ".join(sorted(known)))
    data = read_whole(folder.path / at)
    if sha256(data) != known[at]:
        raise CorruptRecord("E-STORE-HASH", str(folder.path / at), stage=name)
    return data


def _past(store: Store, run_id: str) -> PastRun:
    try:
        return past_run(RunFolder(store.root / run_id).summary(), report=has_report(store, run_id))
    except StoreError as error:
        return PastRun(run_id, "", "unreadable", error.what, report=False)


def _table(store: Store, run_id: str) -> tuple[ResultRow, ...]:
    try:
        folder = RunFolder(store.root / run_id)
        return axis_table(folder.get(VERDICT_STAGE, Verdict)) if folder.has(VERDICT_STAGE) else ()
    except StoreError:
        return ()
