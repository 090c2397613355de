"""What became of one machine of the proof, and the criteria that all of them are held to."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tests.closing.identified import Identified
from tests.closing.presses import Presses

FloatArray = NDArray[np.float64]
FLOOR_FACTOR = 1.15
MISSES_ALLOWED = 0.05
MOST_U_UM = 0.25
HONEST = (0.7, 1.4)
EDGES = np.linspace(-5.0, 5.0, 41)
B_LEFT_WITHIN = 0.05


@dataclass(frozen=True, slots=True)
class Normalised:
    """Normalised errors of many points, kept as sums and counts: ``bins`` over EDGES, what is beyond in the ends."""

    count: int = 0
    total: float = 0.0
    squares: float = 0.0
    bins: tuple[int, ...] = (0,) * (len(EDGES) - 1)

    @staticmethod
    def of(values: FloatArray) -> Normalised:
        """From values of any shape."""
        flat = np.ravel(values)
        bins, _ = np.histogram(np.clip(flat, EDGES[0], EDGES[-1]), EDGES)
        return Normalised(flat.size, float(flat.sum()), float(flat @ flat), tuple(int(n) for n in bins))

    def plus(self, other: Normalised) -> Normalised:
        """Both together."""
        bins = tuple(a + b for a, b in zip(self.bins, other.bins, strict=True))
        return Normalised(self.count + other.count, self.total + other.total, self.squares + other.squares, bins)

    @property
    def mean(self) -> float:
        """Their mean."""
        return self.total / self.count if self.count else 0.0

    @property
    def deviation(self) -> float:
        """Their standard deviation about their mean."""
        return float(np.sqrt(max(self.squares / self.count - self.mean**2, 0.0))) if self.count else 0.0


@dataclass(frozen=True)
class MachineResult:
    """One machine after its closing run; RMS of the true flank in um, axes as M in um or arcsec.

    ``floor_um`` is the judge's floor with no table taking the work's eccentricity, ``least_um`` the one with tables
    that may. ``u_um`` is the predicted standard uncertainty of the flank, ``predicted_um`` and ``rms_u_um`` mean and
    standard deviation of the RMS it predicts. ``points`` are (truth - prediction) / u of every judged point.
    ``axes`` gives M before and after by machine axis. ``b_left`` is what the run says beforehand and what the parts
    then show. ``presses`` is what the run asked of the operator. ``virtual_s`` is what it took in the cell, ``hours``
    with the usual times of a site file instead of those of the double. ``failed`` is the code of the error that ended
    the run, "" if none did.
    """

    name: str
    seed: int
    gear: str
    lobes: int
    short: bool
    utc: str
    before_um: float = 0.0
    set_right_um: float = 0.0
    after_um: float = 0.0
    floor_um: float = 0.0
    least_um: float = 0.0
    u_um: float = 0.0
    predicted_um: float = 0.0
    rms_u_um: float = 1.0
    points: Normalised = field(default_factory=Normalised)
    components: tuple[Identified, ...] = ()
    presses: Presses = field(default_factory=Presses)
    axes: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    b_left: tuple[float, float] = (0.0, 0.0)
    done_twice: tuple[str, ...] = ()
    outcome: str = ""
    words: str = ""
    virtual_s: float = 0.0
    hours: float = 0.0
    wall_s: float = 0.0
    failed: str = ""

    @property
    def limit_um(self) -> float:
        """What the flank after may have at most."""
        return float(np.hypot(FLOOR_FACTOR * self.floor_um, self.u_um))

    @property
    def scalar(self) -> float:
        """(true RMS - predicted mean RMS) / its predicted standard deviation."""
        return (self.after_um - self.predicted_um) / self.rms_u_um

    @property
    def worst_component(self) -> Identified:
        """The motion that uses most of its limit."""
        return max(self.components, key=lambda one: one.off / one.limit, default=Identified("-", 0.0, 1.0))


Results = Sequence[MachineResult]


@dataclass(frozen=True, slots=True)
class Criterion:
    """One thing that must hold: its wording, and a function listing what breaks it."""

    says: str
    broken: Callable[[Results], list[str]]


def finished(results: Results) -> list[str]:
    """Runs that ended with an error."""
    return [f"{one.name}: {one.failed}" for one in results if one.failed]


def above_floor(results: Results) -> list[str]:
    """Machines whose flank after is above what floor and uncertainty allow, if they are too many."""
    done = _done(results)
    missed = [one for one in done if one.after_um > one.limit_um]
    said = [f"{one.name}: {one.after_um:.3f} um above {one.limit_um:.3f} um" for one in missed]
    return said if len(missed) > MISSES_ALLOWED * len(done) else []


def got_worse(results: Results) -> list[str]:
    """Machines whose flank after is above the one before (its set-up values put right) by more than 2 u."""
    return [
        f"{one.name}: {one.after_um:.3f} um after, {one.set_right_um:.3f} um before, u {one.u_um:.3f} um"
        for one in _done(results)
        if one.after_um > one.set_right_um + 2.0 * one.u_um
    ]


def too_unsure(results: Results) -> list[str]:
    """The demo cell's own uncertainty."""
    demo = [one for one in _done(results) if one.name == "demo"]
    return [f"{one.name}: u {one.u_um:.3f} um" for one in demo if one.u_um > MOST_U_UM]


