"""Table texts: the manuals' examples, every layout, what is refused, signs."""

from __future__ import annotations

import dataclasses
from decimal import Decimal
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import FileFormatError, Gap, TableError
from drivers.sinumerik.tablefile import tables, writer
from drivers.sinumerik.tablefile.reader import read_tables
from drivers.types.identity import MachineIdentity
from drivers.types.orders import SignProof
from drivers.types.tables import CompensationTable

GOLDEN = Path(__file__).parents[2] / "golden" / "sinumerik"
TABLES = GOLDEN.parent / "tables"
MACHINE = MachineIdentity("S", "V", ("X1", "Z1", "C1"))


def eec(deviations: tuple[float, ...], step: float = 1.0, low: float = 0.0, **more: object) -> CompensationTable:
    high = low + step * (len(deviations) - 1)
    table = CompensationTable("axis", "X1", "X1", low, high, step, deviations)
    return dataclasses.replace(table, **more)


def proof(sign: int, kind: str = "cross", axis: str = "X1") -> SignProof:
    return SignProof(MACHINE, kind, axis, float(sign), 0.01, sign, "2026-01-01")


def test_the_manuals_example_of_801_points() -> None:
    (table,) = read_tables((TABLES / "manual_eec_x1.ini").read_text(), "manual").tables
    assert (table.minimum, table.maximum, table.step, len(table.deviations)) == (-200.0, 600.0, 1.0, 801)
    assert table.deviations[:3] == (3.0, 10.0, 12.0)
    assert not table.modulo
    assert str(table.deviations[800]) == "0.0"
    # K3 p. 238: positive value, positive deviation: what is written is what is stored
    assert tables.stored_values(table)[:3] == (Decimal("0.003"), Decimal("0.01"), Decimal("0.012"))
    assert writer.write_tables([table], header=True).splitlines()[:3] == [
        "%_N_AX_EEC_INI",
        "CHANDATA(1)",
        "$AA_ENC_COMP[0,0,X1]=0.003000",
    ]


def test_the_manuals_pair_for_both_directions() -> None:
    plus, minus = read_tables((TABLES / "manual_pair_x.spf").read_text(), "p. 264").tables
    assert [len(one.deviations) for one in (plus, minus)] == [11, 11]
    assert list(plus.positions) == [-585.0 + 58.0 * n for n in range(11)]
    assert (plus.index, plus.direction, minus.index, minus.direction) == (0, 1, 1, -1)
    assert (plus.deviations[0], minus.deviations[0], plus.deviations[10]) == (2.0, -2.0, 0.0)


def test_the_manuals_802d_example_is_illustrative_and_refused() -> None:
    text = (TABLES / "manual_802d.ini").read_text()
    with pytest.raises(FileFormatError, match="E-TABLE-STEP") as caught:
        read_tables(text, "p. 222")
    assert caught.value.fields["line"] == 355
    with pytest.raises(FileFormatError, match="E-TABLE-INDEX"):
        read_tables(text.replace("[0,1]", "[0.1]"), "as the copy prints it")


def test_layouts_with_values_or_parameters_first_are_one_table() -> None:
    first = read_tables((GOLDEN / "eec_values_first.ini").read_text(), "a")
    second = read_tables((GOLDEN / "eec_parameters_first.ini").read_text(), "b")
    assert first.tables == second.tables


def test_a_cec_pair_of_one_axis() -> None:
    plus, minus = read_tables((GOLDEN / "cec_pair.spf").read_text(), "pair").tables
    assert (plus.direction, minus.direction) == (1, -1)
    assert (plus.deviations, minus.deviations) == ((0.0, 2.0, 0.0), (0.0, -1.0, 0.0))
    assert (plus.input_axis, plus.output_axis, minus.index) == ("X1", "X1", 1)
    turned = read_tables((GOLDEN / "cec_pair.spf").read_text(), "pair", cec_sign=-1).tables[0]
    assert turned.deviations == (0.0, -2.0, 0.0)


GOOD = "$AA_ENC_COMP[0,0,X1]=0\n$AA_ENC_COMP[0,1,X1]=0.001\n$AA_ENC_COMP[0,2,X1]=0\n" + (
    "$AA_ENC_COMP_STEP[0,X1]=10\n$AA_ENC_COMP_MIN[0,X1]=0\n$AA_ENC_COMP_MAX[0,X1]=20\nM17\n"
)


