"""Drawn figures, shown by a notebook and written as PNG: curves of an axis, flank sheets, results of a screening."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from drivers.types.tables import CompensationTable
from drivers.types.values import FloatArray
from gateway.errors import StoreError
from gateway.gear.cycloid import CycloidGear
from gateway.study import drawing
from gateway.study.drawing import FAINT, INK, MIDDLE, NEW, OLD, QUIET, RULE, draw_unrolled, scale_bar

DPI = 160
STYLE: dict[Any, Any] = {
    "font.size": 8.0,
    "text.parse_math": False,
    "axes.linewidth": 0.6,
    "axes.edgecolor": drawing.RULE,
    "axes.labelcolor": drawing.INK,
    "xtick.labelcolor": drawing.INK,
    "ytick.labelcolor": drawing.INK,
}
FULL = 1.08  # of what is drawn: the limits of a box in space
Paint = Callable[[Figure], None]


class Sheet(Figure):
    """A matplotlib figure that a notebook shows without a window or a magic word."""

    def _repr_png_(self) -> bytes:
        kept = BytesIO()
        with mpl.rc_context(STYLE):
            self.savefig(kept, format="png", metadata={"Software": None})
        return kept.getvalue()


def new_sheet(size: tuple[float, float], paint: Paint) -> Sheet:
    """A sheet of that size in inches, painted."""
    with mpl.rc_context(STYLE):
        sheet = Sheet(figsize=size, dpi=DPI, facecolor="white")
        FigureCanvasAgg(sheet)
        paint(sheet)
    return sheet


def write_sheet(path: Path, size: tuple[float, float], paint: Paint) -> Path:
    """A sheet as a PNG file. Raises StoreError E-STUDY-WRITE."""
    sheet = new_sheet(size, paint)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with mpl.rc_context(STYLE):
            sheet.savefig(path, format="png", metadata={"Software": None})
    except OSError as error:
        raise StoreError("E-STUDY-WRITE", str(path.parent), why=error.strerror or str(error)) from error
    return path


def in_space(panel: Any, points: FloatArray, *, zoom: float = 1.0) -> None:
    """Limits of a 3-D panel about points (..., 3) with equal scales, so that a right angle looks right."""
    flat = points.reshape(-1, 3)
    low, high = flat.min(axis=0), flat.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * FULL * np.maximum(high - low, 1e-9)
    for set_limits, at, room in zip((panel.set_xlim, panel.set_ylim, panel.set_zlim), middle, half, strict=True):
        set_limits(at - room, at + room)
    panel.set_box_aspect(half / half.max(), zoom=zoom)


def calm_space(panel: Any) -> None:
    """Faint walls and small figures of a 3-D panel."""
    for axis in (panel.xaxis, panel.yaxis, panel.zaxis):
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        axis.line.set_color(drawing.RULE)
        axis._axinfo["grid"].update(color=drawing.FAINT, linewidth=0.5)  # noqa: SLF001  matplotlib has no other way
    panel.tick_params(labelsize=6, pad=0)


# ---- Curves of an axis: error motions with what is known of their uncertainty, readings before and after.

SIGN = {"um": "µm", "arcsec": "arcsec"}
COLOURS = (NEW, "#4b7f52", "#a8453a")
SCATTERED = 3  # readings of a target in one direction: fewer show no scatter


@dataclass(frozen=True)
class MotionCurve:
    """One error motion over its axis: positions (n,) in mm or deg, values and half widths U (k = 2) in its unit."""

    name: str
    axis: str
    unit: str
    axis_unit: str
    at: FloatArray
    values: FloatArray
    U: FloatArray


def motion_panels(figure: Figure, curves: Sequence[MotionCurve], title: str, note: str) -> None:
    """Every axis in a row: its shifts on the left in um, its turns on the right in arcsec."""
    axes = list(dict.fromkeys(one.axis for one in curves))
    panels = figure.subplots(len(axes), 2, squeeze=False)
    figure.subplots_adjust(left=0.075, right=0.985, top=0.89, bottom=0.075, hspace=0.42, wspace=0.16)
    figure.text(0.075, 0.96, title, fontsize=10, color=INK)
    figure.text(0.075, 0.93, note, fontsize=8, color=QUIET)
    for side, unit in enumerate(("um", "arcsec")):
        for row, axis in enumerate(axes):
            panel = panels[row][side]
            _calm(panel)
            found = [one for one in curves if (one.axis, one.unit) == (axis, unit)]
            for one, colour in zip(found, COLOURS, strict=False):
                panel.fill_between(one.at, one.values - one.U, one.values + one.U, color=colour, alpha=0.15, lw=0)
                panel.plot(one.at, one.values, color=colour, lw=1.2, label=one.name)
            panel.set_ylabel(SIGN[unit], labelpad=1)
            panel.set_xlabel(f"{axis}  {found[0].axis_unit if found else ''}", labelpad=1)
            panel.legend(loc="upper right", ncols=3, frameon=False, fontsize=7.5, bbox_to_anchor=(1.0, 1.16))


def readings_panel(panel: Axes, targets: FloatArray, deviations: FloatArray, label: str, *, new: bool = False) -> None:
    """Readings (m, n, 2) as points, a direction's mean as a line, 2 s as a band: forward solid, reverse dashed."""
    colours = (NEW, MIDDLE) if new else (QUIET, OLD)
    for way, (line, mark, name) in enumerate((("-", ">", "forward"), ("--", "<", "reverse"))):
        one = deviations[:, :, way]
        there = np.isfinite(one).any(axis=1)
        if not there.any():
            continue
        at = np.broadcast_to(targets[:, None], one.shape)
        panel.plot(at.ravel(), one.ravel(), mark, color=colours[way], ms=2.2, alpha=0.6, mew=0)
        mean = np.nanmean(one[there], axis=1)
        if np.isfinite(one[there]).sum(axis=1).min() >= SCATTERED:
            s = 2.0 * np.nanstd(one[there], axis=1, ddof=1)
            panel.fill_between(targets[there], mean - s, mean + s, color=colours[way], alpha=0.15, lw=0)
        panel.plot(targets[there], mean, line, color=colours[way], lw=1.2, label=f"{label}{name}")


