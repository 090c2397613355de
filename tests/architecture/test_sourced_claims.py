"""What the handbook says of controls, standards and instruments carries its source in the page.

A claim is a sentence or a row that names a machine datum, a setting datum, an alarm, a standard or an instrument. Its
source stands in a comment of the same section, or above the first section for the whole page, and names what it is of:
`<!-- source: MD18342: K3 03/2013; ISO 230-2: edition 2014 -->`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [*sorted((ROOT / "docs").rglob("*.md")), ROOT / "README.md"]
CLAIM = re.compile(
    r"\b(?:MD|SD)\d{5}\b"
    r"|\b[Aa]larm \d{4,5}\b"
    r"|\b(?:ISO|DIN|JIS|ASME|VDI(?:/(?:DGQ|VDE))?|GB/T)(?:/T[RS])? [A-Z]?\d[\d.]*(?:-\d+)?\b"
    r"|\b(?:XL-80|XM-60|XR20-W|XC-80|ML10|RX10|IDS3010|5529A|WMPM)\b"
)
COMMENT = re.compile(r"<!--(.*?)-->", re.DOTALL)
SOURCE = re.compile(r"<!--\s*source:(.*?)-->", re.DOTALL)
SECTION = re.compile(r"(?m)^(?=##? )")


def named(text: str) -> set[str]:
    """What of is spoken, in one spelling."""
    return {match.group().replace("Alarm", "alarm").rstrip(".") for match in CLAIM.finditer(text)}


def unsourced(text: str) -> Iterator[str]:
    """Each thing that a section speaks of and whose source neither it nor the head of the page names."""
    parts = SECTION.split(text)
    first = next((part for part in parts if part.strip()), "")
    of_page = " ".join(SOURCE.findall(first))
    for part in parts:
        given = named(of_page) | named(" ".join(SOURCE.findall(part)))
        heading = part.strip().split("\n")[0]
        yield from (f"{heading}: {one}" for one in sorted(named(COMMENT.sub("", part)) - given))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_claim_has_a_source(page: Path) -> None:
    assert list(unsourced(page.read_text(encoding="utf-8"))) == []


def test_a_source_names_a_place_to_look_at() -> None:
    empty = [
        f"{page.name}: {part.strip()}"
        for page in PAGES
        for found in SOURCE.findall(page.read_text(encoding="utf-8"))
        for part in found.split(";")
        if len(part.partition(": ")[2].strip()) < 6
    ]
    assert empty == []


def test_the_count_finds_a_claim_without_a_source() -> None:
    text = (
        "# P\n\nText.\n\n## A\n\nMD12345 is set.\n\n## B\n\nBy ISO 230-2.\n<!-- source: ISO 230-2: edition 2014 -->\n"
    )
    assert list(unsourced(text)) == ["## A: MD12345"]
    assert list(unsourced(text.replace("Text.", "<!-- source: MD12345: K3 03/2013 -->"))) == []
