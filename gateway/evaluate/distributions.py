"""What is known of an input quantity, as a distribution to draw from (JCGM 101:2008, clause 6.4)."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Protocol

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from gateway.domain import FloatArray
from gateway.errors import ModelError


class Distribution(Protocol):
    """An input quantity: its estimate, its standard uncertainty, and draws of it."""

    @property
    def estimate(self) -> float:
        """Expectation."""
        ...

    @property
    def u(self) -> float:
        """Standard deviation."""
        ...

    def draw(self, rng: Generator, count: int) -> FloatArray:
        """Independent draws (count,)."""
        ...


@dataclass(frozen=True, slots=True)
class Normal:
    """Known by estimate and standard uncertainty (6.4.7)."""

    estimate: float
    u: float

    def draw(self, rng: Generator, count: int) -> FloatArray:
        """Draws (count,)."""
        return self.estimate + self.u * rng.standard_normal(count)


@dataclass(frozen=True, slots=True)
class Rectangular:
    """Anywhere within +/- `half` of the estimate (6.4.2)."""

    estimate: float
    half: float

    @property
    def u(self) -> float:
        """half / sqrt 3."""
        return self.half / sqrt(3.0)

    def draw(self, rng: Generator, count: int) -> FloatArray:
        """Draws (count,)."""
        return self.estimate + self.half * rng.uniform(-1.0, 1.0, count)


@dataclass(frozen=True, slots=True)
class Trapezoidal:
    """The sum of two rectangular quantities; ``top`` is the ratio of the short to the long side (6.4.4)."""

    estimate: float
    half: float
    top: float = 0.0

    @property
    def u(self) -> float:
        """half sqrt((1 + top^2) / 6); top 0 is a triangle, 1 a rectangle."""
        return self.half * sqrt((1.0 + self.top**2) / 6.0)

    def draw(self, rng: Generator, count: int) -> FloatArray:
        """Draws (count,)."""
        one, two = rng.uniform(-1.0, 1.0, (2, count))
        return np.asarray(self.estimate + self.half * ((1.0 + self.top) * one + (1.0 - self.top) * two) / 2.0)


@dataclass(frozen=True, slots=True)
class ArcSine:
    """A quantity that cycles as a sine within +/- `half`: temperature control, periodic error (6.4.6)."""

    estimate: float
    half: float

    @property
    def u(self) -> float:
        """half / sqrt 2."""
        return self.half / sqrt(2.0)

    def draw(self, rng: Generator, count: int) -> FloatArray:
        """Draws (count,)."""
        return self.estimate + self.half * np.sin(rng.uniform(0.0, 2.0 * np.pi, count))


@dataclass(frozen=True, slots=True)
class Student:
    """A mean of repeated readings: estimate + scale x t with `freedom` degrees of freedom (6.4.9)."""

    estimate: float
    scale: float
    freedom: float

    @property
    def u(self) -> float:
        """scale sqrt(nu / (nu - 2)); infinite for nu <= 2."""
        return self.scale * sqrt(self.freedom / (self.freedom - 2.0)) if self.freedom > 2.0 else float("inf")

    def draw(self, rng: Generator, count: int) -> FloatArray:
        """Draws (count,)."""
        return self.estimate + self.scale * rng.standard_t(self.freedom, count)


def of_readings(values: ArrayLike) -> Student:
    """The mean of repeated independent readings (n,), n >= 2. Raises ModelError (E-EVAL-REPEATED)."""
    x = np.asarray(values, dtype=np.float64)
    if x.ndim != 1 or x.size < 2 or not np.isfinite(x).all():
        raise ModelError("E-EVAL-REPEATED", "distribution", readings=x.size)
    return Student(float(x.mean()), float(x.std(ddof=1)) / sqrt(x.size), x.size - 1)


def correlated(rng: Generator, count: int, estimates: ArrayLike, covariance: ArrayLike) -> FloatArray:
    """Draws (count, k) of quantities with estimates (k,) and covariance (k, k) (6.4.8); singular is allowed."""
    centre, v = np.asarray(estimates, dtype=np.float64), np.asarray(covariance, dtype=np.float64)
    values, vectors = np.linalg.eigh((v + v.T) / 2.0)
    root = vectors * np.sqrt(np.clip(values, 0.0, None))
    return np.asarray(centre + rng.standard_normal((count, centre.size)) @ root.T)
