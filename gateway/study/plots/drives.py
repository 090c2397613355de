"""A drive drawn: its parts, its error over a turn with the orders of it, discs in pairs, and what a test bench read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from drivers.types.drives import DriveRecord
from drivers.types.values import FloatArray
from gateway.evaluate.behaviour.drive import DriveFigures
from gateway.evaluate.behaviour.order_causes import CauseKind, OrderCause
from gateway.reducer.figures import Transmission
from gateway.reducer.pairing import Matching
from gateway.reducer.records import Reducer
from gateway.study.draw_drive import cause_words
from gateway.study.drawing import FAINT, INK, MIDDLE, NEW, OLD, QUIET, RULE
from gateway.study.export import outline
from gateway.study.plots.surfaces import BODY, CROWD

BARS = 10
SENSES = {1: "+ torque", -1: "- torque"}
RED = "#a8453a"
DISCS = (NEW, RED, "#4b7f52")
FEWEST_SHOWN = 0.02  # of the largest order: a smaller one is not drawn


def reducer_sheet(figure: Figure, drive: Reducer) -> None:
    """The drive along its axis with the first crank phase at 0 deg: ring pins, discs, cranks or output pins, mm."""
    panel = figure.subplots(1, 1)
    tall = float(figure.get_figheight())
    figure.subplots_adjust(left=0.1, right=0.97, top=1.0 - 1.0 / tall, bottom=0.45 / tall)
    gear, pins = drive.gear, drive.pins
    at = 2.0 * np.pi * np.arange(pins.number) / pins.number
    points = outline(gear, CROWD) @ [1.0, 1j]
    for place, colour in zip(drive.discs, DISCS, strict=False):
        centre = gear.a * np.exp(1j * np.deg2rad(place.crank_phase_deg))
        turned = np.exp(1j * (np.deg2rad(place.mark_angle_deg(gear.zc)))) * points + centre
        label = f"disc on the eccentric at {place.crank_phase_deg:g} deg, mark {place.mark}"
        panel.fill(turned.real, turned.imag, facecolor="none", edgecolor=colour, lw=0.9, label=label)
    ring = [Circle((pins.circle_mm * np.cos(one), pins.circle_mm * np.sin(one)), pins.radius_mm) for one in at]
    panel.add_collection(PatchCollection(ring, facecolor="white", edgecolor=OLD, lw=0.7, zorder=3))
    out = drive.output
    size = 0.12 * gear.rp
    for one in 2.0 * np.pi * np.arange(out.number) / out.number:
        middle = out.circle_mm * np.exp(1j * one)
        panel.add_patch(Circle((middle.real, middle.imag), size, facecolor=BODY, edgecolor=INK, lw=0.8))
    panel.plot([], [], "o", mfc="white", mec=OLD, ms=6, label=f"{pins.number} pins of {pins.radius_mm:.4g} mm")
    words = f"{out.number} {'cranks' if hasattr(out, 'eccentricity_um') else 'output pins'} on {out.circle_mm:g} mm"
    panel.plot([], [], "o", mfc=BODY, mec=INK, ms=8, label=words)
    panel.set_aspect("equal", adjustable="datalim")
    panel.set_xlabel("x  mm")
    panel.set_ylabel("y  mm")
    panel.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, frameon=False, fontsize=7.5)
    _calm(panel)
    note = f"eccentricity {gear.a:g} mm, rated {drive.rated_nm:.4g} Nm, datum of deviations: {drive.datum}"
    _add_heading(figure, drive.name, note, 0.1)


def drive_sheet(figure: Figure, found: Transmission, expected: str = "") -> None:
    """The error of both senses over one output turn, its orders by cause, lost motion and backlash round the turn."""
    grid = figure.add_gridspec(2, 2, left=0.075, right=0.985, top=0.86, bottom=0.1, hspace=0.5, wspace=0.18)
    curves = figure.add_subplot(grid[0, :])
    turned = np.linspace(0.0, 360.0, found.crank_rad.size, endpoint=False)
    for curve, sense, colour in zip(found.loaded, (1, -1), (NEW, RED), strict=True):
        text = f"{SENSES[sense]}  {curve.peak_to_peak_arcsec:.2f} arcsec p-p, {curve.rms_arcsec:.2f} RMS"
        curves.plot(turned, curve.error_arcsec, color=colour, lw=0.8, label=text)
    _turn(curves, "transmission error  arcsec")
    _orders(figure.add_subplot(grid[1, 0]), found)
    play = figure.add_subplot(grid[1, 1])
    for values, colour, name in (
        (found.lost_motion_arcsec, NEW, f"lost motion  mean {found.lost_motion:.2f}"),
        (found.backlash_arcsec, MIDDLE, f"backlash  mean {found.backlash:.2f}"),
    ):
        play.plot(turned, values, color=colour, lw=0.8, label=name)
    _turn(play, "arcsec")
    _limits_from_zero(play, [found.lost_motion_arcsec, found.backlash_arcsec])
    title = f"{found.drive.name} at {found.torque_nm:.4g} Nm: {found.error_arcsec:.1f} arcsec transmission error"
    note = f"predicted, not tested; without friction; stiffness {found.stiffness_nm_arcmin:.4g} Nm/arcmin{expected}"
    _add_heading(figure, title, note, 0.075)


def pairs_sheet(figure: Figure, found: Matching) -> None:
    """Each pair's transmission error as a bar, the least first, beside the pairs as the discs came; arcsec."""
    panel = figure.subplots(1, 1)
    tall = float(figure.get_figheight())
    figure.subplots_adjust(left=0.075, right=0.985, top=1.0 - 0.85 / tall, bottom=0.6 / tall)
    best = sorted(found.pairs, key=lambda pair: pair.error_arcsec)
    come = sorted(found.as_they_come, key=lambda pair: pair.error_arcsec)
    at = np.arange(len(best))
    reach = max(pair.error_arcsec for pair in (*best, *come)) or 1.0
    for pairs, shift, colour, name in ((come, -0.2, OLD, "as the discs came"), (best, 0.2, NEW, "matched")):
        values = [pair.error_arcsec for pair in pairs]
        panel.bar(at + shift, values, 0.36, color=colour, label=f"{name}, mean {np.mean(values):.2f} arcsec")
        for x, pair in zip(at + shift, pairs, strict=True):
            text = f"{pair.first + 1} + {pair.second + 1}\nmark {pair.mark}"
            panel.text(x, pair.error_arcsec + 0.015 * reach, text, fontsize=6.5, color=INK, ha="center", va="bottom")
    panel.set_ylim(0.0, 1.22 * reach)
    panel.set_xlim(-0.6, len(best) - 0.4)
    panel.set_xticks(at, [f"{one + 1}" for one in at])
    panel.set_xlabel("drive, the best first; numbers above: its discs in the order given, tooth position of the second")
    panel.set_ylabel("transmission error p-p  arcsec")
    panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False, fontsize=8)
    _calm(panel)
    panel.grid(False, axis="x")
    left = f"; left over: {', '.join(str(one + 1) for one in found.left_over)}" if found.left_over else ""
    note = f"by the full model, the worse sense of torque; predicted, not tested{left}"
    _add_heading(figure, f"pairing gains {found.worth_arcsec:.2f} arcsec a drive", note, 0.075)


