"""The calibration report: whole pages in every language, SIMULATED on each, both renderings of one content."""

from __future__ import annotations

import csv
import io
import json
import re
import zlib
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime

import pytest
import typst

from drivers.message import Message, render
from drivers.types.identity import Identity
from gateway.acceptance.control import report_font_line
from gateway.domain.outcomes import PushRecord
from gateway.errors import StoreError, VerifyError
from gateway.push.phases import STEP_CODES, step_message, step_with_facts
from gateway.report import InstrumentNote, ReportMaterial
from gateway.report.document import words
from gateway.report.document.content import Document, FactsBlock, Heading, Pair, Signatures, TableBlock, Whole
from gateway.report.document.pdf import Attached, cjk_font, fonts_for, pdf
from gateway.report.document.plain import as_plain
from gateway.report.document.web import page
from gateway.report.document.whole import document
from gateway.report.drawings import positioning
from gateway.report.particulars import Maker, Particulars, Parties
from gateway.workflow.results.overview import decimals_of, results_csv
from tests.unit.report import closing, synthetic
from tests.unit.report.attacks import STRINGS

WRITTEN = datetime(2026, 3, 3, tzinfo=UTC)
STRING = re.compile(rb"\((?:\\.|[^\\()])*\)", re.DOTALL)
ESCAPE = re.compile(rb"\\([0-7]{1,3}|.)", re.DOTALL)
NAMED = {b"n": b"\n", b"r": b"\r", b"t": b"\t", b"b": b"\b", b"f": b"\f"}


def streams(made: bytes) -> Iterator[bytes]:
    """Every inflated stream of a PDF."""
    for found in re.finditer(rb"(?<!end)stream\r?\n", made):
        try:
            yield zlib.decompress(made[found.end() : made.index(b"endstream", found.end())])
        except zlib.error:
            continue


def glyphs(made: bytes) -> Iterator[int]:
    """The number of every glyph that a PDF shows; 0 is the one that stands for what a font has not."""
    for content in streams(made):
        for block in re.findall(rb"\bBT\b.*?\bET\b", content, re.DOTALL):
            for text in STRING.findall(block):
                raw = ESCAPE.sub(_escaped, text[1:-1])
                yield from (raw[at] << 8 | raw[at + 1] for at in range(0, len(raw) - 1, 2))


def _escaped(found: re.Match[bytes]) -> bytes:
    what = found[1]
    return bytes([int(what, 8)]) if what[:1].isdigit() else NAMED.get(what, what)


@pytest.fixture(scope="module")
def material() -> ReportMaterial:
    return replace(closing.material(), simulated=True)


@pytest.fixture(scope="module")
def made(material: ReportMaterial) -> Document:
    return document(material)


@pytest.fixture(scope="module")
def paper(made: Document) -> bytes:
    return pdf(made, WRITTEN, (Attached("results.csv", b"axis,A\n", "text/csv", "figures"),))


def pages(made: bytes) -> int:
    """How many pages a PDF has by its own count."""
    return sum(int(found) for found in re.findall(rb"/Type/Pages/Count (\d+)", b"".join((made, *streams(made)))))


def marked(made: bytes) -> int:
    """How many pages have the word across their middle, behind everything."""
    return sum(content.count(b"/Type/Background") for content in streams(made))


def test_no_glyph_is_missing_and_the_results_are_inside(paper: bytes) -> None:
    shown = list(glyphs(paper))
    assert len(shown) > 5000
    assert shown.count(0) == 0
    everything = b"".join((paper, *streams(paper)))
    assert b"results.csv" in everything
    assert b"axis,A\n" in everything
    assert b"pdfaid" in everything
    assert 6 <= pages(paper) <= 14


def test_a_glyph_that_no_font_has_is_seen_by_this_test() -> None:
    made = typst.compile(b'#set text(font: "DejaVu Sans", fallback: false)\n\xe4\xbd\xa0', ignore_system_fonts=False)
    assert 0 in set(glyphs(made))


def test_simulated_stands_on_every_page_and_nowhere_without_a_double(
    material: ReportMaterial, made: Document, paper: bytes
) -> None:
    assert as_plain(made, ()).data["simulated"] == "SIMULATED"
    assert page(made).count("SIMULATED") >= 2
    assert marked(paper) == pages(paper)
    real = document(replace(material, simulated=False, axes=(), tooth=None))
    assert "SIMULATED" not in page(real)
    assert marked(pdf(real, WRITTEN)) == 0


