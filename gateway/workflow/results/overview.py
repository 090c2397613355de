"""The top of a run's folder: index.html says what lies where, results.csv holds the figures for a spreadsheet."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

from gateway.report import parameter_rows
from gateway.report.material import AxisMaterial, ReportMaterial
from gateway.report.tooth.rows import inspected_parts
from gateway.store import layout

COLUMNS = ("axis", "parameter", "unit", "before", "before_u", "after", "after_u", "change_pct")
DOUBLE = "SIMULATED"
MEANS = {
    "": "the run itself: report, figures, site file, proposal, verdict",
    "captures": "what was measured of each axis, before and after, and what was made of it",
    "setups": "every set-up of the measuring plan",
    "tables": "live tables, back-ups, and what each push did",
    "parts": "test parts: ground and inspected",
    "protocol": "every program that was sent to the control, in order",
    "raw": "readings as they came",
}
_HEAD = '<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title><h1>{title}</h1>\n'


def results_csv(axes: Iterable[AxisMaterial], *, simulated: bool = False) -> str:
    """One line for each axis and parameter: values and U (k = 2) before and after; empty where unknown.

    Where a double was in the loop each line says so in one more column.
    """
    word = (DOUBLE,) if simulated else ()
    text = io.StringIO()
    sheet = csv.writer(text, lineterminator="\n")
    sheet.writerow((*COLUMNS, *(one.lower() for one in word)))
    for axis in axes:
        for row in parameter_rows(axis.axis, axis.before, axis.after):
            values = ("" if (value := getattr(row, name)) is None else value for name in COLUMNS)
            sheet.writerow((*values, *word))
    return text.getvalue()


def gear_csv(report: ReportMaterial) -> str:
    """One line for each figure of each inspected part, um; "" without any. A double is told in one more column."""
    parts = inspected_parts(report.tooth) if report.tooth is not None else ()
    if not parts:
        return ""
    word = (DOUBLE,) if report.simulated else ()
    text = io.StringIO()
    sheet = csv.writer(text, lineterminator="\n")
    sheet.writerow(("part", "figure", "value_um", *(one.lower() for one in word)))
    for one in parts:
        for name, value in one.flank.figures.items() if one.flank is not None else ():
            sheet.writerow((one.part, name, value, *word))
    return text.getvalue()


def index_html(facts: Mapping[str, Any], *, simulated: bool = False) -> str:
    """Links to every file of a run, by what it is; they hold wherever the folder is taken."""
    names = [*(entry["file"] for entry in facts["stages"].values()), *facts["files"]]
    lines = [_HEAD.format(title=escape(f"Run {facts['run_id']}{f' {DOUBLE}' if simulated else ''}"))]
    lines.append('<p><a href="report.html">Report</a>, <a href="results.csv">results as a table</a></p>\n')
    for room, means in MEANS.items():
        found = sorted(place for place in (layout.place(name, facts) for name in names) if _room(place) == room)
        links = "".join(f'<li><a href="{escape(one)}">{escape(one)}</a></li>' for one in found)
        lines += [f"<h2>{escape(means)}</h2><ul>{links}</ul>\n"] if links else []
    return "".join(lines)


def _room(place: str) -> str:
    return place.rpartition("/")[0]
