"""A run's material as one document: its parts in order, its number, the word SIMULATED where a double took part."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import replace

from drivers.message import render
from gateway.domain.identity import KnownFact
from gateway.report.document.annex import axis_annex
from gateway.report.document.charts import axes
from gateway.report.document.content import (
    Block,
    Document,
    Heading,
    Letterhead,
    PageBreak,
    Paragraph,
    Signatures,
    Whole,
)
from gateway.report.document.equipment import equipment, methods
from gateway.report.document.first import answer, conditions, conformity, parties
from gateway.report.document.plain import as_plain
from gateway.report.document.records import records
from gateway.report.document.teeth import incurable, tooth, wheel
from gateway.report.document.words import Tongue
from gateway.report.material import ReportMaterial
from gateway.report.sentences import still_on

DIGITS = 6
DAY = re.compile(r"(\d{4})-(\d\d)-(\d\d)")


def document(material: ReportMaterial) -> Document:
    """The calibration report of a run or of files. Same material, same document: the number follows from it.

    Raises ConfigError (E-REPORT-LANGUAGE).
    """
    t = Tongue(material.particulars.language)
    blocks = (*_main(material, t), *_annex(material, t))
    said = material.particulars
    head = Letterhead(said.maker.laboratory, said.maker.address, said.maker.logo, said.maker.logo_ending)
    found = Document(
        title=said.title or t("title"),
        number="",
        language=said.language,
        letterhead=head,
        blocks=blocks,
        page_of=t("page_of", n="{n}", m="{m}"),
        number_word=t("number_word"),
        foot=t("foot", site=material.site, software=material.software) if material.site else material.software,
        simulated=t("simulated") if material.simulated else "",
        simulated_said=t("simulated_said") if material.simulated else "",
    )
    return _numbered(found, material)


def _main(material: ReportMaterial, t: Tongue) -> tuple[Block, ...]:
    said: tuple[str, ...] = (t("unprotected"),) if material.unprotected else ()
    who, why = material.excused
    said += (t("excused", who=who, why=why),) if why else ()
    said += tuple(accepted_words(one, t) for one in material.accepted)
    left = (render(line, t.language, plain=True) for line in still_on(material))
    warned = tuple(Paragraph(line, "strong") for line in (*left, *said))
    first = (*warned, *parties(material, t), *answer(material, t), *conformity(material, t))
    # Conditions stand with the axes they belong to: they fill what the charts leave of a page.
    of_axes = (*equipment(material, t), *axes(material, t), *conditions(material, t))
    of_tooth = (*tooth(material, t), *wheel(material, t), *incurable(material, t))
    return (*first, *of_axes, *of_tooth, _release(material, t))


def accepted_words(one: KnownFact, t: Tongue) -> str:
    """One change of the machine that a person accepted: from what to what, who, when and why."""
    told = {"fact": t(f"identity_{one.fact}"), "was": one.was, "now": one.value, "who": one.who}
    return t("identity", day=one.utc[:10], why=one.reason, **told)


def _release(material: ReportMaterial, t: Tongue) -> Whole:
    """Whoever signs sees on the same page by which methods: the signatures never stand alone."""
    told = (Heading(t("release")), Paragraph(t("release_said"), "small"), _signatures(material, t))
    return Whole((*methods(material, t), *told))


def _signatures(material: ReportMaterial, t: Tongue) -> Signatures:
    who = material.particulars.signatures or (t("calibrated_by"), t("checked_by"))
    return Signatures(who, t("place_and_date"))


def _annex(material: ReportMaterial, t: Tongue) -> tuple[Block, ...]:
    found = (*axis_annex(material, t), *records(material, t))
    return (PageBreak(), Heading(t("annex")), *found) if found else ()


def _numbered(found: Document, material: ReportMaterial) -> Document:
    """Prefix, day, the run's end, first digits of what the document says: another content, another number.

    The day is the run's; of files it is the day they were measured, and there is none where no file says it.
    """
    plain = as_plain(found, ())
    digest = hashlib.sha256(json.dumps(plain.data, sort_keys=True).encode())
    for name, data in sorted(plain.files.items()):
        digest.update(name.encode() + data)
    day, end = material.run_id[:8], material.run_id.rpartition("-")[2]
    if end == material.run_id or not day[:4].isdigit():
        measured = DAY.match(material.started_utc)
        day = "".join(measured.groups()) if measured else ""
    number = "-".join(
        part for part in (material.particulars.number_prefix.rstrip("-"), day, end, digest.hexdigest()[:DIGITS]) if part
    )
    return replace(found, number=number)
