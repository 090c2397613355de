"""The picture of an evaluation of files: all curves on one scale, over the travel or round the turn."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol, cast

import numpy as np
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import MaxNLocator

from gateway.domain.values import FloatArray
from gateway.report.drawings.curves import NEW, REVERSE, RULE, calm
from gateway.report.drawings.plots import SIMULATED, png, svg_file
from gateway.report.drawings.ruler import INK, QUIET, ruled

COLOURS = (NEW, REVERSE, INK, QUIET)
LINES = ("-", "--", "-.", ":")


class DrawnCurve(Protocol):
    """A curve with its name: ``y`` (m,) over ``x`` (m,)."""

    @property
    def label(self) -> str:
        """What it is."""
        ...

    @property
    def x(self) -> FloatArray:
        """Positions or angles."""
        ...

    @property
    def y(self) -> FloatArray:
        """Values."""
        ...


class DrawnPicture(Protocol):
    """What is drawn; ``axes`` are the words of both axes."""

    @property
    def kind(self) -> str:
        """The heading."""
        ...

    @property
    def curves(self) -> tuple[DrawnCurve, ...]:
        """All on one scale."""
        ...

    @property
    def axes(self) -> tuple[str, str]:
        """Horizontal and vertical."""
        ...

    @property
    def polar(self) -> bool:
        """Round the turn."""
        ...

    @property
    def fitted(self) -> bool:
        """Whether each curve's line is drawn too."""
        ...

    @property
    def simulated(self) -> bool:
        """Whether a double took part."""
        ...


def draw(picture: DrawnPicture, path: Path) -> None:
    """Write a PNG, or an SVG by its ending. Raises StoreError (E-REPORT-WRITE)."""

    def paint(figure: Figure) -> None:
        (_round if picture.polar else _along)(figure, picture)

    stamp = SIMULATED if picture.simulated else ""
    if path.suffix.lower() == ".svg":
        svg_file((178.0, 178.0 if picture.polar else 100.0), paint, path, stamp)
    else:
        png((7.0, 7.0) if picture.polar else (7.0, 3.9), paint, path, stamp)


def _along(figure: Figure, picture: DrawnPicture) -> None:
    panel = ruled(figure)[0, 0]
    figure.subplots_adjust(left=0.11, right=0.97, top=0.86, bottom=0.14)
    calm(panel)
    panel.axhline(0.0, color=RULE, lw=0.6)
    for place, curve in enumerate(picture.curves):
        colour, line = COLOURS[place % 4], LINES[place // 4 % 4]
        panel.plot(curve.x, curve.y, line, color=colour, lw=1.15, marker="o", ms=2.4, mew=0, label=curve.label)
        if picture.fitted:
            panel.plot(curve.x, np.polyval(np.polyfit(curve.x, curve.y, 1), curve.x), "--", color=colour, lw=0.7)
    if "deg" in picture.axes[0]:
        panel.xaxis.set_major_locator(MaxNLocator(9, steps=[1.5, 3, 4.5, 6, 9]))
    panel.set_xlabel(picture.axes[0])
    panel.set_ylabel(picture.axes[1])
    _headed(figure, picture)


def _round(figure: Figure, picture: DrawnPicture) -> None:
    """Turns thin, the last curve (the average) heavy; the circle of zero leaves room for the deviations inside it."""
    panel = cast(PolarAxes, figure.add_subplot(projection="polar"))
    figure.subplots_adjust(left=0.08, right=0.92, top=0.84, bottom=0.06)
    widest = max(float(np.nanmax(np.abs(curve.y))) for curve in picture.curves) or 1.0
    for place, curve in enumerate(picture.curves):
        heavy = place == len(picture.curves) - 1
        angle = np.deg2rad(np.append(curve.x, curve.x[0] + 360.0))
        radius = np.append(curve.y, curve.y[0])
        colour, width = (NEW, 1.6) if heavy else (QUIET, 0.6)
        label = curve.label if heavy else "each turn" if place == 0 else None
        panel.plot(angle, radius, color=colour, lw=width, label=label)
    panel.set_ylim(-2.0 * widest, 1.2 * widest)
    panel.set_rlabel_position(68.0)
    panel.tick_params(labelsize=8, colors=QUIET)
    panel.grid(color=RULE, lw=0.4)
    figure.text(0.08, 0.015, picture.axes[1], fontsize=9, color=QUIET)
    _headed(figure, picture)


def _headed(figure: Figure, picture: DrawnPicture) -> None:
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.text(0.02, 0.94, picture.kind, fontsize=11, weight="bold", color=INK)
    if len(labels) == 1:
        figure.text(0.98, 0.94, labels[0], fontsize=8, color=INK, ha="right")
    if len(labels) > 1:
        figure.legend(handles, labels, loc="upper right", ncols=min(len(labels), 3), frameon=False, fontsize=8)
