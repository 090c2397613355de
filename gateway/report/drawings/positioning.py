"""The chart of a positioning test as ISO 230-2 draws it: every reading, the means, the bands, and A, E, M, R marked.

No word is drawn, only symbols and units, so that the same picture serves every language; the caption says the rest.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from gateway.domain.captures import Capture
from gateway.domain.figures import Evaluation
from gateway.domain.values import FloatArray
from gateway.report.drawings.curves import NEW, REVERSE, calm, limits, mean, plain_name
from gateway.report.drawings.plots import svg
from gateway.report.drawings.ruler import INK, QUIET, ruled

SIZE_MM = (88.0, 43.0)
SMALLEST_PT = 8.0
READING = "#9aa4ad"
MARGIN_OF_MARKS = 0.2
Span = tuple[float, float]


def chart(capture: Capture | None, found: Evaluation, letter: str, name: str) -> str:
    """SVG of one test; without a capture the readings are left out. ``name`` makes its parts' names unique."""
    return svg(SIZE_MM, lambda figure: paint(figure, capture, found, letter), name)


def paint(figure: Figure, capture: Capture | None, found: Evaluation, letter: str) -> None:
    """One test onto a figure: readings, means, bands, marks."""
    panel = ruled(figure)[0, 0]
    figure.subplots_adjust(left=0.145, right=1.0 - MARGIN_OF_MARKS, top=0.94, bottom=0.19)
    calm(panel)
    order = np.argsort(found.targets, kind="stable")
    x = found.targets[order]
    if capture is not None:
        _readings(panel, capture)
    _bands(panel, found)
    panel.plot(x, found.mean_up[order], "-", color=NEW, lw=1.1)
    panel.plot(x, found.mean_down[order], "--", color=REVERSE, lw=1.1)
    panel.plot(x, mean(found)[order], "-", color=INK, lw=1.5)
    spread = _ends(found)
    drawn = [capture.deviations.ravel()] if capture is not None else []
    low, high = limits([*drawn, np.asarray(spread)])
    panel.set_ylim(low, high)
    panel.yaxis.set_major_locator(MaxNLocator(5))
    panel.set_xlabel(
        f"{plain_name(letter)}  {'mm' if found.unit == 'um' else '°'}".strip(), labelpad=1, fontsize=SMALLEST_PT
    )
    panel.set_ylabel("µm" if found.unit == "um" else "arcsec", labelpad=1, fontsize=SMALLEST_PT)
    _marks(panel, found)
    _repeatability(panel, found)


def _readings(panel: Axes, capture: Capture) -> None:
    """Each repetition as thin marks: forward a triangle to the right, reverse one to the left."""
    for side, mark in ((0, ">"), (1, "<")):
        deviations = capture.deviations[:, :, side]
        at = np.repeat(capture.targets, deviations.shape[1])
        panel.plot(at, deviations.ravel(), mark, color=READING, ms=2.2, mew=0)


def _bands(panel: Axes, found: Evaluation) -> None:
    order = np.argsort(found.targets, kind="stable")
    for middle, s, colour in ((found.mean_up, found.s_up, NEW), (found.mean_down, found.s_down, REVERSE)):
        for sign in (-2.0, 2.0):
            panel.plot(found.targets[order], (middle + sign * s)[order], ":", color=colour, lw=0.8)


def _ends(found: Evaluation) -> Span:
    """Lowest and highest of all means -/+ 2 s: the ends of A."""
    low = [middle - 2.0 * np.nan_to_num(s) for middle, s in _sides(found)]
    high = [middle + 2.0 * np.nan_to_num(s) for middle, s in _sides(found)]
    return _span([*low, *high])


def _sides(found: Evaluation) -> tuple[tuple[FloatArray, FloatArray], ...]:
    return (found.mean_up, found.s_up), (found.mean_down, found.s_down)


def _span(parts: list[FloatArray]) -> Span:
    values = np.concatenate(parts)
    values = values[np.isfinite(values)]
    return (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)


def _marks(panel: Axes, found: Evaluation) -> None:
    """M, E and A as measured distances beside the chart, each between the curves it is taken from."""
    asked: list[tuple[str, float | None, Span]] = [
        ("M", found.M, _span([mean(found)])),
        ("E", found.E, _span([found.mean_up, found.mean_down])),
        ("A", found.A, _ends(found)),
    ]
    for place, (letter, figure, (low, high)) in enumerate(asked):
        if figure is not None:
            _distance(panel, 1.04 + 0.095 * place, letter, (low, high))


def _distance(panel: Axes, at: float, letter: str, span: Span) -> None:
    across = panel.get_yaxis_transform()
    look: dict[str, Any] = {"color": INK, "lw": 0.8, "clip_on": False, "transform": across}
    low, high = span
    # One line with gaps: the distance and its two ends.
    x = [at, at, np.nan, at - 0.018, at + 0.018, np.nan, at - 0.018, at + 0.018]
    panel.plot(x, [low, high, np.nan, low, low, np.nan, high, high], "-", **look)
    panel.text(at + 0.026, 0.5 * sum(span), letter, transform=across, fontsize=9, color=INK, va="center", clip_on=False)


def _repeatability(panel: Axes, found: Evaluation) -> None:
    """R at the target that makes it: the span of both bands there."""
    if found.R is None or not np.isfinite(found.R_i).any():
        return
    place = int(np.nanargmax(found.R_i))
    parts = [np.array([middle[place] + sign * 2.0 * s[place]]) for middle, s in _sides(found) for sign in (-1.0, 1.0)]
    low, high = _span(parts)
    x = float(found.targets[place])
    panel.annotate(
        "", (x, low), (x, high), arrowprops={"arrowstyle": "<->", "color": QUIET, "lw": 0.9, "shrinkA": 0, "shrinkB": 0}
    )
    panel.annotate("R", (x, high), xytext=(3, 2), textcoords="offset points", fontsize=9, color=INK)
