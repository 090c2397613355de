"""Tooth and errors as the templates want them: rows, words and finished drawings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from drivers.message import words
from drivers.terms import spoken
from gateway.correct.outlook.flank_uncertainty import OpenDoubt
from gateway.report.drawings import tooth as tooth_drawings
from gateway.report.material import PartMaterial, ReportMaterial, ToothMaterial
from gateway.report.missing import missing
from gateway.report.sentences import value_sense
from gateway.report.tooth.cured import Share, shares
from gateway.report.tooth.errors import ErrorRow, error_rows
from gateway.report.tooth.flank import FlankState, close_up, shown, states, top_of
from gateway.report.tooth.rows import (
    CureRow,
    FigureRow,
    SetupRow,
    TableRow,
    cure_rows,
    figure_rows,
    inspected_parts,
    setup_rows,
    table_rows,
)

LEAST_CHANGE_UM = 0.01


@dataclass(frozen=True, slots=True)
class Drawings:
    """Finished drawings, "" where there is nothing to draw."""

    maps: Markup
    fine: Markup
    charts: Markup
    cured: Markup
    motions: Markup
    ranking: Markup
    tables: Markup


@dataclass(frozen=True, slots=True)
class ToothPage:
    """Everything the page says of errors and tooth; ``top`` and ``fine_top`` are the limits of the maps' scales, um."""

    material: ToothMaterial
    states: tuple[FlankState, ...]
    top: float
    fine_top: float
    inspected: tuple[PartMaterial, ...]
    figures: tuple[FigureRow, ...]
    setup: tuple[SetupRow, ...]
    shares: tuple[Share, ...]
    errors: tuple[ErrorRow, ...]
    cures: tuple[CureRow, ...]
    incurable: tuple[tuple[CureRow, ...], ...]
    tables: tuple[TableRow, ...]
    senses: tuple[tuple[str, str], ...]
    missing: tuple[str, ...]
    open: tuple[OpenDoubt, ...]
    said: tuple[tuple[str, tuple[str, ...]], ...]
    drawn: Drawings


def tooth_page(report: ReportMaterial) -> ToothPage | None:
    """The page's part about errors and tooth; None for a run that has neither."""
    tooth = report.tooth
    if tooth is None:
        return None
    found, cures = states(tooth), cure_rows(tooth)
    small = close_up(shown(found))
    return ToothPage(
        material=tooth,
        states=found,
        top=top_of(shown(found)) if found else 0.0,
        fine_top=top_of(small) if small else 0.0,
        inspected=inspected_parts(tooth),
        figures=figure_rows(tooth),
        setup=setup_rows(tooth),
        shares=shares(tooth.proposal.prediction) if tooth.proposal is not None else (),
        errors=error_rows(tooth.errors) if tooth.errors is not None else (),
        cures=cures,
        incurable=by_reason(cures),
        tables=table_rows(tooth.tables, tooth.letters),
        senses=senses(tooth),
        missing=tuple(map(str, missing(report))),
        open=tuple(one for one in tooth.open if one.change_um >= LEAST_CHANGE_UM),
        said=said(tooth),
        drawn=_drawings(tooth),
    )


def by_reason(cures: Sequence[CureRow]) -> tuple[tuple[CureRow, ...], ...]:
    """The errors that compensation does not take, those with the same reason together."""
    reasons = dict.fromkeys(one.why for one in cures if one.why)
    return tuple(tuple(one for one in cures if one.why == reason) for reason in reasons)


def said(tooth: ToothMaterial) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """What errors, proposal and inspections say of themselves: (of what, sentences), each sentence of parts once."""
    found = {"Errors": tuple(map(str, tooth.errors.said)) if tooth.errors is not None else ()}
    found["Proposal"] = tuple(map(str, tooth.proposal.said)) if tooth.proposal is not None else ()
    found[words("S-TOOTH-PROPOSAL")] = tuple(map(str, tooth.from_gear.said)) if tooth.from_gear is not None else ()
    parts = [(one.part, str(line)) for one in tooth.parts if one.flank is not None for line in one.flank.said]
    for line in dict.fromkeys(line for _, line in parts):
        names = "Inspection of " + ", ".join(f"“{name}”" for name, same in parts if same == line)
        found[names] = (*found.get(names, ()), line)
    return tuple((name, lines) for name, lines in found.items() if lines)


def senses(tooth: ToothMaterial) -> tuple[tuple[str, str], ...]:
    """Which way each layer acts on each output axis and how that is known; of tables that are proposed."""
    found: dict[str, str] = {}
    for one in tooth.tables:
        if not one.change.skipped:
            key = f"{spoken().kind(one.change.new.kind)} on {one.change.axis}"
            found.setdefault(key, value_sense(one.change.new, one.proof))
    return tuple(found.items())


def _drawings(tooth: ToothMaterial) -> Drawings:
    # Our own drawings, whose texts matplotlib has escaped as XML.
    return Drawings(
        maps=Markup(tooth_drawings.maps(tooth)),  # noqa: S704
        fine=Markup(tooth_drawings.fine_maps(tooth)),  # noqa: S704
        charts=Markup(tooth_drawings.charts(tooth)),  # noqa: S704
        cured=Markup(tooth_drawings.cured(tooth)),  # noqa: S704
        motions=Markup(tooth_drawings.motions(tooth)),  # noqa: S704
        ranking=Markup(tooth_drawings.ranking(tooth)),  # noqa: S704
        tables=Markup(tooth_drawings.tables(tooth)),  # noqa: S704
    )
