"""The audit commands: what they print, what they exit with, and that only `correct` adds to the log."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from drivers.errors import ConfigError
from gateway import audit
from gateway.audit.chain import AUDIT, audit_files
from gateway.cli import app
from gateway.errors import CorruptRecord
from tests.unit.audit.log import Moments


def run(*words: object) -> Any:
    return CliRunner().invoke(app, ["audit", *map(str, words)])


@pytest.fixture
def store(tmp_path: Path) -> Path:
    clock = Moments()
    for number in (1, 2, 3):
        audit.record(tmp_path, "approve", clock=clock, actor="ann", transaction=number, details={"axis": "C1"})
    return tmp_path


def test_a_whole_log_is_verified_against_an_exported_head(store: Path) -> None:
    head = run("head", store).stdout.strip()
    assert head == str(audit.check_log(store).head)
    result = run("verify", store, "--head", head)
    assert result.exit_code == 0
    assert "3 records in 1 file are intact" in result.stdout
    assert "give --head" in run("verify", store).stdout
    assert json.loads(run("verify", store, "--json").stdout)["sound"] is True


def test_a_broken_log_ends_with_its_exit_code(store: Path) -> None:
    path = audit_files(store / AUDIT)[0]
    path.write_bytes(path.read_bytes().replace(b'"actor":"ann"', b'"actor":"bob"', 1))
    for words in (("verify", store), ("head", store)):
        failed = run(*words).exception
        assert isinstance(failed, CorruptRecord)
        assert failed.exit_code == 11
    result = run("verify", store, "--json")
    assert result.exit_code == 11
    assert "record 1" in json.loads(result.stdout)["problem"]
    shown = run("show", store)
    assert shown.exit_code == 0
    assert "DAMAGED" in shown.stdout


def test_records_are_shown_and_corrected(store: Path) -> None:
    assert run("correct", store, 2, "wrong axis named").exit_code == 0
    lines = run("show", store, "--last", 2).stdout.splitlines()
    assert len(lines) == 2
    assert "axis=C1" in lines[0]
    assert "corrects=2  why=wrong axis named" in lines[1]
    assert [entry["seq"] for entry in json.loads(run("show", store, "--json").stdout)] == [1, 2, 3, 4]
    assert isinstance(run("correct", store, 9, "no such").exception, ConfigError)
    assert audit.check_log(store).head.seq == 4


def test_no_store_no_log(tmp_path: Path) -> None:
    assert isinstance(run("verify", tmp_path / "nowhere").exception, ConfigError)
    assert run("verify", tmp_path).exit_code == 0
