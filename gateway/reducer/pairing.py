"""Which two of many inspected discs make the best drives, and in which tooth position: an exact assignment; pure.

The first order is a sum over the discs: each disc's curve in either place, for every mark, is found once, and a pair's
transmission error is the peak to peak of two curves' sum. Turning a disc by one tooth moves its deviations by one
space. The best place and mark of each pair is its cost; which pairs together cost least is a perfect matching among N
discs, solved exactly as a 0-1 programme (one variable a pair, each disc in one pair at most, as many pairs as there
can be; scipy's HiGHS). The pairs chosen and the pairs "as they come" are then stated by the full model. Where those
say that pairing gains nothing, the discs stay as they come. Discs whose surplus is more than assembly may squeeze are
paired all the same, for the others' sake, and their pair says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from drivers.message import Message
from drivers.types.values import FloatArray
from drivers.units import rad_to_arcsec
from gateway.errors import ModelError
from gateway.reducer.contact import Assembly
from gateway.reducer.figures import squeezed_um, unloading
from gateway.reducer.firstorder import TransmissionMap, transmission_map
from gateway.reducer.records import Reducer
from gateway.tooth import FlankMap

MOST_DISCS = 60
PAIR = 2


@dataclass(frozen=True, slots=True)
class Pair:
    """Two discs by their numbers, in the places and the tooth position of the second; errors in arcsec, peak to peak.

    ``first_order_arcsec`` chose the pair, ``error_arcsec`` is the full model's. ``interference_um`` is the largest
    surplus that its parts squeeze at no load, ``limit_um`` what assembly may squeeze.
    """

    first: int
    second: int
    mark: int
    first_order_arcsec: float
    error_arcsec: float
    interference_um: float
    limit_um: float

    @property
    def assembles(self) -> bool:
        """Whether the two can be built in at all; a pair that cannot be is stated, not hidden."""
        return self.interference_um <= self.limit_um


@dataclass(frozen=True, slots=True)
class Matching:
    """Pairs that together have the least transmission error, the pairs as they come, and what pairing is worth."""

    pairs: tuple[Pair, ...]
    as_they_come: tuple[Pair, ...]
    left_over: tuple[int, ...]

    @property
    def mean_arcsec(self) -> float:
        """Mean error of the pairs by the full model."""
        return float(np.mean([pair.error_arcsec for pair in self.pairs]))

    @property
    def as_they_come_arcsec(self) -> float:
        """Mean error of the discs paired in the order given, at the drive's own mark, by the full model."""
        return float(np.mean([pair.error_arcsec for pair in self.as_they_come]))

    @property
    def worth_arcsec(self) -> float:
        """How much less error the mean drive has by pairing."""
        return self.as_they_come_arcsec - self.mean_arcsec


def match(
    drive: Reducer,
    flanks: Sequence[FlankMap],
    *,
    marks: Sequence[int] | None = None,
    torque_nm: float | None = None,
    steps: int | None = None,
) -> Matching:
    """The pairing of N inspected discs (all with the same places of points) for drives of two discs.

    ``marks`` are the tooth positions in which the second disc may be built (all zc unless given): name those that its
    holes allow. Raises ModelError E-REDUCER-MATCH, E-REDUCER-FLANK where the maps have different places.
    """
    if len(drive.discs) != PAIR or not PAIR <= len(flanks) <= MOST_DISCS:
        raise ModelError("E-REDUCER-MATCH", drive.name, given=len(flanks), discs=len(drive.discs))
    _check_alike(flanks)
    zc, own = drive.gear.zc, drive.discs[1].mark % drive.gear.zc
    wanted = np.array(sorted({int(m) % zc for m in (range(zc) if marks is None else marks)}))
    mean = FlankMap(flanks[0].theta_rad, flanks[0].z_mm, np.mean([one.deviation_um for one in flanks], axis=0))
    found = transmission_map(drive, mean, torque_nm=torque_nm, steps=steps)
    cost, mark = _costs(found, flanks, wanted, own)
    chosen = _assigned(np.minimum(cost, cost.T))
    ordered = [(i, j) if cost[i, j] <= cost[j, i] else (j, i) for i, j in chosen]
    pairs = tuple(_stated(found, flanks, (i, j, int(mark[i, j])), float(cost[i, j])) for i, j in ordered)
    plain, _ = _costs(found, flanks, np.array([own]), own)
    row = [(i, i + 1) for i in range(0, len(flanks) - 1, PAIR)]
    come = tuple(_stated(found, flanks, (i, j, own), float(plain[i, j])) for i, j in row)
    best = Matching(pairs, come, _left(pairs, len(flanks)))
    return best if best.worth_arcsec > 0.0 else Matching(come, come, _left(come, len(flanks)))


