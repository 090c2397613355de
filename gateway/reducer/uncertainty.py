"""How far a drive's figures may lie from what is stated: the full model on drawn pins, cranks, datum and flanks; pure.

A Monte Carlo in the sense of JCGM 101: every trial draws what nobody measured from its tolerance (`Tolerances`: pin
radius and place, eccentricity, holes, and the datum of the flanks where it is not the crank holes) and a flank by the
caller, who knows its covariance (the machine's model, or an inspection). What was measured, and so is given with the
drive, is not drawn. Peak to peak grows with anything that scatters: so the mean of the trials is the expected figure,
and it lies above that of the parts as given. The number of trials is adaptive: blocks of trials until the blocks'
means agree within a share of each u, or the most that was asked.

Trials use three slices, and every fourth crank angle for lost motion: on drives of this project the figures differ by
less than 1 % from the whole model's, far below u.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import erf, sqrt

import numpy as np
from numpy.random import Generator

from drivers.types.values import FloatArray
from drivers.units import rad_to_arcsec
from gateway.errors import ModelError
from gateway.reducer.contact import Assembly
from gateway.reducer.figures import LOST_MOTION, crank_angles
from gateway.reducer.records import Cranks, OutputPins, Pins, Reducer
from gateway.tooth import FlankMap

Draw = Callable[[Generator], Sequence[FlankMap | None]]
SLICES, EVERY = 3, 4
BLOCK, FEWEST_BLOCKS, MOST = 5, 3, 80
SHARE = 0.2  # of u: how well the mean is known when the trials end
FIGURES = ("error_arcsec", "rms_arcsec", "lost_motion_arcsec")
PROBABILITY = 0.95


@dataclass(frozen=True, slots=True)
class Expected:
    """One figure: mean and standard uncertainty of the trials, and the interval (low, high) that holds 95 % of them."""

    mean: float
    u: float
    low: float
    high: float

    def share_within(self, limit: float) -> float:
        """Probability that the figure is at most ``limit``, by a normal distribution of mean and u."""
        if self.u == 0.0:
            return float(self.mean <= limit)
        return float(_normal((limit - self.mean) / self.u))


@dataclass(frozen=True, slots=True)
class DriveUncertainty:
    """Figures by name (`FIGURES`) in arcsec, from that many trials of a seed; ``settled`` where the means were."""

    figures: dict[str, Expected]
    trials: int
    seed: int
    settled: bool


def uncertainty(
    drive: Reducer,
    flanks: Draw | Sequence[FlankMap | None],
    *,
    torque_nm: float | None = None,
    steps: int | None = None,
    seed: int = 1,
    most: int = MOST,
) -> DriveUncertainty:
    """Monte Carlo of a drive; ``flanks`` are its discs, or a function that draws them. The same seed, the same figures.

    Raises ModelError E-REDUCER-TRIALS for fewer trials than three blocks, and as `Assembly` does.
    """
    if most < FEWEST_BLOCKS * BLOCK:
        raise ModelError("E-REDUCER-TRIALS", drive.name, trials=most, fewest=FEWEST_BLOCKS * BLOCK)
    draw: Draw = flanks if callable(flanks) else lambda _rng: flanks
    torque = drive.rated_nm if torque_nm is None else torque_nm
    alpha, rng = crank_angles(drive, steps), np.random.default_rng(seed)
    rows: list[FloatArray] = []
    settled = False
    while not settled and len(rows) + BLOCK <= most:
        rows += [_trial(drawn_drive(drive, rng), draw(rng), alpha, torque) for _ in range(BLOCK)]
        settled = _settled(np.array(rows))
    values = np.array(rows)
    edges = np.quantile(values, [(1.0 - PROBABILITY) / 2.0, (1.0 + PROBABILITY) / 2.0], axis=0)
    found = {
        name: Expected(
            mean=float(values[:, i].mean()),
            u=float(values[:, i].std(ddof=1)),
            low=float(edges[0, i]),
            high=float(edges[1, i]),
        )
        for i, name in enumerate(FIGURES)
    }
    return DriveUncertainty(found, len(rows), seed, settled)


def _settled(values: FloatArray) -> bool:
    """Whether two blocks or more agree: the scatter of their means is below a share of u, for every figure."""
    blocks = values.reshape(-1, BLOCK, values.shape[1]).mean(axis=1)
    if len(blocks) < FEWEST_BLOCKS:
        return False
    scatter = blocks.std(axis=0, ddof=1) / np.sqrt(len(blocks))
    return bool(np.all(scatter <= SHARE * values.std(axis=0, ddof=1)))


def drawn_drive(drive: Reducer, rng: Generator) -> Reducer:
    """The drive with what nobody measured drawn from its tolerances; the datum moves all holes of a disc together."""
    size, pins, out = drive.tolerances, drive.pins, drive.output
    count, discs = pins.number, len(drive.discs)

    def normal(given: tuple[float, ...], sigma: float) -> tuple[float, ...]:
        return given or tuple((sigma * rng.normal(size=count)).tolist())

    ring = Pins(
        number=count,
        circle_mm=pins.circle_mm,
        radius_mm=pins.radius_mm,
        radius_um=normal(pins.radius_um, size.pin_radius_um),
        radial_um=normal(pins.radial_um, size.pin_place_um),
        tangential_um=normal(pins.tangential_um, size.pin_place_um),
    )
    if drive.rigid:
        return replace(drive, pins=ring)
    hole = np.zeros((discs, out.number, 2))
    if out.hole_um:
        hole += np.asarray(out.hole_um)
    else:
        hole += size.hole_um * rng.normal(size=hole.shape)
    if drive.datum != "crank-holes":
        hole += size.datum_um * rng.normal(size=(discs, 1, 2))
    holes = tuple(tuple((float(x), float(y)) for x, y in one) for one in hole)
    drawn: Cranks | OutputPins = replace(out, hole_um=holes)
    if isinstance(drawn, Cranks) and not drawn.eccentricity_um:
        a = size.eccentricity_um * rng.normal(size=(discs, drawn.number))
        drawn = replace(drawn, eccentricity_um=tuple(tuple(one) for one in a.tolist()))
    return replace(drive, pins=ring, output=drawn)


@dataclass(frozen=True, slots=True)
class Essentials:
    """Loaded transmission error p-p and RMS of the worse sense, and mean lost motion; arcsec, by the full model."""

    error_arcsec: float
    rms_arcsec: float
    lost_motion_arcsec: float


def essentials(
    drive: Reducer,
    flanks: Sequence[FlankMap | None],
    *,
    torque_nm: float | None = None,
    steps: int | None = None,
    slices: int = SLICES,
) -> Essentials:
    """The figures that goals and trials are about, without the way down to no load."""
    torque = drive.rated_nm if torque_nm is None else torque_nm
    return Essentials(*_trial(drive, flanks, crank_angles(drive, steps), torque, slices=slices).tolist())


def _trial(
    drive: Reducer, flanks: Sequence[FlankMap | None], alpha: FloatArray, torque: float, *, slices: int = SLICES
) -> FloatArray:
    """Loaded error peak to peak and RMS of the worse sense, mean lost motion; arcsec."""
    assembly = Assembly(drive, flanks, slices=slices)
    poses = [assembly.solve(alpha, sense * torque) for sense in (1.0, -1.0)]
    curves = [rad_to_arcsec(pose.psi) for pose in poses]
    soft, rows = LOST_MOTION * drive.rated_nm, slice(None, None, EVERY)
    plus, minus = (
        assembly.solve(alpha[rows], sense * soft, pose.at(rows)).psi
        for sense, pose in zip((1.0, -1.0), poses, strict=True)
    )
    worst = max(float(np.ptp(curve)) for curve in curves)
    return np.array([worst, max(float(np.std(curve)) for curve in curves), float(np.mean(rad_to_arcsec(plus - minus)))])


def _normal(x: float) -> float:
    return 0.5 * (1.0 + erf(x / sqrt(2.0)))
