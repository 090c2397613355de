"""A German or Chinese report contains no English sentence, and no text in these languages does, by lists of words."""

from __future__ import annotations

import html
import re
from dataclasses import replace

import pytest

from drivers.catalogue import catalogue
from drivers.languages import page_texts, texts_of
from gateway.report.document.web import page
from gateway.report.document.whole import document
from gateway.report.document.words import catalogue_of
from tests.english import english_sentences, english_words
from tests.unit.report import closing

HIDDEN = re.compile(r"<(?:style|script)[^>]*>.*?</(?:style|script)>", re.DOTALL)
PIECE = re.compile(r">([^<>]+)<")


@pytest.mark.parametrize("language", ["de", "zh"])
def test_every_text_is_in_its_language(language: str) -> None:
    texts = [text for entry in catalogue(language).values() for text in entry.values()]
    texts += [*page_texts(language).values(), *texts_of("panel", language).values()]
    texts += list(catalogue_of(language).values())
    assert len(texts) > 4000
    assert english_sentences(texts, language) == []


@pytest.mark.parametrize("language", ["de", "zh"])
def test_a_certificate_contains_no_english_sentence(language: str) -> None:
    material = closing.material()
    said = replace(material.particulars, language=language)
    made = HIDDEN.sub("", page(document(replace(material, particulars=said))))
    noted = [*material.findings, *(one for axis in material.axes for one in axis.findings)]
    tooth = material.tooth
    noted += [one for part in (tooth.errors, tooth.proposal) if part for one in part.said] if tooth else []
    noted += [one for axis in material.axes for side in (axis.before, axis.after) if side for one in side.flags]
    pieces = [html.unescape(piece).strip() for piece in PIECE.findall(made) if piece.strip()]
    pieces = [one for one in pieces if not any(str(said) in one for said in noted)]  # stored finished: shown as stored
    assert len(pieces) > 300
    assert english_sentences(pieces, language) == []


def test_the_lists_find_english_and_leave_german_alone() -> None:
    assert english_words("the old table was put back", "de") == ["the"]
    assert english_sentences(["nothing is known of the axis"], "de") == ["nothing is known of the axis"]
    assert english_sentences(["die Achse war in Ordnung, also nicht an der Grenze"], "de") == []
    assert english_words('weder "the" noch `of the run` zählt, auch /the/of nicht', "de") == []
