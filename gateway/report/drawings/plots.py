"""Plots of a report: matplotlib figures through the object API, as inline SVG text or one PNG file."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from drivers.local.ownfiles import open_own
from gateway.errors import StoreError
from gateway.report.drawings import curves
from gateway.report.drawings.ruler import INK, QUIET
from gateway.report.material import AxisMaterial, ReportMaterial

# Every drawing names its colours; a cycle of ten would be made for each panel.
_ONE_COLOUR = mpl.cycler(color=[curves.NEW])  # type: ignore[attr-defined]
# One salt makes identical material give identical bytes; text stays text, so the page's own font is used.
# Names from outside reach the drawing, and a "$" in one must not start a formula.
_STYLE: dict[Any, Any] = {
    "svg.hashsalt": "trueflank",
    "axes.prop_cycle": _ONE_COLOUR,
    "svg.fonttype": "none",
    "text.parse_math": False,
    "font.size": 8.0,
    "axes.linewidth": 0.6,
    "axes.edgecolor": curves.RULE,
    "axes.labelcolor": INK,
    "axes.titlesize": 8.0,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "path.simplify": True,
}
_STAMP: dict[str, Any] = {
    "fontsize": 44,
    "weight": "bold",
    "color": "#a62b23",
    "alpha": 0.2,
    "rotation": 14,
    "zorder": 99,
}
SIMULATED = "SIMULATED"
_MM = 1.0 / 25.4
RASTER_DPI = 220


def before_after(axis: AxisMaterial) -> str:
    """SVG: deviations before and after side by side on one scale."""
    return svg((118, 50), lambda figure: curves.before_after(figure, axis), f"Deviations of {axis.axis}")


def table_change(axis: AxisMaterial, size: tuple[float, float] = (182, 68)) -> str:
    """SVG of ``size`` mm: old and new table, the difference beneath; "" when no new table was proposed."""
    change = axis.change
    if change is None or change.skipped:
        return ""
    return svg(size, lambda figure: curves.table_change(figure, change), f"Table of {axis.axis}")


def prediction(axis: AxisMaterial) -> str:
    """SVG: predicted curve with its uncertainty and what was measured; "" without a prediction."""
    change = axis.change
    if change is None or change.skipped or change.targets.size == 0:
        return ""
    size = (108, 70) if axis.rotary else (182, 52)
    return svg(size, lambda figure: curves.prediction(figure, axis, change), f"Prediction of {axis.axis}")


def acting(axis: AxisMaterial, *, words: bool = True) -> str:
    """SVG: the axis with every table acting, predicted and checked; "" where no cross table changes its curve."""
    outlook = axis.outlook
    if outlook is None or not outlook.spoilt or outlook.targets.size == 0:
        return ""
    name = f"Everything acting on {axis.axis}"
    return svg((182, 52), lambda figure: curves.acting(figure, axis, outlook, words=words), name)


def polar(axis: AxisMaterial) -> str:
    """SVG: mean deviation of a rotary axis around its turn, before and after; "" for a linear axis."""
    if not axis.rotary or (axis.before is None and axis.after is None):
        return ""
    return svg((76, 72), lambda figure: curves.polar(figure, axis), f"Polar deviation of {axis.axis}")


def before_after_png(material: ReportMaterial, path: Path) -> None:
    """One row per axis, before left and after right. Raises StoreError (E-REPORT-WRITE)."""
    rows = max(len(material.axes), 1)

    def paint(figure: Figure) -> None:
        for part, axis in zip(figure.subfigures(rows, 1, squeeze=False)[:, 0], material.axes, strict=False):
            curves.before_after(part, axis, heading=True)

    png((9.0, 2.35 * rows), paint, path, SIMULATED if material.simulated else "")


def png(size_inch: tuple[float, float], paint: Callable[[Figure], None], path: Path, stamp: str = "") -> None:
    """One drawing as a PNG file, a stamp across its middle. Raises StoreError (E-REPORT-WRITE)."""
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=size_inch, dpi=160, facecolor="white")
        FigureCanvasAgg(figure)
        paint(figure)
        if stamp:
            figure.text(0.5, 0.5, stamp, ha="center", va="center", **_STAMP)
        picture = io.BytesIO()
        figure.savefig(picture, format="png", metadata={"Software": None})
    _write(path, picture.getvalue())


def svg_file(size_mm: tuple[float, float], paint: Callable[[Figure], None], path: Path, stamp: str = "") -> None:
    """One drawing as an SVG file of its own, a stamp across its middle. Raises StoreError (E-REPORT-WRITE)."""
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(size_mm[0] * _MM, size_mm[1] * _MM), facecolor="white")
        paint(figure)
        if stamp:
            figure.text(0.5, 0.5, stamp, ha="center", va="center", **_STAMP)
        picture = io.BytesIO()
        figure.savefig(picture, format="svg", metadata={"Date": None})
    _write(path, picture.getvalue())


def _write(path: Path, content: bytes) -> None:
    try:
        with open_own(path, "wb") as file:
            file.write(content)
    except OSError as error:
        raise StoreError("E-REPORT-WRITE", str(path), why=error.strerror or str(error)) from error


def svg(size_mm: tuple[float, float], paint: Callable[[Figure], None], label: str) -> str:
    """A drawing as SVG text to stand in a page; cells of maps are one small picture inside it."""
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(size_mm[0] * _MM, size_mm[1] * _MM))
        paint(figure)
        text = io.StringIO()
        figure.savefig(text, format="svg", dpi=RASTER_DPI, transparent=True, metadata={"Date": None})
    return _inline(text.getvalue(), label)


def _inline(document: str, label: str) -> str:
    """Cut an SVG document down to what HTML needs: no prologue, no metadata, no namespaces, a fluid size."""
    body = document[document.index("<svg") :]
    body = re.sub(r"<metadata>.*?</metadata>\s*", "", body, flags=re.DOTALL)
    body = re.sub(r"<!--.*?-->\s*", "", body, flags=re.DOTALL)
    head, rest = body.split(">", 1)
    box = re.search(r'viewBox="[^"]*"', head)
    shape = box.group(0) if box else ""
    safe = re.sub(r"[^A-Za-z0-9 ]", "", label)
    return f'<svg {shape} role="img" aria-label="{safe}">{_own_ids(rest, safe)}'


def _own_ids(body: str, label: str) -> str:
    """Drawings share one page: prefix every id, and every reference to one, with the drawing's name."""
    prefix = label.replace(" ", "-").lower()
    body = re.sub(r'\bid="([^"]+)"', rf'id="{prefix}-\1"', body)
    body = re.sub(r"url\(#([^)]+)\)", rf"url(#{prefix}-\1)", body)
    body = re.sub(r'xlink:href="#([^"]+)"', rf'href="#{prefix}-\1"', body)
    return body.replace('xlink:href="data:image/png', 'href="data:image/png')
