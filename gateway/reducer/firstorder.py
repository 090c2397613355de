"""First order about the mean drive: transmission error as one matrix on the flank deviations of the discs; pure.

At equilibrium g(u, e) = 0. A surplus de on the contacts changes u by -H^-1 sum f'(p) b J de: the output's row of it,
taken at the pose of the *mean drive* (every space with the same modification, clearance and mean deviation, at the
torque asked), is linear in e and, through the tables' own interpolation, in the points of the flank maps. With the
Jacobian of the flank (`gateway.gear.first_order`) it is linear in the 21 errors, tables and set-up values.

About the perfect drive, where half of the pins share by their levers, the figure is up to 44 % low. About the mean
drive peak to peak is within some per cent, the curve less so, and lost motion, where few pins touch, is no more than a
direction. It ranks and optimises; what is stated comes from the full model (`figures`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from drivers.types.values import FloatArray
from drivers.units import mm_to_um, rad_to_arcsec, um_to_mm
from gateway.reducer.contact import Assembly, Linearised
from gateway.reducer.figures import LOST_MOTION, crank_angles
from gateway.reducer.records import Pins, Reducer
from gateway.reducer.surfaces import NODES, Surfacing
from gateway.tooth import FlankMap

BLOCK = 64


@dataclass(frozen=True)
class TransmissionMap:
    """Output angle (N,) in arcsec by the deviations in um of each disc's flank map, points in C order of (K, T, Z).

    ``mean_arcsec`` (N,) is the mean drive's own curve, ``mean_um`` (K, T, Z) its deviation, ``discs`` the matrices
    (N, K T Z) in arcsec per um.
    """

    drive: Reducer
    torque_nm: float
    crank_rad: FloatArray
    mean_arcsec: FloatArray
    mean_um: FloatArray
    discs: tuple[scipy.sparse.csr_matrix, ...]

    @property
    def together(self) -> scipy.sparse.csr_matrix:
        """The matrix where all discs are the same part, as one machine grinds them."""
        return scipy.sparse.csr_matrix(sum(self.discs[1:], start=self.discs[0]))

    def rows(self, jacobian: FloatArray) -> FloatArray:
        """Transmission error (N, P) per unit of parameters, from a flank's Jacobian (K T Z, P) in mm per unit; arcsec.

        The mean over the turn is taken out: where the output's zero lies is nobody's error.
        """
        found = np.asarray(self.together @ mm_to_um(jacobian))
        return np.asarray(found - found.mean(axis=0))

    def curve(self, flanks: Sequence[FlankMap]) -> FloatArray:
        """Transmission error (N,) in arcsec of a drive of those discs, mean removed."""
        change = sum(
            (rows @ (one.deviation_um - self.mean_um).ravel() for rows, one in zip(self.discs, flanks, strict=True)),
            start=np.zeros_like(self.mean_arcsec),
        )
        error = self.mean_arcsec + change
        return np.asarray(error - error.mean())


def mean_flank(flank: FlankMap) -> FlankMap:
    """The same flank in every space: the mean over the spaces."""
    mean = np.broadcast_to(flank.deviation_um.mean(axis=0), flank.deviation_um.shape)
    return replace(flank, deviation_um=np.array(mean))


def mean_drive(drive: Reducer) -> Reducer:
    """The drive with perfect pins and cranks of the same size."""
    pins = Pins(drive.pins.number, drive.pins.circle_mm, drive.pins.radius_mm)
    blank = {name: () for name in ("eccentricity_um", "phase_arcsec", "hole_um") if hasattr(drive.output, name)}
    return replace(drive, pins=pins, output=replace(drive.output, **blank))  # type: ignore[arg-type]


def transmission_map(
    drive: Reducer, flank: FlankMap, *, torque_nm: float | None = None, steps: int | None = None
) -> TransmissionMap:
    """The matrix at a torque (rated unless given) about the mean of a flank, whose places are those of the columns.

    Raises ModelError as `gateway.reducer.figures.transmission` does.
    """
    torque = drive.rated_nm if torque_nm is None else torque_nm
    alpha, mean = crank_angles(drive, steps), mean_flank(flank)
    assembly = Assembly(mean_drive(drive), [mean] * len(drive.discs), every_slice=True)
    found = assembly.linearised(alpha, torque)
    surface = assembly.surfacing
    discs = tuple(_matrix(found, surface, d, alpha.size) for d in range(len(drive.discs)))
    psi = rad_to_arcsec(found.psi)
    return TransmissionMap(
        drive=drive,
        torque_nm=torque,
        crank_rad=alpha,
        mean_arcsec=psi - psi.mean(),
        mean_um=mean.deviation_um,
        discs=discs,
    )


def lost_motion_map(drive: Reducer, flank: FlankMap, *, steps: int | None = None) -> FloatArray:
    """Mean lost motion (K T Z,) in arcsec per um, all discs alike, by the pins that touch at -3 and +3 %."""
    share = LOST_MOTION * drive.rated_nm
    plus, minus = (transmission_map(drive, flank, torque_nm=s * share, steps=steps) for s in (1.0, -1.0))
    return np.asarray((plus.together - minus.together).mean(axis=0)).ravel()


def _matrix(found: Linearised, surface: Surfacing, disc: int, count: int) -> scipy.sparse.csr_matrix:
    """arcsec per um of one disc's points, (N, K T Z)."""
    here = found.disc == disc
    node, weight = found.node[here], found.share[:, here]
    k, inside = np.divmod(node, NODES)
    k -= disc * surface.gear.zc
    over_profile = sum(weight[i][:, None] * surface.profile[inside + i - 1] for i in range(3))
    over_width = found.slope[here] @ surface.width
    block = np.einsum("ct,cz->ctz", over_profile, over_width).reshape(node.size, -1)
    size = block.shape[1]
    columns = k[:, None] * size + np.arange(size)
    rows = np.broadcast_to(found.step[here][:, None], columns.shape)
    values = rad_to_arcsec(um_to_mm(block))
    shape = (count, surface.gear.zc * size)
    return scipy.sparse.csr_matrix((values.ravel(), (rows.ravel(), columns.ravel())), shape=shape)


@dataclass(frozen=True, slots=True)
class MachineTransmission:
    """Transmission error of machines: ``matrix`` (N, P) in arcsec per unit of each parameter, ``mean`` (N,) without."""

    matrix: FloatArray
    mean: FloatArray

    def curves(self, vectors: FloatArray, out: FloatArray | None = None) -> FloatArray:
        """Curves (N, M) of parameter vectors (P, M), arcsec, written into ``out`` if given.

        The mean drive's own curve goes in as one more parameter: the product is all there is to do.
        """
        wide = np.vstack([vectors, np.ones((1, vectors.shape[1]))])
        return np.matmul(np.column_stack([self.matrix, self.mean]), wide, out=out)

    def peak_to_peak_arcsec(self, vectors: FloatArray) -> FloatArray:
        """Largest less smallest (M,), some machines at a time so that their curves stay in the processor's cache."""
        count = vectors.shape[1]
        return np.concatenate([np.ptp(self.curves(vectors[:, i : i + BLOCK]), axis=0) for i in range(0, count, BLOCK)])
