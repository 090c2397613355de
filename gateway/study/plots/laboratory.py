"""A gear as a laboratory prints it: profile and lead traces of both flanks with their lines, pitch and runout bars."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from drivers.types.values import FloatArray
from drivers.units import mm_to_um
from gateway.gear.flank import Inspection, TraceValues, trace_values
from gateway.study.drawing import FAINT, INK, NEW, OLD, QUIET, RULE

SIDES = ("left flank", "right flank")
STEPS = (1.0, 2.0, 5.0, 10.0)
GAP = 1.25  # of a trace's room to the next one


@dataclass(frozen=True)
class Traces:
    """Traces (S, n) in mm of some spaces on one flank, over arc length or height (n,) in mm, with their values."""

    spaces: tuple[int, ...]
    along: FloatArray
    deviation: FloatArray
    values: TraceValues

    @classmethod
    def of(cls, spaces: tuple[int, ...], along: FloatArray, deviation: FloatArray) -> Traces:
        """Traces with F, f_H and f_f as `trace_values` has them."""
        return cls(spaces, along, deviation, trace_values(deviation, along))

    @property
    def level(self) -> FloatArray:
        """Each trace about its own mean (S, n), mm: where a trace lies as a whole is told by pitch and runout."""
        return np.asarray(self.deviation - np.mean(self.deviation, axis=-1, keepdims=True))

    @property
    def lines(self) -> FloatArray:
        """The least-squares line of each levelled trace (S, n), mm: its slope over the length is f_H."""
        centred = self.along - np.mean(self.along)
        return np.asarray(self.values.f_H[:, None] * centred / float(np.ptp(self.along)))


@dataclass(frozen=True)
class Chart:
    """What one page shows; ``profile`` and ``lead`` are those of the left and the right flank."""

    title: str
    note: str
    profile: tuple[Traces, Traces]
    lead: tuple[Traces, Traces]
    chart: Inspection


def laboratory_page(figure: Figure, page: Chart, rooms: tuple[float, float]) -> None:
    """One page: profile above, lead in the middle, pitch and runout below; ``rooms`` of a trace to each side, um."""
    sides: dict[str, float] = {"left": 0.075, "right": 0.985, "wspace": 0.16}
    above = figure.add_gridspec(2, 2, top=0.862, bottom=0.432, hspace=0.46, **sides)
    below = figure.add_gridspec(2, 2, top=0.355, bottom=0.052, hspace=0.52, **sides)
    figure.text(0.075, 0.972, page.title, fontsize=12, color=INK)
    figure.text(0.075, 0.963, page.note, fontsize=7.5, color=QUIET, va="top")
    for height in (0.93, 0.383):
        figure.add_artist(Line2D([0.075, 0.985], [height, height], color=RULE, lw=0.8))
    for side, name in enumerate(SIDES):
        for row, traces, what, label in (
            (0, page.profile[side], ("F_a", "f_Ha", "f_fa"), "arc from root  mm"),
            (1, page.lead[side], ("F_b", "f_Hb", "f_fb"), "z  mm"),
        ):
            panel = figure.add_subplot(above[row, side])
            _traces(panel, traces, what, rooms[row])
            panel.set_title(f"{('profile', 'lead')[row]}, {name}", loc="left", fontsize=8.5, color=INK, pad=34)
            panel.set_ylabel(label)
        pitch = page.chart.pitch[side]
        text = f"{name}: F_p {_um(pitch.F_p)}, f_p {_um(pitch.f_p)} µm"
        _bars(figure.add_subplot(below[0, side]), mm_to_um(pitch.f), "single f_pk  µm", text)
        if side == 0:
            F = mm_to_um(pitch.F - np.mean(pitch.F))
            other = page.chart.pitch[1]
            panel = figure.add_subplot(below[1, 0])
            line = mm_to_um(other.F - np.mean(other.F))
            _bars(panel, F, "index F_k  µm", "cumulative pitch: bars left, line right flank", beside=line)
            panel.plot(line, color=INK, lw=0.9)
    runout = page.chart.runout
    text = f"runout: F_r {_um(runout.F_r)} µm, eccentricity {_um(runout.eccentricity)} µm"
    panel = figure.add_subplot(below[1, 1])
    _bars(panel, mm_to_um(runout.radial - np.mean(runout.radial)), "radial  µm", text)


def rooms_um(pages: tuple[Chart, ...]) -> tuple[float, float]:
    """Round half widths in um that hold every profile and every lead trace of all pages about its mean."""
    found = []
    for parts in ([one for page in pages for one in page.profile], [one for page in pages for one in page.lead]):
        largest = mm_to_um(max(float(np.max(np.abs(one.level))) for one in parts)) or 1.0
        power = 10.0 ** np.floor(np.log10(largest))
        found.append(float(next(step * power for step in STEPS if step * power >= largest)))
    return found[0], found[1]


def _traces(panel: Axes, traces: Traces, names: tuple[str, str, str], room: float) -> None:
    """Traces upright beside each other, surplus to the right, each about its own zero, with its line and values."""
    count = len(traces.spaces)
    panel.grid(True, axis="y", color=FAINT, lw=0.5)
    panel.set_axisbelow(True)
    for number, (space, e, line) in enumerate(zip(traces.spaces, traces.level, traces.lines, strict=True)):
        zero = 2.0 * GAP * room * number
        panel.axvline(zero, color=RULE, lw=0.8)
        for side in (-room, room):
            panel.axvline(zero + side, color=FAINT, lw=0.6)
        panel.plot(zero + mm_to_um(e), traces.along, color=NEW, lw=1.1)
        panel.plot(zero + mm_to_um(line), traces.along, color="#a8453a", lw=0.8, ls="--")
        told = zip(names, (traces.values.F, traces.values.f_H, traces.values.f_f), strict=True)
        text = "\n".join((f"space {space}", *(f"{name} {_um(float(one[number]))}" for name, one in told)))
        panel.text(zero, 1.015, text, transform=panel.get_xaxis_transform(), fontsize=6.3, ha="center", color=INK)
    panel.set_xlim(-GAP * room, 2.0 * GAP * room * (count - 0.5))
    panel.set_xticks([-room, 0.0, room], [f"{-room:g}", "0", f"+{room:g} µm"], fontsize=6.5)
    panel.spines[["top", "right"]].set_visible(False)
    panel.tick_params(length=2.5, width=0.6, labelsize=7)


def _bars(panel: Axes, values: FloatArray, label: str, title: str, beside: FloatArray | None = None) -> None:
    """Bars about zero on a scale that holds them, and what is drawn ``beside`` them."""
    panel.bar(np.arange(values.size), values, 0.72, color=OLD)
    panel.axhline(0.0, color=RULE, lw=0.8)
    held = values if beside is None else np.concatenate([values, beside])
    reach = 1.1 * float(np.max(np.abs(held), initial=0.0)) or 1.0
    panel.set_ylim(-reach, reach)
    panel.set_xlim(-0.6, values.size - 0.4)
    panel.set_ylabel(label)
    panel.set_xlabel("space", labelpad=1)
    panel.set_title(title, loc="left", fontsize=8, color=INK)
    panel.xaxis.set_major_locator(MaxNLocator(integer=True))
    panel.spines[["top", "right"]].set_visible(False)
    panel.tick_params(length=2.5, width=0.6, labelsize=7)


def _um(value_mm: float) -> str:
    return f"{mm_to_um(value_mm):.2f}"
