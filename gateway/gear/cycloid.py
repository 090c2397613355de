"""The cycloid disc: profile, outward normal, curvature, arc length, limits and the three modifications (mm, rad).

Pin-centre curve minus normal: P = P0 - r n, P0 = (r_p cos t - a cos z_p t, r_p sin t - a sin z_p t), with
K = a z_p / r_p, S = 1 + K^2 - 2 K cos z_c t and outward unit normal n = (cos t - K cos z_p t, sin t - K sin z_p t)
/ sqrt(S). t = 0 is the bottom of the space that faces +X, t = +-pi/z_c its tips; space k is turned by 2 pi k/z_c.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from math import isfinite, pi, sqrt

import numpy as np
import scipy
from numpy.typing import ArrayLike

from drivers.types.values import FloatArray
from gateway.errors import ModelError

FEWEST_LOBES = 3
TABLE_POINTS = 257
NEWTON_STEPS = 6


@dataclass(frozen=True, slots=True)
class ProfileSection:
    """Points of a plane profile: coordinates, outward unit normal, curvature (+ convex), arc length per theta.

    All arrays share the shape of theta. ``h`` = x n_y - y n_x is the lever of a rotation about the gear axis.
    """

    x: FloatArray
    y: FloatArray
    nx: FloatArray
    ny: FloatArray
    curvature: FloatArray
    speed: FloatArray

    @property
    def h(self) -> FloatArray:
        """Normal displacement per rad of rotation about the gear axis, mm."""
        return self.x * self.ny - self.y * self.nx

    @property
    def xy(self) -> FloatArray:
        """Coordinates (..., 2)."""
        return np.stack([self.x, self.y], axis=-1)

    @property
    def normal(self) -> FloatArray:
        """Outward unit normals (..., 2)."""
        return np.stack([self.nx, self.ny], axis=-1)

    def turned(self, angle: ArrayLike) -> ProfileSection:
        """The same points turned about the gear axis by angles (rad) that broadcast with theta."""
        c, s = np.cos(angle), np.sin(angle)
        x, y = c * self.x - s * self.y, s * self.x + c * self.y
        return ProfileSection(
            x=x,
            y=y,
            nx=c * self.nx - s * self.ny,
            ny=s * self.nx + c * self.ny,
            curvature=self.curvature,
            speed=self.speed,
        )


@dataclass(frozen=True, slots=True)
class GearLimits:
    """What a set of gear data allows: coefficient K1, radii, the largest pin radius without undercut."""

    K1: float
    r_root: float
    r_tip: float
    rrp_max: float
    undercut: bool
    half_lobe_arc: float


@dataclass(frozen=True, slots=True)
class CycloidGear:
    """A cycloid disc by its own data.

    ``rp`` pin circle radius, ``rrp`` pin radius, ``a`` eccentricity, ``zp`` pins, ``zc`` lobes, ``b`` face width;
    modifications: shift ``drp``, equidistant ``drrp`` (both mm, > 0 removes material at the root or everywhere) and
    rotation ``drot`` (rad, each flank turned by sign(theta) drot, > 0 widens the spaces).
    Raises ModelError E-GEAR-... naming the limit that is broken.
    """

    rp: float
    rrp: float
    a: float
    zp: int
    zc: int
    b: float = 10.0
    drp: float = 0.0
    drrp: float = 0.0
    drot: float = 0.0

    def __post_init__(self) -> None:
        _check_numbers(self)
        _check_lobes(self)
        _check_shape(self)

    @staticmethod
    def of(data: Mapping[str, object]) -> CycloidGear:
        """The gear of a plain mapping, e.g. from a gear file; unknown or missing keys are refused by name."""
        known = [field.name for field in fields(CycloidGear)]
        for key in data:
            if key not in known:
                raise ModelError("E-GEAR-KEY", "gear", key=key, known=", ".join(known))
        for key in known[:5]:
            if key not in data:
                raise ModelError("E-GEAR-MISSING", "gear", key=key)
        return CycloidGear(**data)  # type: ignore[arg-type]

    @property
    def pin_circle(self) -> float:
        """Pin circle radius with its modification."""
        return self.rp + self.drp

    @property
    def pin(self) -> float:
        """Pin radius with its modification."""
        return self.rrp + self.drrp

    @property
    def K(self) -> float:
        """Shortening coefficient a z_p / r_p of the modified profile."""
        return self.a * self.zp / self.pin_circle

    @property
    def half_pitch(self) -> float:
        """theta of the tip, pi / z_c."""
        return pi / self.zc

    def space_angle(self, k: ArrayLike) -> FloatArray:
        """Direction of the middle of space k: 2 pi k / z_c."""
        return np.asarray(k, dtype=np.float64) * (2.0 * pi / self.zc)

    def section(self, theta: ArrayLike) -> ProfileSection:
        """The profile in the frame of space 0, all three modifications applied."""
        t = np.asarray(theta, dtype=np.float64)
        plain = _section(t, self.pin_circle, self.pin, self.K, self.a, self.zp)
        if self.drot == 0.0:
            return plain
        pitch = 2.0 * self.half_pitch
        return plain.turned(np.sign(t - pitch * np.round(t / pitch)) * self.drot)

    def space(self, theta: ArrayLike, k: ArrayLike) -> ProfileSection:
        """The profile of spaces k in the gear's frame; theta and k broadcast together."""
        return self.section(theta).turned(self.space_angle(k))

    def arc(self, theta: ArrayLike) -> FloatArray:
        """Arc length from the bottom of the space, signed like theta (closed form, no rotation modification)."""
        return _arc(np.asarray(theta, dtype=np.float64), self.pin_circle, self.pin, self.K, self.zc)

    def theta_at(self, arc: ArrayLike) -> FloatArray:
        """Inverse of `arc` inside one space (|arc| <= half a lobe)."""
        s = np.asarray(arc, dtype=np.float64)
        table = np.linspace(-self.half_pitch, self.half_pitch, TABLE_POINTS)
        t = np.interp(s, self.arc(table), table)
        for _ in range(NEWTON_STEPS):
            t = t - (self.arc(t) - s) / self.section(t).speed
        return np.asarray(t)

    @property
    def tip_radius(self) -> float:
        """`GearLimits.r_tip` alone, mm: the arc among the limits takes a library that is slow to load."""
        return self.pin_circle + self.a - self.pin

    @property
    def root_radius(self) -> float:
        """`GearLimits.r_root` alone, mm."""
        return self.pin_circle - self.a - self.pin

    def limits(self) -> GearLimits:
        """Coefficient, radii and limits of this gear."""
        return limits(**{field.name: getattr(self, field.name) for field in fields(self)})


