"""Whole commands in processes of their own: processor time and memory, from the first import to the exit."""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

from benchmarks.evaluation import written
from benchmarks.report import Report, child, main

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"


def started(report: Report, text: str, words: list[str], limit_s: float, limit_mb: float, folder: Path) -> None:
    """One command, the best of three."""
    runs = [child(words, folder=folder) for _ in range(report.pick(3, 1))]
    if any(run.code for run in runs):
        raise SystemExit(f"{' '.join(words)} ended with {max(run.code for run in runs)}")
    report.at_most(f"{text}: processor", min(run.cpu_s for run in runs), limit_s, "s")
    report.at_most(f"{text}: memory", min(run.memory_mb for run in runs), limit_mb, "MB")


def measure(report: Report) -> None:
    """All figures of this file."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        site = shutil.copy(sorted((EXAMPLES / "sites").glob("*.toml"))[0], folder / "site.toml")
        one = written(folder / "one.rtl", 1)
        started(report, "trueflank --help", ["--help"], 0.3, 60.0, folder)
        if report.smoke:
            return
        started(report, "check SITE", ["check", str(site)], 0.4, 120.0, folder)
        started(report, "runs list, empty store", ["runs", "list"], 0.3, 90.0, folder)
        started(report, "evaluate FILE.rtl", ["evaluate", str(one)], 0.6, 150.0, folder)
        started(report, "report FILE.rtl (PDF, HTML, data)", ["report", str(one)], 1.2, 250.0, folder)


if __name__ == "__main__":
    sys.exit(main(measure, __doc__))
