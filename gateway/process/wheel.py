"""The wheel's axial profile corrected from measured flanks: points for the dresser, their limits, proof of the sense.

Theory. The axial section of the wheel is the space's profile: axial y = y_g(t), radius R = E - x_g(t). The outward
normal of the wheel is that of the gear turned round: (radial, axial) = (n_x, -n_y). A flank with surplus w asks for a
wheel that is larger by w along its normal at the same t, because a form wheel cuts each flank point in its own plane
to first order: correction c = w, sign + for a larger wheel. A shift of the whole wheel is no part of w
(`gateway.process.separation`), so pitch, runout and lead do not change, and x zero and dressing offset keep what is
theirs.

A round diamond of radius r touches the profile in one point and runs on the curve at distance r: P + c m + r m', m' the
normal of the corrected profile. That curve exists while every hollow of the corrected profile is wider than the diamond
(r kappa < 1 with the profile's curvature kappa, + where the wheel is hollow; a correction changes it by c'' along the
arc), and the diamond touches nowhere else: no other point of the profile lies within r of its centre.

Proof of the sense. A smooth bump s of known height on the left flank alone is dressed first. The next part must show
w_after - w_before = -g s - g' s', s' being the bump on the other flank, both without shift and turn. g = 1: the table
means what we mean. g = -1: its sign is reversed. g' = 1: its axial direction is. Neither: the dresser did not take it.

Source of the geometry: docs of the form-grinding contact, `gateway.gear.grinding`; offset curves: any text of CAD.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.interpolate import CubicSpline

from drivers.message import digits, fixed
from drivers.types.values import FloatArray
from drivers.units import mm_to_um, um_to_mm
from gateway.domain.grinding_process import Separation, WheelForm
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear
from gateway.gear.grinding import wheel_section

LIMIT_UM = 20.0
STEP_UM = 2.0
STEP_SHARE = (0.1, 0.9)  # of a flank's measured arc: where the bump is
FINE = 241  # points on each flank for the checks
TOUCH_MM = 2e-5  # a diamond that is nearer than its radius by so much touches
SURE = 4.0  # standard uncertainties of a gain
WIDTH = 0.4  # a gain is 1 or -1 within so much
COLUMNS = ("radius", "axial", "correction", "normal_radial", "normal_axial", "centre_radius", "centre_axial")
Verdict = Literal["proved", "reversed", "exchanged", "reversed and exchanged", "not seen", "not decidable"]


@dataclass(frozen=True, slots=True)
class WheelCorrection:
    """Points of the wheel's axial section, N, and what to change there.

    ``radius_mm``, ``axial_mm`` of the profile wanted; ``normal`` (N, 2) radial and axial part of the wheel's outward
    normal; ``correction_um`` along it, + = a larger wheel, with ``u_um``; ``centre_mm`` (N, 2) radius and axial place
    of the diamond's centre on the corrected profile. ``theta_rad`` are the profile angles, ascending.
    """

    theta_rad: FloatArray
    radius_mm: FloatArray
    axial_mm: FloatArray
    normal: FloatArray
    correction_um: FloatArray
    u_um: FloatArray
    centre_mm: FloatArray

    @property
    def rms_um(self) -> float:
        """RMS of the correction over its points."""
        return float(np.sqrt(np.mean(self.correction_um**2)))


@dataclass(frozen=True, slots=True)
class DresserTable:
    """How the builder's dresser takes a profile: its columns in order, their units, and what + means.

    ``columns`` are of `COLUMNS`. Lengths in ``length_unit``, the correction in ``correction_unit``. ``sign`` is +1
    where a positive correction makes the wheel larger, -1 where smaller; ``axial_sense`` +1 where axial places count
    like the gear's y in space 0. ``along`` says along what a correction is measured.
    """

    columns: tuple[str, ...]
    length_unit: Literal["mm", "um"]
    correction_unit: Literal["mm", "um"]
    sign: int
    axial_sense: int = 1
    along: Literal["normal", "radial"] = "normal"

    def rows(self, found: WheelCorrection) -> list[tuple[float, ...]]:
        """One row for each point, in the dresser's order, units and signs."""
        length = 1.0 if self.length_unit == "mm" else 1000.0
        size = um_to_mm(1.0) if self.correction_unit == "mm" else 1.0
        along = found.normal[:, 0] if self.along == "radial" else 1.0
        values = {
            "radius": length * found.radius_mm,
            "axial": length * self.axial_sense * found.axial_mm,
            "correction": size * self.sign * found.correction_um / along,
            "normal_radial": found.normal[:, 0],
            "normal_axial": self.axial_sense * found.normal[:, 1],
            "centre_radius": length * found.centre_mm[:, 0],
            "centre_axial": length * self.axial_sense * found.centre_mm[:, 1],
        }
        rows = np.stack([values[name] for name in self.columns], axis=1)
        order = np.argsort(self.axial_sense * found.axial_mm, kind="stable")
        return [tuple(row) for row in rows[order].tolist()]


