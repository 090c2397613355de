"""What a study draws: unrolled flank maps, bars of all errors, pitch around the gear, axes before and after.

Normal deviation is blue below and red above nominal, white at zero; what belongs together has one scale.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Patch
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import MaxNLocator

from drivers.terms import spoken
from drivers.types.values import FloatArray
from drivers.units import mm_to_um
from gateway.correct.plan.layers import AxisCurve
from gateway.gear.flank import FlankGrid
from gateway.sensitivity.screening import RankedInput
from gateway.study.calculate import Study
from gateway.study.describe import tag

INK, QUIET, RULE, FAINT = "#22282e", "#6d757d", "#b4babf", "#e4e7e9"
OLD, MIDDLE, NEW = "#8a9299", "#5f86ab", "#1f4e79"
SIGN = {"um": "µm", "arcsec": "arcsec"}
TAGS = {
    "axis": "#5f86ab",
    "set-up": "#8a9299",
    "cross": "#1f4e79",
    "product": "#7c6a9c",
    "mech": "#a8453a",
    "none": "#c9ced2",
}


def describe_cure() -> dict[str, str]:
    """Each kind of cure in words."""
    return {
        "axis": f"{spoken().own} table",
        "set-up": "set-up value",
        "cross": f"{spoken().cross} table",
        "product": "product table",
        "mech": "mechanical",
        "none": "no effect",
    }


MAP = "RdBu_r"
NOTHING = 1e-6  # um
VISIBLE = 2e-3  # of the largest: smaller bars get no bracket
QUANTILE = 0.999


def flank_maps(figure: Figure, study: Study, states: Sequence[tuple[str, FloatArray]]) -> None:
    """Whole gears unrolled, one above the other on one scale: spaces along, face width up; limits as lines."""
    limit = study.gear.flank.limit_um
    top = max(_largest([_without_rotation(study.grid, e) for _, e in states]), 1.2 * limit)
    panels = figure.subplots(len(states), 1, sharex=True, squeeze=False)[:, 0]
    figure.subplots_adjust(left=0.065, right=0.9, top=0.93, bottom=0.1, hspace=0.32)
    for panel, (title, e) in zip(panels, states, strict=True):
        values = mm_to_um(_without_rotation(study.grid, e))
        draw_unrolled(panel, study.grid.zs, values, top, limit=limit)
        rms, largest = float(np.sqrt(np.mean(values**2))), float(np.max(np.abs(values)))
        panel.set_title(f"{title}   RMS {rms:.2f} µm, largest {largest:.2f} µm", loc="left", color=INK, fontsize=9)
        panel.set_ylabel("z  mm")
    panels[-1].set_xlabel("space; in each the right flank, the bottom, the left flank, in equal arc length")
    scale_bar(figure, list(panels), top, limit)


def one_at_a_time(figure: Figure, study: Study) -> None:
    """One space for each error alone at the paper's size: arc length along, face width up, one scale for all."""
    columns = 7
    rows = int(np.ceil(len(study.alone) / columns))
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    figure.subplots_adjust(left=0.05, right=0.92, top=0.9, bottom=0.09, hspace=0.42, wspace=0.1)
    figure.suptitle(f"{study.gear.name}: each error alone, 5 µm or 0.01 deg, space 0", x=0.05, ha="left", fontsize=10)
    turned = [_without_rotation(study.grid, one.deviation) for one in study.alone]
    top = max(mm_to_um(float(np.max(np.abs(one[0])))) for one in turned)
    arc = study.grid.gear.arc(study.grid.thetas)
    for panel, one, e in zip(panels.flat, study.alone, turned, strict=False):
        _image(panel, mm_to_um(e[0]).T, _edges(arc), _edges(study.grid.zs), top)
        largest = mm_to_um(one.figure.largest)
        text = f"{largest:.2g}" if largest >= NOTHING else "0"
        panel.set_title(f"{one.name}  {text} µm", loc="left", fontsize=8, color=INK, pad=3)
        panel.tick_params(labelsize=6, length=2)
    for panel in panels.flat[len(study.alone) :]:
        panel.set_visible(False)
    for panel in panels[-1, :]:
        panel.set_xlabel("arc  mm", fontsize=7)
    for panel in panels[:, 0]:
        panel.set_ylabel("z  mm", fontsize=7)
    scale_bar(figure, list(panels.flat), top, None)


def draw_ranking(figure: Figure, study: Study, output: str = "rms") -> None:
    """All errors as bars of mu* with their intervals, ranks that cannot be told apart bracketed, cures as colour."""
    panels = figure.subplots(1, 2)
    figure.subplots_adjust(left=0.07, right=0.985, top=0.9, bottom=0.12, wspace=0.16)
    for panel, screening, title in (
        (panels[0], study.equal, "equal steps of 5 µm or 0.01 deg"),
        (panels[1], study.measured, "over each error's own span"),
    ):
        _bars(panel, screening.rankings[output], {name: tag(study, name) for name in study.names})
        panel.set_title(title, loc="left", fontsize=9, color=INK)
        panel.set_xlabel(f"µ* of the {output.upper()} normal deviation  µm   (95 % interval)")
    handles = [Patch(color=colour, label=describe_cure()[name]) for name, colour in TAGS.items()]
    figure.legend(handles=handles, loc="upper right", ncols=6, frameon=False, fontsize=7.5)
    figure.text(
        0.07,
        0.965,
        "colour: what corrects it here; bracket: ranks not separable",
        fontsize=8,
        color=QUIET,
    )


