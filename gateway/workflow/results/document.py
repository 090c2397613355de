"""The calibration report of a stored run as files: PDF with its results inside, and HTML of the same content."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path

from drivers.errors import ConfigError
from drivers.message import words
from drivers.types.doubts import Doubt
from gateway.config import SiteFile
from gateway.evaluate.behaviour.doubts import all_doubts, blocking_doubts
from gateway.report import ReportMaterial, as_json
from gateway.report.certificate.dcc import dcc, evaluated
from gateway.report.document.pdf import Attached, pdf
from gateway.report.document.web import page
from gateway.report.document.whole import document
from gateway.store import write_whole
from gateway.workflow.results.conformity import judge_limits
from gateway.workflow.results.overview import gear_csv, results_csv
from gateway.workflow.results.particulars import particulars_of

NAME = "calibration-report"


@dataclass(frozen=True, slots=True)
class DocumentOptions:
    """What is asked of a report beside its run: another language, another site file's letterhead; None: as recorded."""

    language: str = ""
    site: tuple[SiteFile, Path] | None = None
    accepted: Mapping[str, str] = field(default_factory=dict)

    @property
    def tree(self) -> SiteFile | None:
        """The other site file's content."""
        return self.site[0] if self.site is not None else None


@dataclass(frozen=True, slots=True)
class DocumentPaths:
    """Where the report was written; ``verdicts`` are those of its statement of conformity.

    ``doubts`` are codes of open doubts about the readings, each behind its axis.
    """

    number: str
    pdf: Path
    html: Path
    dcc: Path | None = None
    verdicts: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def as_data(self) -> dict[str, object]:
        """For --json."""
        paths = {"pdf": str(self.pdf), "html": str(self.html), "dcc": str(self.dcc) if self.dcc is not None else None}
        return {"number": self.number, **paths, "verdicts": list(self.verdicts), "doubts": list(self.doubts)}

    @property
    def files(self) -> tuple[Path, ...]:
        """Everything that was written."""
        return (self.pdf, self.html, *((self.dcc,) if self.dcc is not None else ()))


def with_options(material: ReportMaterial, told: DocumentOptions) -> ReportMaterial:
    """The material in the language and with the letterhead that were asked for. Raises as `particulars_of`."""
    found = material.particulars if told.site is None else particulars_of(*told.site, material.started_utc)
    if told.language:
        found = replace(found, language=told.language)
    material = replace(material, particulars=found)
    return material if told.site is None else replace(material, judged=judge_limits(told.site[0], material))


def write_document(material: ReportMaterial, folder: Path, written: datetime) -> DocumentPaths:
    """PDF and HTML into a folder, results.csv and report.json inside the PDF.

    Raises ConfigError (E-REPORT-LANGUAGE, E-CLI-WRITE), StoreError (E-REPORT-FONT, E-REPORT-PDF, E-STORE-DISK).
    """
    made = document(material)
    inside: tuple[Attached, ...] = (
        Attached(
            "results.csv",
            results_csv(material).encode(),
            "text/csv",
            words("S-ATTACHED-FIGURES"),
        ),
        Attached("report.json", json.dumps(as_json(material)).encode(), "application/json", "every value"),
    )
    certificate = dcc(material, made.number).encode() if evaluated(material) else b""
    if certificate:
        inside += (
            Attached(f"{NAME}.dcc.xml", certificate, "application/xml", "digital calibration certificate 3.1.2"),
        )
    gear = gear_csv(material)
    if gear:
        inside += (Attached("gear.csv", gear.encode(), "text/csv", words("S-ATTACHED-PARTS")),)
    paper = folder / f"{NAME}.pdf"
    screen = folder / f"{NAME}.html"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError("E-CLI-WRITE", str(folder), why=error.strerror or str(error)) from error
    write_whole(paper, pdf(made, written, inside))
    write_whole(screen, page(made).encode())
    xml = folder / f"{NAME}.dcc.xml" if certificate else None
    if xml is not None:
        write_whole(xml, certificate)
    verdicts = tuple(one.decision.verdict for one in material.judged)
    open_doubts = tuple(f"{axis} {one.code}" for axis, one in _open_doubts(material))
    return DocumentPaths(made.number, paper, html=screen, dcc=xml, verdicts=verdicts, doubts=open_doubts)


def _open_doubts(material: ReportMaterial) -> Iterator[tuple[str, Doubt]]:
    for axis in material.axes:
        capture = axis.capture_after if axis.capture_after is not None else axis.capture_before
        for one in blocking_doubts(all_doubts(capture)) if capture is not None else ():
            yield axis.axis, one
