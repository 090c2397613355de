"""Which set-ups to measure in the hours there are: the expected gain on a goal per hour, one set-up after the other.

The errors of the machine are e = sum of x_i times known shapes, each x_i ~ N(0, 1) before anything is measured: a shape
carries its prior standard deviation. Nuisances (datum of a set-up, lean of a bar, eccentric ball, angle of a square,
the instrument's own error) are further x_i. A set-up reads means y at its targets,

    y = D x + v,   v ~ N(0, N),  N = diag(u^2)          D: its design, zero where it sees nothing of a shape

and the goal (flank, drive or axis) is g = g0 + G x by the first-order map, its rows scaled so that the expected mean
square is |g0|^2 + tr(G C G'). What is known of x has covariance C, the identity at first. A reading updates it by

    K = C D' (D C D' + N)^-1,   C+ = C - K D C          (Gauss-Markov, the same in any order of the set-ups)

whatever it will read: so the gain  tr(G C G') - tr(G C+ G') = |G C D' S^-T/2|^2,  S = D C D' + N,  is known before
anything is mounted. It is never negative, and never more than what is open.

The best subset within given hours is a knapsack. Each step takes what gains most per hour of those that still fit
(mounting, start and stops count). Some set-ups are worth nothing alone: half a square leaves its angle open, a bar its
lean. So *bundles* compete, such that belong together, and every single set-up, each with its choices of targets and
repetitions. What must be measured anyway counts first, for it changes what the others are worth. Once a set-up was
really measured, C and g0 come from the fit, and the rest is planned anew.

g is normal, so |g|^2 has mean M = |g0|^2 + sum of l_i and variance V = 2 sum of l_i^2 + 4 g0' L g0, with l_i the
eigenvalues of L = G C G'. The promise is  RMS <= sqrt(M + 2 sqrt(V)): two standard deviations, one-sided. The tolerance
is proved where the promise meets it. After D. V. Lindley, On a measure of the information provided by an experiment
(1956), with the A-optimal criterion in place of entropy; K. Chaloner, I. Verdinelli, Bayesian experimental design,
Statistical Science 10 (1995) 273.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from drivers.types.values import FloatArray
from gateway.errors import ModelError

Ended = Literal["proved", "nothing left", "hours"]
SIGMAS = 2.0
WORTH = 0.1
NOTHING = 1e-9
"""Of what is open: no more than rounding."""
SHARE = 0.002
"""Of what all that is left would take: work that takes less than this is not worth a mounting."""


@dataclass(frozen=True)
class Choice:
    """One way to measure a set-up: its design (m, p), standard uncertainties (m,) of its means, and its hours."""

    design: FloatArray
    u: FloatArray
    hours: float
    targets: int = 0
    repetitions: int = 0


@dataclass(frozen=True)
class Candidate:
    """A set-up that may be mounted, with at least one way to measure it, the site's own first."""

    key: str
    choices: tuple[Choice, ...]


