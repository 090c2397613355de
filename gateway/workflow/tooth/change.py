"""How much a flank changed from part to part, with and without what a clamping makes, each with its own U; pure.

What an inspection may be off is nearly all its clamping: an eccentricity of any direction, another at each clamping.
It reaches the RMS by its share of the flank's own shape, so it hides a change only where the flank itself is eccentric.
What no eccentricity can make is known to the scatter of the points: of N points fitted by p values an RMS is uncertain
by u / sqrt(N), and too large by u^2 p / (2 N RMS) (GUM 5.1, H.3).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from gateway.domain.values import COVERAGE
from gateway.gear.cycloid import CycloidGear
from gateway.tooth import FlankMap, FloatArray, InspectedFlank

LEAST_UM = 0.05  # a smaller change of the RMS is nobody's business, whatever the uncertainty
PLACE = 3  # values fitted at each place: A, B, G
Outcome = Literal["better", "unchanged", "worse"]


@dataclass(frozen=True, slots=True)
class FlankSize:
    """One flank's RMS and what of it no eccentricity can make, with standard uncertainties; um."""

    rms: float
    u: float
    clear: float
    clear_u: float

    @classmethod
    def of(cls, flank: FlankMap, inspected: InspectedFlank, gear: CycloidGear) -> FlankSize:
        """Of a flank made from an inspected part, set right or as it is."""
        _, clear = eccentric_share(flank, gear)
        return cls(flank.rms_um, _by_clamping(flank, inspected, gear), clear, _by_scatter(clear, inspected))


@dataclass(frozen=True, slots=True)
class FlankChange:
    """From one flank to the next, um: RMS, and RMS without what an eccentric clamping can make; U with k = 2."""

    whole: float
    whole_U: float
    clear: float
    clear_U: float

    @classmethod
    def of(cls, before: FlankSize, after: FlankSize) -> FlankChange:
        """Both figures' change; none is known better than nobody cares for."""
        return cls(
            after.rms - before.rms,
            max(LEAST_UM, COVERAGE * float(np.hypot(before.u, after.u))),
            after.clear - before.clear,
            max(LEAST_UM, COVERAGE * float(np.hypot(before.clear_u, after.clear_u))),
        )

    @property
    def outcome(self) -> Outcome:
        """The whole flank decides; where a clamping may have made its change, what no clamping can make does."""
        if abs(self.whole) > self.whole_U:
            return "worse" if self.whole > 0.0 else "better"
        if abs(self.clear) > self.clear_U:
            return "worse" if self.clear > 0.0 else "better"
        return "unchanged"


def clamped(flank: FlankMap, gear: CycloidGear) -> FloatArray:
    """What one um of eccentricity along x and along y of the gear does to its flanks, (2, K, T, 1)."""
    section, phi = gear.section(flank.theta_rad), gear.space_angle(np.arange(gear.zc))[:, None, None]
    nx, ny = section.nx[None, :, None], section.ny[None, :, None]
    return np.stack([nx * np.cos(phi) - ny * np.sin(phi), nx * np.sin(phi) + ny * np.cos(phi)])


def eccentric_share(flank: FlankMap, gear: CycloidGear) -> tuple[float, float]:
    """RMS of what an eccentricity of part or clamping takes of a flank by least squares, and of what it leaves, um."""
    ways = np.stack(
        [np.broadcast_to(one, flank.deviation_um.shape).ravel() for one in clamped(flank, gear)],
        axis=1,
    )
    seen = flank.deviation_um.ravel()
    taken = ways @ np.linalg.lstsq(ways, seen, rcond=None)[0]
    return float(np.sqrt(np.mean(taken**2))), float(np.sqrt(np.mean((seen - taken) ** 2)))


def _by_clamping(flank: FlankMap, inspected: InspectedFlank, gear: CycloidGear) -> float:
    """Standard uncertainty of a flank's RMS: how far an eccentric clamping lies along that very flank, um."""
    ways = clamped(flank, gear)
    size = inspected.rms_u_um / float(np.sqrt(np.mean(np.sum(ways**2, axis=0))))
    shape = flank.deviation_um / max(flank.rms_um, np.finfo(float).tiny)
    return size * float(np.hypot(*(np.mean(one * shape) for one in ways)))


def _by_scatter(clear: float, inspected: InspectedFlank) -> float:
    """Of the RMS without an eccentricity; a record without points is no better than its whole uncertainty."""
    points = inspected.k.size
    if not points:
        return inspected.rms_u_um
    fitted = inspected.u_um**2 * PLACE * inspected.place_k.size / points
    return float(np.hypot(inspected.u_um / points**0.5, min(fitted / (2.0 * max(clear, 1e-9)), fitted**0.5)))
