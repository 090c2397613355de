"""English as a native engineer writes it: phrases that the rules for texts reject, counted in what people read.

README, handbook, the texts of `--help` and the English catalogue are read without code, links, comments and HTML. The
catalogue is counted and its number may only fall; the other texts have none.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
GENERATED = {
    "commands.md",
    "site-file.md",
    "families.md",
    "proof.md",
    "reliability.md",
    "benchmarks.md",
    "licences.md",
} | {"push-states.md"}
"""Pages that commands and runs write: their words are those of the code."""
THINGS = (
    r"files?|tables?|pages?|reports?|records?|logs?|plans?|sheets?|rows?|columns?|headings?|registers?|journals?|markers?"
    r"|certificates?|errors?|programs? of ours|manuals?|documents?|verdicts?"
)
PATTERNS = {
    # Subject and verb: a file contains, a value is, an option sets.
    "a thing speaks": rf"\b(?:{THINGS}) (?:says?|said|tells?|knows?|speaks?|carr(?:y|ies)|carried)\b",
    "a thing stands": r"\b(?:stands|stood)\b(?! for)",
    "a thing lies": rf"\b(?:{THINGS}) (?:lies?|lay)\b",
    "a service hears": r"\b(?:hears|heard)\b",
    "told": r"\b(?:re)?told\b",
    "is said": r"\b(?:is|are|was|were|as|be|been) said\b",
    "speaks of": r"\b(?:speaks?|spoke) (?:of|against)\b",
    "free relative": r"(?:^|(?<=[.!:] ))(?:Who|Whoever|What|Whatever) (?!if\b)[^.?!]*[.!]",
    "for who": r"\b(?:for|of|by|to|from) who\b",
    "for whom": r"For whom:",
    # Words that have a standard one.
    "beside": r"\bbesides?\b",
    "anew": r"\banew\b",
    "of before": r"\bof before\b",
    "road": r"\broads?\b",
    "double": r"\b(?:the|its|a|our|simulated|NCK|PLC|Modbus) doubles?\b(?!-)",
    "begin again": r"\bbeg(?:in|ins|inning|an|un) (?:anew|again)\b",
    "foretold": r"\bforet(?:old|ells?)\b",
    "foreseen": r"\bfores(?:aw|een|ees?)\b",
    "reckon": r"\breckon(?:s|ed|ing)?\b",
    "mended": r"\bmend(?:s|ed|ing)?\b",
    "put right": r"\b(?:put|puts|putting|set) right\b",
    "held against": r"\b(?:held|holds?) (?:\w+ ){0,4}against\b",
    "led back": r"\b(?:led|leads?) (?:\w+ ){0,4}back\b",
    "taken away": r"\b(?:taken away|away with)\b",
    "handed on": r"\b(?:hands? on a|handed (?:on|out))\b",
    "let go": r"\blets? go of\b",
    "at work": r"\bat work\b",
    "as ever": r"\bas ever\b",
    "comes about": r"\bcomes? about\b",
    "weather": r"\bweather\b",
    "whole": r"\b(?:is|are|not|nor|stays) whole\b(?! numbers)",
    "as it is": r"\bas (?:it is|they are)(?=[.,;:)|]|$)",
    "white is right": r"\bwhite (?:\(\.\) )?(?:is )?right\b",
    "word of a program": r"\bwords? (?:of|that) our programs?\b",
    "maker's builder": r"\bmachine's builder\b",
    "brothers": r"\bits brothers\b",
    "house": r"\b(?:the house|(?:pure|other|own|its|the|of) rooms?)\b",
    # Turns of another language.
    "is no": r"(?<!there )\b(?:is|are) no (?!longer|more|less|better|worse|further|fewer|later|larger|smaller|greater)",
    "of nobody": r"\b(?:of|to|by|from) nobody\b",
    "for it is": r", for (?:it|they|a \w+|the \w+) (?:is|are|was|were|has|have|can|may|loads?|needs?)\b",
    "as it must": r"\bas (?:it|they) must\b",
    "by as much": r"\bby as much as\b",
    "in the text to copy": r"\bnot (?:be )?tried by nobody\b",
    "that are asked": r"\bquestions that are asked\b",
    "does not suffice alone": r"\balone suffices\b",
    "whereof": r"\b(?:whereof|thereof|thereupon|wherewith|withal)\b",
}
CATALOGUE_LEFT = 0
"""Hits in `drivers/messages/en`."""
FENCE = re.compile(r"^```.*?^```|^(?: {4}|\t).*?$", re.DOTALL | re.MULTILINE)
HIDDEN = re.compile(r"<!--.*?-->|`[^`]*`|\]\([^)]*\)", re.DOTALL)


def prose(text: str) -> Iterator[str]:
    """Paragraphs of a page without code, comments and the targets of links, each in one line; cells one by one."""
    text = HIDDEN.sub(" x ", FENCE.sub("\n\n", text))
    for part in re.split(r"\n\s*\n|\n(?=\s*(?:[-*#|]|\d+\.) ?)", text):
        if not part.lstrip().startswith("#"):
            pieces = part.split("|") if part.lstrip().startswith("|") else [part]
            yield from (re.sub(r"\s+", " ", piece).strip(" *-_") for piece in pieces)


def hits(text: str) -> list[str]:
    """Each rejected phrase of a text: name of the pattern and the words around it."""
    found = []
    for name, pattern in PATTERNS.items():
        flags = 0 if name in {"free relative", "for whom"} else re.IGNORECASE
        for match in re.finditer(pattern, text, flags):
            found.append(f"{name}: {text[max(0, match.start() - 30) : match.end() + 30]}")
    return found


def _of_page(path: Path) -> list[str]:
    return [f"{path.name}: {hit}" for part in prose(path.read_text(encoding="utf-8")) for hit in hits(part)]


def _texts(tree: Mapping[str, Any]) -> Iterator[str]:
    """What people read of a table of texts: `words`, `title`, `what`, `do` and their like, at any depth."""
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from _texts(value)
        elif isinstance(value, list):
            yield from (one for item in value if isinstance(item, Mapping) for one in _texts(item))
        elif isinstance(value, str) and key not in {"place", "source"}:
            yield HIDDEN.sub(" x ", re.sub(r"\{[^{}]*\}", "x", value))


def _of_toml(path: Path) -> list[str]:
    return [f"{path.name}: {hit}" for text in _texts(tomllib.loads(path.read_text("utf-8"))) for hit in hits(text)]


HANDBOOK = [ROOT / "README.md", *(one for one in sorted((ROOT / "docs").rglob("*.md")) if one.name not in GENERATED)]


@pytest.mark.parametrize("page", HANDBOOK, ids=lambda page: page.name)
def test_a_page_has_no_rejected_phrase(page: Path) -> None:
    assert _of_page(page) == []


def test_the_texts_of_help_have_none() -> None:
    assert _of_toml(ROOT / "gateway" / "cli" / "order.toml") == []
    assert _of_page(ROOT / "docs" / "commands.md") == []


def test_the_hits_of_the_catalogue_only_fall() -> None:
    found = [hit for path in sorted((ROOT / "drivers" / "messages" / "en").glob("*.toml")) for hit in _of_toml(path)]
    assert len(found) <= CATALOGUE_LEFT, "\n".join(found)


def test_each_pattern_finds_what_it_is_for_and_leaves_good_english() -> None:
    bad = {
        "a thing speaks": "The file says which.",
        "free relative": "What failed is listed.",
        "is no": "It is no emergency stop.",
        "beside": "the table beside it",
        "for it is": "refused, for it is old",
        "as it is": "leave it as it is.",
        "double": "the control and its double",
        "whole": "a record is not whole",
    }
    assert [name for name, text in bad.items() if not any(hit.startswith(f"{name}:") for hit in hits(text))] == []
    good = (
        "What is refused? There is no key. Stop if the step differs from what was announced. The file contains the"
        " values; the program reports the difference and restarts. The signal is no longer valid."
        " A double-headed arrow stands for both."
    )
    assert hits(good) == []
    assert len(PATTERNS) >= 40