def pitch(figure: Figure, study: Study) -> None:
    """Cumulative pitch deviation of every space, both flanks, as it is and with everything."""
    panels = figure.subplots(2, 1, sharex=True, sharey=True)
    figure.subplots_adjust(left=0.08, right=0.985, top=0.87, bottom=0.11, hspace=0.2)
    figure.text(
        0.08, 0.945, f"{study.gear.name}: cumulative pitch deviation F_k about its mean", fontsize=10, color=INK
    )
    k = np.arange(study.grid.gear.zc)
    for i, (panel, flank) in enumerate(zip(panels, ("left flank", "right flank"), strict=True)):
        _calm(panel)
        for state, colour, label, offset in ((study.before, OLD, "before", -0.2), (study.after, NEW, "after", 0.2)):
            values = state.chart.pitch[i]
            F = mm_to_um(values.F - np.mean(values.F))
            text = f"{label}: F_p {mm_to_um(values.F_p):.2f}, f_p {mm_to_um(values.f_p):.2f} µm"
            panel.bar(k + offset, F, 0.4, color=colour, label=text)
        panel.set_ylabel(f"{flank}  F_k  µm")
        panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False, fontsize=7.5)
    panels[-1].set_xlabel("space")
    panels[-1].set_xlim(-0.8, k.size - 0.2)
    panels[-1].xaxis.set_major_locator(MaxNLocator(integer=True))


def axes_before_after(figure: Figure, curves: Sequence[AxisCurve]) -> None:
    """Each axis' own deviation: as it is, with its own table, with everything; rotary axes around their turn."""
    wide = figure.subfigures(1, len(curves), squeeze=False)[0]
    for part, curve in zip(wide, curves, strict=True):
        (_polar if curve.unit == "arcsec" else _straight)(part, curve)


def draw_unrolled(panel: Axes, heights: FloatArray, values: FloatArray, top: float, *, limit: float = np.inf) -> None:
    """A gear (K, T, Z) in um unrolled: spaces along, heights (Z,) in mm up; lines where a limit is passed."""
    K, T, Z = values.shape
    flat = np.moveaxis(values, -1, 0).reshape(Z, K * T)
    along = (np.arange(K * T + 1) / T) - 0.5
    up = _edges(heights)
    _image(panel, flat, along, up, top)
    middle = 0.5 * (along[1:] + along[:-1])
    for level, style in ((limit, "-"), (-limit, "--")):
        if np.min(flat) < level < np.max(flat):
            panel.contour(middle, heights, flat, levels=[level], colors=INK, linewidths=0.6, linestyles=style)
    panel.set_xlim(-0.5, K - 0.5)
    panel.tick_params(labelsize=7, length=2.5)
    for k in range(1, K):
        panel.axvline(k - 0.5, color="white", lw=0.35)


def _image(panel: Axes, values: FloatArray, along: FloatArray, up: FloatArray, top: float) -> None:
    panel.pcolormesh(along, up, values, cmap=MAP, norm=_norm(top), rasterized=True)
    for spine in panel.spines.values():
        spine.set_color(RULE)


def scale_bar(figure: Figure, panels: list[Axes], top: float, limit: float | None) -> None:
    """The scale of colour in um beside the panels, its limits as lines."""
    box = panels[-1].get_position().y0, panels[0].get_position().y1
    bar = figure.colorbar(ScalarMappable(_norm(top), MAP), cax=figure.add_axes((0.925, box[0], 0.013, box[1] - box[0])))
    bar.ax.tick_params(labelsize=7)
    bar.ax.set_title("µm", fontsize=8, color=QUIET)
    for side in (limit, -limit) if limit is not None else ():
        bar.ax.axhline(side, color=INK, lw=0.9)
    if limit is not None:
        figure.text(0.905, box[0] - 0.055, f"lines: ± {limit:g} µm", fontsize=7, color=QUIET)
    bar.outline.set_edgecolor(RULE)


def _bars(panel: Axes, ranked: Sequence[RankedInput], tags: dict[str, str]) -> None:
    _calm(panel, zero=False)
    panel.grid(False, axis="y")
    y = np.arange(len(ranked))
    values = mm_to_um(np.array([one.mu_star for one in ranked]))
    low, high = (mm_to_um(np.array([getattr(one, key) for one in ranked])) for key in ("low", "high"))
    panel.barh(y, values, color=[TAGS[tags[one.name]] for one in ranked], height=0.66)
    panel.hlines(y, low, high, color=INK, lw=1.0)
    panel.set_yticks(y, [one.name for one in ranked], fontsize=7)
    panel.invert_yaxis()
    edge = float(np.max(high, initial=0.0)) or 1.0
    for first, last, column in _groups(ranked):
        x = edge * (1.04 + 0.035 * column)
        panel.plot([x - 0.008 * edge, x, x, x - 0.008 * edge], [first, first, last, last], color=QUIET, lw=0.9)
    panel.set_xlim(0.0, 1.3 * edge)


