"""The picture of a reducer's evaluation: error over a turn, orders as bars with their causes, the loop of torque."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from drivers.message import words
from gateway.evaluate.behaviour.drive import DriveFigures
from gateway.evaluate.behaviour.order_causes import in_words
from gateway.report.drawings.curves import NEW, REVERSE, RULE, calm
from gateway.report.drawings.plots import SIMULATED, png, svg_file
from gateway.report.drawings.ruler import INK, QUIET, ruled

BARS = 10
COLOURS = {1: NEW, -1: REVERSE}
SENSES = {1: "forwards", -1: "backwards"}
INCH = 25.4


def draw_drive(found: DriveFigures, path: Path, *, simulated: bool) -> None:
    """Write a PNG, or an SVG by its ending. Raises StoreError (E-REPORT-WRITE)."""
    rows = (2 if found.running else 0) + (1 if found.loop is not None else 0)
    size = (7.0, 0.5 + 2.6 * rows)

    def paint(figure: Figure) -> None:
        panels: list[Any] = list(ruled(figure, rows, 1)[:, 0])
        height = 0.5 + 2.6 * rows
        figure.subplots_adjust(left=0.11, right=0.97, top=1.0 - 0.55 / height, bottom=0.5 / height, hspace=0.42)
        if found.running:
            _curves(panels.pop(0), found)
            _bars(panels.pop(0), found)
        if found.loop is not None:
            _twist(panels.pop(0), found)
        figure.text(0.02, 1.0 - 0.3 / height, "transmission", fontsize=11, weight="bold", color=INK)
        handles, labels = figure.axes[0].get_legend_handles_labels()
        if len(labels) > 1:
            figure.legend(handles, labels, loc="upper right", ncols=2, frameon=False, fontsize=8)

    stamp = SIMULATED if simulated else ""
    if path.suffix.lower() == ".svg":
        svg_file((size[0] * INCH, size[1] * INCH), paint, path, stamp)
    else:
        png(size, paint, path, stamp)


def _curves(panel: Axes, found: DriveFigures) -> None:
    calm(panel)
    panel.axhline(0.0, color=RULE, lw=0.6)
    for run in found.running:
        at = np.argsort(run.angle_deg)
        line = panel.plot(run.angle_deg[at], run.error_arcsec[at], color=COLOURS[run.sense], lw=0.8)[0]
        line.set_label(SENSES[run.sense])
    panel.xaxis.set_major_locator(MultipleLocator(45.0))
    panel.set_xlabel("output  deg")
    panel.set_ylabel("error  arcsec")


def _bars(panel: Axes, found: DriveFigures) -> None:
    """The largest orders of the first sense, each with both senses; the causes are written over them."""
    calm(panel)
    chosen = [one.order for one in found.running[0].orders[:BARS]]
    names = {one.order: in_words(one.causes[:1]) for run in found.running for one in run.orders}
    width = 0.8 / len(found.running)
    highest = 0.0
    for place, run in enumerate(found.running):
        heights = [run.amplitude(order) for order in chosen]
        highest = max(highest, *heights)
        at = np.arange(len(chosen)) + (place - 0.5 * (len(found.running) - 1)) * width
        panel.bar(at, heights, width=0.9 * width, color=COLOURS[run.sense])
    for k, order in enumerate(chosen):
        tallest = max(run.amplitude(order) for run in found.running)
        named = names.get(order, "")
        panel.text(k, tallest + 0.03 * highest, named, fontsize=6, rotation=90, ha="center", va="bottom", color=QUIET)
    panel.set_ylim(0.0, 2.3 * highest or 1.0)
    panel.set_xticks(np.arange(len(chosen)), [f"{order}" for order in chosen])
    panel.set_xlabel(words("S-DRAW-ORDER"))
    panel.set_ylabel("amplitude  arcsec")


def _twist(panel: Axes, found: DriveFigures) -> None:
    calm(panel)
    loop, rated = found.loop, found.drive.rated_torque_nm
    if loop is None:
        return
    panel.axhline(0.0, color=RULE, lw=0.6)
    panel.axvline(0.0, color=RULE, lw=0.6)
    panel.plot(loop.torque_nm, loop.twist_arcsec, color=NEW, lw=1.0, marker="o", ms=1.8, mew=0)
    for sign in (-1.0, 1.0):
        panel.axvline(sign * 0.03 * (rated or 0.0), color=QUIET, lw=0.6, ls=":")
    panel.set_xlabel(words("S-DRAW-TORQUE"))
    panel.set_ylabel("twist  arcsec")
