"""Where the axis stands about which the table turns: what a fixture is dialled in to, seen in the table's frame.

The once-per-turn radial motion that turns along with the table is no motion of the axis: it says where the axis
lies in the table (ISO 230-7 calls it the eccentricity of whatever is measured). A dial gauge at a part on the table
shows it, and whoever mounts a fixture takes it out; so does a tilt that turns along.
"""

from __future__ import annotations

import numpy as np

from simulators.grinding.work import ARCSEC, UM
from simulators.truth import Truth
from simulators.truth.chain import Pose, still

STEPS = 720


def on_axis(truth: Truth, height_mm: float) -> Pose:
    """The frame in the table whose z axis is the axis of rotation, at this height above the table's origin."""
    x, y = (UM * value for value in _along(truth, "EXC", "EYC"))
    a, b = (ARCSEC * value for value in _along(truth, "EAC", "EBC"))
    return still((-x - height_mm * b, -y + height_mm * a, height_mm), (-a, -b, 0.0))


def _along(truth: Truth, first: str, second: str) -> tuple[float, float]:
    """The part of a pair of stator-frame motions that turns along with the table, as a vector of the table."""
    places = 360.0 / STEPS * np.arange(STEPS, dtype=np.float64)
    turn = np.deg2rad(places)
    x, y = truth.motion(first, places), truth.motion(second, places)
    along = np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x
    return float(np.mean(along[0])), float(np.mean(along[1]))
