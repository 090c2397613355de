"""What a correction is to make best besides the flank: rows of transmission error and lost motion on its points; pure.

First order about the mean drive of nominal discs, all discs the same part (`firstorder`). An angle counts as what it
moves at the largest lever, a zc: then 1 um of flank and 1 um of transmission weigh alike, and a goal is one least
squares: rms^2 mean(e^2) + transmission^2 mean(TE^2) + lost_motion^2 mean((LM - LM_nominal)^2), TE over both senses of
torque. A lost motion below the nominal drive's is no aim: it is clearance that assembly needs. A goal of the drive
keeps a tenth of the flank's weight, so that what the drive does not see stays small.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal, get_args

import numpy as np

from drivers.message import Message
from drivers.types.values import FloatArray
from drivers.units import arcsec_to_rad, mm_to_um
from gateway.errors import ModelError
from gateway.gear.flank import FlankGrid
from gateway.reducer.figures import LOST_MOTION
from gateway.reducer.firstorder import transmission_map
from gateway.reducer.records import Reducer
from gateway.tooth import FlankMap

GoalKind = Literal["rms", "transmission", "lost-motion", "weights"]
KINDS: tuple[GoalKind, ...] = get_args(GoalKind)
FLANK_SHARE = 0.1
WEIGHTS: Mapping[str, tuple[float, float, float]] = {
    "rms": (1.0, 0.0, 0.0),
    "transmission": (FLANK_SHARE, 1.0, 0.0),
    "lost-motion": (FLANK_SHARE, 0.0, 1.0),
}
LIMITS = ("transmission_arcsec", "lost_motion_arcsec")


@dataclass(frozen=True)
class DriveGoal:
    """Weights of flank, transmission error and lost motion, the drive they are of, and limits by name (`LIMITS`)."""

    kind: GoalKind
    drive: Reducer
    rms: float
    transmission: float
    lost_motion: float
    limits: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        weights = (self.rms, self.transmission, self.lost_motion)
        bad = not all(np.isfinite(w) and w >= 0.0 for w in weights) or not self.rms > 0.0
        if self.kind not in KINDS or bad:
            given = ", ".join(f"{weight:g}" for weight in weights)
            raise ModelError("E-REDUCER-GOAL", "goal", kind=self.kind, weights=given, known=", ".join(KINDS))
        for name, limit in self.limits.items():
            if name not in LIMITS or not limit > 0.0:
                raise ModelError("E-REDUCER-GOAL", "goal", kind=name, weights=limit, known=", ".join(LIMITS))

    @property
    def of_drive(self) -> bool:
        """Whether anything but the flank counts."""
        return self.transmission > 0.0 or self.lost_motion > 0.0


def goal_of(
    kind: GoalKind,
    drive: Reducer,
    weights: tuple[float, float, float] | None = None,
    limits: Mapping[str, float] | None = None,
) -> DriveGoal:
    """The goal of a kind; "weights" needs them (rms, transmission, lost motion). Raises ModelError E-REDUCER-GOAL."""
    rms, transmission, lost = (WEIGHTS.get(kind) or weights or (0.0, 0.0, 0.0)) if kind in KINDS else (0.0, 0.0, 0.0)
    drive.measured_from()
    return DriveGoal(
        kind=kind, drive=drive, rms=rms, transmission=transmission, lost_motion=lost, limits=dict(limits or {})
    )


@dataclass(frozen=True)
class FlankTarget:
    """What else is to be small, on A, B, G of wheel places in C order of (K, Z), and the weight of the flank's rows.

    ``rows`` (R, K Z 3) mm per mm (rad for G), ``start`` (R,) mm; |rows abg + start|^2 is to be added to |e|^2 over all
    points. What no A, B, G can change is left out.
    """

    rows: FloatArray
    start: FloatArray
    flank: float


def flank_target(goal: DriveGoal, grid: FlankGrid) -> FlankTarget:
    """The goal on the places of a grid of all spaces. Raises ModelError E-REDUCER-FLANK where spaces are missing."""
    if not np.array_equal(grid.ks, np.arange(goal.drive.gear.zc)):
        raise ModelError("E-REDUCER-FLANK", "goal", why=Message.of("W-REDUCER-ALL-SPACES"))
    transmission, lost = _rows(goal.drive, tuple(grid.thetas.tolist()), tuple(grid.zs.tolist()))
    unit = arcsec_to_rad(1.0) * goal.drive.lever_mm * np.sqrt(np.prod(grid.shape))
    parts = [
        (weight * unit * rows, weight * unit * start)
        for weight, (rows, start) in ((goal.transmission, transmission), (goal.lost_motion, lost))
        if weight > 0.0
    ]
    width = grid.ks.size * grid.zs.size * 3
    rows = np.concatenate([np.zeros((0, width)), *(rows for rows, _ in parts)])
    return FlankTarget(rows, np.concatenate([np.zeros(0), *(start for _, start in parts)]), goal.rms)


Rows = tuple[FloatArray, FloatArray]


@lru_cache(maxsize=4)
def _rows(drive: Reducer, theta: tuple[float, ...], z: tuple[float, ...]) -> tuple[Rows, Rows]:
    """Root-mean-square rows in arcsec (R, K Z 3) per mm or rad, and their start: transmission error of both senses, and
    lost motion beside the nominal drive's."""
    gear = drive.gear
    thetas, zs = np.array(theta), np.array(z)
    nominal = FlankMap(thetas, zs, np.zeros((gear.zc, thetas.size, zs.size)))
    section = gear.section(thetas)
    form = np.stack([section.nx, section.ny, section.h], axis=-1)

    def of(torque: float) -> Rows:
        found = transmission_map(drive, nominal, torque_nm=torque)
        whole = found.together.toarray().reshape(-1, gear.zc, thetas.size, zs.size)
        rows = mm_to_um(np.einsum("nktz,tc->nkzc", whole, form).reshape(whole.shape[0], -1))
        return rows, found.mean_arcsec

    def centred(one: Rows) -> Rows:
        return one[0] - one[0].mean(axis=0), one[1]

    loaded = [centred(of(sense * drive.rated_nm)) for sense in (1.0, -1.0)]
    soft = [of(sense * LOST_MOTION * drive.rated_nm)[0] for sense in (1.0, -1.0)]
    lost = soft[0] - soft[1]
    both = (np.concatenate([rows for rows, _ in loaded]), np.concatenate([start for _, start in loaded]))
    return _reduced(both), _reduced((lost, np.zeros(lost.shape[0])))


def _reduced(one: Rows) -> Rows:
    """As few rows with the same mean square, less what no column changes."""
    rows, start = one
    # One rotation of all spaces turns the output and nothing else: what the contact's ripple makes of it is taken out,
    # or an index zero that nobody sees would be found from it.
    turned = rows.reshape(rows.shape[0], -1, 3)
    turned[:, :, 2] -= turned[:, :, 2].mean(axis=1, keepdims=True)
    q, r = np.linalg.qr(rows / np.sqrt(rows.shape[0]))
    return r, q.T @ (start / np.sqrt(rows.shape[0]))
