"""The machine's bodies and frames (figures 1 and 2 of the paper), and the six relative errors of wheel to work."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.patches import FancyBboxPatch
from matplotlib.ticker import MaxNLocator, MultipleLocator
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from drivers.types.values import FloatArray
from gateway.model.chain import Axis, Chain
from gateway.model.frames import BED, RELATIVE, WHEEL, WORK, Joint, joints, matrix
from gateway.study.drawing import FAINT, INK, MIDDLE, NEW, OLD, QUIET, RULE
from gateway.study.plots.charts import calm_space, in_space
from gateway.study.plots.surfaces import SYMBOLS

HEADROOM = 1.25  # of the largest value: the room of a panel
HALF_TURN = 180.0
ARROW = 45.0  # mm: length of a frame's arrows
BODY = "#eef1f3"
COLOURS = ("#a8453a", "#4b7f52", NEW)
SHOWN: Mapping[str, float] = {"X": -160.0, "Z": 60.0, "C": float(np.radians(30.0))}
"""Where the machine is drawn: mm and rad; an axis that is not here stands at 60 mm or 30 deg."""
WORDS = {BED: "bed  R", WORK: "work  W", WHEEL: "grinding wheel  T"}
ANGLES = ("ea", "eb", "ec")


def machine_frames(figure: FigureBase, chain: Chain) -> None:
    """Left the tree of bodies, right the frames in space, ideal, with equal scales."""
    tree = figure.add_axes((0.015, 0.04, 0.42, 0.86))
    _tree(tree, joints(chain))
    q = _shown_at(chain)
    _space(figure.add_axes((0.44, -0.02, 0.56, 0.95), projection="3d"), chain, q)
    turning = {axis.name: axis.kind == "revolute" for axis in chain.axes}
    shown = ((name, np.degrees(one), "deg") if turning[name] else (name, one, "mm") for name, one in q.items())
    at = ", ".join(f"{name} {one:g} {unit}" for name, one, unit in shown)
    figure.text(0.015, 0.935, "bodies, each on the one below it", fontsize=10, color=INK)
    figure.text(0.46, 0.935, f"frames without errors at {at}", fontsize=10, color=INK)
    for number, (name, colour) in enumerate(zip("xyz", COLOURS, strict=True)):
        figure.text(0.46 + 0.022 * number, 0.885, name, fontsize=9, color=colour, weight="bold")
    note = f"arrows of {ARROW:g} mm; dashed: from a frame to the one below it"
    figure.text(0.53, 0.885, note, fontsize=7.5, color=QUIET)


def relative_curves(
    figure: FigureBase,
    label: str,
    at: FloatArray,
    values: Mapping[str, FloatArray],
    *,
    frame: str,
    lines: Sequence[str] = (),
) -> None:
    """Six panels, lengths above and angles below with one scale each; values (lines, n) or any shape as ``at``."""
    panels = figure.subplots(2, 3, sharex=True)
    figure.subplots_adjust(left=0.075, right=0.985, top=0.87, bottom=0.1, hspace=0.14, wspace=0.2)
    many = len(lines) > 1
    shades = [OLD, MIDDLE, NEW] if many else [NEW]
    for row, names in zip(panels, (RELATIVE[:3], RELATIVE[3:]), strict=True):
        reach = max(float(np.max(np.abs(values[name]))) for name in names)
        for panel, name in zip(row, names, strict=True):
            _calm(panel)
            room = HEADROOM * reach if reach > 0.0 else 1.0
            panel.set_ylim(-room, room)
            panel.set_ylabel(f"{SYMBOLS[name]}  {'arcsec' if name in ANGLES else 'µm'}", labelpad=1)
            for number, (x, y) in enumerate(_lines(at, values[name], many=many)):
                text = lines[number] if many else None
                panel.plot(x, y, color=shades[number % len(shades)], lw=1.1, label=text)
    for panel in panels[1]:
        panel.set_xlabel(label)
        if label.endswith("deg") and float(np.ptp(at)) > HALF_TURN:
            panel.xaxis.set_major_locator(MultipleLocator(60.0))
    title = f"relative errors of wheel to work, components in the frame of the {frame}"
    figure.text(0.075, 0.955, title, fontsize=10, color=INK)
    note = "one scale for the three shifts, one for the three angles"
    figure.text(0.075, 0.915, note, fontsize=8, color=QUIET)
    if many:
        handles, texts = panels[0][0].get_legend_handles_labels()
        place: dict[str, Any] = {"loc": "upper right", "bbox_to_anchor": (0.99, 0.965)}
        figure.legend(handles, texts, ncols=3, frameon=False, fontsize=8, **place)


def one_relative_curve(figure: Figure, label: str, at: FloatArray, name: str, values: FloatArray, frame: str) -> None:
    """One of the six over the positions of an axis; a line along each row of positions that moves."""
    panel = figure.subplots(1, 1)
    figure.subplots_adjust(left=0.095, right=0.985, top=0.86, bottom=0.14)
    _calm(panel)
    for x, y in _lines(at, values, many=False):
        panel.plot(x, y, color=NEW, lw=1.2)
    panel.set_xlabel(label)
    panel.set_ylabel(f"{SYMBOLS[name]}  {'arcsec' if name in ANGLES else 'µm'}")
    panel.margins(y=0.12)
    title = f"relative error {SYMBOLS[name]} of wheel to work, in the frame of the {frame}"
    figure.text(0.095, 0.93, title, fontsize=10, color=INK)


def _lines(at: FloatArray, values: FloatArray, *, many: bool) -> list[tuple[FloatArray, FloatArray]]:
    """Curves ordered by position: one a row where ``many``, else one along each line of positions that moves."""
    if many:
        return [(x[np.argsort(x)], y[np.argsort(x)]) for x, y in zip(at, values, strict=True)]
    if at.ndim < 2:
        order = np.argsort(at, axis=None)
        return [(at.ravel()[order], values.ravel()[order])]
    moving = max(range(at.ndim), key=lambda axis: float(np.max(np.ptp(at, axis=axis))))
    x, y = (np.moveaxis(one, moving, -1).reshape(-1, at.shape[moving]) for one in (at, values))
    return [(one[np.argsort(one)], other[np.argsort(one)]) for one, other in zip(x, y, strict=True)]


def _tree(panel: Axes, found: Sequence[Joint]) -> None:
    """Bodies as boxes, the bed below; what moves a body against the one below it is written beside their line."""
    panel.axis("off")
    sides = {side: [one for one in found if one.side == side] for side in ("work", "tool")}
    deepest = max(len(one) for one in sides.values())
    panel.set_xlim(-1.0, 1.0)
    panel.set_ylim(-0.42, deepest + 0.3)
    _box(panel, 0.0, 0.0, WORDS[BED], 0.92)
    for x, side in ((-0.52, "work"), (0.52, "tool")):
        for height, one in enumerate(sides[side], start=1):
            panel.plot([x, x], [height - 0.78, height - 0.22], color=INK, lw=1.2, zorder=1)
            panel.text(x + 0.05, height - 0.5, _motion(one), fontsize=8, color=QUIET, va="center")
            _box(panel, x, float(height), WORDS.get(one.frame, _body(one)), 0.4)
    panel.text(0.0, -0.36, "Y dresses the wheel and is in no chain", fontsize=8, color=QUIET, ha="center", va="center")


def _box(panel: Axes, x: float, y: float, text: str, half: float) -> None:
    panel.add_patch(
        FancyBboxPatch(
            (x - half, y - 0.2), 2.0 * half, 0.4, boxstyle="round,pad=0.02,rounding_size=0.04", facecolor=BODY,
            edgecolor=MIDDLE, lw=0.9, zorder=2,
        )
    )  # fmt: skip
    panel.text(x, y, text, ha="center", va="center", fontsize=9, color=INK, zorder=3)


def _body(one: Joint) -> str:
    if isinstance(one.element, Axis):
        return f"{'slide' if one.element.kind == 'prismatic' else 'table'}  {one.frame}"
    return one.frame


def _motion(one: Joint) -> str:
    if not isinstance(one.element, Axis):
        return "fixed, unit matrix" if one.element is None else "fixed"
    letter = "xyz"[int(np.argmax(np.abs(np.asarray(one.element.direction))))]
    return f"{'moves along' if one.element.kind == 'prismatic' else 'turns about'} {letter} by {one.element.name}"


def _shown_at(chain: Chain) -> dict[str, float]:
    """Where the machine is drawn, mm and rad by axis."""
    turning = {axis.name: axis.kind == "revolute" for axis in chain.axes}
    return {name: SHOWN.get(name, float(np.radians(30.0)) if turning[name] else 60.0) for name in turning}


def _space(panel: Any, chain: Chain, q: Mapping[str, float]) -> None:
    ends = [BED, *(one.frame for one in joints(chain) if one.element is not None or one.frame in (WORK, WHEEL))]
    poses = {name: matrix(chain, name, BED, {k: np.asarray(v) for k, v in q.items()}, state="ideal") for name in ends}
    drawn: list[FloatArray] = []
    labels: dict[tuple[float, ...], list[str]] = {}
    for name, T in poses.items():
        origin = T[:3, 3]
        labels.setdefault(tuple(np.round(origin, 6)), []).append(name)
        for axis, colour in enumerate(COLOURS):
            tip = origin + ARROW * T[:3, axis]
            panel.quiver(*origin, *(tip - origin), color=colour, lw=1.5, arrow_length_ratio=0.18)
            drawn += [origin, tip]
    for one in joints(chain):
        line = np.stack([poses[parent][:3, 3] for parent in (one.parent, one.frame) if parent in poses], axis=1)
        panel.plot(*line, color=QUIET, lw=0.9, ls=(0, (4, 3)))
    _solids(panel, poses, drawn)
    for origin_key, names in labels.items():
        text = panel.text(
            *(np.asarray(origin_key) + np.array([0.0, 0.0, -0.42 * ARROW])), ", ".join(names), fontsize=8.5, color=INK,
            ha="center", va="center", zorder=20,
        )  # fmt: skip
        text.set_bbox({"facecolor": "white", "edgecolor": RULE, "lw": 0.5, "alpha": 0.92, "boxstyle": "round,pad=0.25"})
    in_space(panel, np.stack(drawn), zoom=0.98)
    calm_space(panel)
    for axis, most in ((panel.xaxis, 5), (panel.yaxis, 3), (panel.zaxis, 5)):
        axis.set_major_locator(MaxNLocator(most))
    panel.set_xlabel("x  mm", labelpad=0)
    panel.set_ylabel("y  mm", labelpad=0)
    panel.set_zlabel("z  mm", labelpad=-2)
    panel.view_init(20.0, -58.0)


def _solids(panel: Any, poses: Mapping[str, FloatArray], drawn: list[FloatArray]) -> None:
    """Rims of wheel (about its y) and work (about its z), so that the arrows can be seen as a machine."""
    turn = np.linspace(0.0, 2.0 * np.pi, 91)
    c, s, zero = np.cos(turn), np.sin(turn), np.zeros_like(turn)
    for name, radius, ring in ((WHEEL, 98.0, (c, zero, s)), (WORK, 60.0, (c, s, zero))):
        rim = [poses[name][:3, :3] @ (share * radius * np.stack(ring)) + poses[name][:3, 3:] for share in (1.0, 0.35)]
        panel.add_collection3d(Poly3DCollection([rim[0].T], facecolors=(0.12, 0.31, 0.47, 0.07), edgecolors="none"))
        for points, width in zip(rim, (1.1, 0.6), strict=True):
            panel.plot(*points, color=OLD, lw=width)
        drawn += list(rim[0].T)


def _calm(panel: Axes) -> None:
    panel.grid(True, color=FAINT, lw=0.5)
    panel.set_axisbelow(True)
    panel.axhline(0.0, color=RULE, lw=0.8, zorder=1)
    panel.spines[["top", "right"]].set_visible(False)
    panel.tick_params(length=2.5, width=0.6, labelsize=7)