def limits(
    rp: float,
    rrp: float,
    a: float,
    zp: int,
    zc: int,
    b: float = 0.0,
    drp: float = 0.0,
    drrp: float = 0.0,
    drot: float = 0.0,
) -> GearLimits:
    """`GearLimits` of gear data, also of data that `CycloidGear` refuses for undercut; K1 < 1 is still needed.

    ``b`` and ``drot`` change none of the values; they are taken so that a gear's whole data can be passed.
    """
    _ = b, drot
    circle, pin = rp + drp, rrp + drrp
    if not (rp > 0.0 and circle > 0.0):
        raise ModelError("E-GEAR-POSITIVE", "gear", key="rp" if not rp > 0.0 else "rp + drp", value=min(rp, circle))
    K = a * zp / circle
    if not 0.0 < K < 1.0:
        raise ModelError("E-GEAR-K1", "gear", K1=a * zp / rp, K=K)
    largest = undercut_limit(circle, a, zp)
    half = float(_arc(np.asarray(pi / zc), circle, pin, K, zc))
    return GearLimits(
        K1=a * zp / rp,
        r_root=circle - a - pin,
        r_tip=circle + a - pin,
        rrp_max=largest,
        undercut=not pin < largest,
        half_lobe_arc=half,
    )


def undercut_limit(rp: float, a: float, zp: int) -> float:
    """Smallest radius of curvature of the concave side of the pin-centre curve: the pin must be smaller.

    The minimum lies between root and tip for K > (z_p - 2)/(2 z_p - 1), else at the tip.
    """
    K = a * zp / rp
    if (zp - 2) / (2 * zp - 1) < K:
        return rp * sqrt(27.0 * (zp - 1) * (1.0 - K * K) / (zp + 1) ** 3)
    return rp * (1.0 + K) ** 2 / (1.0 + zp * K)


