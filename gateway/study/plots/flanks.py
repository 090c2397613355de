"""Flanks as a gear laboratory prints them: maps, profile and lead traces with their lines, pitch bars, values."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from drivers.types.values import FloatArray
from gateway.gear.cycloid import CycloidGear
from gateway.study.draw import INK, scale_bar, unrolled


def one_map(figure: Figure, gear: CycloidGear, deviation: FloatArray, heights: FloatArray) -> None:
    """All spaces unrolled, um: deviation (K, T, Z), heights (Z,) in mm."""
    panel = figure.subplots(1, 1)
    figure.subplots_adjust(left=0.06, right=0.9, top=0.86, bottom=0.22)
    top = float(np.max(np.abs(deviation))) or 1.0
    unrolled(panel, heights, deviation, top)
    rms = float(np.sqrt(np.mean(deviation**2)))
    panel.set_title(
        f"normal deviation, {gear.zc} spaces   RMS {rms:.2f} µm, largest {np.max(np.abs(deviation)):.2f} µm",
        loc="left", fontsize=9, color=INK,
    )  # fmt: skip
    panel.set_ylabel("z  mm")
    panel.set_xlabel("space; in each the right flank, the bottom, the left flank, in equal arc length")
    scale_bar(figure, [panel], top, None)
