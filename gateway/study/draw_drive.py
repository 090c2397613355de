"""What a customer sees of a drive: its error over a turn, the orders of it as bars, and what the gear does to it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes

from drivers.types.values import FloatArray
from gateway.reducer.figures import Transmission

INK, QUIET, RULE, FAINT = "#22282e", "#6d757d", "#b4babf", "#e4e7e9"
OLD, NEW = "#a8453a", "#1f4e79"
BARS = 10


def transmission_picture(figure: Figure, states: Mapping[str, Transmission], depth: Mapping[str, FloatArray]) -> None:
    """The machine as it is in red and with everything in blue; ``depth`` are mean deviations by space (K,), um.

    Above the curve over one output turn, under load, torque counter-clockwise; below its largest orders by cause, and
    the disc's spaces as a circle that is drawn out by their mean deviation.
    """
    grid = figure.add_gridspec(2, 3, height_ratios=(1.0, 1.1), hspace=0.42, wspace=0.3)
    figure.subplots_adjust(left=0.07, right=0.97, top=0.9, bottom=0.09)
    before, after = states["before"], states["after"]
    shown = (("present state", before, OLD), ("with tables and set-up values", after, NEW))
    _curves(figure.add_subplot(grid[0, :]), shown)
    _orders(figure.add_subplot(grid[1, :2]), before, after)
    panel = figure.add_subplot(grid[1, 2], projection="polar")
    if isinstance(panel, PolarAxes):
        _polar(panel, depth)
    figure.suptitle(
        f"{before.drive.name} at {before.torque_nm:.4g} Nm: predicted, not tested; without friction",
        x=0.07, ha="left", fontsize=10, color=INK,
    )  # fmt: skip


def _curves(panel: Axes, shown: tuple[tuple[str, Transmission, str], ...]) -> None:
    for label, one, colour in shown:
        curve = one.loaded[0]
        turned = np.linspace(0.0, 360.0, curve.error_arcsec.size, endpoint=False)
        text = f"{label}: {one.error_arcsec:.1f} arcsec p-p, lost motion {one.lost_motion:.0f} arcsec"
        panel.plot(turned, curve.error_arcsec, color=colour, linewidth=0.9, label=text)
    panel.set_xlim(0.0, 360.0)
    panel.set_xticks(range(0, 361, 60))
    panel.set_xlabel("output turned  deg", color=INK)
    panel.set_ylabel("transmission error  arcsec", color=INK)
    panel.grid(color=FAINT, linewidth=0.6)
    panel.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False, fontsize=8, ncols=2, borderaxespad=0.2)
    _plain(panel)


def _orders(panel: Axes, before: Transmission, after: Transmission) -> None:
    numbers = sorted({one.number for one in (*before.orders(BARS), *after.orders(3))})[: BARS + 3]
    names = {one.number: one.cause for t in (before, after) for one in t.orders(BARS + 3)}
    at = np.arange(len(numbers))
    for shift, one, colour in ((-0.2, before, OLD), (0.2, after, NEW)):
        sizes = one.loaded[0].amplitudes_arcsec()
        panel.bar(at + shift, [sizes[n] for n in numbers], width=0.38, color=colour)
    panel.set_xticks(at, [f"{n}\n{cause_words(names.get(n, ''))}" for n in numbers], fontsize=7)
    panel.set_ylabel("amplitude  arcsec", color=INK)
    panel.set_title("orders per output turn", loc="left", fontsize=9, color=INK)
    panel.grid(axis="y", color=FAINT, linewidth=0.6)
    panel.set_axisbelow(True)
    _plain(panel)


def cause_words(name: str) -> str:
    """What a cause (`gateway.reducer.figures.cause`) is called under a bar."""
    kind, _, number = name.partition(":")
    return {"disc": f"disc x{number}", "ring": f"ring x{number}", "mixed": "mixed", "none": ""}.get(kind, kind)


def _polar(panel: PolarAxes, depth: Mapping[str, FloatArray]) -> None:
    largest = max(float(np.max(np.abs(values - values.mean()))) for values in depth.values()) or 1.0
    for name, colour in (("before", OLD), ("after", NEW)):
        values = depth[name] - depth[name].mean()
        angle = np.linspace(0.0, 2.0 * np.pi, values.size + 1)
        panel.plot(angle, np.append(values, values[0]), color=colour, linewidth=1.0)
    whole = np.linspace(0.0, 2.0 * np.pi, 181)
    panel.plot(whole, np.zeros_like(whole), color=RULE, linewidth=0.6)
    panel.set_ylim(-2.2 * largest, 1.2 * largest)
    panel.set_yticks([-largest, 0.0, largest], [f"{-largest:.1f}", "0", f"+{largest:.1f} µm"], fontsize=6, color=QUIET)
    panel.set_xticks(np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False))
    panel.tick_params(axis="x", labelsize=6, pad=-1)
    panel.grid(color=FAINT, linewidth=0.5)
    panel.set_title("disc: mean deviation by space", fontsize=9, color=INK)


def _plain(panel: Axes) -> None:
    for side in ("top", "right"):
        panel.spines[side].set_visible(False)
    panel.tick_params(labelsize=7)
