"""Flank maps and their small charts onto given matplotlib figures; maps that belong together have one scale.

Normal deviation is blue below and red above nominal, white at zero; grey is before, dark blue after.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from drivers.message import words
from drivers.terms import shown
from drivers.types.values import FloatArray
from gateway.report.drawings.curves import NEW, OLD, RULE, calm, limits, plain_name
from gateway.report.drawings.ruler import INK, QUIET, RuledPanel, Ruler, ruled
from gateway.report.tooth.flank import FlankState, Traces, top_of, traces
from gateway.tooth import FlankMap

MAP = "RdBu_r"
MOST_TICKS = 11
LIGHT = "#c58a3a"


def flank_maps(figure: Figure, found: Sequence[FlankState]) -> None:
    """Whole gears unrolled, one above the other on one scale: spaces along, face width up."""
    top = top_of(found)
    height = float(figure.get_size_inches()[1])
    panels = ruled(figure, len(found), 1, sharex=True)[:, 0]
    figure.subplots_adjust(left=0.058, right=0.915, top=1.0 - 0.24 / height, bottom=0.42 / height, hspace=0.5)
    for panel, one in zip(panels, found, strict=True):
        unrolled(panel, one.map, top)
        panel.set_title(_caption(one, top), loc="left", color=INK, fontsize=8.5, pad=3)
        panel.set_ylabel("z  mm", fontsize=8, labelpad=2)
    panels[-1].set_xlabel(words("S-DRAW-SPACES"))
    _scale(figure, panels[-1].get_position().y0, panels[0].get_position().y1, top)


def _caption(one: FlankState, top: float) -> str:
    largest = float(np.max(np.abs(one.map.deviation_um)))
    beyond = words("S-DRAW-BEYOND") if largest > top else ""
    # What is to be expected of a predicted flank is more than its map's RMS: that figure stands with its U elsewhere.
    rms = "" if one.key == "predicted" else f"RMS {one.map.rms_um:.2f} um,  "
    text = plain_name(f"{one.text}:  {rms}largest {largest:.2f} um{beyond}")
    return shown(text)


def unrolled(panel: Axes, flank: FlankMap, top: float) -> None:
    """One map (K, T, Z) with all spaces side by side, colours from -top to +top um."""
    K, T, Z = flank.deviation_um.shape
    values = np.moveaxis(flank.deviation_um, -1, 0).reshape(Z, K * T)
    along = np.arange(K * T + 1) / T - 0.5
    panel.pcolorfast(along, edges(flank.z_mm), values, cmap=MAP, norm=norm(top))
    panel.set_xlim(-0.5, K - 0.5)
    panel.xaxis.set_major_locator(MaxNLocator(MOST_TICKS, integer=True))
    panel.yaxis.set_major_locator(MaxNLocator(3))
    Ruler(panel, grid="")
    for spine in panel.spines.values():
        spine.set_color(RULE)
    between = np.arange(1, K) - 0.5
    panel.vlines(between, 0.0, 1.0, transform=panel.get_xaxis_transform(), color=QUIET, lw=0.25, alpha=0.6)


def norm(top: float) -> Normalize:
    """Colours from -top to +top, zero in the middle."""
    return Normalize(-top, top)


def edges(middles: FloatArray) -> FloatArray:
    """Borders of cells around their middles."""
    if middles.size == 1:
        return np.array([middles[0] - 0.5, middles[0] + 0.5])
    between = 0.5 * (middles[1:] + middles[:-1])
    return np.concatenate([[2.0 * middles[0] - between[0]], between, [2.0 * middles[-1] - between[-1]]])


def _scale(figure: Figure, low: float, high: float, top: float) -> None:
    place = figure.add_axes((0.937, low, 0.014, high - low))
    bar = figure.colorbar(ScalarMappable(norm(top), MAP), cax=place, ticks=[-top, -top / 2, 0.0, top / 2, top])
    bar.ax.set_yticklabels([f"{value:+g}" if value else "0" for value in (-top, -top / 2, 0.0, top / 2, top)])
    bar.ax.tick_params(labelsize=8, length=2, pad=2)
    bar.ax.set_title("µm", fontsize=8.5, color=QUIET, pad=3)
    bar.outline.set_edgecolor(RULE)
    if bar.solids is not None:
        bar.solids.set_rasterized(True)


def charts(figure: Figure, states: Sequence[FlankState]) -> None:
    """Profile, lead, pitch of both flanks and runout of some states, all on one scale of deviation."""
    grid = figure.add_gridspec(2, 3, left=0.075, right=0.99, top=0.88, bottom=0.1, hspace=0.5, wspace=0.2)
    panels = [figure.add_subplot(grid[row, column], axes_class=RuledPanel) for row in (0, 1) for column in (0, 1, 2)]
    titles = ("Profile", "Pitch, left flank", "Pitch, right flank", "Runout", "Lead, left flank", "Lead, right flank")
    for panel, text in zip(panels, titles, strict=True):
        calm(panel)
        panel.set_title(text, loc="left", color=QUIET, pad=3)
    for state in states:
        _draw_traces(panels, state, traces(state.map))
    for panel in (panels[0], panels[3]):
        panel.set_ylabel("deviation  µm")
    _profile_axis(panels[0], states[0].map)
    for panel in panels[4:]:
        panel.set_xlabel("z  mm", labelpad=2)
    for panel in panels[1:4]:
        panel.set_xlabel("space number", labelpad=2)
        panel.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    _one_scale(panels, [traces(one.map) for one in states])
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper right", ncols=4, frameon=False, fontsize=8, labelcolor=INK)


STYLE = {
    "before": (OLD, "-", 0.9),
    "before-set-right": (OLD, "-", 1.2),
    "model-before": (OLD, "-", 1.2),
    "model-set-right": (OLD, "-", 1.2),
    "predicted": (LIGHT, "--", 1.1),
    "after": (NEW, "-", 1.3),
}


def _draw_traces(panels: Sequence[Axes], state: FlankState, found: Traces) -> None:
    colour, line, width = STYLE.get(state.key, (NEW, "-", 1.2))
    look: dict[str, Any] = {"color": colour, "lw": width}
    T = state.map.theta_rad.size
    panels[0].plot((np.arange(T) + 0.5) / T * 2.0 - 1.0, found.profile, line, label=_label(state), **look)
    k = np.arange(found.runout.size)
    for panel, values in zip(panels[1:4], (*found.pitch, found.runout), strict=True):
        panel.plot(k, values, line, marker="o", ms=1.6, mew=0, **look)
    for panel, values in zip(panels[4:], found.lead, strict=True):
        panel.plot(state.map.z_mm, values, line, **look)


def _label(state: FlankState) -> str:
    return plain_name(f"predicted {state.title}" if state.key == "predicted" else state.title)


def _profile_axis(panel: Axes, flank: FlankMap) -> None:
    low, high = np.degrees(flank.theta_rad[0]), np.degrees(flank.theta_rad[-1])
    panel.set_xticks([-1.0, 0.0, 1.0], [f"right {low:.2f}", "bottom 0", f"left {high:.2f}"])
    panel.set_xlabel("profile angle  deg", labelpad=2)


def _one_scale(panels: Sequence[Axes], found: Sequence[Traces]) -> None:
    low, high = limits([part.ravel() for one in found for part in (one.profile, one.lead, one.pitch, one.runout)])
    for panel in panels:
        panel.set_ylim(low, high)
