"""The page of errors and tooth: every figure with its unit, self-contained, escaped, honest when stages are missing."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest

from drivers.message import Message, prose
from gateway.model.error_model import ErrorModel, LocationError
from gateway.report import PartMaterial, ReportMaterial, TableMaterial, ToothMaterial, render
from gateway.report.drawings import tooth as tooth_drawings
from gateway.report.sentences import number, signed
from gateway.report.tooth.flank import states
from gateway.tooth import FlankMap, GroundPart, SetupValues
from tests.unit.report import closing
from tests.unit.report.attacks import STRINGS
from tests.unit.report.test_page import Outline

UNITS = {"µm", "arcsec", "mm", "deg", "°C", "%"}
COUNTS = {"points", "rank", "spaces"}
NUMBER = re.compile(r"[±+−]?\s?\d+(\.\d+)?")
PICTURE = re.compile(r'href="data:image/png;base64,[A-Za-z0-9+/=\s]+"')


class Tables(HTMLParser):
    """All tables of a page as rows of (class, text)."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tables: list[list[list[tuple[str, str]]]] = []
        self._cell: list[str] | None = None
        self._class = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self._cell, self._class = [], dict(attrs).get("class") or ""

    def handle_endtag(self, tag: str) -> None:
        if tag in ("td", "th") and self._cell is not None:
            self.tables[-1][-1].append((self._class, " ".join("".join(self._cell).split())))
            self._cell = None

    def handle_data(self, data: str) -> None:
        if self._cell is not None:
            self._cell.append(data)


@pytest.fixture(scope="module")
def material() -> ReportMaterial:
    return replace(closing.material(), axes=())


def test_the_verdict_and_the_tooths_figure_come_first(document: str, material: ReportMaterial) -> None:
    tooth = material.tooth
    assert tooth is not None
    assert tooth.verdict is not None
    verdict, text = tooth.verdict, Outline(document).text
    wanted = [
        prose(verdict.words).replace(" um", " µm"),
        f"{number(verdict.before_set_right_um)} µm",
        f"{number(verdict.after_um)} µm",
        "0.21 ± 0.08 µm",
        "one scale for all maps",
        "Profile, lead, pitch and runout",
        "Set-up values are work offsets",
        "Which correction acted on what",
        "The errors of the machine",
        "Ranking",
        "What cannot be compensated, and why",
        "The tables",
        "Instruments and records",
    ]
    places = [text.find(item) for item in wanted]
    assert -1 not in places
    assert places == sorted(places)


def test_every_figure_stands_in_a_column_or_row_with_its_unit(document: str) -> None:
    tables = Tables(document).tables
    found = 0
    for table in tables:
        heads = [text for _, text in table[0]]
        for row in table[1:]:
            in_row = any(kind == "u" and text in UNITS for kind, text in row)
            for place, (kind, text) in enumerate(row):
                if "n" not in kind.split() or not NUMBER.fullmatch(text):
                    continue
                found += 1
                head = heads[place] if place < len(heads) else ""
                own = bool(UNITS & set(head.split())) or head in COUNTS
                assert own or in_row, (head, row)
    assert found > 200


def test_figures_on_the_page_are_those_of_the_records(document: str, material: ReportMaterial) -> None:
    tooth = material.tooth
    assert tooth is not None
    assert tooth.proposal is not None
    cells = [[text for _, text in row] for table in Tables(document).tables for row in table]
    for one in states(tooth):
        U = f"± {number(one.U)}" if one.U is not None else "–"
        assert [f"{one.title} ({one.source})", number(one.rms), U, number(one.largest)] in cells
    for cure in tooth.proposal.cures:
        row = next(row for row in cells if row[0] == cure.error and len(row) == 5 and row[3] != "–" and row[1:3])
        assert row
        assert [cure.error, number(cure.rms_um, 3), number(cure.floor_um, 3)] in [line[:3] for line in cells]
    for part in tooth.parts:
        assert part.ground is not None
        values = part.ground.setup
        told = [f"part “{part.part}”", signed(values.x_um), signed(values.c_arcsec), signed(values.dressing_um)]
        assert told in cells
    assert ["X1-cec0", "CEC", "X(Z)", "9", "−10", "10", "2.5", "mm", "−3.00", "+3.00", "µm"] in [r[:11] for r in cells]


def test_nothing_is_fetched_and_nothing_runs(document: str) -> None:
    assert PICTURE.search(document)
    bare = PICTURE.sub('href="#"', document)
    outline = Outline(bare)
    assert re.search(r"(?:https?:)?//[a-z]", bare) is None
    assert outline.tags.keys().isdisjoint({"script", "link", "img", "iframe", "object", "embed", "base"})
    links = [value or "" for name, value in outline.attributes if name in {"href", "src", "xlink:href"}]
    assert all(value.startswith("#") for value in links)
    used = set(re.findall(r"url\(#([^)]+)\)", bare)) | set(re.findall(r'href="#([^"]+)"', bare))
    assert used <= set(outline.ids)
    assert len(outline.ids) == len(set(outline.ids))
    assert tooth_drawings.maps(closing.tooth()) in document  # drawn anew: the same bytes