def test_signatures_stay_on_one_page_with_the_methods(made: Document) -> None:
    end = next(one.blocks for one in made.blocks if isinstance(one, Whole) and isinstance(one.blocks[-1], Signatures))
    assert [one.text for one in end if isinstance(one, Heading)] == ["Methods", "Release"]


def test_pages_and_paper_say_the_same(made: Document) -> None:
    html = page(made)
    told = "\n".join(texts(made.blocks))
    assert len(told) > 3000
    plain = re.sub(r"\s+", " ", _unescaped(re.sub(r"<[^>]+>", " ", html)))
    missing = [text for text in told.splitlines() if text.strip() and re.sub(r"\s+", " ", text.strip()) not in plain]
    assert missing == []
    assert not re.findall(r'(?:src|href)="(?!data:|#)', html)


def _unescaped(text: str) -> str:
    for mark, letter in (("&#39;", "'"), ("&#34;", '"'), ("&lt;", "<"), ("&gt;", ">"), ("&amp;", "&")):
        text = text.replace(mark, letter)
    return text


def texts(blocks: tuple[object, ...]) -> Iterator[str]:
    """Every text of these blocks, those inside others too."""
    for one in blocks:
        if isinstance(one, Pair):
            yield from texts((*one.left, *one.right))
        elif isinstance(one, Whole):
            yield from texts(one.blocks)
        elif isinstance(one, TableBlock):
            yield from (cell for row in (one.head, *one.rows) for cell in row)
        elif isinstance(one, FactsBlock):
            yield from (cell for row in one.rows if row[1] for cell in row)
        elif hasattr(one, "text"):
            yield one.text


@pytest.mark.parametrize("language", words.LANGUAGES)
def test_every_language_has_every_text_with_the_same_fields(language: str) -> None:
    english, other = words.catalogue_of("en"), words.catalogue_of(language)
    assert sorted(english) == sorted(other)
    fields = re.compile(r"\{(\w+)\}")
    assert {key: sorted(fields.findall(text)) for key, text in english.items()} == {
        key: sorted(fields.findall(text)) for key, text in other.items()
    }


@pytest.mark.parametrize("language", ["de", "zh"])
def test_a_report_in_another_language_is_whole(language: str) -> None:
    if language == "zh" and not cjk_font():
        pytest.skip("NOT RUN: this system has no font for Chinese")
    axis = synthetic.material()
    said = replace(axis, axes=axis.axes[:1], particulars=Particulars(language=language))
    made = document(said)
    plain = json.dumps(as_plain(made, ()).data, ensure_ascii=False)
    assert not re.search(r"[a-z]+ µm [a-z]+", plain), "a German word became a unit"
    assert made.title == words.catalogue_of(language)["title"] != "Calibration report"
    shown = list(glyphs(pdf(made, WRITTEN)))
    assert len(shown) > 1000
    assert shown.count(0) == 0


@pytest.mark.parametrize("language", ["de", "zh"])
def test_each_step_of_a_push_has_its_name_in_each_language(language: str) -> None:
    english = {render(step_message(kind)) for kind in STEP_CODES}
    assert len(english) == len(STEP_CODES)
    assert not english & {render(step_message(kind), language) for kind in STEP_CODES}
    assert render(step_message("BACKUP"), "de") == "alte Tabelle gesichert"


def test_the_protocol_and_its_reasons_are_in_the_documents_language_and_older_ones_as_stored() -> None:
    why = VerifyError("E-PUSH-UNCONFIRMED", "X1", axis="X1", why=Message.of("W-PUSH-TWO-READS"))
    steps = (
        step_with_facts("BACKUP", "2026-01-02T03:04:05.678+00:00", {}),
        Message.stored("2026-01-02T03:04:06 held: x"),
    )
    record = PushRecord(7, "X1", "rolled-back", steps, "", reasons=(why.message, Message.stored("an old reason")))
    first, *others = synthetic.material().axes
    said = replace(synthetic.material(), axes=(replace(first, push=record), *others))
    text = json.dumps(as_plain(document(replace(said, particulars=Particulars(language="de"))), ()).data)
    shown = json.loads(text)
    told = json.dumps(shown, ensure_ascii=False)
    assert "alte Tabelle gesichert" in told
    assert "03:04:05" in told
    assert "weichen von der Sicherung ab" in told
    assert "differ from the backup" not in told
    assert "an old reason" in told
    assert "held" in told


