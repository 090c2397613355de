"""The machine's bodies and frames (figures 1 and 2 of the paper), and the six relative errors of wheel to work."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.patches import FancyBboxPatch

from drivers.types.values import FloatArray
from gateway.model.axis import Axis
from gateway.model.chain import Chain
from gateway.model.frames import BED, RELATIVE, WHEEL, WORK, Joint, joints, matrix
from gateway.study.draw import FAINT, INK, MIDDLE, NEW, OLD, QUIET, RULE
from gateway.study.plots.sheet import calm_space, in_space

ARROW = 45.0  # mm: length of a frame's arrows
COLOURS = ("#a8453a", "#4b7f52", NEW)
SHOWN: Mapping[str, float] = {"X": -160.0, "Z": 60.0, "C": float(np.radians(30.0))}
"""Where the machine is drawn: mm and rad; an axis that is not here stands at 60 mm or 30 deg."""
WORDS = {BED: "bed  R", WORK: "work  W", WHEEL: "grinding wheel  T"}
ANGLES = ("ea", "eb", "ec")
NAMES = {"dx": "Δx", "dy": "Δy", "dz": "Δz", "ea": "εx", "eb": "εy", "ec": "εz"}


def machine_frames(figure: FigureBase, chain: Chain) -> None:
    """Left the tree of bodies, right the frames in space, ideal, with equal scales."""
    tree = figure.add_axes((0.02, 0.05, 0.4, 0.88))
    _tree(tree, joints(chain))
    _space(figure.add_axes((0.42, 0.02, 0.58, 0.93), projection="3d"), chain)


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
    figure.subplots_adjust(left=0.075, right=0.985, top=0.86, bottom=0.1, hspace=0.16, wspace=0.2)
    many = len(lines) > 1
    shades = [OLD, MIDDLE, NEW] if many else [NEW]
    for row, names in zip(panels, (RELATIVE[:3], RELATIVE[3:]), strict=True):
        reach = max(float(np.max(np.abs(values[name]))) for name in names)
        for panel, name in zip(row, names, strict=True):
            _calm(panel)
            panel.set_ylim(-1.1 * reach or -1.0, 1.1 * reach or 1.0) if reach > 0.0 else panel.set_ylim(-1.0, 1.0)
            panel.set_ylabel(f"{NAMES[name]}  {'arcsec' if name in ANGLES else 'µm'}", labelpad=1)
            for number, (x, y) in enumerate(_lines(at, values[name], many=many)):
                text = lines[number] if many else None
                panel.plot(x, y, color=shades[number % len(shades)], lw=1.1, label=text)
    for panel in panels[1]:
        panel.set_xlabel(label)
    figure.text(0.075, 0.94, f"relative errors of wheel to work, told in the {frame}", fontsize=10, color=INK)
    if many:
        handles, texts = panels[0][0].get_legend_handles_labels()
        figure.legend(handles, texts, loc="upper right", ncols=3, frameon=False, fontsize=8)


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
    """Bodies as boxes, the bed below; what moves a body against the one below it stands at their line."""
    panel.axis("off")
    sides = {side: [one for one in found if one.side == side] for side in ("work", "tool")}
    deepest = max(len(one) for one in sides.values())
    panel.set_xlim(-1.0, 1.0)
    panel.set_ylim(-0.5, deepest + 0.5)
    _box(panel, 0.0, 0.0, WORDS[BED])
    for x, side in ((-0.5, "work"), (0.5, "tool")):
        below = (0.0, 0.0)
        for height, one in enumerate(sides[side], start=1):
            panel.plot([below[0], x], [below[1] + 0.22, height - 0.22], color=QUIET, lw=1.0, zorder=1)
            middle = 0.5 * (below[0] + x), 0.5 * (below[1] + height)
            left = middle[0] < 0.0 and height == 1
            room, side_of = (-0.06, "right") if left else (0.06, "left")
            panel.text(middle[0] + room, middle[1], _motion(one), fontsize=7.5, color=QUIET, va="center", ha=side_of)
            _box(panel, x, float(height), WORDS.get(one.frame, _body(one)))
            below = (x, float(height))
    panel.text(-1.0, deepest + 0.42, "bodies (bed to work, bed to wheel)", fontsize=9, color=INK, va="top")
    panel.text(0.0, -0.45, "Y dresses the wheel, it is in no chain", fontsize=7.5, color=QUIET, ha="center")


def _box(panel: Axes, x: float, y: float, text: str) -> None:
    panel.add_patch(
        FancyBboxPatch(
            (x - 0.36, y - 0.2), 0.72, 0.4, boxstyle="round,pad=0.02", facecolor=FAINT, edgecolor=RULE, zorder=2
        )
    )
    panel.text(x, y, text, ha="center", va="center", fontsize=8.5, color=INK, zorder=3)


def _body(one: Joint) -> str:
    if isinstance(one.element, Axis):
        return f"{'slide' if one.element.kind == 'prismatic' else 'table'}  {one.frame}"
    return one.frame


def _motion(one: Joint) -> str:
    if not isinstance(one.element, Axis):
        return "fixed, identity" if one.element is None else "fixed"
    return f"{'shift' if one.element.kind == 'prismatic' else 'turn'} {one.element.name}"


def _space(panel: Any, chain: Chain) -> None:
    turning = {axis.name: axis.kind == "revolute" for axis in chain.axes}
    q = {name: SHOWN.get(name, float(np.radians(30.0)) if turning[name] else 60.0) for name in turning}
    ends = [BED, *(one.frame for one in joints(chain) if one.element is not None or one.frame in (WORK, WHEEL))]
    poses = {name: matrix(chain, name, BED, {k: np.asarray(v) for k, v in q.items()}, state="ideal") for name in ends}
    drawn: list[FloatArray] = []
    labels: dict[tuple[float, ...], list[str]] = {}
    for name, T in poses.items():
        origin = T[:3, 3]
        labels.setdefault(tuple(np.round(origin, 6)), []).append(name)
        for axis, colour in enumerate(COLOURS):
            tip = origin + ARROW * T[:3, axis]
            panel.plot(*np.stack([origin, tip], axis=1), color=colour, lw=1.6)
            drawn += [origin, tip]
    for origin_key, names in labels.items():
        panel.text(*(np.asarray(origin_key) + np.array([4.0, -8.0, -22.0])), ", ".join(names), fontsize=8, color=INK)
    for one in joints(chain):
        line = np.stack([poses[parent][:3, 3] for parent in (one.parent, one.frame) if parent in poses], axis=1)
        panel.plot(*line, color=QUIET, lw=0.8, ls=(0, (4, 3)))
    _solids(panel, poses, drawn)
    in_space(panel, np.stack(drawn))
    calm_space(panel)
    panel.set_xlabel("x  mm", labelpad=-2)
    panel.set_ylabel("y  mm", labelpad=-2)
    panel.set_zlabel("z  mm", labelpad=-4)
    panel.view_init(22.0, -62.0)
    shown = ((name, np.degrees(one), "deg") if turning[name] else (name, one, "mm") for name, one in q.items())
    at = ", ".join(f"{name} {one:.0f} {unit}" for name, one, unit in shown)
    panel.set_title(f"frames at {at}   (red x, green y, blue z)", fontsize=8.5, color=INK, y=0.98)


def _solids(panel: Any, poses: Mapping[str, FloatArray], drawn: list[FloatArray]) -> None:
    """Rims of wheel (about its y) and work (about its z), so that the arrows can be seen as a machine."""
    turn = np.linspace(0.0, 2.0 * np.pi, 91)
    c, s, zero = np.cos(turn), np.sin(turn), np.zeros_like(turn)
    for name, radius, ring in ((WHEEL, 98.0, (c, zero, s)), (WORK, 60.0, (c, s, zero))):
        points = poses[name][:3, :3] @ (radius * np.stack(ring)) + poses[name][:3, 3:]
        panel.plot(*points, color=OLD, lw=1.2)
        drawn += list(points.T)


def _calm(panel: Axes) -> None:
    panel.grid(True, color=FAINT, lw=0.5)
    panel.set_axisbelow(True)
    panel.axhline(0.0, color=RULE, lw=0.8, zorder=1)
    panel.spines[["top", "right"]].set_visible(False)
    panel.tick_params(length=2.5, width=0.6, labelsize=7)
