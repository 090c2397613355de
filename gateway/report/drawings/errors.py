"""The machine's errors drawn: their curves, what each does to the tooth, the ranking, the tables against them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from drivers.message import words
from drivers.terms import shown
from drivers.types.values import FloatArray
from gateway.domain.figures import Component
from gateway.domain.proposals import TableChange
from gateway.domain.values import COVERAGE
from gateway.model.components import is_periodic, motion_uncertainty, value
from gateway.model.error_model import MOTION_NAMES, ErrorModel, UnmeasuredError
from gateway.report.drawings.curves import NEW, OLD, RULE, calm, limits, plain_name
from gateway.report.drawings.ruler import FAINT, INK, QUIET, ruled
from gateway.report.sentences import number, signed
from gateway.report.tooth.rows import CureRow
from gateway.report.tooth.why import Tag, meaning

POINTS = 121
COLUMNS = 6
Bar = tuple[str, float, float | None, float | None]
TAGS: dict[Tag, str] = {
    "axis": "#5f86ab",
    "set-up": "#8a9299",
    "cross": "#1f4e79",
    "product": "#7c6a9c",
    "part": "#c58a3a",
    "mech": "#a8453a",
    "none": "#c9ced2",
}
NAMED = 0.02  # of the largest: smaller ones would write over each other
SMALL = 5e-4  # of the largest: shorter bars are not drawn
# More in one line are wider than the picture in any language.
LEGEND_COLUMNS = 4


def motions(figure: Figure, model: ErrorModel) -> None:
    """Every error motion over its axis with +/- U (k = 2), one row an axis; one that was only assumed as its span."""
    gaps, names = {one.name: one for one in model.unknown}, motion_names(model)
    panels = ruled(figure, -(-len(names) // COLUMNS), COLUMNS)
    height = float(figure.get_size_inches()[1])
    figure.subplots_adjust(
        left=0.04, right=0.995, top=1.0 - 0.17 / height, bottom=0.29 / height, hspace=0.66, wspace=0.44
    )
    for panel, name in zip(panels.flat, names, strict=False):
        one = model.motion(name)
        if one is not None:
            _motion(panel, one, model.systematic.get(name, 0.0))
        else:
            _gap(panel, gaps[name])
    for panel in panels.flat[len(names) :]:
        panel.set_visible(False)


def motion_names(model: ErrorModel) -> list[str]:
    """The error motions that a model measured or assumes, in the usual order."""
    told = {*(one.name for one in model.motions), *(one.name for one in model.unknown if one.name[:1] == "E")}
    return [*(name for name in MOTION_NAMES if name in told), *sorted(told.difference(MOTION_NAMES))]


def _small(panel: Axes, title: str) -> None:
    calm(panel)
    panel.set_title(shown(plain_name(title)), loc="left", fontsize=8, color=INK, pad=3)
    # Two numbers with a sign and three digits are as wide as the panel.
    panel.xaxis.set_major_locator(MaxNLocator(2))
    panel.yaxis.set_major_locator(MaxNLocator(3))


def _motion(panel: Axes, one: Component, systematic: float) -> None:
    low, high = (0.0, 360.0) if is_periodic(one) else one.domain
    at = np.linspace(low, high, POINTS)
    values = value(one, at)
    U = COVERAGE * np.hypot(motion_uncertainty(one, at), systematic)
    _small(panel, f"{one.name}  {one.unit}")
    panel.fill_between(at, values - U, values + U, color=NEW, alpha=0.18, lw=0)
    panel.plot(at, values, color=NEW, lw=1.1)
    panel.set_ylim(*limits([values - U, values + U]))
    panel.set_xlabel(one.axis_unit, fontsize=8, labelpad=1, color=QUIET)


def _gap(panel: Axes, gap: UnmeasuredError) -> None:
    _small(panel, f"{gap.name}  {gap.unit}")
    panel.set_xticks([])
    text = f"assumed ±{gap.span:g}"
    panel.axhspan(-gap.span, gap.span, color=FAINT, lw=0)
    panel.set_ylim(-1.3 * gap.span, 1.3 * gap.span)
    panel.text(0.5, 0.5, text, transform=panel.transAxes, ha="center", va="center", fontsize=8, color=QUIET)


def ranking(figure: Figure, rows: Sequence[CureRow]) -> None:
    """Bars of mu* with their intervals and ranks, the most important first; the colour says what cures it."""
    known = [one for one in rows if one.mu_star_um is not None]
    rows = sorted(known, key=lambda one: -(one.mu_star_um or 0.0))
    panel = ruled(figure)[0, 0]
    height = float(figure.get_size_inches()[1])
    used = [one for one in TAGS if any(row.tag == one for row in rows)]
    head = 0.3 if len(used) <= LEGEND_COLUMNS else 0.48
    figure.subplots_adjust(left=0.075, right=0.985, top=1.0 - head / height, bottom=0.42 / height)
    calm(panel, zero=False, grid="x")
    y = np.arange(len(rows))
    size = np.array([one.mu_star_um for one in rows], dtype=np.float64)
    low = np.array([one.mu_low_um for one in rows], dtype=np.float64)
    high = np.array([one.mu_high_um for one in rows], dtype=np.float64)
    seen = size > SMALL * float(np.max(size, initial=0.0))
    panel.barh(y, size, color=[TAGS[one.tag] for one in rows], height=0.68)
    panel.hlines(y[seen], low[seen], high[seen], color=INK, lw=1.0)
    panel.set_yticks(y, [plain_name(one.error) for one in rows])
    panel.set_ylim(len(rows) - 0.4, -0.6)
    edge = float(np.max(high, initial=0.0)) or 1.0
    panel.set_xlim(0.0, 1.24 * edge)
    for place, one in enumerate(rows):
        end = max(high[place], size[place]) + 0.012 * edge
        panel.text(end, place, f"{size[place]:.3f} µm, rank {one.rank_text}", va="center", fontsize=8, color=QUIET)
    panel.set_xlabel(words("S-DRAW-MU"), labelpad=2)
    handles = [Patch(color=TAGS[one], label=meaning()[one]) for one in used]
    look = {"frameon": False, "fontsize": 8, "labelcolor": INK, "handlelength": 0.9, "columnspacing": 1.1}
    figure.legend(handles=handles, loc="upper right", ncols=LEGEND_COLUMNS, borderaxespad=0.0, **look)


def plane(figure: Figure, rows: Sequence[CureRow]) -> None:
    """mu* along, sigma up, a point an error with its name where it is not small; dashed: sigma as large as mu*."""
    known = [(one, one.mu_star_um, one.sigma_um) for one in rows if one.mu_star_um is not None]
    points = [(one, along, up) for one, along, up in known if up is not None]
    panel = ruled(figure)[0, 0]
    figure.subplots_adjust(left=0.14, right=0.98, top=0.96, bottom=0.2)
    calm(panel, zero=False)
    edge = max((along for _, along, _ in points), default=0.0) or 1.0
    top = max((up for *_, up in points), default=0.0)
    panel.plot([0.0, max(edge, top)], [0.0, max(edge, top)], "--", color=RULE, lw=0.8)
    for one, along, up in points:
        panel.plot([along], [up], "o", color=TAGS[one.tag], ms=5, mew=0)
        if along > NAMED * edge:
            look: dict[str, Any] = {"fontsize": 8, "color": INK}
            panel.annotate(plain_name(one.error), (along, up), xytext=(4, 3), textcoords="offset points", **look)
    panel.set_xlim(0.0, 1.1 * edge)
    panel.set_ylim(0.0, 1.2 * top or 1.0)
    panel.set_xlabel("µ*  µm", labelpad=2)
    panel.set_ylabel("σ  µm", labelpad=2)


def columns(count: int) -> int:
    """How many small drawings of tables stand in a row: four where they fill it, else three."""
    return 4 if count % 4 == 0 else 3


def tables(figure: Figure, changes: Sequence[tuple[str, TableChange]]) -> None:
    """Small drawings of tables side by side: old as it was, new as it is, over the input axis."""
    wide = columns(len(changes))
    height = float(figure.get_size_inches()[1])
    panels = ruled(figure, -(-len(changes) // wide), wide)
    figure.subplots_adjust(left=0.05, right=0.99, top=1.0 - 0.22 / height, bottom=0.36 / height, hspace=0.7, wspace=0.2)
    for panel, (title, change) in zip(panels.flat, changes, strict=False):
        new = change.new
        _small(panel, f"{title}  {new.deviation_unit}")
        panel.yaxis.set_major_locator(MaxNLocator(4))
        panel.xaxis.set_major_locator(MaxNLocator(5))
        if change.old_enabled and change.old.deviations:
            panel.plot(change.old.positions, _array(change.old.deviations), color=OLD, lw=1.0)
        panel.plot(new.positions, _array(new.deviations), color=NEW, lw=1.2, marker="o", ms=1.8, mew=0)
        panel.set_xlabel(f"{plain_name(new.input_axis)}  {new.input_unit}", fontsize=8, labelpad=1, color=QUIET)
    for panel in panels.flat[len(changes) :]:
        panel.set_visible(False)


def shares(figure: Figure, rows: Sequence[Bar]) -> None:
    """Bars of what each cure takes and what it leaves, percent of the flank's mean square before, with the figures.

    The last figure is what it takes of the flank with its set-up values right.
    """
    panel = ruled(figure)[0, 0]
    height = float(figure.get_size_inches()[1])
    figure.subplots_adjust(left=0.19, right=0.985, top=1.0 - 0.06 / height, bottom=0.4 / height)
    calm(panel, zero=False, grid="x")
    y = np.arange(len(rows))
    panel.barh(y - 0.17, [taken for _, taken, _, _ in rows], height=0.36, color=NEW)
    panel.barh(y + 0.21, [left or 0.0 for _, _, left, _ in rows], height=0.28, color=OLD)
    ends = [max(taken, left or 0.0, 0.0) for _, taken, left, _ in rows]
    start, edge = min(0.0, *(taken for _, taken, _, _ in rows)), max(ends)
    panel.set_xlim(1.05 * start, edge + 0.5 * ((edge - start) or 1.0))
    for place, (end, (_, taken, left, right)) in enumerate(zip(ends, rows, strict=True)):
        text = f"takes {signed(taken, 1)} %" + ("" if left is None else f", leaves {number(left, 1)} %")
        text += "" if right is None else f"; set right: {signed(right, 1)} %"
        panel.text(end + 0.012 * edge, place, text, va="center", fontsize=8, color=QUIET)
    panel.axvline(0.0, color=RULE, lw=0.8)
    panel.set_yticks(y, [plain_name(name) for name, *_ in rows])
    panel.invert_yaxis()
    panel.set_xlabel(words("S-DRAW-SHARES"), labelpad=2)


def _array(values: Sequence[float]) -> FloatArray:
    return np.asarray(values, dtype=np.float64)
