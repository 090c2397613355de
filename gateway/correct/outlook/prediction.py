"""The flank after a correction as it is to be expected, and how far it may lie from that, point by point and in all.

What u is: the model's errors may be wrong (covariances of the fits, systematic parts, spans of what was not measured,
structure between targets), less what x zero, C zero and dressing offset will take because they are set from an
inspected part; the zeros as that part tells them; a blank's clamping; repeatability; the zeros' drift. Each is taken
for normal and, pattern by pattern, for independent of the others: errors measured with one instrument share only what
`next_setup.doubts` knows they share. What u is not: what the inspection machine adds when somebody looks (its own
uncertainty comes on top), a worn or wrongly dressed wheel, heat that bends the machine, anything of second order in
the doubts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from drivers.types.values import FloatArray
from drivers.units import AxisUnit, mm_to_um
from gateway.correct.flank.flank_model import FlankModel, Places, command_effects
from gateway.correct.outlook.flank_uncertainty import (
    THRESHOLD_UM,
    FlankDoubts,
    ProcessUncertainty,
    between_targets,
    near,
    nodes_of,
    part_specific_doubts,
    persistent_doubts,
)
from gateway.correct.plan.layers import LayeredCorrection
from gateway.correct.plan.plan import Plan
from gateway.domain.figures import Component
from gateway.domain.proposals import Chance
from gateway.domain.values import COVERAGE
from gateway.gear.first_order import bounded_first_order
from gateway.gear.flank import FlankGrid, flank_figure
from gateway.gear.grinding import Grinding
from gateway.gear.process_drift import set_right
from gateway.model.error_model import ErrorModel
from gateway.tooth import FlankMap, FlankPrediction

DRAWS = 4000


@dataclass(frozen=True, slots=True)
class Prediction:
    """A prediction, and what the tooth's tables gain: RMS with axis tables alone less RMS after, both set right, um.

    ``gain_u_um`` is the standard deviation of that gain, for both flanks have the same doubts; ``worse`` is how likely
    the flank gets worse (0 to 1). ``steps_um`` are nominal RMS and its standard uncertainty, set right: as it is, with
    axis tables, with everything; the nominal ones are of the known errors alone, u of all doubts (`FlankPrediction`).
    """

    flank: FlankPrediction
    gain_um: float
    gain_u_um: float
    worse: float
    steps_um: tuple[tuple[float, float], ...] = ()

    @property
    def sure(self) -> bool:
        """Whether the flank gets better by more than the gain's uncertainty (k = 2)."""
        return self.gain_um > COVERAGE * self.gain_u_um

    @property
    def worth(self) -> bool:
        """Whether the gain is more than its standard uncertainty and harm unlikely: the rule of an axis' own table."""
        return self.sure or Chance(self.gain_um, self.gain_u_um, self.worse).worth


def predict(
    grinding: Grinding,
    grid: FlankGrid,
    plan: Plan,
    model: ErrorModel,
    found: LayeredCorrection,
    shop: ProcessUncertainty,
    *,
    seed: int = 1,
    draws: int = DRAWS,
) -> Prediction:
    """What a correction of a fitted machine will leave; maps to second order, doubts to first.

    ``after`` is the flank with the work where it sits and the set-up values right, as the trial part will make them.
    """
    gear = grid.gear
    before, with_own, plain = (flank_map(one, grid) for one in (grinding, found.machine_with_own, found.unmoved))
    after = set_right(plain, gear)
    doubt = without_setup(grinding, persistent_doubts(grinding, grid, plan=plan, model=model, shop=shop)).plus(
        part_specific_doubts(grinding, grid, shop)
    )
    doubt = without_rotation(doubt)
    steps = (set_right(before, gear), set_right(with_own, gear), after)
    drawn = _Drawn.of(doubt, steps, seed, draws)
    flank = FlankPrediction(
        before=before,
        with_own=with_own,
        after=after,
        floor_um=float(mm_to_um(found.best.rms)),
        u_um=float(np.sqrt(np.sum(drawn.squares) / doubt.places.points)),
        u_point_um=point_u_um(doubt).reshape(grid.shape),
        rms_um=float(np.mean(drawn.rms[2])),
        rms_u_um=float(np.std(drawn.rms[2])),
        parts_um=_parts(doubt, drawn.squares),
    )
    gains = drawn.rms[1] - drawn.rms[2]
    told = tuple(
        (one.rms_um, float(np.sqrt(np.mean((rms - one.rms_um) ** 2))))
        for one, rms in zip(steps, drawn.rms, strict=True)
    )
    return Prediction(
        flank,
        gain_um=float(np.mean(gains)),
        gain_u_um=float(np.std(gains)),
        worse=float(np.mean(gains < 0.0)),
        steps_um=told,
    )


