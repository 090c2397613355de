"""The verdict depends on what is programmed alone: comments and blank lines change nothing, damage never raises."""

from __future__ import annotations

import random
import re

import pytest

from drivers.sinumerik.legality import Finding, check
from tests.unit.legality.mutations import mutants
from tests.unit.legality.programs import LEGAL, NAMES

COMMENTED = 15
SIGNS = "()[]=<>+-*/:;,.\"$_%&'!?#\x00\t /0159NGMRXEK\u00e4\u2192"


def _commented(rng: random.Random, text: str) -> tuple[str, list[int]]:
    """The same program with comments and blank lines; for each new line the line that it was."""
    out: list[str] = []
    was: list[int] = []
    for number, line in enumerate(text.split("\n"), 1):
        fixed = number <= 2 and text.startswith("%")  # the header and its path stand in lines 1 and 2
        while not fixed and rng.random() < 0.3:
            out.append(rng.choice(["", "   ", "; IF R1==1 GOTOF", ';) " ] DEF INT N', "\t; nothing"]))
            was.append(number)
        tail = rng.choice(["", " ; ENDIF", "  ", ";M30"]) if line and not fixed else ""
        out.append(line + tail)
        was.append(number)
    return "\n".join(out), was


def _verdict(found: tuple[Finding, ...]) -> list[tuple[int, str]]:
    return sorted((item.line, item.code) for item in found)


@pytest.mark.parametrize("seed", [1, 2])
def test_comments_and_blank_lines_change_no_verdict(seed: int) -> None:
    rng = random.Random(seed)
    wrong = ("E-LEGAL-LENGTH", "E-LEGAL-PATH", "E-LEGAL-STRING", "E-LEGAL-HEADER", "E-LEGAL-END")
    broken = [item.text for item in mutants(seed) if item.code not in wrong and not item.text.startswith("%")]
    for text in [*LEGAL.values(), *rng.sample(broken, COMMENTED)]:
        changed, was = _commented(rng, text)
        lines = [(was[item.line - 1], item.code) for item in check(changed)]
        assert sorted(lines) == _verdict(check(text))


def test_a_comment_with_everything_in_it_is_no_program() -> None:
    assert check('; N K "( GOTOF UNOWHERE ? ! \u2192\nM30 ; DEF INT N\n') == ()


def _damage(rng: random.Random, text: str) -> str:
    """A few signs dropped, doubled, swapped or replaced, lines too."""
    for _ in range(rng.randrange(1, 8)):
        at = rng.randrange(len(text) + 1)
        kind = rng.randrange(5)
        if kind == 0:
            text = text[:at] + text[at + rng.randrange(1, 6) :]
        elif kind == 1:
            text = text[:at] + rng.choice(SIGNS) * rng.choice((1, 1, 2, 50)) + text[at:]
        elif kind == 2:
            text = text[:at] + text[at : at + 20] + text[at:]
        elif kind == 3:
            text = text[:at] + "\n" + text[at:]
        else:
            text = text[:at] + rng.choice(re.findall(r"\S+", text) or ["M30"]) + text[at + 1 :]
    return text


@pytest.mark.parametrize("damaged", [400, pytest.param(20_000, marks=pytest.mark.soak)])
def test_no_damage_raises_and_every_finding_has_a_line_of_the_program(damaged: int) -> None:
    rng = random.Random(20)
    found_in = 0
    for number in range(damaged):
        which = rng.choice(list(LEGAL))
        text = _damage(rng, LEGAL[which])
        found = check(text, NAMES.get(which, "") if number % 2 else "")
        assert all(0 < item.line <= text.count("\n") + 1 and item.do for item in found)
        found_in += bool(found)
    assert found_in > damaged // 2


@pytest.mark.parametrize(
    "piece", ["(", "[", "-", "NOT ", "<<", "R[", "SIN(", '"', "IF ", "1+", "X1=", "R1=R", "/", ":", "A."]
)
def test_no_length_of_anything_raises(piece: str) -> None:
    for count in (10, 120):
        assert all(item.line < 3 for item in check(f"R1={piece * count}1\nM30\n"))
    for text in (f"R1={piece * 20000}1\nM30\n", f"{piece * 20000}\nM30\n"):
        assert (1, "E-LEGAL-LENGTH") in _verdict(check(text))


def test_a_block_that_stands_twice_is_judged_by_what_is_declared_where_it_stands() -> None:
    """Undefined at first; after its declaration (late, for a block has worked) the same text is legal."""
    found = check("UAB=1\nUAB=1\nDEF INT UAB\nUAB=1\nDEF INT UCD\nUCD=1.5\nUCD=1.5\nM30\n")
    assert [(one.line, one.code) for one in found] == [
        (1, "E-LEGAL-UNDEFINED"),
        (2, "E-LEGAL-UNDEFINED"),
        (3, "E-LEGAL-LATE"),
        (5, "E-LEGAL-LATE"),
    ]