@dataclass(frozen=True, slots=True)
class SenseProof:
    """What a known step on the dresser did: its gain on its own flank and on the other one, each with u; verdict."""

    gain: float
    other: float
    u: float
    verdict: Verdict


def wheel_correction(
    gear: CycloidGear, centre_mm: float, found: Separation, *, diamond_mm: float, limit_um: float = LIMIT_UM
) -> WheelCorrection:
    """The correction that takes the wheel's form (and an equal error of the diamond) off the next part.

    ``centre_mm`` is the distance of gear and wheel axis, ``diamond_mm`` the radius of the dresser's diamond. Only over
    the measured part of the profile. Raises ModelError: E-WHEEL-NOTHING (no form beyond its uncertainty),
    E-WHEEL-DIAMOND (radius), and what `corrected_points` raises.
    """
    form = found.form
    worst = float(np.max(np.abs(form.deviation_um) - 2.0 * form.u_um))
    if worst <= 0.0:
        u = f"{float(np.max(form.u_um)):.3f}"
        raise ModelError("E-WHEEL-NOTHING", "wheel", rms=fixed(_rms(form.deviation_um), 3), u=u)
    return corrected_points(gear, centre_mm, form, diamond_mm=diamond_mm, limit_um=limit_um)


def step_form(gear: CycloidGear, form: WheelForm, step_um: float = STEP_UM) -> WheelForm:
    """A bump of this height (um, + = larger wheel) on the left flank alone, at the profile angles of a form."""
    return replace(
        form, deviation_um=_bump(gear, form, 1.0) * step_um, covariance_um2=np.zeros_like(form.covariance_um2)
    )


def _bump(gear: CycloidGear, form: WheelForm, side: float) -> FloatArray:
    """A raised cosine of height 1 over the middle of one flank's measured arc."""
    theta = np.asarray(form.theta_rad)
    here = np.sign(theta) == side
    along = np.abs(gear.arc(theta))
    low, high = float(along[here].min()), float(along[here].max())
    first, last = (low + share * (high - low) for share in STEP_SHARE)
    place = np.clip((along - first) / (last - first), 0.0, 1.0)
    return np.where(here, 0.5 - 0.5 * np.cos(2.0 * np.pi * place), 0.0)


def corrected_points(
    gear: CycloidGear, centre_mm: float, form: WheelForm, *, diamond_mm: float, limit_um: float = LIMIT_UM
) -> WheelCorrection:
    """The points of a correction along the wheel's normal, checked against limit and diamond.

    Raises ModelError: E-WHEEL-DIAMOND, E-WHEEL-LIMIT, E-WHEEL-UNDERCUT (a hollow narrower than the diamond),
    E-WHEEL-OVERLAP (the diamond touches the profile at a second place), E-GEAR-DISTANCE.
    """
    if not (np.isfinite(diamond_mm) and 0.0 < diamond_mm < centre_mm):
        raise ModelError("E-WHEEL-DIAMOND", "dresser", radius=diamond_mm)
    c = np.asarray(form.deviation_um, dtype=np.float64)
    if not np.all(np.isfinite(c)) or float(np.max(np.abs(c))) > limit_um:
        at = int(np.argmax(np.abs(c)))
        raise ModelError(
            "E-WHEEL-LIMIT",
            "wheel",
            value=fixed(c[at], 2, signed=True),
            at=fixed(np.rad2deg(form.theta_rad[at]), 3, signed=True),
            limit=digits(limit_um, 6),
        )
    _check_diamond(gear, centre_mm, form, diamond_mm)
    section = wheel_section(gear, centre_mm, form.theta_rad)
    points, normal = _corrected_curve(gear, centre_mm, form, np.asarray(form.theta_rad))
    return WheelCorrection(
        theta_rad=np.asarray(form.theta_rad),
        radius_mm=section.R,
        axial_mm=section.y,
        normal=np.stack([section.nx, -section.ny], axis=1),
        correction_um=c,
        u_um=form.u_um,
        centre_mm=points + diamond_mm * normal,
    )


def _spline(gear: CycloidGear, form: WheelForm) -> CubicSpline:
    """The correction (mm) over the signed arc, both flanks; it bridges the bottom, where no line is measured."""
    return CubicSpline(gear.arc(form.theta_rad), um_to_mm(np.asarray(form.deviation_um)))