def flank_map(grinding: Grinding, grid: FlankGrid) -> FlankMap:
    """A machine's flank to second order, um, one rotation removed."""
    e = np.broadcast_to(bounded_first_order(grinding, grid.k, grid.theta, grid.z).second, grid.shape)
    rest = e - flank_figure(e, grid.section.h).rotation * grid.section.h
    return FlankMap(grid.thetas, grid.zs, np.asarray(mm_to_um(rest)))


def without_rotation(doubt: FlankDoubts) -> FlankDoubts:
    """Patterns less one rotation of the gear each, as the flank figure counts them."""
    return less(doubt, [_turn(doubt.places)])


def without_setup(grinding: Grinding, doubt: FlankDoubts) -> FlankDoubts:
    """Patterns less what x zero, dressing offset and C zero take of each, by least squares over the flank."""
    return less(doubt, setup_effects(grinding, doubt.places))


def setup_effects(grinding: Grinding, places: Places) -> list[FloatArray]:
    """A, B, G (G, 3) of x zero, dressing offset and C zero, one unit each."""
    infeed = command_effects(grinding, places)[grinding.infeed]
    offset = np.broadcast_to(np.array([0.0, 1.0, 0.0]), infeed.shape)
    return [infeed, offset, _turn(places)]


def less(doubt: FlankDoubts, effects: list[FloatArray]) -> FlankDoubts:
    """Patterns less their least-squares share of effects (G, 3) each."""
    columns = np.stack(effects, axis=-1)
    rows, wide = _rows(doubt.places, doubt.patterns), _rows(doubt.places, columns)
    share = np.linalg.lstsq(wide, rows, rcond=None)[0]
    return FlankDoubts(doubt.places, doubt.sources, doubt.patterns - columns @ share)


def point_u_um(doubt: FlankDoubts) -> FloatArray:
    """Standard uncertainty of each point (N,), um."""
    spread = np.einsum("gis,gjs->gij", doubt.patterns, doubt.patterns)
    form = doubt.places.form
    return np.asarray(mm_to_um(np.sqrt(np.einsum("ni,nij,nj->n", form, spread[doubt.places.of], form))))


def rows_of(doubt: FlankDoubts) -> FloatArray:
    """The patterns (R, S) in rows whose sum of squares is the points' number times the mean square, mm."""
    return _rows(doubt.places, doubt.patterns)


def _turn(places: Places) -> FloatArray:
    return np.broadcast_to(np.array([0.0, 0.0, 1.0]), (places.k.size, 3))


def _rows(places: Places, patterns: FloatArray) -> FloatArray:
    return _plain(places).compressed(patterns)


def _plain(places: Places) -> FlankModel:
    return FlankModel(places, np.zeros((places.k.size, 3)), np.zeros(places.points), (), turning=False)


def _parts(doubt: FlankDoubts, squares: FloatArray) -> dict[str, float]:
    """RMS of each source, the largest first, um."""
    sums: dict[str, float] = {}
    for name, square in zip(doubt.sources, squares, strict=True):
        sums[name] = sums.get(name, 0.0) + float(square) / doubt.places.points
    return {name: value**0.5 for name, value in sorted(sums.items(), key=lambda item: -item[1])}


@dataclass(frozen=True)
class _Drawn:
    """Sums of squares (S,) of the patterns, um2, and RMS (draws,) of each flank with the same drawn doubts, um."""

    squares: FloatArray
    rms: tuple[FloatArray, ...]

    @staticmethod
    def of(doubt: FlankDoubts, flanks: tuple[FlankMap, ...], seed: int, draws: int) -> _Drawn:
        """Draw the doubts; everything in as few rows as carry it."""
        plain = _plain(doubt.places)
        nothing = np.zeros((doubt.places.k.size, 3))
        known = np.stack([plain.compressed(nothing, flank.deviation_um.ravel()) for flank in flanks], axis=-1)
        patterns = np.asarray(mm_to_um(rows_of(doubt)))
        short = np.asarray(np.linalg.qr(np.concatenate([patterns, known], axis=1), mode="r"))
        count = patterns.shape[1]
        drawn = short[:, :count] @ np.random.default_rng(seed).standard_normal((count, draws))
        points = doubt.places.points
        rms = []
        for i, flank in enumerate(flanks):
            lost = max(float(np.sum(flank.deviation_um**2)) - float(np.sum(known[:, i] ** 2)), 0.0)
            rest = short[:, count + i, None] + drawn
            rms.append(np.sqrt((np.einsum("rd,rd->d", rest, rest) + lost) / points))
        return _Drawn(np.sum(patterns**2, axis=0), tuple(rms))


