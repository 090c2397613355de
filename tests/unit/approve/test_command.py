"""`approve` asks for the machine's name, approves what was shown, and leaves its record."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from drivers.errors import ConfigError
from gateway import audit
from gateway.approve import Approvals
from gateway.cli import app
from gateway.domain.proposals import Proposal
from gateway.errors import WriteRefused
from gateway.store import RunFolder, Store
from gateway.workflow.control import push
from gateway.workflow.run import stages
from gateway.workflow.run.outcome import Outcome
from tests.unit.approve.test_approve import CHANGE, MACHINE
from tests.unit.approve.test_consents import SKIPPED

SITE = """
[site]
name = "mill"
store = "runs"
[controller]
url = "opc.tcp://127.0.0.1:1"
serial = "SN-1"
[[axes]]
name = "X1"
letter = "X"
kind = "linear"
travel = [0.0, 100.0]
[axes.measure]
component = "EXX"
feed = 1000.0
stable = 1.0
file = "x.csv"
file_datum = 0.0
[axes.table]
minimum = 0.0
maximum = 100.0
step = 50.0
"""


@pytest.fixture
def stored(tmp_path: Path) -> RunFolder:
    """A run with a proposal."""
    site = tmp_path / "site.toml"
    site.write_text(SITE)
    folder = Store(tmp_path / "runs").create("mill", {"site_file": str(site)})
    folder.put(stages.PROPOSAL, Proposal(MACHINE, (CHANGE, SKIPPED), (), "2026-11-21T10:00:00+00:00"))
    return folder


@pytest.fixture
def run(stored: RunFolder, monkeypatch: pytest.MonkeyPatch) -> RunFolder:
    """The same; what `push` would show of it is not asked of a machine here."""

    async def shown(*_: object, **__: object) -> Outcome:
        return Outcome("proposed", str(stored.path), (), ("X1: what push shows",), {"refusals": {}})

    monkeypatch.setattr(push, "push_run", shown)
    return stored


def approve(run: RunFolder, typed: str, *words: str) -> Any:
    return CliRunner().invoke(app, ["approve", str(run.path), *words], input=f"{typed}\n")


def test_shown_then_approved_by_the_machines_name(run: RunFolder) -> None:
    result = approve(run, "mill")
    assert result.exit_code == 0, result.output
    assert "X1: what push shows" in result.output
    assert f"approved by {audit.os_user()} until " in result.output
    (kept,) = Approvals(run.path).read_unused()
    assert kept.actor == audit.os_user()
    (entry,) = audit.read_entries(run.path.parent)
    assert (entry["action"], entry["role"], entry["plan_hash"]) == ("approve", "approver", kept.plan_hash)
    again = approve(run, "mill", "--json").exception
    assert isinstance(again, WriteRefused)
    assert again.code == "E-APPROVE-TWICE"


def test_as_json(run: RunFolder) -> None:
    result = approve(run, "mill", "--axis", "X1", "--json")
    assert result.exit_code == 0
    data = json.loads(result.output[result.output.index("{") :])
    assert data["approved"][0]["actor"] == audit.os_user()


@pytest.mark.parametrize(
    ("typed", "words", "error", "code"),
    [
        ("", (), WriteRefused, "E-APPROVE-NAME"),
        ("grinder", (), WriteRefused, "E-APPROVE-NAME"),
        ("mill", ("--axis", "C1"), WriteRefused, "E-APPROVE-NOTHING"),
        ("mill", ("--axis", "Q9"), ConfigError, "E-RUN-AXIS"),
    ],
)
def test_refused_leaves_nothing(run: RunFolder, typed: str, words: tuple[str, ...], error: type, code: str) -> None:
    found = approve(run, typed, *words).exception
    assert isinstance(found, error)
    assert getattr(found, "code", "") == code
    assert Approvals(run.path).read_unused() == ()
    assert list(audit.read_entries(run.path.parent)) == []


@pytest.mark.parametrize(
    ("words", "code"),
    [((), "E-SUP-OPEN"), (("--offline",), "E-OFF-ROAD"), (("--offline", "--apply", "--machine", "mill"), "E-OFF-ROAD")],
)
def test_a_look_that_fails_and_a_way_that_is_refused_leave_the_run_as_it_was(
    stored: RunFolder, words: tuple[str, ...], code: str
) -> None:
    cross = replace(CHANGE, new=replace(CHANGE.new, kind="cross", output_axis="X1"))
    stored.put(stages.PROPOSAL, Proposal(MACHINE, (cross,), (), "2026-11-21T10:00:00+00:00"))
    stored.set_state("better")
    site = stored.path.parents[1] / "site.toml"
    site.write_text(
        SITE.replace('url = "opc.tcp://127.0.0.1:1"', 'driver = "sinumerik-modbus"\nurl = "tcp://127.0.0.1:1"')
    )
    before = {path: path.read_bytes() for path in stored.path.rglob("*") if path.is_file()}
    found = CliRunner().invoke(app, ["push", str(stored.path), *words]).exception
    assert getattr(found, "code", found) == code
    assert {path: path.read_bytes() for path in stored.path.rglob("*") if path.is_file()} == before
    assert (stored.state, stored.errors) == ("better", ())
