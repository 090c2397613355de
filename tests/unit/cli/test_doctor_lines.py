"""What `doctor` says of the self-test that this store keeps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from drivers.checks import CheckLine, fine, unknown, wrong
from drivers.errors import ConfigError, catalogue
from gateway.acceptance.control import stored_self_tests
from gateway.cli import app
from gateway.cli.next_steps import (
    NEXT_COMMANDS,
    STATE_BY_REFUSAL,
    after_doctor,
    after_preview,
    after_push_preview,
    after_recovery,
    after_run,
    next_command,
    push_options,
)
from gateway.cli.output import count_words, fold_text
from gateway.config import load_site
from gateway.store.machine_books import SelfTestBook
from gateway.workflow.run.folder import store_of
from simulators.cellfile import load_cell
from tests.selftested import machine_of, passed
from tests.unit.programs.sites import site_file


def test_passed_missed_outdated_and_never_made_are_four_lines(tmp_path: Path) -> None:
    path = site_file(tmp_path, "demo")
    site, machine = load_site(path), machine_of(load_cell("demo"))
    book = SelfTestBook(store_of(site, path).root)
    seen = (fine("W-DOC-SERIAL", "serial number", serial=machine.serial, version=machine.version),)
    never = stored_self_tests(site, path, seen)
    assert [(line.code, line.outcome) for line in never] == [("W-DOC-UNTESTED", "unknown")] * len(site.axes)
    book.save(passed(machine, "X1"))
    book.save(replace(passed(machine, "Z1"), failed=("READ",)))
    book.save(passed(replace(machine, version="V4.7"), "C1"))
    lines = stored_self_tests(site, path, seen)
    assert [line.code for line in lines] == ["W-DOC-TESTED", "E-DOC-TESTED", "E-DOC-TESTED-OTHER"]
    assert "2026-11-20" in lines[0].what
    assert "READ" in lines[1].what
    assert "V4.7" in lines[2].what
    assert all(line.fix for line in lines[1:])


def test_the_mailbox_runs_none_so_none_is_asked_for(tmp_path: Path) -> None:
    path = site_file(tmp_path, "demo")
    site = load_site(path)
    mailbox = site.model_copy(update={"controller": site.controller.model_copy(update={"driver": "sinumerik-modbus"})})
    assert stored_self_tests(mailbox, path, ()) == ()


FINE, BAD = fine("W-DOC-SERIAL", "serial number"), wrong("E-DOC-SERIAL", "serial number")
UNTESTED, CLOSED = unknown("W-DOC-UNTESTED", "self-test kept"), unknown("W-DOC-UNITS-UNKNOWN", "units")


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ((FINE, BAD, UNTESTED), "next: correct what is wrong above, then trueflank doctor site.toml"),
        ((FINE, CLOSED, UNTESTED), "next: trueflank doctor self-test site.toml"),
        ((FINE, CLOSED), "next: check what it could not tell, then trueflank run site.toml"),
        ((FINE,), "next: trueflank run site.toml"),
    ],
)
def test_the_last_line_names_a_fault_only_where_one_was_found(
    lines: tuple[CheckLine, ...], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    after_doctor(lines, "site.toml")
    assert capsys.readouterr().out == f"{told}\n"


@pytest.mark.parametrize("width", [80, 100])
def test_a_line_breaks_between_words_and_stays_under_its_sentence(width: int) -> None:
    said = "could not tell self-test kept: " + "the well-known sentence of some words " * 6 + "x" * 120
    *short, path = (lines := fold_text(said.strip(), width, 15).split("\n"))
    assert all(len(line) <= width for line in short)
    assert all(line[:15].isspace() != (line is lines[0]) for line in lines)
    assert path.strip() == "x" * 120
    assert " ".join(line.strip() for line in lines) == said


def test_one_is_not_told_as_many() -> None:
    assert [count_words(number, "axis", "axes") for number in (0, 1, 2)] == ["0 axes", "1 axis", "2 axes"]


def test_what_a_look_offers_is_the_same_table_and_no_other() -> None:
    """`disable --axis X1 --table cec3` offered to switch off the axis' own table."""
    assert after_preview("disable", "s.toml", "X1", "hall-3", table="cec3") == (
        "disable s.toml --axis X1 --table cec3 --apply --machine hall-3"
    )


