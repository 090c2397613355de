"""`python -m release.figures FOLDER`: the figures of the handbook's page of maths, drawn by the functions it explains.

Colours tell approaches and steps apart by lightness too. A test draws them and compares the numbers that the page says.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import trueflank as tf
from drivers.units import rad_to_deg

ROOT = Path(__file__).absolute().parents[1]
DARK, WARM, COOL, PALE = "#1b3a5c", "#c2571a", "#3f87b5", "#b9c6d2"
STEP_MM = 40.0


def measured() -> tf.Measured:
    """An axis as a laser sees it: a lead error, a wave, a reversal and scatter, from a seed."""
    at = np.linspace(0.0, 400.0, 21)
    mean = 0.02 * at + 1.5 * np.sin(at / 60.0)
    way = np.array([0.6, -0.6])
    noise = np.random.default_rng(7).normal(scale=0.35, size=(at.size, 5, 2))
    return tf.Measured(at, mean[:, None, None] + way + noise, "mm", name="EXX")


def gear() -> tf.Gear:
    """The gear of the library's page."""
    return tf.Gear.load(ROOT / "examples" / "gears" / "rv-40e-like.toml")


def tangential() -> tuple[tf.Flank, tf.Corrected]:
    """5 um of EYC, once a turn: the flank it leaves, and what corrects it."""
    machine = tf.Machine({"EYC": {"type": "fourier", "a": [5.0], "b": [0.0]}})
    return tf.flank(machine, gear()), tf.correct(machine, gear())


def _figure(wide: float, high: float, columns: int = 1) -> tuple[Figure, Any]:
    figure = Figure(figsize=(wide, high), layout="constrained", dpi=110)
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, columns)
    for one in np.atleast_1d(axes):
        one.spines[["top", "right"]].set_visible(False)
        one.axhline(0.0, color="black", linewidth=0.6)
    return figure, axes


def axis_figure() -> Figure:
    """Readings, their means, the table on the control's grid, and what is left."""
    found = measured()
    motion, at = tf.fit(found), found.targets
    figure, (left, right) = _figure(9.0, 3.4, 2)
    for way, colour, name in ((0, COOL, "approach +"), (1, WARM, "approach −")):
        x = found.deviations[:, :, way]
        left.plot(np.repeat(at, x.shape[1]), x.ravel(), ".", color=colour, markersize=3, alpha=0.5)
        left.plot(at, x.mean(axis=1), color=colour, label=name)
    b = int(np.argmax(np.abs(np.diff(found.deviations.mean(axis=1), axis=1))))
    low, high = sorted(found.deviations[b].mean(axis=0))
    left.annotate("", (at[b], low), (at[b], high), arrowprops={"arrowstyle": "<->", "color": "black"})
    left.annotate("B", (at[b], high), textcoords="offset points", xytext=(-4, 8))
    left.set(title="measured: two means, B between them", xlabel="target, mm", ylabel="deviation, µm")
    left.legend(frameon=False)
    fine, grid = np.linspace(0.0, 400.0, 401), np.arange(0.0, 400.1, STEP_MM)
    table = np.interp(fine, grid, motion(grid) - motion([0.0]))
    right.plot(fine, motion(fine), color=DARK, label="curve of both")
    right.plot(grid, motion(grid) - motion([0.0]), "o-", color=WARM, markersize=4, label="table, zero at 0 mm")
    right.plot(fine, motion(fine) - table, color=COOL, label="left")
    right.set(title="the table holds what it cancels", xlabel="position, mm")
    right.legend(frameon=False)
    return figure


def terms_figure() -> Figure:
    """What 5 um along the centre line, 5 um across, and 5 arcsec about the gear's axis do along one space."""
    from gateway.study.inputs import gear_of  # noqa: PLC0415 - the gear's profile itself

    cut = gear_of(gear().data)
    t = np.linspace(-np.pi / gear().data.gear.zc, np.pi / gear().data.gear.zc, 201)
    section = cut.section(t)
    turn = np.deg2rad(5.0 / 3600.0) * section.h * 1000.0
    figure, axis = _figure(6.4, 3.2)
    terms = (("A = 5 µm: A n_x", 5.0 * section.nx, DARK), ("B = 5 µm: B n_y", 5.0 * section.ny, WARM))
    for name, values, colour in (*terms, ("G = 5 arcsec: G h", turn, COOL)):
        axis.plot(rad_to_deg(t), values, color=colour, label=name)
    axis.set(xlabel="profile angle, deg (0: bottom of the space)", ylabel="normal deviation, µm")
    axis.legend(frameon=False)
    return figure


def layers_figure() -> Figure:
    """5 um of EYC: pitch-like deviation of the flank, the cross table that cures it, the flank afterwards."""
    found, best = tangential()
    figure, (left, right) = _figure(9.0, 3.2, 2)
    spaces = np.arange(found.deviation.shape[0]) + 1
    middle = found.deviation[:, :, found.height.size // 2]
    left.fill_between(spaces, middle.min(axis=1), middle.max(axis=1), color=PALE)
    left.set(title="least and most over each space's profile", xlabel="space", ylabel="normal deviation, µm")
    for table, colour in zip(best.tables, (WARM, COOL, DARK), strict=False):
        unit = "arcsec" if table.name.startswith("C") else "µm"
        right.plot(table.positions, table.deviations, color=colour, label=f"{table.name}, {unit}")
    right.set(title=f"tables that take RMS {best.rms_before:.2f} to {best.rms_after:.2f} µm", xlabel="C, deg")
    right.legend(frameon=False)
    return figure


def verdict_figure() -> Figure:
    """Figures with U beside a limit: passed, not decidable, failed."""
    figure, axis = _figure(6.4, 2.6)
    cases = (("pass", 7.0, 1.5, COOL), ("not decidable", 9.2, 1.5, PALE), ("fail", 12.5, 1.5, WARM))
    for place, (name, value, big_u, colour) in enumerate(cases):
        axis.errorbar(place, value, yerr=big_u, fmt="o", color=colour, capsize=6, linewidth=2)
        axis.annotate(name, (place, value), textcoords="offset points", xytext=(10, -3))
    axis.axhline(10.0, color="black", linestyle="--")
    axis.annotate("limit of A", (-0.35, 10.2))
    axis.set(ylabel="A with U (k = 2), µm", xticks=[], xlim=(-0.4, 2.8), ylim=(0.0, 15.0))
    return figure


FIGURES = {"axis": axis_figure, "terms": terms_figure, "layers": layers_figure, "verdict": verdict_figure}


def main(arguments: list[str]) -> int:
    """Draw all into a folder."""
    for name, draw in FIGURES.items():
        draw().savefig(Path(arguments[0]) / f"maths-{name}.png", metadata={"Software": None})
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
