"""The picture of a circular test: both senses about the nominal circle, magnified, with the scale stated."""

from __future__ import annotations

from collections.abc import Mapping
from math import floor, log10
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from gateway.domain.values import FloatArray
from gateway.report.drawings.curves import NEW, REVERSE, RULE
from gateway.report.drawings.plots import png, svg_file
from gateway.report.drawings.ruler import INK, QUIET

COLOURS = {1: NEW, -1: REVERSE}
WORDS = {1: "ccw", -1: "cw"}
DIVISIONS = 5
"""From the centre to the nominal circle: a deviation of one division is a fifth of the radius."""


def division_um(paths: Mapping[int, tuple[FloatArray, FloatArray]]) -> float:
    """One division in um: the least 1, 2 or 5 of a decade that keeps every deviation within two of them."""
    largest = max(float(np.max(np.abs(radial))) for _angle, radial in paths.values()) / 2.0 or 1.0
    decade = 10.0 ** floor(log10(largest))
    return next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= largest * (1.0 - 1e-12))


def draw_circle(paths: Mapping[int, tuple[FloatArray, FloatArray]], path: Path) -> None:
    """Write a PNG, or an SVG by its ending. Raises StoreError (E-REPORT-WRITE)."""
    unit = division_um(paths)

    def paint(figure: Figure) -> None:
        panel = figure.add_axes((0.06, 0.05, 0.88, 0.84))
        turn = np.linspace(0.0, 2.0 * np.pi, 361)
        for ring in range(DIVISIONS - 2, DIVISIONS + 3):
            heavy = ring == DIVISIONS
            colour = INK if heavy else RULE
            panel.plot(ring * np.cos(turn), ring * np.sin(turn), color=colour, lw=0.9 if heavy else 0.5)
        for sense, (angle, radial) in paths.items():
            t = np.deg2rad(angle)
            r = DIVISIONS + radial / unit
            panel.plot(r * np.cos(t), r * np.sin(t), color=COLOURS[sense], lw=1.2, label=WORDS[sense])
        for x, y, word in ((7.3, 0.0, "first +"), (0.0, 7.3, "second +")):
            panel.annotate("", (x, y), (0.0, 0.0), arrowprops={"arrowstyle": "->", "color": QUIET, "lw": 0.6})
            panel.text(x + 0.1, y + 0.1, word, fontsize=8, color=QUIET)
        panel.set_xlim(-8.2, 8.2)
        panel.set_ylim(-8.2, 8.2)
        panel.set_aspect("equal")
        panel.axis("off")
        figure.text(0.02, 0.95, "ballbar", fontsize=11, weight="bold", color=INK)
        figure.text(0.02, 0.92, f"{unit:g} µm per division", fontsize=9, color=QUIET)
        figure.legend(loc="upper right", ncols=2, frameon=False, fontsize=8)

    if path.suffix.lower() == ".svg":
        svg_file((178.0, 178.0), paint, path)
    else:
        png((7.0, 7.0), paint, path)
