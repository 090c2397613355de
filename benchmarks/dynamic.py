"""A dynamic capture of 1 000 001 samples opened, evaluated and drawn: seconds, and against numpy and matplotlib alone.

`python benchmarks/dynamic.py`; exit code 1 when it takes more than 3 times as long as reading, a plain spectrum and
the same two panels without any of our checks.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy import signal

from drivers.recordings import Recording
from gateway.workflow.axes.dynamic import outcome_of
from gateway.workflow.files.reading import How, read_file

COUNT, RATE_HZ = 1_000_001, 50_000.0
LIMIT = 3.0
HEAD = (
    "HEADER::\r\nFile type: rtx\r\n\r\nTARGET DATA::\r\nSample rate: 50000\r\nSample no: 1000001\r\n"
    "Actual sample rate: 50000\r\n\r\nUSER-TEXT::\r\nAxis: X\r\n\r\nData:\r\n"
)


def written(path: Path) -> Path:
    """A file with a ringing step in noise."""
    time_s = np.arange(COUNT) / RATE_HZ
    rng = np.random.default_rng(1)
    after = np.maximum(time_s - 1.0, 0.0)
    step = np.where(time_s >= 1.0, 0.05 + 0.02 * np.exp(-3.0 * after) * np.sin(2.0 * np.pi * 40.0 * after), 0.0)
    path.write_bytes(HEAD.encode() + (step + 1e-5 * rng.standard_normal(COUNT)).tobytes() + b"EOF::\r\n")
    return path


def ours(path: Path, picture: Path) -> None:
    """As `trueflank dynamic FILE.rtx --unit mm` does it."""
    read = read_file(path, How("mm"))
    if not isinstance(read.content, Recording):
        raise SystemExit("the benchmark's own file is no dynamic capture")
    outcome_of(read.content, path, picture, None)


def alone(path: Path, picture: Path) -> None:
    """The same two panels by numpy, scipy and matplotlib, nothing checked, nothing said."""
    values = np.fromfile(path, dtype="<f8", count=COUNT, offset=len(HEAD)) * 1000.0
    frequency, power = signal.welch(values, RATE_HZ, nperseg=8192, detrend="linear")
    pieces = values[: COUNT // 667 * 667].reshape(-1, 667)
    figure = Figure(figsize=(10.0, 7.0), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    above, below = figure.subplots(2, 1)
    above.fill_between(np.arange(len(pieces)) * 667 / RATE_HZ, pieces.min(axis=1), pieces.max(axis=1), lw=0.3)
    below.loglog(frequency[1:], np.sqrt(power[1:]), lw=0.7)
    with picture.open("xb") as file:
        figure.savefig(file, format="png")


def best(work: Any, path: Path, folder: Path, repeats: int = 5) -> float:
    """Seconds of the fastest of some calls."""
    times = []
    for number in range(repeats):
        start = perf_counter()
        work(path, folder / f"{work.__name__}-{number}.png")
        times.append(perf_counter() - start)
    return min(times)


def main() -> int:
    """Run and print."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = written(folder / "a.rtx")
        bare, whole = best(alone, path, folder), best(ours, path, folder)
    ratio = whole / bare
    sys.stdout.write(f"{'a 1 000 001-sample .rtx opened, evaluated and drawn, s':<66} {whole:10.3f}\n")
    sys.stdout.write(f"{'the same panels by numpy, scipy and matplotlib alone, s':<66} {bare:10.3f}\n")
    sys.stdout.write(f"{'ratio':<66} {ratio:10.3f}  <= {LIMIT:g}\n")
    return int(ratio > LIMIT)


if __name__ == "__main__":
    sys.exit(main())
