"""The index: it says what the folders say, catches up, is made anew, and never decides anything."""

from __future__ import annotations

import json
import shutil
import sys
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from sqlalchemy import create_engine, inspect

from drivers.errors import ConfigError
from gateway import audit
from gateway.errors import StoreError
from gateway.index import IndexedFigure, IndexedRun, SiteIndex, database
from gateway.index.database import METADATA, RunIndex, catch_up, compare_machines, due_measurements, index_url, rebuild
from gateway.push.journal import JOURNALS
from gateway.store import RunFolder, RunSummary, Store
from gateway.views.runs import standing_tables
from tests.unit.audit.log import Moments
from tests.unit.push.test_history import SERIAL as PUSHED
from tests.unit.push.test_history import written
from tests.unit.report.synthetic import axis_material
from tests.unit.web.test_daemon import SITE


def measured(store: Store, axis: str, state: str = "proposed") -> str:
    """A run with one axis evaluated."""
    run = store.create("hall-3")
    material = axis_material(axis, "mm")
    assert material.before is not None
    run.put(f"evaluation-{axis}-before", material.before)
    run.set_state(state)
    return run.run_id


def test_an_index_says_what_the_folders_say_and_follows_them(tmp_path: Path) -> None:
    store, index = Store(tmp_path), RunIndex(tmp_path)
    first = measured(store, "X1")
    assert catch_up(index, store) == 1
    assert catch_up(index, store) == 0
    second = measured(store, "X1")
    store.open(first).set_state("pushed")
    assert catch_up(index, store) == 2
    assert [(one["run_id"], one["state"]) for one in index.search()] == [(second, "proposed"), (first, "pushed")]
    assert [one["run_id"] for one in index.search("PUSH")] == [first]
    assert index.search("100%_") == []
    shutil.rmtree(tmp_path / second)
    assert catch_up(index, store) == 0
    assert [one["run_id"] for one in index.search()] == [first]


def test_what_did_not_change_is_not_read_again_and_what_the_database_lost_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, index = Store(tmp_path), RunIndex(tmp_path)
    runs = [measured(store, "X1") for _run in range(3)]
    catch_up(index, store)
    read: list[str] = []
    summary = Store.summary

    def noted(self: Store, run_id: str) -> RunSummary:
        read.append(run_id)
        return summary(self, run_id)

    monkeypatch.setattr(Store, "summary", noted)
    assert catch_up(index, store) == 0
    assert read == []
    store.open(runs[1]).set_state("pushed")
    assert catch_up(index, store) == 1
    RunIndex(tmp_path).drop(runs[:1])  # by another program
    assert catch_up(index, store) == 1
    assert read == [runs[1], runs[0]]
    assert {one["run_id"] for one in index.search()} == set(runs)


def test_a_trend_has_each_figure_with_its_u_in_the_order_of_time(tmp_path: Path) -> None:
    store, index = Store(tmp_path), RunIndex(tmp_path)
    runs = [measured(store, "X1") for _run in range(3)]
    catch_up(index, store)
    material = axis_material("X1", "mm").before
    assert material is not None
    points = index.trend("E", subject="X1", phase="before")
    assert [one["run_id"] for one in points] == runs
    assert {(one["value"], one["expanded"]) for one in points} == {(material.E, material.U.get("E"))}
    assert index.trend("E", subject="C1") == []
    now = datetime.now(UTC)
    (due,) = due_measurements(index, 365, now)
    assert (due["subject"], due["due"]) == ("X1", False)
    assert due_measurements(index, 365, now + timedelta(days=366))[0]["due"] is True


def test_made_anew_from_damage_and_beside_runs_that_cannot_be_read(tmp_path: Path) -> None:
    store = Store(tmp_path)
    good, bad = measured(store, "X1"), measured(store, "X1")
    (tmp_path / bad / "run.json").write_text("{", encoding="ascii")
    (tmp_path / "index.db").write_bytes(b"no database at all " * 100)
    assert rebuild(RunIndex(tmp_path), store) == 2
    found = {one["run_id"]: one["problem"] for one in RunIndex(tmp_path).search()}
    assert found[good] == ""
    assert found[bad]
    assert (tmp_path / "index.db.damaged-1").exists()