def points_honest(results: Results) -> list[str]:
    """Pooled normalised errors of the flank's points."""
    pooled = pooled_points(results)
    return _spread("points", pooled.deviation, pooled.count)


def rms_honest(results: Results) -> list[str]:
    """Normalised errors of the RMS, one a machine."""
    scalars = [one.scalar for one in _done(results)]
    return _spread("RMS", float(np.std(scalars)), len(scalars)) if len(scalars) > 1 else []


def _spread(what: str, deviation: float, count: int) -> list[str]:
    inside = HONEST[0] <= deviation <= HONEST[1]
    return [] if inside or not count else [f"{what}: standard deviation {deviation:.2f} of {count}"]


def misidentified(results: Results) -> list[str]:
    """Error motions identified worse than allowed."""
    return [
        f"{one.name}: {part.name} off by {part.off:.2f}, allowed {part.limit:.2f}"
        for one in _done(results)
        for part in one.components
        if part.off > part.limit
    ]


def b_unconfirmed(results: Results) -> list[str]:
    """The cell made to show it: another share of B on its parts than was said beforehand.

    On the seeded machines B makes 0.15 to 0.3 um of flank; 38 % of that is no more than what tenths of an arcsec left
    in C make, so their shares are told in the document and not held to it.
    """
    return [
        f"{one.name}: said {one.b_left[0]:.2f}, seen {one.b_left[1]:.2f}"
        for one in _done(results)
        if one.name == "eleven" and not abs(one.b_left[0] - one.b_left[1]) <= B_LEFT_WITHIN
    ]


def pooled_points(results: Results) -> Normalised:
    """The normalised errors of all machines' points."""
    total = Normalised()
    for one in _done(results):
        total = total.plus(one.points)
    return total


def _done(results: Results) -> list[MachineResult]:
    return [one for one in results if not one.failed]


CRITERIA = (
    Criterion("every run came to its end", finished),
    Criterion(
        "RMS after^2 <= (1.15 floor)^2 + u^2 on at least 19 of 20 machines",
        above_floor,
    ),
    Criterion("RMS after never above RMS before (set-up values put right) + 2 u", got_worse),
    Criterion("u <= 0.25 um in the demo cell", too_unsure),
    Criterion("(truth - prediction) / u of the points has a standard deviation of 0.7 to 1.4", points_honest),
    Criterion("(truth - prediction) / u of the RMS has a standard deviation of 0.7 to 1.4", rms_honest),
    Criterion("measured error motions within max(0.3 um or arcsec, 5 %) of the truth at the targets", misidentified),
    Criterion("the 11-lobe cell: the share of B that stays is seen as said, within 0.05", b_unconfirmed),
)


def violations(results: Results) -> list[str]:
    """Everything that does not hold, in words."""
    return [f"{one.says}: {line}" for one in CRITERIA for line in one.broken(results)]
