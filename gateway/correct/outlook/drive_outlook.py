"""The drive that a corrected machine's discs will make: what each goal costs in the other, expected figures, verdicts.

All figures here are the full model's: the machine's flank to second order, in every disc alike. For the choice between
goals `essentials` is enough (three slices, lost motion at every fourth crank angle). What is expected, with its u,
draws the flank by how the errors may be wrong and pins, cranks and datum by their tolerances.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.random import Generator

from drivers.types.tables import CompensationTable
from drivers.types.values import FloatArray
from drivers.units import mm_to_um
from gateway.correct.flank.flank_model import Places
from gateway.correct.outlook.flank_uncertainty import FlankDoubts
from gateway.correct.plan.layers import LayeredCorrection, correct
from gateway.correct.plan.plan import Plan
from gateway.domain.values import COVERAGE
from gateway.evaluate.standards.conformity import decide
from gateway.gear.first_order import bounded_first_order
from gateway.gear.flank import FlankGrid, flank_figure
from gateway.gear.grinding import Grinding
from gateway.reducer.figures import without_limit
from gateway.reducer.firstorder import transmission_map
from gateway.reducer.goal import DriveGoal, GoalKind, goal_of
from gateway.reducer.records import Reducer
from gateway.reducer.uncertainty import SLICES, Draw, DriveUncertainty, essentials, uncertainty
from gateway.tooth import DriveDoubt, DriveForecast, DriveLimit, DriveProposal, FlankMap, GoalRow

GOALS: tuple[GoalKind, ...] = ("rms", "transmission", "lost-motion")
FIGURE = {"transmission_arcsec": "error_arcsec", "lost_motion_arcsec": "lost_motion_arcsec"}
TRIALS = 30


def drive_proposal(
    grinding: Grinding,
    grid: FlankGrid,
    plan: Plan,
    goal: DriveGoal,
    *,
    found: LayeredCorrection,
    wrong: FlankDoubts | None = None,
    live: Sequence[CompensationTable] = (),
    own: Sequence[CompensationTable] | None = None,
    doubts: Sequence[DriveDoubt] = (),
    steps: int | None = None,
    seed: int = 1,
    most: int = TRIALS,
) -> DriveProposal:
    """What a correction ``found`` for a goal makes of the drive, beside every other goal's tables on the same machine.

    ``wrong`` is how the machine's errors may be wrong (`error_doubts`); ``doubts`` are those of `costliest`, kept with
    it.
    ``steps`` per crank turn as in `crank_angles`, ``most`` trials. Raises ModelError E-REDUCER-...
    """
    drive = without_limit(goal.drive)
    rows = [
        _row(name, drive, machine, grid, steps=steps)
        for name, machine in (
            ("present state", grinding),
            ("axis tables", found.machine_with_own),
            *((kind, one.machine) for kind, one in _others(grinding, grid, plan, goal, live=live, own=own)),
            (f"this goal: {goal.kind}", found.machine),
        )
    ]
    expected = expected_drive(goal, found.machine, grid, wrong, steps=steps, seed=seed, most=most)
    figures = expected.figures
    limits = tuple(_limit(name, limit, expected) for name, limit in goal.limits.items())
    return DriveProposal(
        reducer=goal.drive.name,
        datum=goal.drive.measured_from(),
        goal=goal.kind,
        rows=tuple(rows),
        transmission_arcsec=figures["error_arcsec"].mean,
        transmission_u_arcsec=figures["error_arcsec"].u,
        lost_motion_arcsec=figures["lost_motion_arcsec"].mean,
        lost_motion_u_arcsec=figures["lost_motion_arcsec"].u,
        trials=expected.trials,
        limits=limits,
        doubts=tuple(doubts),
    )


def drive_forecast(
    drive: Reducer, machines: Sequence[tuple[str, Grinding]], grid: FlankGrid, doubts: Sequence[DriveDoubt] = ()
) -> DriveForecast:
    """The drive of some machines by their names, as their discs come, by the full model."""
    free = without_limit(drive)
    rows = tuple(_row(name, free, machine, grid, steps=None) for name, machine in machines)
    return DriveForecast(drive.name, drive.measured_from(), rows, tuple(doubts))


def costliest(
    drive: Reducer,
    machine: Grinding,
    grid: FlankGrid,
    *,
    doubt: FlankDoubts,
    measured: Collection[str],
    steps: int | None = None,
) -> tuple[DriveDoubt, ...]:
    """What each error's doubt costs in the drive, the costliest first.

    The patterns of ``doubt`` are independent; those of one error count by the root of the sum of squares of their
    transmission errors p-p, to first order about the machine's mean drive. What an error makes
    alike in every space moves the lost motion and costs nothing here.
    """
    if not doubt.sources:
        return ()
    sizes = np.ptp(transmission_rows(drive, machine, grid, doubt, steps=steps), axis=0)
    square: dict[str, float] = {}
    for name, size in zip(doubt.sources, sizes.tolist(), strict=True):
        square[name] = square.get(name, 0.0) + size**2
    order = sorted(square, key=lambda name: -square[name])
    return tuple(DriveDoubt(name, float(np.sqrt(square[name])), name in measured) for name in order)


def transmission_rows(
    drive: Reducer, machine: Grinding, grid: FlankGrid, doubt: FlankDoubts, *, steps: int | None = None
) -> FloatArray:
    """Transmission error (N, S) in arcsec that each pattern of a flank makes, first order about the mean drive."""
    found = transmission_map(without_limit(drive), _flank(machine, grid), steps=steps)
    patterns = np.moveaxis(doubt.patterns, -1, 0)
    moved = [doubt.places.along_normal(one) for one in patterns]
    return found.rows(np.stack(moved, axis=1) if moved else np.zeros((doubt.places.points, 0)))


def expected_drive(
    goal: DriveGoal,
    machine: Grinding,
    grid: FlankGrid,
    doubt: FlankDoubts | None,
    *,
    steps: int | None = None,
    seed: int = 1,
    most: int = TRIALS,
) -> DriveUncertainty:
    """Expected figures with u of the drives that a machine's discs make; all discs of a trial are one machine's.

    ``doubt`` is how its errors may be wrong (None: not at all); pins, cranks and datum are drawn as well.
    """
    drive = without_limit(goal.drive)
    plain = [_flank(machine, grid)] * len(drive.discs)
    discs = plain if doubt is None else drawn_flanks(plain, doubt.places, doubt.patterns)
    return uncertainty(drive, discs, steps=steps, seed=seed, most=most)


def drawn_flanks(plain: Sequence[FlankMap | None], places: Places, patterns: FloatArray) -> Draw:
    """A drive's discs as one machine makes them, drawn by how its errors may be wrong: patterns (G, 3, S) in mm.

    All discs that are there are wrong alike, for one machine ground them.
    """

    def draw(rng: Generator) -> list[FlankMap | None]:
        if not patterns.size:
            return list(plain)
        terms = patterns @ rng.normal(size=patterns.shape[-1])
        off = mm_to_um(places.along_normal(terms))
        return [
            None if one is None else replace(one, deviation_um=one.deviation_um + off.reshape(one.deviation_um.shape))
            for one in plain
        ]

    return draw


def drawn_apart(plain: Sequence[FlankMap | None], draws: Sequence[Draw]) -> Draw:
    """Discs that are wrong each for itself: every draw gives those that it knows, None for the others."""

    def draw(rng: Generator) -> list[FlankMap | None]:
        found = list(plain)
        for one in draws:
            found = [new or old for new, old in zip(one(rng), found, strict=True)]
        return found

    return draw


def _others(
    grinding: Grinding,
    grid: FlankGrid,
    plan: Plan,
    goal: DriveGoal,
    *,
    live: Sequence[CompensationTable],
    own: Sequence[CompensationTable] | None,
) -> list[tuple[str, LayeredCorrection]]:
    """The corrections for all goals but the one asked."""
    return [
        (kind, correct(grinding, grid, plan=replace(plan, goal=goal_of(kind, goal.drive)), live=live, own=own))
        for kind in GOALS
        if kind != goal.kind
    ]


def _row(name: str, drive: Reducer, machine: Grinding, grid: FlankGrid, *, steps: int | None) -> GoalRow:
    flank = _flank(machine, grid)
    found = essentials(drive, [flank] * len(drive.discs), steps=steps, slices=SLICES)
    return GoalRow(
        name=name,
        flank_um=mm_to_um(flank_figure(flank.deviation_um / mm_to_um(1.0), grid.section.h).rms),
        transmission_arcsec=found.error_arcsec,
        lost_motion_arcsec=found.lost_motion_arcsec,
    )


def _flank(machine: Grinding, grid: FlankGrid) -> FlankMap:
    e: FloatArray = np.broadcast_to(bounded_first_order(machine, grid.k, grid.theta, grid.z).second, grid.shape)
    return FlankMap(grid.thetas, grid.zs, mm_to_um(np.array(e)))


def _limit(name: str, limit: float, expected: DriveUncertainty) -> DriveLimit:
    one = expected.figures[FIGURE[name]]
    made = decide(name, one.mean, COVERAGE * one.u, limit)
    return DriveLimit(
        name=name, value_arcsec=one.mean, U_arcsec=COVERAGE * one.u, limit_arcsec=limit, verdict=made.verdict
    )
