"""What `doctor` says of the self-test that this store keeps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from drivers.checks import fine
from gateway.cli.control.connecting import kept_tests
from gateway.config import load_site
from gateway.store import SelfTestBook
from gateway.workflow.bench import store_of
from simulators.cellfile import load_cell
from tests.selftested import machine_of, passed
from tests.unit.programs.sites import site_file


def test_passed_missed_outdated_and_never_made_are_four_lines(tmp_path: Path) -> None:
    path = site_file(tmp_path, "demo")
    site, machine = load_site(path), machine_of(load_cell("demo"))
    book = SelfTestBook(store_of(site, path).root)
    seen = (fine("W-DOC-SERIAL", "serial number", serial=machine.serial, version=machine.version),)
    never = kept_tests(site, path, seen)
    assert [(line.code, line.outcome) for line in never] == [("W-DOC-UNTESTED", "unknown")] * len(site.axes)
    book.save(passed(machine, "X1"))
    book.save(replace(passed(machine, "Z1"), failed=("READ",)))
    book.save(passed(replace(machine, version="V4.7"), "C1"))
    lines = kept_tests(site, path, seen)
    assert [line.code for line in lines] == ["W-DOC-TESTED", "E-DOC-TESTED", "E-DOC-TESTED-OTHER"]
    assert "2026-11-20" in lines[0].what
    assert "READ" in lines[1].what
    assert "V4.7" in lines[2].what
    assert all(line.fix for line in lines[1:])


def test_the_mailbox_runs_none_so_none_is_asked_for(tmp_path: Path) -> None:
    path = site_file(tmp_path, "demo")
    site = load_site(path)
    mailbox = site.model_copy(update={"controller": site.controller.model_copy(update={"driver": "sinumerik-modbus"})})
    assert kept_tests(mailbox, path, ()) == ()
