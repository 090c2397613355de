"""Every file of a run folder stands in its seal: what is changed, missing or added is told."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import pytest
from typer.testing import CliRunner

from gateway import audit
from gateway.approve import Approvals, give_consent
from gateway.audit import integrity
from gateway.cli import app
from gateway.store import RunFolder, Store
from tests.unit.approve.test_approve import CHANGE, MACHINE, NOW
from tests.unit.audit.log import Moments


@dataclass(frozen=True, slots=True)
class Done:
    """A record of a stage."""

    what: str


@pytest.fixture
def run(tmp_path: Path) -> RunFolder:
    """A run with a stage stored twice, a text, a picture, a trace and an approval."""
    folder = Store(tmp_path).create("mill")
    folder.put("done", Done("first"))
    folder.put("done", Done("second"))
    folder.write_text("site.toml", "here")
    (folder.path / "traces").mkdir()
    (folder.path / "traces" / "laser.trace").write_bytes(b"wire")
    (folder.path / "before-after.png").write_bytes(b"picture")
    folder.adopt(folder.path / "traces" / "laser.trace", folder.path / "before-after.png", folder.path / "none.png")
    made = give_consent(CHANGE, MACHINE, actor="ann", typed_name="mill", site_name="mill", now_utc=NOW)
    Approvals(folder.path).keep(made)
    told = {"approval": Approvals.digest(made)}
    audit.record(tmp_path, audit.APPROVED, clock=Moments(), actor="ann", serial="SN-1", details=told)
    folder.set_anchor(audit.current_head(tmp_path))
    return folder


NAMES = ("done.json", "done.2.json", "site.toml", "traces/laser.trace", "before-after.png")


def test_a_run_as_it_was_kept(run: RunFolder) -> None:
    kept = integrity.check_store(run.path.parent)
    assert (kept.runs, kept.problems) == (1, ())
    assert [str(head) for head in kept.heads] == [run.anchor]
    assert sum(path.is_file() for path in run.path.rglob("*")) == len(NAMES) + 2, "and run.json and an approval"


@pytest.mark.parametrize("name", NAMES)
def test_every_changed_and_every_missing_file_is_told(run: RunFolder, name: str) -> None:
    path = run.path / name
    path.write_bytes(path.read_bytes() + b" ")
    (told,) = integrity.check_store(run.path.parent).problems
    assert name in told
    assert "changed" in told
    path.unlink()
    (told,) = integrity.check_store(run.path.parent).problems
    assert name in told
    assert "missing" in told


@pytest.mark.parametrize("name", ["new.json", "traces/other.trace"])
def test_a_file_that_is_not_the_runs_is_told(run: RunFolder, name: str) -> None:
    (run.path / name).write_bytes(b"x")
    (told,) = integrity.check_store(run.path.parent).problems
    assert name in told


def test_an_approval_that_nobody_gave_is_told(run: RunFolder) -> None:
    Approvals(run.path).keep(give_consent(CHANGE, MACHINE, actor="eve", typed_name="m", site_name="m", now_utc=NOW))
    (told,) = integrity.check_store(run.path.parent).problems
    assert "approval" in told


def test_the_command_says_it_and_ends_with_11(run: RunFolder) -> None:
    store = str(run.path.parent)
    assert CliRunner().invoke(app, ["audit", "verify", store]).exit_code == 0
    (run.path / "site.toml").write_text("there")
    found = CliRunner().invoke(app, ["audit", "verify", store, "--json"])
    assert found.exit_code == 11
    assert "site.toml" in json.loads(found.output)["wrong"][0]
    run.write_text("site.toml", "there")
    for path in (run.path.parent / audit.AUDIT).iterdir():
        path.unlink()
    assert "E-AUDIT-BROKEN" in str(CliRunner().invoke(app, ["audit", "verify", store]).exception)