def readings_of_bench(figure: Figure, record: DriveRecord, source: str) -> None:
    """What a bench read, in the order of the readings: angles of input and output, and torque if it read it."""
    torque = record.torque_nm
    rows = 3 if torque is not None else 2
    panels = figure.subplots(rows, 1, sharex=True)
    tall = float(figure.get_figheight())
    figure.subplots_adjust(left=0.1, right=0.985, top=1.0 - 0.72 / tall, bottom=0.42 / tall, hspace=0.2)
    parts = [(record.input_deg, "input  deg", NEW), (record.output_deg, "output  deg", MIDDLE)]
    if torque is not None:
        parts.append((torque, "torque  Nm", RED))
    for panel, (values, label, colour) in zip(panels, parts, strict=True):
        panel.plot(np.arange(values.size), values, color=colour, lw=0.9)
        panel.set_ylabel(label)
        _calm(panel)
    panels[-1].set_xlabel("reading")
    _add_heading(figure, source, f"{record.input_deg.size} readings of a reducer's test bench", 0.1)


def bench_sheet(figure: Figure, found: DriveFigures, verdict: str = "", *, simulated: bool = False) -> None:
    """What a record comes to: error over a turn and orders of each sense, and the loop of torque; arcsec, Nm."""
    rows = (2 if found.running else 0) + (1 if found.loop is not None else 0)
    tall = float(figure.get_figheight())
    panels: list[Any] = list(figure.subplots(rows, 1, squeeze=False)[:, 0])
    figure.subplots_adjust(left=0.085, right=0.985, top=1.0 - 0.95 / tall, bottom=0.45 / tall, hspace=0.45)
    if found.running:
        curves, bars = panels.pop(0), panels.pop(0)
        for run in found.running:
            order, colour = np.argsort(run.angle_deg), NEW if run.sense > 0 else RED
            name = "forwards" if run.sense > 0 else "backwards"
            text = f"{name}  {run.peak_to_peak:.2f} arcsec p-p, {run.rms:.2f} RMS"
            curves.plot(run.angle_deg[order], run.error_arcsec[order], color=colour, lw=0.8, label=text)
        _turn(curves, "transmission error  arcsec")
        numbers = sorted(one.order for one in found.running[0].orders[:BARS])
        names = {one.order: _short(one.causes) for run in found.running for one in run.orders}
        wide = 0.8 / len(found.running)
        for place, run in enumerate(found.running):
            shift = (place - 0.5 * (len(found.running) - 1)) * wide
            colour = NEW if run.sense > 0 else RED
            bars.bar(np.arange(len(numbers)) + shift, [run.amplitude(n) for n in numbers], 0.9 * wide, color=colour)
        _ordered(bars, numbers, {n: names.get(n, "") for n in numbers})
    if found.loop is not None:
        panel = panels.pop(0)
        panel.plot(found.loop.torque_nm, found.loop.twist_arcsec, ".-", color=NEW, lw=0.9, ms=3)
        panel.axvline(0.0, color=RULE, lw=0.8)
        panel.set_xlabel("torque  Nm")
        panel.set_ylabel("twist  arcsec")
        words = f"lost motion {found.loop.lost_motion:.2f}, backlash {found.loop.backlash:.2f} arcsec"
        panel.set_title(f"torque loop: {words}", loc="left", fontsize=8.5, color=INK)
        _calm(panel)
    note = f"{found.drive.pins} pins, ratio {found.drive.ratio:g}{verdict}"
    _add_heading(figure, f"reducer on its test bench, {'SIMULATED' if simulated else 'measured'}", note, 0.085)


