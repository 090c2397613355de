"""Check stops: where they stand, how often they are visited, and that another seed takes other places."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.capture.targets import OFF_TARGET, between_places, measuring_plan, with_checks
from tests.unit.capture.test_live import AXIS


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("targets", [np.linspace(0.0, 345.0, 24), np.r_[np.arange(0.0, 300.0, 50.0), 300.0:320.0:1.0]])
def test_places_lie_in_all_parts_and_off_the_targets(targets: np.ndarray, seed: int) -> None:
    places = between_places(targets, 6, seed)
    assert 4 <= len(places) <= 6
    assert np.all(np.diff(places) > 0.0)
    left = np.searchsorted(targets, places) - 1
    share = (places - targets[left]) / (targets[left + 1] - targets[left])
    assert np.all(share > OFF_TARGET - 0.01)
    assert np.all(share < 1.01 - OFF_TARGET)
    assert places[0] < targets[0] + 0.4 * np.ptp(targets)
    assert places[-1] > targets[0] + 0.6 * np.ptp(targets)
    assert set(places).isdisjoint(between_places(targets, 6, seed + 100))


def test_few_targets_have_few_stops() -> None:
    assert [len(between_places(np.arange(float(m)), 6, 1)) for m in (3, 4, 9, 40)] == [0, 1, 2, 6]
    assert len(between_places(np.arange(40.0), 0, 1)) == 0


def test_the_plan_visits_them_twice_from_each_side_among_the_targets() -> None:
    places, checks = with_checks(np.array([0.0, 10.0, 20.0]), np.array([4.0, 13.0]))
    assert places.tolist() == [0.0, 4.0, 10.0, 13.0, 20.0]
    assert checks == (1, 3)
    axis = AXIS.model_copy(update={"measure": AXIS.measure.model_copy(update={"repetitions": 5})})
    stops = measuring_plan(axis, places, "", name="TFMEASX", checks=checks).stops
    counts = [sum(stop.label == label for stop in stops) for label in range(5)]
    assert counts == [10, 4, 10, 4, 10]
    assert [stop.target for stop in stops[:5]] == places.tolist()