def readings_sheet(
    figure: Figure,
    label: tuple[str, str],
    before: tuple[FloatArray, FloatArray],
    after: tuple[FloatArray, FloatArray] | None = None,
    *,
    title: str = "",
) -> None:
    """Readings of an axis, and those after its correction on the same scale; ``label`` of positions and deviations."""
    panel = figure.subplots(1, 1)
    figure.subplots_adjust(left=0.085, right=0.985, top=0.84, bottom=0.13)
    _calm(panel)
    readings_panel(panel, *before, label="" if after is None else "before, ", new=after is None)
    if after is not None:
        readings_panel(panel, *after, label="after, ", new=True)
    panel.set_xlabel(label[0])
    panel.set_ylabel(label[1])
    panel.legend(loc="lower right", ncols=4, frameon=False, fontsize=7.5, bbox_to_anchor=(1.0, 1.0))
    figure.text(0.085, 0.95, title, fontsize=10, color=INK, va="top")


@dataclass(frozen=True)
class Measurement:
    """Readings of one error motion: targets (m,) in mm or deg, deviations (m, n, 2), and those after its correction."""

    title: str
    axis: str
    axis_unit: str
    unit: str
    before: tuple[FloatArray, FloatArray]
    after: tuple[FloatArray, FloatArray] | None = None


def measured_panels(figure: Figure, found: Sequence[Measurement], title: str, note: str) -> None:
    """What was read of every error motion before anything was corrected, a panel each, on scales of their own."""
    columns = 3
    rows = -(-len(found) // columns) or 1
    panels = figure.subplots(rows, columns, squeeze=False)
    tall = float(figure.get_figheight())
    figure.subplots_adjust(left=0.06, right=0.985, top=1.0 - 0.95 / tall, bottom=0.45 / tall, hspace=0.75, wspace=0.24)
    _add_heading(figure, title, note, 0.06)
    for panel in panels.flat[len(found) :]:
        panel.set_visible(False)
    for panel, one in zip(panels.flat, found, strict=False):
        _calm(panel)
        readings_panel(panel, *one.before, label="", new=True)
        panel.set_title(one.title, loc="left", fontsize=8.5, color=INK)
        panel.set_xlabel(f"{one.axis}  {one.axis_unit}", labelpad=1)
        panel.set_ylabel(SIGN[one.unit], labelpad=1)
    handles, names = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, names, loc="upper right", ncols=2, frameon=False, fontsize=7.5)


