"""Drawings of tooth and errors as inline SVG for the page and as PNG files beside it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from drivers.message import words
from gateway.model.error_model import ErrorModel
from gateway.report.drawings import errors as error_drawings
from gateway.report.drawings import flank as flank_drawings
from gateway.report.drawings import gears as gear_drawings
from gateway.report.drawings.plots import png, svg
from gateway.report.material import ToothMaterial
from gateway.report.tooth.cured import shares
from gateway.report.tooth.flank import FlankState, close_up, shown, states
from gateway.report.tooth.rows import cure_rows, table_name

Paint = Callable[[Figure], None]
Size = tuple[float, float]
WIDE = 182.0  # mm
INCH = 25.4


def maps(tooth: ToothMaterial) -> str:
    """SVG: flank maps from before to after on one scale, as ground only where nothing else tells before; "" without."""
    found = _on_scale(tooth)
    return _drawn(lambda figure: flank_drawings.flank_maps(figure, found), _map_size(len(found)), "Flank maps")


def _on_scale(tooth: ToothMaterial) -> tuple[FlankState, ...]:
    """The states that fit one scale: as ground may be any size, and its set-up values corrected tell the same."""
    found = shown(states(tooth))
    right = any(one.key == "before-set-right" for one in found)
    return tuple(one for one in found if one.key != "before" or not right)


def fine_maps(tooth: ToothMaterial) -> str:
    """SVG: predicted and after once more on a scale of their own; "" where that shows nothing new."""
    found = close_up(states(tooth))
    return _drawn(
        lambda figure: flank_drawings.flank_maps(figure, found), _map_size(len(found)), "Flank maps finer scale"
    )


def charts(tooth: ToothMaterial) -> str:
    """SVG: profile, lead, pitch and runout of the states; "" without any."""
    found = _charted(tooth)
    return _drawn(lambda figure: flank_drawings.charts(figure, found), (WIDE, 92.0 if found else 0.0), "Gear charts")


def motions(tooth: ToothMaterial) -> str:
    """SVG: every error motion; "" without any."""
    model = tooth.errors
    if model is None:
        return ""
    return _drawn(lambda figure: error_drawings.motions(figure, model), _motion_size(model), "Error motions")


def ranking(tooth: ToothMaterial) -> str:
    """SVG: the ranking as bars with intervals; "" where the errors were not ranked."""
    rows = [one for one in cure_rows(tooth) if one.mu_star_um is not None]
    size = (WIDE, 18.0 + 3.9 * len(rows) if rows else 0.0)
    return _drawn(lambda figure: error_drawings.ranking(figure, rows), size, "Ranking")


def plane(tooth: ToothMaterial) -> str:
    """SVG: mu* against sigma; "" where the errors were not ranked, or by a version that kept no sigma."""
    rows = [one for one in cure_rows(tooth) if one.sigma_um is not None]
    size = (120.0, 62.0) if rows else (0.0, 0.0)
    return _drawn(lambda figure: error_drawings.plane(figure, rows), size, "Ranking plane")


def tables(tooth: ToothMaterial) -> str:
    """SVG: cross tables, old and new; "" without any."""
    found = [
        (f"{one.change.name} = {table_name(one, tooth.letters)}", one.change)
        for one in tooth.tables
        if one.change.layer == "cross" and not one.change.skipped
    ]
    size = (WIDE, 34.0 * -(-len(found) // error_drawings.columns(len(found))) if found else 0.0)
    return _drawn(lambda figure: error_drawings.tables(figure, found), size, "Cross tables")


def cured(tooth: ToothMaterial) -> str:
    """SVG: what each cure takes of the flank's mean square; "" without a prediction."""
    rows = [] if tooth.proposal is None else shares(tooth.proposal.prediction)
    bars = [(one.by, one.taken_pct, one.left_pct, one.of_right_pct) for one in rows]
    size = (WIDE, 13.0 + 5.6 * len(bars) if bars else 0.0)
    return _drawn(lambda figure: error_drawings.shares(figure, bars), size, "Cures")


def before_after(tooth: ToothMaterial) -> str:
    """SVG: the gear before, set-up values corrected, and after, side by side; "" without both or without a gear."""
    found = _side_by_side(tooth, said=False)
    return svg(found[0][1], found[0][2], words("S-DRAW-GEAR")) if found else ""


def pictures(tooth: ToothMaterial, folder: Path, stamp: str = "") -> tuple[Path, ...]:
    """Maps, charts, the gear before and after, ranking and errors as PNG files, those there are, with a stamp.

    Raises StoreError (E-REPORT-WRITE).
    """
    found, model = shown(states(tooth)), tooth.errors
    rows = [one for one in cure_rows(tooth) if one.mu_star_um is not None]
    wanted: list[tuple[str, Size, Paint]] = []
    if found:
        wanted.append(("flank-maps", _map_size(len(found)), lambda figure: flank_drawings.flank_maps(figure, found)))
        charted = _charted(tooth)
        wanted.append(("flank-charts", (WIDE, 92.0), lambda figure: flank_drawings.charts(figure, charted)))
    wanted += _side_by_side(tooth)
    if rows:
        wanted.append(("ranking", (WIDE, 18.0 + 3.9 * len(rows)), lambda figure: error_drawings.ranking(figure, rows)))
    if model is not None and _motion_size(model)[1]:
        wanted.append(("errors", _motion_size(model), lambda figure: error_drawings.motions(figure, model)))
    return tuple(_file(folder / f"{name}.png", size, paint, stamp) for name, size, paint in wanted)


def _side_by_side(tooth: ToothMaterial, *, said: bool = True) -> list[tuple[str, Size, Paint]]:
    """The gear before (its set-up values corrected, so that the tables alone are seen) and after, where both are."""
    by, gear = {one.key: one for one in states(tooth)}, tooth.gear
    pair = [by.get("before-set-right"), by.get("after")]
    found = [one for one in pair if one is not None]
    if gear is None or len(found) < len(pair):
        return []
    return [("tooth-before-after", (WIDE, 82.0), lambda figure: gear_drawings.gears(figure, found, gear, said=said))]


def _charted(tooth: ToothMaterial) -> tuple[FlankState, ...]:
    found = shown(states(tooth))
    fair = any(one.source == "worked out" for one in found)
    left_out = ("model-own", "before", "model-before") if fair else ("model-own",)
    return tuple(one for one in found if one.key not in left_out)


def _map_size(count: int) -> Size:
    return WIDE, 16.0 + 21.0 * count if count else 0.0


def _motion_size(model: ErrorModel) -> Size:
    return WIDE, 29.0 * -(-len(error_drawings.motion_names(model)) // error_drawings.COLUMNS)


def _drawn(paint: Paint, size: Size, label: str) -> str:
    return svg(size, paint, label) if size[1] else ""


def _file(path: Path, size: Size, paint: Paint, stamp: str) -> Path:
    png((1.25 * size[0] / INCH, 1.25 * size[1] / INCH), paint, path, stamp)
    return path
