"""The measured error that makes most of the flank's uncertainty: are its targets too coarse, and what cures that; pure.

Targets h apart show no wave shorter than 2 h, and straight lines leave (pi s / 2 h)^2 / 2 of that once targets stand
s apart. So a step over the face is found at which the error no longer matters.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from drivers.units import AxisUnit, mm_to_um
from gateway.correct.outlook.face_residual import near, nodes_of
from gateway.correct.outlook.flank_uncertainty import between_targets
from gateway.correct.outlook.next_setup import THRESHOLD_UM
from gateway.correct.outlook.prediction import rows_of, without_setup
from gateway.domain.figures import Component
from gateway.gear.flank import FlankGrid
from gateway.gear.grinding import Grinding
from gateway.model.known import ErrorModel
from gateway.tooth import FlankPrediction

DOMINATES = 0.5  # of u squared
CURED = 1.0 / 3.0  # of what it was
FEWEST, MOST = 4, 20  # steps over the face
BESIDE = 2  # steps on either side of it: the outermost may be too close together for the gap beyond them


@dataclass(frozen=True, slots=True)
class FinerTargets:
    """Where to measure at which step, machine coordinates in the axis' unit, and what is left then, um RMS."""

    first: float
    last: float
    step: float
    unit: AxisUnit
    left_um: float


@dataclass(frozen=True, slots=True)
class Dominant:
    """One measured error whose doubt is more than half of the flank's u squared, um RMS.

    ``window`` cures it; None where its targets are fine enough and noise or the instrument make its doubt.
    """

    name: str
    part_um: float
    u_um: float
    window: FinerTargets | None


def dominant(grinding: Grinding, grid: FlankGrid, model: ErrorModel, flank: FlankPrediction) -> Dominant | None:
    """The error to measure better, if one makes most of the doubt and enough to matter; None else."""
    motions = {one.name: one for one in model.motions}
    name, part = max(flank.parts_um.items(), key=lambda item: item[1], default=("", 0.0))
    if name not in motions or part <= THRESHOLD_UM or part**2 <= DOMINATES * flank.u_um**2:
        return None
    unseen = _unseen_um(grinding, grid, motions[name])
    coarse = unseen**2 > DOMINATES * part**2
    return Dominant(name, part, flank.u_um, _window(grinding, grid, motions[name], unseen) if coarse else None)


def _unseen_um(grinding: Grinding, grid: FlankGrid, one: Component) -> float:
    """What of an error's doubt lies between its targets, set-up values right."""
    if one.residual_rms <= 0.0:
        return 0.0
    doubt = without_setup(grinding, between_targets(grinding, grid, one))
    return float(np.sqrt(np.sum(np.asarray(mm_to_um(rows_of(doubt))) ** 2) / doubt.places.points))


def _window(grinding: Grinding, grid: FlankGrid, one: Component, unseen_um: float) -> FinerTargets | None:
    axis, _ = grinding.chain.error_place(one.name)
    if axis == grinding.index:
        return _every_space(grinding, grid)
    if axis != grinding.stroke:
        return None
    face = grid.gear.b
    middle = float(grinding.stroke_command(np.zeros(())))
    count, share = next(
        ((n, share) for n in range(FEWEST, MOST) if (share := _left(one, face, middle, face / n)) <= CURED),
        (MOST, _left(one, face, middle, face / MOST)),
    )
    step = face / count
    return FinerTargets(
        first=middle - face / 2.0 - BESIDE * step,
        last=middle + face / 2.0 + BESIDE * step,
        step=step,
        unit=one.axis_unit,
        left_um=share * unseen_um,
    )


def _every_space(grinding: Grinding, grid: FlankGrid) -> FinerTargets:
    """An index error is seen where the spaces are ground: between them no flank asks."""
    places = np.asarray(grinding.commands(grid.ks, 0.0)[grinding.index])
    at = np.sort(np.mod(np.rad2deg(places), 360.0))
    return FinerTargets(first=float(at[0]), last=float(at[-1]), step=360.0 / at.size, unit="deg", left_um=0.0)


def _left(one: Component, face: float, middle: float, step: float) -> float:
    """The share of what lies between the targets that stays there with others ``step`` apart; all of it at most.

    The shortest wave that targets show is twice their distance. A smooth fit does not keep that: down to the face.
    """
    here = near(one, face, middle)
    shortest = face if here is None else 2.0 * float(np.mean(np.diff(nodes_of(one)[here])))
    return min((pi * step / shortest) ** 2 / 2.0, 1.0)