def measured_pairs(figure: Figure, found: Sequence[Measurement], title: str, note: str) -> None:
    """A row an axis: readings before and after on one scale, and those after alone on a scale where they are seen."""
    panels = figure.subplots(len(found), 2, squeeze=False)
    tall = float(figure.get_figheight())
    figure.subplots_adjust(left=0.06, right=0.985, top=1.0 - 1.05 / tall, bottom=0.45 / tall, hspace=0.62, wspace=0.14)
    _add_heading(figure, title, note, 0.06)
    for row, one in zip(panels, found, strict=True):
        for panel, head in zip(row, ("before and after", "after alone, its own scale"), strict=True):
            _calm(panel)
            panel.set_title(f"{one.title}, {head}", loc="left", fontsize=8.5, color=INK)
            panel.set_xlabel(f"{one.axis}  {one.axis_unit}", labelpad=1)
            panel.set_ylabel(SIGN[one.unit], labelpad=1)
        readings_panel(row[0], *one.before, label="before, ")
        if one.after is not None:
            for panel in row:
                readings_panel(panel, *one.after, label="after, ", new=True)
    handles, names = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, names, loc="upper right", ncols=4, frameon=False, fontsize=7.5)


def _add_heading(figure: Figure, title: str, note: str, left: float) -> None:
    """Title and note at the head, a fixed way below the top edge whatever the height."""
    tall = float(figure.get_figheight())
    figure.text(left, 1.0 - 0.28 / tall, title, fontsize=10, color=INK)
    figure.text(left, 1.0 - 0.50 / tall, note, fontsize=8, color=QUIET)


def curve_sheet(figure: Figure, curve: MotionCurve) -> None:
    """One error motion with its band."""
    panel = figure.subplots(1, 1)
    figure.subplots_adjust(left=0.095, right=0.985, top=0.87, bottom=0.14)
    _calm(panel)
    low, high = curve.values - curve.U, curve.values + curve.U
    panel.fill_between(curve.at, low, high, color=NEW, alpha=0.17, lw=0, label="± U (k = 2)")
    panel.plot(curve.at, curve.values, color=NEW, lw=1.3, label=curve.name)
    panel.set_xlabel(f"{curve.axis}  {curve.axis_unit}")
    panel.set_ylabel(f"{curve.name}  {SIGN[curve.unit]}")
    panel.margins(y=0.1)
    text = f"{curve.name} as fitted, range {float(np.ptp(curve.values)):.2f} {SIGN[curve.unit]}"
    figure.text(0.095, 0.93, text, fontsize=10, color=INK)
    panel.legend(loc="lower right", ncols=2, frameon=False, fontsize=8, bbox_to_anchor=(1.0, 1.0))


