"""Jumps below what no axis does, in sets of one or two repetitions: said where they are, and seldom where none is."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.evaluate.behaviour.doubts import doubts_of
from gateway.evaluate.behaviour.repetitions import find_slips, slip_limit

LAYOUTS = ((1, 1), (1, 2), (2, 1), (2, 2))


def honest(
    rng: np.random.Generator, kind: str, count: int, repetitions: int, ways: int
) -> tuple[np.ndarray, np.ndarray]:
    """Targets, equal or as a standard spreads them, and deviations with drift, reversal and scatter."""
    at = 50.0 * np.arange(count) + rng.uniform(-15.0, 15.0, count) * (rng.random() < 0.5)
    along = (at - at[0]) / np.ptp(at)
    curves = {
        "slope": rng.normal() * 30.0 * along + rng.normal() * 10.0 * along**2,
        "waves": sum(3.0 * np.sin(rng.uniform(1.0, 2.0 * count) * along + rng.uniform(0.0, 6.0)) for _ in range(3)),
        "walk": np.cumsum(rng.normal(0.0, 1.5, count)),
        "rounded": 5.0 * along,
    }
    x = np.asarray(curves[kind])[:, None, None] + rng.normal(0.0, rng.uniform(0.05, 1.0), (count, repetitions, 2))
    x = x + np.array([0.0, 1.0]) * (rng.normal() * 3.0 + rng.normal() * 2.0 * along[:, None, None])
    x = x + rng.normal(0.0, 1.0, (1, repetitions, 2)) * along[:, None, None]
    x = np.round(x, int(rng.integers(0, 2))) if kind == "rounded" else x
    if ways == 1:
        x[:, :, 1] = np.nan
    return at, x


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("count", [6, 9, 16, 40])
def test_the_limit_is_what_normal_scatter_reaches_in_two_of_a_thousand_sets(order: int, count: int) -> None:
    rng = np.random.default_rng(count)
    y = rng.normal(size=(5000, count))
    r = np.diff(y, n=order, axis=1)
    shapes = [np.arange(count) > at for at in range(1, count - 2)] + list(np.eye(count))
    templates = np.array([np.diff(np.asarray(shape, float), n=order) for shape in shapes])
    found = np.abs(r @ (templates / np.linalg.norm(templates, axis=1)[:, None]).T).max(axis=1)
    largest = found / np.sqrt((np.sum(r**2, axis=1) - found**2) / (r.shape[1] - 1))
    share = float(np.mean(largest > slip_limit(count - order, order)))
    assert 0.0001 < share < 0.004


@pytest.mark.parametrize("kind", ["slope", "waves", "walk", "rounded"])
def test_honest_sets_raise_no_false_alarm(kind: str) -> None:
    rng = np.random.default_rng(11)
    sets = 60
    for repetitions, ways in LAYOUTS:
        alarms = sum(
            bool(find_slips(*honest(rng, kind, int(rng.integers(5, 30)), repetitions, ways))) for _ in range(sets)
        )
        assert alarms <= 1, f"{alarms} of {sets}: below 1 of 100 in the long run"


@pytest.mark.parametrize(("repetitions", "ways"), LAYOUTS)
@pytest.mark.parametrize("off", [12.0, -8.0])
def test_a_jump_below_what_no_axis_does_is_said_with_its_place(repetitions: int, ways: int, off: float) -> None:
    at = 50.0 * np.arange(15)
    rng = np.random.default_rng(4)
    x = 5.0 * np.sin(at / 250.0)[:, None, None] + rng.normal(0.0, 0.2, (15, repetitions, 2)) + np.array([0.0, 2.0])
    if ways == 1:
        x[:, :, 1] = np.nan
    assert not [one for one in doubts_of(at, x, "mm") if one.code in ("S-EVAL-SLIP", "S-EVAL-BUMP")]
    bumped = x.copy()
    x[6:, 0, 0] += off
    bumped[6, 0, 0] += off
    (slip,) = [one for one in doubts_of(at, x, "mm") if one.code == "S-EVAL-SLIP"]
    assert (slip.names["low"], slip.names["high"], slip.blocking) == ("250", "300", False)
    assert abs(slip.numbers["off"]) == pytest.approx(abs(off), abs=1.5)
    assert "jump" in slip.text
    (bump,) = [one for one in doubts_of(at, bumped, "mm") if one.code == "S-EVAL-BUMP"]
    assert bump.names["low"] == "300"
    assert abs(bump.numbers["off"]) == pytest.approx(abs(off), abs=1.5)


def test_three_repetitions_vote_and_few_or_rounded_readings_say_nothing() -> None:
    at = 50.0 * np.arange(15)
    x = np.random.default_rng(4).normal(0.0, 0.2, (15, 3, 2))
    x[6:, 0, 0] += 9.0
    assert not find_slips(at, x)
    assert [one for one in doubts_of(at, x, "mm") if one.code.startswith("S-EVAL-OUT")], "its repetitions show it"
    assert not find_slips(at[:5], x[:5, :1])
    whole = np.round(at / 400.0)[:, None, None] * np.ones((15, 1, 2)) + np.array([0.0, 1.0])
    assert not find_slips(at, whole)
    kept = whole.copy()
    kept[3, 0, 0] = np.nan
    assert not find_slips(at, kept)


def test_positions_under_the_heading_of_deviations_stop_the_verdict() -> None:
    """0.4 mm of "deviation" over 400 mm was 1 um/mm, and a figure."""
    at = np.arange(0.0, 401.0, 50.0)
    x = np.random.default_rng(2).normal(0.0, 0.003, (9, 2, 2)) + at[:, None, None]
    for axis_unit in ("mm", "deg"):
        assert [one.code for one in doubts_of(at, x, axis_unit) if one.blocking][:1] == ["S-EVAL-POSITIONS"]
    scaled = 0.9 * x
    assert not [one for one in doubts_of(at, scaled, "mm") if one.code == "S-EVAL-POSITIONS"]
