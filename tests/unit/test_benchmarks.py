"""Every benchmark runs to its end in its small form, and one that misses a limit fails."""

from __future__ import annotations

import importlib
import math
from pathlib import Path

import pytest

from benchmarks import __main__ as all_of_them
from benchmarks.report import Figure, Report, slope

# These two start whole controls and a large picture: a minute of `make long` instead of seconds of every run.
SLOW = ("push", "dynamic")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long) if name in SLOW else name for name in all_of_them.NAMES]
)
def test_a_benchmark_runs_to_its_end_in_its_small_form(name: str) -> None:
    report = Report(smoke=True)
    importlib.import_module(f"benchmarks.{name}").measure(report)
    assert report.figures
    assert all(math.isfinite(figure.value) for figure in report.figures)
    assert report.missed == []


def test_a_figure_beyond_its_limit_fails_and_one_that_is_no_number_too() -> None:
    report = Report()
    report.at_most("kept", 1.0, 1.0)
    report.at_least("kept", 2.0, 1.0)
    assert report.missed == []
    report.at_most("too large", 1.1, 1.0)
    report.at_least("too small", 0.9, 1.0)
    report.at_most("no number", math.nan, 1.0)
    assert [figure.text for figure in report.missed] == ["too large", "too small", "no number"]


def test_the_page_tells_what_was_missed() -> None:
    figures = [Figure("a", 2.0, "s", "<=", 1.0), Figure("b", 3.0)]
    page = all_of_them.section("flank", "today, load 1", figures, ["c: not measured (why)"])
    assert "\n\ntoday, load 1\n\n" in page
    assert "| a | 2 s **missed** | <= 1 s |\n| b | 3 |  |" in page
    assert "c: not measured (why)." in page
    assert slope([10.0, 100.0], [1.0, 100.0]) == pytest.approx(2.0)


def test_a_benchmark_that_is_run_again_takes_its_own_place_on_the_page(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    for name, text in (("store", "old"), ("flank", "first"), ("store", "new")):
        all_of_them.write_page(page, name, f"## {name}\n\n{text}\n")
    assert page.read_text(encoding="utf-8") == f"{all_of_them.HEAD}## flank\n\nfirst\n\n## store\n\nnew\n"
