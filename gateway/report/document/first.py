"""The first page: who, what machine, the answer, the statement of conformity, equipment and conditions."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from drivers.types.sensing import Ambient
from gateway.domain.captures import Capture
from gateway.report.document.content import Band, Block, Bullets, FactsBlock, Heading, Paragraph, State, TableBlock
from gateway.report.document.words import Tongue
from gateway.report.material import CONDITIONS, AxisMaterial, Outcome, ReportMaterial
from gateway.report.parameters import ParameterRow, parameter_rows
from gateway.report.sentences import ABSENT, UNIT, number, percent, when
from gateway.report.tooth.flank import before_after

STATES: dict[Outcome, State] = {"better": "good", "worse": "bad", "not-pushed": "open"}
RESULT_FILES, MOST_NAMED = ("result file", "imported"), 6
MOST_SIDE_BY_SIDE = 4
SITE = "site"
SIGNS = {"pass": "✔", "fail": "✖", "not decidable": "?"}


def parties(report: ReportMaterial, t: Tongue) -> tuple[Block, ...]:
    """For whom and at which machine: as the site file states it, else as the files do; else it is not stated."""
    said, own = report.particulars.parties, report.particulars.machine
    named = " ".join(part for part in (own.maker, own.type) if part)
    rows = (
        (t("customer"), "\n".join((said.customer, *said.customer_address)).strip() or _of_files("customer", report, t)),
        (t("machine"), named or _of_files("machine", report, t, report.site)),
        (t("order"), said.order or _of_files("order", report, t)),
        (t("machine_number"), own.number or _of_files("serial", report, t)),
        (t("place"), said.place or _of_files("place", report, t)),
        (t("year"), str(own.year) if own.year is not None else ""),
        (t("operator"), said.operator or _of_files("operator", report, t, report.operator)),
        (t("control"), _control(report) or t("not_stated")),
        (t("measured_on"), _span(report)),
        (t("run"), report.run_id),
        (t("result_files"), _files(report)),
        (t("accreditation"), report.particulars.maker.accreditation),
    )
    return (FactsBlock(rows, 2),)


def _of_files(key: str, report: ReportMaterial, t: Tongue, otherwise: str = "") -> str:
    """What the files state, marked as theirs; ``otherwise`` where they state nothing."""
    values = report.stated.values(key)
    return t("by_files", value=", ".join(values)) if values else otherwise or t("not_stated")


def _control(report: ReportMaterial) -> str:
    """Serial number and version of the control; a number that files state is the machine's."""
    serial = "" if report.machine.serial in report.stated.values("serial") else report.machine.serial
    return ", ".join(part for part in (serial, report.machine.version) if part)


def _files(report: ReportMaterial) -> str:
    """The result files that were evaluated, by name; none for what was measured at the machine."""
    names = [one.path for one in report.files if one.role in RESULT_FILES]
    more = len(names) - MOST_NAMED
    return ", ".join(names[:MOST_NAMED]) + (f" + {more}" if more > 0 else "")


def _span(report: ReportMaterial) -> str:
    first, last = when(report.started_utc), when(report.ended_utc)
    if first == last:
        return first
    return f"{first.removesuffix(' UTC')} – {last[11:] if first[:10] == last[:10] else last}"


def answer(report: ReportMaterial, t: Tongue) -> tuple[Block, ...]:
    """The band and, line by line, what each axis and the tooth were and are."""
    word, said = t(f"outcome_{report.outcome}"), t(f"outcome_{report.outcome}_said")
    lines = (said, *_tooth_line(report, t))
    found: list[Block] = [Heading(t("result")), Band(STATES.get(report.outcome, "plain"), word, lines)]
    rows = tuple(row for axis in report.axes for row in _axis_rows(axis, t))
    if rows:
        head = (t("axis"), t("figure"), t("as_found"), "U", t("as_left"), "U", t("change"), t("unit"))
        found.append(TableBlock(head, rows, "llrrrrrl", wide=(0, 6)))
        found.append(Paragraph(" ".join((*standards(report, t), t("figures_said"))), "small"))
    return tuple(found)


