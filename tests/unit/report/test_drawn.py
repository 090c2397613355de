"""The words in drawings and remarks: a report has its own in each language, and numbers and names stay."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from typing import get_args, get_type_hints

import pytest
from matplotlib.figure import Figure

from drivers.errors import catalogue, words
from gateway.domain.captures import Capture
from gateway.report.document.drawn import MARK, in_language
from gateway.report.document.retold import retold
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


FIELD = re.compile(r"\{(\w+)[^}]*\}")
TOO_SHORT = {"S-EVAL-SINGLE"}
"""So few words of its own that other sentences would be taken for it: it stays English."""


@pytest.mark.parametrize("language", ["de", "zh"])
def test_what_a_record_notes_is_told_in_the_language_with_its_numbers(language: str) -> None:
    own = catalogue(language)
    noted = [code for code in catalogue() if code.startswith(("S-EVAL-", "S-MODEL-", "S-INSPECT-"))]
    assert len(set(noted) - set(own)) == 0
    assert len(noted) > 40
    wrong = []
    for code in set(noted) - TOO_SHORT:
        fields = {name: f"{number + 3}" for number, name in enumerate(FIELD.findall(catalogue()[code]["what"]))}
        told = retold(words(code, **fields), language)
        wanted = FIELD.sub(lambda field, fields=fields: fields[field[1]], own[code]["what"])
        if told.replace("µm", "um").replace("°C", "degC").lower() != wanted.lower():
            wrong.append(f"{code}: {told}")
    assert wrong == []


@pytest.mark.parametrize("language", ["de", "zh"])
@pytest.mark.parametrize("goes_on", ["W-CFG-GUESS", "W-CFG-ELSEWHERE"])
def test_what_goes_on_a_list_is_told_too(language: str, goes_on: str) -> None:
    (field,) = FIELD.findall(catalogue()[goes_on]["what"])
    own = catalogue(language)
    more = words(goes_on, **{field: "travel"})
    told = retold(words("E-CFG-KEY", key="trave", known="letter, travel" + more), language)
    assert told.startswith(own["E-CFG-KEY"]["what"].partition("{key}")[0])
    wanted = own[goes_on]["what"].format(**{field: "travel"}).lstrip(";； ")
    assert f"letter, travel; {wanted}" in told


@pytest.mark.parametrize("language", ["de", "zh"])
def test_a_sentence_that_begins_with_a_number_takes_none_before_it_along(language: str) -> None:
    own, held = catalogue(language), {"count": "6", "before": "6.3", "unit": "arcsec", "after": "0.2"}
    said = " ".join((words("W-VERDICT-BETTER"), words("W-VERDICT-BETWEEN-HELD", **held)))
    wanted = (own["W-VERDICT-BETTER"]["what"], own["W-VERDICT-BETWEEN-HELD"]["what"].format(**held))
    assert retold(said, language) == " ".join(wanted)


def test_a_remark_without_a_text_of_the_catalogue_stays_and_english_is_left_alone() -> None:
    assert retold("The room warmed by 0.27 K.", "de") == "The room warmed by 0.27 K."
    told = words("S-EVAL-STEPS")
    assert retold(told, "en") == told
    assert (
        retold(f"{words('S-EVAL-TARGETS', targets=3, least=9)}. Stored.", "de")
        == "3 Ziele; dieser Weg verlangt 9. Stored."
    )
