"""The wanted flank: a cycloid disc as the curve that stays one pin radius inside the path of a pin (mm, rad).

In the complex plane a pin's centre runs along w(t) = R exp(it) - a exp(i zp t); the disc's flank is w minus the
pin's radius along the unit normal -i w'/|w'|, which points out of the disc. t = 0 is the bottom of the space that
faces +X, t = +-pi/zc are its tips; space k is turned by 2 pi k/zc.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulators.cellfile.part import Gear

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
LENGTH_POINTS = 20001


@dataclass(frozen=True, slots=True)
class Rays:
    """Points (m, 3) and unit directions (m, 3), e.g. a flank's nominal points and outward normals, in mm."""

    points: FloatArray
    directions: FloatArray


class Lobes:
    """The flanks of one disc as its data have them."""

    def __init__(self, gear: Gear) -> None:
        self.gear = gear
        self.circle = gear.rp + gear.drp
        self.pin = gear.rrp + gear.drrp
        self.half = np.pi / gear.zc

    @property
    def tip_mm(self) -> float:
        """Radius of the tips."""
        return self.circle + self.gear.a - self.pin

    def profile(self, t: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Points and outward normals of space 0 as complex numbers, shaped like t; both turned by ``drot``."""
        first = self.circle * np.exp(1j * t)
        second = self.gear.a * np.exp(1j * self.gear.zp * t)
        normal = first - self.gear.zp * second
        normal = normal / np.abs(normal)
        turn = np.exp(1j * np.sign(t) * self.gear.drot)
        return (first - second - self.pin * normal) * turn, normal * turn

    def length(self, t: FloatArray) -> FloatArray:
        """Length of the flank in mm from the bottom of the space, signed like t (|t| <= half a lobe)."""
        fine = np.linspace(0.0, self.half, LENGTH_POINTS)
        points = self.profile(fine)[0] * np.exp(-1j * np.sign(fine) * self.gear.drot)
        along = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(points)))))
        return np.asarray(np.sign(t) * np.interp(np.abs(t), fine, along))

    def even(self, count: int, share: float = 0.95) -> FloatArray:
        """t of `count` points of one space, both flanks, in equal steps along this share of the flank's length."""
        fine = np.linspace(-self.half, self.half, LENGTH_POINTS)
        along = self.length(fine)
        return np.asarray(np.interp(np.linspace(-share, share, count) * along[-1], along, fine))

    def rays(self, space: int, t: FloatArray, z: FloatArray) -> Rays:
        """Nominal points and outward normals of a space at t (T,) and heights z (Z,): m = T * Z, z fastest."""
        turn = np.exp(2j * self.half * space)
        point, normal = (np.repeat(part * turn, len(z)) for part in self.profile(t))
        heights = np.tile(z, len(t))
        return Rays(
            np.stack((point.real, point.imag, heights), axis=1),
            np.stack((normal.real, normal.imag, np.zeros_like(heights)), axis=1),
        )
