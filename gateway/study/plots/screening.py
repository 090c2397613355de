"""The paper's figure 5: normalised mean and standard deviation of the elementary effects, with their intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drivers.types.values import FloatArray
from gateway.study.draw import FAINT, INK, NEW, OLD, QUIET, RULE


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
