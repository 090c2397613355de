"""The acceptance of a cell in one process: each check sees what the cell has, and fails where something is wrong."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from drivers.checks import fine, skipped, wrong
from drivers.clock import LoopClock, run_virtual
from drivers.errors import ConfigError
from drivers.probes import Level
from gateway.acceptance.checks import CHECKS, CheckResult, SiteDesk, cases, examine_site, run_check
from gateway.acceptance.sheet import Occasion, check_sheet, sheet, write_sheet
from gateway.config import load_site
from gateway.report.document.web import page
from gateway.report.document.words import catalogue_of
from gateway.say import silence
from simulators.cell import Cell, cell_running
from tests.selftested import keep

DAY = datetime(2026, 3, 2, 8, 30, tzinfo=UTC)


def accepted(
    folder: Path,
    names: tuple[str, ...],
    level: Level = "read",
    *,
    tested: bool = True,
    change: Any = None,
    road: str = "opcua",
) -> dict[str, CheckResult]:
    """Results of these checks by their names, on the smallest cell."""

    async def main() -> dict[str, CheckResult]:
        clock = LoopClock()
        async with cell_running("zero", folder, clock, wires="memory", road=road) as cell:
            if tested:
                keep(cell.site_path, cell.file)
            if change is not None:
                change(cell)
            site = load_site(cell.site_path)
            desk = SiteDesk(site, cell.site_path, clock, silence)
            wanted = [one for one in cases(site) if one[0].name in names]
            found = [await run_check(check, axis, desk, level) for check, axis in wanted]
            return {one.name: one for one in found}

    return run_virtual(main)


def test_what_can_be_read_is_accepted_and_what_lies_above_is_said(tmp_path: Path) -> None:
    found = accepted(tmp_path, ("connection", "motion", "table"))
    above = {name: one for name, one in found.items() if name != "connection"}
    assert {one.outcome for one in above.values()} == {"skipped"}
    assert found["motion X1"].said == "needs --level motion; this examination has read"
    seen = {line.code: line.outcome for line in found["connection"].lines}
    assert {seen[code] for code in ("W-DOC-SERIAL", "W-DOC-MEMORY", "W-DOC-RIGHTS", "W-DOC-TESTED")} == {"ok"}
    assert "wrong" not in seen.values()
    assert "V4.94" in found["connection"].said


def test_a_mailbox_is_accepted_too_and_what_it_does_not_have_is_skipped(tmp_path: Path) -> None:
    found = accepted(tmp_path, ("connection", "rights", "axis", "self-test"), "program", road="modbus")
    assert {name for name, one in found.items() if one.outcome == "wrong"} == set()
    assert found["rights"].outcome == "skipped"
    assert found["axis X1"].outcome == "ok"
    assert [line.code for line in found["self-test X1"].lines] == ["W-DOC-TEST-NOT-NEEDED"]


def test_what_is_wrong_fails_with_the_next_step(tmp_path: Path) -> None:
    def change(cell: Cell) -> None:
        cell.nck.lose_reference("X1")

    found = accepted(tmp_path, ("axis",), "program", change=change)
    assert found["axis X1"].outcome == "wrong"
    assert found["axis X1"].said == "axis X1 is not referenced -> reference it"
    assert found["axis C1"].outcome == "ok"


def test_a_control_that_was_never_tested_is_tested_at_the_level_of_programs(tmp_path: Path) -> None:
    """Reading says that no test is kept; a level higher the operator starts it, and it is kept."""

    async def main() -> tuple[CheckResult, CheckResult, CheckResult]:
        clock = LoopClock()
        async with cell_running("zero", tmp_path, clock, wires="memory") as cell:
            site = load_site(cell.site_path)
            desk = SiteDesk(site, cell.site_path, clock, silence)
            road, tested = (one for one in CHECKS if one.name in ("connection", "self-test"))
            before = await run_check(road, "", desk, "read")
            higher = await run_check(road, "", desk, "program")
            assert {one.code for one in before.lines} - {one.code for one in higher.lines} == {
                *("W-DOC-UNTESTED", "W-DOC-NO-SELF-TEST"),
            }, "what the next check finds out is not said to be unknown"
            made = await run_check(tested, "X1", desk, "program")
            return before, made, await run_check(road, "", desk, "read")

    before, made, after = run_virtual(main)
    kept = [
        {line.fields["axis"]: line.outcome for line in one.lines if line.check == "self-test kept"}["X1"]
        for one in (before, made, after)
    ]
    assert kept == ["unknown", "ok", "ok"]


def test_the_doctor_and_an_acceptance_are_one_examination(tmp_path: Path) -> None:
    """The acceptance has the doctor's results and, as skipped, what lies above them."""

    async def main() -> tuple[Any, Any]:
        clock = LoopClock()
        async with cell_running("zero", tmp_path, clock, wires="memory") as cell:
            desk = SiteDesk(load_site(cell.site_path), cell.site_path, clock, silence)
            told: list[CheckResult] = []
            doctor = await examine_site(desk, "read", told.append)
            assert doctor == tuple(told)
            return doctor, await examine_site(desk, "read", told.append, above=True)

    doctor, acceptance = run_virtual(main)
    codes = [[line.code for line in one.lines] for one in doctor]
    assert [[line.code for line in one.lines] for one in acceptance[: len(doctor)]] == codes
    assert {one.outcome for one in acceptance[len(doctor) :]} == {"skipped"}
    assert all(record["level"] != "read" for one in acceptance[len(doctor) :] for record in one.as_records())


