"""Disc, wheel, contact lines and flanks drawn in mm on equal scales; what errors change is enlarged, and said so."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PatchCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure, FigureBase
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from drivers.message import Message
from drivers.types.values import FloatArray
from drivers.units import mm_to_um
from gateway.gear.cycloid import CycloidGear
from gateway.gear.grinding import wheel_section, wheel_surface
from gateway.study.drawing import FAINT, INK, MAP, MIDDLE, NEW, OLD, QUIET, RULE
from gateway.study.export import outline, space_angles
from gateway.study.plots.charts import calm_space, in_space

POINTS = 181
NORMALS = 19
BODY = "#eef1f3"
SEGMENT = 7.0  # deg of the wheel that is drawn in space
CROWD = 5.0  # um: how far an outline for a picture may leave the curve
MOST_SHEETS = 60  # sheets of a surface that are drawn
NET = (12, 24)  # lines of a sheet, at most
SHARE = 0.12  # of the drawn size: what the largest deviation is enlarged to
STEPS = (1.0, 2.0, 5.0)
SYMBOLS = {"dx": "Δx", "dy": "Δy", "dz": "Δz", "ea": "εx", "eb": "εy", "ec": "εz"}


def profile_sheet(figure: FigureBase, gear: CycloidGear, space: int = 0) -> None:
    """The disc, one space with its outward normals, both on equal scales, and the curvature over the arc."""
    disc, near, bend = figure.subplots(1, 3, gridspec_kw={"width_ratios": (1.0, 1.0, 1.1)})
    figure.subplots_adjust(left=0.055, right=0.985, top=0.88, bottom=0.12, wspace=0.28)
    limits = gear.limits()
    points = outline(gear, CROWD)
    disc.fill(*points.T, facecolor="#eef1f3", edgecolor=NEW, lw=0.7)
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    for radius, style, name in (
        (gear.pin_circle, "-.", f"pins on {gear.pin_circle:g} mm"),
        (limits.r_tip, ":", f"tip {limits.r_tip:.3f} mm"),
        (limits.r_root, "--", f"root {limits.r_root:.3f} mm"),
    ):
        aside = -gear.a if radius == gear.pin_circle else 0.0  # the ring's centre, with the eccentric along x
        disc.plot(aside + radius * np.cos(turn), radius * np.sin(turn), ls=style, color=QUIET, lw=0.7, label=name)
    at = np.linspace(0.0, 2.0 * np.pi, gear.zp, endpoint=False)
    pins = np.stack([gear.pin_circle * np.cos(at) - gear.a, gear.pin_circle * np.sin(at)], axis=-1)
    disc.add_collection(
        PatchCollection(
            [Circle(tuple(one), gear.pin) for one in pins], facecolor="white", edgecolor=OLD, lw=0.6, zorder=3
        )
    )
    disc.legend(loc="center", frameon=False, fontsize=7)
    _equal(disc, f"{gear.zc} lobes, {gear.zp} pins of {gear.pin:g} mm, a {gear.a:g} mm")
    theta = space_angles(gear, POINTS)
    s = gear.space(theta, space)
    near.plot(s.x, s.y, color=NEW, lw=1.3)
    some = gear.space(space_angles(gear, NORMALS), space)
    length = 0.12 * float(np.ptp(s.xy, axis=0).max())
    for x, y, nx, ny in zip(some.x, some.y, some.nx, some.ny, strict=True):
        near.plot([x, x + length * nx], [y, y + length * ny], color=OLD, lw=0.8)
    _equal(near, f"space {space}, outward normals")
    bend.plot(gear.arc(theta), s.curvature, color=NEW, lw=1.2, label="curvature")
    bend.axhline(0.0, color=RULE, lw=0.8)
    bend.axhline(-1.0 / gear.pin, color=OLD, lw=0.8, ls="--", label=f"pin, 1/{gear.pin:g} mm, concave")
    bend.set_xlabel(Message.of("S-GEAR-ARC"))
    bend.set_ylabel("curvature, + convex  1/mm", labelpad=1)
    bend.legend(loc="upper center", frameon=False, fontsize=7)
    bend.set_title(f"undercut-free below pin radius {limits.rrp_max:.3f} mm", loc="left", fontsize=9, color=INK)
    _calm(bend)


def wheel_sheet(figure: FigureBase, gear: CycloidGear, centre_distance: float) -> None:
    """The dressed axial section with its normals, the wheel beside the gear, and a segment of its surface in space."""
    figure.text(0.055, 0.935, f"dressed wheel of {gear.zc} lobes, centre distance {centre_distance:g} mm", fontsize=10)
    _section(figure.add_axes((0.055, 0.13, 0.345, 0.68)), gear, centre_distance)
    _elevation(figure.add_axes((0.47, 0.13, 0.24, 0.68)), gear, centre_distance)
    panel: Any = figure.add_axes((0.715, 0.01, 0.285, 0.83), projection="3d")
    turn = np.radians(np.linspace(-SEGMENT, SEGMENT, 33))[:, None]
    section = wheel_section(gear, centre_distance, space_angles(gear, 81))
    points, _ = wheel_surface(section, turn)
    net = {"rstride": 2, "cstride": 4, "edgecolor": MIDDLE, "lw": 0.25, "shade": False}
    height = (section.R - section.R.min()) / float(np.ptp(section.R))
    colours = 0.96 - 0.32 * height[None, :, None] * np.array([1.0, 0.72, 0.5])
    panel.plot_surface(
        points[..., 0], points[..., 1], points[..., 2], facecolors=np.broadcast_to(colours, points.shape), **net
    )
    in_space(panel, points, zoom=0.86)
    calm_space(panel)
    panel.view_init(22.0, 222.0)
    panel.set_xticks([round(float(points[..., 0].max()))])
    panel.set_yticks([0.0, round(0.4 * float(np.ptp(section.y)))])
    panel.zaxis.set_major_locator(MaxNLocator(5))
    panel.set_xlabel("x  mm", labelpad=0)
    panel.set_ylabel("y  mm", labelpad=-1)
    panel.set_zlabel("z  mm", labelpad=2)
    figure.text(0.745, 0.855, f"surface within ± {SEGMENT:g} deg of the gear", fontsize=9, color=INK)


def _section(panel: Axes, gear: CycloidGear, centre_distance: float) -> None:
    """The axial section, the abrasive below it, with normals into the wheel and its radii and width."""
    section = wheel_section(gear, centre_distance, space_angles(gear, POINTS))
    wide, deep = float(np.ptp(section.y)), float(np.ptp(section.R))
    floor = float(section.R.min()) - 0.75 * deep
    panel.fill_between(section.y, section.R, floor, color=BODY, lw=0)
    panel.plot(section.y, section.R, color=NEW, lw=1.5)
    some = wheel_section(gear, centre_distance, space_angles(gear, NORMALS))
    length = 0.09 * wide
    for y, R, nx, ny in zip(some.y, some.R, some.nx, some.ny, strict=True):
        panel.plot([y, y + length * ny], [R, R - length * nx], color=OLD, lw=0.8)
    for radius in (float(section.R.max()), float(section.R.min())):
        panel.axhline(radius, color=QUIET, lw=0.6, ls=(0, (6, 3)), zorder=1)
    text = f"R {section.R.min():.3f} .. {section.R.max():.3f} mm"
    panel.text(0.02, 0.97, text, transform=panel.transAxes, fontsize=8, color=INK, va="top")
    at = floor + 0.12 * deep
    panel.annotate("", (section.y.min(), at), (section.y.max(), at), arrowprops={"arrowstyle": "<->", "lw": 0.7})
    panel.text(0.0, at + 0.03 * deep, f"width {wide:.3f}", fontsize=7, color=INK, ha="center", va="bottom")
    panel.set_xlabel("axial coordinate y  mm")
    panel.set_ylabel("radius R  mm")
    _equal(panel, "axial section, normals into the wheel", labels=False)


def _elevation(panel: Axes, gear: CycloidGear, centre_distance: float) -> None:
    """Wheel and gear as the stroke is seen from the side, along the wheel's axis."""
    section = wheel_section(gear, centre_distance, space_angles(gear, POINTS))
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    panel.fill(centre_distance + section.R.max() * np.cos(turn), section.R.max() * np.sin(turn), color=BODY, lw=0)
    for radius, width in ((float(section.R.max()), 1.2), (float(section.R.min()), 0.6)):
        panel.plot(centre_distance + radius * np.cos(turn), radius * np.sin(turn), color=NEW, lw=width)
    tip, half = gear.limits().r_tip, 0.5 * gear.b
    panel.fill([-tip, tip, tip, -tip], [-half, -half, half, half], facecolor="#dfe5ea", edgecolor=INK, lw=0.8)
    for x in (0.0, centre_distance):
        panel.axvline(x, color=QUIET, lw=0.6, ls="-.")
    low = -1.12 * float(section.R.max())
    panel.annotate("", (0.0, low), (centre_distance, low), arrowprops={"arrowstyle": "<->", "lw": 0.7})
    words: dict[str, Any] = {"fontsize": 7, "color": INK, "ha": "center", "va": "bottom"}
    panel.text(0.5 * centre_distance, low + 1.5, f"{centre_distance:g}", **words)
    panel.text(0.0, half + 3.0, "work", **words)
    panel.text(centre_distance, 0.35 * float(section.R.max()), "wheel", **words)
    panel.set_xlabel("x  mm")
    panel.set_ylabel("z  mm", labelpad=1)
    _equal(panel, "wheel and work, side view", labels=False)


