"""Six error motions of a linear axis that one instrument read at once, and the error of a point beside its beam.

An instrument with six degrees of freedom reads at each stop the linear, two straightness and three angular motions of
one carriage from one mounting. Readings d (target i, run j, way s, motion k) have means m (i, k) over both ways.
What is left about the mean of its own target and way is scatter; its products, pooled over all stops at which every
channel was read, are the covariance of one reading

    C = sum r r^T / nu,   nu = sum over targets and ways of (runs - 1)

with terms beside the diagonal: a tripod that creeps, or a carriage that stops otherwise each time, moves straightness
and angle together. A point that stands p = (x, y, z) mm from the measured point of the carriage moves by

    t = E + w x p:   dX = EXX + EBX z - ECX y,  dY = EYX + ECX x - EAX z,  dZ = EZX + EAX y - EBX x

(right-handed, ISO 230-1; axis X as example). In matrix form t = J(p) (E, w), so the covariance of its mean over n
readings is J C J^T / n. Taking the six as independent would give J diag(C) J^T / n: too much where angle and
straightness drift against each other, too little where they drift together. The straightness motions keep the slope of
the instrument's own reference line: it is mounting, and is taken off the error of a point by a least-squares line
across the travel, never off its linear part.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drivers.message import digits
from drivers.units import arcsec_to_rad, mm_to_um
from gateway.domain.values import COVERAGE, FloatArray
from gateway.errors import ModelError
from gateway.evaluate.behaviour.repetitions import mean_of_both

FEWEST = 2


def motions_of_axis(axis: str) -> tuple[str, ...]:
    """The six motions of a linear axis in the order of this module: three along X, Y, Z, then about A, B, C."""
    return tuple(f"E{way}{axis}" for way in "XYZABC")


@dataclass(frozen=True, slots=True)
class SixMotions:
    """Means (m, 6) of EX., EY., EZ. in um and EA., EB., EC. in arcsec at targets (m,) in mm.

    ``covariance`` (6, 6) is that of one reading in these units, None without repeats; ``counts`` (m,) are the readings
    of the channel that has fewest at each target.
    """

    axis: str
    targets: FloatArray
    means: FloatArray
    counts: FloatArray
    covariance: FloatArray | None

    def u(self) -> FloatArray | None:
        """Standard uncertainties (m, 6) of the means by their scatter."""
        if self.covariance is None:
            return None
        return np.asarray(np.sqrt(np.diag(self.covariance)[None, :] / self.counts[:, None]))

    def correlation(self) -> FloatArray | None:
        """Correlation (6, 6) of the channels' scatter; 0 where a channel has none."""
        if self.covariance is None:
            return None
        own = np.sqrt(np.diag(self.covariance))
        scale = np.outer(own, own)
        return np.asarray(np.divide(self.covariance, scale, out=np.zeros_like(scale), where=scale > 0.0))


@dataclass(frozen=True, slots=True)
class PointError:
    """Error (m, 3) in um of a point beside the beam, its U (m, 3) (k = 2), and U as if channels were independent."""

    targets: FloatArray
    error: FloatArray
    U: FloatArray | None
    U_independent: FloatArray | None


def six_motions(axis: str, targets: FloatArray, readings: Mapping[str, FloatArray]) -> SixMotions:
    """Six sets of deviations (m, n, 2) by name, um and arcsec, read at the same targets (m,); NaN where one was lost.

    Raises ModelError: E-SIX-AXIS (no X, Y, Z), E-SIX-MISSING (a motion is not there), E-SIX-SHAPE (not the same
    targets, runs and ways), E-SIX-LOST (a channel without any reading at a target).
    """
    if axis not in ("X", "Y", "Z"):
        raise ModelError("E-SIX-AXIS", "six-dof", axis=axis or "?")
    names = motions_of_axis(axis)
    lacking = [name for name in names if name not in readings]
    if lacking:
        raise ModelError("E-SIX-MISSING", "six-dof", missing=", ".join(lacking), found=", ".join(readings) or "-")
    shapes = {name: readings[name].shape for name in names}
    shape = shapes[names[0]]
    if len(shape) != len("ijs") or shape[0] != targets.size or set(shapes.values()) != {shape}:
        told = ", ".join(f"{name} {'x'.join(map(str, one))}" for name, one in shapes.items())
        raise ModelError("E-SIX-SHAPE", "six-dof", shapes=told)
    every = np.stack([readings[name] for name in names], axis=-1)
    there = np.asarray(np.isfinite(every))
    count = there.sum(axis=1)
    sums = np.where(there, every, 0.0).sum(axis=1)
    way = np.divide(sums, count, out=np.full_like(sums, np.nan), where=count > 0)
    means = np.stack([mean_of_both(way[:, 0, k], way[:, 1, k]) for k in range(len(names))], axis=-1)
    lost = [(i, k) for i, k in zip(*np.nonzero(~np.isfinite(means)), strict=True)]
    if lost:
        i, k = lost[0]
        raise ModelError("E-SIX-LOST", "six-dof", motion=names[k], target=digits(targets[i], 6), count=len(lost))
    whole = np.asarray(there.all(axis=-1))
    free = int(np.maximum(whole.sum(axis=1) - 1, 0).sum())
    covariance = None
    if free > 0:
        kept = np.where(whole[..., None], every, np.nan)
        counted = np.maximum(whole.sum(axis=1), 1)[:, None, :, None]
        centre = np.where(whole[..., None], every, 0.0).sum(axis=1, keepdims=True) / counted
        left = (kept - centre)[whole]
        covariance = np.asarray(left.T @ left / free)
    fewest = np.asarray(count.sum(axis=1).min(axis=-1), dtype=np.float64)
    at = np.asarray(targets, dtype=np.float64)
    return SixMotions(axis=axis, targets=at, means=means, counts=fewest, covariance=covariance)


def lever(offset_mm: tuple[float, float, float]) -> FloatArray:
    """J (3, 6): um along X, Y, Z by um and arcsec of the six motions, at an offset in mm from the measured point."""
    x, y, z = (float(mm_to_um(arcsec_to_rad(one))) for one in offset_mm)
    turn = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    return np.hstack([np.eye(3), turn])


def point_error(found: SixMotions, offset_mm: tuple[float, float, float], *, level: bool = True) -> PointError:
    """The error of a point beside the beam. ``level`` takes the mounting's slope off the two across the travel.

    Raises ModelError (E-SIX-OFFSET) for an offset that is no finite number or beyond 10 m.
    """
    if not all(np.isfinite(one) and abs(one) <= mm_to_um(10.0) for one in offset_mm):
        raise ModelError("E-SIX-OFFSET", "six-dof", offset=", ".join(f"{one:g}" for one in offset_mm))
    J = lever(offset_mm)
    error = found.means @ J.T
    if level and found.targets.size >= FEWEST and np.ptp(found.targets) > 0.0:
        for place, letter in enumerate("XYZ"):
            if letter != found.axis:
                error[:, place] -= np.polyval(np.polyfit(found.targets, error[:, place], 1), found.targets)
    if found.covariance is None:
        return PointError(found.targets, error, None, None)
    U, alone = (
        COVERAGE * np.sqrt(np.diag(J @ C @ J.T)[None, :] / found.counts[:, None])
        for C in (found.covariance, np.diag(np.diag(found.covariance)))
    )
    return PointError(found.targets, error, U, alone)
