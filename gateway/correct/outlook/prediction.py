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

from dataclasses import dataclass

import numpy as np

from drivers.types.values import FloatArray
from drivers.units import mm_to_um
from gateway.correct.flank.flankmodel import FlankModel, command_effects
from gateway.correct.flank.wheel_places import Places
from gateway.correct.outlook.flank_uncertainty import FlankDoubts, Shop, lasting, passing
from gateway.correct.plan.layers import LayeredCorrection
from gateway.correct.plan.plan import Plan
from gateway.domain.values import COVERAGE
from gateway.gear.first_order import judged
from gateway.gear.flank import FlankGrid, flank_figure
from gateway.gear.grinding import Grinding
from gateway.gear.setright import set_right
from gateway.model.known import ErrorModel
from gateway.table.chances import Chance
from gateway.tooth import FlankMap, FlankPrediction

DRAWS = 4000


@dataclass(frozen=True, slots=True)
class Outlook:
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
    shop: Shop,
    *,
    seed: int = 1,
    draws: int = DRAWS,
) -> Outlook:
    """What a correction of a fitted machine will leave; maps to second order, doubts to first.

    ``after`` is the flank with the work where it sits and the set-up values right, as the trial part will make them.
    """
    gear = grid.gear
    before, with_own, plain = (flank_map(one, grid) for one in (grinding, found.machine_with_own, found.unmoved))
    after = set_right(plain, gear)
    doubt = without_setup(grinding, lasting(grinding, grid, plan=plan, model=model, shop=shop)).plus(
        passing(grinding, grid, shop)
    )
    doubt = unturned(doubt)
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
    return Outlook(
        flank,
        gain_um=float(np.mean(gains)),
        gain_u_um=float(np.std(gains)),
        worse=float(np.mean(gains < 0.0)),
        steps_um=told,
    )


def flank_map(grinding: Grinding, grid: FlankGrid) -> FlankMap:
    """A machine's flank to second order, um, one rotation removed."""
    e = np.broadcast_to(judged(grinding, grid.k, grid.theta, grid.z).second, grid.shape)
    rest = e - flank_figure(e, grid.section.h).rotation * grid.section.h
    return FlankMap(grid.thetas, grid.zs, np.asarray(mm_to_um(rest)))


def unturned(doubt: FlankDoubts) -> FlankDoubts:
    """Patterns less one rotation of the gear each, as the flank figure counts them."""
    return less(doubt, [_turn(doubt.places)])


def without_setup(grinding: Grinding, doubt: FlankDoubts) -> FlankDoubts:
    """Patterns less what x zero, dressing offset and C zero take of each, by least squares over the flank."""
    infeed = command_effects(grinding, doubt.places)[grinding.infeed]
    offset = np.broadcast_to(np.array([0.0, 1.0, 0.0]), infeed.shape)
    return less(doubt, [infeed, offset, _turn(doubt.places)])


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
