"""Tables of other controls: printed examples, files as strangers have them, there and back, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers import registry
from drivers.errors import FileFormatError, TableError, TrueflankError
from drivers.types.exchange import ErrorSet, ReadAs
from drivers.types.tables import CompensationTable

OWN = CompensationTable(
    "axis", "X", "X", -10.0, 20.0, 0.0, (0.0, 1.5, -2.25), places=(-10.0, 5.0, 20.0), reverse=(0.5, 2.0, -1.75)
)


def driver(name: str) -> Any:
    return registry.load(name, "table-exchange")()


def as_x(form: str = "", **declared: Any) -> ReadAs:
    return ReadAs("X", "mm", form, declared)


# FANUC 0i-PB parameter manual p. 99-100: numbers 33 to 49, reference 40 at 0, interval 50.
PRINTED = (2, 1, 1, -2, 0, -1, 0, -1, 2, 1, 0, -1, -1, -2, 0, 1, 2)
ABSOLUTE = (0, 2, 3, 4, 2, 2, 1, 1, 0, 2, 3, 3, 2, 1, -1, -1, 0, 2)
FACTS = {"interval": 50, "magnification": 1, "unit_um": 1, "zero": 0}
LISTING = "%\nN03620A1P40A2P140\n" + "".join(f"N{10033 + k}P{one}\n" for k, one in enumerate(PRINTED)) + "%\n"


def test_fanuc_increments_are_summed_outwards_from_the_reference() -> None:
    (table,) = driver("fanuc").read(LISTING, "x.txt", as_x("error", axis_number=1, **FACTS))
    assert table.places == tuple(range(-400, 451, 50))
    assert table.deviations == tuple(map(float, ABSOLUTE))
    (turned,) = driver("fanuc").read(LISTING, "x.txt", as_x("correction", axis_number=1, **FACTS))
    assert turned.deviations == tuple(-float(one) for one in ABSOLUTE)


def test_fanuc_magnification_detection_unit_and_place_of_the_reference_count() -> None:
    facts = FACTS | {"magnification": 2, "unit_um": 0.5, "zero": 125.0, "reference": 40}
    text = LISTING.replace("N03620A1P40A2P140\n", "N03623 P4\n")
    (table,) = driver("fanuc").read(text, "x.txt", as_x("error", **facts))
    assert table.places[0] == -275.0
    assert table.deviations == tuple(map(float, ABSOLUTE))


@pytest.mark.parametrize(
    ("text", "declared", "form", "code"),
    [
        (LISTING, {"axis_number": 1, **FACTS}, "", "E-EXCHANGE-SIGN"),
        (LISTING, FACTS, "error", "E-EXCHANGE-DECLARE"),  # which axis of the parameters
        (LISTING, {"axis_number": 1}, "error", "E-EXCHANGE-DECLARE"),
        (LISTING, {"axis_number": 2, **FACTS}, "error", "E-EXCHANGE-REFERENCE"),
        (LISTING.replace("N10036P-2\n", ""), {"axis_number": 1, **FACTS}, "error", "E-EXCHANGE-SERIES"),
        (LISTING.replace("N10036P-2", "N10035P-2"), {"axis_number": 1, **FACTS}, "error", "E-EXCHANGE-TWICE"),
        (LISTING.replace("P-2", "P-0.5"), {"axis_number": 1, **FACTS}, "error", "E-EXCHANGE-KEY"),
        (LISTING.replace("P-2", "X-2"), {"axis_number": 1, **FACTS}, "error", "E-EXCHANGE-KEY"),
        (LISTING.removesuffix("%\n"), {"axis_number": 1, **FACTS}, "error", "E-EXCHANGE-OPEN"),
        (LISTING, {"axis_number": 1, **FACTS, "interval": -50}, "error", "E-EXCHANGE-DECLARE"),
        (LISTING, {"axis_number": 1, **FACTS, "interval": "wide"}, "error", "E-EXCHANGE-DECLARE"),
        (LISTING.replace("N03620A1", "N03605A1P1\nN03620A1"), {"axis_number": 1, **FACTS}, "error",
         "E-EXCHANGE-BOTH-WAYS"),
        ("N10000P1\n", FACTS, "error", "E-EXCHANGE-KEY"),
    ],
)  # fmt: skip
def test_fanuc_asks_or_refuses(text: str, declared: dict[str, Any], form: str, code: str) -> None:
    with pytest.raises(FileFormatError) as wrong:
        driver("fanuc").read(text, "x.txt", as_x(form, **declared))
    assert wrong.value.code == code


def test_fanuc_turns_that_do_not_close_are_refused_and_nothing_is_written() -> None:
    turn = "%\n" + "".join(f"N{10000 + k}P{one}\n" for k, one in enumerate((1, 0, -1, 0))) + "%\n"
    known = ReadAs("C", "deg", "error", FACTS | {"interval": 90, "reference": 0})
    (table,) = driver("fanuc").read(turn, "c.txt", known)
    assert (table.modulo, table.positions[0], table.positions[-1]) == (True, -90.0, 270.0)
    with pytest.raises(FileFormatError) as open_turn:
        driver("fanuc").read(turn.replace("P-1", "P3"), "c.txt", known)
    assert open_turn.value.code == "E-EXCHANGE-TURN"
    with pytest.raises(TableError) as written:
        driver("fanuc").text((OWN,), "error", ())
    assert written.value.code == "E-EXCHANGE-READ-ONLY"


COM = (
    "BEGIN XCORR   .COM DATUM: +0\nNR   AXISPOS     BACKLASH    X\n0    -200        +0.004      +0.0012\n"
    "1    -195        +0.005      +0.0021\n2    -190        +0.005      +0.0007\n[END]\n"
)
OLDER = (
    "BEGIN AXIS-X.COM  DATUM:-200.0000 DISTANCE:+6.5536\nNR POS X Y\n"
    "0 -200.0000 +0.0010 -0.0020\n1 -193.4464 +0.0030 -0.0010\n[END]\n"
)


def test_heidenhain_columns_are_the_directions_and_the_sign_is_asked() -> None:
    (table,) = driver("heidenhain").read(COM, "x.com", as_x("error"))
    assert table.places == (-200.0, -195.0, -190.0)
    assert table.deviations == pytest.approx((1.2, 2.1, 0.7))
    assert table.reverse == pytest.approx((4.0, 5.0, 5.0))
    (cross,) = driver("heidenhain").read(OLDER, "x.com", ReadAs("Y", "mm", "correction"))
    assert (cross.kind, cross.input_axis, cross.output_axis) == ("cross", "X", "Y")
    assert cross.deviations == pytest.approx((2.0, 1.0))
    with pytest.raises(FileFormatError) as asked:
        driver("heidenhain").read(COM, "x.com", as_x())
    assert asked.value.code == "E-EXCHANGE-SIGN"
    (inch,) = driver("heidenhain").read(COM.replace("DATUM: +0", "INCH"), "x.com", as_x("error"))
    assert inch.places[0] == pytest.approx(-5080.0)
    assert inch.deviations[0] == pytest.approx(30.48)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (COM.replace("XCORR", "TABLE"), "E-EXCHANGE-DECLARE"),
        (COM.replace("[END]\n", ""), "E-EXCHANGE-OPEN"),
        (COM.replace("1    -195", "3    -195"), "E-EXCHANGE-GAP"),
        (COM.replace("-195", "-205"), "E-EXCHANGE-RISING"),
        (COM.replace("+0.0021", "9e99"), "E-EXCHANGE-NUMBER"),
        (COM.replace("      +0.0021", ""), "E-EXCHANGE-WIDTH"),
        (COM.replace("AXISPOS ", "X "), "E-EXCHANGE-HEADER"),
        (COM.replace("   X\n", "   Y\n"), "E-EXCHANGE-AXIS"),
        (COM.replace("BEGIN", "START"), "E-EXCHANGE-KEY"),
        (COM.replace(".COM", ".CMA"), "E-EXCHANGE-KEY"),
        (OLDER.replace("6.5536", "3.2768"), "E-EXCHANGE-STEP"),
        (OLDER.replace("DATUM:-200", "DATUM:-100"), "E-EXCHANGE-STEP"),
        ("", "E-EXCHANGE-KEY"),
    ],
)
def test_heidenhain_tables_that_contradict_themselves_are_refused(text: str, code: str) -> None:
    with pytest.raises(FileFormatError) as wrong:
        driver("heidenhain").read(text, "x.com", as_x("error"))
    assert wrong.value.code == code


AXESERR = (
    "unit = mm\n[X]\n-300, 0.000, 0.012\n-200, 0.004, 0.015\n-100, 0.006, 0.018\n0, 0.000, 0.011\n"
    "[Y]\n0, 0.000, 0.008\n100, -0.003, 0.006\n200, -0.005, 0.004\n"
)


def test_axeserr_holds_the_error_of_each_direction() -> None:
    first, second = driver("axeserr").read(AXESERR, "axeserr.dat", as_x())
    assert (first.output_axis, first.deviations, first.reverse) == ("X", (0, 4, 6, 0), (12, 15, 18, 11))
    assert (second.output_axis, second.places, second.deviations) == ("Y", (0, 100, 200), (0, -3, -5))
    (remark, _) = driver("axeserr").read("; NK200\n" + AXESERR.replace("unit = mm", ";unit=mm"), "", as_x())
    assert remark.deviations == first.deviations


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (AXESERR.replace("unit = mm\n", ""), "E-EXCHANGE-DECLARE"),
        (AXESERR.replace("unit = mm", "unit = furlong"), "E-EXCHANGE-KEY"),
        (AXESERR.replace("[Y]", "[X]"), "E-EXCHANGE-TWICE"),
        (AXESERR.replace("-100, ", "-250, "), "E-EXCHANGE-RISING"),
        (AXESERR.replace(", 0.018", ""), "E-EXCHANGE-WIDTH"),
        (AXESERR.replace("0.018", "Out of range"), "E-EXCHANGE-NUMBER"),
        (AXESERR.replace("[X]\n", ""), "E-EXCHANGE-KEY"),
        ("unit = mm\n[X]\n0, 0, 0\n", "E-EXCHANGE-COUNT"),
        ("unit = mm\n", "E-EXCHANGE-COUNT"),
    ],
)
def test_axeserr_files_that_are_wrong_are_refused(text: str, code: str) -> None:
    with pytest.raises(FileFormatError) as wrong:
        driver("axeserr").read(text, "axeserr.dat", as_x())
    assert wrong.value.code == code


CAL = (
    ";*************** Axis calibration **************\n:START 1 SAMPLEDIST=10 POSUNIT=PRIMARY CORUNIT=PRIMARY/1000\n"
    ":START HOMEDIRECTION=CCW HOMEOFFSET=0\n0.0        -0.4        -1.1        -0.7        0.2        0.9\n"
    "1.3        0.8\n:END\n"
)


def test_aerotech_values_are_corrections_from_a_declared_first_position() -> None:
    (table,) = driver("aerotech").read(CAL, "x.cal", as_x(start=-30))
    assert table.places == tuple(range(-30, 50, 10))
    assert table.deviations == pytest.approx((0, 0.4, 1.1, 0.7, -0.2, -0.9, -1.3, -0.8))
    (turning,) = driver("aerotech").read(
        CAL.replace("/1000", "/3600"), "c.cal", ReadAs("C", "deg", "", {"start": 0, "axis_number": 1})
    )
    assert turning.deviations == table.deviations  # PRIMARY/3600 of a rotary axis is arcsec


@pytest.mark.parametrize(
    ("text", "declared", "code"),
    [
        (CAL, {}, "E-EXCHANGE-DECLARE"),
        (CAL, {"start": 0, "axis_number": 2}, "E-EXCHANGE-DECLARE"),
        (CAL + CAL.replace("START 1", "START 2"), {"start": 0}, "E-EXCHANGE-DECLARE"),
        (CAL.replace("START 1", "START2D 2 1 3 1 50 50 10"), {"start": 0}, "E-EXCHANGE-PLANE"),
        (CAL.replace("POSUNIT=PRIMARY", "POSUNIT=COUNTS"), {"start": 0}, "E-EXCHANGE-KEY"),
        (CAL.replace("HOMEOFFSET=0", "NEGCOR=1"), {"start": 0}, "E-EXCHANGE-KEY"),
        (CAL.replace("SAMPLEDIST=10", "SAMPLEDIST=-10"), {"start": 0}, "E-EXCHANGE-NUMBER"),
        (CAL.replace(":END\n", ""), {"start": 0}, "E-EXCHANGE-OPEN"),
        (CAL.replace("-1.1", "nan"), {"start": 0}, "E-EXCHANGE-NUMBER"),
        ("; nothing\n", {"start": 0}, "E-EXCHANGE-COUNT"),
    ],
)
def test_aerotech_files_ask_or_are_refused(text: str, declared: dict[str, Any], code: str) -> None:
    with pytest.raises(FileFormatError) as wrong:
        driver("aerotech").read(text, "x.cal", as_x(**declared))
    assert wrong.value.code == code


def test_aerotech_writes_the_mean_only_if_it_is_wanted() -> None:
    with pytest.raises(TableError) as lost:
        driver("aerotech").text((OWN,), "", ())
    assert (lost.value.code, str(lost.value.fields["largest"])) == ("E-EXCHANGE-CURVES", "0.5")
    text = driver("aerotech").text((OWN,), "mean", ())
    (back,) = driver("aerotech").read(text, "x.cal", as_x(start=-10))
    assert back.deviations == pytest.approx((0.25, 1.75, -2.0))
    with pytest.raises(TableError) as uneven:
        driver("aerotech").text((replace(OWN, places=(-10.0, 0.0, 20.0), reverse=()),), "", ())
    assert uneven.value.code == "E-EXCHANGE-STEP"


@pytest.mark.parametrize(("name", "form"), [("heidenhain", "error"), ("heidenhain", "correction"), ("axeserr", "")])
def test_what_is_written_reads_back(name: str, form: str) -> None:
    (back,) = driver(name).read(driver(name).text((OWN,), form, ("a remark",)), "x", as_x(form))
    assert back.places == OWN.places
    assert back.deviations == pytest.approx(OWN.deviations)
    assert back.reverse == pytest.approx(OWN.reverse)
    with pytest.raises(TableError) as named:
        driver(name).text((replace(OWN, output_axis="AX1", input_axis="AX1"),), form, ())
    assert named.value.code == "E-EXCHANGE-LETTER"


@settings(max_examples=40, deadline=None)
@given(st.sampled_from([LISTING, COM, OLDER, AXESERR, CAL]), st.data())
def test_files_that_are_broken_anywhere_are_read_or_refused(text: str, data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(text) - 1))
    piece = data.draw(st.sampled_from(["", "9" * 400, "\0", "-", "%", "[", "\n", "NaN", "\u00b5", ":START ", "="]))
    broken = text[:at] + piece + text[at + data.draw(st.integers(0, 6)) :]
    known = as_x("error", start=0, axis_number=1, input="X", **FACTS)
    for name in ("fanuc", "heidenhain", "axeserr", "aerotech"):
        try:
            tables = driver(name).read(broken, "x", known)
        except TrueflankError as error:
            told = str(error)
        else:
            told = "-> " * all(np.isfinite(one.deviations).all() for one in tables)
        assert "-> " in told


def test_each_control_is_recognised_by_its_text_and_no_reading_is() -> None:
    recognise = registry.load("other-controls", "recogniser")
    texts = {"fanuc": LISTING, "heidenhain": COM, "axeserr": AXESERR, "aerotech": CAL, "isg-volumetric": BLOCKS}
    assert {name: recognise(text).format for name, text in texts.items()} == {name: name for name in texts}
    assert recognise("BEGIN CONFIG.CMA\nNR X Y\n").format == "heidenhain-cma"
    assert recognise("[EXY]\r\nGridpoints = {\r\n0 0\r\n}\r\n").format == "etalon-exchange"
    assert recognise("%_N_AX1_EEC_INI\n$AA_ENC_COMP[0,0,AX1]=0\n") is None
    assert recognise("target;deviation\n0;1\n100;2\n") is None


# TF5280: the maker's own examples with several arguments.
BLOCKS = (
    "// location errors\nC0B X0B\n0.00002 0.01\n#\n// component errors of X at two heights\n"
    "Z X EXX EYX EZX EAX EBX ECX\n0.0 0.0 0.02 0.01 0.07 0.00 0.0042 0.003\n"
    "0.0 10.0 0.00 -0.1 0.01 0.00 0.0011 0.002\n100.0 0.0 0.01 0.02 0.03 0.07 0.0040 0.003\n"
    "100.0 10.0 0.03 -0.09 0.03 0.06 0.0015 0.000\n"
)
VOLUME = "X Y Z EXX EYY\n0 0 0 0.000 0.000\n0 5 0 0.001 0.001\n0 10 0 0.002 0.002\n0 15 0 0.003 0.003\n"


def isg(text: str) -> ErrorSet:
    return registry.load("isg-volumetric", "error-exchange")().read(text, "x.csv")


def test_isg_errors_over_several_axes_are_kept_and_written_again() -> None:
    found = isg(BLOCKS)
    assert found.locations["X0B"] == pytest.approx(10.0)
    assert [one.name for one in found.fields] == ["EXX", "EYX", "EZX", "EAX", "EBX", "ECX"]
    first = found.fields[0]
    assert first.arguments == ("Z", "X")
    assert first.points.tolist() == [[0, 0], [0, 10], [100, 0], [100, 10]]
    assert first.values.tolist() == [20, 0, 10, 30]
    again = isg(registry.load("isg-volumetric", "error-exchange")().text(found, ()))
    for one, other in zip(found.fields, again.fields, strict=True):
        assert (one.name, one.arguments) == (other.name, other.arguments)
        np.testing.assert_array_equal(one.points, other.points)
        np.testing.assert_allclose(one.values, other.values, atol=1e-5)
    for name in ("etalon-exchange", "error-csv"):
        with pytest.raises(TableError) as held:
            registry.load(name, "error-exchange")().text(found, ())
        assert (held.value.code, held.value.fields["name"]) == ("E-EXCHANGE-FIELD", "EXX")


def test_isg_arguments_that_do_not_matter_leave_an_error_motion() -> None:
    found = isg(VOLUME)  # X and Z stay where they are: EYY over Y is a motion, EXX over Y is none
    assert [(one.name, one.values.tolist()) for one in found.curves] == [("EYY", [0, 1, 2, 3])]
    assert [(one.name, one.arguments) for one in found.fields] == [("EXX", ("Y",))]
    grid = "X Z EXX\n0 0 0.001\n0 5 0.001\n10 0 0.003\n10 5 0.003\n"
    (curve,) = isg(grid).curves
    assert (curve.positions.tolist(), curve.values.tolist()) == ([0, 10], [1, 3])
    with pytest.raises(FileFormatError) as twice:
        isg(grid.replace("10 5", "10 0"))
    assert (twice.value.code, twice.value.fields["row"]) == ("E-EXCHANGE-RISING", 4)


def test_a_pair_by_direction_is_one_axis_with_two_curves() -> None:
    join = registry.load("paired-tables", "table-pairing")
    plus = CompensationTable("cross", "X", "X", 0.0, 200.0, 100.0, (0.0, 2.0, 3.0), direction=1)
    minus = replace(plus, direction=-1, index=1, deviations=(-5.0, -3.0, -2.0))
    (table,) = join((plus, minus))
    assert (table.kind, table.places, table.direction) == ("axis", (0.0, 100.0, 200.0), 0)
    assert (table.deviations, table.reverse) == (plus.deviations, minus.deviations)
    other = replace(plus, output_axis="Z", direction=0)
    assert join((other,)) == (other,)
    for tables, code in (
        ((plus,), "E-EXCHANGE-DIRECTION"),
        ((plus, replace(minus, maximum=100.0, deviations=(0.0, 1.0))), "E-EXCHANGE-PAIR"),
        ((plus, replace(minus, direction=1)), "E-EXCHANGE-TWICE"),
    ):
        with pytest.raises(TableError) as wrong:
            join(tables)
        assert wrong.value.code == code
