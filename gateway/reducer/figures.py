"""The figures of a drive by the full model: transmission error and its orders, backlash, lost motion, stiffness; pure.

Definitions, with where they come from (what is not public is not claimed; no conformity with a standard is):

* Transmission error: output angle less input angle over the ratio, over one whole turn of the output in one sense of
  torque; its figure is the largest less the smallest value (makers' catalogues of strain-wave and servo drives). Here
  psi + alpha / zc, counter-clockwise positive, its mean removed. RMS over the whole turn. With the sun held or driven
  evenly (`Reducer.input_held`), as a customer measures, it is zc / (zp + z1/z2) of that with the crank held.
* Lost motion: change of the output angle between -3 % and +3 % of rated torque with the input locked (makers' wording
  of reducers for robots: mid points of the hysteresis loop's width). This model has no friction and no loop: it is
  psi(+3 %) - psi(-3 %), and so said. Few pins touch there: it is neither linear in the flank nor a mean over it.
* Backlash: the loop's width at zero torque; here psi(0+) - psi(0-), with 0.03 % of rated torque to settle the parts.
* Torsional stiffness: slope of the loop's straight part, here between 50 % and 100 % of rated torque, both senses.

Crank angles are whole steps of each crank turn over one output turn, so that orders are exact: order n counts per
turn of the output. A disc pattern m times round shows at m zp, for the loaded zone runs round the disc zp times a
turn; a ring pattern at m zc; what all spaces share at zp zc; lost contact mixes them to i zp + j zc.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from drivers.message import fixed
from drivers.types.values import FloatArray
from drivers.units import arcsec_to_rad, mm_to_um, rad_to_arcsec
from gateway.errors import ModelError
from gateway.reducer.contact import Assembly, Pose
from gateway.reducer.records import Reducer
from gateway.reducer.surfaces import SLICES
from gateway.tooth import FlankMap

STEPS, FEW_PINS_STEPS, FEW_PINS = 24, 96, 24
LOST_MOTION = 0.03  # of rated torque
SETTLED = 3e-4  # of rated torque: no load
LADDER = (LOST_MOTION, 3e-3, SETTLED)
STIFF_EVERY = 8  # crank angles between two where the stiffness is taken
MIXED = 6  # largest i and j of i zp + j zc that is named
ARCSEC_PER_ARCMIN = 60.0


@dataclass(frozen=True, slots=True)
class Order:
    """One order of a curve: number per turn of the output, amplitude and what causes it (`cause`)."""

    number: int
    amplitude_arcsec: float
    cause: str


@dataclass(frozen=True, slots=True)
class Curve:
    """Transmission error (N,) at equal steps of the crank over one output turn, mean removed, + counter-clockwise."""

    torque_nm: float
    error_arcsec: FloatArray

    @property
    def peak_to_peak_arcsec(self) -> float:
        """Largest less smallest."""
        return float(np.ptp(self.error_arcsec))

    @property
    def rms_arcsec(self) -> float:
        """By mean of squares over the whole turn."""
        return float(np.sqrt(np.mean(self.error_arcsec**2)))

    def amplitudes_arcsec(self) -> FloatArray:
        """Amplitude by order (N // 2 + 1,); the first is the mean."""
        spectrum = np.asarray(np.abs(np.fft.rfft(self.error_arcsec)), dtype=np.float64) / self.error_arcsec.size
        spectrum[1 : (self.error_arcsec.size + 1) // 2] *= 2.0
        return spectrum


@dataclass(frozen=True, slots=True)
class Transmission:
    """What a drive does. Pairs are the senses of torque: + (counter-clockwise on the output), then -.

    ``loaded`` at ``torque_nm``, ``unloaded`` at no load. ``backlash_arcsec`` and ``lost_motion_arcsec`` (N,) at each
    crank angle. ``touching`` (N, D) pins of each disc that bear under +torque, ``force_n`` and ``pressure_mpa`` the
    largest of any pin (N,) there. ``interference_um`` is the largest surplus squeezed at no load.
    """

    drive: Reducer
    torque_nm: float
    crank_rad: FloatArray
    loaded: tuple[Curve, Curve]
    unloaded: tuple[Curve, Curve]
    backlash_arcsec: FloatArray
    lost_motion_arcsec: FloatArray
    stiffness_nm_arcmin: float
    touching: FloatArray
    force_n: FloatArray
    pressure_mpa: FloatArray
    interference_um: float

    @property
    def error_arcsec(self) -> float:
        """Transmission error under load, peak to peak, the worse sense."""
        return max(curve.peak_to_peak_arcsec for curve in self.loaded)

    @property
    def unloaded_arcsec(self) -> float:
        """Transmission error at no load, peak to peak, the worse sense."""
        return max(curve.peak_to_peak_arcsec for curve in self.unloaded)

    @property
    def rms_arcsec(self) -> float:
        """RMS of the loaded error, the worse sense."""
        return max(curve.rms_arcsec for curve in self.loaded)

    @property
    def lost_motion(self) -> float:
        """Mean lost motion over the turn, arcsec; its range is that of ``lost_motion_arcsec``."""
        return float(np.mean(self.lost_motion_arcsec))

    @property
    def backlash(self) -> float:
        """Mean backlash over the turn, arcsec."""
        return float(np.mean(self.backlash_arcsec))

    def orders(self, most: int = 12, curve: Curve | None = None) -> tuple[Order, ...]:
        """The largest orders of a curve (the loaded one of + torque unless given), largest first."""
        sizes = (self.loaded[0] if curve is None else curve).amplitudes_arcsec()
        best = 1 + np.argsort(sizes[1:])[::-1][:most]
        count = self.crank_rad.size
        return tuple(Order(int(n), float(sizes[n]), cause(self.drive, int(n), count)) for n in best)


def cause(drive: Reducer, order: int, samples: int = 0) -> str:
    """What an order per output turn comes from, by its number: a name and, after a colon, the wave's number.

    "profile", "disc:m" (m times round the disc; unequal cranks too at m = 1), "ring:m", "mixed:i zp + j zc", "output"
    (1: carrier, flange, encoder), "cranks" (number of cranks), "input" (sun and its coupling), "folded" (zp zc or its
    neighbours beyond what ``samples`` a turn can show, by their place), "none".
    """
    zp, zc, ratio = drive.gear.zp, drive.gear.zc, drive.first_stage.ratio
    if order % (zp * zc) == 0:
        return "profile"
    if order % zp == 0 and order <= zp * zc // 2:
        return f"disc:{order // zp}"
    if samples and order in _folded(zp, zc, samples) and order > MIXED * zc:
        return "folded"
    if order % zc == 0:
        return f"ring:{order // zc}"
    if ratio and order in (round(ratio - 1.0), round(ratio)):
        return "input"
    if order == 1:
        return "output"
    for size in range(1, 2 * MIXED + 1):
        for i in range(-min(size, MIXED), min(size, MIXED) + 1):
            j = size - abs(i)
            for part in (j, -j):
                if abs(part) <= MIXED and i * zp + part * zc == order:
                    return f"mixed:{i} zp {part:+d} zc"
    return "cranks" if order == drive.output.number else "none"


def _folded(zp: int, zc: int, samples: int) -> set[int]:
    """Where zp zc, its multiples and what is m zp beside them appear among ``samples`` a turn."""
    wide = [n * zp * zc + m * zp for n in range(1, MIXED) for m in range(-MIXED, MIXED + 1)]
    return {abs(order - samples * round(order / samples)) for order in wide if order > samples // 2}


def crank_angles(drive: Reducer, steps: int | None = None) -> FloatArray:
    """Crank angles (N,) of one output turn in whole steps per crank turn. Raises ModelError E-REDUCER-STEPS.

    At least 24 steps, and 96 for drives of fewer than 24 pins, unless given. Whole steps keep every order exact.
    """
    usual = FEW_PINS_STEPS if drive.gear.zp < FEW_PINS else STEPS
    count = usual if steps is None else steps
    if count != int(count) or count < STEPS:
        raise ModelError("E-REDUCER-STEPS", drive.name, steps=count, fewest=STEPS)
    N = count * drive.gear.zc
    if drive.first_stage.error_arcsec and drive.first_stage.ratio >= N // 2:
        raise ModelError("E-REDUCER-STEPS", drive.name, steps=count, fewest=int(2 * drive.first_stage.ratio))
    return np.arange(N, dtype=np.float64) * (2.0 * np.pi / count)


def transmission(
    drive: Reducer,
    flanks: Sequence[FlankMap | None],
    *,
    torque_nm: float | None = None,
    steps: int | None = None,
    slices: int = SLICES,
) -> Transmission:
    """All figures of a drive with one flank map per disc (None: nominal) at a torque (rated unless given).

    Raises ModelError E-REDUCER-DATUM without the datum of the deviations, E-REDUCER-ASSEMBLY where the parts have
    more surplus than assembly can squeeze, E-REDUCER-TORQUE beyond the contact's limit.
    """
    torque = drive.rated_nm if torque_nm is None else torque_nm
    if not np.isfinite(torque) or torque < LOST_MOTION * drive.rated_nm:
        least = f"{LOST_MOTION * drive.rated_nm:g}"
        raise ModelError("E-REDUCER-LOAD", drive.name, torque=torque, least=least)
    alpha = crank_angles(drive, steps)
    assembly = Assembly(drive, flanks, slices=slices)
    loaded, soft, free = [], [], []
    rising = 0.0
    for sense in (1.0, -1.0):
        full = assembly.solve(alpha, sense * torque)
        rising += _stiffness(assembly, alpha, full, sense * torque)
        loaded.append(full)
        down = unloading(assembly, alpha, full, sense)
        soft.append(down[0])
        free.append(down[-1])
    squeezed = squeezed_um(free)
    if squeezed > drive.interference_um:
        limit = f"{drive.interference_um:g}"
        raise ModelError("E-REDUCER-ASSEMBLY", drive.name, interference=fixed(squeezed, 1), limit=limit)
    wave = _first_stage(drive, alpha)
    curves = [_curve(pose, s * torque, wave) for pose, s in zip(loaded, (1.0, -1.0), strict=True)]
    rest = [_curve(pose, s * SETTLED * drive.rated_nm, wave) for pose, s in zip(free, (1.0, -1.0), strict=True)]
    return Transmission(
        drive=drive,
        torque_nm=torque,
        crank_rad=alpha,
        loaded=(curves[0], curves[1]),
        unloaded=(rest[0], rest[1]),
        backlash_arcsec=rad_to_arcsec(free[0].psi - free[1].psi),
        lost_motion_arcsec=rad_to_arcsec(soft[0].psi - soft[1].psi),
        stiffness_nm_arcmin=rising / 2.0,
        touching=np.count_nonzero(loaded[0].force, axis=2).astype(np.float64),
        force_n=loaded[0].force.max(axis=(1, 2)),
        pressure_mpa=loaded[0].pressure.max(axis=(1, 2)),
        interference_um=squeezed,
    )


def unloading(assembly: Assembly, alpha: FloatArray, full: Pose, sense: float) -> tuple[Pose, ...]:
    """From the pose under load down to none, at each share of `LADDER` of rated torque, each from the one before."""
    found, pose = [], full
    for share in LADDER:
        pose = assembly.solve(alpha, sense * share * assembly.drive.rated_nm, pose)
        found.append(pose)
    return tuple(found)


def squeezed_um(free: Sequence[Pose]) -> float:
    """The largest surplus, um, that parts squeeze at no load: what `Reducer.interference_um` limits."""
    return mm_to_um(max(float(pose.approach.max()) for pose in free))


def without_limit(drive: Reducer) -> Reducer:
    """The drive where any surplus may be squeezed: to compare parts that nobody would assemble; say so with it."""
    return replace(drive, interference_um=1e6)


def _stiffness(assembly: Assembly, alpha: FloatArray, full: Pose, torque: float) -> float:
    """Mean slope between half and whole torque, Nm per arcmin, at every `STIFF_EVERY`-th crank angle."""
    rows = slice(None, None, STIFF_EVERY)
    start = full.at(rows)
    half = assembly.solve(alpha[rows], 0.5 * torque, start)
    turned = float(np.mean(rad_to_arcsec(start.psi - half.psi))) / ARCSEC_PER_ARCMIN
    return 0.5 * torque / turned if turned else inf


def _first_stage(drive: Reducer, alpha: FloatArray) -> FloatArray:
    """What the involute stage's error adds to the output (N,), rad: its wave per turn of the sun, over zp + z1/z2."""
    stage = drive.first_stage
    if not stage.error_arcsec:
        return np.zeros_like(alpha)
    output = alpha / drive.gear.zc
    size = arcsec_to_rad(stage.error_arcsec) / (drive.gear.zp + drive.sun_to_planet)
    return np.asarray(size * np.cos(round(stage.ratio - 1.0) * output))


def _curve(pose: Pose, torque_nm: float, wave: FloatArray) -> Curve:
    error = pose.psi + wave
    return Curve(torque_nm, rad_to_arcsec(error - error.mean()))