def _check_alike(flanks: Sequence[FlankMap]) -> None:
    for one in flanks[1:]:
        same = one.deviation_um.shape == flanks[0].deviation_um.shape
        if not (same and np.allclose(one.theta_rad, flanks[0].theta_rad) and np.allclose(one.z_mm, flanks[0].z_mm)):
            raise ModelError("E-REDUCER-FLANK", "match", why=Message.of("W-REDUCER-DISCS"))


def _costs(
    found: TransmissionMap, flanks: Sequence[FlankMap], marks: FloatArray, own: int
) -> tuple[FloatArray, FloatArray]:
    """Least error (N, N) of disc i in the first place and j in the second, and its mark; inf on the diagonal."""
    first = np.stack([found.discs[0] @ (one.deviation_um - found.mean_um).ravel() for one in flanks])
    moved = np.stack(
        [np.roll(one.deviation_um - found.mean_um, int(m) - own, axis=0).ravel() for one in flanks for m in marks],
        axis=1,
    )
    second = (found.discs[1] @ moved).T.reshape(len(flanks), len(marks), -1)
    cost, mark = np.full((2, len(flanks), len(flanks)), np.inf)
    for i in range(len(flanks)):
        alone = found.mean_arcsec + first[i]
        error = np.ptp(alone + second, axis=2)
        best = np.argmin(error, axis=1)
        cost[i], mark[i] = error[np.arange(len(flanks)), best], marks[best]
        cost[i, i] = np.inf
    return cost, mark


def _assigned(cost: FloatArray) -> list[tuple[int, int]]:
    """Pairs (i, j) of least total cost, as many as there can be."""
    count = len(cost)
    pairs = [(i, j) for i in range(count) for j in range(i + 1, count)]
    columns = np.repeat(np.arange(len(pairs)), PAIR)
    uses = scipy.sparse.csr_matrix((np.ones(columns.size), (np.array(pairs).ravel(), columns)))
    wanted = count // PAIR
    answer = scipy.optimize.milp(
        np.array([cost[i, j] for i, j in pairs]),
        integrality=np.ones(len(pairs), dtype=np.int64),
        bounds=scipy.optimize.Bounds(0.0, 1.0),
        constraints=[
            scipy.optimize.LinearConstraint(uses, 0.0, 1.0),
            scipy.optimize.LinearConstraint(np.ones((1, len(pairs))), wanted, wanted),
        ],
    )
    return [pair for pair, taken in zip(pairs, np.asarray(answer.x), strict=True) if taken > 0.5]


def _stated(found: TransmissionMap, flanks: Sequence[FlankMap], who: tuple[int, int, int], first_order: float) -> Pair:
    """A pair by the full model, the worse sense of torque."""
    i, j, mark = who
    drive = found.drive.with_marks((found.drive.discs[0].mark, mark))
    assembly = Assembly(drive, [flanks[i], flanks[j]])
    alpha = found.crank_rad
    loaded = [(sense, assembly.solve(alpha, sense * found.torque_nm)) for sense in (1.0, -1.0)]
    free = [unloading(assembly, alpha, pose, sense)[-1] for sense, pose in loaded]
    return Pair(
        first=i,
        second=j,
        mark=mark,
        first_order_arcsec=first_order,
        error_arcsec=max(float(np.ptp(rad_to_arcsec(pose.psi))) for _, pose in loaded),
        interference_um=squeezed_um(free),
        limit_um=drive.interference_um,
    )


def _left(pairs: Sequence[Pair], count: int) -> tuple[int, ...]:
    taken = {number for pair in pairs for number in (pair.first, pair.second)}
    return tuple(number for number in range(count) if number not in taken)
