"""The page: complete, self-contained, escaped, the same twice, and honest about what is missing."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from drivers.message import Message, prose
from drivers.types.identity import Identity, MachineIdentity
from drivers.types.sensing import Ambient
from gateway.domain.proposals import TableFinding
from gateway.report import AxisMaterial, FileUsed, InstrumentNote, ReportMaterial, render
from tests.sizes import few
from tests.unit.report import synthetic
from tests.unit.report.attacks import STRINGS

VOID = {"meta", "br", "img", "hr", "input", "link"}


class Outline(HTMLParser):
    """Tags, attributes and text of a document; fails on tags that do not match."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: dict[str, int] = {}
        self.attributes: list[tuple[str, str | None]] = []
        self.ids: list[str] = []
        self.words: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags[tag] = self.tags.get(tag, 0) + 1
        self.attributes += attrs
        self.ids += [value or "" for name, value in attrs if name == "id"]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags[tag] = self.tags.get(tag, 0) + 1
        self.attributes += attrs
        self.ids += [value or "" for name, value in attrs if name == "id"]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.words))


@pytest.fixture(scope="module")
def material() -> ReportMaterial:
    return synthetic.material()


def test_every_fact_of_the_run_is_on_the_page(document: str, material: ReportMaterial) -> None:
    text = Outline(document).text
    wanted = (
        "hall-3-grinder", "YK7350B-0042", "107.60.05", "2026-03-02-01", "2026-03-02 12:04 UTC",
        "trueflank 0.1.0", "Better", "ISO 230-2:2014", "cannot see a beam break", "Edlen 1994",
        "dead_path_mm = 120", "1009.30",
        "order 36 is above what 24 targets can see", "read back equal", "X1/backup.spf", "0f" * 32, "1a" * 32,
        "Deviation = measured − target", "a positive value moves the axis in the negative direction",
        "measured step / commanded step = +1.003 ± 0.022", "The room warmed by 0.27 K", "within",
        "target 3 (40.000 mm), repetition 2, approach +",
    )  # fmt: skip
    assert [item for item in wanted if item not in text] == []
    for axis in material.axes:
        assert axis.verdict is not None
        assert prose(axis.verdict.words).replace(" um", " µm") in text
        assert axis.before is not None
        assert axis.after is not None
        assert f"{axis.before.M:.2f}" in text
        assert f"{axis.after.E:.2f}" in text


def test_nothing_is_fetched_and_nothing_runs(document: str) -> None:
    outline = Outline(document)
    assert re.search(r"(?:https?:)?//[a-z]", document) is None
    assert "@import" not in document
    assert outline.tags.keys().isdisjoint({"script", "link", "img", "iframe", "object", "embed", "base"})
    assert [name for name, _value in outline.attributes if name.startswith("on")] == []
    links = [value or "" for name, value in outline.attributes if name in {"href", "src", "xlink:href"}]
    assert all(value.startswith("#") for value in links)


def test_drawings_do_not_share_ids_and_refer_to_their_own(document: str) -> None:
    outline = Outline(document)
    assert len(outline.ids) == len(set(outline.ids)) > 50
    used = set(re.findall(r"url\(#([^)]+)\)", document)) | set(re.findall(r'href="#([^"]+)"', document))
    assert used <= set(outline.ids)
    # three before-after, three tables, three predictions, one polar for C, three samples of the key
    assert outline.tags["svg"] == 3 + 3 + 3 + 1 + 3


def test_same_material_gives_the_same_bytes(document: str, material: ReportMaterial) -> None:
    assert render(material) == document


def _hostile(text: str) -> ReportMaterial:
    axis = replace(synthetic.axis_material("C1", "deg"), axis=text, letter=text, findings=(Message.stored(text),))
    assert axis.change is not None
    assert axis.push is not None
    assert axis.capture_before is not None
    assert axis.before is not None
    assert axis.verdict is not None
    assert axis.sense_proof is not None
    capture = axis.capture_before
    table = replace(axis.change.new, input_axis=text, output_axis=text)
    axis = replace(
        axis,
        change=replace(
            axis.change,
            new=table,
            findings=(TableFinding(Message.stored(text)),),
            skipped=Message.stored(text),
        ),
        push=replace(axis.push, steps=(Message.stored(text),), backup_path=text),
        before=replace(axis.before, flags=(Message.stored(text),), standard=text),
        capture_before=replace(
            capture, component=text, notes=(Message.stored(text),), source=text, started_utc=text, ended_utc=text,
            corrections=replace(capture.corrections, air=text, details={text: 1.0}),
        ),
        verdict=replace(axis.verdict, words=(Message.stored(text),)),
        sense_proof=replace(axis.sense_proof, instrument=text),
        components=tuple(replace(part, name=text, basis=text) for part in axis.components),
    )  # fmt: skip
    return ReportMaterial(
        site=text, machine=MachineIdentity(text, text, (text,)), run_id=text, outcome="worse", axes=(axis,),
        started_utc=text, ended_utc=text, software=text, operator=text,
        instruments=(InstrumentNote(text, Identity(text, text, text, text, (text,)), (text,)),),
        files=(FileUsed(text, text, text),), hashes={text: text}, findings=(text,),
    )  # fmt: skip


