"""Structure between the targets: found where it is, not found where it is not, on seeded machines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gateway.domain.captures import Between
from gateway.evaluate.behaviour.fine_structure import hidden_structure, isolated_outlier, means_between
from gateway.evaluate.behaviour.repetitions import robust_means
from tests.sizes import few
from tests.unit.evaluate.hostile import Captured, Curve, captured


def wave(period: float, size: float) -> Curve:
    return lambda q: size * np.cos(2.0 * np.pi * q / period + 0.3)


def missed(one: Captured) -> float:
    """RMS by which the fit really misses the machine, where it is known."""
    low, high = (0.0, 360.0) if one.rotary else (float(one.targets.min()), float(one.targets.max()))
    places = np.linspace(low, high, 2001)
    return float(np.std(one.truth(places) - one.fit()(places)))


def test_good_machines_raise_no_alarm() -> None:
    shapes = [{}, {"repetitions": 2}, {"scatter": 1.0}, {"count": 24, "rotary": True}]
    found = [captured(seed, **shapes[seed % 4]).hidden() for seed in range(200)]
    alarms = [one for one in found if one.u > 0.0]
    assert all(one.by == "check stops" for one in found)
    assert len(alarms) <= 0.02 * len(found), [one.words for one in alarms]


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize(
    ("rotary", "count", "length", "size"),
    few([(True, 24, 15.0, 36.0), (False, 21, 21.0, 2.0), (True, 24, 7.5, 36.0), (True, 24, 360.0 / 25, 5.0),
         (False, 21, 20.0, 5.0)], 2),
)  # fmt: skip
def test_waves_near_the_targets_spacing_are_found_and_not_understated(
    rotary: bool, count: int, length: float, size: float, even: bool
) -> None:
    machines = [captured(s, rotary=rotary, count=count, extra=wave(length, size), even=even) for s in range(25)]
    found = [one.hidden() for one in machines]
    assert sum(one.u > 0.0 for one in found) >= 24
    covered = [2.0 * one.u >= missed(machine) for one, machine in zip(found, machines, strict=True)]
    assert sum(covered) >= 22


def test_one_bad_place_between_two_targets_is_not_claimed_to_be_seen() -> None:
    bad = captured(3, extra=lambda q: 6.0 * np.clip(1.0 - np.abs(q - 130.0) / 2.5, 0.0, 1.0)).hidden()
    assert bad.u == 0.0
    assert "A single local deviation between two of them may remain unseen" in str(bad.words[0])


def test_random_offsets_betray_structure_without_check_stops() -> None:
    one = replace(captured(4, extra=wave(21.0, 5.0)), between=Between(np.empty(0), np.empty((0, 2, 2))))
    found = one.hidden(fitted=False)
    assert found.by == "targets"
    assert found.u > 1.0
    assert one.hidden().by == "nothing"
    assert "Nothing was measured between the targets" in str(one.hidden().words[0])


def test_a_stop_out_of_line_once_does_no_harm() -> None:
    one = captured(5)
    worse = one.between.deviations.copy()
    worse[2, 0, 0] += 40.0
    clean = means_between(one.targets, one.deviations, one.between)[0]
    dirty = means_between(one.targets, one.deviations, Between(one.between.targets, worse))[0]
    assert np.max(np.abs(clean - dirty)) < 0.6


def test_a_single_target_out_of_line_is_called_lonely_and_no_good_one_is() -> None:
    bad = captured(9, extra=lambda q: 20.0 * np.clip(1.0 - np.abs(q - 100.0) / 2.5, 0.0, 1.0), even=True)
    means = robust_means(bad.targets, bad.deviations)
    assert isolated_outlier(bad.targets, means.mean, means.u) == 100.0
    good = [captured(seed, rotary=bool(seed % 2)) for seed in range(100)]
    means_of = [robust_means(one.targets, one.deviations) for one in good]
    alarms = [isolated_outlier(one.targets, m.mean, m.u) for one, m in zip(good, means_of, strict=True)]
    assert sum(alarm is not None for alarm in alarms) <= 2


def test_stops_that_were_never_read_tell_nothing() -> None:
    one = captured(6)
    empty = Between(one.between.targets, np.full_like(one.between.deviations, np.nan))
    assert hidden_structure(one.targets, one.deviations, "um", between=empty).by == "nothing"
