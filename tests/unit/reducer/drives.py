"""Drives and discs of the tests: the 40E-like gear on rigid cranks, and flanks made of shifts and turns of a space."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import numpy as np
import pytest

from drivers.types.values import FloatArray
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import flank_grid
from gateway.reducer import figures
from gateway.reducer.records import Cranks, DiscPlace, Pins, Reducer
from gateway.tooth import FlankMap

ARCSEC = 180.0 * 3600.0 / np.pi
PHASES = (0.0, 180.0, 0.0)
COARSE = 12


def coarse(patch: pytest.MonkeyPatch) -> None:
    """Twelve crank angles a turn where drives of few pins take 96: for tests whose both sides take the same angles.

    With 12 pins and 11 lobes the orders of five waves round a disc still stay apart.
    """
    patch.setattr(figures, "STEPS", COARSE)
    patch.setattr(figures, "FEW_PINS_STEPS", COARSE)


def forty(discs: int = 1, marks: Sequence[int] = (0, 1, 0), radius_um: Sequence[float] = (), **shape: float) -> Reducer:
    """rp 64, rrp 3, a 1.3, 40/39 on rigid cranks: the drive of the closed forms."""
    gear = CycloidGear(rp=64.0, rrp=3.0, a=1.3, zp=40, zc=39, b=10.0, **shape)
    return Reducer(
        name="forty",
        gear=gear,
        pins=Pins(40, 64.0, 3.0, tuple(radius_um)),
        discs=tuple(DiscPlace(PHASES[d], marks[d]) for d in range(discs)),
        output=Cranks(number=2, circle_mm=36.0, stiffness_n_mm=inf, clearance_um=0.0),
        rated_nm=412.0,
        datum="crank-holes",
        interference_um=100.0,
    )


def crank(steps: int, turns: int = 39) -> FloatArray:
    """Crank angles of whole turns."""
    return np.arange(steps * turns, dtype=np.float64) * (2.0 * np.pi / steps)


def flank(gear: CycloidGear, A: object = 0.0, B: object = 0.0, G: object = 0.0, width: int = 1) -> FlankMap:
    """A n_x + B n_y + G h, um and um per mm of lever; each a number, or an array by space (K, 1, 1) or (K, 1, Z)."""
    grid = flank_grid(gear, width=width)
    s = grid.section
    e = np.asarray(A) * s.nx + np.asarray(B) * s.ny + np.asarray(G) * s.h
    return FlankMap(grid.thetas, grid.zs, np.array(np.broadcast_to(e, grid.shape)))


def wave(gear: CycloidGear, m: int, amplitude_um: float = 1.0) -> FlankMap:
    """Depth that goes m times round the disc."""
    k = np.arange(gear.zc)[:, None, None] * 2.0 * np.pi / gear.zc
    return flank(gear, A=amplitude_um * np.cos(m * k))


def order(psi: FloatArray, number: int) -> float:
    """Amplitude of one order of angles (N,) over one output turn, arcsec."""
    return float(2.0 * np.abs(np.fft.rfft(psi))[number] / psi.size * ARCSEC)
