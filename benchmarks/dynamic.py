"""A dynamic capture of a million samples opened, evaluated and drawn, against numpy, scipy and matplotlib alone."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy import signal

from benchmarks.report import Report, main, spent
from drivers.recordings import Recording
from gateway.workflow.axes.dynamic import outcome_of
from gateway.workflow.files.reading import ReadOptions, read_file

COUNT, RATE_HZ = 1_000_001, 50_000.0
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
    """As `trueflank measure dynamic FILE.rtx --unit mm` does it."""
    read = read_file(path, ReadOptions("mm"))
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


def measure(report: Report) -> None:
    """Both, each into a new picture at every call."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path, count = written(folder / "a.rtx"), iter(range(1000))
        repeats = report.pick(3, 1)
        floor = spent(lambda: alone(path, folder / f"{next(count)}.png"), repeats)
        whole = spent(lambda: ours(path, folder / f"{next(count)}.png"), repeats)
    report.say(f"a .rtx of {COUNT} samples opened, evaluated and drawn", whole, "s")
    report.at_most("the same / the two panels by numpy, scipy and matplotlib alone", whole / floor, 3.0)


if __name__ == "__main__":
    sys.exit(main(measure, __doc__))
