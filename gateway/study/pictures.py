"""A study's pictures as PNG files in a folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from drivers.terms import spoken
from gateway.errors import StoreError
from gateway.study import draw
from gateway.study.work import Study

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


def write_pictures(study: Study, folder: Path) -> tuple[Path, ...]:
    """Draw everything into a folder (made if missing). Raises StoreError E-STUDY-WRITE."""
    states = (
        ("as it is", study.before.deviation),
        (f"with {spoken().own} (axes corrected)", study.with_own.deviation),
        (f"with {spoken().own}, {spoken().cross} and set-up values", study.after.deviation),
    )
    pictures: tuple[tuple[str, tuple[float, float], Callable[[Figure], None]], ...] = (
        ("one-at-a-time", (11.0, 5.2), lambda figure: draw.one_at_a_time(figure, study)),
        ("flank-before-after", (11.0, 6.0), lambda figure: draw.flank_maps(figure, study, states)),
        ("ranking", (11.0, 5.6), lambda figure: draw.ranking(figure, study)),
        ("pitch", (9.0, 4.6), lambda figure: draw.pitch(figure, study)),
        ("axes-before-after", (11.0, 4.0), lambda figure: draw.axes_before_after(figure, study.correction.axes)),
    )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return tuple(_write(folder / f"{name}.png", size, paint) for name, size, paint in pictures)
    except OSError as error:
        raise StoreError("E-STUDY-WRITE", str(folder), why=error.strerror or str(error)) from error


def _write(path: Path, size: tuple[float, float], paint: Callable[[Figure], None]) -> Path:
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=size, dpi=DPI, facecolor="white")
        FigureCanvasAgg(figure)
        paint(figure)
        figure.savefig(path, format="png", metadata={"Software": None})
    return path
