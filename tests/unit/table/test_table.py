"""Tables: signs, grid, merging with what is live, closing, limits, comparison."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.errors import Gap, TableError, TooManyPoints, ValueOutOfRange
from drivers.limits import Limits
from drivers.message import Message, render
from gateway.domain.figures import Component
from gateway.domain.proposals import TableChange
from gateway.model.fit import fit_positioning, fit_through
from gateway.store.records import read_typed, write_typed
from gateway.table import Grid, MeasuredMeans, check, effective, project, propose
from gateway.table.limits import check_points
from gateway.table.proposal import InstrumentU
from tests.unit.table.world import C_GRID, axis, live, table

X = Grid(0.0, 400.0, 20.0)
AT = np.linspace(0.0, 400.0, 21)


def fitted(means: np.ndarray, at: np.ndarray = AT) -> Component:
    return fit_through(at, means, 0.02, name="EXX", axis="X1", axis_unit="mm")


def offer(means: np.ndarray, acts: np.ndarray | None = None, **changes: object) -> TableChange:
    at = np.asarray(changes.pop("at", AT))
    grid, reference = changes.pop("grid", X), changes.pop("reference", 0.0)
    enabled = bool(changes.pop("enabled", True))
    known = live(table(acts, X, rotary=False), enabled=enabled)
    usual = {"resolution": 1e-3, "reserved_points": 100}
    return propose(
        axis(rotary=False, reference=reference),
        fitted(means, at),
        MeasuredMeans(at, means, np.full(at.size, 0.02)),
        known,
        grid,
        **(usual | changes),
    )


def test_table_value_is_plus_the_deviation() -> None:
    means = 5.0 * AT / AT[-1]
    values = offer(means).new.deviations
    assert values[0] == 0.0
    assert values[-1] == pytest.approx(5.0)


def test_rotary_golden_plus_five_arcsec() -> None:
    at = np.arange(0.0, 360.0, 15.0)
    means = 5.0 * (1 - np.cos(np.radians(at))) / 2
    component = fit_positioning(at, means, 0.02, name="ECC", axis="C1", axis_unit="deg", kind="rotary", modulo=True)
    change = propose(
        axis(rotary=True), component, MeasuredMeans(at, means, np.full(24, 0.02)),
        live(table(None, C_GRID, rotary=True), enabled=False), C_GRID, resolution=1e-3, reserved_points=73,
    )  # fmt: skip
    values = change.new.deviations
    assert values[36] == pytest.approx(5.0, abs=0.02)
    assert values[0] == values[-1] == 0.0
    assert change.new.modulo


def test_live_table_is_added_when_it_acted_and_ignored_when_not() -> None:
    acts, means = 0.02 * AT, 0.01 * AT
    np.testing.assert_allclose(offer(means, acts).new.deviations, 0.03 * AT, atol=1e-3)
    np.testing.assert_allclose(offer(means, acts, enabled=False).new.deviations, 0.01 * AT, atol=1e-3)


def test_live_table_on_another_grid_is_carried_over() -> None:
    change = offer(0.01 * AT, 0.02 * AT, grid=Grid(0.0, 400.0, 12.5))
    np.testing.assert_allclose(change.new.deviations, 0.03 * change.new.positions, atol=1e-3)
    assert len(change.new.deviations) == 33


@pytest.mark.parametrize("reference", [0.0, 200.0, 237.5, 400.0])
def test_zero_at_the_reference(reference: float) -> None:
    new = offer(0.02 * AT + 3.0, reference=reference).new
    assert float(new.at(np.asarray([reference]))[0]) == pytest.approx(0.0, abs=1e-3)
    assert new.deviations[-1] - new.deviations[0] == pytest.approx(8.0)


def test_a_table_beyond_the_measured_range_is_refused_and_a_last_bit_of_it_is_said() -> None:
    at = np.linspace(100.0, 300.0, 11)
    with pytest.raises(Gap, match="E-COMP-REACH"):
        offer(0.02 * (at - 100.0), at=at, reference=100.0)
    at = np.linspace(19.0, 385.0, 11)
    change = offer(0.02 * (at - 19.0), at=at, reference=19.0)
    assert change.new.deviations[0] == pytest.approx(0.0, abs=0.02)
    assert change.new.deviations[-1] == pytest.approx(7.32, abs=0.03)
    assert any(finding.message.code == "W-COMP-FLAT" for finding in change.findings)
    assert offer(0.02 * AT).findings == ()
    (said,) = offer(0.02 * AT, reference=-30.0).findings
    assert said.message.code == "W-COMP-OUTSIDE"
    assert "-30 mm" in str(said.message)


def test_values_are_whole_multiples_of_the_resolution() -> None:
    values = np.asarray(offer(0.0173 * AT, resolution=0.1).new.deviations)
    np.testing.assert_allclose(values * 10, np.round(values * 10), atol=1e-9)


def test_broken_line_on_the_grid_comes_back_exactly() -> None:
    heights = np.random.default_rng(1).normal(size=21)
    found = project(lambda at: np.interp(at, X.points, heights), X, modulo=False)
    np.testing.assert_allclose(found, heights, atol=1e-10)
    closed = np.append(heights[:18], heights[0])
    turn = Grid(0.0, 360.0, 20.0)
    again = project(lambda at: np.interp(np.mod(at, 360.0), turn.points, closed), turn, modulo=True)
    np.testing.assert_allclose(again, closed, atol=1e-10)
    assert again[0] == again[-1]


def test_least_squares_beats_point_sampling() -> None:
    def wave(at: np.ndarray) -> np.ndarray:
        return np.cos(np.radians(6 * at))

    dense = np.arange(0.0, 360.0, 0.1)
    found = project(wave, C_GRID, modulo=True)
    ours = np.abs(wave(dense) - np.interp(dense, C_GRID.points, found)).max()
    sampled = np.abs(wave(dense) - np.interp(dense, C_GRID.points, wave(C_GRID.points))).max()
    assert ours < 0.72 * sampled


def test_the_reason_against_a_table_is_stored_as_code_and_fields_and_older_sentences_stay_readable() -> None:
    change = offer(0.2 * np.sin(AT / 60.0), 0.02 * AT, instrument=InstrumentU(0.8))
    data = write_typed(change, TableChange, "change")
    assert isinstance(data, dict)
    assert data["skipped"]["code"] == "S-COMP-WITHIN-U"
    for kept, meant in (
        (data["skipped"], change.skipped),
        ("", None),
        ("it lies within U", Message.stored("it lies within U")),
    ):
        assert read_typed({**data, "skipped": kept}, TableChange, "change", "test").skipped == meant


def test_inside_its_uncertainty_nothing_is_corrected() -> None:
    change = offer(0.2 * np.sin(AT / 60.0), 0.02 * AT, instrument=InstrumentU(0.8))
    assert str(change.skipped).startswith("S-COMP-WITHIN-U")
    assert change.skipped is not None
    assert "innerhalb ihrer Unsicherheit" in render(change.skipped, "de")
    assert change.new == change.old
    assert offer(0.2 * np.sin(AT / 60.0), instrument=InstrumentU(0.0)).skipped is None


def test_prediction_is_what_the_table_leaves() -> None:
    means = 0.02 * AT + np.where(AT == 200.0, 0.5, 0.0)
    change = offer(means, resolution=1e-3)
    np.testing.assert_allclose(change.predicted, means - change.new.at(AT), atol=1e-6)
    assert (change.predicted_U > 0.0).all()
    assert change.base_digest == "digest"


def test_too_many_points_name_the_machine_datum() -> None:
    with pytest.raises(TooManyPoints) as caught:
        offer(0.02 * AT, reserved_points=20)
    assert "21" in caught.value.what
    assert "MD38000" in caught.value.what
    assert offer(0.02 * AT, reserved_points=21).new.deviations


@pytest.mark.parametrize(
    ("means", "acts", "code"),
    [
        (0.51 * AT, None, "E-COMP-VALUE"),
        (np.where(AT > 100.0, 30.0, 0.0), None, "E-COMP-SLOPE"),
        (0.31 * AT, None, "E-COMP-CHANGE"),
    ],
)
def test_limits(means: np.ndarray, acts: np.ndarray | None, code: str) -> None:
    with pytest.raises(ValueOutOfRange) as caught:
        offer(means, acts)
    assert caught.value.code == code
    assert "mm" in caught.value.what


def test_steep_is_a_finding_only() -> None:
    change = offer(np.where(AT > 190.0, 6.0, 0.0))
    assert any(finding.message.code == "W-COMP-STEEP" for finding in change.findings)


def test_one_slope_warns_in_a_proposal_and_in_a_file() -> None:
    """The same six seconds of arc per degree, by the one place of limits."""
    steep = replace(table(None, Grid(0.0, 360.0, 5.0), rotary=True), deviations=(0.0, 30.0, *(0.0,) * 71))
    still = replace(steep, deviations=(0.0,) * 73)
    assert [one.message.code for one in check(steep, still, Limits.of("deg"), "C1")] == ["W-COMP-STEEP"]
    assert Limits.of("deg").warn_slope < Limits.of("deg").slope


def test_change_is_judged_against_what_acts() -> None:
    high = table(0.35 * AT, X, rotary=False)
    new = replace(high, deviations=tuple(v + 1.0 for v in high.deviations))
    assert check(new, high, Limits.of("mm"), "A1")
    with pytest.raises(ValueOutOfRange, match="E-COMP-CHANGE"):
        check(new, effective(live(high, enabled=False).own), Limits.of("mm"), "A1")


@pytest.mark.parametrize("grid", [Grid(0.0, 400.0, 30.0), Grid(0.0, 0.0, 1.0), Grid(0.0, 10.0, 0.0)])
def test_a_grid_that_does_not_divide_is_refused(grid: Grid) -> None:
    with pytest.raises(Gap, match="E-COMP-GRID"):
        offer(0.02 * AT, grid=grid)


def test_modulo_needs_the_whole_turn() -> None:
    at = np.linspace(0.0, 90.0, 10)
    part = fit_positioning(at, 0.1 * at, 0.02, name="ECC", axis="C1", axis_unit="deg", kind="rotary", modulo=True)
    usual = {"resolution": 1e-3, "reserved_points": 100}
    acts = live(table(None, C_GRID, rotary=True))
    measured = MeasuredMeans(at, 0.1 * at, np.full(10, 0.02))
    with pytest.raises(Gap, match="E-COMP-TURN"):
        propose(axis(rotary=True), part, measured, acts, C_GRID, **usual)
    with pytest.raises(Gap, match="E-COMP-GRID"):
        propose(axis(rotary=True), part, measured, acts, Grid(0.0, 180.0, 5.0), **usual)


def test_a_table_never_loaded_acts_as_zero() -> None:
    empty = replace(table(None, X, rotary=False), step=0.0, maximum=0.0, deviations=(0.0,))
    known = live(empty, enabled=False)
    change = propose(
        axis(rotary=False), fitted(0.02 * AT), MeasuredMeans(AT, 0.02 * AT, np.full(21, 0.02)), known, X,
        resolution=1e-3, reserved_points=21,
    )  # fmt: skip
    assert change.new.deviations[-1] == pytest.approx(8.0)


def test_each_layer_names_its_own_memory() -> None:
    with pytest.raises(TableError, match="MD38000") as eec:
        check_points(11, 10, "X(X)")
    with pytest.raises(TableError, match="MD18342") as cec:
        check_points(11, 10, "X(Z)", "cross")
    assert "MD18342" not in str(eec.value)
    assert "MD38000" not in str(cec.value)
    check_points(10, 10, "X(Z)", "cross")