@pytest.fixture(scope="module")
def harmless() -> Outline:
    return Outline(render(_hostile("harmless")))


@pytest.mark.parametrize("attack", few(STRINGS, 10))
def test_no_name_becomes_markup(attack: str, harmless: Outline) -> None:
    outline = Outline(render(_hostile(attack)))
    same = {"script": 0, "img": 0, "iframe": 0, "object": 0, "embed": 0, "link": 0, "base": 0, "input": 0}
    assert {tag: outline.tags.get(tag, 0) for tag in same} == same
    for tag in ("meta", "style", "title", "svg", "a", "li", "section", "table", "tr"):
        assert outline.tags.get(tag, 0) == harmless.tags.get(tag, 0)
    assert [name for name, _value in outline.attributes if name.startswith("on")] == []
    assert "\x00" not in outline.text
    assert "\u202e" not in outline.text


def test_a_run_that_only_proposed_says_so() -> None:
    axis = replace(
        synthetic.axis_material("X1", "mm"),
        after=None,
        capture_after=None,
        push=None,
        verdict=None,
        sign_proof=None,
    )
    text = Outline(render(replace(synthetic.material(), outcome="not-pushed", axes=(axis,)))).text
    assert "Not pushed" in text
    assert "Nothing was written to the controller by this run." in text
    assert "proposed only" in text
    assert "not measured" in text
    assert "as predicted after the correction" in text
    assert "This machine has no recorded sign proof for this table" in text


def test_an_axis_inside_its_uncertainty_says_why_it_was_left_alone() -> None:
    axis = synthetic.axis_material("X1", "mm")
    assert axis.change is not None
    why = "not corrected because the deviation is inside its uncertainty"
    axis = replace(axis, change=replace(axis.change, skipped=Message.stored(why)), verdict=None, push=None, after=None)
    text = Outline(render(replace(synthetic.material(), outcome="not-pushed", axes=(axis,)))).text
    assert why in text
    assert "not corrected" in text
    assert "predicted and measured" not in text
    assert "Compensation table EEC" not in text


@pytest.mark.parametrize("outcome", ["better", "unchanged", "worse", "not-pushed"])
def test_each_outcome_has_its_word_and_its_class(outcome: str) -> None:
    document = render(replace(synthetic.material(), outcome=outcome, axes=()))
    assert f'class="band {outcome}"' in document
    assert {"better": "Better", "unchanged": "Unchanged", "worse": "Worse", "not-pushed": "Not pushed"}[
        outcome
    ] in document


def test_missing_figures_are_dashes_and_never_nan() -> None:
    axis = synthetic.axis_material("C1", "deg")
    assert axis.before is not None
    assert axis.capture_before is not None
    gone = np.full(axis.before.targets.shape, np.nan)
    one_way = replace(
        axis.before, mean_down=gone, s_down=gone, B_i=gone, B=None, M=None, R=None, A=None, E=None, U={},
        flags=(Message.stored("measured in one direction only"),),
    )  # fmt: skip
    capture = replace(axis.capture_before, ambient_start=Ambient(), ambient_end=Ambient())
    axis = replace(axis, before=one_way, capture_before=capture)
    document = render(replace(synthetic.material(), axes=(axis,)))
    text = Outline(document).text
    assert "nan" not in text.lower().replace("nanometre", "")
    assert "None" not in text
    assert "Before: measured in one direction only" in text
    assert "–" in text


def test_nothing_but_a_name_still_makes_a_page() -> None:
    bare = ReportMaterial("s", MachineIdentity("1", "2", ()), "r", "not-pushed", (AxisMaterial("X1", "X", "mm"),))
    text = Outline(render(bare)).text
    assert "measured only" in text
    assert "No evaluation." in text


def test_a_long_table_is_drawn_and_left_to_the_json() -> None:
    axis = synthetic.axis_material("X1", "mm")
    assert axis.change is not None
    long = replace(axis.change.new, maximum=800.0, step=1.0, deviations=(0.5,) * 801)
    text = Outline(
        render(replace(synthetic.material(), axes=(replace(axis, change=replace(axis.change, new=long)),)))
    ).text
    assert "801 points: all values are in the report's JSON." in text