def _small(text: str) -> FlankMap:
    return FlankMap(np.array([-0.1, 0.1]), np.array([0.0, 1.0]), np.ones((2, 2, 2)))


def hostile(text: str) -> ReportMaterial:
    """Small material in which every name that comes from outside is this text."""
    flank = replace(closing.inspected(text, _small(text)), source=text, serial=text, figures={text: 1.0})
    flank = replace(flank, said=(Message.stored(text),))
    old = closing.proposal()
    made = replace(
        old,
        prediction=replace(old.prediction, before=_small(text), with_own=_small(text), after=_small(text)),
        cures=(replace(old.cures[0], error=text, by=f"{text} in part"),),
        ranking=(replace(old.ranking[0], error=text),),
        said=(Message.stored(text),),
    )
    change = closing.cross_table("X", "Z", 0).change
    new = replace(change.new, input_axis=text, output_axis=text)
    table = TableMaterial(replace(change, axis=text, new=new))
    skipped = TableMaterial(replace(change, axis=text, new=new, skipped=Message.stored(text)))
    tooth = ToothMaterial(
        ErrorModel(
            (), (LocationError(text, 1.0, 0.1, "arcsec", (Message.stored(text),)),), said=(Message.stored(text),)
        ),
        made,
        replace(closing.tooth().verdict or pytest.fail("no verdict"), words=(Message.stored(text),)),
        (PartMaterial(text, GroundPart(text, SetupValues(), 2, text, text), flank),),
        (table, skipped),
        gear_name=text,
        advice=(Message.stored(text),),
    )
    return replace(closing.material(), axes=(), tooth=tooth, findings=(text,))


@pytest.fixture(scope="module")
def harmless() -> Outline:
    return Outline(render(hostile("harmless")))


@pytest.mark.parametrize("attack", [STRINGS[0], STRINGS[28], STRINGS[29]])
def test_no_name_becomes_markup(attack: str, harmless: Outline) -> None:
    outline = Outline(render(hostile(attack)))
    for tag in ("script", "img", "iframe", "object", "embed", "link", "base", "input"):
        assert outline.tags.get(tag, 0) == 0
    for tag in ("meta", "style", "title", "svg", "a", "li", "section", "table", "tr"):
        assert outline.tags.get(tag, 0) == harmless.tags.get(tag, 0)
    assert [name for name, _value in outline.attributes if name.startswith("on")] == []
    assert "\x00" not in outline.text
    assert "\u202e" not in outline.text
    assert harmless.text.count("harmless") > 20


PARTIAL: list[tuple[str, dict[str, Any], tuple[str, ...]]] = [
    (
        "proposed",
        {"verdict": None, "parts": (), "errors": None},
        ("by the model", "The tooth was not judged.", "neither ground nor"),
    ),
    ("no model", {"errors": None, "proposal": None}, ("Nothing was proposed for the tooth", "Flank RMS after")),
    (
        "no gear",
        {"gear": None, "gear_name": "", "errors": None, "tables": ()},
        ("before, as ground", "Flank RMS after"),
    ),
]


@pytest.mark.parametrize(("name", "without", "said"), PARTIAL)
def test_a_run_that_stopped_half_way_shows_what_is_there(
    name: str, without: dict[str, Any], said: tuple[str, ...], material: ReportMaterial
) -> None:
    assert material.tooth is not None
    text = Outline(render(replace(material, outcome="not-pushed", tooth=replace(material.tooth, **without)))).text
    assert [item for item in said if item not in text] == []
    assert "None" not in text
    assert " nan" not in text.lower()


def test_a_measure_run_alone_shows_its_errors_and_what_next() -> None:
    text = Outline(render(closing.measured())).text
    wanted = (
        "Error measurement report", "Measured", "20 of 21 errors were measured.", "Only assumed within a span: EAZ.",
        "What next", "EAZ may change the proposal by 0.31 µm", "not measured: anywhere within this span",
        "both slopes were measured against one square", "Error motions over each axis",
    )  # fmt: skip
    assert [item for item in wanted if item not in text] == []
    assert "Flank RMS" not in text
    assert "Not in this run" not in text
    assert "The axes" not in text


def test_an_inspected_part_alone_is_a_gear_inspection() -> None:
    document = render(closing.part_alone())
    text = Outline(document).text
    wanted = (
        "Gear inspection report", "Inspected", "customer 7 (inspected)", "gear inspection machine P 26", "P26-118",
        "profile: total F_α", "How far this inspection clamped off centre",
    )  # fmt: skip
    assert [item for item in wanted if item not in text] == []
    assert "Not in this run" not in text
    assert "The errors of the machine" not in text
    only_ground = ToothMaterial(parts=(PartMaterial("7", closing.tooth().parts[0].ground),))
    text = Outline(render(replace(closing.part_alone(), tooth=only_ground))).text
    assert "Part “7” was ground but not inspected." in text
