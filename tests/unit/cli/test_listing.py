"""`runs` lists a store and shows one run, by its id, a beginning of it, or as the latest."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.errors import TrueflankError
from drivers.types.sensing import Ambient
from gateway import audit
from gateway.cli import app
from gateway.cli.options import open_run
from gateway.domain.outcomes import PushRecord
from gateway.errors import StoreError, UnknownRun
from gateway.store import Store
from gateway.store.runs import Needs
from gateway.workflow.results.report import material_of
from tests.unit.programs.sites import site_file

RUNNER = CliRunner()


def a_store(root: Path) -> list[str]:
    """Two runs, a day apart; the later one ended with an error."""
    days = iter((1, 2))
    store = Store(root, lambda: datetime(2026, 3, next(days), tzinfo=UTC))
    first, second = store.create("hall-3"), store.create("hall-3")
    second.set_state("failed", error={"code": "E-CAP-BEAM", "what": "the beam was lost"})
    return [first.run_id, second.run_id]


def test_all_runs_of_a_store(tmp_path: Path) -> None:
    ids = a_store(tmp_path)
    told = RUNNER.invoke(app, ["runs", "list", "--store", str(tmp_path), "--json"])
    assert [one["run_id"] for one in json.loads(told.stdout)] == ids
    plain = RUNNER.invoke(app, ["runs", "list", "--store", str(tmp_path)])
    assert all(run in plain.stdout for run in ids)


def test_no_run_is_said(tmp_path: Path) -> None:
    assert "no run in" in RUNNER.invoke(app, ["runs", "list", "--store", str(tmp_path / "none")]).stdout


def test_one_run_by_any_of_its_names(tmp_path: Path) -> None:
    first, second = a_store(tmp_path)
    for name, wanted in ((first, first), (first[:8], first), ("latest", second), (second[:8], second)):
        told = RUNNER.invoke(app, ["runs", "show", name, "--store", str(tmp_path)])
        assert told.exit_code == 0
        assert wanted in told.stdout
    shown = RUNNER.invoke(app, ["runs", "latest", "--store", str(tmp_path)]).stdout
    assert "E-CAP-BEAM: the beam was lost" in shown


def test_a_self_test_between_run_and_push_is_not_the_latest_run(tmp_path: Path) -> None:
    """`push latest` said "self-test first", and after it found nothing to push in the self-test's own run."""
    _, second = a_store(tmp_path)
    store = Store(tmp_path, lambda: datetime(2026, 3, 3, tzinfo=UTC))
    tested = store.create("hall-3", {"measures": False})
    assert store.open("latest").run_id == second
    assert store.open(tested.run_id).run_id == tested.run_id
    alone = Store(tmp_path / "alone", lambda: datetime(2026, 3, 3, tzinfo=UTC))
    only = alone.create("hall-3", {"measures": False})
    assert alone.open("latest").run_id == only.run_id


def test_latest_is_the_newest_run_with_what_the_command_needs_and_is_named(tmp_path: Path) -> None:
    """After `guard`, `push latest` ended in a missing stage (exit 11); now the proposal before it is meant."""
    first, second = a_store(tmp_path)
    store = Store(tmp_path, lambda: datetime(2026, 3, 4, tzinfo=UTC))
    store.open(first).put("proposal", PushRecord(1, "X1", "committed", (), ""))
    guard = store.create("hall-3")
    guard.put("capture-C1-after", PushRecord(1, "C1", "committed", (), ""))
    proposal = Needs("W-NEEDS-PROPOSAL", ("proposal",))
    assert store.open("latest").run_id == guard.run_id
    assert store.open("latest", proposal).run_id == first
    told = RUNNER.invoke(app, ["push", "latest", "--store", str(tmp_path)])
    assert f"latest is {first} (the newest run with a proposal of tables)" in told.stderr
    for run in (second, guard.run_id):
        lacks = RUNNER.invoke(app, ["push", run, "--store", str(tmp_path)])
        assert isinstance(lacks.exception, UnknownRun)
        assert (lacks.exception.code, lacks.exception.exit_code) == ("E-STORE-NEEDS", 2)
        assert f"name {first}, the newest run that has it" in lacks.exception.hint


@pytest.mark.parametrize("empty", [True, False], ids=["no run", "a self-test alone"])
@pytest.mark.parametrize(
    ("needs", "made"), [("proposal", "run SITE"), ("errors", "measure SITE"), ("part", "inspect SITE --file FILE")]
)
def test_where_no_run_has_it_the_command_that_makes_it_is_named(
    tmp_path: Path, needs: str, made: str, *, empty: bool
) -> None:
    """Another run was advised where there is none."""
    if not empty:
        Store(tmp_path, lambda: datetime(2026, 3, 3, tzinfo=UTC)).create("hall-3", {"measures": False})
    with pytest.raises(UnknownRun) as told:
        open_run(Store(tmp_path), "latest", needs)
    assert told.value.code == ("E-STORE-EMPTY" if empty else "E-STORE-NEEDS")
    assert told.value.hint.endswith(told.value.fields["step"])
    assert f"make one: `trueflank {made}`" in told.value.hint


@pytest.mark.parametrize(
    "words",
    [("push", "nonsense"), ("report", "nonsense"), ("runs", "show", "nonsense"), ("runs", "logs", "--run", "nonsense")],
)
@pytest.mark.parametrize("empty", [True, False])
def test_an_unknown_run_is_a_wrong_option(tmp_path: Path, words: tuple[str, ...], *, empty: bool) -> None:
    if not empty:
        a_store(tmp_path)
    told = RUNNER.invoke(app, [*words, "--store", str(tmp_path)])
    assert isinstance(told.exception, UnknownRun)
    assert told.exception.exit_code == 2


