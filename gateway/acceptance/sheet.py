"""The site-acceptance sheet: every check with what was seen, what was left out and why, and lines to sign."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from importlib import metadata
from pathlib import Path

from drivers.checks import CheckLine, Outcome, gathered
from drivers.errors import ConfigError
from drivers.message import Message, advice, render
from drivers.probes import Level
from gateway.acceptance.checks import CheckResult
from gateway.config import SiteFile
from gateway.domain.identity import KnownFact
from gateway.report.document.content import (
    Band,
    Block,
    Document,
    FactsBlock,
    Heading,
    Letterhead,
    Paragraph,
    Signatures,
    State,
    TableBlock,
    Whole,
)
from gateway.report.document.web import page
from gateway.report.document.whole import accepted_words
from gateway.report.document.words import LANGUAGES, Tongue
from gateway.report.particulars import Particulars
from gateway.workflow.results.particulars import particulars_of

ENDINGS = (".html", ".pdf")
DIGITS = 6
OUTCOME_WORDS: Mapping[Outcome, str] = {"ok": "passed", "wrong": "failed", "unknown": "unknown", "skipped": "skipped"}
"""The outcome of a line, and its word in the document's catalogue."""


@dataclass(frozen=True, slots=True)
class Occasion:
    """What a sheet is about: the site, the level, the moment in UTC, and the language ("": the site file's).

    ``accepted`` are the changes of the machine that a person accepted before.
    """

    site: SiteFile
    site_path: Path
    level: Level
    moment: datetime
    language: str = ""
    accepted: tuple[KnownFact, ...] = ()


def check_sheet(path: Path, language: str) -> None:
    """Before anything is asked of a machine: raise ConfigError (E-ACCEPT-SHEET, E-REPORT-LANGUAGE, E-REPORT-EXTRA)."""
    if path.suffix.lower() not in ENDINGS:
        raise ConfigError("E-ACCEPT-SHEET", str(path), known=", ".join(ENDINGS))
    if language and language not in LANGUAGES:
        raise ConfigError("E-REPORT-LANGUAGE", "accept", language=language, known=", ".join(LANGUAGES))
    if path.suffix.lower() == ".pdf":
        try:
            import gateway.report.document.pdf  # noqa: F401, PLC0415 - an extra that only paper needs
        except ModuleNotFoundError as error:
            raise ConfigError("E-REPORT-EXTRA", str(path), library=error.name) from error


def write_sheet(path: Path, results: Collection[CheckResult], of: Occasion) -> None:
    """The sheet as PDF or HTML, as its name ends. Raises ConfigError (E-CLI-WRITE) and what the PDF raises."""
    made = sheet(results, of)
    if path.suffix.lower() == ".pdf":
        from gateway.report.document.pdf import pdf  # noqa: PLC0415 - as above

        data = pdf(made, of.moment)
    else:
        data = page(made).encode()
    try:
        path.write_bytes(data)
    except OSError as error:
        raise ConfigError("E-CLI-WRITE", str(path), why=str(error)) from error


def sheet(results: Collection[CheckResult], of: Occasion) -> Document:
    """The sheet's content. Raises ConfigError (E-REPORT-LANGUAGE)."""
    said = particulars_of(of.site, of.site_path)
    t = Tongue(of.language or said.language)
    made = Document(
        title=t("accept_title"),
        number="",
        language=t.language,
        letterhead=Letterhead(said.maker.laboratory, said.maker.address, said.maker.logo, said.maker.logo_ending),
        blocks=(_facts(of, said, t), *_changed(of, t), _answer(results, t), *_table(results, t), _signatures(t)),
        page_of=t("page_of", n="{n}", m="{m}"),
        number_word=t("number_word"),
        foot=t("foot", site=of.site.site.name, software=f"trueflank {metadata.version('trueflank')}"),
        simulated=t("simulated") if of.site.site.simulated else "",
        simulated_said=t("accept_simulated") if of.site.site.simulated else "",
    )
    records = [record for one in results for record in one.as_records()]
    digest = hashlib.sha256(json.dumps([records, of.moment.isoformat()]).encode()).hexdigest()
    return replace(made, number=f"{of.moment:%Y%m%d}-{digest[:DIGITS]}")


def _facts(of: Occasion, said: Particulars, t: Tongue) -> Block:
    own = said.machine
    machine = " ".join(str(part) for part in (own.maker, own.type, own.number, own.year) if part)
    rows = (
        (t("accept_site"), of.site.site.name),
        (t("accept_machine"), machine),
        (t("accept_serial"), of.site.controller.serial),
        (t("accept_allowance"), f"{of.level}: {t(f'accept_allow_{of.level}')}"),
        (t("accept_moment"), f"{of.moment:%Y-%m-%d %H:%M} UTC"),
        (t("accept_place"), said.parties.place),
    )
    return FactsBlock(rows, columns=1)


def _changed(of: Occasion, t: Tongue) -> tuple[Block, ...]:
    return tuple(Paragraph(accepted_words(one, t), "small") for one in of.accepted)


def _answer(results: Collection[CheckResult], t: Tongue) -> Band:
    lines = [line for one in results for line in gathered(one.lines)]
    count = {word: sum(line.outcome == outcome for line in lines) for outcome, word in OUTCOME_WORDS.items()}
    state: State = "bad" if count["failed"] else "open" if count["skipped"] or count["unknown"] else "good"
    told = (t("accept_count", **count), *((t("accept_skipped_said"),) if count["skipped"] else ()))
    return Band(state, t("accept_outcome_failed" if count["failed"] else "accept_outcome_passed"), told)


def _table(results: Collection[CheckResult], t: Tongue) -> tuple[Block, ...]:
    """A row a line; the check's name and what it looks at are said once for all its lines and axes."""
    head = tuple(t(f"accept_head_{name}") for name in ("check", "what", "outcome", "seen"))
    before: str | None = None
    rows: list[tuple[str, ...]] = []
    strong: list[int] = []
    for one in results:
        what = "" if one.check == before else t(f"accept_what_{one.check}")
        name = f"{t(f'accept_name_{one.check}')} {one.axis}".strip()
        for line in gathered(one.lines):
            if line.outcome == "wrong":
                strong.append(len(rows))
            rows.append((name, what, t(f"accept_outcome_{OUTCOME_WORDS[line.outcome]}"), _seen(line, t)))
            name = what = ""
        before = one.check
    return (
        Heading(t("accept_checks")),
        TableBlock(head, tuple(rows), "llll", tuple(strong), dense=True, wide=(1, 3)),
    )


def _seen(line: CheckLine, t: Tongue) -> str:
    """A line in the sheet's language; with what to do where something is not in order."""
    said = Message(line.code, line.fields)
    todo = advice(said, t.language) if line.fix else ""
    return f"{render(said, t.language)} -> {todo}" if todo else render(said, t.language)


def _signatures(t: Tongue) -> Block:
    who = Signatures((t("accept_tested_by"), t("accept_accepted_by")), t("place_and_date"))
    return Whole((Heading(t("release")), who))
