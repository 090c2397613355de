"""A drawn figure: one style for all, shown by a notebook as it is, written as PNG."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from drivers.types.values import FloatArray
from gateway.errors import StoreError
from gateway.study import draw

DPI = 160
STYLE: dict[Any, Any] = {
    "font.size": 8.0,
    "text.parse_math": False,
    "axes.linewidth": 0.6,
    "axes.edgecolor": draw.RULE,
    "axes.labelcolor": draw.INK,
    "xtick.labelcolor": draw.INK,
    "ytick.labelcolor": draw.INK,
}
FULL = 1.08  # of what is drawn: the limits of a box in space
Paint = Callable[[Figure], None]


class Sheet(Figure):
    """A matplotlib figure that a notebook shows without a window or a magic word."""

    def _repr_png_(self) -> bytes:
        kept = BytesIO()
        with mpl.rc_context(STYLE):
            self.savefig(kept, format="png", metadata={"Software": None})
        return kept.getvalue()


def painted(size: tuple[float, float], paint: Paint) -> Sheet:
    """A sheet of that size in inches, painted."""
    with mpl.rc_context(STYLE):
        sheet = Sheet(figsize=size, dpi=DPI, facecolor="white")
        FigureCanvasAgg(sheet)
        paint(sheet)
    return sheet


def written(path: Path, size: tuple[float, float], paint: Paint) -> Path:
    """A sheet as a PNG file. Raises StoreError E-STUDY-WRITE."""
    sheet = painted(size, paint)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with mpl.rc_context(STYLE):
            sheet.savefig(path, format="png", metadata={"Software": None})
    except OSError as error:
        raise StoreError("E-STUDY-WRITE", str(path.parent), why=error.strerror or str(error)) from error
    return path


def in_space(panel: Any, points: FloatArray, *, zoom: float = 1.0) -> None:
    """Limits of a 3-D panel about points (..., 3) with equal scales, so that a right angle looks right."""
    flat = points.reshape(-1, 3)
    low, high = flat.min(axis=0), flat.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * FULL * np.maximum(high - low, 1e-9)
    for set_limits, at, room in zip((panel.set_xlim, panel.set_ylim, panel.set_zlim), middle, half, strict=True):
        set_limits(at - room, at + room)
    panel.set_box_aspect(half / half.max(), zoom=zoom)


def calm_space(panel: Any) -> None:
    """Faint walls and small figures of a 3-D panel."""
    for axis in (panel.xaxis, panel.yaxis, panel.zaxis):
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        axis.line.set_color(draw.RULE)
        axis._axinfo["grid"].update(color=draw.FAINT, linewidth=0.5)  # noqa: SLF001  matplotlib has no other way
    panel.tick_params(labelsize=6, pad=0)