def _section(t: FloatArray, rp: float, r: float, K: float, a: float, zp: int) -> ProfileSection:
    ct, st = np.cos(t), np.sin(t)
    cp, sp = np.cos(zp * t), np.sin(zp * t)
    cos_phi = ct * cp + st * sp
    S = 1.0 + K * K - 2.0 * K * cos_phi
    root = np.sqrt(S)
    nx, ny = (ct - K * cp) / root, (st - K * sp) / root
    k0 = (1.0 + zp * K * K - (1.0 + zp) * K * cos_phi) / (rp * S * root)
    free = 1.0 - r * k0
    x, y = rp * ct - a * cp - r * nx, rp * st - a * sp - r * ny
    return ProfileSection(x=x, y=y, nx=nx, ny=ny, curvature=k0 / free, speed=rp * root * free)


def _arc(t: FloatArray, rp: float, r: float, K: float, zc: int) -> FloatArray:
    """rp Int sqrt(S) dt - r (turning of the normal); the first is an elliptic integral of the second kind."""
    phi = zc * t
    length = rp * 2.0 * (1.0 - K) / zc * scipy.special.ellipeinc(0.5 * phi, -4.0 * K / (1.0 - K) ** 2)
    turning = t + np.arctan2(-K * np.sin(phi), 1.0 - K * np.cos(phi))
    return np.asarray(length - r * turning)


def _check_numbers(gear: CycloidGear) -> None:
    for field in fields(gear):
        value = getattr(gear, field.name)
        if isinstance(value, bool) or not isinstance(value, (int, float, np.number)) or not isfinite(value):
            raise ModelError("E-GEAR-NUMBER", "gear", key=field.name, value=value)
    for key in ("rp", "rrp", "a", "b", "pin_circle", "pin"):
        if getattr(gear, key) <= 0.0:
            raise ModelError("E-GEAR-POSITIVE", "gear", key=key, value=getattr(gear, key))


def _check_lobes(gear: CycloidGear) -> None:
    if gear.zc != int(gear.zc) or gear.zp != gear.zc + 1 or gear.zc < FEWEST_LOBES:
        raise ModelError("E-GEAR-LOBES", "gear", zp=gear.zp, zc=gear.zc, fewest=FEWEST_LOBES)
    if not max(gear.K, gear.a * gear.zp / gear.rp) < 1.0:
        raise ModelError("E-GEAR-K1", "gear", K1=gear.a * gear.zp / gear.rp, K=gear.K)


def _check_shape(gear: CycloidGear) -> None:
    largest = undercut_limit(gear.pin_circle, gear.a, gear.zp)
    if not gear.pin < largest:
        raise ModelError("E-GEAR-UNDERCUT", "gear", rrp=gear.pin, limit=round(largest, 3))
    if abs(gear.drot) >= 0.5 * gear.half_pitch:
        raise ModelError("E-GEAR-ROTATION", "gear", drot=gear.drot, limit=0.5 * gear.half_pitch)


# ---- The dressed wheel: profile deviation and offsets of its axial section against the wanted profile (mm, rad).

STEP = 1e-5  # rad of theta, for the slope of the profile deviation


@dataclass(frozen=True, slots=True)
class DressingError:
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
            return _shift_profile(plain, self)
        return _shift_profile(self._bent(plain, theta), self)

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


def _shift_profile(s: ProfileSection, dressing: DressingError) -> ProfileSection:
    return ProfileSection(
        x=s.x - dressing.radius, y=s.y + dressing.offset, nx=s.nx, ny=s.ny, curvature=s.curvature, speed=s.speed
    )