@pytest.mark.parametrize(
    ("old", "new", "code", "line"),
    [
        ("$AA_ENC_COMP[0,1,X1]=0.001", "$AA_ENC_COMP[0,1,X1] 0.001", "E-TABLE-EQUALS", 2),
        ("=0.001", "=NaN", "E-TABLE-NUMBER", 2),
        ("=0.001", "=1e-3", "E-TABLE-NUMBER", 2),
        ("=0.001", "=0,001", "E-TABLE-COMMA", 2),
        ("=0.001", "=", "E-TABLE-NUMBER", 2),
        ("=0.001", "=9999999", "E-TABLE-NUMBER", 2),
        ("[0,1,X1]", "[0,0,X1]", "E-TABLE-TWICE", 2),
        ("[0,1,X1]", "[0,1]", "E-TABLE-INDEX", 2),
        ("[0,1,X1]", "[X1,1,0]", "E-TABLE-INDEX", 2),
        ("$AA_ENC_COMP[0,1,X1]", "$AA_ENC_CMP[0,1,X1]", "E-TABLE-NAME", 2),
        ("[0,1,X1]", "[0,7,X1]", "E-TABLE-BEYOND", 2),
        ("$AA_ENC_COMP[0,1,X1]=0.001\n", "", "E-TABLE-GAP", 1),
        ("STEP[0,X1]=10", "STEP[0,X1]=7.5", "E-TABLE-STEP", 4),
        ("STEP[0,X1]=10", "STEP[0,X1]=0", "E-TABLE-GRID", 4),
        ("STEP[0,X1]=10", "STEP[0,X1]=-10", "E-TABLE-GRID", 4),
        ("MAX[0,X1]=20", "MAX[0,X1]=0", "E-TABLE-GRID", 4),
        ("$AA_ENC_COMP_MAX[0,X1]=20\n", "", "E-TABLE-PARAMETER", 1),
        ("M17\n", "$AA_ENC_COMP_IS_MODULO[0,X1]=-1\nM17\n", "E-TABLE-FLAG", 7),
        ("M17\n", "M17\n$AA_ENC_COMP_IS_MODULO[0,X1]=0\n", "E-TABLE-AFTER-END", 8),
        ("M17\n", "%_N_AX_EEC_INI\nM17\n", "E-TABLE-HEADER", 7),
        ("M17\n", "G1 X100\nM17\n", "E-TABLE-SYNTAX", 7),
        ("=0.001", "=inf", "E-TABLE-NUMBER", 2),
        ("[0,1,X1]", "[2,1,X1]", "E-TABLE-FIRST", 2),
        ("STEP[0,X1]", "STEP[1,X1]", "E-TABLE-PARAMETER", 1),
        ("$AA_ENC_COMP[0,0", ";$PATH=/_N_SPF_DIR\n$AA_ENC_COMP[0,0", "E-TABLE-PATH", 1),
        ("M17\n", "$AN_CEC_DIRECTION[0]=2\nM17\n", "E-TABLE-RANGE", 7),
        ("M17\n", "$MA_BACKLASH_FACTOR[6,X1]=1\nM17\n", "E-TABLE-FIRST", 7),
        ("M17\n", "$MA_TEMP_COMP_TYPE[X1]=9\nM17\n", "E-TABLE-RANGE", 7),
        ("M17\n", "$MA_BACKLASH_MODE[0,X1]=1.5\nM17\n", "E-TABLE-INTEGER", 7),
        ("M17\n", "$MA_MM_ENC_COMP_MAX_POINTS[0,X1]=801\nM17\n", "E-TABLE-NAME", 7),
        (GOOD, "; nothing\nM17\n", "E-TABLE-EMPTY", 2),
    ],
)
def test_what_is_wrong_is_refused_with_line_and_reason(old: str, new: str, code: str, line: int | None) -> None:
    with pytest.raises((FileFormatError, Gap)) as caught:
        read_tables(GOOD.replace(old, new, 1), "file.ini")
    assert caught.value.code == code
    assert caught.value.fields.get("line") == line
    assert caught.value.hint
    assert "<" not in caught.value.what