def _corrected_curve(
    gear: CycloidGear, centre_mm: float, form: WheelForm, theta: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Points (N, 2) of the corrected section, radius and axial, and its outward normals; ends held beyond the form."""
    section = wheel_section(gear, centre_mm, theta)
    normal = np.stack([section.nx, -section.ny], axis=1)
    along = np.stack([section.ny, section.nx], axis=1)  # the wheel's section in the direction of growing t
    arc, spline = gear.arc(theta), _spline(gear, form)
    inside = np.clip(arc, spline.x[0], spline.x[-1])
    c = spline(inside)
    slope = np.where(inside == arc, spline(inside, 1), 0.0)
    stretched = 1.0 - gear.section(theta).curvature * c
    turn = np.arctan2(slope, stretched)[:, None]
    return (
        np.stack([section.R, section.y], axis=1) + c[:, None] * normal,
        np.cos(turn) * normal - np.sin(turn) * along,
    )


def _check_diamond(gear: CycloidGear, centre_mm: float, form: WheelForm, diamond_mm: float) -> None:
    half = gear.limits().half_lobe_arc
    arc = np.linspace(-half, half, 2 * FINE)[1:-1]
    theta = gear.theta_at(arc)
    hollow = _hollowness(gear, form, theta)
    worst = int(np.argmax(hollow))
    if diamond_mm * hollow[worst] >= 1.0:
        raise ModelError(
            "E-WHEEL-UNDERCUT",
            "wheel",
            radius=digits(diamond_mm, 6),
            hollow=fixed(1.0 / hollow[worst], 3),
            at=fixed(np.rad2deg(theta[worst]), 3, signed=True),
        )
    points, normal = _corrected_curve(gear, centre_mm, form, theta)
    centre = points + diamond_mm * normal
    apart = np.hypot(*(centre[:, None, i] - points[None, :, i] for i in (0, 1)))
    nearest = np.min(apart, axis=1)
    bad = int(np.argmin(nearest))
    if nearest[bad] < diamond_mm - TOUCH_MM:
        other = float(np.rad2deg(theta[int(np.argmin(apart[bad]))]))
        raise ModelError(
            "E-WHEEL-OVERLAP",
            "wheel",
            at=fixed(np.rad2deg(theta[bad]), 3, signed=True),
            other=fixed(other, 3, signed=True),
            deep=fixed(mm_to_um(diamond_mm - float(nearest[bad])), 2),
        )


def _hollowness(gear: CycloidGear, form: WheelForm, theta: FloatArray) -> FloatArray:
    """Curvature of the corrected wheel, + where it is hollow, 1/mm: the gear is convex there; c adds c''."""
    arc, spline = gear.arc(theta), _spline(gear, form)
    here = (arc >= spline.x[0]) & (arc <= spline.x[-1])
    kappa = gear.section(theta).curvature
    return np.asarray(np.where(here, kappa / (1.0 - kappa * spline(arc)) + spline(arc, 2), kappa))


def prove_sense(gear: CycloidGear, before: WheelForm, after: WheelForm, step_um: float = STEP_UM) -> SenseProof:
    """What the step of `step_form` did to the next part: forms before and after that dressing.

    Raises ModelError E-WHEEL-RANGE where the forms cover different parts of the profile.
    """
    theta = np.asarray(before.theta_rad)
    other = np.asarray(after.theta_rad)
    if theta.shape != other.shape or float(np.max(np.abs(theta - other))) > 0.05 * gear.half_pitch:
        raise ModelError("E-WHEEL-RANGE", "wheel")
    section = gear.section(theta)
    moves = np.stack([section.nx, section.ny, section.h], axis=1)
    bumps = np.stack([_bump(gear, before, 1.0), _bump(gear, before, -1.0)], axis=1) * step_um
    bumps = bumps - moves @ np.linalg.lstsq(moves, bumps, rcond=None)[0]
    change = np.asarray(after.deviation_um) - np.asarray(before.deviation_um)
    change = change - moves @ np.linalg.lstsq(moves, change, rcond=None)[0]
    inverse = np.linalg.pinv(bumps)
    gain, mirrored = (-inverse @ change).tolist()
    covariance = inverse @ (before.covariance_um2 + after.covariance_um2) @ inverse.T
    left = change + bumps @ np.array([gain, mirrored])
    misfit = _rms(left) * np.sqrt(np.max(np.diag(inverse @ inverse.T)))  # what changed beside the step
    u = float(np.hypot(np.sqrt(np.max(np.diag(covariance))), misfit))
    return SenseProof(gain, mirrored, u, _verdict(gain, mirrored, u))


def _verdict(gain: float, other: float, u: float) -> Verdict:
    if SURE * u >= 1.0 - WIDTH:
        return "not decidable"
    cases: Sequence[tuple[float, float, Verdict]] = (
        (1.0, 0.0, "proved"),
        (-1.0, 0.0, "reversed"),
        (0.0, 1.0, "exchanged"),
        (0.0, -1.0, "reversed and exchanged"),
        (0.0, 0.0, "not seen"),
    )
    for wanted, mirrored, verdict in cases:
        if abs(gain - wanted) <= WIDTH and abs(other - mirrored) <= WIDTH:
            return verdict
    return "not decidable"


def predicted_form(
    form: WheelForm, correction: WheelCorrection, *, gain: float = 1.0, gain_u: float = 0.0
) -> WheelForm:
    """What the next part will show of the wheel after the correction, with u: that of the form and of the gain."""
    left = np.asarray(form.deviation_um) - gain * correction.correction_um
    extra = np.outer(correction.correction_um, correction.correction_um) * gain_u**2
    return replace(form, deviation_um=left, covariance_um2=form.covariance_um2 + extra)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.asarray(values) ** 2)))
