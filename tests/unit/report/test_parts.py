"""Rows, words, data and drawings of a report, one by one."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import catalogue
from gateway.errors import StoreError
from gateway.report import as_json, before_after_png, parameter_rows, render, sentences
from gateway.report.data import plain
from gateway.report.drawings.curves import mean
from gateway.report.page import columns
from tests.unit.report import synthetic


def test_rows_hold_before_after_uncertainty_and_change() -> None:
    axis = synthetic.axis_material("X1", "mm")
    assert axis.before is not None
    assert axis.after is not None
    before = replace(axis.before, E=20.0, M=None, B=0.0, U={"E": 3.0})
    after = replace(axis.after, E=5.0, B=1.0, R=math.nan, U={"E": 4.0})
    rows = {row.parameter: row for row in parameter_rows("X1", before, after)}
    assert list(rows) == ["E", "R", "B", "A", "M", "M_travel"]
    assert (rows["E"].before, rows["E"].after, rows["E"].change_pct) == (20.0, 5.0, -75.0)
    assert rows["E"].significant is True
    assert rows["M"].before is None
    assert rows["M"].change_pct is None
    assert rows["B"].change_pct is None
    assert rows["R"].after is None
    assert rows["A"].significant is None


def test_a_change_inside_both_uncertainties_is_not_significant() -> None:
    axis = synthetic.axis_material("X1", "mm")
    assert axis.before is not None
    before, after = replace(axis.before, E=10.0, U={"E": 3.0}), replace(axis.before, E=14.9, U={"E": 4.0})
    assert parameter_rows("X1", before, after)[0].significant is False
    assert parameter_rows("X1", before, replace(after, E=15.1))[0].significant is True


def test_no_evaluation_no_rows_and_one_is_enough() -> None:
    axis = synthetic.axis_material("C1", "deg")
    assert parameter_rows("C1", None, None) == ()
    only = parameter_rows("C1", None, axis.after)
    assert [row.before for row in only] == [None] * 6
    assert only[0].unit == "arcsec"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.005, "1.00"),
        (-1.25, "−1.25"),
        (-0.001, "0.00"),
        (0.0, "0.00"),
        (None, "–"),
        (math.nan, "–"),
        (math.inf, "–"),
    ],
)
def test_numbers(value: float | None, text: str) -> None:
    assert sentences.number(value) == text


@pytest.mark.parametrize(
    ("value", "text"), [(1.0, "+1.00"), (-1.0, "−1.00"), (0.001, "0.00"), (-0.004, "0.00"), (None, "–")]
)
def test_signed_numbers(value: float | None, text: str) -> None:
    assert sentences.signed(value) == text


@given(st.floats(allow_nan=True, allow_infinity=True), st.integers(0, 6))
def test_a_number_reads_back_within_half_a_digit(value: float, decimals: int) -> None:
    text = sentences.number(value, decimals)
    if not math.isfinite(value):
        assert text == sentences.ABSENT
    else:
        assert math.isclose(float(text.replace("−", "-")), value, abs_tol=0.5000001 * 10.0**-decimals)


@pytest.mark.parametrize(
    ("stamp", "text"),
    [
        ("2026-03-02T14:05:09+00:00", "2026-03-02 14:05 UTC"),
        ("2026-03-02T14:05:09Z", "2026-03-02 14:05 UTC"),
        ("2026-03-02T16:05:09+02:00", "2026-03-02 14:05 UTC"),
        ("yesterday", "yesterday"),
        ("", "–"),
    ],
)
def test_moments(stamp: str, text: str) -> None:
    assert sentences.when(stamp) == text


def test_state_of_an_axis_follows_verdict_push_and_proposal() -> None:
    axis = synthetic.axis_material("X1", "mm")
    assert axis.verdict is not None
    assert axis.push is not None
    not_improved = replace(axis.verdict, improved=False)
    assert sentences.axis_state(axis)[0] == "better"
    assert sentences.axis_state(replace(axis, verdict=not_improved))[0] == "unchanged"
    assert sentences.axis_state(replace(axis, verdict=not_improved, before=axis.after, after=axis.before))[0] == "worse"
    held = replace(axis, verdict=None, push=replace(axis.push, outcome="held"))
    assert sentences.axis_state(held) == ("worse", "✖", "held")
    loud = replace(axis, push=replace(axis.push, outcome="held-on"))
    assert sentences.axis_state(loud) == ("worse", "✖", "held, still on")
    (line,) = sentences.still_on(replace(synthetic.material(), axes=(loud, axis)))
    assert str(line).startswith("X1: held, still on")
    page = render(replace(synthetic.material(), axes=(loud, axis)))
    assert page.index(str(line).split(" (")[0]) < page.index("Better")
    assert sentences.still_on(synthetic.material()) == ()
    assert sentences.axis_state(replace(axis, verdict=None, change=None, push=None))[2] == "measured only"


def test_data_are_json_without_nan_and_keep_every_reading() -> None:
    material = synthetic.material()
    first = material.axes[0]
    assert first.capture_before is not None
    readings = first.capture_before.deviations.copy()
    readings[0, 0, 0] = np.nan
    axis = replace(first, capture_before=replace(first.capture_before, deviations=readings))
    data = json.loads(json.dumps(as_json(replace(material, axes=(axis,))), allow_nan=False))
    assert data["schema"] == "trueflank.report/1"
    assert data["outcome"] == "better"
    assert data["machine"]["serial"] == "YK7350B-0042"
    stored = data["axes"][0]
    assert stored["capture_before"]["deviations"][0][0][0] is None
    assert stored["capture_before"]["deviations"][3][2] == readings[3, 2].tolist()
    assert stored["parameters"]["M"]["before"] == first.before.M if first.before else False
    assert stored["change"]["new"]["deviations"][5] == first.change.new.deviations[5] if first.change else False
    assert (stored["unit"], stored["deviation_unit"], stored["component"]) == ("mm", "um", "EXX")


def test_plain_takes_scalars_of_any_kind() -> None:
    assert plain(np.float64(2.5)) == 2.5
    assert plain(np.bool_(True)) is True
    assert plain(Path("a") / "b") == str(Path("a/b"))
    assert plain(sentences) == repr(sentences)


def test_mean_of_both_directions_uses_the_one_that_exists() -> None:
    axis = synthetic.axis_material("X1", "mm")
    assert axis.before is not None
    up, down = np.array([1.0, 2.0, np.nan]), np.array([3.0, np.nan, np.nan])
    both = mean(replace(axis.before, mean_up=up, mean_down=down))
    assert both[:2].tolist() == [2.0, 2.0]
    assert np.isnan(both[2])


@given(st.lists(st.integers(), max_size=40), st.integers(1, 5))
def test_columns_deal_every_item_once_down_first(items: list[int], count: int) -> None:
    lines = columns(tuple(items), count)
    width = max((len(line) for line in lines), default=0)
    dealt = [line[part] for part in range(width) for line in lines]
    assert [item for item in dealt if item is not None] == items
    assert width <= count


def test_picture_is_a_png_with_one_row_per_axis(tmp_path: Path) -> None:
    material = synthetic.material()
    heights = []
    for count in (1, 3):
        path = tmp_path / f"{count}.png"
        before_after_png(replace(material, axes=material.axes[:count]), path)
        data = path.read_bytes()
        assert data.startswith(b"\x89PNG\r\n\x1a\n")
        heights.append(int.from_bytes(data[20:24], "big"))
    assert heights[1] == 3 * heights[0]


def test_a_picture_that_cannot_be_written_is_our_error(tmp_path: Path) -> None:
    with pytest.raises(StoreError) as caught:
        before_after_png(replace(synthetic.material(), axes=()), tmp_path / "gone" / "x.png")
    assert caught.value.code == "E-REPORT-WRITE"
    assert "<" not in caught.value.what
    assert caught.value.code in catalogue()
