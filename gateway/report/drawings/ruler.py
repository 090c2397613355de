"""Grid, ticks, numbers and labels of a panel, drawn in one go.

A tick of matplotlib is five artists, and a report has a thousand ticks: they took most of its drawing. Places, numbers
and whether they are shown are still asked of the panel's two axes; only the drawing is done here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis, XAxis, YAxis
from matplotlib.backend_bases import RendererBase
from matplotlib.figure import Figure, FigureBase
from matplotlib.path import Path
from matplotlib.text import Text
from matplotlib.transforms import IdentityTransform
from numpy.typing import NDArray

from drivers.types.values import FloatArray

INK = "#22282e"
QUIET = "#6d757d"
FAINT = "#e4e7e9"
LENGTH = 2.5  # points, like every length here
PAD = 2.0
SIZE = 8.0
BEHIND = 0.5  # beneath whatever is drawn of data
WITHIN = 1e-6  # of the panel's size: a tick at its end is inside
_reach: dict[tuple[object, ...], tuple[float, float]] = {}


class _NoTicks:
    """Instead of the list that makes a tick as soon as somebody looks."""

    def __get__(self, axis: object, kind: object) -> list[Any]:
        return []

    def __set__(self, axis: object, ticks: object) -> None: ...

    def __delete__(self, axis: object) -> None: ...


class _Bare:
    """An axis that makes no tick of its own: places and numbers are asked of its locator and formatter alone."""

    majorTicks = minorTicks = cast(Any, _NoTicks())

    def get_major_ticks(self, *_: object) -> list[Any]:
        """None, however many are asked for."""
        return []

    get_minor_ticks = get_major_ticks


class _BareX(_Bare, XAxis):
    def get_ticks_position(self) -> Any:
        """Where a title need not make room for them."""
        return "bottom"


class _BareY(_Bare, YAxis):
    def get_ticks_position(self) -> Any:
        """Where no label need make room for them."""
        return "left"


class RuledPanel(Axes):
    """A panel whose ticks a `Ruler` draws. Making the first two ticks of each axis took a fifth of a report."""

    def _init_axis(self) -> None:
        self.xaxis, self.yaxis = _BareX(self, clear=False), _BareY(self, clear=False)
        for axis, sides in ((self.xaxis, ("bottom", "top")), (self.yaxis, ("left", "right"))):
            for side in sides:
                self.spines[side].register_axis(axis)


def ruled(figure: FigureBase, rows: int = 1, columns: int = 1, **how: Any) -> NDArray[Any]:
    """Panels for a `Ruler` each, shape (rows, columns); ``how`` as a figure's ``subplots`` takes it."""
    found: NDArray[Any] = figure.subplots(rows, columns, squeeze=False, subplot_kw={"axes_class": RuledPanel}, **how)
    return found


