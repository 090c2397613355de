"""What people are shown of stored runs and of pushes: newest runs, last verdict, files, tables in the control."""

from __future__ import annotations

from typing import Any

from drivers.local.names import is_file_name
from gateway import audit
from gateway.domain.outcomes import ActingCheck, Verdict
from gateway.errors import CorruptRecord, RecordNotFound, StoreError
from gateway.push import (
    JOURNALS,
    CommittedPush,
    TableState,
    all_pushes,
    consent_set,
    held_pushes,
    rollback_previews,
    sense_conversion,
    table_states,
)
from gateway.store import RUN_FILE, RunFolder, Store, read_whole, sealed_hashes, sha256, stored_place
from gateway.store.machine_books import ProofBook
from gateway.tooth import ToothProposal
from gateway.views import ActingRow, HeldView, PastRun, ResultRow, acting_rows, axis_table, past_run

# What people are shown of stored runs: the newest ones, the last verdict, one run's report and files.

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
        return _acting_check(RunFolder(store.root / newest)) if newest else ()
    except StoreError:
        return ()


def _acting_check(folder: RunFolder) -> tuple[ActingRow, ...]:
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
    known = sealed_hashes(folder.facts)
    at = stored_place(name, folder.facts)
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


# What pushes left in a control, as data: each table with its number, date and points, and pushes that did not end.


def standing_tables(store: Store, serial: str) -> dict[str, Any]:
    """How each table stands, the alarms about them, and what is held. Raises StoreError.

    ``settled`` is false while anything must be put right before the next push.
    """
    journals, known = store.root / JOURNALS, audit.read_log_state(store.root, serial)
    looks = {name: (utc, known.kinds.get(name, "differs")) for name, utc in known.looked.items()}
    states, held = table_states(journals, serial, looks), held_pushes(journals)
    rolling = _Rollbacks(store, serial)
    return {
        "serial": serial,
        "tables": [_table_view(one, rolling) for one in states],
        "rollback": rolling.of(""),
        "alarms": dict(known.alarms),
        "held": [one.as_data() for one in held],
        "settled": not held and all(one.is_settled for one in states),
    }


class _Rollbacks:
    """What a rollback of one axis, or of everything the newest consent changed (""), restores."""

    def __init__(self, store: Store, serial: str) -> None:
        proofs, journals = ProofBook(store.root), store.root / JOURNALS
        self._kept = all_pushes(journals, serial)
        self._pushes = all_pushes(journals, serial, sense_conversion(lambda axis: proofs.sense_of(serial, axis)))

    def of(self, asked: str) -> dict[str, Any]:
        """``back`` are the tables with names and moves, ``stays`` tables of the same consent that go on acting."""
        found = consent_set(self._pushes, asked)
        if found is None:
            return {"back": [], "stays": []}
        back = [one.as_data() for one in rollback_previews(self._kept, found).values()]
        return {"back": back, "stays": [one.table for one in found.rest]}


def _table_view(state: TableState, rolling: _Rollbacks) -> dict[str, Any]:
    """A table as every screen shows it; ``back`` are the tables that a rollback of its axis restores."""
    told: dict[str, Any] = {
        "table": state.table,
        "axis": state.axis,
        "id": state.name.id,
        "transaction": state.push.transaction if state.push is not None else 0,
        "utc": state.name.utc or state.utc,
        "known_utc": state.utc,
        "acts": state.acts,
        "enabled": state.acts == "on",
        "held": state.held.as_data() if state.held is not None else None,
    }
    return told | rolling.of(state.axis) | _points(state.push)


def _points(push: CommittedPush | None) -> dict[str, Any]:
    """An axis' own table with its points; a cross table's are kept in the control's sense, so they stay out."""
    if push is None:
        return {"kind": "", "unit": ""}
    table = push.new.table
    told: dict[str, Any] = {"kind": table.kind, "unit": table.deviation_unit}
    if table.kind == "axis":
        told |= {"positions": table.positions.tolist(), "deviations": list(map(float, table.deviations))}
    if table.kind == "reversal":
        told |= {"value": float(table.deviations[0])}
    return told
