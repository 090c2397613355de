"""The drive in a study: what each error alone and each correction make of it, and Morris' ranking in arcsec.

Each error alone and the ranking are first order about the mean drive, one matrix on the 21 errors; the figures of the
machine as it is, with axis tables and with everything come from the full model. All discs are the same part.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from drivers.types.values import FloatArray
from drivers.units import mm_to_um
from gateway.correct.outlook.drive_outlook import costliest
from gateway.correct.outlook.flank_uncertainty import FlankDoubts
from gateway.gear.cycloid import CycloidGear
from gateway.gear.first_order import ErrorParameter, linear_flank
from gateway.gear.flank import FlankGrid
from gateway.gear.grinding import Grinding
from gateway.reducer import records
from gateway.reducer.figures import Transmission, transmission, without_limit
from gateway.reducer.firstorder import MachineTransmission, lost_motion_map, transmission_map
from gateway.sensitivity.outputs import equal_size
from gateway.sensitivity.screening import ScreeningResult, screen
from gateway.study.inputs import ReducerData
from gateway.tooth import DriveDoubt, FlankMap

DRIVE_OUTPUTS = ("transmission", "lost motion")


@dataclass(frozen=True, slots=True)
class Constant:
    """A motion that is the same everywhere; plain data."""

    value: float

    def __call__(self, q: FloatArray) -> FloatArray:
        """Values at q, same shape."""
        return np.full_like(q, self.value)


@dataclass(frozen=True, slots=True)
class DriveAlone:
    """One error alone by the first order: a constant of the paper's size, and ``here`` this machine's own motion.

    Transmission error p-p, and change of the mean lost motion, arcsec. A constant is alike in every space and moves the
    lost motion; what changes round the table makes the transmission error.
    """

    name: str
    error_arcsec: float
    lost_motion_arcsec: float
    here_error_arcsec: float
    here_rms_arcsec: float
    here_lost_motion_arcsec: float


@dataclass(frozen=True)
class DriveStudy:
    """What a study found of the drive. ``states`` by the names of the flank's: before, with_own, after.

    ``missed_arcsec`` is how far the first order's p-p lies from the full model's, machine as it is. ``doubts`` are
    what not knowing each error better costs, the costliest first.
    """

    reducer: records.Reducer
    alone: tuple[DriveAlone, ...]
    ranking: ScreeningResult
    states: Mapping[str, Transmission]
    missed_arcsec: float
    doubts: tuple[DriveDoubt, ...] = ()


@dataclass(frozen=True)
class DriveOutputs:
    """`DRIVE_OUTPUTS` (n, 2) of points (n, d) of the unit cube: error p-p, size of the change of lost motion; arcsec.

    A point says how much of each error's own motion acts. Plain data with a call: can be sent to another process.
    """

    matrix: FloatArray
    lost: FloatArray

    def __call__(self, points: FloatArray) -> FloatArray:
        """Outputs of the points."""
        error = MachineTransmission(self.matrix, np.zeros(self.matrix.shape[0])).peak_to_peak_arcsec(points.T)
        return np.stack([error, np.abs(points @ self.lost)], axis=-1)


def reducer_of(data: ReducerData, gear: CycloidGear) -> records.Reducer:
    """The drive of a gear file's [reducer]: defaults by the gear's size, with what the file gives instead.

    Raises ModelError E-REDUCER-...
    """
    drive = records.for_gear(gear, data.datum, rated_nm=data.rated_nm, name=data.name)
    return records.told(drive, data.model_dump(exclude={"name", "datum", "rated_nm"}, exclude_none=True))


def drive_study(
    drive: records.Reducer,
    grinding: Grinding,
    grid: FlankGrid,
    *,
    names: tuple[str, ...],
    states: Mapping[str, FloatArray],
    r: int,
    seed: int,
    executor: Executor | None = None,
    doubt: FlankDoubts,
    measured: Collection[str] = (),
) -> DriveStudy:
    """Work out the drive of a study; ``states`` are flanks (K, T, Z) in mm by name.

    ``doubt`` is how the errors may be wrong; ``measured`` are those that were measured.
    """
    free = without_limit(drive)
    maps = {name: flank_map(grid, e) for name, e in states.items()}
    before = maps["before"]
    found = transmission_map(free, before)
    sizes = np.array([equal_size(name) for name in names])
    steps = linear_flank(grinding, grid, names).jacobian() * sizes
    motions = linear_flank(grinding, grid, [_own(grinding, name) for name in names]).jacobian()
    lost = lost_motion_map(free, before)
    matrix = found.rows(motions)
    here = lost @ mm_to_um(motions)
    alone = zip(names, found.rows(steps).T, lost @ mm_to_um(steps), matrix.T, here, strict=True)
    full = {name: transmission(free, [one] * len(drive.discs)) for name, one in maps.items()}
    first = float(np.ptp(found.curve([before] * len(drive.discs))))
    return DriveStudy(
        reducer=drive,
        alone=tuple(_alone(*one) for one in alone),
        ranking=screen(DriveOutputs(matrix, here), names, DRIVE_OUTPUTS, r=r, seed=seed, executor=executor),
        states=full,
        missed_arcsec=first - full["before"].loaded[0].peak_to_peak_arcsec,
        doubts=costliest(drive, grinding, grid, doubt=doubt, measured=measured),
    )


def flank_map(grid: FlankGrid, deviation: FloatArray) -> FlankMap:
    """Deviations (K, T, Z) in mm on a grid as a map in um."""
    return FlankMap(grid.thetas, grid.zs, mm_to_um(np.broadcast_to(deviation, grid.shape)))


def _own(grinding: Grinding, name: str) -> ErrorParameter:
    """This machine's own motion of that error as one parameter of size 1; a constant is its value."""
    axis, key = grinding.chain.error_place(name)
    one = grinding.chain.axis(axis)
    motion = one.err.get(key, one.loc.get(key, 0.0))
    return ErrorParameter(name, motion if callable(motion) else Constant(float(motion)))