def test_points_and_parameters_for_different_encoders_are_told_apart() -> None:
    text = GOOD.replace("[0,0,X1]", "[1,0,X1]").replace("[0,1,X1]", "[1,1,X1]").replace("[0,2,X1]", "[1,2,X1]")
    with pytest.raises(FileFormatError, match="E-TABLE-MIX") as caught:
        read_tables(text, "file.ini")
    assert "encoder 1" in caught.value.what
    assert "encoder 0" in caught.value.what
    both = GOOD.replace("M17\n", "") + GOOD.replace("[0,", "[1,")
    assert [one.index for one in read_tables(both, "two measuring systems").tables] == [0, 1]


def test_a_huge_range_with_few_points_is_refused_at_once() -> None:
    text = GOOD.replace("MAX[0,X1]=20", "MAX[0,X1]=99999").replace("STEP[0,X1]=10", "STEP[0,X1]=0.0000001")
    with pytest.raises(Gap, match="E-TABLE-GAP"):
        read_tables(text, "file.ini")


micrometres = st.floats(-200.0, 200.0, allow_nan=False)


@given(st.lists(micrometres, min_size=2, max_size=40), st.sampled_from([0.5, 1.0, 5.0, 7.5]), st.booleans())
def test_quantised_tables_come_back_exactly(values: list[float], step: float, rotary: bool) -> None:
    unit = "deg" if rotary else "mm"
    table = eec(tuple(values), step, -37.5, input_unit=unit, output_unit=unit, input_axis="C1", output_axis="C1")
    table = tables.quantise(table) if rotary else tables.quantise(eec(tuple(values), step, -37.5))
    assert tables.quantise(table) == table
    assert read_tables(writer.write_tables([table]), "again").tables == (table,)
    for stored in tables.stored_values(table):
        assert stored == stored.quantize(Decimal("0.000001"))


@given(st.lists(st.decimals(-1, 1, places=10), min_size=2, max_size=20), st.sampled_from(["mm", "deg"]))
def test_ten_decimals_of_the_control_come_back_exactly(values: list[Decimal], unit: str) -> None:
    axis = "X1" if unit == "mm" else "C1"
    lines = [f"$AA_ENC_COMP[0,{n},{axis}]={value:f}" for n, value in enumerate(values)]
    lines += [
        f"$AA_ENC_COMP_{name}[0,{axis}]={value}" for name, value in (("STEP", 1), ("MIN", 0), ("MAX", len(values) - 1))
    ]
    (table,) = read_tables("\n".join([*lines, "M17"]), "live").tables
    assert table.output_unit == unit
    assert list(tables.stored_as_read(table)) == list(values)
    assert read_tables(writer.write_tables([table]), "again").tables == (table,)


def test_quantising_rounds_once_to_the_nearest_step() -> None:
    assert tables.quantise(eec((0.0, 1.0004, -1.0006))).deviations == (0.0, 1.0, -1.001)
    arcsec = eec((0.0, 1.0), 180.0, input_unit="deg", output_unit="deg", input_axis="C1", output_axis="C1")
    assert tables.quantise(arcsec).deviations == (0.0, pytest.approx(1.0008))


def test_cec_needs_this_machines_proof_and_obeys_its_sign() -> None:
    table = eec((0.0, 5.0, 0.0), 10.0, kind="cross", input_axis="Z1")
    with pytest.raises(TableError, match="E-TABLE-NO-PROOF"):
        tables.stored_values(table)
    with pytest.raises(TableError, match="E-TABLE-NO-PROOF"):
        tables.stored_values(table, proof(1, axis="C1"))
    with pytest.raises(TableError, match="E-TABLE-NO-PROOF"):
        tables.stored_values(table, proof(1, kind="axis"))
    assert tables.stored_values(table, proof(1))[1] == Decimal("0.005")
    assert tables.stored_values(table, proof(-1))[1] == Decimal("-0.005")
    text = writer.write_tables([table], [proof(-1)])
    assert read_tables(text, "cec", cec_sign=-1).tables == (table,)


def test_eec_goes_by_the_manual_and_refuses_a_contrary_proof() -> None:
    table = eec((0.0, 5.0, 0.0))
    assert tables.stored_values(table)[1] == Decimal("0.005")
    with pytest.raises(TableError, match="E-TABLE-SIGN"):
        tables.stored_values(table, proof(-1, kind="axis"))


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf"), 1e12])
def test_what_is_no_number_is_never_written(value: float) -> None:
    with pytest.raises(TableError, match="E-TABLE-FINITE"):
        writer.write_tables([eec((0.0, value, 0.0))])