# ---- Which cross tables are worth loading together: all, or what is left when those that may do harm are taken out.
#
# One error that is hardly known would else take tables away that cure what is known well.

Worked = tuple[LayeredCorrection, Prediction]


@dataclass(frozen=True)
class CrossTableSelection:
    """What is proposed and its outlook; ``whole`` is the outlook of all the cross tables that the plan allowed.

    ``left_out`` names the tables (output first, as X(Z)) that were taken out because with them harm is too likely.
    """

    found: LayeredCorrection
    outlook: Prediction
    whole: Prediction
    left_out: tuple[str, ...] = ()

    @property
    def told(self) -> Prediction:
        """The outlook that says why cross tables are proposed, or why none is."""
        return self.outlook if self.found.optimum.tables else self.whole


def select_cross_tables(plan: Plan, work_out: Callable[[Plan], Worked]) -> CrossTableSelection:
    """The cross tables of the plan that are worth it together, one after the other taken out until they are.

    ``work_out`` gives correction and outlook of a plan. Of those that could go next, the one goes without which the
    rest is worth it and gains most; where none is so, the one without which harm is least likely.
    """
    found, outlook = work_out(plan)
    whole, cross = outlook, plan.cross
    while found.optimum.tables and not outlook.worth:
        acting = {table.grid.name for table in found.optimum.tables}
        rest = [tuple(one for one in cross if one != out) for out in cross if _name(out) in acting]
        tried = [(left, *work_out(replace(plan, cross=left))) for left in rest]
        cross, found, outlook = max(tried, key=lambda one: _rank(one[1], one[2]))
    gone = tuple(_name(one) for one in plan.cross if one not in cross)
    return CrossTableSelection(found, outlook, whole, gone if found.optimum.tables else ())


def _name(cross: tuple[str, str]) -> str:
    return f"{cross[0]}({cross[1]})"


def _rank(found: LayeredCorrection, outlook: Prediction) -> tuple[bool, float]:
    worth = bool(found.optimum.tables) and outlook.worth
    return worth, outlook.gain_um if worth else -outlook.worse


# ---- The measured error that makes most of the flank's uncertainty: are its targets too coarse, and what cures that.
#
# Targets h apart show no wave shorter than 2 h, and straight lines leave (pi s / 2 h)^2 / 2 of that once targets stand
# s apart. So a step over the face is found at which the error no longer matters.

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
class DominantError:
    """One measured error whose doubt is more than half of the flank's u squared, um RMS.

    ``window`` cures it; None where its targets are fine enough and noise or the instrument make its doubt.
    """

    name: str
    part_um: float
    u_um: float
    window: FinerTargets | None


def diagnose_sampling(
    grinding: Grinding, grid: FlankGrid, model: ErrorModel, flank: FlankPrediction
) -> DominantError | None:
    """The error to measure better, if one makes most of the doubt and enough to matter; None else."""
    motions = {one.name: one for one in model.motions}
    name, part = max(flank.parts_um.items(), key=lambda item: item[1], default=("", 0.0))
    if name not in motions or part <= THRESHOLD_UM or part**2 <= DOMINATES * flank.u_um**2:
        return None
    unseen = _unseen_um(grinding, grid, motions[name])
    coarse = unseen**2 > DOMINATES * part**2
    return DominantError(name, part, flank.u_um, _window(grinding, grid, motions[name], unseen) if coarse else None)


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
        ((n, share) for n in range(FEWEST, MOST) if (share := _remaining_share(one, face, middle, face / n)) <= CURED),
        (MOST, _remaining_share(one, face, middle, face / MOST)),
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


def _remaining_share(one: Component, face: float, middle: float, step: float) -> float:
    """The share of what lies between the targets that stays there with others ``step`` apart; all of it at most.

    The shortest wave that targets show is twice their distance. A smooth fit does not keep that: down to the face.
    """
    here = near(one, face, middle)
    shortest = face if here is None else 2.0 * float(np.mean(np.diff(nodes_of(one)[here])))
    return min((pi * step / shortest) ** 2 / 2.0, 1.0)
