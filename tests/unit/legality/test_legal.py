"""Legal programs pass; the lists behind the judge agree with themselves; findings say what to do."""

from __future__ import annotations

from importlib import resources

import pytest

from drivers.sinumerik.legality import Machine, check
from drivers.sinumerik.legality.dictionary import GROUP_OF, dictionary
from drivers.sinumerik.legality.expressions import PROCEDURES, SIGNATURES
from tests.unit.legality.programs import LEGAL, NAMES, TABLE


@pytest.mark.parametrize("which", LEGAL)
def test_a_legal_program_has_no_findings(which: str) -> None:
    assert check(LEGAL[which], NAMES.get(which, "")) == ()


@pytest.mark.parametrize("which", LEGAL)
def test_line_ends_and_small_letters_change_nothing(which: str) -> None:
    assert check(LEGAL[which].replace("\n", "\r\n"), NAMES.get(which, "")) == ()
    small = LEGAL[which].lower().replace(";$path=/_n_mpf_dir", ";$PATH=/_N_MPF_DIR")
    assert check(small, NAMES.get(which, "")) == ()


def test_the_list_counts_indices_and_the_axis_of_axial_data_is_one_more() -> None:
    data = dictionary().data
    assert (data["$MA_ENC_COMP_ENABLE"].number, data["$MA_ENC_COMP_ENABLE"].indices) == (32700, 2)
    assert (data["$SN_CEC_TABLE_ENABLE"].number, data["$SN_CEC_TABLE_ENABLE"].indices) == (41300, 1)
    assert (data["$AA_ENC_COMP"].type, data["$AA_ENC_COMP"].indices) == ("REAL", 3)
    assert len(data) == 1782 + 369 + 2187


def test_every_word_that_this_room_names_is_a_word_of_the_list() -> None:
    lists = dictionary()
    assert set(GROUP_OF) <= lists.commands
    assert set(SIGNATURES) <= lists.functions
    assert set(PROCEDURES) <= lists.procedures
    assert "Address" not in lists.reserved


def test_the_licence_stands_beside_the_list() -> None:
    text = resources.files("drivers.sinumerik.legality").joinpath("dictionary.LICENCE.txt").read_text()
    assert "Copyright (c) 2016 DeathAxe" in text
    assert "Permission is hereby granted" in text


def test_single_letters_are_no_variables_and_are_told_once() -> None:
    text = "DEF INT UERR, N, K\nFOR N=0 TO 3\nK=N+1\nR1=K*N\nENDFOR\nM30\n"
    found = check(text)
    assert [(item.line, item.code) for item in found] == [(1, "E-LEGAL-NAME")] * 2
    assert found[1].words.startswith("line 1: N is not a valid name for a variable")
    assert "beginning with U" in found[1].words


def test_an_axis_of_the_machine_and_a_known_sub_program_are_no_unknown_words() -> None:
    text = "G1 WHEEL=10 F100\n$AA_ENC_COMP[0,0,WHEEL]=0\nUSAVED\nM30\n"
    assert [item.code for item in check(text)] == ["E-LEGAL-UNDEFINED", "E-LEGAL-UNDEFINED", "E-LEGAL-WORD"]
    assert check(text, machine=Machine(frozenset({"WHEEL"}), frozenset({"USAVED"}))) == ()


def test_a_wrong_name_of_the_program_is_found_on_line_0() -> None:
    assert [(item.line, item.code) for item in check(TABLE, "T1.SPF")] == [(0, "E-LEGAL-PROGRAM-NAME")]


def test_several_broken_rules_are_told_by_line() -> None:
    found = check("R1=(2\nG0 G1 X10\nQUARK\n")
    assert [(item.line, item.code) for item in found] == [
        (1, "E-LEGAL-BRACKET"),
        (2, "E-LEGAL-G-GROUP"),
        (3, "E-LEGAL-END"),
        (3, "E-LEGAL-WORD"),
    ]