def test_the_tables_of_every_machine_are_found_with_id_and_date(tmp_path: Path) -> None:
    """By what the journals say: the newest push of each table, nothing of one that was taken back by the control."""
    store, index = Store(tmp_path), RunIndex(tmp_path)
    measured(store, "X1")
    assert catch_up(index, store) == 1
    assert index.tables() == []
    journals = tmp_path / JOURNALS
    for number, old, new in ((1, 0.0, 1.0), (2, 1.0, 2.0)):
        written(journals, number, old, new, minute=number, serial=PUSHED)
    written(journals, 3, 2.0, 9.0, end="ROLLED_BACK", serial=PUSHED)
    written(journals, 4, 0.0, 3.0, axis="C1", serial=PUSHED)
    assert catch_up(index, store) == 0
    found = {one["name"]: one for one in index.tables()}
    assert {name: (one["transaction"], one["utc"]) for name, one in found.items()} == {
        "C1": (4, "2026-11-21T10:55:00+00:00"),
        "X1": (2, "2026-11-21T10:02:00+00:00"),
    }
    assert found["X1"]["enabled"]
    assert [one["id"] for one in standing_tables(store, PUSHED)["tables"]] == [
        found[x]["table_id"] for x in ("C1", "X1")
    ]
    assert index.tables(serial="SN-9") == []
    written(journals, 5, 2.0, 0.0, minute=6, undoes=2, serial=PUSHED)
    index.clear()
    catch_up(RunIndex(tmp_path), store)
    assert [one["transaction"] for one in index.tables()] == [4, 5]
    assert rebuild(RunIndex(tmp_path), store) == 1
    assert [one["transaction"] for one in index.tables()] == [4, 5]


def test_a_machine_whose_journal_cannot_be_believed_says_so(tmp_path: Path) -> None:
    store, index = Store(tmp_path), RunIndex(tmp_path)
    for number in (1, 2):
        path = written(tmp_path / JOURNALS, number, 0.0, 1.0, serial=PUSHED)
    done = path.parent / "done" / path.name
    done.write_bytes(done.read_bytes().replace(b"live-2", b"live-7"))
    catch_up(index, store)
    (found,) = index.tables()
    assert (found["serial"], found["name"], found["table_id"]) == (PUSHED, "", "")
    assert "E-PUSH-JOURNAL" in found["problem"]


def test_an_index_of_an_older_program_gets_the_tables_that_it_lacks(tmp_path: Path) -> None:
    store = Store(tmp_path)
    measured(store, "X1")
    catch_up(RunIndex(tmp_path), store)
    engine = create_engine(index_url(tmp_path))
    with engine.begin() as connection:
        connection.exec_driver_sql("DROP TABLE active_table")
        for name in ("figure_by_machine", "figure_by_time"):
            connection.exec_driver_sql(f"DROP INDEX {name}")
        for name in ("serial", "site", "created_utc"):
            connection.exec_driver_sql(f"ALTER TABLE figure DROP COLUMN {name}")
        connection.exec_driver_sql("CREATE INDEX figure_by_subject ON figure (subject, parameter, phase)")
        connection.exec_driver_sql("UPDATE alembic_version SET version_num = '0001'")
    engine.dispose()
    written(tmp_path / JOURNALS, 1, 0.0, 1.0, serial=PUSHED)
    index = RunIndex(tmp_path)
    assert catch_up(index, store) == 0
    assert [one["name"] for one in index.tables()] == ["X1"]
    (point,) = index.trend("E")
    assert (point["site"], point["created_utc"]) == ("hall-3", index.search()[0]["created_utc"])


def test_the_steps_end_at_the_tables_that_the_program_knows(tmp_path: Path) -> None:
    RunIndex(tmp_path).open()
    engine = create_engine(index_url(tmp_path))
    with engine.connect() as connection:
        assert connection.exec_driver_sql("PRAGMA journal_mode").scalar() == "wal"
        seen = inspect(connection)
        for table in METADATA.sorted_tables:
            columns = {one["name"]: one["nullable"] for one in seen.get_columns(table.name)}
            assert columns == {one.name: one.nullable for one in table.columns}
            assert {one["name"] for one in seen.get_indexes(table.name)} == {one.name for one in table.indexes}
    engine.dispose()


def test_two_stores_in_one_database_are_told_apart_and_compared(tmp_path: Path) -> None:
    url = index_url(tmp_path)
    stores = [Store(tmp_path / name) for name in ("a", "b")]
    for store in stores:
        measured(store, "X1")
        catch_up(RunIndex(store.root, url), store)
    index = RunIndex(stores[0].root, url)
    assert len(index.trend("E")) == 2
    index.clear()
    assert len(index.trend("E")) == 1


def test_one_error_is_compared_across_machines_by_the_newest_of_each(tmp_path: Path) -> None:
    index = RunIndex(tmp_path)
    index.open()
    machines = (("SN-1", "a", (4.0, 9.0, 2.0)), ("SN-2", "b", (7.0, 3.0, None)), ("SN-3", "c", (5.0, None, None)))
    for serial, site, (first, second, after) in machines:
        for day, value, phase in ((1, first, "before"), (2, second, "before"), (2, after, "after")):
            if value is None:
                continue
            run_id = f"{serial}-{day}"
            run = IndexedRun("g", f"{run_id}-{phase}", site, serial, f"2026-01-0{day}", "", "", "", "")
            figure = IndexedFigure("g", run.run_id, "X1", phase, "E", value, 0.5, "um")
            index.put([(run, (figure,))])
    found = [(one["serial"], one["phase"], one["value"]) for one in compare_machines(index, "E", subject="X1")]
    assert found == [("SN-3", "before", 5.0), ("SN-2", "before", 3.0), ("SN-1", "after", 2.0)]
    before = [(one["serial"], one["value"]) for one in compare_machines(index, "E", subject="X1", phase="before")]
    assert before == [("SN-1", 9.0), ("SN-3", 5.0), ("SN-2", 3.0)]
    assert compare_machines(index, "B", subject="X1") == []
    for figure, subject in (("Q", "X1"), ("rms", "X1"), ("E", "flank"), ("", "X1"), ("e", "X1")):
        with pytest.raises(ConfigError, match="E-INDEX-FIGURE"):
            compare_machines(index, figure, subject=subject)


