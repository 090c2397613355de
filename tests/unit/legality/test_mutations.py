"""Each rule broken in ten ways or more: found with its code, on its line, and nothing else blamed."""

from __future__ import annotations

from collections import Counter

import pytest

from drivers.errors import catalogue
from drivers.sinumerik.legality import check
from tests.unit.legality.mutations import Mutant, mutants

BY_NAME = {"E-LEGAL-HEADER-NAME"}  # broken by the name beside the text: below
MUTANTS = mutants(seed=840)


@pytest.mark.parametrize("code", sorted({mutant.code for mutant in MUTANTS}))
def test_a_broken_rule_is_found_on_its_line_and_nothing_else(code: str) -> None:
    wrong = []
    for mutant in (item for item in MUTANTS if item.code == code):
        found = {(item.line, item.code) for item in check(mutant.text)}
        if found != {(mutant.line, mutant.code)}:
            wrong.append((_block(mutant), mutant.line, found))
    assert not wrong


def _block(mutant: Mutant) -> str:
    return mutant.text.split("\n")[mutant.line - 1]


def test_every_rule_is_broken_in_ten_ways() -> None:
    broken = Counter(code for code, _ in {(mutant.code, mutant.text) for mutant in MUTANTS})
    rules = {code for code in catalogue() if code.startswith("E-LEGAL-")} - BY_NAME
    assert rules == set(broken)
    assert min(broken.values()) >= 10


@pytest.mark.parametrize(
    "given", ["AB", "UPART2", "UPAR", "PART", "UQPART", "UPARTS", "UPART_A", "UPATR", "TRAPU", "UP"]
)
def test_a_file_and_its_program_have_one_name(given: str) -> None:
    for text in (f"%_N_{given}_MPF\nM30\n", f"PROC {given}\nM17\n"):
        assert [(item.line, item.code) for item in check(text, "UPART.MPF")] == [(1, "E-LEGAL-HEADER-NAME")]


@pytest.mark.parametrize(
    ("name", "code"),
    [
        *(
            (name, "E-LEGAL-PROGRAM-NAME")
            for name in ("1AB.MPF", "A.MPF", "A-B.MPF", "AB.TXT", "A B.SPF", "ÄB.MPF", "A.B.MPF")
        ),
        *((name, "E-LEGAL-NAME-LENGTH") for name in ("U" + "A" * 24 + ".MPF", "_N_U" + "A" * 24 + "_SPF")),
        *((name, "E-LEGAL-DEVICE-NAME") for name in ("CON.MPF", "com3.spf", "_N_AUX_MPF")),
        *((name, "E-LEGAL-RESERVED") for name in ("SIN.SPF", "MSG.SPF", "CYCLE800.SPF")),
        *((name, "E-LEGAL-PREFIX") for name in ("CYCLE_A.SPF", "CUST_A.SPF", "_AB.SPF", "CC_A.MPF")),
    ],
)
def test_a_wrong_program_name_is_found(name: str, code: str) -> None:
    assert [(item.line, item.code) for item in check("M30\n", name)] == [(0, code)]
