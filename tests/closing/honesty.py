"""How honest stated uncertainties are: normalised errors of many machines, pooled and in each family; pure.

A normalised error is (truth - said) / u. Of honest uncertainties its standard deviation is 1, of n machines within
about 1 / sqrt(2 n) of it. Points of one flank share their doubts, so a family of machines counts as its machines, not
as their points.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gateway.domain.values import COVERAGE, FloatArray
from tests.closing.record import MachineResult, Normalised, Results

POOLED = (0.7, 1.4)
FAMILY = (0.6, 1.6)
# A family of fewer machines is told and not judged: chance alone is wider than what is allowed.
FEWEST = 12


def normalised(true: FloatArray, said: FloatArray, u: FloatArray) -> FloatArray:
    """(true - said) / u of figures (n,), u the standard uncertainty; NaN where one of them is missing or u is 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        found = (np.asarray(true) - np.asarray(said)) / np.asarray(u)
    return np.where(np.isfinite(found), found, np.nan)


def of_expanded(true: FloatArray, said: FloatArray, U: FloatArray) -> FloatArray:
    """The same of figures stated with U, k = 2, such as M and the range over the whole travel."""
    return normalised(true, said, np.asarray(U) / COVERAGE)


@dataclass(frozen=True, slots=True)
class Spread:
    """Normalised errors of one kind of figure over some machines: their mean, and ``deviation``, named by ``by``."""

    what: str
    family: str
    machines: int
    mean: float
    deviation: float
    limits: tuple[float, float]
    by: str = "standard deviation"

    @property
    def judged(self) -> bool:
        """Whether there are machines enough."""
        return self.machines >= FEWEST

    @property
    def honest(self) -> bool:
        """Within the limits, or too few to be judged."""
        return not self.judged or self.limits[0] <= self.deviation <= self.limits[1]

    @property
    def words(self) -> str:
        """For a row of the page."""
        told = "" if self.judged else ", too few to be judged"
        return (
            f"{self.what} of {self.family}: {self.by} {self.deviation:.2f}, mean {self.mean:+.2f}, "
            f"{self.machines} machines (allowed {self.limits[0]} to {self.limits[1]}{told})"
        )


def spreads(families: Mapping[str, Results]) -> tuple[Spread, ...]:
    """Points and RMS of the flank, pooled over all machines first, then in each family; failed runs left out."""
    done = {name: [one for one in results if not one.failed] for name, results in families.items()}
    whole = [one for results in done.values() for one in results]
    found = [*_both("all", whole, POOLED)]
    for name, results in done.items():
        found += _both(name, results, FAMILY)
    return tuple(found)


def of_values(what: str, family: str, values: Iterable[float], limits: tuple[float, float] = FAMILY) -> Spread:
    """One figure a machine, such as an axis' range: normalised errors, NaN left out."""
    known = np.asarray([value for value in values if np.isfinite(value)])
    mean, deviation = (float(known.mean()), float(known.std())) if known.size else (0.0, 0.0)
    return Spread(what, family, known.size, mean, deviation, limits)


def broken(found: Sequence[Spread]) -> list[str]:
    """What is outside its limits, in words: as a criterion of the proof lists it."""
    return [one.words for one in found if not one.honest]


def _both(family: str, results: Sequence[MachineResult], limits: tuple[float, float]) -> tuple[Spread, Spread]:
    points = Normalised()
    for one in results:
        points = points.plus(one.points)
    flank = Spread("points", family, len(results), points.mean, points.deviation, limits)
    return flank, of_values("RMS", family, [one.scalar for one in results], limits)
