"""What is drawn: curves of deviations, tables and predictions onto given matplotlib figures.

Forward is solid, reverse dashed; bands are mean +/- 2 s; greys throughout, one dark blue for the new state.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import MaxNLocator

from drivers.message import Message, render
from gateway.domain.figures import Evaluation
from gateway.domain.proposals import TableChange
from gateway.domain.values import FloatArray
from gateway.report.drawings.ruler import FAINT, INK, QUIET, Ruler, ruled
from gateway.report.material import AxisMaterial
from gateway.tooth import AxisOutlook

RULE = "#b4babf"
OLD = "#8a9299"
NEW = "#1f4e79"
REVERSE = "#5f86ab"
LABEL_AT = 27.0  # points left of both panels of a table
SIGN = {"um": "µm", "arcsec": "arcsec"}


def before_after(figure: FigureBase, axis: AxisMaterial, heading: bool = False) -> None:
    """Two panels, before and after, on one scale of deviation; a picture that stands alone gets a heading."""
    left, right = ruled(figure, 1, 2, sharey=True)[0]
    figure.subplots_adjust(left=0.12, right=0.99, top=0.84 if heading else 0.92, bottom=0.175, wspace=0.05)
    low, high = limits([part for item in (axis.before, axis.after) if item is not None for part in _bands(item)])
    for panel, evaluation, title in ((left, axis.before, "Before"), (right, axis.after, "After")):
        _panel(panel, evaluation, title, axis)
    left.set_ylim(low, high)
    left.set_ylabel(f"deviation  {SIGN[axis.deviation_unit]}")
    right.tick_params(labelleft=False)
    if heading:
        left.legend(**_legend(), bbox_to_anchor=(2.05, 1.16), ncols=3)
        figure.text(0.12, 0.93, plain_name(f"{axis.axis}  {axis.component}"), fontsize=10, weight="bold", color=INK)


def _panel(panel: Axes, evaluation: Evaluation | None, title: str, axis: AxisMaterial) -> None:
    calm(panel)
    panel.set_title(title, loc="left", color=QUIET, pad=4)
    panel.set_xlabel(f"{plain_name(axis.letter)}  {axis.unit}", labelpad=2)
    if evaluation is None:
        panel.text(0.5, 0.5, "not measured", transform=panel.transAxes, ha="center", va="center", color=QUIET)
        return
    _curve(panel, evaluation.targets, evaluation.mean_up, evaluation.s_up, NEW, "-", ">", "forward")
    _curve(panel, evaluation.targets, evaluation.mean_down, evaluation.s_down, REVERSE, "--", "<", "reverse")


def _curve(
    panel: Axes, x: FloatArray, mean: FloatArray, s: FloatArray, colour: str, line: str, mark: str, name: str
) -> None:
    if not np.isfinite(mean).any():
        return
    order = np.argsort(x, kind="stable")
    x, mean, band = x[order], mean[order], 2.0 * s[order]
    if np.isfinite(band).any():
        label = "mean ± 2s" if name == "forward" else None
        panel.fill_between(x, mean - band, mean + band, color=colour, alpha=0.17, lw=0, label=label)
    panel.plot(x, mean, line, color=colour, lw=1.15, marker=mark, ms=2.6, mew=0, label=name)


def _bands(evaluation: Evaluation) -> list[FloatArray]:
    parts = []
    for mean, s in ((evaluation.mean_up, evaluation.s_up), (evaluation.mean_down, evaluation.s_down)):
        spread = 2.0 * np.nan_to_num(s)
        parts += [mean - spread, mean + spread]
    return parts


def limits(parts: list[FloatArray]) -> tuple[float, float]:
    """Common limits with a margin; zero is always inside."""
    values = np.concatenate([np.zeros(1), *parts])
    values = values[np.isfinite(values)]
    low, high = float(values.min()), float(values.max())
    margin = 0.07 * (high - low) or 1.0
    return low - margin, high + margin


def plain_name(text: str) -> str:
    """A controller's name as the drawing's font can show it: printable ASCII, and the signs of units."""
    return "".join(letter if " " <= letter <= "~" or letter in "µ°" else "?" for letter in text)


def calm(panel: Axes, *, zero: bool = True, grid: str = "xy") -> Ruler:
    """Faint grid, no frame above and to the right, a line at zero deviation; what draws the ticks is returned."""
    if zero:
        panel.axhline(0.0, color=RULE, lw=0.8, zorder=1)
    panel.spines[["top", "right"]].set_visible(False)
    panel.margins(x=0.02)
    return Ruler(panel, grid)


def _legend() -> dict[str, Any]:
    return {
        "loc": "upper right",
        "frameon": False,
        "fontsize": 8,
        "handlelength": 2.2,
        "columnspacing": 1.4,
        "borderaxespad": 0.0,
        "labelcolor": INK,
    }


def figure_mm(figure: FigureBase) -> tuple[float, float]:
    """Width and height of the sheet that a figure or a part of one is drawn on, mm."""
    width, height = figure.get_figure(root=True).get_size_inches()
    return 25.4 * float(width), 25.4 * float(height)


def table_change(figure: FigureBase, change: TableChange) -> None:
    """Old and new table at their points, with the straight lines between that act; beneath, new minus old."""
    top, low = ruled(figure, 2, 1, sharex=True, height_ratios=(2.1, 1.0))[:, 0]
    width, height = figure_mm(figure)
    figure.subplots_adjust(left=13.6 / width, right=0.99, top=1.0 - 6.8 / height, bottom=9.5 / height, hspace=0.13)
    unit = SIGN[change.new.deviation_unit]
    for panel, label in ((top, f"table  {unit}"), (low, f"change  {unit}")):
        calm(panel).label_at = LABEL_AT
        panel.set_ylabel(label)
    points = change.new.positions
    old = np.asarray(change.old.deviations, dtype=np.float64)
    new = np.asarray(change.new.deviations, dtype=np.float64)
    state = "" if change.old_enabled else " (was disabled)"
    top.plot(change.old.positions, old, ".-", ms=3, color=OLD, lw=1.0, label=f"old{state}")
    top.plot(points, new, ".-", ms=3, color=NEW, lw=1.2, label="new")
    top.legend(**_legend(), bbox_to_anchor=(1.0, 1.16), ncols=2)
    difference = new - change.old.at(points)
    low.fill_between(points, difference, color=NEW, alpha=0.25, lw=0)
    low.plot(points, difference, color=NEW, lw=0.9)
    low.set_xlabel(f"{plain_name(change.new.input_axis)}  {change.new.input_unit}", labelpad=2)


def prediction(figure: FigureBase, axis: AxisMaterial, change: TableChange) -> None:
    """The mean of both directions as predicted, with U (k = 2), and as measured after the push.

    A deviation's zero is arbitrary, so the common offset of measured to predicted is taken out.
    """
    panel = ruled(figure)[0, 0]
    wide = not axis.rotary
    figure.subplots_adjust(left=0.075 if wide else 0.12, right=0.99, top=0.87, bottom=0.18)
    calm(panel)
    low, high = change.predicted - change.predicted_U, change.predicted + change.predicted_U
    panel.fill_between(change.targets, low, high, color=OLD, alpha=0.3, lw=0, label="± U (k = 2)")
    panel.plot(change.targets, change.predicted, color=OLD, lw=1.0, label="predicted")
    if axis.after is not None:
        measured = _on_prediction(axis.after, change)
        panel.plot(axis.after.targets, measured, "o", color=NEW, ms=2.8, mew=0, label="measured")
    panel.legend(**_legend(), bbox_to_anchor=(1.0, 1.18 if wide else 1.13), ncols=3)
    panel.set_ylabel(f"deviation  {SIGN[axis.deviation_unit]}")
    panel.set_xlabel(f"{plain_name(axis.letter)}  {axis.unit}", labelpad=2)


def acting(figure: FigureBase, axis: AxisMaterial, outlook: AxisOutlook, *, words: bool) -> None:
    """The axis with every table acting as predicted, U (k = 2), beside its own table alone, and as a check found it.

    Without ``words`` only units are drawn: a caption in the reader's language says the rest.
    """
    panel = ruled(figure)[0, 0]
    figure.subplots_adjust(left=0.075, right=0.99, top=0.87, bottom=0.18)
    calm(panel)
    order = np.argsort(outlook.targets, kind="stable")
    at, curve, U = outlook.targets[order], outlook.deviation[order], outlook.U[order]
    panel.fill_between(at, curve - U, curve + U, color=OLD, alpha=0.3, lw=0, label="± U (k = 2)")
    panel.plot(at, curve, color=OLD, lw=1.0, label="predicted")
    if axis.change is not None and outlook.spoilt:
        own = np.argsort(axis.change.targets, kind="stable")
        alone = axis.change.predicted[own]
        panel.plot(
            axis.change.targets[own], alone, ":", color=INK, lw=1.0, label=render(Message.of("S-DRAW-OWN-ALONE"))
        )
    if axis.acting is not None:
        panel.plot(axis.acting.targets, axis.acting.measured, "o", color=NEW, ms=2.8, mew=0, label="measured")
    if words:
        panel.legend(**_legend(), bbox_to_anchor=(1.0, 1.18), ncols=4)
    panel.set_ylabel(f"{'deviation  ' if words else ''}{SIGN[axis.deviation_unit]}")
    panel.set_xlabel(f"{plain_name(axis.letter)}  {axis.unit if words or not axis.rotary else '°'}", labelpad=2)


def _on_prediction(after: Evaluation, change: TableChange) -> FloatArray:
    order = np.argsort(change.targets, kind="stable")
    expected = np.interp(after.targets, change.targets[order], change.predicted[order])
    offset = mean(after) - expected
    known = offset[np.isfinite(offset)]
    return mean(after) - (float(np.median(known)) if known.size else 0.0)


def mean(evaluation: Evaluation) -> FloatArray:
    """Mean of both directions, shape (m,); where one direction is missing, the other alone."""
    both = np.stack([evaluation.mean_up, evaluation.mean_down])
    count = np.isfinite(both).sum(axis=0)
    total = np.nansum(both, axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def polar(figure: FigureBase, axis: AxisMaterial) -> None:
    """Mean of both directions around the turn on one scale; the dashed circle is zero deviation."""
    panel = figure.add_subplot(projection="polar")
    figure.subplots_adjust(left=0.1, right=0.9, top=0.88, bottom=0.1)
    curves = [
        (item, mean(item), colour, name)
        for item, colour, name in ((axis.before, OLD, "before"), (axis.after, NEW, "after"))
        if item is not None
    ]
    _polar_scale(panel, [values for _item, values, _colour, _name in curves])
    for evaluation, values, colour, name in curves:
        angle, radius = _closed(evaluation.targets, values)
        panel.plot(np.radians(angle), radius, color=colour, lw=1.2, marker="o", ms=2.2, mew=0, label=name)
    panel.legend(**_legend(), bbox_to_anchor=(1.16, 1.12))
    figure.text(0.02, 0.02, SIGN[axis.deviation_unit], color=QUIET, fontsize=8)


def _polar_scale(panel: Axes, curves: list[FloatArray]) -> None:
    low, high = limits(curves)
    panel.set_ylim(low, high)
    if isinstance(panel, PolarAxes):
        # A hollow middle keeps small radii readable: the curve's height counts, not its distance.
        panel.set_rorigin(low - 0.8 * (high - low))
        panel.set_theta_zero_location("N")
        panel.set_rlabel_position(22.5)
    panel.yaxis.set_major_locator(MaxNLocator(4))
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    panel.plot(turn, np.zeros_like(turn), color=QUIET, lw=0.7, ls=(0, (4, 3)))
    panel.grid(True, color=FAINT, lw=0.6)
    panel.spines["polar"].set_color(RULE)
    panel.tick_params(labelsize=8, pad=1)


def _closed(targets: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Join the ends of a curve that goes all the way round."""
    keep = np.isfinite(values)
    angle, radius = targets[keep], values[keep]
    if angle.size < 3 or np.ptp(angle) < 300.0:
        return angle, radius
    return np.append(angle, angle[0] + 360.0), np.append(radius, radius[0])