@dataclass(frozen=True)
class Knowledge:
    """What is known: covariance (p, p) of the shapes, goal (R, p) by each of them, known rest ``nominal`` (R,)."""

    covariance: FloatArray
    goal: FloatArray
    nominal: FloatArray

    @classmethod
    def before(cls, goal: FloatArray, nominal: FloatArray | None = None) -> Knowledge:
        """Nothing is measured yet. Raises ModelError (E-PLAN-SHAPE)."""
        rows = np.asarray(goal, dtype=np.float64)
        rest = np.zeros(rows.shape[:1]) if nominal is None else np.asarray(nominal, dtype=np.float64)
        if rows.ndim != len("Rp") or rest.shape != rows.shape[:1]:
            raise ModelError("E-PLAN-SHAPE", "plan", design=str(rows.shape), u=str(rest.shape), shapes=rows.shape[-1])
        return cls(np.eye(rows.shape[1]), rows, rest)

    @property
    def u(self) -> float:
        """Standard uncertainty of the goal, RMS over its rows."""
        return float(np.sqrt(max(float(np.sum(self._goal_covariance * self.goal)), 0.0)))

    @property
    def bound(self) -> float:
        """What the goal's RMS will not exceed, by two standard deviations of its square."""
        spread = self._goal_covariance @ self.goal.T
        mean = float(self.nominal @ self.nominal + np.trace(spread))
        variance = 2.0 * float(np.sum(spread**2)) + 4.0 * float(self.nominal @ spread @ self.nominal)
        return float(np.sqrt(max(mean + SIGMAS * np.sqrt(max(variance, 0.0)), 0.0)))

    def gain(self, choices: Sequence[Choice]) -> float:
        """What readings take from the goal's square, its unit squared."""
        if not choices:
            return 0.0
        few, used, root = self._seen(choices)
        half = scipy.linalg.solve_triangular(root, few @ self._goal_covariance[:, used].T, lower=True)
        return float(np.sum(half**2))

    def after(self, choices: Sequence[Choice]) -> Knowledge:
        """What will be known with these readings."""
        if not choices:
            return self
        few, used, root = self._seen(choices)
        half = scipy.linalg.solve_triangular(root, few @ self.covariance[used], lower=True)
        left = self.covariance - half.T @ half
        return replace(self, covariance=0.5 * (left + left.T))

    @cached_property
    def _goal_covariance(self) -> FloatArray:
        return self.goal @ self.covariance

    def _seen(self, choices: Sequence[Choice]) -> tuple[FloatArray, NDArray[np.intp], FloatArray]:
        """Design (m, n) of the n shapes that are seen, their places, and the lower Cholesky root (m, m) of S.

        Raises ModelError (E-PLAN-SHAPE).
        """
        p = self.covariance.shape[0]
        for one in choices:
            if one.design.shape != (one.u.size, p) or not bool(np.all(one.u > 0.0)):
                raise ModelError("E-PLAN-SHAPE", "plan", design=str(one.design.shape), u=str(one.u.shape), shapes=p)
        design = np.concatenate([one.design for one in choices])
        noise = np.concatenate([one.u for one in choices]) ** 2
        used = np.flatnonzero(np.any(design != 0.0, axis=0))
        few = design[:, used]
        whole = few @ self.covariance[np.ix_(used, used)] @ few.T + np.diag(noise)
        scale = np.sqrt(np.diag(whole))
        # An unknown lean dwarfs the noise by 1e8: with rows scaled to 1 the least eigenvalue stays above rounding.
        root = np.linalg.cholesky(whole / np.outer(scale, scale) + 1e-13 * np.eye(noise.size))
        return few, used, scale[:, None] * root


@dataclass(frozen=True, slots=True)
class Step:
    """Set-ups measured next, by key, with the place of the choice of each; ``u`` and ``bound`` of the goal with it."""

    keys: tuple[str, ...]
    choices: tuple[int, ...]
    hours: float
    u_before: float
    u: float
    bound: float

    @property
    def gain_per_h(self) -> float:
        """Decrease of the goal's square for each hour."""
        return (self.u_before**2 - self.u**2) / self.hours if self.hours > 0.0 else float("inf")


@dataclass(frozen=True, slots=True)
class LeftOut:
    """Set-ups that were left out together, their hours, and the u of the goal if they were measured too."""

    keys: tuple[str, ...]
    hours: float
    u_with: float


@dataclass(frozen=True, slots=True)
class HourPlan:
    """A plan for limited hours. ``u_least`` is the goal's u with every set-up there is, in ``hours_all``."""

    steps: tuple[Step, ...]
    left_out: tuple[LeftOut, ...]
    ended: Ended
    u_before: float
    u: float
    u_least: float
    bound: float
    hours: float
    hours_all: float

    @property
    def keys(self) -> tuple[str, ...]:
        """Every set-up in the order of the plan."""
        return tuple(key for step in self.steps for key in step.keys)

    def choice(self, key: str) -> int:
        """Which choice of a set-up was taken."""
        return next(at for step in self.steps for one, at in zip(step.keys, step.choices, strict=True) if one == key)


