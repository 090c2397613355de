"""The words in drawings: every one a report draws has its own in each language, and numbers and names stay."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from gateway.report.document.drawn import MARK, in_language
from gateway.report.document.web import page
from gateway.report.document.whole import document
from gateway.report.document.words import catalogue_of
from tests.unit.report import closing

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


@pytest.mark.parametrize("language", ["de", "zh"])
def test_no_english_word_is_left_in_a_drawing_of_a_whole_report(language: str) -> None:
    material = closing.material()
    said = replace(material.particulars, language=language)
    drawn = " ".join(DRAWN.findall(page(document(replace(material, particulars=said)))))
    left = {
        text for text in _phrases("en") - _phrases(language) if re.search(rf"(?<!\w){re.escape(text)}(?!\w)", drawn)
    }
    assert left == set()
    assert len(DRAWN.findall(page(document(material)))) > 100
