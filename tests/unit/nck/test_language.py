"""The language: blocks, structures, labels, order of operators, and what is refused."""

from __future__ import annotations

import pytest

from simulators.nck.language.parser import outline_program, parse, parse_block
from simulators.nck.language.syntax import (
    Address,
    Assign,
    Binary,
    Define,
    IfJump,
    Indexed,
    Name,
    NcSyntaxError,
    Number,
    OrdinaryBlock,
    Procedure,
)
from tests.unit.nck.bench import on_bench


def words(text: str) -> tuple[object, ...]:
    block = parse_block(text)
    assert isinstance(block, OrdinaryBlock)
    return block.items


def test_din_words_need_no_blanks() -> None:
    assert words("G1X10Y-20.5F100") == (
        Address("G", 1),
        Address("X", 10),
        Address("Y", -20.5),
        Address("F", 100),
    )


def test_blank_between_letter_and_number() -> None:
    assert words("X -10.25 Z.25") == (Address("X", -10.25), Address("Z", 0.25))


def test_exponent_is_ex() -> None:
    assert words("R1=-.1EX-3")[0] == Assign(Name("R1"), parse_block("R1=-.1EX-3").items[0].value)  # type: ignore[union-attr]
    assert words("R1=2.5EX3") == (Assign(Name("R1"), Number(2500.0)),)


def test_several_assignments_stand_in_one_block() -> None:
    names = [item.target.name for item in words("R90=K R91=1 R92=I R93=TGT R94=R94+1")]  # type: ignore[attr-defined]
    assert names == ["R90", "R91", "R92", "R93", "R94"]


def test_machine_axis_name_on_the_left_is_no_din_word() -> None:
    assert words("X1=R10-R13 F=R14")[0] == Assign(Name("X1"), Binary("-", Name("R10"), Name("R13")))


def test_system_variable_with_axis_index() -> None:
    item = words("$AA_ENC_COMP[0,N,X1]=0.5")[0]
    assert item == Assign(Indexed("$AA_ENC_COMP", (Number(0), Name("N"), Name("X1"))), Number(0.5))


def test_concatenation_in_a_call() -> None:
    item = words('WRITE(ERR,"_N_B_SPF","A["<<N<<"]="<<R1)')[0]
    assert isinstance(item, Procedure)
    assert item.name == "WRITE"
    assert len(item.arguments) == 3


def test_definition_with_initial_values() -> None:
    block = parse_block('DEF STRING[20] ONE="a;b", TWO')
    assert isinstance(block, Define)
    assert [variable.name for variable in block.variables] == ["ONE", "TWO"]


@pytest.mark.parametrize(
    ("text", "tree"),
    [
        ("1+2*3", "(1+(2*3))"),
        ("8-3-2", "((8-3)-2)"),
        ("-2*3", "((-2)*3)"),
        ("7 DIV 2 MOD 2", "((7DIV2)MOD2)"),
        ("A OR B AND C XOR D", "(AOR((BANDC)XORD))"),
        ("A B_OR B B_XOR C B_AND D", "(AB_OR(BB_XOR(CB_ANDD)))"),
        ("1+2<3+4", "((1+2)<(3+4))"),
        ("(A==1) AND (B==2)", "((A==1)AND(B==2))"),
        ("NOT A AND B", "((NOTA)ANDB)"),
    ],
)
def test_order_of_operators(text: str, tree: str) -> None:
    assert show(parse_block(f"R1={text}").items[0].value) == tree  # type: ignore[union-attr]


def show(node: object) -> str:
    match node:
        case Binary(operator, left, right):
            return f"({show(left)}{operator}{show(right)})"
        case Number(value):
            return str(value)
        case Name(name):
            return name
    return f"({node.operator}{show(node.operand)})"  # type: ignore[attr-defined]


def test_comparisons_beside_and_need_brackets() -> None:
    with pytest.raises(NcSyntaxError) as caught:
        parse_block("IF A==1 AND B==2 GOTOF END1", 7)
    assert (caught.value.line, caught.value.number) == (7, 12180)
    assert isinstance(parse_block("IF (A==1) AND (B==2) GOTOF END1"), IfJump)


@pytest.mark.parametrize(
    "text",
    ["FOO BAR(", "R1==2", "X1 2", "%_N_X_MPF", "R1=", "FOR I 1 TO 2", 'MSG("a"', "R1=2 3", "IF", "\x00", "R1=(1", "é"],
)
def test_what_is_no_block_is_refused_with_its_line(text: str) -> None:
    with pytest.raises(NcSyntaxError) as caught:
        parse("R1=1\n" + text)
    assert caught.value.line == 2
    assert caught.value.reason


def test_too_long_and_too_deep_blocks_are_refused() -> None:
    for text in ("R1=" + "1+" * 300 + "1", "R1=" + "(" * 80 + "1" + ")" * 80, "R1=" + "-" * 90 + "1"):
        with pytest.raises(NcSyntaxError) as caught:
            parse(text)
        assert caught.value.number == 12540


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("IF R1>0\nR1=1", 1),
        ("R1=1\nENDIF", 2),
        ("FOR R1=0 TO 2\nWHILE TRUE\nENDFOR\nENDWHILE", 3),
        ("IF TRUE\nELSE\nELSE\nENDIF", 3),
        ("LOOP\n", 1),
    ],
)
def test_structures_must_match(text: str, line: int) -> None:
    with pytest.raises(NcSyntaxError) as caught:
        outline_program(text)
    assert (caught.value.line, caught.value.number) == (line, 12640)


def test_outline_reads_numbers_labels_comments_and_skips() -> None:
    program = outline_program('N10 G0 ; go\n/N20 AGAIN: r1="a;B"\nn30 gotob again\n')
    assert [line.number for line in program.lines] == ["N10", "N20", "N30"]
    assert program.lines[1].skippable
    assert program.lines[1].text == 'R1="a;B"'
    assert program.find_label("GOTOB", "AGAIN", 2) == 1
    assert program.find_label("GOTOF", "AGAIN", 2) is None
    assert program.find_label("GOTO", "N10", 1) == 0


def test_an_open_string_is_refused() -> None:
    with pytest.raises(NcSyntaxError):
        outline_program('MSG("abc)')


async def test_a_control_that_fills_no_arrays_stops_at_the_first_list() -> None:
    text = "DEF REAL UTAB[3]\nUTAB[0]=SET(1.5,2.5,3.5)\nR1=UTAB[2]\nM30\n"
    async with on_bench() as bench:
        await bench.run(text)
        assert bench.nck.get("R[1]") == 3.5
    async with on_bench(fills_arrays=False) as bench:
        await bench.run(text)
        assert bench.numbers() == [12550]
        assert bench.nck.get("R[1]") == 0.0