class Ruler(Artist):
    """Draws instead of the panel's own two axes, which it hides. Linear scales, labels below and at the left."""

    def __init__(self, panel: Axes, grid: str = "xy", size: float = SIZE, label_at: float | None = None) -> None:
        """``label_at`` (points left of the panel) lines up the labels of panels one above the other."""
        super().__init__()
        self.grid, self.label_at = grid, label_at
        self.set_zorder(BEHIND)
        self.set_in_layout(False)
        self._panel = panel
        self._text = Text(0.0, 0.0, "", fontsize=size, color=INK)
        panel.add_artist(self)
        for side in ("left", "bottom"):
            # Ticks put the frame where it belongs; without one it lies at the zero of the data.
            panel.spines[side].set_position(("outward", 0.0))
        figure = cast(Figure, panel.get_figure(root=True))
        self._text.set_figure(figure)
        for axis in (panel.xaxis, panel.yaxis):
            axis.set_visible(False)

    def draw(self, renderer: RendererBase) -> None:
        """Everything of both axes. The numbers come from one text that is moved from tick to tick."""
        if not self.get_visible():
            return
        pt = cast(float, renderer.points_to_pixels(1.0))
        box = self._panel.bbox
        x, y = self._ticks(self._panel.xaxis, box.x0, box.width), self._ticks(self._panel.yaxis, box.y0, box.height)
        down, left = box.y0 - LENGTH * pt, box.x0 - LENGTH * pt
        grid = [(at, box.y0, at, box.y1) for at, _ in x if "x" in self.grid]
        grid += [(box.x0, at, box.x1, at) for at, _ in y if "y" in self.grid]
        self._lines(renderer, grid, FAINT, 0.5 * pt)
        ticks = [(at, box.y0, at, down) for at, _ in x] + [(box.x0, at, left, at) for at, _ in y]
        self._lines(renderer, ticks, QUIET, 0.6 * pt)
        shown = self._panel.xaxis.get_tick_params(which="major").get("labelbottom", True)
        lowest = self._numbers(renderer, [(at, down - PAD * pt, name) for at, name in x if shown], "center", "top")
        shown = self._panel.yaxis.get_tick_params(which="major").get("labelleft", True)
        places = [(left - PAD * pt, at, name) for at, name in y if shown]
        leftmost = self._numbers(renderer, places, "right", "center_baseline")
        under, beside = self._panel.xaxis, self._panel.yaxis
        _label(renderer, under, 0.5 * (box.x0 + box.x1), min(lowest[1], down) - under.labelpad * pt)
        ends = min(leftmost[0], left) - beside.labelpad * pt
        _label(
            renderer, beside, ends if self.label_at is None else box.x0 - self.label_at * pt, 0.5 * (box.y0 + box.y1)
        )
        self.stale = False

    def _ticks(self, axis: Axis, start: float, length: float) -> list[tuple[float, str]]:
        """Pixel along the axis and number of each tick in sight."""
        at = np.asarray(axis.get_majorticklocs(), dtype=np.float64)
        names = axis.get_major_formatter().format_ticks(cast(Any, at))
        low, high = axis.get_view_interval()
        share = (at - low) / ((high - low) or 1.0)
        return [
            (start + length * float(part), name)
            for part, name in zip(share, names, strict=True)
            if -WITHIN <= part <= 1.0 + WITHIN
        ]

    def _numbers(
        self, renderer: RendererBase, places: Sequence[tuple[float, float, str]], ha: Any, va: Any
    ) -> tuple[float, float]:
        """Write numbers; return how far left and how far down they reach, pixels."""
        text = self._text
        text.set(ha=ha, va=va)
        reach = np.inf, np.inf
        look = (type(renderer), renderer.points_to_pixels(1.0), text.get_fontsize(), ha, va)
        for x, y, name in places:
            text.set(x=x, y=y, text=name)
            text.draw(renderer)
            if (*look, name) not in _reach:
                box = text.get_window_extent(renderer)
                _reach[(*look, name)] = box.x0 - x, box.y0 - y
            left, down = _reach[(*look, name)]
            reach = min(reach[0], x + left), min(reach[1], y + down)
        return reach

    def _lines(
        self, renderer: RendererBase, ends: Sequence[tuple[float, float, float, float]], colour: str, width: float
    ) -> None:
        if not ends:
            return
        corners: FloatArray = np.asarray(ends, dtype=np.float64).reshape(-1, 2)
        codes = np.tile(np.array([Path.MOVETO, Path.LINETO], dtype=np.uint8), len(ends))
        gc = renderer.new_gc()
        gc.set_foreground(colour)
        gc.set_linewidth(width)
        renderer.draw_path(gc, Path(corners, codes), IdentityTransform())
        gc.restore()


def _label(renderer: RendererBase, axis: Axis, x: float, y: float) -> None:
    """The axis's own label, whose text, size and colour its drawing has set."""
    text = axis.label
    if text.get_text():
        text.set_transform(IdentityTransform())
        text.set_position((x, y))
        text.draw(renderer)
