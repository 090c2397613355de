"""Findings: clean tables are clean, each mistake of the public tools is named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from drivers import registry
from drivers.sinumerik import lint, tables
from drivers.types import CompensationTable, TableLimits

GOLDEN = Path(__file__).parents[2] / "golden" / "sinumerik"
CLEAN = CompensationTable("EEC", "X1", "X1", 0.0, 100.0, 50.0, (0.0, 5.0, 2.0))
TURN = CompensationTable(
    "EEC", "C1", "C1", 0.0, 360.0, 180.0, (0.0, -3.0, 0.0), modulo=True, input_unit="deg", output_unit="deg"
)


def codes(table: CompensationTable, **known: object) -> list[str]:
    return [finding.code for finding in lint.of_table(table, "t", **known)]


def test_good_tables_have_no_findings() -> None:
    assert codes(CLEAN, reference=0.0, limits=TableLimits(3, 1e-6, 0.2)) == []
    assert codes(TURN, reference=0.0) == []


@pytest.mark.parametrize(
    ("table", "known", "code"),
    [
        (CLEAN, {"limits": TableLimits(2, 1e-6, 0.2)}, "E-TABLE-POINTS"),
        (CLEAN, {"reference": 50.0}, "E-TABLE-REFERENCE"),
        (replace(CLEAN, index=1), {}, "E-TABLE-ENCODER"),
        (replace(CLEAN, step=7.0), {}, "E-TABLE-STEP"),
        (replace(CLEAN, step=0.0), {}, "E-TABLE-GRID"),
        (replace(CLEAN, maximum=150.0), {}, "E-TABLE-COUNT"),
        (replace(CLEAN, deviations=(0.0, 201.0, 2.0), step=5000.0, maximum=10000.0), {}, "E-TABLE-VALUE"),
        (replace(CLEAN, deviations=(0.0, 51.0, 2.0)), {}, "E-TABLE-SLOPE"),
        (replace(CLEAN, deviations=(0.0, 11.0, 2.0)), {}, "E-TABLE-STEEP"),
        (replace(CLEAN, deviations=(0.0, float("nan"), 2.0)), {}, "E-TABLE-FINITE"),
        (replace(TURN, deviations=(0.0, -3.0, 1.0)), {}, "E-TABLE-CLOSURE"),
        (replace(TURN, maximum=340.0, step=170.0), {}, "E-TABLE-MODULO"),
        (replace(TURN, deviations=(0.0, 181.0, 0.0)), {}, "E-TABLE-VALUE"),
    ],
)
def test_each_mistake_is_named(table: CompensationTable, known: dict[str, object], code: str) -> None:
    assert code in codes(table, **known)


def test_one_deviation_in_both_layers() -> None:
    cross = replace(CLEAN, function="CEC")
    assert [finding.code for finding in lint.of_set([CLEAN, cross], "t")] == ["E-TABLE-BOTH"]
    assert lint.of_set([CLEAN, replace(cross, direction=1)], "t") == []
    assert lint.of_set([CLEAN, replace(cross, input_axis="Z1")], "t") == []


def test_files_are_linted_through_the_registry() -> None:
    files = registry.load("sinumerik-tables", "table-file")()
    assert files.findings(tables.write([CLEAN, TURN]), "good.ini") == ()
    cut = files.findings(tables.write([CLEAN]).replace("M17", ""), "cut.ini")
    assert len(cut) == 1
    assert "E-TABLE-CUT" in cut[0]
    assert "cut.ini" in cut[0]


def test_a_file_without_equals_signs_and_for_encoder_2_gives_every_line() -> None:
    text = "%_N_AX_EEC_INI\n$AA_ENC_COMP[1,0,X1] 0.001\n$AA_ENC_COMP[1,1,X1] 0.002\nm0\nm30\nM17\n"
    found = tables.TableFiles().findings(text, "old.ini")
    assert sum("E-TABLE-EQUALS" in line for line in found) == 2


def test_a_step_printed_without_decimals_no_longer_divides() -> None:
    text = tables.write([replace(CLEAN, step=7.5, maximum=15.0)]).replace("STEP[0,X1]=7.5", "STEP[0,X1]=8")
    assert any("E-TABLE-STEP" in line for line in tables.TableFiles().findings(text, "tool.spf"))