@pytest.mark.parametrize("own", [True, False], ids=["runs beside the caller", "nothing beside the caller"])
def test_the_store_is_that_of_the_site_file_that_was_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, own: bool
) -> None:
    """`check programs --run` looked in ./runs whatever the site said."""
    here, there = tmp_path / "here", tmp_path / "there"
    (here / "runs" if own else here).mkdir(parents=True)
    there.mkdir()
    site = site_file(there, "demo")
    store = Store(there / "runs", lambda: datetime(2026, 3, 4, tzinfo=UTC))
    made = store.create("hall-3")
    monkeypatch.chdir(here)
    told = RUNNER.invoke(
        app, ["check", "programs", str(site), "-o", str(here / "out"), "--what", "load", "--run", made.run_id]
    )
    assert told.exception.code == "E-STORE-NEEDS"
    assert str(made.path) in told.exception.where
    typed = RUNNER.invoke(
        app,
        [
            "check",
            "programs",
            str(site),
            "-o",
            "out",
            "--what",
            "load",
            "--run",
            made.run_id,
            "--store",
            str(here / "else"),
        ],
    )
    assert typed.exception.code == "E-STORE-EMPTY"


def test_a_report_of_the_latest_run_of_an_empty_store_is_refused(tmp_path: Path) -> None:
    told = RUNNER.invoke(app, ["runs", "show", "latest", "--store", str(tmp_path)])
    assert "E-STORE-EMPTY" in str(told.exception)


def test_a_reason_of_the_operating_system_is_said_without_its_number(tmp_path: Path) -> None:
    told = RUNNER.invoke(app, ["tables", "lint", str(tmp_path / "none.ini")])
    assert str(told.exception).startswith(
        f"E-CLI-READ [{tmp_path / 'none.ini'}]: the file cannot be read: No such file"
    )
    assert TrueflankError("E", why="[WinError 2] not there: 'C:\\x'").fields["why"] == "not there"
    assert TrueflankError("E", why="[Errno 111] Connect call failed ('127.0.0.1', 9)").fields["why"].endswith("9)")


def test_the_store_of_the_one_site_file_here_is_meant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cell").mkdir()
    (tmp_path / "cell" / "site.toml").write_text('[site]\nname = "hall-3"\nstore = "kept"\n')
    (tmp_path / "cell" / "gear.toml").write_text("[gear]\n")
    _, second = a_store(tmp_path / "cell" / "kept")
    monkeypatch.chdir(tmp_path)
    assert second in RUNNER.invoke(app, ["runs", "latest"]).stdout
    (tmp_path / "other.toml").write_text('[site]\nname = "hall-4"\nstore = "others"\n')
    assert "no run in runs" in RUNNER.invoke(app, ["runs", "list"]).stdout  # though only the first has runs yet
    a_store(tmp_path / "others")
    assert "no run in runs" in RUNNER.invoke(app, ["runs", "list"]).stdout
    third = a_store(tmp_path / "runs")[1]
    assert third in RUNNER.invoke(app, ["runs", "latest"]).stdout


def test_what_ended_a_run_stands_in_its_report(tmp_path: Path) -> None:
    run = Store(tmp_path).create("hall-3", {"site_file": str(site_file(tmp_path, "demo", plan=False))})
    run.set_state("failed", error={"code": "E-CAP-BEAM", "what": "the beam was lost"})
    assert material_of(run).findings == ("the beam was lost",)


def test_a_run_is_removed_unless_a_push_rests_on_it(tmp_path: Path) -> None:
    store = Store(tmp_path)
    gone, kept = store.create("one"), store.create("two")
    kept.put("push-X1", Ambient(1.0))
    assert CliRunner().invoke(app, ["runs", "rm", gone.run_id, "--store", str(tmp_path)], input="n\n").exit_code == 1
    assert gone.path.exists()
    done = CliRunner().invoke(app, ["runs", "rm", gone.run_id, "--yes", "--store", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert not gone.path.exists()
    told = CliRunner().invoke(app, ["runs", "rm", kept.run_id, "--yes", "--store", str(tmp_path)])
    assert isinstance(told.exception, StoreError)
    assert told.exception.code == "E-STORE-RESTS"
    assert kept.path.exists()
    assert any(entry["action"] == "remove-run" for entry in audit.read_entries(tmp_path))


@pytest.mark.parametrize("command", ["rollback", "tables verify", "doctor self-test", "disable", "run"])
def test_an_unknown_letter_is_a_wrong_option_before_any_device_is_asked(tmp_path: Path, command: str) -> None:
    """The control of this site does not answer: that is not what is wrong."""
    site = site_file(tmp_path, "demo", plan=False)
    told = RUNNER.invoke(app, [*command.split(), str(site), "--axis", "Q9"])
    assert told.exception.code == "E-RUN-AXIS"
    assert told.exception.exit_code == 2


def test_a_look_at_a_part_for_a_run_that_is_not_there_is_refused(tmp_path: Path) -> None:
    site = site_file(tmp_path, "demo", plan=True)
    told = RUNNER.invoke(app, ["grind", str(site), "--run", "nonsense"])
    assert told.exception.code in ("E-STORE-RUN", "E-STORE-EMPTY")
    run, _ = a_store(tmp_path / "runs")
    told = RUNNER.invoke(app, ["grind", str(site), "--run", run])
    assert f"--part part --run {run} --machine" in " ".join(told.stdout.split())


def test_of_a_run_that_has_nothing_the_log_is_next(tmp_path: Path) -> None:
    run = Store(tmp_path).create("hall-3")
    run.set_state("failed")
    assert (
        f"next: trueflank runs logs --run {run.run_id}"
        in RUNNER.invoke(app, ["runs", "show", "latest", "--store", str(tmp_path)]).stdout
    )
