"""What is known of an input quantity, as a distribution to draw from (JCGM 101:2008, clause 6.4)."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Protocol

from numpy.random import Generator

from gateway.domain.values import FloatArray


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
