"""What files of gear measuring machines give in other frames, as points of the nominal cycloid flank (mm, rad).

A contour scan shows a plane section of a part that was clamped somewhere: its axis lies d = (dx, dy) from the origin
and it is turned by an angle nobody stated. Both are found by least squares of the normal deviations e_i of all points,

    e_i = dx n_x + dy n_y + h rotation + c + rest,     n the outward normal, h = x n_y - y n_x,

(c, the same surplus everywhere, is fitted so that it moves no centre, and stays in the deviations), repeated from the
best of several turns over one pitch until nothing moves. Deviations after that hold no eccentricity and no rotation: a
scan cannot tell them from its clamping. A few lobes determine d less well than a whole turn, so the fit
states how sure it is.

A trace that names its points by radius and height alone lies on the nominal flank where that has this radius.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.message import digits, fixed
from drivers.types.gearfiles import GearContour
from drivers.types.gears import GearInspection, GearTraces
from drivers.types.values import FloatArray
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear
from gateway.gear.measured_points import FURTHEST, FlankPoints, flank_points

STARTS, LOOKED_AT, ROUNDS = 24, 200, 40
CONVERGED = 1e-10  # mm
MOST_ALIKE = 0.999  # correlation of neighbouring residuals: beyond it a scan says nothing of itself
FARTHEST_AXIS = 2.0  # mm of the gear's axis from the origin
EDGE = 0.02  # mm beyond root and tip: rounding of printed radii


@dataclass(frozen=True, slots=True)
class LocatedContour:
    """A scan in the gear's frame: axis found at ``centre_mm`` (2,), turned by ``turn`` rad; feet of the points in mm.

    ``centre_u_mm`` (2,): standard uncertainty of the centre by what the fit leaves, in the order of the scan: form that
    goes on from point to point counts as fewer points.
    """

    centre_mm: FloatArray
    turn: float
    points: FlankPoints
    xyz: FloatArray
    centre_u_mm: FloatArray


def located_contour(gear: CycloidGear, contour: GearContour) -> LocatedContour:
    """Place and turn of a scan. Raises ModelError: E-GEAR-POINT (another gear), E-GEAR-CONTOUR (undetermined)."""
    points = np.asarray(contour.points_mm, dtype=np.float64)
    few = points[:: max(len(points) // LOOKED_AT, 1)]
    pitch = 2.0 * gear.half_pitch
    starts = (np.arange(STARTS) - STARTS // 2) * pitch / STARTS
    turn = min(starts, key=lambda one: _rms(gear, _moved(few, np.zeros(2), one)))
    centre = np.zeros(2)
    for _ in range(ROUNDS):
        found = _feet(gear, _moved(points, centre, turn))
        step, _ = _step(gear, found)
        # The step is in the gear's frame, the centre in that of the scan.
        centre = centre + _rotation(turn) @ step[:2]
        turn += float(step[2])
        if float(np.hypot(*centre)) > FARTHEST_AXIS:
            raise ModelError("E-GEAR-CONTOUR", contour.source, limit=digits(FARTHEST_AXIS, 6))
        if float(np.max(np.abs(step))) < CONVERGED:
            break
    xyz = _moved(points, centre, turn)
    found = flank_points(gear, xyz)
    _, u = _step(gear, found)
    return LocatedContour(centre_mm=centre, turn=turn, points=found, xyz=xyz, centre_u_mm=u[:2])


def inspection_of_contour(gear: CycloidGear, contour: GearContour) -> GearInspection:
    """The scan as flank points of the gear, space 0 where the fit put it. Raises what `located_contour` raises."""
    found = located_contour(gear, contour)
    flank = np.where(found.points.theta >= 0.0, 1, -1).astype(np.int64)
    return GearInspection(
        points_mm=found.xyz,
        space=found.points.k.astype(np.int64),
        flank=flank,
        source=contour.source,
        warnings=contour.warnings,
    )


def inspection_of_traces(gear: CycloidGear, traces: GearTraces) -> GearInspection:
    """Traces as nominal flank points with their deviations; space numbers count from 0 towards +X, as written.

    Raises ModelError (E-GEAR-RADIUS) for a radius that the flank does not have.
    """
    theta = theta_at_radius(gear, traces.radius_mm) * traces.flank
    space = np.mod(traces.space, gear.zc)
    section = gear.space(theta, space.astype(np.float64))
    return GearInspection(
        points_mm=np.column_stack([section.x, section.y, traces.z_mm]),
        space=space,
        flank=traces.flank,
        deviation_um=traces.deviation_um,
        probe_u_um=traces.probe_u_um,
        source=traces.source,
        warnings=traces.warnings,
    )


def theta_at_radius(gear: CycloidGear, radius: FloatArray) -> FloatArray:
    """Profile angle (n,) from 0 at the bottom to the tip where the flank has these radii (n,), by bisection.

    Raises ModelError (E-GEAR-RADIUS).
    """
    r = np.asarray(radius, dtype=np.float64)
    low, high = np.full(r.shape, 1e-9), np.full(r.shape, gear.half_pitch)
    ends = [float(np.hypot(*gear.section(np.array([one])).xy[0])) for one in (low.flat[0], high.flat[0])]
    if not np.all(np.isfinite(r)) or np.any(r < ends[0] - EDGE) or np.any(r > ends[1] + EDGE):
        wrong = r[~((r >= ends[0] - EDGE) & (r <= ends[1] + EDGE))]
        raise ModelError(
            "E-GEAR-RADIUS", "inspection", radius=fixed(wrong[0], 4), low=fixed(ends[0], 4), high=fixed(ends[1], 4)
        )
    for _ in range(60):
        middle = (low + high) / 2.0
        section = gear.section(middle)
        above = np.hypot(section.x, section.y) > r
        high, low = np.where(above, middle, high), np.where(above, low, middle)
    return (low + high) / 2.0


def _rotation(turn: float) -> FloatArray:
    cos, sin = np.cos(turn), np.sin(turn)
    return np.array([[cos, -sin], [sin, cos]])


def _moved(points: FloatArray, centre: FloatArray, turn: float) -> FloatArray:
    """Points of the scan in the gear's frame: the axis taken to the origin, the turn taken back."""
    return np.column_stack([(points[:, :2] - centre) @ _rotation(turn), points[:, 2]])


