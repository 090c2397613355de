"""Two table files: the same whatever their layout, and every difference with its place, unit and size."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal

import pytest

from drivers.tablefile import TableFile
from drivers.types.tables import CompensationTable
from gateway.table.file_comparison import compare_files

X = CompensationTable("axis", "X1", "X1", 0.0, 20.0, 10.0, (0.0, 2.0, 1.0))
Z = replace(X, input_axis="Z1", output_axis="Z1")
CROSS = CompensationTable("cross", "Z1", "C1", 0.0, 20.0, 10.0, (0.0, 2.0, 1.0), index=3, output_unit="deg")


def test_the_same_content_in_another_order_is_the_same() -> None:
    settings = {"$MA_BACKLASH[0,X1]": Decimal("0.002"), "$SN_CEC_TABLE_ENABLE[3]": Decimal(1)}
    other = dict(reversed(settings.items()))
    difference = compare_files(TableFile((X, CROSS), settings), TableFile((CROSS, X), other, {}, ("a note",)))
    assert difference.same
    assert difference.largest is None


def test_points_are_compared_one_by_one() -> None:
    changed = replace(X, deviations=(0.0, 2.5, -1.0))
    difference = compare_files(TableFile((X, Z)), TableFile((changed, Z)))
    (pair,) = difference.tables
    assert list(pair.points.positions) == [10.0, 20.0]
    assert list(pair.points.change) == [0.5, -2.0]
    assert (pair.unit, pair.input_unit, pair.count, pair.parameters) == ("um", "mm", 3, ())
    assert difference.largest == ("EEC X1 encoder 0 X1(X1)", 20.0, -2.0, "um")


def test_another_grid_is_compared_where_either_has_a_point() -> None:
    finer = replace(X, step=5.0, deviations=(0.0, 1.0, 2.0, 1.5, 1.0))
    (pair,) = compare_files(TableFile((X,)), TableFile((finer,))).tables
    assert pair.parameters == (("step", 10.0, 5.0),)
    assert pair.points.positions.size == 0
    bent = replace(finer, deviations=(0.0, 1.5, 2.0, 1.5, 1.0))
    (pair,) = compare_files(TableFile((X,)), TableFile((bent,))).tables
    assert list(pair.points.positions) == [5.0]
    assert list(pair.points.change) == [0.5]


def test_parameters_of_cross_tables_and_values_in_arcsec() -> None:
    turned = replace(CROSS, direction=1, multiply_by=2, deviations=(0.0, 2.0, 5.0))
    (pair,) = compare_files(TableFile((CROSS,)), TableFile((turned,))).tables
    assert pair.parameters == (("direction", 0, 1), ("multiply_by", 0, 2))
    assert pair.unit == "arcsec"
    assert list(pair.points.change) == [4.0]


def test_tables_of_other_axes_are_not_compared_point_by_point() -> None:
    (pair,) = compare_files(
        TableFile((CROSS,)), TableFile((replace(CROSS, output_axis="X1", output_unit="mm"),))
    ).tables
    assert pair.parameters == (("output_axis", "C1", "X1"), ("output_unit", "deg", "mm"))
    assert pair.points.positions.size == 0


def test_what_stands_in_one_file_only() -> None:
    difference = compare_files(TableFile((X, CROSS)), TableFile((X, Z, replace(X, index=1))))
    assert difference.only_first == ("CEC table 3",)
    assert difference.only_second == ("EEC Z1 encoder 0", "EEC X1 encoder 1")
    assert not difference.same


def test_settings_change_in_the_unit_of_their_axis() -> None:
    name, turn, switch = "$MA_BACKLASH[0,X1]", "$MA_BACKLASH[0,C1]", "$MA_CEC_ENABLE[X1]"
    lengths = {name: "mm", turn: "deg"}
    first = TableFile((), {name: Decimal("0.002"), turn: Decimal("0.001"), switch: Decimal(0)}, lengths)
    second = TableFile((), {name: Decimal("0.0035"), turn: Decimal("0.002")}, lengths)
    found = {one.name: one for one in compare_files(first, second).settings}
    assert found[name].change == pytest.approx(1.5)
    assert (found[name].unit, found[turn].unit) == ("um", "arcsec")
    assert found[turn].change == pytest.approx(3.6)
    assert (found[switch].first, found[switch].second, found[switch].change) == (0, None, None)
