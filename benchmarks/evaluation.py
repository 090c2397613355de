"""Evaluating readings: figures to ISO 230-2 against plain numpy, a large CSV against pandas, the commands over files.

The commands run in processes of their own; what one more file costs is the difference between many files and one. It is
mostly the Monte Carlo that says how far the figures of a repeated test scatter, trials of means and variances until its
tolerance is kept; beside plain numpy, which has none, the line says it against as many bare draws. `tf.evaluate` says U
and doubts of each figure, which plain numpy does not. A table of 100 000 targets has no Monte Carlo, and says so.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

import trueflank as tf
from benchmarks.report import Report, child, main, spent
from gateway.evaluate.standards.registry import evaluate_by
from gateway.evaluate.uncertainty.budget import Budget
from gateway.evaluate.uncertainty.montecarlo import BLOCK
from gateway.workflow.files.reading import ReadOptions, read_file

RTL = """HEADER::
File type  : rtl
Owner      : bench
Version no : 0

TARGET DATA::
Filetype  : ISO
Target-count: {count}
Targets :
 {targets}
Flags: 0 0 2 0

USER-TEXT::
Machine:Example
Serial No:12
Date:2026-01-01
By:
Axis:X
Location:
TITLE:

RUNS::
Run-count:10

DEVIATIONS::
Run Target Data:
{rows}

EOF::
"""
TARGETS, RUNS = 21, 5


def deviations(seed: int) -> np.ndarray:
    """Readings (targets, runs, 2) in um of an axis with a slope, a wave, reversal and scatter."""
    rng, at = np.random.default_rng(seed), np.linspace(0.0, 1.0, TARGETS)
    mean = 8.0 * at + 2.0 * np.sin(9.0 * at)
    return np.asarray(mean[:, None, None] + np.array([0.0, 1.5]) + rng.normal(0.0, 0.3, (TARGETS, RUNS, 2)))


def written(path: Path, seed: int) -> Path:
    """One result file of these readings, pilgrim's way up and down."""
    values = deviations(seed)
    rows = []
    for run in range(RUNS):
        rows += [f"{2 * run + 1} {i + 1} {values[i, run, 0]:.3f}" for i in range(TARGETS)]
        rows += [f"{2 * run + 2} {i + 1} {values[i, run, 1]:.3f}" for i in reversed(range(TARGETS))]
    targets = "  ".join(f"{x:.6f}" for x in np.linspace(0.0, 400.0, TARGETS))
    path.write_text(RTL.format(count=TARGETS, targets=targets, rows="\n".join(rows)), encoding="ascii", newline="\r\n")
    return path


def plain(values: np.ndarray) -> dict[str, float]:
    """A, E, R, B and M of ISO 230-2:2014 in a few lines of numpy."""
    mean, s = values.mean(axis=1), values.std(axis=1, ddof=1)
    both, B = mean.mean(axis=1), mean[:, 0] - mean[:, 1]
    R = np.maximum(4.0 * s.max(axis=1), np.maximum(2.0 * s.sum(axis=1) + np.abs(B), 0.0))
    return {
        "A": float((mean + 2.0 * s).max() - (mean - 2.0 * s).min()),
        "E": float(mean.max() - mean.min()),
        "R": float(R.max()),
        "B": float(np.abs(B).max()),
        "M": float(both.max() - both.min()),
    }


def trials_of(values: np.ndarray) -> int:
    """How many trials the evaluation of these readings makes."""
    found = evaluate_by("2014", np.linspace(0.0, 400.0, TARGETS), values, "um", budget=Budget())
    return max(one.trials for one in found.trials.values())


def draws(trials: int) -> None:
    """What a Monte Carlo of a test draws at least: a mean and a variance at each target in each direction."""
    rng = np.random.default_rng(1)
    for _ in range(0, trials, BLOCK):
        rng.standard_normal((TARGETS, 2, BLOCK))
        rng.standard_gamma((RUNS - 1) / 2.0, (TARGETS, 2, BLOCK))


def figures(report: Report, folder: Path) -> None:
    """The library and the command against plain numpy."""
    measured, values = tf.read(written(folder / "one.rtl", 1)), deviations(1)
    values = np.round(values, 3)
    found = tf.evaluate(measured)
    worst = max(abs((found[name] or 0.0) - value) for name, value in plain(values).items())
    report.at_most("ISO 230-2: largest difference of A, E, R, B, M to plain numpy", worst, 1e-9, "um")
    floor = spent(lambda: plain(values))
    report.say("ISO 230-2: plain numpy, one set", 1e6 * floor, "us")
    report.at_most(
        "ISO 230-2: tf.evaluate with U and notes / plain numpy", spent(lambda: tf.evaluate(measured)) / floor, 20.0
    )
    count = report.pick(40, 2)
    paths = [str(written(folder / f"{number}.rtl", number)) for number in range(count + 1)]
    if report.smoke:
        return
    one = child(["evaluate", paths[0]])
    many = child(["evaluate", *paths])
    report.at_most("evaluate: one .rtl", one.cpu_s, 0.6, "s")
    further_s = (many.cpu_s - one.cpu_s) / count
    report.at_most("evaluate: each further .rtl / plain numpy", further_s / floor, 300.0)
    trials = trials_of(values)
    drawn_s = spent(lambda: draws(trials), 1)
    report.say("evaluate: Monte Carlo of one .rtl", trials, "trials")
    report.at_most("evaluate: each further .rtl / bare draws of its trials", further_s / drawn_s, 4.0)


def large_table(report: Report, folder: Path) -> None:
    """A CSV of many readings against pandas and the memory it takes."""
    targets, repetitions = report.pick(100_000, 50), 5
    rng, at = np.random.default_rng(2), np.round(np.linspace(0.0, 1000.0, targets), 6)
    passes = []
    for run in range(2 * repetitions):
        upwards = run % 2 == 0
        values = np.round(rng.normal(size=targets), 3)
        columns = {"target_mm": at if upwards else at[::-1], "direction": "+" if upwards else "-"}
        passes.append(pd.DataFrame({**columns, "repetition": run // 2 + 1, "deviation_um": values}))
    table = pd.concat(passes)
    path = folder / "large.csv"
    table.to_csv(path, index=False)
    floor = spent(lambda: pd.read_csv(path), 2)
    report.say(f"CSV: {len(table)} readings by pandas.read_csv", floor, "s")
    report.at_most(
        "CSV: read, checked and arranged / pandas.read_csv",
        spent(lambda: read_file(path, ReadOptions()), 1) / floor,
        8.0,
    )
    if not report.smoke:
        whole = child(["evaluate", str(path)])
        report.at_most(f"evaluate: a CSV of {len(table)} readings, processor", whole.cpu_s, 3.0, "s")
        report.at_most(f"evaluate: a CSV of {len(table)} readings, memory", whole.memory_mb, 400.0, "MB")


def measure(report: Report) -> None:
    """All figures of this file."""
    with tempfile.TemporaryDirectory() as name:
        figures(report, Path(name))
        large_table(report, Path(name))


if __name__ == "__main__":
    sys.exit(main(measure, __doc__))
