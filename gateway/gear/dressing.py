"""The dressed wheel: profile deviation and offsets of its axial section against the wanted profile (mm, rad)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drivers.types.values import FloatArray
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear, ProfileSection

STEP = 1e-5  # rad of theta, for the slope of the profile deviation


@dataclass(frozen=True, slots=True)
class Dressing:
    """How the dressed profile differs from the one wanted.

    ``offset`` (mm) is the shift of the whole profile along the wheel's axis Y, ``radius`` (mm) the excess of the
    wheel's radius; ``profile`` gives, for theta (any shape), the deviation (mm) along the gear's outward normal:
    positive leaves material on the tooth.
    """

    offset: float = 0.0
    radius: float = 0.0
    profile: Callable[[FloatArray], FloatArray] | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.offset) and np.isfinite(self.radius)):
            raise ModelError("E-GEAR-DRESSING", "wheel", offset=self.offset, radius=self.radius)

    @property
    def perfect(self) -> bool:
        """True when the wheel has exactly the wanted profile."""
        return self.offset == 0.0 and self.radius == 0.0 and self.profile is None

    def deviation(self, theta: FloatArray) -> FloatArray:
        """Profile deviation (mm) at theta, same shape."""
        if self.profile is None:
            return np.zeros_like(theta)
        return np.asarray(self.profile(theta), dtype=np.float64) + np.zeros_like(theta)

    def first_order(self, section: ProfileSection, theta: FloatArray) -> FloatArray:
        """Normal deviation (mm, + surplus) it leaves on the flank to first order."""
        return self.deviation(theta) + self.offset * section.ny - self.radius * section.nx

    def section(self, gear: CycloidGear, theta: FloatArray) -> ProfileSection:
        """The profile the wheel really has, in the frame of the space, exact; `Section.speed` is per theta."""
        plain = gear.section(theta)
        if self.perfect:
            return plain
        if self.profile is None:
            return _shifted(plain, self)
        return _shifted(self._bent(plain, theta), self)

    def _bent(self, s: ProfileSection, theta: FloatArray) -> ProfileSection:
        """P + p n: the tangent is (1 + kappa p) speed t + p' n."""
        p = self.deviation(theta)
        slope = (self.deviation(theta + STEP) - self.deviation(theta - STEP)) / (2.0 * STEP)
        along = s.speed * (1.0 + s.curvature * p)
        speed = np.hypot(along, slope)
        c, q = along / speed, slope / speed
        nx, ny = c * s.nx + q * s.ny, c * s.ny - q * s.nx
        return ProfileSection(
            x=s.x + p * s.nx,
            y=s.y + p * s.ny,
            nx=nx,
            ny=ny,
            curvature=s.curvature / (1.0 + s.curvature * p),
            speed=speed,
        )


def _shifted(s: ProfileSection, dressing: Dressing) -> ProfileSection:
    return ProfileSection(
        x=s.x - dressing.radius, y=s.y + dressing.offset, nx=s.nx, ny=s.ny, curvature=s.curvature, speed=s.speed
    )