def _groups(ranked: Sequence[RankedInput]) -> list[tuple[int, int, int]]:
    """Runs of neighbours that cannot be told apart from the first of them: (first, last, column)."""
    found: list[tuple[int, int, int]] = []
    reach = -1
    for i, one in enumerate(ranked):
        if one.mu_star <= VISIBLE * ranked[0].mu_star:
            break
        last = i
        while last + 1 < len(ranked) and ranked[last + 1].name in one.tied_with:
            last += 1
        if last > max(i, reach):
            taken = {column for first, end, column in found if end >= i}
            found.append((i, last, next(c for c in range(len(ranked)) if c not in taken)))
            reach = last
    return found


def _straight(part: SubFigure, curve: AxisCurve) -> None:
    panel = part.subplots(1, 1)
    part.subplots_adjust(left=0.19, right=0.97, top=0.78, bottom=0.14)
    _calm(panel)
    for values, colour, label, style in _three(curve):
        panel.plot(curve.at, values, color=colour, lw=1.2, ls=style, label=label)
    panel.set_xlabel(f"{curve.axis}  mm")
    panel.set_ylabel("deviation  µm")
    part.legend(loc="upper left", frameon=False, fontsize=7)


def _polar(part: SubFigure, curve: AxisCurve) -> None:
    panel = part.add_subplot(projection="polar")
    part.subplots_adjust(left=0.08, right=0.92, top=0.74, bottom=0.08)
    values = np.concatenate([one for one, _, _, _ in _three(curve)])
    low, high = float(min(np.min(values), 0.0)), float(max(np.max(values), 0.0))
    room = 0.08 * (high - low) or 1.0
    panel.set_ylim(low - room, high + room)
    if isinstance(panel, PolarAxes):
        panel.set_rorigin(low - 0.8 * (high - low) - room)
        panel.set_theta_zero_location("N")
        panel.set_rlabel_position(22.5)
    turn = np.radians(curve.at)
    panel.plot(turn, np.zeros_like(turn), color=QUIET, lw=0.7, ls=(0, (4, 3)))
    for one, colour, label, style in _three(curve):
        panel.plot(turn, one, color=colour, lw=1.2, ls=style, label=label)
    panel.yaxis.set_major_locator(MaxNLocator(4))
    panel.grid(True, color=FAINT, lw=0.6)
    panel.tick_params(labelsize=6.5, pad=1)
    part.legend(loc="upper left", frameon=False, fontsize=7)
    part.text(0.02, 0.02, f"{curve.axis}  {SIGN[curve.unit]}", fontsize=8, color=QUIET)


def _three(curve: AxisCurve) -> list[tuple[FloatArray, str, str, str]]:
    unit = SIGN[curve.unit]

    def label(name: str, values: FloatArray) -> str:
        return f"{name}  range {float(np.ptp(values)):.2f} {unit}"

    return [
        (curve.before, OLD, label("present state", curve.before), "-"),
        (curve.own_layer, MIDDLE, label(f"with {spoken().own}", curve.own_layer), "-"),
        (curve.predicted, NEW, label(f"with {spoken().own} and {spoken().cross}", curve.predicted), "--"),
    ]


def _without_rotation(grid: FlankGrid, e: FloatArray) -> FloatArray:
    """Deviations less one rotation of the gear, as the flank figure counts them."""
    lever = np.broadcast_to(grid.section.h, e.shape)
    return np.asarray(e - lever * (float(np.sum(lever * e)) / float(np.sum(lever**2))))


def _largest(parts: Sequence[FloatArray]) -> float:
    return mm_to_um(float(np.quantile(np.abs(np.concatenate([part.ravel() for part in parts])), QUANTILE)))


def _norm(top: float) -> Normalize:
    return Normalize(-top, top)


def _edges(middles: FloatArray) -> FloatArray:
    if middles.size == 1:
        return np.array([middles[0] - 0.5, middles[0] + 0.5])
    between = 0.5 * (middles[1:] + middles[:-1])
    return np.concatenate([[2.0 * middles[0] - between[0]], between, [2.0 * middles[-1] - between[-1]]])


def _calm(panel: Axes, *, zero: bool = True) -> None:
    panel.grid(True, color=FAINT, lw=0.5)
    panel.set_axisbelow(True)
    if zero:
        panel.axhline(0.0, color=RULE, lw=0.8, zorder=1)
    panel.spines[["top", "right"]].set_visible(False)
    panel.tick_params(length=2.5, width=0.6, labelsize=7)
