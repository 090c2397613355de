"""Smooth shapes by which an error motion may be wrong: Legendre polynomials over a travel, harmonics of a turn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.types.values import FloatArray
from gateway.model.chain import Chain


@dataclass(frozen=True, slots=True)
class Shape:
    """A smooth shape of RMS 1: a Legendre polynomial over a travel, or a harmonic of the turn."""

    order: int
    low: float
    high: float
    turning: bool

    def __call__(self, q: FloatArray) -> FloatArray:
        """Values at q, same shape."""
        if self.turning:
            wave = np.cos if self.order % 2 else np.sin
            return np.asarray(np.sqrt(2.0) * wave(((self.order + 1) // 2) * q))
        x = np.clip((2.0 * q - self.low - self.high) / (self.high - self.low), -1.0, 1.0)
        legendre = x if self.order == 1 else 0.5 * (3.0 * x**2 - 1.0)
        return np.asarray(np.sqrt(2.0 * self.order + 1.0) * legendre)


def shapes_over(chain: Chain, axis: str, travel: tuple[float, float]) -> list[Shape]:
    """First and second order over a travel (mm), or two harmonics around the turn."""
    if chain.axis(axis).kind == "revolute":
        return [Shape(order, 0.0, 0.0, turning=True) for order in (1, 2, 3, 4)]
    return [Shape(order, *travel, turning=False) for order in (1, 2)]