def plan_hours(
    known: Knowledge,
    candidates: Sequence[Candidate],
    *,
    bundles: Sequence[tuple[str, ...]] = (),
    required: Sequence[str] = (),
    hours: float | None = None,
    tolerance: float | None = None,
    least: float = 0.0,
    worth: float = WORTH,
) -> HourPlan:
    """The set-ups to measure, best first, ``required`` ones last; ``bundles`` are keys that are also tried together.

    It ends where the tolerance is proved, where all that is left together would lower the goal's u by less
    than the share ``worth``, or take no more than ``least`` from it (root of the difference of squares), or where
    nothing that still helps fits into the hours. Raises ModelError:
    E-PLAN-HOURS (the required set-ups alone take longer), E-PLAN-SHAPE.
    """
    by = {one.key: one for one in candidates}
    must = tuple(key for key in required if key in by)
    needed_h = sum(by[key].choices[0].hours for key in must)
    if hours is not None and needed_h > hours:
        raise ModelError("E-PLAN-HOURS", "plan", hours=f"{hours:g}", needed=f"{needed_h:.2f}", setups=", ".join(must))
    start = known
    at = known.after([by[key].choices[0] for key in must])
    groups = _groups(by, bundles, must)
    picked: list[tuple[tuple[str, ...], tuple[int, ...]]] = []
    spent, ended = needed_h, "nothing left"
    while True:
        taken = {*must, *(key for keys, _ in picked for key in keys)}
        if tolerance is not None and at.bound <= tolerance:
            ended = "proved"
            break
        rest = at.gain([one.choices[0] for one in candidates if one.key not in taken])
        if rest <= max(least**2, NOTHING * start.u**2, (1.0 - (1.0 - worth) ** 2) * at.u**2):
            break
        best = _best(at, by, groups, taken, None if hours is None else hours - spent, SHARE * rest)
        if best is None:
            ended = "hours"
            break
        keys, choices = best
        picked.append(best)
        at = at.after([by[key].choices[n] for key, n in zip(keys, choices, strict=True)])
        spent += sum(by[key].choices[n].hours for key, n in zip(keys, choices, strict=True))
    steps = _told(start, by, [*picked, *(((key,), (0,)) for key in must)])
    taken = {key for step in steps for key in step.keys}
    done = steps[-1] if steps else None
    everything = start.after([one.choices[0] for one in candidates])
    return HourPlan(
        steps=steps,
        left_out=_left_out(at, by, groups, taken),
        ended=ended,  # type: ignore[arg-type]
        u_before=start.u,
        u=done.u if done is not None else start.u,
        u_least=everything.u,
        bound=done.bound if done is not None else start.bound,
        hours=sum(step.hours for step in steps),
        hours_all=sum(one.choices[0].hours for one in candidates),
    )


def _groups(
    by: Mapping[str, Candidate], bundles: Sequence[tuple[str, ...]], must: Sequence[str]
) -> tuple[tuple[str, ...], ...]:
    """Every set-up alone, and those that are tried together as far as they are there."""
    together = [tuple(key for key in one if key in by and key not in must) for one in bundles]
    singles = [(key,) for key in by if key not in must]
    return tuple(dict.fromkeys(one for one in (*singles, *together) if one))


def _best(
    at: Knowledge,
    by: Mapping[str, Candidate],
    groups: Sequence[tuple[str, ...]],
    taken: set[str],
    hours_left: float | None,
    least: float,
) -> tuple[tuple[str, ...], tuple[int, ...]] | None:
    """What gains most per hour of what fits and takes at least so much; None where nothing does."""
    best, most = None, 0.0
    for group in groups:
        keys = tuple(key for key in group if key not in taken)
        if not keys:
            continue
        for n in range(max(len(by[key].choices) for key in keys)):
            choices = tuple(min(n, len(by[key].choices) - 1) for key in keys)
            ways = [by[key].choices[m] for key, m in zip(keys, choices, strict=True)]
            takes = sum(one.hours for one in ways)
            if hours_left is not None and takes > hours_left:
                continue
            gain = at.gain(ways)
            rate = gain / max(takes, 1e-6)
            if gain > least and rate > most:
                best, most = (keys, choices), rate
    return best


def _told(
    start: Knowledge, by: Mapping[str, Candidate], picked: Sequence[tuple[tuple[str, ...], tuple[int, ...]]]
) -> tuple[Step, ...]:
    """The steps in their order with the goal's u before and after each."""
    found, at = [], start
    for keys, choices in picked:
        ways = [by[key].choices[n] for key, n in zip(keys, choices, strict=True)]
        after = at.after(ways)
        hours = sum(one.hours for one in ways)
        found.append(Step(keys, choices, hours, u_before=at.u, u=after.u, bound=after.bound))
        at = after
    return tuple(found)


def _left_out(
    at: Knowledge, by: Mapping[str, Candidate], groups: Sequence[tuple[str, ...]], taken: set[str]
) -> tuple[LeftOut, ...]:
    """Each set-up that was left out, once, in the company in which it is worth most per hour; the costliest first."""
    found: list[LeftOut] = []
    told: set[str] = set()
    left = {tuple(key for key in one if key not in taken) for one in groups} - {()}

    def worth(keys: tuple[str, ...]) -> tuple[float, float]:
        ways = [by[key].choices[0] for key in keys]
        return at.gain(ways), sum(one.hours for one in ways)

    rated = {keys: worth(keys) for keys in sorted(left)}
    for keys in sorted(rated, key=lambda one: -rated[one][0] / max(rated[one][1], 1e-6)):
        if told.isdisjoint(keys):
            gain, hours = rated[keys]
            found.append(LeftOut(keys, hours, float(np.sqrt(max(at.u**2 - gain, 0.0)))))
            told |= set(keys)
    return tuple(sorted(found, key=lambda one: one.u_with))
