"""Above the port nobody writes one maker's words: tables, machine data and variables are named by the driver."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from pathlib import Path

import pytest

from drivers import registry
from drivers.errors import catalogue
from drivers.terms import Terms
from tests.architecture.sources import nodes

ROOT = Path(__file__).parents[2]
MAKERS = {
    "kinds of tables": re.compile(r"(?<![A-Za-z])(EEC|CEC|eec|cec)(?![a-z])"),
    "machine and setting data": re.compile(r"\b[MS]D_?\d{4,5}\b"),
    "variables of the control": re.compile(r"\$[A-Z]{1,2}_[A-Z]"),
    "what the person presses": re.compile(r"NC START|NCK"),
    "the maker's controls and files": re.compile(r"\b8[0-9]{2}D\b|\.[ms]pf\b"),
    "fields of the fingerprint": re.compile(r"nck_version"),
}


def _files() -> list[Path]:
    kinds = (".py", ".j2", ".js", ".html")
    return sorted(path for path in (ROOT / "gateway").rglob("*") if path.suffix in kinds)


@pytest.mark.parametrize("what", MAKERS)
def test_no_file_above_the_port_has_a_word_of_one_maker(what: str) -> None:
    found = [str(path.relative_to(ROOT)) for path in _files() if MAKERS[what].search(path.read_text(encoding="utf-8"))]
    assert found == []


def test_nobody_above_the_port_asks_for_the_sign_of_a_table() -> None:
    asks = re.compile(r"(?<!np)\.sign\b|\b(sense|sign)\s*\*\s*\w+\.(deviation|table|value)")
    rooms = ("push", "interlocks", "table", "approve", "workflow/control", "workflow/tooth", "workflow/aftercare.py")
    files = (path for path in _files() if str(path.relative_to(ROOT / "gateway")).startswith(rooms))
    assert [str(path.relative_to(ROOT)) for path in files if asks.search(path.read_text(encoding="utf-8"))] == []


def test_every_registered_control_brings_its_words() -> None:
    named = [name for name in registry.known("controller") if name != "none"]  # a site of files has no control to name
    assert [name for name in named if registry.terms_of(name) in (None, Terms())] == []


def _raised() -> dict[str, set[str]]:
    """Where each code of the catalogue stands in the source."""
    known, found = catalogue(), defaultdict(set)
    for top in ("gateway", "drivers"):
        for path in (ROOT / top).rglob("*.py"):
            for node in nodes(path, ast.Constant):
                if isinstance(node.value, str) and node.value in known:
                    found[node.value].add(str(path.relative_to(ROOT)))
    return found


def test_texts_of_codes_that_neutral_code_raises_have_no_word_of_one_maker() -> None:
    maker = re.compile("|".join((*(one.pattern for one in MAKERS.values()), "R parameter", "NEWCONF")))
    neutral = [code for code, files in _raised().items() if any(not f.startswith("drivers/sinumerik") for f in files)]
    assert len(neutral) > 400
    texts = catalogue()
    assert [code for code in neutral if maker.search(f"{texts[code]['what']} {texts[code]['do']}")] == []


def test_the_patterns_find_what_they_are_for() -> None:
    texts = ("the EEC table", "MD38000", "$AN_CEC_TYPE", "press NC START", "an 840D, or x.mpf", "nck_version")
    assert all(pattern.search(text) for pattern, text in zip(MAKERS.values(), texts, strict=True))


IDIOMS = re.compile(
    r"speaks against|nobody on record|must clear|\blent\b|met by turning|as it must|what stands there|whatever is done"
    r"|put right|free part program memory|index 0\b|STILL ON|HELD,"
)


def test_texts_for_people_have_no_idiom_of_our_own_and_no_state_in_capitals() -> None:
    shown = {
        code: f"{entry['what']} {entry['do']}" for code, entry in catalogue().items() if not code.startswith("P-INIT")
    }
    assert [f"{code}: {text}" for code, text in shown.items() if IDIOMS.search(text)] == []
