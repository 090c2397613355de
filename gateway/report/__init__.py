"""The report of a run: material in, one self-contained HTML page and the same figures as data out.

Drawing and templates are loaded when a report is made, not when this package is imported.
"""

from __future__ import annotations

from pathlib import Path

from gateway.report.material import (
    AxisMaterial,
    FileUsed,
    InstrumentNote,
    PartMaterial,
    ReportMaterial,
    TableMaterial,
    ToothMaterial,
)
from gateway.report.parameters import ParameterRow, parameter_rows

__all__ = [
    "TOOTH_PICTURES",
    "AxisMaterial",
    "FileUsed",
    "InstrumentNote",
    "ParameterRow",
    "PartMaterial",
    "ReportMaterial",
    "TableMaterial",
    "ToothMaterial",
    "as_json",
    "before_after_png",
    "parameter_rows",
    "render",
    "tooth_pictures",
]


TOOTH_PICTURES = ("flank-maps", "flank-charts", "tooth-before-after", "ranking", "errors")
"""Names of the pictures that `tooth_pictures` may draw, in their order."""


def render(material: ReportMaterial) -> str:
    """The report as one HTML document without any foreign request; plots are inline SVG."""
    from gateway.report import page

    return page.render(material)


def as_json(material: ReportMaterial) -> dict[str, object]:
    """The report as data that `json.dumps(..., allow_nan=False)` takes; NaN becomes None."""
    from gateway.report import data

    return data.as_json(material)


def tooth_pictures(material: ToothMaterial, folder: Path, *, simulated: bool = False) -> tuple[Path, ...]:
    """Draw flank maps, charts, ranking and errors, those there are, into a folder. Raises StoreError."""
    from gateway.report.drawings import plots, tooth

    return tooth.pictures(material, folder, plots.SIMULATED if simulated else "")


def before_after_png(material: ReportMaterial, path: Path) -> None:
    """Draw the before-after curves, one row per axis. Raises StoreError (E-REPORT-WRITE)."""
    from gateway.report.drawings import plots

    plots.before_after_png(material, path)
