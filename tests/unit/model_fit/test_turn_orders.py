"""A turn's orders at few targets: those that the smooth part may not have are looked for as waves, without a gap."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.model.components import value
from gateway.model.waves import fit_means

AMPLITUDES = {1: 7.0, 2: 4.0, 3: 2.0}


def turn(places: np.ndarray, orders: dict[int, float]) -> np.ndarray:
    waves = [size * np.cos(np.radians(order * places + 15.0)) for order, size in orders.items()]
    return np.asarray(np.sum(waves, axis=0))


@pytest.mark.parametrize("order", [5, 6, 11, 12])
@pytest.mark.parametrize("count", [34, 46])
def test_a_worm_beside_an_order_that_few_targets_may_not_fit_is_found(order: int, count: int) -> None:
    """36 periods a turn, and an order above an eighth of the targets: neither is explained without the other."""
    rng = np.random.default_rng([count, order])
    even = np.arange(count) * 360.0 / count
    targets = np.append(even + rng.uniform(0.0, 0.6 * 360.0 / count, count), 360.0)
    targets[0] = 0.0
    true = {**AMPLITUDES, order: 1.2, 36: 3.0}
    means = turn(targets, true) + rng.normal(0.0, 0.05, targets.size)
    curve = fit_means(
        targets, means, np.full(targets.size, 0.05), name="ECC", axis="C1", axis_unit="deg", kind="rotary", modulo=True
    )  # fmt: skip
    dense = np.linspace(0.0, 360.0, 3601)
    left = value(curve, dense) - turn(dense, true)
    assert np.ptp(left) < 0.5