def test_nothing_that_a_stranger_names_becomes_markup() -> None:
    for name in (*STRINGS[:8], '#panic("x")', '"); #sys.version', "\\u{202e}", "$x$", "*strong* _a_ @ref <l>"):
        said = Particulars(parties=Parties(customer=name), maker=Maker(name, (name,)))
        one = document(replace(synthetic.material(), axes=(), site=name, particulars=said))
        assert "<script>alert" not in page(one)
        assert pdf(one, WRITTEN).startswith(b"%PDF-1.7")


def test_the_number_follows_from_what_is_said(made: Document, material: ReportMaterial) -> None:
    small = replace(material, axes=(), tooth=None)
    one, same = document(small), document(small)
    other = document(replace(small, particulars=Particulars(parties=Parties(customer="Another"))))
    prefixed = document(replace(small, particulars=Particulars(number_prefix="K-")))
    assert one.number == same.number != other.number
    assert prefixed.number.startswith("K-2026-03-")
    assert made.number


def test_addresses_paths_and_records_names_are_not_printed(material: ReportMaterial) -> None:
    laser = InstrumentNote("laser", Identity("umd", "uMD1", "socket://127.0.0.1:4"))
    told = "\n".join(
        texts(document(replace(material, tooth=None, axes=material.axes[:1], instruments=(laser,))).blocks)
    )
    assert "uMD1" in told
    assert "socket://" not in told
    assert "runs/2026" not in told
    assert "hidden-" not in told


def test_chart_labels_are_eight_points_or_more() -> None:
    axis = synthetic.axis_material("X1", "mm")
    assert axis.before is not None
    drawn = positioning.chart(axis.capture_before, axis.before, "X", "Chart")
    found = re.findall(r"<text[^>]*font-size: ([\d.]+)px[^>]*>([^<]*)</text>", drawn)
    assert len(found) > 8
    assert min(float(size) for size, _ in found) >= 8.0
    assert {"A", "E", "M", "R"} <= {text for _, text in found}


def test_fonts_come_in_the_order_they_are_tried() -> None:
    assert fonts_for("en")[-1 if not cjk_font() else -2] == "DejaVu Sans"


def test_doctor_names_the_font_and_a_missing_one_is_a_fault_only_where_it_is_needed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("gateway.report.document.pdf.cjk_font", lambda: "Some Sans")
    assert [(one.outcome, one.what) for one in report_font_line("zh")] == [
        ("ok", "reports in Chinese are written in Some Sans")
    ]
    monkeypatch.setattr("gateway.report.document.pdf.cjk_font", lambda: "")
    assert [one.outcome for one in report_font_line("en")] == ["ok"]
    assert [one.outcome for one in report_font_line("zh")] == ["wrong"]
    with pytest.raises(StoreError, match="font"):
        fonts_for("zh")


def test_the_table_of_results_has_the_flank_and_decimals_by_the_uncertainty(material: ReportMaterial) -> None:
    head, *rows = list(csv.reader(io.StringIO(results_csv(material))))
    flank = {row[1]: dict(zip(head, row, strict=True)) for row in rows if row[0] == "flank"}
    assert material.tooth is not None
    before, after = (material.tooth.part(name).flank for name in ("before", "after"))
    assert before is not None
    assert after is not None
    assert float(flank["RMS"]["before"]) == pytest.approx(before.fitted.rms_um, abs=0.005)
    assert float(flank["RMS"]["after"]) == pytest.approx(after.fitted.rms_um, abs=0.005)
    assert set(before.figures) <= set(flank)
    assert float(flank["F_p"]["before"]) == pytest.approx(before.figures["F_p"], abs=0.005)
    assert {row[0] for row in rows} == {*(axis.axis for axis in material.axes), "flank"}
    assert all(len(cell.partition(".")[2]) <= 6 for row in rows for cell in row[3:8])
    assert [decimals_of(U) for U in (23.1, 0.4, 0.055, 0.0021, None)] == [2, 2, 3, 4, 3]


def test_a_remark_about_figures_is_in_the_documents_language() -> None:
    first, *others = synthetic.material().axes
    assert first.before is not None
    flags = (Message.of("S-EVAL-CYCLE", cycle="pilgrim"), Message.of("S-EVAL-ONE-WAY"))
    said = replace(synthetic.material(), axes=(replace(first, before=replace(first.before, flags=flags)), *others))
    shown = [document(replace(said, particulars=Particulars(language=language))) for language in ("de", "zh")]
    german, chinese = (json.dumps(as_plain(one, ()).data, ensure_ascii=False) for one in shown)
    assert "nicht für eine Abnahme nach ISO 230-2" in german
    assert "不用于按 ISO 230-2 的验收" in chinese
    assert "unidirectional" not in german + chinese
