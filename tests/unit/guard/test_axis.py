"""The drift guard on an axis: right when the change is clear, never reassuring when it is not, and says why."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.domain.figures import Component
from gateway.guard import Approved, Check, GuardVerdict, guard_axis
from gateway.guard.verdict import SIGMAS, margin_factor
from gateway.model.components import value
from gateway.model.fit import fit_positioning
from tests.sizes import few

TARGETS = np.linspace(0.0, 315.0, 8)
LIMIT = 2.0


def true_curve(q: np.ndarray) -> np.ndarray:
    return 7.0 * np.cos(np.deg2rad(q + 30.0)) + 2.0 * np.cos(np.deg2rad(3.0 * q))


def approved(rng: np.random.Generator, sigma: float = 0.1) -> Component:
    at = np.arange(0.0, 360.0, 15.0)
    means = true_curve(at) + rng.normal(0.0, sigma, at.size)
    return fit_positioning(at, means, sigma, name="ECC", axis="C1", axis_unit="deg", kind="rotary", modulo=True)


def drawn_change(rng: np.random.Generator, size: float) -> np.ndarray:
    """A change of the curve whose largest place, without its mean, is `size`."""
    kind = rng.integers(4)
    q = np.deg2rad(TARGETS)
    shape = [
        np.cos(q + rng.uniform(0, 6.3)),
        np.cos(2.0 * q + rng.uniform(0, 6.3)),
        (np.arange(8) == rng.integers(8)).astype(float),
        rng.normal(size=8),
    ][kind]
    shape = shape - shape.mean()
    return shape / np.abs(shape).max() * size


def answer(rng: np.random.Generator, curve: Component, change: np.ndarray, sigma: float, n: int | None) -> GuardVerdict:
    """One check with noise: sigma known, or estimated from n readings each way at every place."""
    if n is None:
        u, freedom = np.full(8, sigma), np.inf
        means = true_curve(TARGETS) + change + rng.normal(0.0, sigma, 8)
    else:
        readings = true_curve(TARGETS)[:, None] + change[:, None] + rng.normal(0.0, sigma * np.sqrt(2 * n), (8, 2 * n))
        means, freedom = readings.mean(axis=1), 8.0 * (2 * n - 1)
        pooled = np.sqrt(np.mean(readings.var(axis=1, ddof=1)))
        u = np.full(8, pooled / np.sqrt(2 * n))
    return guard_axis(Approved(curve), Check(TARGETS, means + rng.normal(0.0, 5.0), u, float(freedom)), LIMIT)


@pytest.mark.parametrize("readings", few([3, None]), ids=["sigma of 3 repetitions", "sigma known"])
def test_two_thousand_checks_with_noise_are_never_wrong_where_it_can_be_told(readings: int | None) -> None:
    """Separation above 4 U (8 sigma): the right word every time; inside it: no reassurance beyond the limit."""
    rng = np.random.default_rng(61)
    wrong, undecided, far, reassured = 0, 0, 0, 0
    curves = [approved(rng) for _ in range(20)]
    for trial in range(2000):
        sigma = rng.uniform(0.02, 0.2)
        size = rng.uniform(0.0, 2.0 * LIMIT)
        curve = curves[trial % 20]
        found = answer(rng, curve, drawn_change(rng, size), sigma, readings)
        U = found.margin / 2.0
        if abs(size - LIMIT) > 4.0 * U:
            far += 1
            wanted = "re-measure this axis" if size > LIMIT else "still valid"
            wrong += found.answer not in (wanted, "cannot tell")
            undecided += found.answer == "cannot tell"
        reassured += found.answer == "still valid" and size > LIMIT
    assert far > 500
    assert (wrong, undecided, reassured) == (0, 0, 0)


def test_at_the_very_limit_it_does_not_decide() -> None:
    rng = np.random.default_rng(7)
    curve = approved(rng)
    words = {answer(rng, curve, drawn_change(rng, LIMIT), 0.15, None).answer for _ in range(300)}
    assert words == {"cannot tell"}


def test_it_tells_how_the_curve_changed() -> None:
    rng = np.random.default_rng(5)
    curve = approved(rng, 0.02)
    change = 1.5 * np.cos(np.deg2rad(2.0 * TARGETS) + 0.4)
    found = answer(rng, curve, change, 0.02, None)
    sizes = {one.kind: one.size for one in found.changes if one.sure and one.kind != "offset"}
    assert list(sizes) == ["harmonic 2"]
    assert sizes["harmonic 2"] == pytest.approx(1.5, abs=0.05)
    assert any("harmonic 2 changed by +1.5" in line for line in map(str, found.said))


def test_a_linear_axis_that_grew_says_slope() -> None:
    at = np.linspace(-400.0, 0.0, 21)
    curve = fit_positioning(at, 0.02 * at, 0.1, name="EXX", axis="X1", axis_unit="mm", kind="linear")
    places = np.linspace(-400.0, 0.0, 6)
    found = guard_axis(Approved(curve), Check(places, 0.04 * places, np.full(6, 0.1)), LIMIT)
    assert found.answer == "re-measure this axis"
    assert (found.largest, found.unit) == (pytest.approx(4.0, abs=0.01), "um") or found.largest == pytest.approx(-4.0)
    slope = next(one for one in found.changes if one.kind.startswith("slope"))
    assert slope.size == pytest.approx(8.0, abs=0.01)
    beyond = guard_axis(Approved(curve), Check(places - 300.0, 0.02 * places, np.full(6, 0.1)), LIMIT)
    assert beyond.answer == "cannot tell"


def test_too_little_is_no_answer() -> None:
    curve = approved(np.random.default_rng(1))
    u = np.array([0.1, 0.1, *[np.nan] * 6])
    found = guard_axis(Approved(curve), Check(TARGETS, true_curve(TARGETS), u), LIMIT)
    assert found.answer == "cannot tell"
    assert "uncertainty: 2;" in str(found.said[0])
    loose = guard_axis(Approved(curve), Check(TARGETS, value(curve, TARGETS), np.full(8, 0.1), mounting=1.0), LIMIT)
    assert loose.answer == "cannot tell"


def test_few_readings_ask_for_more_than_four_sigma() -> None:
    assert margin_factor(np.inf) == SIGMAS
    assert margin_factor(1e6) == pytest.approx(4.0, abs=1e-3)
    assert margin_factor(8.0) > 6.0