def _rms(gear: CycloidGear, xyz: FloatArray) -> float:
    try:
        return float(np.sqrt(np.mean(flank_points(gear, xyz).deviation ** 2)))
    except ModelError:
        return FURTHEST * 10.0


def _feet(gear: CycloidGear, xyz: FloatArray) -> FlankPoints:
    return flank_points(gear, xyz)


def _step(gear: CycloidGear, found: FlankPoints) -> tuple[FloatArray, FloatArray]:
    """dx, dy (mm) and turn (rad) that the deviations ask for, and their standard uncertainties; (3,) each."""
    section = gear.space(found.theta, found.k)
    h = section.h
    scale = float(np.max(np.abs(h)))
    design = np.column_stack([section.nx, section.ny, h / scale, np.ones_like(h)])
    normal = design.T @ design
    if np.linalg.cond(normal) > 1e12:
        raise ModelError("E-GEAR-CONTOUR", "inspection", limit=digits(FARTHEST_AXIS, 6))
    step = np.linalg.solve(normal, design.T @ found.deviation)
    rest = found.deviation - design @ step
    # Form that the fit leaves goes on from point to point: so many points count as one.
    along = float(rest[1:] @ rest[:-1]) / max(float(rest @ rest), 1e-300)
    along = min(max(along, 0.0), MOST_ALIKE)
    variance = float(rest @ rest) / max(rest.size - 4, 1) * (1.0 + along) / (1.0 - along)
    u = np.sqrt(variance * np.diag(np.linalg.inv(normal)))
    return np.array([step[0], step[1], step[2] / scale]), np.array([u[0], u[1], u[2] / scale])
