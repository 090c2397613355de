"""A whole run of the demo for a German and a Chinese reader: neither terminal, page nor certificate is in English."""

from __future__ import annotations

import html
import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.message import Message, render
from gateway.config import load_site
from gateway.report.document.web import page
from gateway.report.document.whole import document
from gateway.store import RunFolder
from gateway.workflow.complete_run import close_site
from gateway.workflow.results.report import material_of
from gateway.workflow.run.outcome import Outcome
from simulators.cellfile import load_cell, with_plan
from tests.closing.reckoned import BLOCK_S
from tests.closing.runs import quick
from tests.english import english_sentences
from tests.selftested import cell_running

TEXT = re.compile(r"<(?:style|script)[^>]*>.*?</(?:style|script)>", re.DOTALL)
PIECE = re.compile(r">([^<>]+)<")


@dataclass
class Reader:
    """Everything that a run says, as messages."""

    said: list[Message] = field(default_factory=list)

    def say(self, code: str, /, **fields: object) -> None:
        """A word of progress."""
        self.said.append(Message(code, fields))


async def _closed(folder: Path) -> tuple[Outcome, Reader]:
    clock, reader = LoopClock(), Reader()
    async with cell_running(with_plan(load_cell("demo")), folder, clock, wires="memory", block_s=BLOCK_S) as cell:
        path = cell.site_path
        path.write_text(quick(cell, path.read_text(encoding="utf-8")), encoding="utf-8")
        site = load_site(path)
        name = site.site.name
        done = await close_site(site, path, apply=True, machine_name=name, clock=clock, say=reader.say)
    return done, reader


def _pieces(text: str) -> list[str]:
    return [html.unescape(piece).strip() for piece in PIECE.findall(TEXT.sub("", text)) if piece.strip()]


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_a_whole_run_is_told_without_an_english_sentence(tmp_path: Path) -> None:
    outcome, reader = run_virtual(lambda: _closed(tmp_path))
    assert outcome.state == "better"
    assert len(reader.said) > 100
    folder = RunFolder(Path(outcome.run_folder))
    cells = [cell for row in (outcome.headings, *outcome.rows) for cell in row]
    shown = [*reader.said, *outcome.lines, *outcome.places, *outcome.details, *outcome.points, outcome.title, *cells]
    material = material_of(folder)
    for language in ("de", "zh"):
        told = {render(one, language) for one in shown if isinstance(one, Message)}
        told |= {one for one in shown if isinstance(one, str)}
        assert english_sentences(sorted(told), language) == [], "terminal and page"
        said = replace(material.particulars, language=language)
        pieces = _pieces(page(document(replace(material, particulars=said))))
        assert len(pieces) > 300
        assert english_sentences(pieces, language) == [], "certificate"
