"""The picture of a dynamic record: its envelope over time and its spectrum, however many samples it has."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from drivers.local.ownfiles import open_own
from drivers.recordings import Recording
from gateway.evaluate.behaviour.dynamics import DynamicSpectrum

INK, QUIET, FILL = "#22282e", "#6d757d", "#1f4e79"
SIGN = {"um": "µm", "arcsec": "arcsec"}
POINTS = 1500


def draw(recording: Recording, spectrum: DynamicSpectrum | None, path: Path) -> Path:
    """Write a PNG of 1500 x 1050 pixels; the file must not exist."""
    figure = Figure(figsize=(10.0, 7.0), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    above, below = figure.subplots(2, 1)
    _envelope(above, recording)
    _spectrum(below, spectrum, SIGN[recording.unit])
    with open_own(path, "xb") as file:
        figure.savefig(file, format="png")
    return path


def _envelope(panel: Axes, recording: Recording) -> None:
    time_s, low, high = recording.envelope(POINTS)
    if len(time_s) < len(recording):
        panel.fill_between(time_s, low, high, color=FILL, lw=0.3)
    else:
        panel.plot(time_s, low, color=FILL, lw=0.8)
    for gap in recording.gaps[:POINTS]:
        panel.axvline(float(recording.times(gap.index, gap.index + 1).sum()), color=QUIET, lw=0.6, ls=":")
    if recording.trigger:
        panel.axvline(float(recording.times(recording.trigger, recording.trigger + 1)[0]), color=INK, lw=0.8, ls="--")
    panel.set_xlabel("time  s")
    panel.set_ylabel(f"{SIGN[recording.unit]}")
    panel.set_title(f"{len(recording)} samples at {recording.rate_hz:g} Hz", loc="left", fontsize=9)


def _spectrum(panel: Axes, spectrum: DynamicSpectrum | None, unit: str) -> None:
    panel.set_xlabel("frequency  Hz")
    panel.set_ylabel(f"amplitude  {unit}")
    if spectrum is None:
        return
    shown = spectrum.frequency_hz > 0.0
    panel.loglog(spectrum.frequency_hz[shown], np.maximum(spectrum.amplitude[shown], 1e-9), color=FILL, lw=0.7)
    for peak in spectrum.peaks[:5]:
        panel.annotate(f"{peak.frequency_hz:.4g} Hz", (peak.frequency_hz, peak.amplitude), fontsize=7, color=INK)
    panel.grid(True, which="major", color="#e4e7e9", lw=0.5)
