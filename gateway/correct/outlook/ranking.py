"""How much each error of a fitted machine matters on the tooth, and by what it can be cured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.types.values import FloatArray
from drivers.units import mm_to_um
from gateway.correct.flank.compensability import Cure, cures
from gateway.correct.flank.flank_model import places_of_grid
from gateway.correct.flank.noise import Shape
from gateway.correct.outlook.flank_uncertainty import FlankDoubts
from gateway.correct.outlook.prediction import rows_of, without_setup
from gateway.correct.plan.plan import Plan
from gateway.gear.first_order import ErrorParameter, linear_flank
from gateway.gear.flank import FlankGrid
from gateway.gear.grinding import Grinding
from gateway.model.error_model import TWENTY_ONE, ErrorModel, UnmeasuredError, in_mm_rad
from gateway.sensitivity.outputs import ScaledMotion
from gateway.sensitivity.screening import screen
from gateway.tooth import CureRecord, RankRecord

TRAJECTORIES = 40
PART = 0.5  # of the RMS: a cure that leaves more is none


@dataclass(frozen=True, slots=True)
class ConstantShape:
    """A motion that is the same everywhere, mm or rad."""

    value: float

    def __call__(self, q: FloatArray) -> FloatArray:
        """Values at q, same shape."""
        return np.full_like(q, self.value)


@dataclass(frozen=True, slots=True)
class SizedError:
    """An error as it is in a machine, and between which multiples of that it may lie."""

    parameter: ErrorParameter
    low: float
    high: float


def errors_of(grinding: Grinding, plan: Plan, model: ErrorModel) -> tuple[SizedError, ...]:
    """Every error of the model: a measured one from nothing to what it is, an unknown one anywhere in its span.

    An unknown motion is taken for a slope over the travel, around the turn for two waves.
    """
    found = []
    for name in (*model.measured, *(gap.name for gap in model.unknown)):
        if name not in TWENTY_ONE:
            continue
        gap = next((one for one in model.unknown if one.name == name), None)
        if gap is not None:
            found.append(SizedError(ErrorParameter(name, _assumed_error(grinding, plan, gap)), -1.0, 1.0))
            continue
        axis, key = grinding.chain.error_place(name)
        one = grinding.chain.axis(axis)
        motion = one.err.get(key, one.loc.get(key, 0.0))
        found.append(
            SizedError(ErrorParameter(name, motion if callable(motion) else ConstantShape(float(motion))), 0.0, 1.0)
        )
    return tuple(found)


def _assumed_error(grinding: Grinding, plan: Plan, gap: UnmeasuredError) -> ConstantShape | ScaledMotion:
    size = in_mm_rad(gap.unit, gap.span)
    if not gap.name.startswith("E"):
        return ConstantShape(size)
    axis, _ = grinding.chain.error_place(gap.name)
    if grinding.chain.axis(axis).kind == "revolute":
        return ScaledMotion(Shape(3, 0.0, 0.0, turning=True), size / 2.0**0.5)
    low, high = next(((one.minimum, one.maximum) for one in plan.grids if one.axis == axis), (-1.0, 1.0))
    return ScaledMotion(Shape(1, low, high, turning=False), size / 3.0**0.5)


def rank_errors(
    grinding: Grinding, grid: FlankGrid, plan: Plan, model: ErrorModel, *, r: int = TRAJECTORIES, seed: int = 1
) -> tuple[RankRecord, ...]:
    """Morris ranking of the flank's RMS with the set-up values right, the most important error first."""
    errors = errors_of(grinding, plan, model)
    names = tuple(one.parameter.name for one in errors)
    if not names:
        return ()
    places = places_of_grid(grid)
    terms = linear_flank(grinding, grid, [one.parameter for one in errors]).terms
    patterns = np.moveaxis(terms, 1, 2).reshape(places.k.size, 3, len(errors))
    rows = rows_of(without_setup(grinding, FlankDoubts(places, names, patterns)))
    root = np.asarray(np.linalg.qr(rows, mode="r")) / np.sqrt(places.points)
    model_rms = _Rms(np.asarray(mm_to_um(root)), errors)
    found = screen(model_rms, names, ("rms",), r=r, seed=seed).rankings["rms"]
    return tuple(
        RankRecord(
            error=one.name,
            mu_star_um=one.mu_star,
            low_um=one.low,
            high_um=one.high,
            rank=(one.rank_low, one.rank_high),
            sigma_um=one.sigma,
        )
        for one in found
    )


@dataclass(frozen=True)
class _Rms:
    """RMS (n, 1) um of points (n, d) of the unit cube; ``root`` (m, d) um per whole error."""

    root: FloatArray
    errors: tuple[SizedError, ...]

    def __call__(self, points: FloatArray) -> FloatArray:
        low = np.array([one.low for one in self.errors])
        high = np.array([one.high for one in self.errors])
        return np.asarray(np.linalg.norm((low + points * (high - low)) @ self.root.T, axis=-1)[:, None])


def cure_errors(grinding: Grinding, grid: FlankGrid, plan: Plan, model: ErrorModel) -> tuple[CureRecord, ...]:
    """What cures each error of a machine, an unknown one as large as it may be; the largest first."""
    found = cures(grinding, grid, [one.parameter for one in errors_of(grinding, plan, model)])
    records = (CureRecord(one.error, float(mm_to_um(one.rms)), _by(one), float(mm_to_um(one.floor))) for one in found)
    return tuple(sorted(records, key=lambda one: -one.rms_um))


def _by(cure: Cure) -> str:
    """The simplest cure; where none does it all, the simplest that takes more than half, "in part"."""
    if cure.by != "mechanical only":
        return cure.by
    helping = (family for family, left in cure.left.items() if left <= PART * cure.rms)
    return next((f"{family} in part" for family in helping), cure.by)
