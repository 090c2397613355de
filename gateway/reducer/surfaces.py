"""Flank deviations of the discs as tables over every space and slice that contact can look up; pure, mm and rad.

A deviation e(theta) is given at some profile angles of each space. Its part A n_x + B n_y + G h, which is all that a
machine's errors make of a spur flank at first order, is fitted and continued exactly, to the tips too. What is left
runs through a cubic spline over the arc length of both flanks and the bottom; beyond the outermost points its value is
held. Over the face width e is linear between the given heights and held beyond the outermost ones. All of this is
linear in e: `Surfacing` keeps the matrices, so that the first order uses the same interpolation as the full model.

The table is the control polygon of a uniform quadratic B-spline over the profile angle: contact needs a slope without
jumps, or Newton finds kinks where the flank has none. Its nodes are set back by an eighth of their second difference,
which makes the spline run through e up to fourth order.

A pin of radius r that touches where e has the slope e' along the arc s finds its foot shifted by R e', with the
relative radius R = 1 / (kappa + 1/r), kappa + convex. The gap is less there by R e'^2 / 2 than at the nominal foot:
that term is part of the table (exact to third order in e), and the slope of the table turns the normal by itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from drivers.message import Message
from drivers.types.values import FloatArray
from drivers.units import um_to_mm
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear
from gateway.tooth import FlankMap

CELLS = 320  # of a table over one space
EDGE = 2  # nodes beyond each tip
NODES = CELLS + 1 + 2 * EDGE
SLICES = 11
FEWEST = 4  # profile angles of a cubic


@dataclass(frozen=True)
class Surfacing:
    """From deviations on (K, T, Z) to tables (K, M, S): ``profile`` (M, T), ``slope`` per mm, ``width`` (S, Z).

    ``softness`` (M,) is R / 2 of the second-order term.
    """

    gear: CycloidGear
    profile: FloatArray
    slope: FloatArray
    width: FloatArray
    softness: FloatArray

    def table(self, deviation_um: FloatArray) -> FloatArray:
        """Deviations (K, T, Z) in um as effective surplus (K, M, S) in mm."""
        e = um_to_mm(np.asarray(deviation_um, dtype=np.float64)) @ self.width.T
        return np.asarray(self.profile @ e + _nodes(self.softness[:, None] * (self.slope @ e) ** 2, axis=1))


def surfacing(gear: CycloidGear, pin_mm: float, flank: FlankMap, *, slices: int) -> Surfacing:
    """The interpolation for deviations at a map's profile angles (T,) and heights (Z,), for ``slices`` equal slices.

    Raises ModelError E-REDUCER-FLANK where the places are no ascending profile of both flanks within the face.
    """
    theta, z = (np.atleast_1d(np.asarray(v, dtype=np.float64)) for v in (flank.theta_rad, flank.z_mm))
    _check_places(gear, theta, z)
    plain = replace(gear, drot=0.0)
    grid = _grid(gear)
    arc, whole = gear.arc(theta), gear.arc(grid)
    at = np.clip(whole, arc[0], arc[-1])
    spline = scipy.interpolate.make_interp_spline(arc, np.eye(theta.size), k=3)
    fit = np.linalg.pinv(_forms(plain, theta))
    rest = np.eye(theta.size) - _forms(plain, theta) @ fit
    step = 1e-6
    speed = plain.section(grid).speed[:, None]
    bend = (_forms(plain, grid + step) - _forms(plain, grid - step)) / (2.0 * step * speed)
    inside = (whole > arc[0]) & (whole < arc[-1])
    slope = bend @ fit + np.where(inside[:, None], spline.derivative()(at), 0.0) @ rest
    middles = ((np.arange(slices) + 0.5) / slices - 0.5) * gear.b
    width = np.stack([np.interp(middles, z, unit) for unit in np.eye(z.size)], axis=1)
    softness = np.maximum(0.5 / (plain.section(grid).curvature + 1.0 / pin_mm), 0.0)
    profile = _nodes(_forms(plain, grid) @ fit + spline(at) @ rest, axis=0)
    return Surfacing(gear=gear, profile=profile, slope=slope, width=width, softness=softness)


def _grid(gear: CycloidGear) -> FloatArray:
    """Profile angles of the nodes, `EDGE` cells beyond the tips."""
    beyond = gear.half_pitch * (1.0 + 2.0 * EDGE / CELLS)
    return np.linspace(-beyond, beyond, NODES)


def _nodes(values: FloatArray, axis: int) -> FloatArray:
    """Control values whose quadratic B-spline runs through values at the nodes, to fourth order."""
    v = np.moveaxis(values, axis, 0)
    bent = np.zeros_like(v)
    bent[1:-1] = (v[2:] - 2.0 * v[1:-1] + v[:-2]) / 8.0
    return np.moveaxis(v - bent, 0, axis)


def _forms(gear: CycloidGear, theta: FloatArray) -> FloatArray:
    """n_x, n_y, h (T, 3) of the profile."""
    section = gear.section(theta)
    return np.stack([section.nx, section.ny, section.h], axis=1)


def rotation_table(gear: CycloidGear) -> FloatArray:
    """The rotation modification as surplus (M,) of the unrotated profile, mm: each flank turned by sign drot."""
    grid = _grid(gear)
    return np.asarray(np.sign(grid) * gear.drot * replace(gear, drot=0.0).section(grid).h)


def check_map(gear: CycloidGear, flank: FlankMap) -> None:
    """Raises ModelError E-REDUCER-FLANK where a map is not of this gear, whole, finite and of a plausible size."""
    e = np.asarray(flank.deviation_um)
    wanted = (gear.zc, np.size(flank.theta_rad), np.size(flank.z_mm))
    if e.shape != wanted:
        raise ModelError("E-REDUCER-FLANK", "disc", why=f"deviations {e.shape}, wanted {wanted}")
    if not np.all(np.isfinite(e)):
        raise ModelError("E-REDUCER-FLANK", "disc", why=Message.of("W-REDUCER-MISSING"))


def _check_places(gear: CycloidGear, theta: FloatArray, z: FloatArray) -> None:
    why: str | Message = ""
    if theta.ndim != 1 or z.ndim != 1 or not (np.all(np.isfinite(theta)) and np.all(np.isfinite(z))):
        why = Message.of("W-REDUCER-ROWS")
    elif theta.size < FEWEST or np.any(np.diff(theta) <= 0.0) or not theta[0] < 0.0 < theta[-1]:
        why = Message.of("W-REDUCER-ASCEND", fewest=FEWEST)
    elif np.max(np.abs(theta)) > gear.half_pitch * (1.0 + 1e-9):
        why = Message.of("W-REDUCER-TIP")
    elif np.any(np.diff(z) <= 0.0) or np.max(np.abs(z)) > 0.5 * gear.b + 1e-9:
        why = Message.of("W-REDUCER-HEIGHTS")
    if why:
        raise ModelError("E-REDUCER-FLANK", "disc", why=why)
