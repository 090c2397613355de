"""Errors and tooth as plain values: what the page shows of them, and every record behind it."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.message import prose
from gateway.domain.values import COVERAGE
from gateway.report.material import ReportMaterial, TableMaterial, ToothMaterial
from gateway.report.missing import missing
from gateway.report.tooth.cured import shares
from gateway.report.tooth.errors import error_rows
from gateway.report.tooth.flank import FlankState, before_after, gain_pct, states
from gateway.report.tooth.page import said
from gateway.report.tooth.rows import cure_rows, figure_rows, inspected_parts, setup_rows, table_rows
from gateway.report.tooth.sentences import FIGURE, sentence


def summary(report: ReportMaterial) -> Mapping[str, object]:
    """The answer in few figures: outcome, words, the tooth's figure, what is missing."""
    tooth = report.tooth
    words = [prose(axis.verdict.words) for axis in report.axes if axis.verdict is not None]
    if tooth is not None and tooth.verdict is not None:
        words = [prose(tooth.verdict.words), *words]
    return {
        "outcome": report.outcome,
        "words": [sentence(report), *words],
        "tooth": _figures(tooth) if tooth is not None else None,
        "missing": tuple(map(str, missing(report))),
    }


def _figures(tooth: ToothMaterial) -> Mapping[str, object]:
    ground, fair, after = before_after(tooth)
    prediction = tooth.proposal.prediction if tooth.proposal is not None else None
    return {
        "before_um": ground,
        "before_set_right_um": fair,
        "after_um": after,
        "change_pct": gain_pct(tooth),
        "predicted_um": prediction.rms_um if prediction is not None else None,
        "predicted_U_um": COVERAGE * prediction.rms_u_um if prediction is not None else None,
        "within_prediction": tooth.verdict.within_prediction if tooth.verdict is not None else None,
    }


def tooth_data(report: ReportMaterial) -> Mapping[str, object] | None:
    """Rows as on the page, and the records: errors, proposal with its maps, parts with all points; None without."""
    tooth = report.tooth
    if tooth is None:
        return None
    names = [one.part for one in inspected_parts(tooth)]
    rows = table_rows(tooth.tables, tooth.letters)
    return {
        "kind": tooth.kind,
        "gear": tooth.gear,
        "gear_name": tooth.gear_name,
        "flank_figure": FIGURE,
        "flank": [_state(one) for one in states(tooth)],
        "figures_um": {row.name: dict(zip(names, row.values, strict=True)) for row in figure_rows(tooth)},
        "setup_values": [{"name": str(one.name), "values": one.values} for one in setup_rows(tooth)],
        "shares": shares(tooth.proposal.prediction) if tooth.proposal is not None else (),
        "errors": error_rows(tooth.errors) if tooth.errors is not None else (),
        "cures": cure_rows(tooth),
        "tables": [_table(one, row) for one, row in zip(tooth.tables, rows, strict=True)],
        "open": tooth.open,
        "advice": prose(tooth.advice),
        "said": dict(said(tooth)),
        "records": {
            "errors": tooth.errors,
            "proposal": tooth.proposal,
            "from_gear": tooth.from_gear,
            "wheel": tooth.wheel,
            "verdict": tooth.verdict,
            "parts": tooth.parts,
        },
    }


def _state(one: FlankState) -> Mapping[str, object]:
    found = {"key": one.key, "title": one.title, "source": one.source, "rms_um": one.rms, "largest_um": one.largest}
    # Maps that are a record stand in that record; only what was worked out here has no other place.
    extra = {"map": one.map} if one.source == "worked out" else {}
    return {**found, "map_rms_um": one.map.rms_um, "U_um": one.U, **extra}


def _table(one: TableMaterial, row: object) -> Mapping[str, object]:
    return {"row": row, "change": one.change, "push": one.push, "proof": one.proof}
