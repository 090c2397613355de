"""Temperatures over a capture: air and every material sensor, no words drawn."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from gateway.domain.values import FloatArray
from gateway.report.drawings.curves import NEW, OLD, REVERSE, calm
from gateway.report.drawings.plots import svg
from gateway.report.drawings.ruler import INK, ruled
from gateway.report.material import AmbientCourse

SIZE_MM = (90.0, 34.0)
LEAST_READINGS = 3
MATERIALS = (NEW, REVERSE, OLD)


def temperatures(course: AmbientCourse | None, name: str) -> str:
    """SVG: °C over minutes, air dashed, each material sensor solid; "" for fewer than three readings."""
    if course is None or len(course.ambients) < LEAST_READINGS:
        return ""
    return svg(SIZE_MM, lambda figure: _paint(figure, course), name)


def _paint(figure: Figure, course: AmbientCourse) -> None:
    panel = ruled(figure)[0, 0]
    figure.subplots_adjust(left=0.14, right=0.86, top=0.95, bottom=0.28)
    calm(panel, zero=False)
    minutes = (course.time_s - course.time_s[0]) / 60.0
    found: list[tuple[str, FloatArray, str, str]] = [
        ("air", _row([one.air_degc for one in course.ambients]), INK, "--")
    ]
    sensors = max(len(one.material_degc) for one in course.ambients)
    for place in range(sensors):
        values = [one.material_degc[place] if place < len(one.material_degc) else None for one in course.ambients]
        found.append((str(place + 1), _row(values), MATERIALS[place % len(MATERIALS)], "-"))
    for label, course_of, colour, line in found:
        if np.isfinite(course_of).any():
            panel.plot(minutes, course_of, line, color=colour, lw=1.1, marker="o", ms=2.2, mew=0)
            shown = "T" if label == "air" else f"M{label}"
            last = float(course_of[np.isfinite(course_of)][-1])
            panel.annotate(
                shown, (float(minutes[-1]), last), xytext=(4, 0), textcoords="offset points", fontsize=8, va="center"
            )
    panel.yaxis.set_major_locator(MaxNLocator(4))
    panel.ticklabel_format(useOffset=False)
    panel.set_xlabel("min", labelpad=1, fontsize=8)
    panel.set_ylabel("°C", labelpad=1, fontsize=8)


def _row(values: list[float | None]) -> FloatArray:
    return np.array([np.nan if one is None else one for one in values], dtype=np.float64)
