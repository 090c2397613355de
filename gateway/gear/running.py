"""What runs while one part is ground (a wheel that wears, heat), told from what repeats with a turn of the table; pure.

A pitch error of C, an eccentric part or a lean of the table closes after a turn: the last space lies beside the first
and differs from it little. What runs on from space to space in the order of grinding does not close: between the last
space and the first there is a step. No table can take it, for the next part's first space is at the same place of C.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.types.values import FloatArray
from drivers.units import rad_to_arcsec, um_to_mm
from gateway.gear.cycloid import CycloidGear
from gateway.tooth import FlankMap

# Waves a turn that a machine's own errors may have here, one for four spaces; with fewer than two nobody can tell.
ORDERS = 6
FEWEST = 2
PER_ORDER = 4


@dataclass(frozen=True, slots=True)
class Running:
    """How far something ran from the first space to the last, with its standard uncertainty from ``freedom`` degrees.

    ``value`` and ``u`` in um (depth: + material is left more and more) or arcsec (index: + turns counter-clockwise);
    ``freedom`` is 0 where nobody can tell. ``flank_um`` is what it makes of the flank as RMS over the profile.
    """

    value: float
    u: float
    freedom: int
    flank_um: float


def depth_running(flank: FlankMap, gear: CycloidGear) -> Running:
    """How far the depth of the wheel ran over the spaces 0, 1, ... of a flank: it wears, or the infeed drifts; um."""
    return _running(flank.deviation_um, gear.section(flank.theta_rad).nx, 1.0)


def index_running(flank: FlankMap, gear: CycloidGear) -> Running:
    """How far the index ran over the spaces 0, 1, ... of a flank: C drifts, or the wheel wears on one side; arcsec.

    + where later spaces lie further counter-clockwise.
    """
    return _running(flank.deviation_um, gear.section(flank.theta_rad).h, rad_to_arcsec(um_to_mm(1.0)))


def _running(deviation_um: FloatArray, shape: FloatArray, unit: float) -> Running:
    by_space = deviation_um.mean(axis=2) @ shape / float(shape @ shape)
    value, u, freedom = _ramp(by_space)
    return Running(value * unit, u * unit, freedom, abs(value) * float(np.sqrt(np.mean(shape**2))))


def _ramp(by_space: FloatArray) -> tuple[float, float, int]:
    """First to last of the straight part of values (K,) beside waves that close after a turn; its u and freedom."""
    count = by_space.size
    place = np.arange(count) / count
    orders = np.arange(1, min(ORDERS, (count - 1) // PER_ORDER) + 1)
    turns = 2.0 * np.pi * np.multiply.outer(place, orders)
    ramp = np.linspace(-0.5, 0.5, count)
    design = np.column_stack((ramp, np.ones(count), np.cos(turns), np.sin(turns)))
    found, *_ = np.linalg.lstsq(design, by_space, rcond=None)
    freedom = count - design.shape[1]
    if orders.size < FEWEST:
        return float(found[0]), 0.0, 0
    scatter = float(np.sum((by_space - design @ found) ** 2)) / freedom
    u = np.sqrt(scatter * np.linalg.inv(design.T @ design)[0, 0])
    return float(found[0]), float(u), freedom
