"""Where a pin seen from a disc is nearest to the pin-centre curve of a space; pure, mm and rad.

The foot t of q on P0 = r_p e^{it} - a e^{i zp t} solves (q - P0) . P0' = 0, by Newton with the second derivative: at
the bottom of a space the curve has a radius below 0.1 mm, where a frozen normal is wrong by degrees.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.types.values import FloatArray
from gateway.gear.cycloid import CycloidGear

FOOT_STEPS, FOOT_RAD = 15, 1e-12
BEYOND = 1.1  # half pitches: how far a foot may run past the tip of its space

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Foot:
    """Points of the curve, and d((q - P0) . P0') / dtau there."""

    point: Complex
    second: FloatArray


def feet(gear: CycloidGear, q: Complex, tau: FloatArray) -> tuple[FloatArray, Complex, Foot]:
    """Feet of q on the pin-centre curve of space 0: tau, P0' and P0 with d((q - P0) . P0')/dtau there."""
    most, flat, start = gear.half_pitch, q.ravel(), tau.ravel()
    tau, move, point, slope, second = _foot_step(gear, flat, start)
    for _ in range(FOOT_STEPS):
        moving = np.flatnonzero(np.abs(move) > FOOT_RAD)
        if not moving.size:
            break
        step = np.clip(move[moving], -0.2 * most, 0.2 * most)
        found = _foot_step(gear, flat[moving], np.clip(tau[moving] + step, -BEYOND * most, BEYOND * most))
        for whole, part in zip((tau, move, point, slope, second), found, strict=True):
            whole[moving] = part
    shape = q.shape
    return tau.reshape(shape), slope.reshape(shape), Foot(point.reshape(shape), second.reshape(shape))


def _foot_step(
    gear: CycloidGear, q: Complex, tau: FloatArray
) -> tuple[FloatArray, FloatArray, Complex, Complex, FloatArray]:
    """At tau: itself, the Newton step from there, P0, P0' and the derivative of (q - P0) . P0'."""
    rp, a, zp = gear.pin_circle, gear.a, gear.zp
    one, many = np.exp(1j * tau), np.exp(1j * (zp * tau))
    point = rp * one - a * many
    slope = 1j * (rp * one - (a * zp) * many)
    bend = (a * zp * zp) * many - rp * one
    off = q - point
    square = slope.real**2 + slope.imag**2
    second = np.minimum(off.real * bend.real + off.imag * bend.imag - square, -1e-3 * square)
    move = -(off.real * slope.real + off.imag * slope.imag) / second
    return tau.copy(), move, point, slope, second