def _short(causes: Sequence[OrderCause]) -> str:
    """The likely cause as it fits below a bar."""
    if not causes:
        return ""
    one = causes[0]
    i, j = one.waves
    waves = f" x{i or j}" if one.kind in (CauseKind.DISC, CauseKind.DISC_OR_CRANKS, CauseKind.RING) else ""
    name = "disc" if one.kind is CauseKind.DISC_OR_CRANKS else str(one.kind).partition("-")[0]
    return ("folded " if one.folded else "") + name + waves


def _orders(panel: Axes, found: Transmission) -> None:
    """The largest orders of either sense, both drawn."""
    chosen = {one.number: one for curve in found.loaded for one in found.orders(BARS, curve)}
    top = max((one.amplitude_arcsec for one in chosen.values()), default=0.0)
    numbers = sorted(n for n, one in chosen.items() if one.amplitude_arcsec >= FEWEST_SHOWN * top)
    for shift, curve, colour in ((-0.2, found.loaded[0], NEW), (0.2, found.loaded[1], RED)):
        sizes = curve.amplitudes_arcsec()
        panel.bar(np.arange(len(numbers)) + shift, [sizes[n] for n in numbers], 0.38, color=colour)
    _ordered(panel, numbers, {n: cause_words(chosen[n].cause) for n in numbers})


def _ordered(panel: Axes, numbers: Sequence[int], causes: Mapping[int, str]) -> None:
    size = 7.0 if len(numbers) <= BARS else 5.5
    panel.set_xticks(np.arange(len(numbers)), [f"{n}\n{causes[n]}" for n in numbers], fontsize=size)
    panel.set_ylabel("amplitude  arcsec")
    panel.set_title("orders per turn of the output", loc="left", fontsize=8.5, color=INK)
    _calm(panel)
    panel.tick_params(axis="x", labelsize=size)
    panel.grid(False, axis="x")


def _turn(panel: Axes, label: str) -> None:
    panel.set_xlim(0.0, 360.0)
    panel.set_xticks(range(0, 361, 60))
    panel.set_xlabel("output turned  deg", labelpad=1)
    panel.set_ylabel(label)
    panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False, fontsize=7.5, borderaxespad=0.2)
    _calm(panel)


def _limits_from_zero(panel: Axes, parts: Sequence[FloatArray]) -> None:
    """Limits from zero, so that a steady play looks steady."""
    top = max(float(np.max(one)) for one in parts)
    panel.set_ylim(min(0.0, 1.1 * min(float(np.min(one)) for one in parts)), 1.15 * top if top > 0.0 else 1.0)


def _add_heading(figure: Figure, title: str, note: str, left: float) -> None:
    tall = float(figure.get_figheight())
    figure.text(left, 1.0 - 0.28 / tall, title, fontsize=10, color=INK)
    figure.text(left, 1.0 - 0.50 / tall, note, fontsize=8, color=QUIET)


def _calm(panel: Axes) -> None:
    panel.grid(True, color=FAINT, lw=0.5)
    panel.set_axisbelow(True)
    panel.axhline(0.0, color=RULE, lw=0.8, zorder=1)
    panel.spines[["top", "right"]].set_visible(False)
    panel.tick_params(length=2.5, width=0.6, labelsize=7)