def standards(report: ReportMaterial, t: Tongue) -> tuple[str, ...]:
    """By which standard the figures are, and how certain its formulas are: said where the figures are."""
    found = [item for axis in report.axes for item in (axis.before, axis.after) if item is not None]
    said = (
        t("by_standard", standard=item.standard, certainty=t.known(f"certainty_{item.certainty}", item.certainty))
        for item in found
    )
    return tuple(dict.fromkeys(said))


def _tooth_line(report: ReportMaterial, t: Tongue) -> Iterator[str]:
    if report.tooth is None:
        return
    ground, fair, after = before_after(report.tooth)
    start = fair if fair is not None else ground
    verdict = report.tooth.verdict
    if verdict is not None and verdict.before_anew_um is not None and verdict.change_U_um is not None:
        yield t(
            "tooth_change",
            before=number(verdict.before_anew_um),
            after=number(verdict.after_um),
            change=number(verdict.change_um),
            U=number(verdict.change_U_um),
        )
    elif start is not None and after is not None:
        yield t("tooth_after", before=number(start), after=number(after))
    elif start is not None:
        yield t("tooth_before", before=number(start))


def _axis_rows(axis: AxisMaterial, t: Tongue) -> Iterator[tuple[str, ...]]:
    """A and M of an axis: what an acceptance asks for, and what a table can change; M over the travel where larger."""
    rows = {row.parameter: row for row in parameter_rows(axis.axis, axis.before, axis.after)}
    beyond = ("M_travel",) if "M" in rows and "M_travel" in rows and _larger(rows["M_travel"], rows["M"]) else ()
    for place, name in enumerate(("A", "M", *beyond)):
        if name in rows:
            row = rows[name]
            told = (
                percent(row.change_pct)
                if row.significant is not False
                else t("inside_u", change=percent(row.change_pct))
            )
            yield (
                f"{axis.axis}  {axis.component}" if place == 0 else "",
                t.known(f"figure_{name}", name),
                number(row.before),
                number(row.before_u),
                number(row.after),
                number(row.after_u),
                told,
                UNIT[row.unit],
            )


def _larger(travel: ParameterRow, targets: ParameterRow) -> bool:
    """Whether the range over the travel exceeds that of the targets, as printed, before or after."""
    pairs = ((travel.before, targets.before), (travel.after, targets.after))
    return any(one is not None and other is not None and round(one, 2) > round(other, 2) for one, other in pairs)


def conformity(report: ReportMaterial, t: Tongue) -> tuple[Block, ...]:
    """The statement of conformity with its rule; without a tolerance none is made, and that is said."""
    if not report.judged:
        return (Heading(t("conformity"), 2), Paragraph(t("no_tolerance")))
    names = {axis.axis for axis in report.axes}
    rows = tuple(
        (
            one.of if one.of in names else t("tooth_part", part=t.known(f"part_{one.of}", one.of)),
            one.standard,
            t.known(f"gear_{one.decision.parameter}", one.decision.parameter),
            t("as_left" if one.as_left else "as_found"),
            number(one.decision.value),
            number(one.decision.U),
            f"{one.decision.limit:g}",
            f"{SIGNS[one.decision.verdict]} {t('verdict_' + one.decision.verdict.replace(' ', '_'))}",
        )
        for one in report.judged
    )
    head = (t("axis"), t("standard"), t("figure"), t("state"), t("value"), "U", t("limit"), t("verdict"))
    verdicts = {one.decision.verdict for one in report.judged}
    last = "fail" if "fail" in verdicts else "not_decidable" if "not decidable" in verdicts else "pass"
    return (
        Heading(t("conformity"), 2),
        Paragraph(t(f"conforms_{last}"), "strong"),
        TableBlock(head, rows, "llllrrrl", dense=True, wide=(0, 7)),
        Paragraph(t("rule"), "small"),
    )


