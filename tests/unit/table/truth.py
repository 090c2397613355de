"""A little truth of its own for the table tests: error curves, a capture with noise, drift and outliers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Curve = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Truth:
    """Error of an axis (deviation unit), reversal, and what the instrument adds."""

    error: Curve
    instrument: Curve
    reversal: float
    noise: float
    drift_per_h: float
    outliers: int = 2
    outlier_size: float = 5.0


def rotary(seed: int, *, scale: float = 1.0, sign: int = 1) -> Truth:
    """ECC 15-25 arcsec in orders 1, 2, 3, 6 and 0.2 at order 36, calibrator 0.3 arcsec."""
    rng = np.random.default_rng(seed)
    shares = rng.dirichlet((3.0, 2.0, 1.5, 1.0)) * rng.uniform(15.0, 25.0) * scale
    waves = [*zip((1, 2, 3, 6), shares, strict=True), (36, 0.2 * min(scale, 1.0))]
    phases = rng.uniform(0.0, 2 * np.pi, len(waves))
    phase = rng.uniform(0.0, 2 * np.pi, 2)

    def error(c: np.ndarray) -> np.ndarray:
        turn = np.radians(c)
        waved = (a * np.cos(k * turn - p) for (k, a), p in zip(waves, phases, strict=True))
        return sign * np.sum(list(waved), axis=0)

    def instrument(c: np.ndarray) -> np.ndarray:
        return 0.2 * np.cos(np.radians(c) - phase[0]) + 0.1 * np.cos(2 * np.radians(c) - phase[1])

    return Truth(error, instrument, 0.6, 0.15, 0.3)


def linear(seed: int, *, scale: float = 1.0, sign: int = 1, travel: float = 400.0) -> Truth:
    """Scale error, sag, two waves, one shorter than the targets' spacing allows, a 1 um step; 10-30 um."""
    rng = np.random.default_rng(seed)
    total = rng.uniform(10.0, 30.0) * scale
    tilt, sag = total * rng.choice((-1.0, 1.0)), total * rng.uniform(-0.3, 0.3)
    wave, short = total * rng.uniform(0.02, 0.1), 0.3 * min(scale, 1.0)
    periods, phases = rng.uniform(150.0, 400.0), rng.uniform(0.0, 2 * np.pi, 2)
    at_step = rng.uniform(0.2, 0.8) * travel
    step = min(scale, 1.0)

    def error(x: np.ndarray) -> np.ndarray:
        u = x / travel
        smooth = tilt * u + sag * 4 * u * (1 - u) + wave * np.sin(2 * np.pi * x / periods + phases[0])
        fine = short * np.sin(2 * np.pi * x / 13.7 + phases[1])
        return sign * (smooth + fine + step * (x > at_step))

    gain = rng.uniform(-0.3, 0.3)
    return Truth(error, lambda x: gain * x / travel, 0.5, float(rng.uniform(0.05, 0.2)), 0.5)


def unequal_targets(first: float, last: float, count: int, seed: int, *, reference: float = 0.0) -> np.ndarray:
    """Evenly spaced targets with random offsets up to 0.3 of the interval; the reference stays exact."""
    even = np.linspace(first, last, count)
    interval = even[1] - even[0]
    offsets = np.random.default_rng(seed).uniform(-0.3, 0.3, count) * interval
    offsets[np.abs(even - reference) < interval / 2] = 0.0
    return np.sort(np.round(np.clip(even + offsets, first, last), 3))


def capture(
    truth: Truth, targets: np.ndarray, seed: int, *, residual: Curve | None = None, stop_s: float = 6.0
) -> np.ndarray:
    """Deviations (m, 5, 2) of five bidirectional repetitions; `residual` replaces the error when given."""
    rng = np.random.default_rng(seed)
    m, n = targets.size, 5
    base = (residual or truth.error)(targets) + truth.instrument(targets)
    index = np.arange(m)
    order = np.stack([index, 2 * m - 1 - index], axis=1)
    hours = (order[:, None, :] + 2 * m * np.arange(n)[None, :, None]) * stop_s / 3600.0
    side = truth.reversal * np.array([0.5, -0.5])
    x = base[:, None, None] + side + truth.drift_per_h * hours + rng.normal(0.0, truth.noise, (m, n, 2))
    for _ in range(truth.outliers):
        place = tuple(int(rng.integers(0, size)) for size in x.shape)
        x[place] += truth.outlier_size * rng.choice((-1.0, 1.0)) * rng.uniform(0.5, 2.0)
    return x - x[0, 0, 0]
