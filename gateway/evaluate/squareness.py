"""Squareness of two axes from straightness runs, face diagonals or body diagonals (ISO 230-1, -6)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import asin

import numpy as np
from numpy.typing import ArrayLike

from gateway.errors import ModelError
from gateway.evaluate.straightness import straightness


@dataclass(frozen=True, slots=True)
class SquarenessRuns:
    """Slopes of the two runs and E_C0Y in rad; positive: the angle from X to Y is above 90 deg."""

    slope_x: float
    slope_y: float
    C0Y: float


def from_runs(x: ArrayLike, eyx: ArrayLike, y: ArrayLike, exy: ArrayLike, artefact_rad: float = 0.0) -> SquarenessRuns:
    """E_C0Y = artefact - (slope of EYX along X + slope of EXY along Y), all lengths in one unit.

    ``artefact_rad`` is the square's own angle less 90 deg.
    """
    slope_x, slope_y = straightness(x, eyx, "lsq").slope, straightness(y, exy, "lsq").slope
    return SquarenessRuns(slope_x, slope_y, artefact_rad - (slope_x + slope_y))


def from_face_diagonals(d_pp: float, d_pm: float, length_x: float, length_y: float) -> float:
    """E_C0Y in rad from the two diagonals of a rectangle length_x by length_y (++ and +-)."""
    cosine = (d_pp**2 - d_pm**2) / (4.0 * length_x * length_y)
    if abs(cosine) > 1.0:
        raise ModelError("E-EVAL-DIAGONALS", "squareness", d_pp=d_pp, d_pm=d_pm)
    return -asin(cosine)


@dataclass(frozen=True, slots=True)
class BodyDiagonals:
    """Three squarenesses in rad and the scale error common to the axes (relative)."""

    C0Y: float
    B0Z: float
    A0Z: float
    scale: float


def from_body_diagonals(
    deviations: Mapping[tuple[int, int], float], lengths: tuple[float, float, float]
) -> BodyDiagonals:
    """Solve the four body diagonals (ISO 230-6) for squarenesses and one common scale, first order.

    ``deviations`` maps the signs (s_y, s_z) of the diagonal direction (+, s_y, s_z) to its length deviation
    in the unit of `lengths`. Diagonals alone cannot tell scale, squareness and straightness apart.
    """
    lx, ly, lz = lengths
    diagonal = float(np.sqrt(lx**2 + ly**2 + lz**2))
    signs = [(1, 1), (1, -1), (-1, 1), (-1, -1)]
    rows = [[-sy * lx * ly, sz * lx * lz, -sy * sz * ly * lz, diagonal**2] for sy, sz in signs]
    found = np.linalg.solve(np.asarray(rows) / diagonal, np.asarray([deviations[sign] for sign in signs]))
    return BodyDiagonals(*(float(value) for value in found))
