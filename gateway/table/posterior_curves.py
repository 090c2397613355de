"""What an axis may be between the places where it was measured: many curves, each as likely as the others; pure.

Four explanations compete for what was seen: a smooth axis; one with structure of no known shape, finer than the
targets; one with a short wave of some period (screw, scale, worm); one with a single bad place. Each is a Gaussian
process or a linear model with a Gaussian prior, so how well it explains the readings (its evidence) is known in closed
form. Curves are drawn from all, as often as the readings ask for.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import log

import numpy as np

from gateway.domain.values import FloatArray

SMOOTH = (2.0, 4.0, 8.0)  # lengths of the smooth part, in usual gaps between targets
FINE = (0.2, 0.4, 0.8)  # those of structure without a shape
SHARES = (0.5, 1.0, 2.0)  # its size, and that of waves and bad places, against what was missed
REST = 0.25  # what waves and bad places may leave of it
HALF_WIDTHS = (0.5, 0.75, 1.5, 3.0)  # of a bad place, in usual gaps
BAD_PLACE = 3.0  # it is so much larger than the RMS by which it was missed
WIDE = 1e3  # a level or slope may be so much larger than all that was seen
SHARE_OF_GAP = 6.0  # waves down to this share of the gap
STEPS_A_PERIOD, CENTRES = 16.0, 8.0  # how finely frequencies and places are tried
FINENESS = 4.0  # points of the lattice on the shortest wave
FLOOR = 0.05  # optics, air and rounding, um or arcsec
JITTER = 1e-8


@dataclass(frozen=True)
class SeenPlaces:
    """Means (n,) of an axis at places ``at`` with standard uncertainties ``u``; ``turn`` is 360 where it closes.

    ``gap`` is the usual distance of the targets, ``missed`` the RMS by which what was not fitted missed the curve.
    """

    at: FloatArray
    mean: FloatArray
    u: FloatArray
    gap: float
    missed: float
    turn: float | None = None

    @property
    def lattice(self) -> FloatArray:
        """Places (g,) over the measured range, or the whole turn, fine enough for the shortest wave."""
        low, high = float(np.min(self.at)), float(np.max(self.at))
        span = high - low if self.turn is None else self.turn
        count = int(np.ceil(span / self.gap * SHARE_OF_GAP * FINENESS)) + 1
        return np.linspace(low, low + span, count, endpoint=self.turn is None)


@dataclass(frozen=True)
class _Ground:
    """The smooth part, with or without structure of no known shape: lengths and variances of its covariance."""

    smooth: float
    fine: float
    fine_variance: float
    level: float
    turn: float | None
    centre: float

    def covariance(self, a: FloatArray, b: FloatArray) -> FloatArray:
        d = a[:, None] - b[None, :]
        if self.turn is not None:
            d = self.turn / np.pi * np.sin(np.pi * d / self.turn)
        found = self.level * (WIDE + np.exp(-0.5 * (d / self.smooth) ** 2))
        if self.turn is None:
            found += self.level * WIDE * np.outer(a - self.centre, b - self.centre) / self.smooth**2 / 100.0
        if self.fine_variance:
            found += self.fine_variance * np.exp(-0.5 * (d / self.fine) ** 2)
        return np.asarray(found)


@dataclass(frozen=True)
class _Extra:
    """Shapes that may lie on a ground, each of some columns: their prior variances (v,), and how much each is believed.

    ``data`` (p, w, n) are the columns of all shapes where the axis was measured.
    """

    kind: str
    places: FloatArray
    half_width: float
    variances: FloatArray
    belief: float
    data: FloatArray

    @property
    def count(self) -> int:
        """Shapes times sizes."""
        return int(self.places.size * self.variances.size)


def _columns(kind: str, places: FloatArray, half_width: float, q: FloatArray, turn: float | None) -> FloatArray:
    """The columns (p, 2, q) of waves, (p, 1, q) of bad places."""
    if kind == "wave":
        phase = 2.0 * np.pi * places[:, None] * q
        return np.stack([np.cos(phase), np.sin(phase)], axis=1)
    d = np.abs(q - places[:, None])
    d = d if turn is None else np.minimum(d % turn, turn - d % turn)
    return np.clip(1.0 - d / half_width, 0.0, None)[:, None, :]


def draw_posterior_curves(seen: SeenPlaces, count: int, seed: int = 1) -> FloatArray:
    """Curves (count, g) on ``seen.lattice`` that explain what was seen, their number by how well; reproducible."""
    rng = np.random.default_rng([seed, seen.at.size, count])
    noise = seen.u**2 + FLOOR**2
    extras = tuple(_extras(seen))
    every = [
        _GroundPosterior(ground, belief, seen, noise, extras=extras if shaped else ())
        for ground, belief, shaped in _grounds(seen)
    ]
    weights = np.concatenate([one.evidence for one in every])
    chosen = rng.choice(weights.size, count, p=_normalise_weights(weights))
    ends = np.cumsum([one.evidence.size for one in every])
    drawn: list[FloatArray] = []
    for number, one in enumerate(every):
        start = int(ends[number]) - one.evidence.size
        mine = np.sort(chosen[(chosen >= start) & (chosen < ends[number])]) - start
        if mine.size:
            drawn.append(one.drawn(mine, rng))
    return np.concatenate(drawn)


def _grounds(seen: SeenPlaces) -> Iterator[tuple[_Ground, float, bool]]:
    """Each with how much it is believed, and whether waves and bad places may lie on it."""
    level = max(float(np.var(seen.mean)), FLOOR**2)
    centre = float(np.mean(seen.at))
    for smooth in SMOOTH:

        def ground(fine: float, share: float, smooth: float = smooth) -> _Ground:
            variance = (share * seen.missed) ** 2
            return _Ground(
                smooth=smooth * seen.gap,
                fine=fine * seen.gap,
                fine_variance=variance,
                level=level,
                turn=seen.turn,
                centre=centre,
            )

        yield ground(1.0, 0.0), 0.4 / len(SMOOTH), True
        yield ground(FINE[1], REST), 0.4 / len(SMOOTH), True
        for fine in FINE:
            for share in SHARES:
                yield ground(fine, share), 0.2 / (len(SMOOTH) * len(FINE) * len(SHARES)), False


def _extras(seen: SeenPlaces) -> Iterator[_Extra]:
    """Waves and bad places; each kind is believed as much as a smooth axis without any."""
    span = float(np.ptp(seen.at))
    if seen.turn is None:
        rates = np.arange(0.5 / seen.gap, SHARE_OF_GAP / seen.gap, 1.0 / (STEPS_A_PERIOD * span))
        middle = np.arange(np.min(seen.at), np.max(seen.at), seen.gap / CENTRES)
    else:
        rates = np.arange(int(seen.turn / seen.gap / 2.0), int(SHARE_OF_GAP * seen.turn / seen.gap) + 1) / seen.turn
        middle = np.arange(0.0, seen.turn, seen.gap / CENTRES)
    sizes, third = (np.asarray(SHARES) * seen.missed) ** 2, 1.0 / (3.0 * len(SHARES))
    waves = _columns("wave", rates, 0.0, seen.at, seen.turn)
    yield _Extra("wave", rates, 0.0, variances=2.0 * sizes, belief=third / rates.size, data=waves)
    for half in HALF_WIDTHS:
        width = half * seen.gap
        bumps = _columns("place", middle, width, seen.at, seen.turn)
        belief = third / (middle.size * len(HALF_WIDTHS))
        yield _Extra("place", middle, width, variances=BAD_PLACE**2 * sizes, belief=belief, data=bumps)


class _GroundPosterior:
    """One ground with all that may lie on it: how well each explains the readings, and curves from it."""

    def __init__(
        self, ground: _Ground, belief: float, seen: SeenPlaces, noise: FloatArray, extras: tuple[_Extra, ...]
    ) -> None:
        self._ground, self._seen, self._noise, self._extras = ground, seen, noise, extras
        self._root = _root(ground.covariance(seen.at, seen.at) + np.diag(noise))
        self._inverse = np.linalg.inv(self._root)
        self._y = self._inverse @ (seen.mean - np.mean(seen.mean))
        plain = -0.5 * float(self._y @ self._y) - float(np.sum(np.log(np.diag(self._root))))
        alone = np.array([plain + log(belief / (3.0 if extras else 1.0))])
        with_one = [plain + self._better(one) + log(belief * one.belief) for one in extras]
        self.evidence = np.concatenate([alone, *with_one])

    def _better(self, extra: _Extra) -> FloatArray:
        """By how much each shape of each size raises the evidence's logarithm: determinant and form of low rank."""
        count, width, n = extra.data.shape
        solved = (extra.data.reshape(-1, n) @ self._inverse.T).reshape(count, width, n)
        crossed, seen = solved @ np.swapaxes(solved, 1, 2), solved @ self._y
        found = []
        for variance in extra.variances:
            inner = np.eye(width) + variance * crossed
            taken = variance * np.einsum("pi,pij,pj->p", seen, np.linalg.inv(inner), seen)
            found.append(0.5 * taken - 0.5 * np.log(np.linalg.det(inner)))
        return np.concatenate(found)

    def _shape(self, which: int, q: FloatArray) -> FloatArray:
        """Columns (q, w) of an explanation, each as large as its prior says; none (q, 0) for the ground alone."""
        left = which - 1
        for extra in self._extras:
            if 0 <= left < extra.count:
                size, place = divmod(left, extra.places.size)
                chosen = extra.places[place : place + 1]
                columns = _columns(extra.kind, chosen, extra.half_width, q, self._seen.turn)[0].T
                return np.asarray(np.sqrt(extra.variances[size]) * columns)
            left -= extra.count
        return np.zeros((q.size, 0))

    def drawn(self, which: FloatArray, rng: np.random.Generator) -> FloatArray:
        """A curve (len, g) of each chosen explanation: a draw from the prior, corrected by what was seen."""
        seen, lattice, n = self._seen, self._seen.lattice, self._seen.at.size
        both = np.concatenate([seen.at, lattice])
        prior = self._ground.covariance(both, both)
        root, cross = _root(prior), prior[n:, :n]
        found = []
        for index in which:
            shape = self._shape(int(index), both)
            f = root @ rng.standard_normal(both.size) + shape @ rng.standard_normal(shape.shape[1])
            scatter = rng.standard_normal(n) * np.sqrt(self._noise)
            solved = self._against(shape[:n], seen.mean - np.mean(seen.mean) - f[:n] - scatter)
            found.append(f[n:] + cross @ solved + shape[n:] @ (shape[:n].T @ solved))
        return np.asarray(found)

    def _against(self, shape: FloatArray, left: FloatArray) -> FloatArray:
        """The inverse of ground, shape (n, w) and noise together, times ``left`` (n,)."""
        plain = self._inverse.T @ (self._inverse @ left)
        spread = self._inverse.T @ (self._inverse @ shape)
        inner = np.eye(shape.shape[1]) + shape.T @ spread
        return np.asarray(plain - spread @ np.linalg.solve(inner, shape.T @ plain))


def _normalise_weights(evidence: FloatArray) -> FloatArray:
    weights = np.exp(evidence - np.max(evidence))
    return np.asarray(weights / np.sum(weights))


def _root(covariance: FloatArray) -> FloatArray:
    """Its lower Cholesky factor, rounding made up for."""
    size = len(covariance)
    return np.asarray(np.linalg.cholesky(covariance + JITTER * np.trace(covariance) / size * np.eye(size)))
