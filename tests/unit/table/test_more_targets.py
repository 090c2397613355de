"""Structure finer than the targets: more targets within the hours, else by its chances; judged by the truth between."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gateway.capture.targets import targets_of
from gateway.workflow.axes.measure import live_again
from tests.sizes import few
from tests.unit.table.finer import Curve, Judged, machine, sag, wave

SCREWS: list[tuple[Callable[[int], Curve], dict[str, Any], float]] = [
    (lambda seed: sag(40.0 + 47.0 * seed % 320.0, 30.0, 8.0), {}, 0.35),
    (lambda _seed: wave(8.0, 4.0), {"even": True}, 2.9),
    (lambda _seed: wave(10.0, 0.8), {"even": True, "step": 2.0}, 0.6),
    (lambda _seed: wave(8.0, 4.0), {}, 2.9),
    (lambda _seed: wave(10.0, 4.0), {"even": True}, 2.9),
    (lambda _seed: lambda q: wave(8.0, 3.0)(q) + wave(10.0, 2.0)(q), {"even": True}, 2.9),
]
WORMS = [(36, 1.0, 0.15), (72, 1.0, 2.9), (90, 5.0, 2.9), (36, 5.0, 1.0), (72, 5.0, 2.9), (90, 1.0, 0.5)]


def good(one: Judged, left: float) -> None:
    """Better, down to what grid and limits can hold, and where it was said to be."""
    assert not one.change.skipped
    assert np.std(one.after) <= left
    assert np.ptp(one.after) < np.ptp(one.before)
    assert one.off <= 1.0
    assert all(int(said["minutes"]) <= int(said["left"]) + 1 for said in one.said)


@pytest.mark.parametrize(("extra", "keys", "left"), few(SCREWS, 2))
@pytest.mark.parametrize("seed", few(range(8), 1, 2))
def test_screw_and_guide_get_as_good_as_their_grid_can_hold(
    extra: Callable[[int], Curve], keys: dict[str, Any], left: float, seed: int
) -> None:
    good(machine(seed, extra(seed), **keys).judged(), left)


@pytest.mark.parametrize(("order", "step", "left"), few(WORMS, 2))
@pytest.mark.parametrize("seed", few(range(8), 1, 2))
def test_worm_orders_are_told_apart_and_held_where_the_grid_can(
    order: int, step: float, left: float, seed: int
) -> None:
    good(machine(seed, wave(360.0 / order, 4.0), rotary=True, even=True, step=step).judged(), left)


@pytest.mark.parametrize("hours", few([0.0, 0.12]))
@pytest.mark.parametrize("seed", few(range(12), 1, 3))
@pytest.mark.parametrize("size", few([0.3, 0.05], 1))
def test_without_the_hours_a_table_is_labelled_or_refused_and_never_worse(hours: float, seed: int, size: float) -> None:
    shapes = (wave(8.0, 4.0), wave(10.0, 4.0), sag(40.0 + 53.0 * seed % 320.0, 30.0, 8.0))
    worse, labels = 0, set()
    for shape in shapes:
        one = machine(seed, shape, even=bool(seed % 2), hours=hours, size=size).judged()
        worse += one.worse
        labels |= {str(one.change.skipped or "")[:13], *(str(finding.message)[:13] for finding in one.change.findings)}
        assert sum(int(said["minutes"]) for said in one.said if said["count"]) <= 60.0 * hours + 1.0
        assert one.change.skipped or one.gain > 0.0
    assert worse == 0
    assert hours or labels & {"S-COMP-HIDDEN", "W-COMP-HIDDEN", "W-COMP-CHANCE", "W-COMP-PLACE "}


@pytest.mark.parametrize("seed", few(range(8), 2))
def test_a_table_that_can_hold_less_than_half_of_an_axis_is_labelled_and_written_where_it_gains(seed: int) -> None:
    """A screw's short wave stays whatever the table does; the slow part of the axis goes, and M with it."""
    one = machine(seed, wave(8.0, 1.2), size=0.12).judged()
    assert not one.change.skipped
    assert one.change.chance is not None
    assert one.change.chance.worth
    assert any(finding.message.code == "W-COMP-LEAVES" for finding in one.change.findings)
    assert np.std(one.after) > 0.5 * np.std(one.before)
    assert np.ptp(one.after) < 0.6 * np.ptp(one.before)
    assert one.gain == pytest.approx(one.change.chance.gain, abs=2.0 * one.change.chance.u)


@pytest.mark.parametrize("seed", few(range(8), 2))
def test_an_axis_that_scatters_gets_its_table_where_the_gain_is_likely(seed: int) -> None:
    """Twice the scatter of a reading is more than a third of the largest correction; the mean of ten is not."""
    one = machine(seed, wave(400.0, 0.0), size=0.12, scatter=0.7).judged()
    assert not one.worse
    assert one.gain > 0.5 * np.std(one.before)
    assert any(finding.message.code == "W-COMP-SCATTERS" for finding in one.change.findings)
    assert one.change.chance is not None
    assert one.change.chance.worth


@pytest.mark.parametrize("seed", few(range(8), 2))
@pytest.mark.parametrize("size", [0.002, 0.02, 0.04, 0.06])
def test_an_axis_that_is_hardly_more_than_scatter_never_gets_worse(seed: int, size: float) -> None:
    one = machine(seed, wave(400.0, 0.0), size=size, scatter=0.5).judged()
    assert not one.worse
    assert one.change.skipped or one.gain > 0.0
    assert size > 0.01 or one.change.skipped


def test_after_the_push_an_axis_is_measured_where_it_was_measured_before() -> None:
    axis = machine(3, wave(200.0, 1.0)).axis
    own = targets_of(axis)
    assert live_again(axis, own) is axis
    more = np.sort(np.append(own, [33.3, 44.4]))
    again = live_again(axis, more)
    assert again is not None
    assert np.array_equal(targets_of(again), more)


def test_a_good_axis_gets_no_more_targets() -> None:
    assert [machine(seed, wave(200.0, 1.0), rotary=bool(seed % 2)).judged().said for seed in range(4)] == [[]] * 4


def test_an_axis_of_few_targets_gets_more_where_time_allows_it() -> None:
    one = machine(2, wave(90.0, 8.0), hours=5.0)
    measure = one.axis.measure
    targets = measure.targets.model_copy(update={"count": 5}) if measure.targets is not None else None
    five = one.axis.model_copy(update={"measure": measure.model_copy(update={"targets": targets})})
    found = replace(one, axis=five).judged()
    assert found.said[0]["code"] == "P-MORE-TARGETS"
    assert found.targets.size >= 8
