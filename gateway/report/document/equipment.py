"""What was measured with and how each is traceable, and by which methods the figures were made."""

from __future__ import annotations

from gateway.report.document.content import Block, Bullets, Heading, Paragraph, TableBlock
from gateway.report.document.words import Tongue
from gateway.report.material import InstrumentNote, ReportMaterial
from gateway.report.particulars import Registered
from gateway.report.sentences import ABSENT

CONTROL = "controller"  # the control is what was calibrated, not what it was calibrated with


def equipment(report: ReportMaterial, t: Tongue) -> tuple[Block, ...]:
    """Every device of the run as it named itself with what the register says of it, then the register's others."""
    register = report.particulars.register
    of = {one.instrument: one for one in register if one.instrument}
    rows = [_row(one, of.get(one.name), t) for one in report.instruments if one.name != CONTROL]
    known = {one.name for one in report.instruments}
    rows += [_other(one, t) for one in register if one.instrument not in known]
    if not register:
        rows += _of_files(report, t)
    lacking = () if register else (Paragraph(t("no_register"), "small"),)
    if not rows:
        return Heading(t("equipment"), 2), *lacking
    head = (t("equipment_name"), t("model"), t("serial"), t("traceability"), t("due"), "U, k = 2")
    return Heading(t("equipment"), 2), TableBlock(head, tuple(rows), "llllll", dense=True, wide=(1, 3)), *lacking


def _of_files(report: ReportMaterial, t: Tongue) -> list[tuple[str, ...]]:
    """The instruments that files state; no register says anything of their calibration."""
    found = dict.fromkeys(
        (one.of(file).get("instrument", ""), one.of(file).get("instrument_serial", ""))
        for one in (report.stated,)
        for file in dict.fromkeys(fact.file for fact in one.facts)
    )
    return [
        (
            t("by_files", value=name or t("instrument")),
            ABSENT,
            serial or ABSENT,
            t("no_certificate"),
            ABSENT,
            t("assumed_u"),
        )
        for name, serial in found
        if name or serial
    ]


def _row(one: InstrumentNote, said: Registered | None, t: Tongue) -> tuple[str, ...]:
    serial = serial_of(one.identity.serial)
    if said is None:
        return one.name, one.identity.model or ABSENT, serial, t("no_certificate"), ABSENT, t("assumed_u")
    own = _other(said, t)
    return said.name, said.model or one.identity.model or ABSENT, said.serial or serial, *own[3:]


def _other(one: Registered, t: Tongue) -> tuple[str, ...]:
    parts = (one.certificate, one.laboratory, one.calibrated)
    traced = ", ".join(part for part in parts if part) or t("no_certificate")
    due = f"{one.due} {t('overdue')}" if one.overdue else one.due
    return one.name, one.model or ABSENT, one.serial or ABSENT, traced, due or ABSENT, one.stated or t("assumed_u")


def serial_of(text: str) -> str:
    """A serial number as it may be printed: an address or a path is none."""
    return ABSENT if not text or "/" in text or "\\" in text else text


def methods(report: ReportMaterial, t: Tongue) -> tuple[Block, ...]:
    """How deviations count, what U covers, and what the flank's figure is."""
    said = [t("sign_convention"), t("coverage")]
    if report.tooth is not None:
        said.append(t("flank_figure"))
    return Heading(t("methods"), 2), Bullets(tuple(said)), Paragraph(report.software, "small")
