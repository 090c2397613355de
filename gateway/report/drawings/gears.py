"""The gear before and after, side by side on one scale: each flank laid out around the profile, in colours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from drivers.message import words
from drivers.types.values import FloatArray
from gateway.gear.cycloid import CycloidGear
from gateway.report.drawings.curves import NEW, RULE
from gateway.report.drawings.flank import MAP, edges, norm
from gateway.report.drawings.ruler import INK, QUIET
from gateway.report.tooth.flank import FlankState, top_of
from gateway.tooth import FlankMap

BODY = "#dfe3e7"
FOLD = 0.34  # of the profile's radius: how far the face width is laid out
CENTRES = (0.25, 0.72)
NAMES = ("Before", "After")
BIG: dict[str, Any] = {"fontsize": 16, "weight": "bold"}


def gears(figure: Figure, pair: Sequence[FlankState], gear: CycloidGear, *, said: bool = True) -> None:
    """Two gears with their flanks (K, T, Z) folded outward, the RMS of each in its middle, one scale of colour, um.

    Without ``said`` no word is drawn, for a caption in another language.
    """
    top = top_of(pair)
    wide, high = (float(size) for size in figure.get_size_inches())
    side = 0.86 * high / wide
    for centre, one, name in zip(CENTRES, pair, NAMES, strict=True):
        panel = figure.add_axes((centre - 0.5 * side, 0.02, side, 0.86))
        _gear(panel, one.map, gear, top)
        panel.text(0, 0.05 if said else 0.0, f"{one.rms:.2f} µm", ha="center", va="center", **BIG, color=NEW)
        if said:
            figure.text(centre, 0.925, name, ha="center", fontsize=19, weight="bold", color=INK)
            panel.text(0, -0.14, words("S-DRAW-FLANKS-RMS"), ha="center", va="center", fontsize=9.5, color=QUIET)
    middle = 0.5 * sum(CENTRES)
    figure.text(middle, 0.45, "→", ha="center", va="center", fontsize=34, color=NEW)
    _colours(figure, top, said=said)


def _gear(panel: Axes, flank: FlankMap, gear: CycloidGear, top: float) -> None:
    """One gear in units of its largest radius; the flanks of space k as one strip around its profile."""
    panel.set_aspect("equal")
    panel.set_xlim(-1.0 - FOLD, 1.0 + FOLD)
    panel.set_ylim(-1.0 - FOLD, 1.0 + FOLD)
    panel.axis("off")
    along = edges(flank.theta_rad)
    spaces = gear.space(along[None, :], np.arange(flank.deviation_um.shape[0])[:, None])
    radius = float(np.max(np.hypot(spaces.x, spaces.y)))
    outline = np.stack([spaces.x.ravel(), spaces.y.ravel()]) / radius
    panel.fill(*outline, facecolor=BODY, edgecolor=RULE, lw=0.6)
    panel.add_patch(Circle((0.0, 0.0), 0.56, facecolor="white", edgecolor=RULE, lw=0.8))
    out = 1.0 + FOLD * np.linspace(0.06, 1.0, flank.z_mm.size + 1)
    x, y = outline[:, :, None] * out
    # One net for all spaces; between two of them a column of it holds no value and is not drawn.
    gap = ((0, 0), (0, 1), (0, 0))
    deviation = np.pad(flank.deviation_um, gap, constant_values=np.nan).reshape(-1, flank.z_mm.size)[:-1]
    mesh = panel.pcolormesh(x, y, deviation, cmap=MAP, norm=norm(top), rasterized=True)
    mesh.set_edgecolor("face")
    for end in (out[0], out[-1]):
        panel.plot(*_closed(outline * end), color=QUIET, lw=0.5)


def _closed(outline: FloatArray) -> FloatArray:
    return np.concatenate([outline, outline[:, :1]], axis=1)


def _colours(figure: Figure, top: float, *, said: bool) -> None:
    place = figure.add_axes((0.955, 0.16, 0.011, 0.58))
    bar = figure.colorbar(ScalarMappable(norm(top), MAP), cax=place, ticks=[-top, 0.0, top])
    bar.ax.set_yticklabels([f"{-top:+g}", "0", f"{top:+g}"])
    bar.ax.tick_params(labelsize=9, length=2, pad=2)
    bar.outline.set_edgecolor(RULE)
    figure.text(0.962, 0.835, "µm", ha="center", fontsize=10, color=INK)
    if said:
        figure.text(0.962, 0.775, "surplus", ha="center", fontsize=9, color=QUIET)
        figure.text(0.962, 0.085, "missing", ha="center", fontsize=9, color=QUIET)
