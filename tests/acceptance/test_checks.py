"""The acceptance of a cell in one process: each check sees what the cell has, and fails where something is wrong."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import ConfigError
from drivers.probes import Allowance
from gateway.acceptance.checks import CHECKS
from gateway.acceptance.judging import cases, run_check
from gateway.acceptance.results import CheckResult, seen
from gateway.acceptance.sheet import Occasion, check_sheet, sheet, write_sheet
from gateway.acceptance.working import SiteDesk
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
    allow: Allowance = "read",
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
            found = [await run_check(check, axis, desk, allow) for check, axis in wanted]
            return {one.name: one for one in found}

    return run_virtual(main)


def test_what_can_be_read_is_accepted_and_what_lies_above_is_said(tmp_path: Path) -> None:
    found = accepted(tmp_path, ("identity", "limits", "rights", "motion", "table"))
    told = {name: one.outcome for name, one in found.items()}
    above = {name for name in told if name.startswith(("motion", "table"))}
    assert {told[name] for name in above} == {"skipped"}
    assert {name: word for name, word in told.items() if name not in above and word != "passed"} == {}
    assert found["motion X1"].said == "needs --allow move; this acceptance has --allow read"
    assert "V4.94" in found["identity"].said


def test_a_mailbox_is_accepted_too_and_what_it_does_not_have_is_skipped(tmp_path: Path) -> None:
    found = accepted(tmp_path, ("connection", "identity", "axis", "limits", "rights"), road="modbus")
    print({name: (one.outcome, one.said) for name, one in found.items()})
    assert {name for name, one in found.items() if one.outcome == "failed"} == set()
    assert found["rights"].outcome == "skipped"
    assert found["identity"].outcome == "passed"


def test_what_is_wrong_fails_with_the_next_step(tmp_path: Path) -> None:
    def change(cell: Cell) -> None:
        cell.nck.lose_reference("X1")

    found = accepted(tmp_path, ("axis", "self-test"), tested=False, change=change)
    assert found["axis X1"].outcome == "failed"
    assert "not referenced" in found["axis X1"].said
    assert found["self-test X1"].outcome == "failed"
    assert "trueflank doctor self-test" in found["self-test X1"].said


@pytest.mark.long
def test_an_instrument_that_counts_the_wrong_optics_is_not_accepted(tmp_path: Path) -> None:
    def change(cell: Cell) -> None:
        cell.operator.change(mounts_wrong=["EXX"])

    found = accepted(tmp_path, ("motion",), "move", change=change)
    assert found["motion X1"].outcome == "failed"


@pytest.fixture(scope="module")
def of(tmp_path_factory: pytest.TempPathFactory) -> Occasion:
    """The smallest cell's site, on one day."""
    folder = tmp_path_factory.mktemp("site")

    async def main() -> Occasion:
        async with cell_running("zero", folder, LoopClock(), wires="memory") as cell:
            return Occasion(load_site(cell.site_path), cell.site_path, "move", DAY)

    return run_virtual(main)


IDENTITY = {"serial": "7", "version": "V4", "axes": "X1", "unit": "metric"}
RESULTS = (
    CheckResult("axis", "X1", "read", outcome="failed", seen=seen("wrong", error="no axis <X1> & no limit")),
    CheckResult("rights", "", "read", outcome="skipped", seen=seen("no-user")),
    CheckResult("identity", "", "read", outcome="passed", seen=seen("identity", **IDENTITY)),
)


def test_the_sheet_shows_every_result_and_lines_to_sign(of: Occasion, tmp_path: Path) -> None:
    write_sheet(tmp_path / "sheet.html", RESULTS, of)
    text = (tmp_path / "sheet.html").read_text(encoding="utf-8")
    assert "no axis &lt;X1&gt; &amp; no limit" in text
    assert "1 passed, 1 failed, 1 skipped" in text
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
