"""The self-test on the double: it moves nothing, leaves every value as it was, and says word by word what passed."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import run_virtual
from drivers.sinumerik.legality import Machine as Axes
from drivers.sinumerik.legality import check
from drivers.sinumerik.ncprogram.backup import ReservedPoints
from drivers.sinumerik.ncprogram.selftest import build_self_test_program, read_self_test_report, trial_words
from gateway.config import load_site
from gateway.workflow.programs import programs
from tests.unit.programs import test_left_behind as machines
from tests.unit.programs.sites import CELLS, site_file

SETTING = replace(machines.SETTING, memory=ReservedPoints(4, (4,), machines.NAMES))
FILE = "/_N_SPF_DIR/_N_TFSELF_X1_SPF"


def tried(**changes: Any) -> tuple[list[str], machines.Machine, float, bool]:
    """The report's lines, the machine, how long it took, and whether memory and data are as before."""
    found: list[Any] = []

    async def job() -> None:
        machine = machines.Machine()
        await machine.begin()
        for name, value in changes.items():
            machine.nck.set(name.replace("__", "$"), value, 0)
        before = [machine.nck.static_memory()[key] for key in ("tables", "data")]
        begun = machine.clock.now()
        await machine.run(build_self_test_program("X1", 0, 4711, SETTING))
        machine.found = {name: machine.nck.get(name) for name in machines.READ}
        after = [machine.nck.static_memory()[key] for key in ("tables", "data")]
        lines = machine.nck.files.read(FILE).decode().splitlines()
        found.extend((lines, machine, machine.clock.now() - begun, before == after))
        await machine.nck.stop()

    run_virtual(job)
    return found[0], found[1], found[2], found[3]


def test_every_word_passes_and_nothing_is_left_changed() -> None:
    lines, machine, took_s, same = tried()
    wanted = [f";PASSED {place} {word}" for place, word in enumerate(trial_words("X1", 0, SETTING), start=1)]
    assert re.fullmatch(r";AT \d{4}-\d{1,2}-\d{1,2}", lines.pop(1))
    assert lines == [";TRUEFLANK SELF 4711 X1", *wanted, f";TRUEFLANK END {len(wanted)}", "M17"]
    assert same
    assert took_s < 60.0
    assert machine.stood == [machine.stood[0]]  # one M0, and nothing moved
    assert any("PRODUCT OF TABLE 0" in line for line in lines)
    assert check("\n".join([*lines, ""]), "TFSELF.SPF") == ()


def test_its_report_is_read_for_what_it_says_and_no_more() -> None:
    text = "\n".join(tried()[0])
    report = read_self_test_report(text, "X1")
    assert report is not None
    assert (report.passed, report.failed, report.whole) == (trial_words("X1", 0, SETTING), (), True)
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", report.date)
    assert read_self_test_report(text, "Z1") is None
    assert read_self_test_report("M17\n", "X1") is None
    spoilt = read_self_test_report(text.replace(";PASSED 4 ", ";NOT PASSED 4 "), "X1")
    assert spoilt is not None
    assert spoilt.failed == (trial_words("X1", 0, SETTING)[3],)
    cut = read_self_test_report("\n".join(text.splitlines()[:9]), "X1")
    assert cut is not None
    assert not cut.whole
    lost = read_self_test_report("\n".join(line for line in text.splitlines() if "PASSED 7" not in line), "X1")
    assert lost is not None
    assert not lost.whole


def test_it_is_legal_and_its_head_says_that_nothing_moves() -> None:
    text = build_self_test_program("X1", 0, 4711, SETTING)
    assert check(text, "TFSELF_X1.MPF", Axes(frozenset(machines.NAMES))) == ()
    assert "SUPA" not in text
    assert "Moves: nothing." in text


def test_where_files_stay_too_short_its_end_says_so() -> None:
    lines, machine, _, same = tried(__MN_LEN_PROTOCOL_FILE=1)
    assert (machine.found["R[90]"], machine.found["R[88]"]) == (11.0, 10.0)
    assert "M17" not in lines
    assert same


@pytest.mark.parametrize("cell", CELLS)
def test_it_is_among_the_programs_of_every_site(tmp_path: Path, cell: str) -> None:
    path = site_file(tmp_path, cell, plan=False)
    made = programs(load_site(path), path, ("self-test",))
    assert [one.program.path for one in made] == [f"/_N_MPF_DIR/_N_TFSELF_{axis}_MPF" for axis in ("X1", "Z1", "C1")]
