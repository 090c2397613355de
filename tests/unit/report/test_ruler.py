"""Ticks drawn in one go: the numbers and places are those that the panel's own axes have, and nothing else is said."""

from __future__ import annotations

import re

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from gateway.report.drawings.curves import calm
from gateway.report.drawings.plots import svg
from gateway.report.drawings.ruler import ruled


def texts(paint: object) -> list[str]:
    drawn = svg((80, 50), paint, "Drawing")  # type: ignore[arg-type]
    return re.findall(r"<text[^>]*>([^<]*)</text>", drawn)


def numbers(panel: Axes) -> tuple[list[str], list[str]]:
    """What matplotlib itself would write at the ticks in sight."""
    found = []
    for axis in (panel.xaxis, panel.yaxis):
        at, (low, high) = axis.get_majorticklocs(), sorted(axis.get_view_interval())
        told = axis.get_major_formatter().format_ticks(at)
        found.append([name for place, name in zip(at, told, strict=True) if low <= place <= high])
    return found[0], found[1]


def test_numbers_are_those_of_the_axes_in_sight_and_the_labels_follow() -> None:
    kept: list[Axes] = []

    def paint(figure: Figure) -> None:
        panel = figure.subplots()
        kept.append(panel)
        calm(panel)
        panel.plot(np.linspace(-400.0, 13.0, 7), np.linspace(-0.7, 2.1, 7))
        panel.yaxis.set_major_locator(MaxNLocator(4))
        panel.set_xlabel("X  mm")
        panel.set_ylabel("µm")

    found = texts(paint)
    along, up = numbers(kept[0])
    assert "−400" in along
    assert found == [*along, *up, "X  mm", "µm"]


def test_named_ticks_of_an_axis_turned_round_stand_in_its_order_and_hidden_numbers_are_not_written() -> None:
    def paint(figure: Figure) -> None:
        panel = figure.subplots()
        calm(panel, zero=False, grid="x")
        panel.barh([0, 1, 2], [3.0, 2.0, 1.0])
        panel.set_yticks([0, 1, 2], ["ECC", "EXC", "EYC"])
        panel.set_ylim(1.5, -0.5)
        panel.tick_params(labelbottom=False)

    drawn = svg((80, 50), paint, "Drawing")
    assert re.findall(r"<text[^>]*>([^<]*)</text>", drawn) == ["ECC", "EXC"], "out of sight is not drawn"
    heights = [float(found) for found in re.findall(r'<text[^>]*\by="([\d.]+)"', drawn)]
    assert not heights or heights[0] < heights[1], "the first one is the upper one"


def test_labels_of_panels_one_above_the_other_are_lined_up_where_asked() -> None:
    places = []

    def paint(figure: Figure) -> None:
        for panel, top in zip(figure.subplots(2, 1), (1.0, 1e5), strict=True):
            calm(panel).label_at = 30.0
            panel.plot([0.0, 1.0], [0.0, top])
            panel.set_ylabel("µm")
            places.append(panel)

    svg((80, 80), paint, "Drawing")
    first, second = (panel.yaxis.label.get_position()[0] for panel in places)
    assert first == second


def test_the_frame_stands_at_the_panel_and_not_at_the_zero_of_the_data() -> None:
    kept: list[Axes] = []

    def paint(figure: Figure) -> None:
        panel = ruled(figure)[0, 0]
        kept.append(panel)
        calm(panel, zero=False, grid="x")
        panel.barh([0, 1, 2], [3.0, 2.0, 1.0])
        panel.set_ylim(2.6, -0.6)

    svg((80, 80), paint, "Drawing")
    spines, box = kept[0].spines, kept[0].bbox
    assert spines["bottom"].get_window_extent().y0 == box.y0
    assert spines["left"].get_window_extent().x0 == box.x0
