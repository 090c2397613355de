"""The words in drawings and remarks: a report has its own in each language, and numbers and names stay."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from typing import get_args, get_type_hints

import pytest
from matplotlib.figure import Figure

from drivers.message import Message, digits
from gateway.domain.captures import Capture
from gateway.report.document.content import Bullets
from gateway.report.document.drawn import MARK, in_language
from gateway.report.document.web import page
from gateway.report.document.whole import document
from gateway.report.document.words import catalogue_of
from gateway.report.drawings.curves import table_change
from tests.unit.report import closing, synthetic

DRAWN = re.compile(r"<text\b[^>]*>([^<]+)</text>")


def test_a_phrase_is_put_into_another_language_whole_and_numbers_stay() -> None:
    svg = "<svg><text x='1'>2.380 µm, rank 1–2</text><text>afterwards old C1-cec2</text><g>after</g></svg>"
    assert in_language(svg, "en") == svg
    found = in_language(svg, "de")
    assert ">2.380 µm, Rang 1–2<" in found
    assert ">afterwards alt C1-cec2<" in found
    assert "<g>after</g>" in found


def _phrases(language: str) -> set[str]:
    return {text for key, text in catalogue_of(language).items() if key.startswith(MARK)}


@cache
def _whole(language: str) -> str:
    """The page of a whole report; drawn once for the tests of this file."""
    material = closing.material()
    said = replace(material.particulars, language=language)
    return page(document(replace(material, particulars=said)))


@pytest.mark.parametrize("language", ["de", "zh"])
def test_no_english_word_is_left_in_a_drawing_of_a_whole_report(language: str) -> None:
    texts = DRAWN.findall(_whole(language))
    assert len(texts) > 100
    drawn = " ".join(texts)
    left = {
        text for text in _phrases("en") - _phrases(language) if re.search(rf"(?<!\w){re.escape(text)}(?!\w)", drawn)
    }
    assert left == set()


def test_a_table_is_drawn_as_it_acts_with_straight_lines_between_its_points() -> None:
    change = synthetic.axis_material("X1", "mm").change
    assert change is not None
    figure = Figure()
    table_change(figure, change)
    top = figure.axes[0]
    old, new = top.get_lines()[-2:]
    assert [one.get_drawstyle() for one in (old, new)] == ["default", "default"]
    assert list(new.get_ydata()) == list(change.new.deviations)
    assert list(new.get_xdata()) == list(change.new.positions)


def test_every_cycle_and_figure_has_its_name_in_every_language() -> None:
    cycles = get_args(get_type_hints(Capture)["cycle"])
    assert len(cycles) == 3
    for language in ("en", "de", "zh"):
        assert {f"cycle_{one}" for one in cycles} | {"figure_M_travel"} <= set(catalogue_of(language))
    german = _whole("de")
    assert "M, Weg" in german
    assert "M, travel" not in german


NOTED = (
    Message.of("S-FILE-LARGEST", value=digits(0.35), unit="um"),
    Message.of("S-EVAL-TARGETS", targets=3, least=9),
    Message.stored("The room warmed by 0.27 K."),
)


@pytest.mark.parametrize(
    ("language", "wanted"),
    [
        (
            "en",
            ("the largest deviation is 0.35 µm: is the file's unit as stated?", "3 targets; this travel asks"),
        ),
        (
            "de",
            (
                "die größte Abweichung ist 0,35 µm: stimmt die angegebene Einheit der Datei?",
                "3 Ziele; dieser Weg verlangt 9",
            ),
        ),
        ("zh", ("最大偏差为 0.35 µm：文件的单位是否如所述？", "3 个目标；此行程要求 9 个")),
    ],
)
def test_what_a_run_notes_is_in_the_language_of_the_report(language: str, wanted: tuple[str, ...]) -> None:
    """With that language's decimal sign; what an older version stored as a sentence is shown as stored."""
    made = synthetic.material()
    made = replace(made, findings=NOTED, particulars=replace(made.particulars, language=language))
    blocks = [block for part in document(made).blocks for block in getattr(part, "blocks", (part,))]
    lines = [one for block in blocks if isinstance(block, Bullets) for one in block.items]
    assert wanted[0] in lines
    assert any(wanted[1] in one for one in lines)
    assert "The room warmed by 0.27 K." in lines
