"""The top of a run's folder: index.html says what lies where, results.csv holds the figures for a spreadsheet."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from math import floor, isfinite, log10
from typing import Any

from drivers.message import words
from drivers.terms import shown
from gateway.report import parameter_rows
from gateway.report.material import AxisMaterial, ReportMaterial, ToothMaterial
from gateway.report.parameters import ParameterRow
from gateway.report.tooth.flank import before_after, states
from gateway.report.tooth.rows import inspected_parts
from gateway.store import stored_place
from gateway.workflow.results.conformity import figure_U

FLANK = "flank"
LATER = ("predicted",)
FEWEST, USUAL, MOST = 2, 3, 6
"""Decimals of figures in um and arcsec."""
FIGURES = 4
COLUMNS = ("axis", "parameter", "unit", "before", "before_u", "after", "after_u", "change_pct")
DOUBLE = "SIMULATED"
MEANS = {
    "": words("S-FOLDER-RUN"),
    "captures": words("S-FOLDER-AXES"),
    "setups": words("S-FOLDER-SETUPS"),
    "tables": words("S-FOLDER-TABLES"),
    "parts": words("S-FOLDER-PARTS"),
    "protocol": words("S-FOLDER-PROGRAMS"),
    "raw": words("S-FOLDER-READINGS"),
}
_HEAD = '<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title><h1>{title}</h1>\n'


def results_csv(report: ReportMaterial) -> str:
    """One line for each parameter of each axis and of the flank: values and U (k = 2); empty where unknown.

    Decimals by the uncertainty: two digits of U, three decimals without one. Where a double was in the loop each line
    says so in one more column.
    """
    word = (DOUBLE,) if report.simulated else ()
    text = io.StringIO()
    sheet = csv.writer(text, lineterminator="\n")
    sheet.writerow((*COLUMNS, *(one.lower() for one in word)))
    rows = [row for axis in report.axes for row in parameter_rows(axis.axis, axis.before, axis.after)]
    for one in (*map(_line, rows), *(_flank_lines(report.tooth) if report.tooth is not None else ())):
        sheet.writerow((*one, *word))
    return text.getvalue()


Line = tuple[str, ...]


def _line(row: ParameterRow) -> Line:
    figures = _pair(row.before, row.before_u), _pair(row.after, row.after_u)
    change = "" if row.change_pct is None else f"{row.change_pct:.1f}"
    return row.axis, row.parameter, row.unit, *figures[0], *figures[1], change


def _pair(value: float | None, U: float | None) -> tuple[str, str]:
    """A value and its U with the same decimals."""
    decimals = decimals_of(U)
    return tuple("" if one is None else f"{one:.{decimals}f}" for one in (value, U))  # type: ignore[return-value]


def decimals_of(U: float | None) -> int:
    """Decimals that show two digits of an uncertainty, from `FEWEST` to `MOST`; `USUAL` where it is unknown."""
    if U is None or not isfinite(U) or U <= 0.0:
        return USUAL
    return min(max(1 - floor(log10(U)), FEWEST), MOST)


def _flank_lines(tooth: ToothMaterial) -> Iterator[Line]:
    """The flank: each state of its RMS, then the figures of the first and the last inspected part."""
    known = {one.key if one.key != "part" else one.title: one for one in states(tooth)}
    ends = [known.pop(key, None) for key in ("before", "after")]
    if any(ends):
        rms = [one.rms if one is not None else None for one in ends]
        pairs = [_pair(one.rms, one.U) if one is not None else ("", "") for one in ends]
        yield FLANK, "RMS", "um", *pairs[0], *pairs[1], _change(rms)
    for name, one in known.items():
        pair, empty = _pair(one.rms, one.U), ("", "")
        yield FLANK, f"RMS {name}", "um", *(empty if name in LATER else pair), *(pair if name in LATER else empty), ""
    parts = [one for one in inspected_parts(tooth) if one.flank is not None]
    inspected = [parts[0], parts[-1]] if len(parts) > 1 else parts
    names = dict.fromkeys(name for one in inspected if one.flank is not None for name in one.flank.figures)
    for name in names:
        pairs = [_pair(one.flank.figures.get(name), figure_U(one.flank)) for one in inspected if one.flank is not None]
        pairs += [("", "")] * (2 - len(pairs))
        yield (
            FLANK,
            name,
            "um",
            *pairs[0],
            *pairs[1],
            _change([one.flank.figures.get(name) for one in inspected if one.flank]),
        )


def _change(ends: Sequence[float | None]) -> str:
    first, last = ends[0], ends[-1]
    return "" if len(ends) < len("ab") or not first or last is None else f"{100.0 * (last - first) / first:.1f}"


def gear_csv(report: ReportMaterial) -> str:
    """One line for each figure of each inspected part, um; "" without any. A double is told in one more column."""
    parts = inspected_parts(report.tooth) if report.tooth is not None else ()
    if not parts:
        return ""
    word = (DOUBLE,) if report.simulated else ()
    text = io.StringIO()
    sheet = csv.writer(text, lineterminator="\n")
    sheet.writerow(("part", "figure", "value_um", "U_um", *(one.lower() for one in word)))
    for one in parts:
        for name, value in one.flank.figures.items() if one.flank is not None else ():
            sheet.writerow(
                (one.part, name, *_pair(value, figure_U(one.flank) if one.flank is not None else None), *word)
            )
    return text.getvalue()


def index_html(facts: Mapping[str, Any], *, simulated: bool = False, lead: str = "", paper: str = "") -> str:
    """What `lead_of` says first, the report (``paper`` is its PDF), then links to every file of a run, by what it is.

    The links hold wherever the folder is taken.
    """
    names = [*(entry["file"] for entry in facts["stages"].values()), *facts["files"]]
    lines = [_HEAD.format(title=escape(f"Run {facts['run_id']}{f' {DOUBLE}' if simulated else ''}")), lead]
    papers = f'<a href="{escape(paper)}">Calibration report (PDF)</a>, ' if paper else ""
    lines.append(f'<p>{papers}<a href="report.html">Report</a>, <a href="results.csv">results as a table</a></p>\n')
    for room, means in MEANS.items():
        found = sorted(place for place in (stored_place(name, facts) for name in names) if _room(place) == room)
        links = "".join(f'<li><a href="{escape(one)}">{escape(one)}</a></li>' for one in found)
        lines += [f"<h2>{escape(means)}</h2><ul>{links}</ul>\n"] if links else []
    return "".join(lines)


def lead_of(report: ReportMaterial, picture: str) -> str:
    """The run at a glance: its picture and at most four figures, M of the first axes and the flank's RMS, as HTML."""
    rows = [
        (f"{one.axis} {row.parameter}", row.before, row.after, row.unit) for one in report.axes for row in _m_of(one)
    ]
    flank = before_after(report.tooth) if report.tooth is not None else (None, None, None)
    ground, fair, after = flank
    ends = (fair if fair is not None else ground), after
    tooth = [("flank RMS", *ends, "um")] if any(one is not None for one in ends) else []
    figures = [*rows[: FIGURES - len(tooth)], *tooth]
    cells = "".join(f"<tr><th>{escape(name)}<td>{_ends(old, new)}<td>{shown(unit)}" for name, old, new, unit in figures)
    image = f'<p><img src="{escape(picture)}" alt="before and after" style="max-width:100%"></p>\n' if picture else ""
    return f"{image}<table>{cells}</table>\n" if cells else image


def _m_of(axis: AxisMaterial) -> Iterator[ParameterRow]:
    return (row for row in parameter_rows(axis.axis, axis.before, axis.after) if row.parameter == "M")


def _ends(old: float | None, new: float | None) -> str:
    return " &rarr; ".join(f"{one:.2f}" for one in (old, new) if one is not None)


def _room(place: str) -> str:
    return place.rpartition("/")[0]