def contact_sheet(figure: FigureBase, ideal: FloatArray, actual: FloatArray, *, enlarged: float = 0.0) -> None:
    """Contact lines (S, T, 3) of one space in the work: ideal, and actual with what errors change enlarged."""
    panel: Any = figure.add_axes((0.0, 0.02, 1.0, 0.9), projection="3d")
    scale = enlarged or _enlargement(
        float(np.max(np.abs(actual - ideal))), float(np.max(np.ptp(ideal.reshape(-1, 3), axis=0)))
    )
    shown = ideal + scale * (actual - ideal)
    for lines, colour, width in ((ideal, OLD, 0.8), (shown, NEW, 1.2)):
        panel.add_collection3d(Line3DCollection(list(lines), colors=colour, linewidths=width))
    in_space(panel, np.concatenate([ideal, shown]), zoom=0.93)
    calm_space(panel)
    panel.view_init(24.0, 40.0)
    panel.xaxis.set_major_locator(MaxNLocator(3))
    for name in "xyz":
        getattr(panel, f"set_{name}label")(f"{name}  mm", labelpad=-1)
    figure.text(0.03, 0.94, "contact lines of one space: grey ideal, blue actual", fontsize=9.5, color=INK)
    figure.text(0.03, 0.905, f"what the errors change is enlarged {scale:g} times", fontsize=8, color=QUIET)


