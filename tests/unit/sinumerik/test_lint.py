"""Findings: clean tables are clean, each mistake is named, wrong is told from doubtful."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal

import pytest

from drivers import registry
from drivers.errors import ConfigError
from drivers.sinumerik.tablefile import lint, writer
from drivers.sinumerik.tablefile.format import TableFiles
from drivers.sinumerik.tablefile.reader import read_tables
from drivers.tablefile import TableFile, TableMachine
from drivers.types.tables import CompensationTable

CLEAN = CompensationTable("axis", "X1", "X1", 0.0, 100.0, 50.0, (0.0, 5.0, 2.0))
TURN = CompensationTable(
    "axis", "C1", "C1", 0.0, 360.0, 180.0, (0.0, -3.0, 0.0), modulo=True, input_unit="deg", output_unit="deg"
)
CROSS = replace(CLEAN, kind="cross", input_axis="Z1", index=2)
KNOWN = TableMachine(references={"": 0.0})


def codes(table: CompensationTable, known: TableMachine = KNOWN) -> dict[str, str]:
    return {finding.code: finding.severity for finding in lint.lint_table(table, "t", known)}


def of_file(content: TableFile | str, known: TableMachine = KNOWN) -> dict[str, str]:
    """Code -> gravest severity of the findings of a file."""
    text = content if isinstance(content, str) else writer.render_file(content)
    return {finding.code: finding.severity for finding in TableFiles().findings(text, "file.spf", known)}


def test_good_tables_have_no_findings() -> None:
    assert codes(CLEAN, replace(KNOWN, own_points=3)) == {}
    assert codes(TURN) == {}
    files = registry.load("sinumerik-tables", "table-file")()
    assert files.findings(writer.write_tables([CLEAN, TURN]), "good.ini", KNOWN) == ()


@pytest.mark.parametrize(
    ("table", "known", "code"),
    [
        (CLEAN, {"own_points": 2}, "E-TABLE-RESERVED"),
        (CLEAN, {"references": {"X1": 50.0}}, "E-TABLE-REFERENCE"),
        (replace(CLEAN, step=7.0), {}, "E-TABLE-COUNT"),
        (replace(CLEAN, step=0.0), {}, "E-TABLE-GRID"),
        (replace(CLEAN, step=1e12), {}, "E-TABLE-STEP"),
        (replace(CLEAN, maximum=150.0), {}, "E-TABLE-COUNT"),
        (replace(CLEAN, deviations=(0.0, 201.0, 2.0), step=5000.0, maximum=10000.0), {}, "E-TABLE-VALUE"),
        (replace(CLEAN, deviations=(0.0, 51.0, 2.0)), {}, "E-TABLE-SLOPE"),
        (replace(CLEAN, deviations=(0.0, float("nan"), 2.0)), {}, "E-TABLE-FINITE"),
        (replace(TURN, deviations=(0.0, -3.0, 1.0)), {}, "E-TABLE-CLOSURE"),
        (replace(TURN, maximum=340.0, step=170.0), {}, "E-TABLE-MODULO"),
        (replace(TURN, deviations=(0.0, 181.0, 0.0)), {}, "E-TABLE-VALUE"),
        (replace(CROSS, index=8), {"control": "828D"}, "E-TABLE-NUMBER-OF"),
        (replace(CROSS, step=0.25, deviations=(0.0,) * 401), {"control": "828D"}, "E-TABLE-CONTROL"),
        (replace(CROSS, step=0.25, deviations=(0.0,) * 401), {"control": "802D"}, "E-TABLE-CONTROL"),
    ],
)
def test_each_mistake_is_named(table: CompensationTable, known: dict[str, object], code: str) -> None:
    assert codes(table, replace(KNOWN, **known)).get(code) == "wrong"


@pytest.mark.parametrize(
    ("table", "known", "code", "severity"),
    [
        (replace(CLEAN, index=1), {}, "W-TABLE-ENCODER", "note"),
        (replace(CLEAN, index=1), {"acting": {"X1": (0,)}}, "W-TABLE-OTHER-ENCODER", "doubtful"),
        (replace(CLEAN, step=40.0), {}, "W-TABLE-STEP", "doubtful"),
        (replace(CLEAN, deviations=(0.0, 11.0, 2.0)), {}, "W-TABLE-STEEP", "doubtful"),
        (replace(TURN, step=20.0, deviations=(0.0, 120.0, *(0.0,) * 17)), {}, "W-TABLE-STEEP", "doubtful"),
        (CLEAN, {"references": {"Z1": 0.0}}, "W-TABLE-NO-REFERENCE", "note"),
        (CLEAN, {"control": "840D"}, "W-TABLE-SIZE", "note"),
        (CROSS, {"control": "808D"}, "W-TABLE-SIZE", "note"),
        (CLEAN, {"velocity": 10000.0}, "W-TABLE-VELOCITY", "note"),
    ],
)
def test_doubts_and_notes_are_no_errors(
    table: CompensationTable, known: dict[str, object], code: str, severity: str
) -> None:
    assert codes(table, replace(KNOWN, **known)) == {code: severity}


def test_the_memory_is_named_by_its_own_machine_datum() -> None:
    (eec,) = lint.lint_table(CLEAN, "t", replace(KNOWN, own_points=2, cross_points=9))
    (cec,) = lint.lint_table(CROSS, "t", replace(KNOWN, own_points=9, cross_points=2))
    assert "MD38000" in eec.error.what
    assert "MD18342" not in eec.error.what
    assert "MD18342" in cec.error.what
    assert "MD38000" not in cec.error.what
    with pytest.raises(ConfigError, match="E-TABLE-WHICH"):
        TableFiles().findings("", "f", TableMachine(control="HEIDENHAIN"))


def test_the_velocity_that_a_slope_adds() -> None:
    (note,) = lint.lint_table(CLEAN, "t", replace(KNOWN, velocity=10000.0))  # 5 um in 50 mm
    assert note.error.fields["added"] == "1 mm/min"
    assert str(note.error.fields["share"]) == "0.01"


@pytest.mark.parametrize(
    ("table", "code"),
    [
        (replace(CLEAN, deviations=(0.0, 5000.0, 2000.0)), "W-TABLE-LARGE-UNIT"),  # 5 um written as 5
        (replace(TURN, deviations=(0.0, -3.0 * 3600, 0.0)), "W-TABLE-LARGE-UNIT"),  # 3 arcsec written as 3 deg
        (replace(CLEAN, deviations=(0.0, 0.005, 0.002)), "W-TABLE-TINY"),  # um divided by 1000 twice
        (replace(CLEAN, maximum=254.0, step=127.0), "W-TABLE-INCH-GRID"),
        (replace(CLEAN, minimum=-3.937008, maximum=3.937008, step=3.937008), "W-TABLE-INCH"),
    ],
)
def test_a_wrong_unit_is_suspected(table: CompensationTable, code: str) -> None:
    assert [finding.code for finding in lint.doubt_units(table, "t")] == [code]
    assert list(lint.doubt_units(CLEAN, "t")) == list(lint.doubt_units(TURN, "t")) == []


def test_one_deviation_in_both_layers() -> None:
    same = replace(CLEAN, kind="cross")
    assert of_file(TableFile((CLEAN, same)))["E-TABLE-BOTH"] == "wrong"
    assert of_file(TableFile((CLEAN, replace(same, deviations=(0.0, -5.0, -2.0)))))["E-TABLE-BOTH"] == "wrong"
    other = replace(same, deviations=(0.0, -2.0, 2.0))
    assert of_file(TableFile((CLEAN, other)))["W-TABLE-LAYERS"] == "doubtful"
    assert "E-TABLE-BOTH" not in of_file(TableFile((CLEAN, replace(same, input_axis="Z1"))))
    assert "E-TABLE-BOTH" not in of_file(TableFile((CLEAN, replace(same, deviations=(0.0, 0.0, 0.0)))))
    pair = (replace(same, direction=1), replace(same, direction=-1, index=1))
    assert of_file(TableFile((CLEAN, *pair)))["E-TABLE-BOTH"] == "wrong"
    reversal = (pair[0], replace(pair[1], deviations=(0.0, -5.0, -2.0)))
    assert "E-TABLE-BOTH" not in of_file(TableFile((CLEAN, *reversal)))


def test_a_pair_and_the_backlash_for_the_same_amount() -> None:
    plus = replace(CLEAN, kind="cross", direction=1, deviations=(0.0, 2.0, 2.5))
    minus = replace(plus, direction=-1, index=1, deviations=(0.0, -2.0, -2.5))
    slack = {"$MA_BACKLASH[0,X1]": Decimal("0.003")}
    assert of_file(TableFile((plus, minus), slack))["E-TABLE-BACKLASH"] == "wrong"
    assert "E-TABLE-BACKLASH" not in of_file(TableFile((plus, minus), {"$MA_BACKLASH[0,X1]": Decimal("0.02")}))
    assert "E-TABLE-BACKLASH" not in of_file(TableFile((plus, minus)))
    halved = slack | {"$MA_BACKLASH_FACTOR[0,X1]": Decimal("0.05")}
    assert "E-TABLE-BACKLASH" not in of_file(TableFile((plus, minus), halved))


def test_what_tables_of_one_axis_do_to_each_other() -> None:
    half = replace(CROSS, input_axis="X1", direction=1)
    assert of_file(TableFile((half,)))["W-TABLE-HALF"] == "doubtful"
    assert "W-TABLE-HALF" not in of_file(TableFile((half, replace(half, direction=-1, index=3))))
    assert of_file(TableFile((CROSS, replace(CROSS, index=3))))["W-TABLE-SUM"] == "doubtful"
    factor = replace(CROSS, multiply_by=5)
    assert of_file(TableFile((factor,)))["W-TABLE-FACTOR"] == "doubtful"
    assert "W-TABLE-FACTOR" not in of_file(TableFile((factor, replace(CROSS, input_axis="C1", index=4))))


def test_every_cec_table_repeats_that_its_sign_is_unproven() -> None:
    assert of_file(TableFile((CROSS,)))["W-TABLE-CEC-SIGN"] == "doubtful"
    assert "W-TABLE-CEC-SIGN" not in of_file(TableFile((CLEAN,)))


def test_what_the_text_itself_tells() -> None:
    good = writer.render_file(TableFile((CLEAN,)))
    assert of_file(good.replace("M17\n", "")) == {"E-TABLE-CUT": "wrong"}
    assert of_file("; nothing\n") == {"E-TABLE-EMPTY": "wrong"}
    assert of_file(good.replace("M17", "M0\nM17")) == {"W-TABLE-STOP": "note"}
    assert of_file(good.replace("M17", "M0\nM30\nM17")) == {"W-TABLE-STOP": "note", "W-TABLE-ENDS": "doubtful"}
    checked = "".join(f"{line} '1A2B\n" for line in good.splitlines()[:-1]) + "M17\n"
    assert of_file(checked) == {"W-TABLE-CHECK-SUMS": "note"}
    assert of_file(checked.replace("=50.0 '1A2B", "=50.0")) == {"W-TABLE-EDITED": "doubtful"}
    assert of_file("%_N_NC_CEC_INI\n" + good) == {"W-TABLE-HEADER": "doubtful"}
    numbered = good.replace("X1", "AX2")
    linear = replace(KNOWN, units={"AX2": "mm"})
    assert of_file("%_N_AX3_EEC_INI\n" + numbered, linear) == {"W-TABLE-HEADER": "doubtful"}
    assert of_file("%_N_AX2_EEC_INI\n" + numbered, linear) == {}
    assert of_file("%_N_AX2_EEC_INI\n" + numbered) == {"W-TABLE-UNIT": "doubtful"}


def test_leftovers_above_the_last_point() -> None:
    good = writer.render_file(TableFile((CLEAN,)))
    zero = good.replace("$AA_ENC_COMP_STEP", "$AA_ENC_COMP[0,3,X1]=0\n$AA_ENC_COMP_STEP")
    assert of_file(zero) == {"W-TABLE-LEFT": "note"}
    live = zero.replace("[0,3,X1]=0", "[0,3,X1]=0.004")
    assert of_file(live) == {"E-TABLE-BEYOND": "wrong"}
    steep = live.replace("=0.005000", "=0.055000")  # and the other findings are still made
    assert set(of_file(steep)) == {"E-TABLE-BEYOND", "E-TABLE-SLOPE"}


def test_every_wrong_line_is_named_not_only_the_first() -> None:
    text = "%_N_AX_EEC_INI\n$AA_ENC_COMP[1,0,X1] 0.001\n$AA_ENC_COMP[1,1,X1]=0,002\nX\nM17\n"
    found = [finding.error.fields["line"] for finding in TableFiles().findings(text, "old.ini")]
    assert found == [2, 3, 4]


def test_a_modulo_axis_is_rotary_wherever_the_file_uses_it() -> None:
    modulo = writer.render_file(TableFile((TURN,))).replace("C1", "AX4").replace("M17\n", "")
    cross = writer.render_file(TableFile((replace(CROSS, output_axis="AX4"),)))
    eec, cec = read_tables(modulo + cross, "both").tables
    assert (eec.output_unit, cec.output_unit, cec.input_unit) == ("deg", "deg", "mm")