def _alone(name: str, step: FloatArray, lost: float, own: FloatArray, own_lost: float) -> DriveAlone:
    return DriveAlone(
        name=name,
        error_arcsec=float(np.ptp(step)),
        lost_motion_arcsec=float(lost),
        here_error_arcsec=float(np.ptp(own)),
        here_rms_arcsec=float(np.std(own)),
        here_lost_motion_arcsec=float(own_lost),
    )


def drive_rows(study: DriveStudy) -> Sequence[tuple[str, ...]]:
    """Every error alone: transmission error and lost motion by first order, and its rank in arcsec."""
    rank = {one.name: one for one in study.ranking.rankings["transmission"]}
    return [
        (
            one.name,
            f"{one.error_arcsec:.2f}",
            f"{one.lost_motion_arcsec:+.2f}",
            f"{one.here_error_arcsec:.2f}",
            f"{one.here_lost_motion_arcsec:+.2f}",
            f"{rank[one.name].rank_low}-{rank[one.name].rank_high}"
            if rank[one.name].rank_low != rank[one.name].rank_high
            else str(rank[one.name].rank),
        )
        for one in study.alone
    ]


def state_rows(study: DriveStudy) -> Sequence[tuple[str, ...]]:
    """Each figure of the drive as it is, with axis tables, with everything, by the full model."""
    figures: dict[str, tuple[str, Callable[[Transmission], float]]] = {
        "transmission error": ("arcsec", lambda t: t.error_arcsec),
        "transmission error at no load": ("arcsec", lambda t: t.unloaded_arcsec),
        "transmission error RMS": ("arcsec", lambda t: t.rms_arcsec),
        "lost motion, without friction": ("arcsec", lambda t: t.lost_motion),
        "backlash": ("arcsec", lambda t: t.backlash),
        "stiffness": ("Nm/arcmin", lambda t: t.stiffness_nm_arcmin),
        "surplus squeezed": ("um", lambda t: t.interference_um),
    }
    states = [study.states[name] for name in ("before", "with_own", "after")]
    return [(key, *(f"{take(one):.2f}" for one in states), unit) for key, (unit, take) in figures.items()]


def drive_data(study: DriveStudy) -> dict[str, object]:
    """Plain data."""
    return {
        "reducer": study.reducer.name,
        "datum": study.reducer.datum,
        "predicted_not_tested": True,
        "first_order_misses_arcsec": study.missed_arcsec,
        "one_at_a_time": {
            one.name: {
                "transmission_arcsec": one.error_arcsec,
                "lost_motion_arcsec": one.lost_motion_arcsec,
                "here_transmission_arcsec": one.here_error_arcsec,
                "here_transmission_rms_arcsec": one.here_rms_arcsec,
                "here_lost_motion_arcsec": one.here_lost_motion_arcsec,
            }
            for one in study.alone
        },
        "ranking": {
            output: [
                {"name": one.name, "rank": one.rank, "mu_star_arcsec": one.mu_star, "sigma_arcsec": one.sigma}
                for one in study.ranking.rankings[output]
            ]
            for output in DRIVE_OUTPUTS
        },
        "states": {name: _state(one) for name, one in study.states.items()},
        "doubts": [
            {"error": one.error, "cost_arcsec": one.cost_arcsec, "measured": one.measured} for one in study.doubts
        ],
    }


def _state(one: Transmission) -> dict[str, object]:
    return {
        "transmission_arcsec": one.error_arcsec,
        "transmission_unloaded_arcsec": one.unloaded_arcsec,
        "transmission_rms_arcsec": one.rms_arcsec,
        "lost_motion_arcsec": one.lost_motion,
        "backlash_arcsec": one.backlash,
        "stiffness_nm_arcmin": one.stiffness_nm_arcmin,
        "interference_um": one.interference_um,
        "orders": [[order.number, order.amplitude_arcsec, order.cause] for order in one.orders()],
    }