def surface_sheet(figure: FigureBase, points: FloatArray, normals: FloatArray) -> None:
    """A surface (..., 3) in mm on equal scales as lines along its last two directions, with some unit normals."""
    panel: Any = figure.add_axes((0.0, 0.0, 1.0, 0.92), projection="3d")
    whole = points if points.ndim > 2 else points[None] if points.ndim == 2 else points[None, None]
    sheets = whole.reshape(-1, *whole.shape[-3:])
    arrows = normals.reshape(sheets.shape)
    shown = range(0, len(sheets), max(1, len(sheets) // MOST_SHEETS))
    size = float(np.max(np.ptp(sheets.reshape(-1, 3), axis=0))) or 1.0
    for number in shown:
        one, step = (
            sheets[number],
            [max(1, -(-count // most)) for count, most in zip(sheets.shape[1:3], NET, strict=True)],
        )
        lines = [*one[:: step[0]], *np.swapaxes(one, 0, 1)[:: step[1]]]
        panel.add_collection3d(Line3DCollection(lines, colors=MIDDLE, linewidths=0.5))
        at = (slice(None, None, 2 * step[0]), slice(None, None, 2 * step[1]))
        start, end = one[at].reshape(-1, 3), (one + 0.06 * size * arrows[number])[at].reshape(-1, 3)
        panel.add_collection3d(Line3DCollection(list(np.stack([start, end], axis=1)), colors=OLD, linewidths=0.5))
    in_space(panel, sheets, zoom=0.9)
    calm_space(panel)
    panel.view_init(28.0, 32.0)
    for axis in (panel.xaxis, panel.yaxis, panel.zaxis):
        axis.set_major_locator(MaxNLocator(4))
    for name in "xyz":
        getattr(panel, f"set_{name}label")(f"{name}  mm", labelpad=0)
    figure.text(
        0.03, 0.945, f"surface of {' x '.join(str(n) for n in points.shape[:-1])} points", fontsize=10, color=INK
    )
    figure.text(0.03, 0.91, "equal scales; grey: unit normals, enlarged", fontsize=8, color=QUIET)


def error_surfaces(
    figure: Figure,
    cases: Sequence[tuple[str, FloatArray, FloatArray, FloatArray]],
    *,
    columns: int,
    title: str,
) -> None:
    """Theoretical against actual tooth surface of one space for each case, all on one scale of colour and enlargement.

    A case is its name, nominal points (T, Z, 3) in mm, outward unit normals alike, and deviations (T, Z) in mm.
    """
    rows = -(-len(cases) // columns)
    top = max(mm_to_um(float(np.max(np.abs(e)))) for *_, e in cases)
    tall = float(np.max(np.ptp(cases[0][1].reshape(-1, 3), axis=0)))
    scale = _enlargement(top / mm_to_um(1.0), tall)
    width, height = figure.get_size_inches()
    low, high = 0.05 / height, 1.0 - 0.85 / height
    right = 1.0 - 0.75 / width
    cell = (right / columns, (high - low) / rows)
    for number, (name, nominal, normals, e) in enumerate(cases):
        row, column = divmod(number, columns)
        box = (0.005 + column * cell[0], high - (row + 0.94) * cell[1], cell[0], cell[1] * 0.9)
        panel: Any = figure.add_axes(box, projection="3d")
        actual = nominal + scale * e[..., None] * normals
        _net(panel, nominal)
        _skin(panel, actual, mm_to_um(e), top)
        far = _reach(nominal, normals, scale, top)
        in_space(panel, np.concatenate([nominal.reshape(-1, 3), far]), zoom=0.95)
        _bare(panel, labelled=number == 0)
        largest = mm_to_um(float(np.max(np.abs(e))))
        words = f"{SYMBOLS.get(name, name)}   largest {_figure(largest)} µm"
        figure.text(box[0] + 0.5 * cell[0], box[1] + 1.005 * box[3], words, fontsize=8, color=INK, ha="center")
    figure.text(0.012, 1.0 - 0.3 / height, title, fontsize=10, color=INK)
    note = f"grid: theoretical surface; coloured: actual, deviations enlarged {scale:g} times, one scale for all"
    figure.text(0.012, 1.0 - 0.52 / height, note, fontsize=8, color=QUIET)
    bar = figure.colorbar(
        ScalarMappable(Normalize(-top, top), MAP),
        cax=figure.add_axes((right + 0.1 / width, low + 0.05, 0.16 / width, high - low - 0.1)),
    )
    bar.ax.tick_params(labelsize=7)
    bar.ax.set_title("µm", fontsize=8, color=QUIET)
    bar.outline.set_edgecolor(RULE)


def _reach(nominal: FloatArray, normals: FloatArray, scale: float, top_um: float) -> FloatArray:
    """Points as far out as any case may be drawn, so that all panels have the same limits."""
    room = scale * top_um / mm_to_um(1.0)
    return np.concatenate([(nominal + side * room * normals).reshape(-1, 3) for side in (-1.0, 1.0)])


def _net(panel: Any, points: FloatArray) -> None:
    lines = [*points[::4], *np.swapaxes(points, 0, 1)]
    panel.add_collection3d(Line3DCollection(lines, colors=OLD, linewidths=0.35))


def _skin(panel: Any, points: FloatArray, values: FloatArray, top: float) -> None:
    """Facets coloured by the mean of their corners."""
    corners = np.stack([points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]], axis=2).reshape(-1, 4, 3)
    mean = 0.25 * (values[:-1, :-1] + values[1:, :-1] + values[1:, 1:] + values[:-1, 1:])
    colours = ScalarMappable(Normalize(-top, top), MAP).to_rgba(mean.ravel(), alpha=0.92)
    panel.add_collection3d(Poly3DCollection(corners, facecolors=colours, edgecolors=(0, 0, 0, 0.12), linewidths=0.15))


def _bare(panel: Any, *, labelled: bool) -> None:
    calm_space(panel)
    panel.view_init(28.0, 32.0)
    for axis in (panel.xaxis, panel.yaxis, panel.zaxis):
        axis.set_major_locator(_few())
    if not labelled:
        for axis in (panel.xaxis, panel.yaxis, panel.zaxis):
            axis.set_ticklabels([])
        return
    panel.tick_params(labelsize=5, pad=-3)
    for name in "xyz":
        getattr(panel, f"set_{name}label")(f"{name}  mm", labelpad=-6, fontsize=6)


def _few() -> MaxNLocator:
    return MaxNLocator(3)


def _enlargement(largest: float, size: float) -> float:
    """A round factor that shows the largest deviation (mm) as about `SHARE` of the size (mm)."""
    if not largest > 0.0:
        return 1.0
    wanted = SHARE * size / largest
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * power for step in STEPS if step * power <= wanted))


def _figure(value: float) -> str:
    return "0" if value < 1e-6 else f"{value:.2g}"


def _equal(panel: Axes, title: str, *, labels: bool = True) -> None:
    panel.set_aspect("equal", adjustable="datalim")
    panel.set_title(title, loc="left", fontsize=9, color=INK)
    if labels:
        panel.set_xlabel("x  mm")
        panel.set_ylabel("y  mm", labelpad=1)
    _calm(panel)


def _calm(panel: Axes) -> None:
    panel.grid(True, color=FAINT, lw=0.5)
    panel.set_axisbelow(True)
    panel.spines[["top", "right"]].set_visible(False)
    panel.tick_params(length=2.5, width=0.6, labelsize=7)
