"""The annex' second half: the machine's errors, the ranking, the flank maps, the tables, the protocol, the hashes."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from itertools import zip_longest

from drivers.message import Message, Moment, joined, render
from drivers.terms import shown
from gateway.domain.outcomes import PushRecord
from gateway.domain.values import COVERAGE
from gateway.report.document.content import Block, Bullets, Heading, Pair, Paragraph, PictureBlock, TableBlock, Whole
from gateway.report.document.words import Tongue
from gateway.report.drawings import plots
from gateway.report.drawings import tooth as drawings
from gateway.report.material import AxisMaterial, ReportMaterial, TableMaterial, ToothMaterial
from gateway.report.sentences import ABSENT, UNIT, number, shortest, signed
from gateway.report.tooth.errors import error_rows
from gateway.report.tooth.rows import TableRow, cure_rows, table_rows
from gateway.tooth import DriveProposal, next_for_drive

TABLE_MM = (89.0, 60.0)
STEP = re.compile(r"^\d{4}-\d\d-\d\dT(\d\d:\d\d:\d\d)[^ ]* (.*)$", re.DOTALL)


def records(report: ReportMaterial, t: Tongue) -> tuple[Block, ...]:
    """Everything else that was recorded; hashes last and short, whole in the JSON file."""
    tooth = report.tooth
    found: list[Block] = []
    if tooth is not None:
        found += [*_errors(tooth, t), *_ranking(tooth, t), *_tables(tooth, t), *_maps(tooth, t)]
        found += drive_annex(None if tooth.proposal is None else tooth.proposal.drive, t)
    found += [*_pushes(report, t), *_remarks(report, t), *_hashes(report, t)]
    return tuple(found)


def _errors(tooth: ToothMaterial, t: Tongue) -> Iterator[Block]:
    if tooth.errors is None:
        return
    rows = tuple(
        (one.name, signed(one.low), signed(one.high), f"{number(one.U)} {UNIT[one.unit]}", t(one.state))
        for one in error_rows(tooth.errors)
    )
    half = -(-len(rows) // 2)
    yield Heading(t("errors"))
    yield PictureBlock(drawings.motions(tooth), drawings.WIDE, t("motions_said"))
    yield Paragraph(t("errors_said"), "small")
    lines = tuple((*rows[i], "", *(rows[half + i] if half + i < len(rows) else ("",) * 5)) for i in range(half))
    head = (t("error"), t("low"), t("high"), "U", t("state"))
    yield TableBlock((*head, "", *head), lines, "lrrrl" + "l" + "lrrrl", dense=True, wide=(5,))


def _ranking(tooth: ToothMaterial, t: Tongue) -> Iterator[Block]:
    if any(one.mu_star_um is not None for one in cure_rows(tooth)):
        yield Whole((Heading(t("ranking")), PictureBlock(drawings.ranking(tooth), drawings.WIDE, t("ranking_said"))))
    plane = drawings.plane(tooth)
    if plane:
        yield PictureBlock(plane, 120.0, t("plane_said"))


def _maps(tooth: ToothMaterial, t: Tongue) -> Iterator[Block]:
    for svg, said in ((drawings.maps(tooth), "maps_said"), (drawings.charts(tooth), "charts_said")):
        if svg:
            heading = (Heading(t("maps")),) if said == "maps_said" else ()
            yield Whole((*heading, PictureBlock(svg, drawings.WIDE, t(said))))


def drive_annex(drive: DriveProposal | None, t: Tongue) -> tuple[Block, ...]:
    """The drive that discs ground so will make: expected figures, what each goal costs, verdicts; nothing without one.

    Predicted, not tested: said above every figure.
    """
    if drive is None:
        return ()
    fields = {
        "name": drive.reducer,
        "datum": drive.datum,
        "goal": drive.goal,
        "error": number(drive.transmission_arcsec, 1),
        "U": number(COVERAGE * drive.transmission_u_arcsec, 1),
        "lost": number(drive.lost_motion_arcsec, 1),
        "lost_U": number(COVERAGE * drive.lost_motion_u_arcsec, 1),
        "trials": drive.trials,
    }
    rows = tuple(
        (one.name, number(one.flank_um), number(one.transmission_arcsec, 1), number(one.lost_motion_arcsec, 1))
        for one in drive.rows
    )
    head = (t("drive_tables"), "RMS, µm", t("drive_error"), t("drive_lost"))
    found: list[Block] = [
        Heading(t("drive")),
        Paragraph(t("drive_said", **fields)),
        TableBlock(head, rows, "lrrr", dense=True, wide=(0,)),
        Paragraph(t("drive_rows_said"), "small"),
    ]
    if drive.limits:
        judged = tuple(
            (
                t.known(f"drive_{one.name}", one.name),
                number(one.value_arcsec, 1),
                number(one.U_arcsec, 1),
                number(one.limit_arcsec, 1),
                t.known(f"drive_{one.verdict.replace(' ', '_')}", one.verdict),
            )
            for one in drive.limits
        )
        head_limits = (t("figure"), t("value"), "U", t("drive_limit"), t("drive_verdict"))
        found.append(TableBlock(head_limits, judged, "lrrrl", dense=True, wide=(0,)))
    costly = next_for_drive(drive.doubts)
    if costly is not None:
        found.append(Paragraph(t("drive_next", name=costly.error, cost=number(costly.cost_arcsec, 1))))
    return (Whole(tuple(found)),)


def _tables(tooth: ToothMaterial, t: Tongue) -> Iterator[Block]:
    rows = table_rows(tooth.tables, tooth.letters)
    if not rows:
        return
    told = tuple(
        (
            one.name,
            one.table,
            str(one.points),
            _grid(one),
            _span(one),
            t(f"push_{one.outcome}") if one.outcome else t("push_none"),
        )
        for one in rows
    )
    yield Heading(t("tables"))
    yield TableBlock(
        (t("table"), t("table_of"), t("points"), t("grid"), t("values"), t("pushed")),
        told,
        "llrlll",
        dense=True,
        wide=(5,),
    )
    svg = drawings.tables(tooth)
    if svg:
        yield PictureBlock(svg, drawings.WIDE, t("tables_said"))


def _grid(one: TableRow) -> str:
    """Where the points stand; one value alone, a reversal, stands nowhere."""
    if one.points == 1:
        return ABSENT
    return f"{shortest(one.minimum)} … {shortest(one.maximum)} / {shortest(one.step)} {UNIT[one.input_unit]}"


def _span(one: TableRow) -> str:
    values = signed(one.low) if one.points == 1 else f"{signed(one.low)} … {signed(one.high)}"
    return f"{values} {UNIT[one.unit]}"


def _pushes(report: ReportMaterial, t: Tongue) -> Iterator[Block]:
    drawn = [_axis_table(axis, t) for axis in report.axes if axis.change is not None and not axis.change.skipped]
    for left, right in zip_longest(drawn[::2], drawn[1::2], fillvalue=()):
        yield Whole((Pair(left, right),))
    every = [(one.change.name, one.push) for one in _all_tables(report) if one.push is not None]
    pushed = [(name, push) for name, push in every if push.steps or push.reasons]
    if not pushed:
        return
    yield Heading(t("protocol"))
    yield Paragraph(t("protocol_said"), "small")
    for name, push in pushed:
        transaction = t("transaction", number=push.transaction)
        yield Heading(f"{name}: {t('push_' + push.outcome)} ({transaction})", 2)
        if push.reasons:
            yield Paragraph(t("push_why", why=joined(push.reasons, t.language)))
        if push.marker:
            yield Paragraph(t("push_marker", why=render(push.marker, t.language)))
        if push.steps:
            yield _steps(push, t.language)


def _steps(push: PushRecord, language: str) -> TableBlock:
    """When and what, in two columns of lines; the details of each step stay in the record."""
    rows = [_step(one, language) for one in push.steps]
    half = -(-len(rows) // 2)
    pairs = zip_longest(rows[:half], rows[half:], fillvalue=("", ""))
    return TableBlock((), tuple((*left, *right) for left, right in pairs), "llll", dense=True, wide=(1, 3))


def _step(step: Message, language: str) -> tuple[str, str]:
    """The time of day and the step; what an older version stored is shown as stored."""
    said, at = render(step, language), step.fields.get("utc")
    if isinstance(at, Moment):
        return at.utc[11:19], said
    found = STEP.match(said)
    return (found[1], found[2].partition(":")[0]) if found else ("", said.partition(":")[0])


def _all_tables(report: ReportMaterial) -> tuple[TableMaterial, ...]:
    if report.tooth is not None and report.tooth.tables:
        return report.tooth.tables
    own = [TableMaterial(one.change, one.push) for one in report.axes if one.change is not None]
    return (*own, *(table for axis in report.axes for table in axis.beside))


def _axis_table(axis: AxisMaterial, t: Tongue) -> tuple[Block, ...]:
    """Half a page wide: two axes stand side by side."""
    svg = plots.table_change(axis, TABLE_MM)
    return (Heading(t("axis_table", axis=axis.axis), 2), PictureBlock(svg, TABLE_MM[0])) if svg else ()


def _remarks(report: ReportMaterial, t: Tongue) -> Iterator[Block]:
    """What the run itself noted, in the document's language."""
    said: list[tuple[str, str | Message]] = [("", text) for text in report.findings]
    for axis in report.axes:
        flags: list[str | Message] = [
            text for item in (axis.before, axis.after) if item is not None for text in item.flags
        ]
        said += [(f"{axis.axis}: ", text) for text in axis.findings]
        said += [(f"{axis.axis}: ", text) for text in flags]
    if report.tooth is not None:
        notes = [one.said for one in (report.tooth.errors, report.tooth.proposal) if one is not None]
        said += [("", text) for lines in notes for text in lines]
    if said:
        yield Heading(t("remarks"))
        yield Paragraph(t("remarks_said"), "small")
        yield Bullets(tuple(of + _remark(text, t.language) for of, text in dict.fromkeys(said)))


def _remark(text: str | Message, language: str) -> str:
    """A message in the document's language; what an older version stored as a sentence is shown as stored."""
    return shown(render(text, language, plain=True) if isinstance(text, Message) else text)


def _hashes(report: ReportMaterial, t: Tongue) -> Iterator[Block]:
    """One hash over all records and files: each of them stands whole in the JSON file."""
    told = [f"{name} {digest}" for name, digest in report.hashes.items()]
    told += [f"{one.path} {one.sha256}" for one in report.files]
    if told:
        digest = hashlib.sha256("\n".join(sorted(told)).encode()).hexdigest()
        yield Heading(t("hashes"))
        if report.hashes:
            yield Paragraph(t("hashes_said", count=len(report.hashes), files=len(report.files), digest=digest), "small")
        else:
            yield Bullets(tuple(f"{one.path}: sha256 {one.sha256}" for one in report.files))
