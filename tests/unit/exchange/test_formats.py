"""Exchange formats against numbers printed in their public descriptions, and there and back again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers import registry
from drivers.errors import FileFormatError, TableError, TrueflankError
from drivers.types.exchange import ErrorCurve, ErrorSet, ReadAs
from drivers.types.tables import CompensationTable

OWN = CompensationTable(
    "axis", "X", "X", 0.0, 20.0, 0.0, (0.0, 1.5, -2.25), places=(0.0, 7.5, 20.0), reverse=(0.5, 2.0, -1.75)
)
TURNING = replace(
    OWN, input_axis="C", output_axis="C", input_unit="deg", output_unit="deg", deviations=(0.0, 3.6, -7.2),
    reverse=(0.36, 3.96, -6.84),
)  # fmt: skip
CROSS = CompensationTable("cross", "Z", "X", 0.0, 100.0, 50.0, (0.0, 3.0, -4.0))


def tables(name: str):
    return registry.load(name, "table-exchange")()


def errors(name: str):
    return registry.load(name, "error-exchange")()


# LinuxCNC: the three rows that the comment of usrmotLoadComp shows for COMP_FILE_TYPE 0, and the same as trims.
PRINTED_POSITIONS = "0.000000 0.000000 -0.001279\n0.100000 0.098742 0.051632\n0.200000 0.171529 0.194216\n"
PRINTED_TRIMS = "0.0 0.0 0.001279\n0.1 0.001258 0.048368\n0.2 0.028471 0.005784\n"


@pytest.mark.parametrize(("form", "text"), [("positions", PRINTED_POSITIONS), ("trims", PRINTED_TRIMS)])
def test_linuxcnc_rows_as_the_loader_takes_them(form: str, text: str) -> None:
    (table,) = tables("linuxcnc").read(text, "x.comp", ReadAs("X", "mm", form))
    assert table.places == (0.0, 0.1, 0.2)
    assert table.deviations == pytest.approx((0.0, -1.258, -28.471))
    assert table.reverse == pytest.approx((-1.279, -48.368, -5.784))


def test_linuxcnc_stops_at_a_comment_so_comments_come_last() -> None:
    text = tables("linuxcnc").text((OWN,), "trims", ("made on a Monday",))
    rows = text.splitlines()
    assert rows[1].split() == ["7.500000000", "-0.001500000", "-0.002000000"]
    assert all(row.startswith("#") for row in rows[3:])
    with pytest.raises(FileFormatError) as lost:
        tables("linuxcnc").read("# title\n" + PRINTED_TRIMS, "x.comp", ReadAs("X", "mm", "trims"))
    assert lost.value.code == "E-EXCHANGE-LOST"
    assert lost.value.fields["line"] == 2


def test_linuxcnc_refuses_row_257() -> None:
    at = tuple(float(one) for one in range(257))
    wide = replace(OWN, places=at, deviations=(0.0,) * 257, reverse=())
    with pytest.raises(TableError) as many:
        tables("linuxcnc").text((wide,), "trims", ())
    assert many.value.fields == {"rows": 257, "limit": 256}
    whole = replace(OWN, places=at[:256], deviations=(0.0,) * 256, reverse=())
    assert tables("linuxcnc").read(tables("linuxcnc").text((whole,), "trims", ()), "", ReadAs("X", "mm", "trims"))


# TwinCAT: the worked example of page 113439115; its third point is 19866.7 um, measured 19856.5 (+) and 19874.7 (-).
PRINTED_LIST = """
kopf.log_achs_nr                     2
kopf.log_achs_name                   Y-ACHSE
kw.ssfk.interval                     0
kw.ssfk.kw_startpos                 -200000
kw.ssfk.kw_nr_max                    3
kw.ssfk.unit                         1
kw.ssfk.bilateral                    1
kw.ssfk.table[0].setpoint           -200000
kw.ssfk.table[1].setpoint           -199306
kw.ssfk.table[2].setpoint           -198667
kw.ssfk.table[0].pos                 0
kw.ssfk.table[1].pos                 24
kw.ssfk.table[2].pos                -102
kw.ssfk.table[0].neg                 0
kw.ssfk.table[1].neg                 67
kw.ssfk.table[2].neg                 80   /* one
remark */
"""


def test_twincat_values_are_the_deviations_of_the_printed_example() -> None:
    (table,) = tables("twincat").read(PRINTED_LIST, "y.lis", ReadAs("Y", "mm", "whole"))
    assert table.places == (-20.0, -19.9306, -19.8667)
    assert table.deviations[2] == pytest.approx(19856.5 - 19866.7)
    assert table.reverse[2] == pytest.approx(19874.7 - 19866.7)
    again = tables("twincat").text((table,), "whole", ())
    assert "kw.ssfk.table[2].pos -102" in again.splitlines()
    assert "kw.ssfk.table[2].neg 80" in again.splitlines()


def test_twincat_equal_steps_begin_at_the_start_position() -> None:
    text = PRINTED_LIST.replace("interval                     0", "interval 50000").replace("/* one\nremark */", "")
    (table,) = tables("twincat").read(text, "y.lis", ReadAs("Y", "mm", "whole"))
    assert table.places == (-20.0, -15.0, -10.0)


def test_twincat_cross_tables_say_what_is_not_settled() -> None:
    text = tables("twincat").text((OWN, CROSS), "real", ())
    assert "not settled" in text
    own, cross = tables("twincat").read(text, "x.lis", ReadAs("X", "mm", "real"))
    assert own.reverse == pytest.approx(OWN.reverse)
    assert cross.deviations == pytest.approx(CROSS.deviations)
    assert tuple(cross.positions) == tuple(CROSS.positions)


# TF5280: the excerpts of pages 296429067 and 296430091, in mm and rad.
PRINTED_ISG = """// The header contains the argument "X" and component errors.
X EXX EYX EZX EAX EBX ECX
0.0 0.02 0.01 0.07 0.00 0.0042 0.003
10.0 0.00 -0.1 0.01 0.00 0.0011 0.002
#
Y0A Z0A C0B
0.1 0.2 0.000022355737
"""
PRINTED_ETALON = """// one parameter a block
[C0B]
VALUE = 0.000022355737
[EXY]
Gridpoints = {
          -280.0 -0.001358635132
          -270.0 -0.000240680764
           270.0 -0.000316265101
}  // end of EXY
"""


def test_isg_csv_is_read_in_um_and_arcsec() -> None:
    found = errors("isg-volumetric").read(PRINTED_ISG, "vc.csv")
    by_name = {curve.name: curve for curve in found.curves}
    assert list(by_name) == ["EXX", "EYX", "EZX", "EAX", "EBX", "ECX"]
    assert by_name["EYX"].values == pytest.approx([10.0, -100.0])
    assert by_name["EBX"].values == pytest.approx(np.rad2deg([0.0042, 0.0011]) * 3600.0)
    assert found.locations == pytest.approx({"Y0A": 100.0, "Z0A": 200.0, "C0B": np.rad2deg(0.000022355737) * 3600.0})


def test_etalon_exchange_is_read_in_um_and_arcsec() -> None:
    found = errors("etalon-exchange").read(PRINTED_ETALON, "vc.txt")
    (curve,) = found.curves
    assert (curve.name, curve.argument, curve.axis_unit) == ("EXY", "Y", "mm")
    assert curve.values == pytest.approx([-1.358635, -0.240681, -0.316265], abs=1e-6)
    assert found.locations["C0B"] == pytest.approx(4.611, abs=1e-3)


def whole_set() -> ErrorSet:
    at, turn = np.array([0.0, 125.5, 250.0]), np.array([0.0, 90.0, 360.0])
    curves = (
        ErrorCurve("EXX", "mm", at, np.array([0.0, 1.25, -3.5])),
        ErrorCurve("EAX", "mm", at, np.array([0.0, 0.5, 0.75])),
        ErrorCurve("EXC", "deg", turn, np.array([1.0, 2.0, 1.0])),
        ErrorCurve("ECC", "deg", turn, np.array([0.0, 4.5, 0.0])),
    )
    return ErrorSet(curves, {"B0Z": 2.5, "X0C": -7.0})


@pytest.mark.parametrize("name", ["isg-volumetric", "etalon-exchange", "error-csv"])
def test_errors_come_back_and_the_head_says_the_sign(name: str) -> None:
    text = errors(name).text(whole_set(), ("note",))
    assert "actual - nominal" in text
    back = errors(name).read(text, name)
    assert {curve.name for curve in back.curves} == {"EXX", "EAX", "EXC", "ECC"}
    for curve in whole_set().curves:
        again = next(one for one in back.curves if one.name == curve.name)
        assert again.axis_unit == curve.axis_unit
        np.testing.assert_allclose(again.positions, curve.positions, atol=1e-6)
        np.testing.assert_allclose(again.values, curve.values, atol=2e-6)
    assert back.locations == pytest.approx(whole_set().locations, abs=2e-6)


NUMBER = st.floats(-500.0, 500.0, allow_nan=False).map(lambda value: round(value, 3))


@settings(max_examples=40)
@given(
    places=st.lists(st.integers(-90_000, 90_000), min_size=2, max_size=40, unique=True).map(sorted),
    values=st.lists(st.tuples(NUMBER, NUMBER), min_size=40, max_size=40),
    axis=st.sampled_from(["X", "C"]),
)
@pytest.mark.parametrize(
    ("name", "form", "tolerance"),
    [("linuxcnc", "trims", 1e-5), ("linuxcnc", "positions", 1e-5), ("twincat", "real", 1e-4), ("table-csv", "", 0.0)],
)
def test_tables_come_back(name: str, form: str, tolerance: float, places, values, axis) -> None:
    unit = "mm" if axis == "X" else "deg"
    at = tuple(place / 100.0 for place in places)
    forward, reverse = zip(*values[: len(at)], strict=True)
    table = CompensationTable(
        "axis", axis, axis, at[0], at[-1], 0.0, forward, input_unit=unit, output_unit=unit, places=at, reverse=reverse
    )
    (back,) = tables(name).read(tables(name).text((table,), form, ()), "x", ReadAs(axis, unit, form))
    scale = 1.0 if axis == "X" else 3.6
    assert back.places == pytest.approx(at, abs=1e-6)
    np.testing.assert_allclose(back.deviations, forward, atol=tolerance * scale)
    np.testing.assert_allclose(back.reverse or back.deviations, reverse, atol=tolerance * scale)


TYPED = """kind,output_axis,input_axis,input_unit,deviation_unit,modulo,direction,position,deviation,deviation_reverse
axis,X,X,mm,um,0,0,0.0,0.0,-8.0
axis,X,X,mm,um,0,0,25.0,2.5,-6.0
"""


@pytest.mark.parametrize(
    "typed",
    [
        TYPED,
        TYPED.replace(",um,", ",µm,"),
        TYPED.replace(",", " , ").upper(),
        TYPED.replace("\n", "\r\n") + ",,,,,,,,,\r\n",
        TYPED.replace(",", ";").replace(".", ","),
        TYPED.replace(",", "\t"),
    ],
    ids=["as written", "with the sign of um", "blanks and capitals", "rows without anything", "semicolons", "tabs"],
)
def test_a_sheet_is_read_as_people_and_spreadsheets_write_it(typed: str) -> None:
    (table,) = tables("table-csv").read(typed, "x.csv", ReadAs("", "mm"))
    assert (table.output_axis, table.output_unit, table.places) == ("X", "mm", (0.0, 25.0))
    assert (table.deviations, table.reverse) == ((0.0, 2.5), (-8.0, -6.0))


BAD = {
    "number": ("linuxcnc", "0 0 0\n1 nan 0\n", "E-EXCHANGE-NUMBER"),
    "decimal comma": ("linuxcnc", "0 0 0\n1,5 0 0\n", "E-EXCHANGE-NUMBER"),
    "falling": ("linuxcnc", "0 0 0\n1 0 0\n1 0 0\n", "E-EXCHANGE-RISING"),
    "short row": ("linuxcnc", "0 0 0\n1 0 0\n2 0\n3 0 0\n", "E-EXCHANGE-LOST"),
    "empty": ("linuxcnc", "", "E-EXCHANGE-COUNT"),
    "increments": (
        "twincat",
        PRINTED_LIST.replace("unit                         1", "unit 0"),
        "E-EXCHANGE-INCREMENTS",
    ),
    "cut list": ("twincat", PRINTED_LIST.replace("kw.ssfk.table[2].neg", "# "), "E-EXCHANGE-GAP"),
    "count": ("twincat", PRINTED_LIST.replace("kw_nr_max                    3", "kw_nr_max 4"), "E-FILE-COUNT"),
    "where it begins": (
        "twincat",
        PRINTED_LIST.replace("interval                     0", "interval 50000").replace("kw.ssfk.kw_startpos", "# "),
        "E-FILE-LINE",
    ),
    "both ways": ("twincat", PRINTED_LIST.replace("kw.ssfk.bilateral", "# "), "E-FILE-LINE"),
    "step": (
        "twincat",
        PRINTED_LIST.replace("kw.ssfk.interval", "# ").replace("kw.ssfk.table[2].set", "# "),
        "E-FILE-LINE",
    ),
    "twice": ("twincat", PRINTED_LIST + "kw.ssfk.table[2].pos 5\n", "E-EXCHANGE-TWICE"),
    "no list": ("twincat", "hello world of lists\n", "E-EXCHANGE-KEY"),
    "other csv": ("table-csv", "a,b,c\n1,2,3\n", "E-EXCHANGE-COLUMNS"),
    "table of mm": ("table-csv", TYPED.replace(",um,", ",mm,"), "E-EXCHANGE-WORD"),
    "table over cm": ("table-csv", TYPED.replace(",mm,", ",cm,"), "E-EXCHANGE-WORD"),
    "no table": ("table-csv", TYPED.replace("axis,X,X", "plane,X,X"), "E-EXCHANGE-WORD"),
    "no direction": ("table-csv", TYPED.replace(",0,0,", ",0,up,"), "E-EXCHANGE-WORD"),
    "no modulo": ("table-csv", TYPED.replace(",0,0,", ",no,0,"), "E-EXCHANGE-WORD"),
    "comma in commas": ("table-csv", TYPED.replace("2.5", "2,5"), "E-EXCHANGE-WIDTH"),
    "half a column": ("table-csv", TYPED.replace("-6.0", ""), "E-EXCHANGE-EMPTY"),
    "deg and um": ("table-csv", TYPED.replace(",mm,", ",deg,"), "E-EXCHANGE-OWN"),
    "own over another": ("table-csv", TYPED.replace("axis,X,X", "axis,X,Y"), "E-EXCHANGE-OWN"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_table_files_are_refused_by_line(case: str) -> None:
    name, text, code = BAD[case]
    with pytest.raises(TrueflankError) as refused:
        tables(name).read(text, "file", ReadAs("X", "mm", tables(name).forms[0]))
    assert refused.value.code == code
    assert "<" not in refused.value.what


ERRORS_TYPED = """name,argument,argument_unit,position,value,value_unit
B0Z,,,,6.5,arcsec
EXX,X,mm,0,1.5,um
EXX,X,mm,10,2.5,um
"""
BAD_ERRORS = {
    "no error": ("isg-volumetric", "X Z\n0 0\n1 0\n", "E-EXCHANGE-HEADER"),
    "unknown name": ("isg-volumetric", "X EQX\n0 0\n1 0\n", "E-EXCHANGE-HEADER"),
    "width": ("isg-volumetric", "X EXX\n0 0\n1 0 3\n", "E-EXCHANGE-WIDTH"),
    "open": ("etalon-exchange", "[EXY]\nGridpoints = {\n0 0\n1 0\n", "E-EXCHANGE-OPEN"),
    "no section": ("etalon-exchange", "VALUE = 3\n", "E-EXCHANGE-KEY"),
    "twice": ("etalon-exchange", PRINTED_ETALON + PRINTED_ETALON, "E-EXCHANGE-TWICE"),
    "nothing": ("etalon-exchange", "// empty\n", "E-EXCHANGE-COUNT"),
    "no name": ("error-csv", ERRORS_TYPED.replace("EXX", "E"), "E-EXCHANGE-KEY"),
    "no location": ("error-csv", ERRORS_TYPED.replace("B0Z", "EXX"), "E-EXCHANGE-KEY"),
    "over another axis": ("error-csv", ERRORS_TYPED.replace("EXX,X", "EXX,Z"), "E-EXCHANGE-WORD"),
    "a length in deg": ("error-csv", ERRORS_TYPED.replace(",mm,", ",deg,"), "E-EXCHANGE-WORD"),
    "a place twice": ("error-csv", ERRORS_TYPED + "B0Z,,,,7.5,arcsec\n", "E-EXCHANGE-TWICE"),
    "values in mm": ("error-csv", ERRORS_TYPED.replace(",um", ",mm"), "E-EXCHANGE-WORD"),
}


@pytest.mark.parametrize("case", BAD_ERRORS)
def test_bad_error_files_are_refused_by_line(case: str) -> None:
    name, text, code = BAD_ERRORS[case]
    with pytest.raises(TrueflankError) as refused:
        errors(name).read(text, "file")
    assert refused.value.code == code
    assert "<" not in refused.value.what


def test_a_list_holds_one_axis() -> None:
    for name in ("linuxcnc", "twincat"):
        with pytest.raises(TableError) as refused:
            tables(name).text((OWN, TURNING), tables(name).forms[0], ())
        assert refused.value.code == "E-EXCHANGE-ONE"


def test_a_turning_axis_counts_in_ten_thousandths_of_a_degree() -> None:
    lines = tables("twincat").text((TURNING,), "whole", ()).splitlines()
    assert "kw.ssfk.table[1].setpoint 75000" in lines
    assert "kw.ssfk.table[1].pos 10" in lines  # 3.6 arcsec
