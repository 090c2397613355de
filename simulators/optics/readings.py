"""What straightness, angle, square, ball and bar set-ups show for the poses of the machine: pure geometry.

Straightness: the carrier's way across a straight reference that the mounting leans by ``misalign_mrad`` (its slope
means nothing). Square: the same with one reference for two runs, its arms 90 deg + ``own_angle`` apart. Ball: the way
of a point of the table, seen by indicators. Bar: a line of the table, leaning by ``tilt_mrad``; indicators on the
carrier follow it (um), or two of them at different heights show its direction (arcsec). Every reading grows when
the moved part errs in the + direction of the component's own letter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simulators.cellfile import Setup
from simulators.optics.mountings import angle_rad, carrier_of
from simulators.truth import AxisMotion
from simulators.truth.chain import Pose

FloatArray = NDArray[np.float64]
UM = 1e-3
ARCSEC = np.pi / 180.0 / 3600.0
AXES = {"X": 0, "Y": 1, "Z": 2}
# Which way each location error is looked at, by the axis that moves.
LOOKS = {("B0Z", "X"): "Z", ("B0Z", "Z"): "X", ("A0C", "Z"): "Y", ("B0C", "Z"): "X"}

Frames = dict[str, Pose]


def component_of(setup: Setup) -> str:
    """The component without its mark for a reversed artefact."""
    return setup.component.removesuffix("-R")


def looks_along(setup: Setup) -> str:
    """The letter along or about which this set-up reads."""
    name = component_of(setup)
    return name[1] if name[0] == "E" else LOOKS.get((name, setup.axis), name[0])


def reading(setup: Setup, frames: Frames, motions: dict[str, AxisMotion]) -> FloatArray:
    """What an error-free instrument shows, (n,) or (1,): um, or arcsec for angles; turned round it counts backwards."""
    shown = _facing(setup, frames, motions)
    return -shown if setup.reversed else shown


def _facing(setup: Setup, frames: Frames, motions: dict[str, AxisMotion]) -> FloatArray:
    along = looks_along(setup)
    if along in "ABC":
        return _direction(setup, frames, along) if setup.optics == "bar" else _angle(setup, frames, along)
    if setup.optics == "bar":
        return _beside_bar(setup, frames, motions, AXES[along])
    if setup.axis == "C":
        return _ball(setup, frames, motions, AXES[along])
    return _across(setup, frames, AXES[along])


def _angle(setup: Setup, frames: Frames, about: str) -> FloatArray:
    return angle_rad(setup, frames, about) / ARCSEC


def _across(setup: Setup, frames: Frames, along: int) -> FloatArray:
    """Way across a straight reference along the moved axis."""
    travel = AXES[setup.axis]
    offset = np.asarray(setup.offset_mm)
    carried, head = frames[carrier_of(setup)].point(offset), frames[setup.head].point(np.zeros(3))
    nominal = offset.copy()
    nominal[travel] += setup.datum
    reference = _reference(setup, travel)
    across = np.zeros(3)
    across[along] = 1.0
    across = across - (across @ reference) * reference
    return np.asarray((carried - head - nominal) @ (across / np.linalg.norm(across))) / UM


def _reference(setup: Setup, travel: int) -> FloatArray:
    """The reference's direction, (3,). A square leans as a whole about Y; its Z arm leans by its own angle too."""
    line = np.zeros(3)
    line[travel] = 1.0
    if setup.optics != "square":
        line[(travel + 1) % 3], line[(travel + 2) % 3] = np.tan(np.asarray(setup.misalign_mrad) * 1e-3)
        return np.asarray(line / np.linalg.norm(line))
    own = setup.own_angle_arcsec * ARCSEC * (-1.0 if setup.component.endswith("-R") else 1.0)
    lean = setup.misalign_mrad[0] * 1e-3 - (own if setup.axis == "Z" else 0.0)
    cos, sin = np.cos(lean), np.sin(lean)
    return np.asarray((cos, 0.0, -sin) if setup.axis == "X" else (sin, 0.0, cos))


def _ball(setup: Setup, frames: Frames, motions: dict[str, AxisMotion], along: int) -> FloatArray:
    """A ball on the table, eccentric by ``eccentric_mm``, against the head; nominal X and Z taken off."""
    place = np.asarray(setup.offset_mm) + np.asarray((setup.eccentric_mm, 0.0, 0.0))
    centre = frames["C"].point(place) - frames[setup.head].point(np.zeros(3))
    nominal = np.zeros((1, 3))
    if "X" in motions:
        nominal = nominal + motions["X"].position[:, None] * np.asarray((1.0, 0.0, 0.0))
    if "Z" in motions and setup.head == "Z":
        nominal = nominal - motions["Z"].position[:, None] * np.asarray((0.0, 0.0, 1.0))
    nominal = nominal + np.asarray((0.0, 0.0, place[2]))
    return np.asarray((centre - nominal)[:, along]) / UM + setup.zero_um


def _bar(setup: Setup, frames: Frames) -> tuple[FloatArray, FloatArray]:
    """A point of the bar's axis and its direction in the bed frame, each (n, 3)."""
    foot = np.asarray(setup.offset_mm) + np.asarray((setup.eccentric_mm, 0.0, 0.0))
    lean = np.asarray((np.tan(setup.tilt_mrad * 1e-3), 0.0, 1.0))
    return frames["C"].point(foot), frames["C"].rotation @ (lean / np.linalg.norm(lean))


def _direction(setup: Setup, frames: Frames, about: str) -> FloatArray:
    """Lean of the bar about bed A or B."""
    _, way = _bar(setup, frames)
    return np.arctan2(-way[:, 1] if about == "A" else way[:, 0], way[:, 2]) / ARCSEC


def _beside_bar(setup: Setup, frames: Frames, motions: dict[str, AxisMotion], along: int) -> FloatArray:
    """Way of an indicator on the carrier across the bar at the indicator's own height."""
    foot, way = _bar(setup, frames)
    seen = frames[carrier_of(setup)].point(np.zeros(3))
    up = (seen[:, 2] - foot[:, 2]) / way[:, 2]
    nominal = motions["X"].position[:, None] * np.asarray((1.0, 0.0, 0.0)) + np.asarray(setup.offset_mm)
    return np.asarray((seen - foot - up[:, None] * way + nominal)[:, along]) / UM