@pytest.mark.long
def test_an_instrument_that_counts_the_wrong_optics_is_not_accepted(tmp_path: Path) -> None:
    def change(cell: Cell) -> None:
        cell.operator.change(mounts_wrong=["EXX"])

    found = accepted(tmp_path, ("motion",), "motion", change=change)
    assert found["motion X1"].outcome == "wrong"


@pytest.fixture(scope="module")
def of(tmp_path_factory: pytest.TempPathFactory) -> Occasion:
    """The smallest cell's site, on one day."""
    folder = tmp_path_factory.mktemp("site")

    async def main() -> Occasion:
        async with cell_running("zero", folder, LoopClock(), wires="memory") as cell:
            return Occasion(load_site(cell.site_path), cell.site_path, "motion", DAY)

    return run_virtual(main)


RESULTS = (
    CheckResult("axis", "X1", "program", (wrong("E-DOC-NO-AXIS", "axis", axis="<X1>", known="C1 & Z1"),)),
    CheckResult("rights", "", "program", (skipped("W-DOC-NO-USER", "rights"),)),
    CheckResult("axis", "C1", "program", (fine("W-DOC-REFERENCED", "axis", axis="C1", unit="deg"),)),
)


def test_the_sheet_shows_every_result_and_lines_to_sign(of: Occasion, tmp_path: Path) -> None:
    write_sheet(tmp_path / "sheet.html", RESULTS, of)
    text = (tmp_path / "sheet.html").read_text(encoding="utf-8")
    assert "no axis &lt;X1&gt;; it has C1 &amp; Z1 → correct the name" in text
    assert "1 passed, 1 failed, 0 not told, 1 skipped" in text
    assert of.site.site.name in text
    assert "2026-03-02 08:30 UTC" in text
    assert "SIMULATED" in text
    assert "Accepted by" in text


def test_the_sheet_is_written_in_every_language_as_page_and_on_paper(of: Occasion, tmp_path: Path) -> None:
    told = {}
    for language, word in (("en", "skipped"), ("de", "ausgelassen"), ("zh", "跳过")):
        one = replace(of, language=language)
        told[language] = texts = page(sheet(RESULTS, one))
        assert word in texts
    assert "此连接没有可查询权限的用户" in told["zh"]
    assert "die Steuerung hat keine Achse &lt;X1&gt;" in told["de"]
    english = {text for key, text in catalogue_of("en").items() if key.startswith("accept_") and len(text) > 12}
    assert {text for text in english if text in told["de"] or text in told["zh"]} == set()
    write_sheet(tmp_path / "sheet.pdf", RESULTS, replace(of, language="de"))
    assert (tmp_path / "sheet.pdf").read_bytes().startswith(b"%PDF-1.7")


def test_every_check_has_its_words() -> None:
    english = catalogue_of("en")
    assert [
        one.name for one in CHECKS if not {f"accept_name_{one.name}", f"accept_what_{one.name}"} <= set(english)
    ] == []


@pytest.mark.parametrize(("name", "language", "code"), [("a.txt", "", "SHEET"), ("a.html", "fr", "LANGUAGE")])
def test_a_sheet_that_cannot_be_written_is_refused_first(name: str, language: str, code: str) -> None:
    with pytest.raises(ConfigError) as refused:
        check_sheet(Path(name), language)
    assert refused.value.code.endswith(code)
