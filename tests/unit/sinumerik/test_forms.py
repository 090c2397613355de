"""Every form we write comes back as the same content, byte for byte when written again; goldens of each."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import ConfigError, FileFormatError
from drivers.sinumerik.tablefile import axis_settings, reader, writer
from drivers.tablefile import TableFile
from drivers.types.tables import CompensationTable

TABLES = Path(__file__).parents[2] / "golden" / "tables"
NAMES = sorted(writer.FORMS)

stored = st.integers(-200_000, 200_000).map(lambda count: Decimal(count).scaleb(-6))
grids = st.one_of(
    st.sampled_from([0.5, 7.5, 6.73, 0.1, 1.0, 58.0, 0.0001220703125]), st.decimals("0.001", "20", places=6).map(float)
)
starts = st.decimals("-500", "500", places=5).map(float)


@st.composite
def eec(draw: st.DrawFn, axis: str, encoder: int) -> CompensationTable:
    rotary = draw(st.booleans())
    scale = 3600 if rotary else 1000
    values = tuple(float(value * scale) + 0.0 for value in draw(st.lists(stored, min_size=2, max_size=8)))
    unit = "deg" if rotary else "mm"
    step, low = draw(grids), draw(starts)
    high = float(Decimal(repr(low)) + Decimal(repr(step)) * (len(values) - 1))
    return CompensationTable(
        "axis", axis, axis, low, high, step, values, modulo=rotary, index=encoder, input_unit=unit, output_unit=unit
    )


@st.composite
def cec(draw: st.DrawFn, number: int) -> CompensationTable:
    source, output = draw(st.sampled_from([("AX1", "AX1"), ("AX3", "AX1"), ("AX1", "AX3")]))
    table = draw(eec("AX1", 0))
    if table.modulo:
        table = replace(table, modulo=False, input_unit="mm", output_unit="mm")
        table = replace(table, deviations=tuple(round(value, 3) + 0.0 for value in table.deviations))
    return replace(
        table,
        kind="cross",
        input_axis=source,
        output_axis=output,
        index=number,
        direction=draw(st.sampled_from([-1, 0, 1])),
        multiply_by=draw(st.integers(0, 3)),
        table_type=draw(st.integers(0, 1)),
    )


@st.composite
def contents(draw: st.DrawFn) -> TableFile:
    own = [draw(eec(axis, encoder)) for axis, encoder in (("AX5", 0), ("AX5", 1), ("AX6", 0)) if draw(st.booleans())]
    if {table.modulo for table in own if table.output_axis == "AX5"} == {True, False}:
        own = [table for table in own if table.output_axis != "AX5" or table.index == 0]
    cross = [draw(cec(number)) for number in range(draw(st.integers(0, 3)))]
    slack = axis_settings.Backlash("AX1", 0, draw(stored), (Decimal(1), Decimal("2.5"), *[Decimal(1)] * 4), 3)
    warmth = axis_settings.Temperature("AX3", Decimal(3), draw(stored), Decimal("0.0000115"), draw(stored))
    chosen = draw(
        st.sampled_from([{}, axis_settings.backlash_settings(slack), axis_settings.temperature_settings(warmth)])
    )
    if not (own or cross or chosen):
        chosen = {"$SN_CEC_TABLE_ENABLE[2]": Decimal(1)}
    return TableFile((*own, *cross), chosen)


layouts = st.builds(
    writer.TextForm,
    wrapper=st.sampled_from(["program", "ini", "axis-ini", "archive"]),
    order=st.sampled_from(["values-first", "parameters-first"]),
    axes=st.sampled_from(["parentheses", "quotes", "bare"]),
    numbered=st.booleans(),
    end=st.sampled_from(["M17", "M30", "M0"]),
    channel=st.integers(1, 10),
    comments=st.sampled_from([(), ("one", "two = 2 ; three")]),
)


@settings(max_examples=250, deadline=None)
@given(contents(), layouts)
def test_every_form_comes_back_as_it_was(content: TableFile, form: writer.TextForm) -> None:
    text = writer.render_file(content, form)
    assert reader.read_tables(text, "again") == content
    assert writer.render_file(reader.read_tables(text, "again"), form) == text


@settings(max_examples=100, deadline=None)
@given(
    st.floats(0.001, 100.0),
    st.floats(-1000.0, 1000.0).map(lambda low: low if abs(low) > 1e-9 else 0.0),
    st.integers(1, 50),
    st.lists(stored, min_size=51, max_size=51),
)
def test_no_digit_of_a_grid_is_ever_lost(step: float, low: float, k: int, values: list[Decimal]) -> None:
    high = low + k * step
    points = tuple(float(value * 1000) + 0.0 for value in values[: k + 1])
    table = CompensationTable("axis", "X1", "X1", low, high, step, points)
    assert reader.read_tables(writer.render_file(TableFile((table,))), "again").tables == (table,)


@pytest.mark.parametrize("name", NAMES)
def test_the_golden_of_each_form(name: str) -> None:
    text = (TABLES / f"form_{name}.txt").read_text()
    content = reader.read_tables(text, name)
    assert writer.render_file(content, writer.FORMS[name]) == text
    assert content == reader.read_tables((TABLES / "form_program.txt").read_text(), "program")
    assert len(content.tables) == 6
    assert len(content.settings) == 12


def test_a_form_nobody_knows_and_an_axis_without_number_are_refused() -> None:
    with pytest.raises(ConfigError, match="E-TABLE-FORM"):
        writer.find_form("pdf")
    table = CompensationTable("axis", "X1", "X1", 0.0, 1.0, 1.0, (0.0, 0.0))
    with pytest.raises(ConfigError, match="E-TABLE-FORM-AXIS"):
        writer.render_file(TableFile((table,)), writer.FORMS["axis-ini"])


GRID = "$AA_ENC_COMP_STEP[0,AX2]=5\n$AA_ENC_COMP_MIN[0,AX2]=0\n$AA_ENC_COMP_MAX[0,AX2]=5\n"
POINTS = "$AA_ENC_COMP[0,0,AX2]=0\n$AA_ENC_COMP[0,1,AX2]=0.001\n"


@pytest.mark.parametrize(
    "text",
    [
        POINTS + GRID + "M17",
        GRID + POINTS + "M30\n",
        GRID + POINTS + "M0",
        "%_N_AX_EEC_INI\nCHANDATA(1)\n" + POINTS + GRID + "M17\n",
        "%_N_AX2_EEC_INI\n" + POINTS + GRID + "m0\nm30\nM17\n",
        "%_N_TABLE_SPF\n;$PATH=/_N_SPF_DIR\n" + GRID + POINTS + "M17\n",
        "; a comment\n\n" + POINTS.replace("=", "\t = ").replace("[0,", " [ 0 , ") + GRID.lower() + "RET",
        "".join(f"N{place}0 {line} '0Fa9\n" for place, line in enumerate((POINTS + GRID).splitlines(), 1)) + "M17\n",
        (POINTS + GRID).replace("=0\n", "=+.0 ; zero\n").replace("0.001", "1EX-3") + "N99 M17",
        POINTS + "$AA_ENC_COMP_IS_MODULO[0,AX2]=FALSE\n" + GRID + "NEWCONF\nSTOPRE\nM17\n",
        (POINTS + GRID).replace("\n", "\r\n") + "M17\r\n",
    ],
)
def test_samples_vary_and_mean_one_table(text: str) -> None:
    expected = CompensationTable("axis", "AX2", "AX2", 0.0, 5.0, 5.0, (0.0, 1.0))
    assert reader.read_tables(text, "sample").tables == (expected,)


@pytest.mark.parametrize("axis", ["(AX2)", '"AX2"', "AX2", "( ax2 )"])
def test_every_name_form_of_an_axis(axis: str) -> None:
    text = f"$AN_CEC_INPUT_AXIS[0]={axis}\n$AN_CEC_OUTPUT_AXIS[0]=(X1)\n"
    text += "".join(f"$AN_CEC_{name}[0]={value}\n" for name, value in (("STEP", 1), ("MIN", 0), ("MAX", 1)))
    (table,) = reader.read_tables(text + "$AN_CEC[0,0]=0\n$AN_CEC[0,1]=0\nM17\n", "cec").tables
    assert (table.input_axis, table.output_axis) == ("AX2", "X1")


def test_an_archive_of_several_files_is_one_content() -> None:
    second = POINTS.replace("AX2", "AX3") + GRID.replace("AX2", "AX3") + "M17\n"
    text = "%_N_AX2_EEC_INI\n" + POINTS + GRID + "M17\n%_N_AX3_EEC_INI\n" + second
    assert [table.output_axis for table in reader.read_tables(text, "archive").tables] == ["AX2", "AX3"]
    with pytest.raises(FileFormatError, match="E-TABLE-TWICE") as caught:
        reader.read_tables(text.replace("AX3", "AX2"), "one name twice")
    assert caught.value.fields["line"] == 9


def test_settings_are_understood() -> None:
    text = "N32450 $MA_BACKLASH[0,AX1]=0.004 '1a2b\nN32452 $MA_BACKLASH_FACTOR[1,AX1]=0.5 '1a2c\n"
    text += "N32454 $MA_BACKLASH_MODE[0,AX1]='H3' '1a2d\nN32750 $MA_TEMP_COMP_TYPE[AX1]=3\n"
    text += "N43900 $SA_TEMP_COMP_ABS_VALUE[AX1]=0.01\nN43910 $SA_TEMP_COMP_SLOPE[AX1]=0.02\n"
    text += "N43920 $SA_TEMP_COMP_REF_POSITION[AX1]=100\nN32760 $MA_COMP_ADD_VELO_FACTOR[AX1]=0.01\nM17\n"
    found = reader.read_tables(text, "tea").settings
    slack = axis_settings.backlash_of(found, "AX1")
    assert slack is not None
    assert (slack.effective(), slack.effective(1)) == (Decimal("0.004"), Decimal("0.002"))
    assert (slack.restored_at_power_on, slack.ignores_compensation, slack.dynamic) == (True, True, 0)
    assert axis_settings.backlash_of(found, "AX2") is None
    warmth = axis_settings.temperature_of(found, "AX1")
    assert warmth is not None
    assert warmth.acting_slope == Decimal("0.01")  # clipped to MD32760, as the control does without an alarm
    assert warmth.shift(Decimal(300)) == Decimal("2.01")
    assert replace(warmth, kind=Decimal(1)).shift(Decimal(300)) == Decimal("0.01")
    assert replace(warmth, kind=Decimal(0)).shift(Decimal(300)) == 0
    assert axis_settings.temperature_of(found, "AX2") is None
    assert axis_settings.temperature_of(axis_settings.temperature_settings(warmth), "AX1") == warmth
    assert axis_settings.backlash_of(axis_settings.backlash_settings(slack), "AX1") == slack


def test_a_back_up_of_ours_reads_loosely_with_its_leftovers_said() -> None:
    text = (TABLES.parent / "sinumerik" / "backup_c1.spf").read_text()
    content = reader.read_tables_loosely(text, "back-up")
    assert [len(table.deviations) for table in content.tables] == [3, 2]
    assert tuple(map(str, content.notes)) == ("$AA_ENC_COMP[0,..,C1]: 1 points from 3 on do not act",)
    assert content.lengths == {"$MA_BACKLASH[0,C1]": "deg"}
    with pytest.raises(FileFormatError, match="E-TABLE-BEYOND"):
        reader.read_tables(text, "back-up")
    empty = "$AA_ENC_COMP[0,0,X1]=0\n" + "".join(f"$AA_ENC_COMP_{name}[0,X1]=0\n" for name in ("STEP", "MIN", "MAX"))
    assert reader.read_tables_loosely(empty + "M17", "new").tables == ()
    assert "never loaded" in str(reader.read_tables_loosely(empty + "M17", "new").notes[0])