MONTH_S = 30 * 86_400


def fleet(index: RunIndex, machines: int, runs: int, parameters: str) -> None:
    """``runs`` monthly runs of each machine with its axes' figures; machine 0 was measured last years ago."""
    began = datetime(2016, 1, 1, tzinfo=UTC)
    for run in range(runs):
        rows = []
        for machine in range(int(run > 0), machines):
            utc = (began + timedelta(seconds=run * MONTH_S + machine)).isoformat()
            row = IndexedRun("g", f"r{run}-{machine}", "hall", f"SN-{machine}", utc, "", "", "", "")
            value = float(machine + 1000 * (run == runs - 1 or machine == 0))
            kinds = [(axis, phase, name) for axis in ("X1", "Z1", "C1") for phase in PHASES for name in parameters]
            figures = [IndexedFigure("g", row.run_id, *kind, value, None, "um") for kind in kinds]
            rows.append((row, figures))
        index.put(rows)


PHASES = ("before", "after")


@pytest.mark.parametrize(
    ("machines", "runs", "parameters"),
    [(20, 20, "E"), pytest.param(500, 67, "ERBAM", marks=[pytest.mark.long, pytest.mark.timeout(900)])],
)
def test_the_newest_of_each_machine_is_found_among_any_number_of_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, machines: int, runs: int, parameters: str
) -> None:
    """An answer has a most of rows, which must never be the oldest ones: here each is far below the rows there are."""
    monkeypatch.setattr(database, "MOST_ROWS", machines)
    index = RunIndex(tmp_path)
    index.open()
    fleet(index, machines, runs, parameters)
    began = time.process_time()
    found = compare_machines(index, "E", subject="X1")
    due = index.last_measured()
    used = time.process_time() - began
    assert [(one["serial"], one["value"], one["phase"]) for one in found] == [
        (f"SN-{machine}", 1000.0 + machine, "after") for machine in reversed(range(machines))
    ]
    assert len(due) == 3 * machines
    page = index.trend("E", serial="SN-1", subject="X1", phase="after", most=12)
    assert [one["run_id"] for one in page] == [f"r{run}-1" for run in range(runs - 12, runs)]
    older = index.trend("E", serial="SN-1", subject="X1", phase="after", most=3, before=page[0]["created_utc"])
    assert [one["run_id"] for one in older] == [f"r{run}-1" for run in range(runs - 15, runs - 12)]
    print(f"{machines * runs * len(parameters) * 6} figures: {used:.3f} s of processor")


def test_a_back_up_put_back_is_whole_and_is_found_again(tmp_path: Path) -> None:
    store = Store(tmp_path / "runs")
    for axis in ("X1", "C1"):
        measured(store, axis)
        audit.record(store.root, "note", clock=Moments(), actor="ann", details={"axis": axis})
    catch_up(RunIndex(store.root), store)
    figures = RunIndex(store.root).trend("E")
    backup = tmp_path / "backup"
    shutil.copytree(store.root, backup, ignore=shutil.ignore_patterns("index.db*"))
    shutil.rmtree(store.root)
    shutil.copytree(backup, store.root)
    assert audit.is_sound(store.root)
    assert audit.check_log(store.root).head.seq == 2
    again = Store(store.root)
    assert rebuild(RunIndex(store.root), again) == 2
    assert RunIndex(store.root).trend("E") == figures
    for run in again.runs():
        folder = RunFolder(run.path)
        assert all(folder.envelope(stage) for stage in folder.stages)
        assert list(folder.differences()) == []


def test_a_database_that_is_away_is_an_error_without_its_address(tmp_path: Path) -> None:
    index = RunIndex(tmp_path, f"sqlite:///{tmp_path}/gone/secret-word.db")
    with pytest.raises(StoreError) as caught:
        index.open()
    assert caught.value.code == "E-INDEX"
    assert "secret-word" not in json.dumps(caught.value.as_record())


def test_a_database_whose_library_is_not_installed_is_a_message_without_its_address(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "index.url").write_text("postgresql+psycopg://u:hunter2@127.0.0.1:1/x", encoding="ascii")
    monkeypatch.setitem(sys.modules, "psycopg", None)
    service = SITE.service.model_copy(update={"index_url_file": Path("index.url")})
    with pytest.raises(ConfigError) as caught:
        SiteIndex(SITE.model_copy(update={"service": service}), tmp_path / "site.toml", Store(tmp_path))
    assert caught.value.code == "E-INDEX-EXTRA"
    assert "psycopg" in str(caught.value)
    assert "hunter2" not in str(caught.value)