def table_panels(figure: Figure, tables: Sequence[CompensationTable]) -> None:
    """Every table's points with the straight lines between them."""
    rows = -(-len(tables) // 3) or 1
    panels = figure.subplots(rows, 3, squeeze=False)
    figure.subplots_adjust(left=0.07, right=0.985, top=1.0 - 0.17 / rows, bottom=0.2 / rows, hspace=0.75, wspace=0.25)
    for panel in panels.flat[len(tables) :]:
        panel.set_visible(False)
    for panel, one in zip(panels.flat, tables, strict=False):
        _calm(panel)
        panel.plot(one.positions, one.deviations, ".-", color=NEW, lw=1.0, ms=3)
        kind = "axis table" if one.kind == "axis" else "cross table"
        panel.set_title(f"{kind} {one.name}", loc="left", fontsize=8.5, color=INK)
        panel.set_xlabel(f"{one.input_axis}  {one.input_unit}", labelpad=1)
        panel.set_ylabel(f"{one.output_axis}  {SIGN[one.deviation_unit]}", labelpad=1)


def bars_sheet(
    figure: Figure,
    names: Sequence[str],
    values: Sequence[float],
    spread: Sequence[float | None],
    *,
    label: str,
    title: str,
    note: str,
) -> None:
    """Named values as bars with half widths where there are some, each value written above its bar."""
    panel = figure.subplots(1, 1)
    tall = float(figure.get_figheight())
    figure.subplots_adjust(left=0.085, right=0.985, top=1.0 - 0.72 / tall, bottom=0.3 / tall)
    _add_heading(figure, title, note, 0.085)
    _calm(panel)
    panel.grid(False, axis="x")
    at, half = np.arange(len(names)), np.array([one or 0.0 for one in spread])
    panel.bar(at, values, 0.5, color=MIDDLE)
    known = half > 0.0
    panel.errorbar(
        at[known], np.asarray(values)[known], yerr=half[known], fmt="none", ecolor=INK, elinewidth=1.0, capsize=3.0
    )
    reach = float(np.max(np.asarray(values) + half, initial=0.0)) - min(float(np.min(values, initial=0.0)), 0.0) or 1.0
    for x, value, one in zip(at.tolist(), values, half.tolist(), strict=True):
        text = f"{value:.2f}" + (f" ± {one:.2f}" if one > 0.0 else "")
        panel.text(x, max(value + one, 0.0) + 0.03 * reach, text, fontsize=7.5, color=INK, ha="center", va="bottom")
    panel.set_ylim(top=float(np.max(np.asarray(values) + half, initial=0.0)) + 0.18 * reach)
    panel.set_xlim(-0.6, len(names) - 0.4)
    panel.set_xticks(at, names)
    panel.set_ylabel(label)


def _calm(panel: Axes) -> None:
    panel.grid(True, color=FAINT, lw=0.5)
    panel.set_axisbelow(True)
    panel.axhline(0.0, color=RULE, lw=0.8, zorder=1)
    panel.spines[["top", "right"]].set_visible(False)
    panel.tick_params(length=2.5, width=0.6, labelsize=7)


# ---- Flanks as a gear laboratory prints them: maps, profile and lead traces with their lines, pitch bars, values.


def one_map(figure: Figure, gear: CycloidGear, deviation: FloatArray, heights: FloatArray) -> None:
    """All spaces unrolled, um: deviation (K, T, Z), heights (Z,) in mm."""
    panel = figure.subplots(1, 1)
    figure.subplots_adjust(left=0.06, right=0.9, top=0.86, bottom=0.22)
    top = float(np.max(np.abs(deviation))) or 1.0
    draw_unrolled(panel, heights, deviation, top)
    rms = float(np.sqrt(np.mean(deviation**2)))
    panel.set_title(
        f"normal deviation, {gear.zc} spaces   RMS {rms:.2f} µm, largest {np.max(np.abs(deviation)):.2f} µm",
        loc="left", fontsize=9, color=INK,
    )  # fmt: skip
    panel.set_ylabel("z  mm")
    panel.set_xlabel("space; in each the right flank, the bottom, the left flank, in equal arc length")
    scale_bar(figure, [panel], top, None)


# ---- The paper's figure 5: normalised mean and standard deviation of the elementary effects, with their intervals.


def screening_bars(figure: Figure, rows: Sequence[Mapping[str, float | str]], output: str) -> None:
    """Shares of mu* (left) and sigma (right) by error; above the same in um. Rows as `gateway.study.paper` has them."""
    left, right = figure.subplots(1, 2, sharey=True)
    figure.subplots_adjust(left=0.07, right=0.985, top=0.8, bottom=0.11, wspace=0.07)
    names = [str(one["name"]) for one in rows]
    for panel, key, colour, label in (
        (left, "mu_star", NEW, "µ*  mean size of the effect"),
        (right, "sigma", OLD, "σ  standard deviation of the effects"),
    ):
        values, low, high = (_column(rows, f"{key}{end}_um") for end in ("", "_low", "_high"))
        total = float(np.sum(values)) or 1.0
        _bars(panel, names, (values / total, low / total, high / total), colour)
        panel.set_xlabel(f"{label}, normalised: share of their sum")
        above = panel.secondary_xaxis("top", functions=(lambda x, t=total: x * t, lambda x, t=total: x / t))
        above.set_xlabel("µm", fontsize=8)
        above.tick_params(labelsize=7, length=2.5)
    figure.text(
        0.07, 0.945, f"sensitivity of the {output} to the errors, one step of 5 µm or 0.01 deg", fontsize=10, color=INK
    )
    note = "bars: value; lines: 95 % interval (bootstrap over trajectories); large σ: the effect depends on the others"
    figure.text(0.07, 0.905, note, fontsize=8, color=QUIET)


def _bars(panel: Axes, names: Sequence[str], shares: tuple[FloatArray, ...], colour: str) -> None:
    y, (values, low, high) = np.arange(len(names)), shares
    panel.barh(y, values, height=0.66, color=colour)
    panel.hlines(y, low, high, color=INK, lw=1.0)
    panel.set_yticks(y, names, fontsize=7.5)
    panel.set_ylim(len(names) - 0.4, -0.6)
    panel.set_xlim(0.0, 1.06 * (float(np.max(high, initial=0.0)) or 1.0))
    panel.grid(True, axis="x", color=FAINT, lw=0.5)
    panel.set_axisbelow(True)
    panel.axvline(0.0, color=RULE, lw=0.8)
    panel.spines["right"].set_visible(False)
    panel.tick_params(length=2.5, width=0.6)


def _column(rows: Sequence[Mapping[str, float | str]], key: str) -> FloatArray:
    return np.array([float(one[key]) for one in rows])