def conditions(report: ReportMaterial, t: Tongue) -> tuple[Block, ...]:
    """Air, material and state of each axis' captures."""
    rows = tuple(row for axis in report.axes for row in _condition_rows(axis, t))
    if not rows:
        return ()
    head = (t("axis"), t("state"), t("when"), t("air"), t("pressure"), t("humidity"), t("material"), t("readings"))
    return (
        Heading(t("conditions")),
        TableBlock(head, rows, "llllllll", dense=True, wide=(2, 6)),
        Paragraph(t("conditions_said"), "small"),
        *_tests(report, t),
        *_accepted(report, t),
    )


def _tests(report: ReportMaterial, t: Tongue) -> tuple[Block, ...]:
    """How the readings were taken, as ISO 230-2 lists it: each condition by name, stated or not."""
    columns: list[tuple[str, Mapping[str, str]]] = []
    for axis in report.axes:
        sides = [("as_found", axis.capture_before, axis.test_before), ("as_left", axis.capture_after, axis.test_after)]
        known = [(key, told) for key, capture, told in sides if capture is not None]
        alike = len({tuple(told.items()) for _key, told in known}) == 1
        columns += [(axis.axis if alike else f"{axis.axis}, {t(key)}", told) for key, told in known][
            : 1 if alike else 2
        ]
    if not columns:
        return ()
    rows = tuple(
        (t(f"test_{key}"), *(_told(key, told.get(key, ""), t) for _name, told in columns)) for key in CONDITIONS
    )
    groups = [columns[at : at + MOST_SIDE_BY_SIDE] for at in range(0, len(columns), MOST_SIDE_BY_SIDE)]
    tables = []
    for at, group in enumerate(groups):
        start = at * MOST_SIDE_BY_SIDE + 1
        body = tuple((row[0], *row[start : start + len(group)]) for row in rows)
        head = ("", *(name for name, _told in group))
        tables.append(TableBlock(head, body, "l" * len(head), dense=True, wide=tuple(range(1, len(head)))))
    return (Heading(t("tests"), 2), *tables)


def _told(key: str, value: str, t: Tongue) -> str:
    if not value:
        return t("not_stated")
    if key in ("cycle", "compensated"):
        return t.known(f"{key}_{value}", value)
    return t("tables_none") if key == "tables" and value in ("-", "none") else _minus(value)


def _accepted(report: ReportMaterial, t: Tongue) -> tuple[Block, ...]:
    """Statements of files that differ and that a person accepted, with both values."""
    if not report.stated.accepted:
        return ()
    told = tuple(
        t(
            "accepted",
            file=one.file,
            key=t(f"fact_{one.key}"),
            value=one.value,
            other=one.other,
            source=t("site_file") if one.source == SITE else one.source,
            day=f" ({one.utc[:10]})" if one.utc else "",
        )
        for one in report.stated.accepted
    )
    return (Heading(t("differences"), 2), Bullets(tuple(dict.fromkeys(told))))


def _minus(text: str) -> str:
    return re.sub(r"(?<![\w.])-(?=\d)", "−", text)


def _condition_rows(axis: AxisMaterial, t: Tongue) -> Iterator[tuple[str, ...]]:
    for key, capture in (("as_found", axis.capture_before), ("as_left", axis.capture_after)):
        if capture is not None:
            yield axis.axis, t(key), when(capture.started_utc), *_air(capture), _count(capture)


def _count(capture: Capture) -> str:
    return f"{capture.deviations.shape[0]} × {capture.deviations.shape[1]} × 2"


def _air(capture: Capture) -> tuple[str, str, str, str]:
    first, last = capture.ambient_start, capture.ambient_end
    return (
        _from_to(first.air_degc, last.air_degc, 2),
        _from_to(first.pressure_hpa, last.pressure_hpa, 1),
        _from_to(first.humidity_pct, last.humidity_pct, 0),
        _material(first, last),
    )


def _material(first: Ambient, last: Ambient) -> str:
    ends = [sum(one.material_degc) / len(one.material_degc) if one.material_degc else None for one in (first, last)]
    return _from_to(ends[0], ends[1], 2)


def _from_to(first: float | None, last: float | None, decimals: int) -> str:
    known = [number(one, decimals) for one in (first, last) if one is not None]
    return " – ".join(dict.fromkeys(known)) or ABSENT
