"""Location of a rotary axis, position and orientation by ISO 230-1 letters, from a ball or a bar that turns with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from drivers.message import Message
from drivers.units import rad_to_arcsec, um_to_mm
from gateway.domain.figures import Component
from gateway.domain.values import COVERAGE, FloatArray
from gateway.errors import ModelError
from gateway.evaluate.geometry.straightness import StraightnessRun
from gateway.model.components import is_periodic, mean_of

RotaryAxis = Literal["A", "B", "C"]
# Cyclic order (u, v, w): w is the axis; it leans as direction (+rotation about v, -rotation about u, 1).
FRAMES: Mapping[str, tuple[str, str, str]] = {"C": ("X", "Y", "Z"), "A": ("Y", "Z", "X"), "B": ("Z", "X", "Y")}
ROTATION = {"X": "A", "Y": "B", "Z": "C"}


@dataclass(frozen=True, slots=True)
class Location:
    """Where an axis is: um at the height asked for, arcsec for its lean; ``U`` (k = 2) by the same names.

    For C: EX0C, EY0C position, EA0C, EB0C orientation: the centre moves with height by X = EB0C z, Y = -EA0C z.
    ``artefact`` is how the artefact's own surface leans along a direction (X, Y, Z) at the first place, arcsec.
    """

    axis: RotaryAxis
    values: Mapping[str, float]
    U: Mapping[str, float] = field(default_factory=dict)
    flags: tuple[Message, ...] = ()
    artefact: Mapping[str, float] = field(default_factory=dict)


def from_ball(
    axis: RotaryAxis, rings: Sequence[tuple[float, Mapping[str, Component]]], *, height_mm: float = 0.0
) -> Location:
    """Location from a ball (or bore) read while the axis turns: rings of (height, fitted readings by direction, um).

    A ring's centre is the mean over the turn of each direction across the axis: the ball's eccentricity and the axis'
    own motions turn with it and leave none. Directions that were not read are left out. Two heights or more also give
    the lean, as a straight line through the centres, and the position at `height_mm`. One height: position only.
    Raises ModelError (E-EVAL-LOCATION), also for a ring that was not read around the whole turn: an eccentric ball's
    mean over a part of it is no centre.
    """
    across = _across(axis)
    read = [letter for letter in across if rings and all(letter in ring for _, ring in rings)]
    if not read:
        raise ModelError("E-EVAL-LOCATION", "location", axis=axis, why=Message.of("W-EVAL-NO-DIRECTION"))
    for one in (part for _, ring in rings for part in ring.values() if not is_periodic(part)):
        low, high = one.domain
        why = Message.of("W-EVAL-PART-TURN", name=one.name, low=low, high=high)
        raise ModelError("E-EVAL-LOCATION", "location", axis=axis, why=why)
    heights = np.array([height for height, _ in rings], dtype=np.float64) - height_mm
    values, U = {}, {}
    for letter in read:
        centres = np.array([mean_of(ring[letter]) for _, ring in rings])
        place, lean = _line(heights, centres[:, 0], centres[:, 1])
        values[f"E{letter}0{axis}"], U[f"E{letter}0{axis}"] = place[0], COVERAGE * place[1]
        if lean is not None:
            name, sign = _leans(axis, letter)
            values[name], U[name] = sign * _arcsec(lean[0]), COVERAGE * _arcsec(lean[1])
    return Location(axis, values, U, _limits_of_heights(np.unique(heights).size))


def _arcsec(um_per_mm: float) -> float:
    return float(rad_to_arcsec(um_to_mm(um_per_mm)))


def _limits_of_heights(heights: int) -> tuple[Message, ...]:
    if heights == 1:
        return (Message.of("S-EVAL-ONE-HEIGHT"),)
    return () if heights > 2 else (Message.of("S-EVAL-TWO-HEIGHTS"),)


def _across(axis: str) -> tuple[str, str]:
    if axis not in FRAMES:
        raise ModelError("E-EVAL-LOCATION", "location", axis=axis, why=Message.of("W-EVAL-NOT-ABC"))
    return FRAMES[axis][:2]


def _leans(axis: str, letter: str) -> tuple[str, float]:
    """Name and sign of the orientation that a slope of centres along a direction makes."""
    u, v = _across(axis)
    return (f"E{ROTATION[v]}0{axis}", 1.0) if letter == u else (f"E{ROTATION[u]}0{axis}", -1.0)


def _line(h: FloatArray, y: FloatArray, u: FloatArray) -> tuple[tuple[float, float], tuple[float, float] | None]:
    """Weighted line: value at h = 0 and slope, each with its standard uncertainty; no slope from one height."""
    if np.ptp(h) == 0.0:
        return (float(y.mean()), float(np.sqrt(np.mean(u**2) / h.size))), None
    weight = 1.0 / np.maximum(u, 1e-12)
    design = np.column_stack([np.ones_like(h), h]) * weight[:, None]
    found = np.linalg.lstsq(design, y * weight, rcond=None)[0]
    sigma = np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    return (float(found[0]), float(sigma[0])), (float(found[1]), float(sigma[1]))


def from_bar(axis: RotaryAxis, runs: Mapping[str, tuple[StraightnessRun, StraightnessRun]]) -> Location:
    """Orientation against the linear axis along it, from indicator runs up a test bar, in mm.

    ``runs`` by direction across the axis (C: X, Y): coordinate of the bar's surface with the rotary axis at two places
    half a turn apart; the mean slope is free of the bar's own lean and run-out, which are half the difference. Includes
    the straightness and squareness of the linear axis that carried the indicator. Raises ModelError (E-EVAL-LOCATION).
    """
    values, U, artefact = {}, {}, {}
    for letter, (first, second) in runs.items():
        if letter not in _across(axis):
            raise ModelError(
                "E-EVAL-LOCATION", "location", axis=axis, why=Message.of("W-EVAL-NOT-ACROSS", letter=letter)
            )
        (one, u_one), (two, u_two) = first.direction(), second.direction()
        name, sign = _leans(axis, letter)
        values[name] = sign * float(rad_to_arcsec((one + two) / 2.0))
        U[name] = COVERAGE * float(rad_to_arcsec(np.hypot(u_one, u_two) / 2.0))
        artefact[letter] = float(rad_to_arcsec((one - two) / 2.0))
    return Location(axis=axis, values=values, U=U, flags=(Message.of("S-EVAL-ORIENTATION-ONLY"),), artefact=artefact)