@pytest.mark.parametrize(("code", "leads"), [("E-INT-UNFINISHED", "recover s.toml"), ("E-INT-RESET", "doctor s.toml")])
def test_a_look_that_something_speaks_against_leads_to_what_removes_it(code: str, leads: str) -> None:
    """A rollback's look named an unfinished push, and offered the rollback that this one would refuse."""
    assert after_preview("rollback", "s.toml", "X1", "hall-3", refused_by=(code,), site=Path("s.toml")) == leads


def test_the_next_command_is_the_look_and_then_the_push_over_the_road_of_the_site() -> None:
    """Nothing is left for the person to fill in, and what a control without a wire needs stands there."""
    wired, carried = push_options("sinumerik-opcua", "M"), push_options("sinumerik-offline", "M")
    assert after_run("proposed", "R", "S") == "push R"
    assert after_push_preview((), "R", "S", wired) == "push R --apply --machine M"
    assert after_push_preview((), "R", "S", carried) == "push R --offline --apply --machine M"
    assert after_run("worse", "R", "S", worse=["C1"]) == "rollback S --axis C1"
    assert after_run("worse", "R", "S", worse=["X1", "C1"]) == "rollback S"
    assert after_run("unchanged", "R", "S") == "tables verify S"
    assert after_run("no such state", "runs/R", "S") == "runs show R --store runs"
    assert after_run("failed", "runs/R", "S") == "runs logs --run R --store runs"


@pytest.mark.parametrize("code", sorted(one for one in catalogue() if one.startswith(("E-INT-", "W-INT-"))))
def test_a_look_never_names_itself_whatever_is_against_the_push(code: str) -> None:
    told = after_push_preview((code,), "R", "S", push_options("sinumerik-opcua", "M"))
    assert told != "push R"
    assert told.split()[0] in ("recover", "run", "approve", "doctor")


def test_every_refusal_that_leads_somewhere_is_one_of_the_catalogue() -> None:
    assert {code for codes in STATE_BY_REFUSAL.values() for code in codes} <= set(catalogue())


@pytest.mark.parametrize("state", NEXT_COMMANDS)
def test_every_state_has_a_command_and_no_gap_is_left_in_it(state: str) -> None:
    whole = {"run": "runs/R", "site": "S", "options": "--apply", "axis": "X1", "machine": "M", "folder": "F"}
    assert "{" not in next_command(state, **whole)
    assert next_command(state, run="runs/R") in (
        "push runs/R",
        "approve runs/R",
        "runs logs --run R --store runs",
        "runs show R --store runs",
    )


def test_what_could_not_be_read_is_looked_at_again_and_not_carried_out() -> None:
    """Nothing was offered, and `--apply` was the next step all the same: it was refused."""
    unread, offered, stands = (
        SimpleNamespace(action=action, stands=stands)
        for action, stands in (("none", False), ("restore", False), ("end", True))
    )
    assert after_recovery((unread,), "S", "M", apply=False) == "recover S"
    assert after_recovery((unread, offered), "S", "M", apply=False) == "recover S --apply --machine M"
    assert after_recovery((offered,), "S", "M", apply=True) == "tables verify S"
    assert after_recovery((stands,), "S", "M", apply=True) == "recover S --apply --machine M"
    assert after_recovery((), "S", "M", apply=False) == "tables verify S"


@pytest.mark.parametrize(("level", "code"), [("write", "E-DOC-WRITE"), ("all", "E-ACCEPT-LEVEL")])
def test_the_doctor_tries_no_table_and_knows_no_other_level(tmp_path: Path, level: str, code: str) -> None:
    """A table is written with consent and a sheet alone: before the control is asked anything."""
    site = site_file(tmp_path, "demo")
    refused = CliRunner().invoke(app, ["doctor", str(site), "--level", level]).exception
    assert isinstance(refused, ConfigError)
    assert (refused.code, refused.exit_code) == (code, 2)
    assert ("doctor accept" in refused.hint) == (level == "write")


def test_a_site_of_files_only_has_nothing_to_start(tmp_path: Path) -> None:
    site = tmp_path / "site.toml"
    site.write_bytes((Path(__file__).parents[3] / "examples" / "sites" / "files-only.toml").read_bytes())
    assert CliRunner().invoke(app, ["doctor", str(site)]).exit_code == 0
    refused = CliRunner().invoke(app, ["doctor", str(site), "--level", "program"]).exception
    assert isinstance(refused, ConfigError)
    assert refused.code == "E-FILES-ONLY"
